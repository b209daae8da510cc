//! Models and their parts from JSON.

use serde::{Serialize, de::DeserializeOwned};
use wayfix::likelihood::{GroupedLikelihood, Groups, PooledLikelihood, SparseObservation};
use wayfix::motion::{DistanceTransition, OffMapTransition};
use wayfix::transition::{
    ConstrainedTransition, DwellTransition, KroneckerTransition, RestartTransition,
    SwitchedTransition,
};
use wayfix::{
    Belief, DenseTransition, FusedLikelihood, Hmm, Likelihood, LikelihoodVector,
    OptionalLikelihood, Prior, SparseLikelihood, SparseTransition, TableLikelihood, Transition,
    TransitionEntries,
};
use wayfix_learn::GeneratorTransition;

use super::json_recognition::recognition;
use super::read;
use crate::counts::Counts;
use crate::draw::Draw;
use crate::matrices;
use crate::model::{Matrix, Range, weight};
use crate::operators::{Driven, Plain};

/// Larger models are not checked.
const MOST_STATES: usize = 200;

/// Reads a damaged model, or a part of one.
pub fn json_models(bytes: &[u8], counts: &mut Counts) {
    let mut draw = Draw::new(bytes);
    let n = 1 + draw.below(6);
    let draw = &mut draw;
    let range = draw.pick(&[Range::Plain, Range::Wide]);
    let belief = Belief::new(draw.distribution(n, |draw| weight(draw, range))).expect("a belief");
    match draw.below(6) {
        5 => recognition(draw, n, counts),
        0 => sensors(draw, n, counts),
        1 => driven(draw, n, range, counts),
        2 => parts(draw, n, belief, counts),
        _ => plain(draw, n, range, belief, counts),
    }
}

fn sparse(draw: &mut Draw<'_>, n: usize, range: Range) -> SparseTransition {
    SparseTransition::from_rows(&matrices::matrix(draw, n, range)).expect("a matrix")
}

fn plain(draw: &mut Draw<'_>, n: usize, range: Range, belief: Belief, counts: &mut Counts) {
    let base = sparse(draw, n, range);
    let rate = draw.pick(&[0.5, 0.0, 1.0, 1e-9]);
    match draw.below(10) {
        0 | 6 => operator(draw, &base, &(), counts),
        1 => {
            let dense = DenseTransition::from_fn(n, |to, from| base.get(to, from));
            operator(draw, &dense.expect("a matrix"), &(), counts);
        }
        2 => {
            let tied = ConstrainedTransition::new(base).with_ties(|from, to| (from * 3 + to) % 2);
            operator(draw, &tied, &(), counts);
        }
        3 => {
            let log = draw.pick(&[0.0, -7.0, 900.0]);
            let restart = RestartTransition::new(base, rate, belief)
                .and_then(|restart| restart.with_evidence(log));
            // A product that underflows is refused.
            restart.ok().iter().for_each(|a| operator(draw, a, &(), counts));
        }
        4 => {
            let off_map = OffMapTransition::new(base, rate, 0.25, belief);
            off_map.ok().iter().for_each(|a| operator(draw, a, &(), counts));
        }
        5 => {
            let dwell: Matrix =
                (0..n).map(|_| draw.distribution(3, |draw| weight(draw, range))).collect();
            let dwell = DwellTransition::new(base, &dwell).expect("dwell times");
            operator(draw, &dwell, &(), counts);
        }
        7 => {
            let other = sparse(draw, 2, range);
            let pairs = KroneckerTransition::new(base, other).expect("few states");
            operator(draw, &pairs, &(), counts);
        }
        8 => {
            let moves = base.triplets().filter(|&(to, from, p)| to != from && p > 1e-290);
            let generator = GeneratorTransition::from_triplets(n, moves).expect("rates");
            let time = draw.pick(&[1.5, 0.0, 1e6, 1e300]);
            if let Some(a) =
                read(draw, &generator, counts).filter(|a| a.check_control(&time).is_ok())
            {
                usable(&a, &time, counts);
            }
        }
        _ => {
            if let (Plain::Window(window), _) = matrices::plain(draw, n, range) {
                operator(draw, &window, &(), counts);
            }
        }
    }
}

