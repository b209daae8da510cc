//! Expected moves and times of a step, against integrals.

use proptest::prelude::*;
use wayfix::transition::{LearnTransition, Move, MoveCounts};
use wayfix::{Transition, TransitionEntries};
use wayfix_learn::GeneratorTransition;

use super::{generator, rates};
use crate::kit::{Matrix, cases_of, close, exponential};

/// Nodes and weights of ten points on 0 … 1 (Gauss and Legendre).
const NODES: [(f64, f64); 5] = [
    (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_4),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_1),
];

/// ∫ (exp(Q s) b)_j (exp(Q' (t − s)) a)_i ds.
fn integral(rates: &Matrix, t: f64, b: &[f64], a: &[f64]) -> Matrix {
    let n = rates.len();
    let parts = 24;
    let mut sums = vec![vec![0.0; n]; n];
    for part in 0..parts {
        for (node, weight) in NODES.iter().flat_map(|(x, w)| [(*x, *w), (-x, *w)]) {
            let width = t / f64::from(parts);
            let s = width * (f64::from(part) + 0.5 + 0.5 * node);
            let (before, after) = (exponential(rates, s), exponential(rates, t - s));
            for i in 0..n {
                for j in 0..n {
                    let v: f64 = (0..n).map(|k| before[j][k] * b[k]).sum();
                    let z: f64 = (0..n).map(|k| after[k][i] * a[k]).sum();
                    sums[i][j] += 0.5 * width * weight * v * z;
                }
            }
        }
    }
    sums
}

/// a, so that a' exp(Q t) b is one over `scale`.
fn normalized(a: &GeneratorTransition, t: f64, b: &[f64], after: &[f64], scale: f64) -> Vec<f64> {
    let mut out = vec![0.0; b.len()];
    a.apply(&t, b, &mut out);
    let sum: f64 = out.iter().zip(after).map(|(x, y)| x * y).sum();
    after.iter().map(|a| a / sum / scale).collect()
}

fn unit(n: usize, state: usize) -> Vec<f64> {
    (0..n).map(|i| f64::from(i == state)).collect()
}

proptest! {
    #![proptest_config(cases_of(250))]

    #[test]
    fn moves_and_times_are_integrals(
        rates in rates(4, 0.7),
        t in (-2.0..1.0_f64).prop_map(|x| 10_f64.powf(x)),
        weights in [0.0..1.0, 0.0..1.0_f64, 0.0..1.0, 0.5..1.0],
        scale in prop_oneof![Just(1.0), Just(2_f64.powi(-700)), Just(2_f64.powi(1000))],
    ) {
        let (n, a) = (rates.len(), generator(&rates));
        let b: Vec<f64> = weights[4 - n..].to_vec();
        let after: Vec<f64> = weights[4 - n..].iter().map(|x| 1.5 - x).collect();
        let after = normalized(&a, t, &b, &after, scale);
        let mut sums = a.statistics();
        let total = a.add_step(&mut sums, &t, &b, &after, scale).unwrap();
        close(total, 1.0, 1e-12, 1.0)?;
        let after: Vec<f64> = after.iter().map(|a| a * scale).collect();
        let expected = integral(&rates, t, &b, &after);
        for (j, (time, expected)) in sums.times().iter().zip(&expected).enumerate() {
            close(*time, expected[j], 1e-10, 1e-12)?;
        }
        for ((i, j, rate), found) in a.triplets().zip(sums.moves()) {
            close(*found, rate * expected[i][j], 1e-10, 1e-12)?;
        }
        close(sums.times().iter().sum(), t, 1e-12, 1e-300)?;
    }
}

