//! The filter and the smoother with a lag, step by step.

use wayfix::{Hmm, TransitionEntries};

use super::{close, expect};
use crate::counts::Counts;
use crate::draw::Draw;
use crate::model::{Observation, Sensor};
use crate::reference::Chain;

/// Number of steps of the smoother that are checked; the reference goes back at each.
const MOST_STEPS: usize = 12;

pub(super) fn check<A: TransitionEntries<Control: Clone + PartialEq>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    controls: &[A::Control],
    drive: &[Observation],
    chain: &Chain,
    counts: &mut Counts,
) {
    let mut filter = hmm.filter();
    let mut smoother = hmm.fixed_lag(draw.below(5));
    for (k, (control, observation)) in (1..).zip(controls.iter().zip(drive)) {
        if k > chain.len() {
            let before = (filter.snapshot(), smoother.snapshot());
            let stepped = filter.step_with(control, observation);
            assert!(expect("filter", stepped, chain, counts).is_none());
            let stepped = smoother.step_with(control, observation);
            assert!(expect("smoother with a lag", stepped, chain, counts).is_none());
            assert_eq!(filter.snapshot(), before.0, "the filter after an error");
            assert!(smoother.snapshot() == before.1, "the smoother after an error");
            return;
        }
        // In one step or two: the second leaves the log-likelihood to the update, except for
        // that of evidence on the move.
        let log = if draw.one_in(4) {
            let before = filter.log_likelihood();
            filter.predict_with(control).expect("a prediction");
            let evidence = filter.log_likelihood() - before;
            evidence + filter.update(observation).expect("a possible update")
        } else {
            filter.step_with(control, observation).expect("a possible step")
        };
        close::log("log-likelihood of a step", log, chain.steps[k - 1], chain.size());
        assert_eq!(filter.steps(), k);
        close::belief("filter", k, filter.belief().as_slice(), &chain.filtered[k]);
        counts.add("steps of the filter");
        smoother.step_with(control, observation).expect("a possible step");
        if k > MOST_STEPS {
            continue;
        }
        let (expected, _) = chain.smoothed(k);
        for j in k.saturating_sub(smoother.lag())..=k {
            let belief = smoother.get(j).expect("a step of the window");
            close::belief("smoother with a lag", j, belief.as_slice(), &expected[j]);
        }
        counts.add("steps of the smoother with a lag");
    }
    close::log("filter", filter.log_likelihood(), chain.log_likelihood(), chain.size());
}