fn driven(draw: &mut Draw<'_>, n: usize, range: Range, counts: &mut Counts) {
    match matrices::driven(draw, n, range).0 {
        Driven::Switched(a, controls) => {
            operator::<SwitchedTransition<_>>(draw, &a, &controls[0], counts);
        }
        Driven::Route(a, controls) => {
            operator(draw, &a, &controls[0], counts);
            if let Some(control) = read(draw, &controls[0], counts)
                && a.check_control(&control).is_ok()
            {
                usable(&a, &control, counts);
            }
        }
        Driven::Distance(a, controls) => {
            operator::<DistanceTransition>(draw, &a, &controls[0], counts);
        }
        Driven::Generator(a, times) => operator(draw, &a, &times[0], counts),
        // Functions are not stored.
        Driven::Measured(..) | Driven::Restart(..) | Driven::Pairs(..) => {}
    }
}

fn parts(draw: &mut Draw<'_>, n: usize, belief: Belief, counts: &mut Counts) {
    let groups = Groups::new((0..n).map(|i| i / 2).collect()).expect("groups");
    match draw.below(4) {
        0 => {
            if let Some(belief) = read(draw, &belief, counts) {
                // Probabilities that sum to slightly more than one have a smaller entropy.
                assert!(belief.entropy() >= -2e-9 && belief.mode() < belief.states());
                assert!((belief.as_slice().iter().sum::<f64>() - 1.0).abs() < 2e-9);
            }
        }
        1 => {
            if let Some(groups) = read(draw, &groups, counts)
                && groups.as_slice().len() == n
            {
                let sum: f64 = groups.marginal(&belief).expect("groups").as_slice().iter().sum();
                assert!((sum - 1.0).abs() < 2e-9);
            }
        }
        2 => {
            let _ = read(draw, &Prior::AtFirstObservation(belief), counts);
        }
        _ => {
            let table = table(draw, n);
            let motion = sparse(draw, n, Range::Plain);
            let hmm =
                Hmm::new(Prior::BeforeFirstTransition(belief), motion, table).expect("a model");
            let hmm = if draw.one_in(2) { hmm.with_rounded_tails() } else { hmm };
            let Some(hmm) = read(draw, &hmm, counts) else { return };
            usable(hmm.transition(), &(), counts);
            for ys in [vec![0], vec![0, 1, 2], vec![2; 12]] {
                let smoothing = hmm.smooth(&ys);
                // A decoder keeps the tails that the other rounds to 0.
                let decoded = hmm.viterbi(&ys);
                assert!(decoded.is_ok() || smoothing.is_err(), "{smoothing:?}");
                assert!(hmm.rounds_tails() || smoothing.is_ok() == decoded.is_ok());
                for belief in smoothing.iter().flat_map(|s| s.posteriors().with_start()) {
                    assert!((belief.as_slice().iter().sum::<f64>() - 1.0).abs() < 1e-9);
                }
            }
        }
    }
}

fn table(draw: &mut Draw<'_>, n: usize) -> TableLikelihood {
    let rows: Matrix =
        (0..n).map(|_| draw.distribution(3, |draw| weight(draw, Range::Plain))).collect();
    TableLikelihood::from_rows(&rows).expect("a table")
}

