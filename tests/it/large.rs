//! Maps so large that several threads share a step.

use std::collections::BTreeSet;

use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition, Transition};

/// More than three blocks of lines, and not a multiple of eight.
const PLACES: usize = 131_071;

/// Moves: a stay, to the next place, or to some other place.
fn roads() -> Vec<(usize, usize, f64)> {
    let of = |from: usize| {
        let to = BTreeSet::from([from, (from + 1) % PLACES, from * 7919 % PLACES]);
        let each = 1.0 / to.len() as f64;
        to.into_iter().map(move |to| (to, from, each))
    };
    (0..PLACES).flat_map(of).collect()
}

fn seen() -> Vec<Vec<f64>> {
    let of = |step: usize| {
        let b = move |place: usize| 0.1 + ((place * 31 + step * 17) % 101) as f64;
        (0..PLACES).map(b).collect()
    };
    (1..4).map(of).collect()
}

fn hmm() -> Hmm<SparseTransition, LikelihoodVector> {
    let transition = SparseTransition::from_triplets(PLACES, roads()).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(PLACES).unwrap());
    Hmm::new(prior, transition, LikelihoodVector::linear(PLACES)).unwrap()
}

/// Adds p `x[from]` to `out[to]` over all roads, or in the other direction.
fn product(roads: &[(usize, usize, f64)], x: &[f64], transposed: bool) -> Vec<f64> {
    let mut out = vec![0.0; PLACES];
    for &(to, from, p) in roads {
        if transposed { out[from] += p * x[to] } else { out[to] += p * x[from] }
    }
    out
}

fn assert_close(found: &[f64], expected: &[f64]) {
    let close = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * b;
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(close));
}

#[test]
fn filter_and_smoother_are_as_defined() {
    let (hmm, roads, seen) = (hmm(), roads(), seen());
    let mut belief = vec![1.0 / PLACES as f64; PLACES];
    let (mut beliefs, mut log_likelihood) = (Vec::new(), 0.0);
    for b in &seen {
        belief = product(&roads, &belief, false);
        belief.iter_mut().zip(b).for_each(|(belief, b)| *belief *= b);
        let sum: f64 = belief.iter().sum();
        belief.iter_mut().for_each(|belief| *belief /= sum);
        log_likelihood += sum.ln();
        beliefs.push(belief.clone());
    }
    let smoothing = hmm.smooth(&seen[..]).unwrap();
    assert!((smoothing.log_likelihood() - log_likelihood).abs() <= 1e-11);
    let mut back = vec![1.0; PLACES];
    for (k, belief) in beliefs.iter().enumerate().rev() {
        let mut gamma: Vec<f64> = belief.iter().zip(&back).map(|(a, b)| a * b).collect();
        let sum: f64 = gamma.iter().sum();
        gamma.iter_mut().for_each(|gamma| *gamma /= sum);
        assert_close(smoothing.posteriors().get(k + 1).unwrap().as_slice(), &gamma);
        back.iter_mut().zip(&seen[k]).for_each(|(back, b)| *back *= b);
        back = product(&roads, &back, true);
    }
    let mut forward = vec![f64::NAN; PLACES];
    hmm.transition().apply(&(), &seen[0], &mut forward);
    assert_close(&forward, &product(&roads, &seen[0], false));
    let mut filter = hmm.filter();
    for (b, belief) in seen.iter().zip(&beliefs) {
        filter.step(b).unwrap();
        assert_close(filter.belief().as_slice(), belief);
    }
}

/// Results are the same for any number of threads.
#[cfg(feature = "rayon")]
#[test]
fn threads_do_not_change_a_bit() {
    let (hmm, seen) = (hmm(), seen());
    let results = [1, 2, 4].map(|threads| {
        crate::threads::with_threads(threads, || {
            let mut back = vec![f64::NAN; PLACES];
            hmm.transition().apply_transpose(&(), &seen[0], &mut back);
            (hmm.smooth(&seen[..]).unwrap(), hmm.forward(&seen[..]).unwrap(), back)
        })
    });
    assert!(results.iter().all(|result| *result == results[0]));
    assert_eq!(hmm.forward(&seen[..]).unwrap(), results[0].1);
}
