//! The gears of a vehicle, and how the labelled part of a recording uses them.

use std::error::Error;

use wayfix::{Belief, DenseTransition, Gear, Hmm, LikelihoodVector, Prior, TransitionError};

/// How often a gear that was not seen in the labelled part counts as seen.
const UNSEEN: f64 = 1.0;
/// The share of moves that are one place off the gear's, on either side, before
/// any are seen; and how many moves that counts for.
pub(crate) const SLACK: f64 = 0.02;
const SLACK_COUNT: f64 = 20.0;

/// Reverse, stand, half, one, two, any.
pub(crate) fn all(slack: f64) -> Result<Vec<Gear>, TransitionError> {
    Ok(vec![
        Gear::speed(-1.0, slack)?,
        Gear::speed(0.0, 0.0)?,
        Gear::speed(0.5, slack)?,
        Gear::speed(1.0, slack)?,
        Gear::speed(2.0, slack)?,
        Gear::uniform(-3..=4)?,
    ])
}

/// How much each gear was used, how often it changed, and how many moves were
/// off the gear's on either side: by smoothing the labelled moves with a model of
/// gears alone.
pub(crate) fn used(
    gears: &[Gear],
    moves: &[Vec<(usize, usize, isize)>],
) -> Result<(Vec<f64>, f64, f64), Box<dyn Error>> {
    let k = gears.len();
    let keep = DenseTransition::from_fn(
        k,
        |to, from| {
            if to == from { 0.98 } else { 0.02 / (k - 1) as f64 }
        },
    )?;
    let prior = Prior::AtFirstObservation(Belief::uniform(k)?);
    let hmm = Hmm::new(prior, keep, LikelihoodVector::linear(k))?;
    let (mut used, mut changed, mut all) = (vec![UNSEEN; k], 1.0, 2.0);
    let (mut off, mut count) = (2.0 * SLACK * SLACK_COUNT, SLACK_COUNT);
    for part in moves {
        let likelihood = |moved: isize| -> Vec<f64> {
            let of = |gear: &Gear| {
                let at = usize::try_from(moved - gear.first()).ok();
                at.and_then(|at| gear.weights().get(at)).copied().unwrap_or(0.0)
            };
            let likelihoods: Vec<f64> = gears.iter().map(of).collect();
            // A jump that no gear makes says nothing.
            if likelihoods.iter().all(|p| *p == 0.0) { vec![1.0; k] } else { likelihoods }
        };
        let seen: Vec<Vec<f64>> = part.iter().map(|(_, _, moved)| likelihood(*moved)).collect();
        let smoothing = hmm.smooth(&seen)?;
        for (belief, likelihoods) in smoothing.posteriors().iter().skip(1).zip(&seen) {
            used.iter_mut().zip(belief.as_slice()).for_each(|(used, p)| *used += p);
            let pairs = belief.as_slice().iter().zip(likelihoods);
            off += pairs.filter(|pair| *pair.1 == SLACK).map(|pair| pair.0).sum::<f64>();
            count += 1.0;
        }
        for moved in hmm.expected_moves(&seen)?.moves() {
            all += moved.weight;
            changed += if moved.from == moved.to { 0.0 } else { moved.weight };
        }
    }
    let sum: f64 = used.iter().sum();
    let used = used.into_iter().map(|used| used / sum).collect();
    Ok((used, changed / all, 0.5 * off / count))
}