fn sensors(draw: &mut Draw<'_>, n: usize, counts: &mut Counts) {
    let table = table(draw, n);
    let groups = || Groups::new((0..=n).map(|i| i.min(n - 1)).collect()).expect("groups");
    match draw.below(7) {
        0 => sensor(draw, &table, &1, counts),
        1 => sensor(draw, &LikelihoodVector::log(n).owned(), &vec![-1.0; n], counts),
        2 => sensor(draw, &SparseLikelihood::new(n), &SparseObservation::known(0), counts),
        3 => sensor(draw, &OptionalLikelihood::new(table), &Some(2), counts),
        4 => {
            let known = OptionalLikelihood::new(SparseLikelihood::new(n));
            let fused = FusedLikelihood::new(table, known).expect("as many states");
            sensor(draw, &fused, &(0, None), counts);
        }
        5 => {
            let grouped = GroupedLikelihood::new(table, groups()).expect("as many groups");
            sensor(draw, &grouped, &1, counts);
        }
        _ => {
            let pooled = PooledLikelihood::new(self::table(draw, n + 1), groups());
            sensor(draw, &pooled.expect("as many states"), &1, counts);
        }
    }
}

fn operator<A>(draw: &mut Draw<'_>, a: &A, control: &A::Control, counts: &mut Counts)
where
    A: TransitionEntries + Serialize + DeserializeOwned,
{
    if let Some(a) = read(draw, a, counts)
        && a.check_control(control).is_ok()
    {
        usable(&a, control, counts);
    }
}

/// Products and entries of an operator, whose columns sum to one.
fn usable<A: TransitionEntries>(a: &A, control: &A::Control, counts: &mut Counts) {
    let n = a.states();
    if n > MOST_STATES {
        return counts.add("operators too large to use");
    }
    let (ones, mut out, mut best, mut from) =
        (vec![1.0; n], vec![f64::NAN; n], vec![f64::NAN; n], vec![0; n]);
    a.apply_transpose(control, &ones, &mut out);
    let evidence = a.evidence(control).is_some();
    for (j, sum) in out.iter().enumerate() {
        let one = (sum - 1.0).abs() < 1e-8 || (evidence && (0.0..=2.0).contains(sum));
        assert!(one, "column {j} sums to {sum:e}");
        let listed: f64 = a.outgoing(control, j).map(|entry| entry.1).sum();
        let same = (listed - sum).abs() < 1e-8;
        assert!(same, "the entries of column {j} sum to {listed:e}, its product to {sum:e}");
    }
    let columns: f64 = out.iter().sum();
    a.apply(control, &ones, &mut out);
    let sum: f64 = out.iter().sum();
    let same = (sum - columns).abs() < 1e-8 * n as f64;
    assert!(same, "the product sums to {sum:e}, that of the transpose to {columns:e}");
    a.max_product(control, &vec![0.0; n], &mut best, &mut from);
    for i in 0..n {
        let most = a.incoming(control, i).map(|entry| entry.1.log2());
        let most = most.fold(f64::NEG_INFINITY, f64::max);
        let near = best[i] == most || (best[i] - most).abs() < 1e-9 || most < -1000.0;
        assert!(near, "the best way to {i} has {}, expected {most}", best[i]);
    }
    counts.add("operators used");
}

/// Checks that a sensor takes an observation, or returns an error.
fn sensor<B>(draw: &mut Draw<'_>, sensor: &B, observation: &B::Observation, counts: &mut Counts)
where
    B: Likelihood + Serialize + DeserializeOwned,
{
    let Some(sensor) = read(draw, sensor, counts) else { return };
    let n = sensor.states();
    if n > MOST_STATES || n == 0 {
        return counts.add("sensors too large to use");
    }
    let prior = Prior::AtFirstObservation(Belief::uniform(n).expect("a state"));
    let still = DenseTransition::from_fn(n, |to, from| f64::from(to == from)).expect("a matrix");
    let hmm = Hmm::new(prior, still, sensor).expect("a model");
    let mut filter = hmm.filter();
    for _ in 0..2 {
        let log = match filter.step(observation) {
            Ok(log) => log,
            Err(error) => return super::check_message(&error),
        };
        let sum: f64 = filter.belief().as_slice().iter().sum();
        assert!(!log.is_nan() && (sum - 1.0).abs() < 1e-9, "{log}, a belief that sums to {sum}");
    }
    counts.add("sensors used");
}