/// By one series, by segments and by matrices: statistics of parts of a time add up to those of the
/// whole.
#[test]
fn long_steps_are_sums_of_short_ones() {
    let rates = [(1, 0, 2.0), (2, 1, 0.7), (0, 2, 1.0), (3, 0, 1e-3), (0, 3, 2e-3), (1, 2, 0.3)];
    let a = GeneratorTransition::from_triplets(4, rates).unwrap();
    // The same with unreachable states: too many for a matrix.
    let large = GeneratorTransition::from_triplets(600, rates).unwrap();
    for (t, parts) in [(3.0, 2), (20.0, 10), (300.0, 150), (30_000.0, 15_000_u16)] {
        let mut b = vec![0.4, 0.0, 0.6, 0.0];
        let after = normalized(&a, t, &b, &[0.0, 0.2, 0.1, 1.0], 1.0);
        let step = t / f64::from(parts);
        let mut expected = a.statistics();
        // From the last step back: a after each.
        let mut afters = vec![after.clone()];
        for _ in 1..parts {
            let mut out = vec![0.0; 4];
            a.apply_transpose(&step, afters.last().unwrap(), &mut out);
            afters.push(out);
        }
        let start = b.clone();
        for after in afters.iter().rev() {
            a.add_step(&mut expected, &step, &b, after, 1.0).unwrap();
            let mut out = vec![0.0; 4];
            a.apply(&step, &b, &mut out);
            b = out;
        }
        let wide = |x: &[f64], rest: f64| {
            x.iter().copied().chain(std::iter::repeat(rest)).take(600).collect::<Vec<_>>()
        };
        let mut sums = [a.statistics(), large.statistics()];
        let one = a.add_step(&mut sums[0], &t, &start, &after, 1.0).unwrap();
        // No move leads to the unreachable states.
        let same =
            large.add_step(&mut sums[1], &t, &wide(&start, 0.0), &wide(&after, f64::NAN), 1.0);
        for sum in [one, same.unwrap()] {
            assert!((sum - 1.0).abs() < 1e-11, "{sum} at {t}");
        }
        for found in sums {
            for (found, expected) in found.moves().iter().zip(expected.moves()) {
                assert!((found / expected - 1.0).abs() < 1e-10, "{found} for {expected} at {t}");
            }
            for (found, expected) in found.times().iter().zip(expected.times()) {
                assert!((found / expected - 1.0).abs() < 1e-10, "{found} for {expected} at {t}");
            }
        }
    }
}

/// A step after which only an improbable part is possible.
#[test]
fn small_parts_are_whole() {
    let n = 60;
    let line = GeneratorTransition::from_triplets(n, (1..n).map(|i| (i, i - 1, 1.0))).unwrap();
    let b = unit(n, 0);
    for to in [1, 30, 58] {
        for t in [1e-3, 1.0, 200.0] {
            let p = line.outgoing(&t, 0).find(|entry| entry.0 == to).unwrap().1;
            let mut after = vec![0.0; n];
            after[to] = 1.0 / p;
            let mut sums = line.statistics();
            let total = line.add_step(&mut sums, &t, &b, &after, 1.0).unwrap();
            assert!((total - 1.0).abs() < 1e-11, "{to} {t}: {total}");
            // All of these moves were made, and all stays have equal lengths.
            for (from, found) in sums.moves().iter().enumerate() {
                assert!(
                    (found - f64::from(u8::from(from < to))).abs() < 1e-11,
                    "{from} of {to}: {found}"
                );
            }
            for (state, time) in sums.times().iter().enumerate() {
                let expected = if state <= to { t / (to + 1) as f64 } else { 0.0 };
                assert!((time - expected).abs() < 1e-11 * t, "{state} of {to}");
            }
        }
    }
}

#[test]
fn counted_moves_are_bridged() {
    let a = GeneratorTransition::from_triplets(3, [(1, 0, 2.0), (2, 1, 0.5), (0, 2, 3.0)]).unwrap();
    let counts = [(0, 2, 2.0), (0, 1, 1.0), (2, 2, 4.0)];
    let moves = counts.map(|(from, to, weight)| Move { from, to, weight });
    let (mut listed, mut stepped) = (a.statistics(), a.statistics());
    a.counts(&mut listed, &0.7).unwrap().merge(&MoveCounts::from_moves(moves));
    for m in moves {
        let p = a.outgoing(&0.7, m.from).find(|entry| entry.0 == m.to).unwrap().1;
        let after: Vec<f64> = unit(3, m.to).iter().map(|x| x / p * m.weight).collect();
        a.add_step(&mut stepped, &0.7, &unit(3, m.from), &after, 1.0).unwrap();
    }
    let (b, c) = (a.maximize(&listed, 0.5).unwrap(), a.maximize(&stepped, 0.5).unwrap());
    for ((_, _, b), (_, _, c)) in b.triplets().zip(c.triplets()) {
        assert!((b / c - 1.0).abs() < 1e-12, "{b} {c}");
    }
}
