//! Each kernel with every set of instructions that the machine has: the same
//! bits, and what a loop over the entries gives.

use proptest::collection::vec;
use proptest::prelude::*;

use super::abreast::{Abreast, Unravel};
use super::aligned::Aligned;
use super::lanes::{Eight, Isa, LANES, run_on};
use super::largest::{Largest, Valid};
use super::max::{Add, Log2OfLogs, Maximize, Shifted};
use super::product::{Made, Multiply, Part, Sparse};
use super::retreat::{BACK_LIFT, Retreat, Weigh};
use super::segments::{Few, Products};
use super::segments_filter::Filter;
use super::segments_smooth::Smooth;
use super::sliced::Sliced;
use super::survey::Look;
use super::update::{Settle, SettleAndLift, Update, Updated, Watch};
use super::{LIFT, log2, on_grid};

type Rows = Vec<Vec<(u32, f64)>>;

/// Rows with diagonals, scattered entries, and now and then a very long one.
fn rows() -> impl Strategy<Value = Rows> {
    (1..70_usize).prop_flat_map(|n| {
        let few = vec((0..n as u32, 0.01..1.0), 0..6);
        let many = vec((0..n as u32, 0.01..1.0), 0..60);
        let near = vec(prop_oneof![Just(0.0), 0.01..1.0], 3);
        let row = (prop_oneof![9 => few, 1 => many], near);
        vec(row, n).prop_map(move |rows| {
            let lines = rows.into_iter().enumerate().map(|(i, (mut entries, near))| {
                let beside = near.iter().zip(i.saturating_sub(1)..).filter(|(p, _)| **p > 0.0);
                entries.extend(beside.filter(|(_, j)| *j < n).map(|(p, j)| (j as u32, *p)));
                entries.sort_by_key(|entry| entry.0);
                entries.dedup_by_key(|entry| entry.0);
                entries
            });
            lines.collect()
        })
    })
}

fn sliced(rows: &Rows) -> Sliced {
    let split: Vec<(Vec<u32>, Vec<f64>)> =
        rows.iter().map(|row| row.iter().copied().unzip()).collect();
    Sliced::new(rows.len(), |line| (&split[line].0, &split[line].1))
}

fn product(rows: &Rows, x: &[f64]) -> Vec<f64> {
    let sum = |row: &Vec<(u32, f64)>| row.iter().map(|&(j, p)| p * x[j as usize]).sum();
    rows.iter().map(sum).collect()
}

/// What a kernel gives with each set of instructions: the same.
fn everywhere<R: PartialEq + std::fmt::Debug>(run: impl Fn(Isa) -> R) -> R {
    let expected = run(Isa::Plain);
    for isa in [Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.is_here()) {
        assert_eq!(run(isa), expected, "{isa:?}");
    }
    expected
}

fn close(found: &[f64], expected: &[f64]) -> Result<(), TestCaseError> {
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        prop_assert!(error <= 1e-13 * expected.abs(), "{found}, expected {expected} at {i}");
    }
    Ok(())
}

fn sum_is(found: f64, terms: &[f64]) -> Result<(), TestCaseError> {
    close(&[found], &[terms.iter().sum()])
}

/// As many numbers as there are rows, some of them 0.
fn numbers(from: &[f64], n: usize) -> Vec<f64> {
    from.iter().copied().cycle().take(n).collect()
}

fn some_zero() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(0.0), 5 => 0.001..1.0], 71)
}

fn scores() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(f64::NEG_INFINITY), 3 => (-4..4).prop_map(f64::from)], 71)
}

/// As many cases as `WAYFIX_CASES` says, or 256.
fn cases() -> ProptestConfig {
    let cases = std::env::var("WAYFIX_CASES").ok().and_then(|text| text.parse().ok());
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases.unwrap_or(256)) }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn products_and_updates(
        rows in rows(), x in some_zero(), b in some_zero(), lifted in any::<bool>(),
        watch in prop::sample::select(vec![Watch::Nothing, Watch::Products, Watch::Predictions]),
        tiny in prop_oneof![4 => Just(1.0), 1 => Just(1e-305)],
    ) {
        let (n, matrix) = (rows.len(), sliced(&rows));
        let lift = if lifted { LIFT } else { 1.0 };
        let x: Vec<f64> = numbers(&x, n).iter().map(|x| x * lift).collect();
        let b: Vec<f64> = numbers(&b, n).iter().map(|b| b * tiny).collect();
        let p = product(&rows, &x);
        let found = everywhere(|isa| {
            let mut out = vec![f64::NAN; n];
            let product = Part::all(Sparse { matrix: &matrix, x: &x });
            run_on(isa, Multiply { product, out: &mut out });
            out
        });
        close(&found, &p)?;

        let expected: Vec<f64> = p.iter().zip(&b).map(|(p, b)| p * b).collect();
        let (out, updated) = everywhere(|isa| {
            let mut out = vec![f64::NAN; n];
            let prediction = Part::all(Sparse { matrix: &matrix, x: &x });
            let likelihoods = &b;
            let updated =
                run_on(isa, Update { prediction, lift, likelihoods, watch, out: &mut out });
            (out, updated)
        });
        if tiny == 1.0 || lifted {
            close(&out, &expected)?;
            sum_is(updated.products, &expected)?;
        }
        let small = p.iter().zip(&b).any(|(&p, &b)| {
            p > 0.0 && (b > 0.0 || watch == Watch::Predictions) && p * b < lift / LIFT
        });
        let small = small && watch != Watch::Nothing;
        prop_assert_eq!(updated.small, small);
        prop_assert_eq!(updated.largest_likelihood, b.iter().copied().fold(0.0, f64::max));
        prop_assert!(!updated.negative_likelihood);

        // The same with a prediction that has been made, which is looked at.
        let (made, seen) = everywhere(|isa| {
            let mut out = vec![f64::NAN; n];
            let update = Update {
                prediction: Part::all(Made(&found)), lift, likelihoods: &b, watch, out: &mut out,
            };
            (run_on(isa, update), out)
        });
        sum_is(made.predicted, &found)?;
        prop_assert_eq!(Updated { predicted: lift, ..made }.products, updated.products);
        prop_assert_eq!(seen, out);
    }

    #[test]
    fn bad_likelihoods_and_predictions_are_seen(
        good in vec(0.1..1.0, 1..40_usize), at in any::<prop::sample::Index>(),
        bad in prop::sample::select(vec![-1.0, f64::NAN, f64::INFINITY]), which in any::<bool>(),
    ) {
        let mut other = good.clone();
        other[at.index(good.len())] = bad;
        let (p, b) = if which { (&other, &good) } else { (&good, &other) };
        let seen = everywhere(|isa| {
            let mut out = vec![0.0; good.len()];
            let prediction = Part::all(Made(p));
            let updated = run_on(
                isa,
                Update { prediction, lift: 1.0, likelihoods: b, watch: Watch::Products, out: &mut out },
            );
            let Updated { products, negative_predicted, negative_likelihood, .. } = updated;
            (products.is_finite(), negative_predicted, negative_likelihood)
        });
        prop_assert_eq!(seen, (bad == -1.0, bad == -1.0 && which, bad == -1.0 && !which));
    }

    #[test]
    fn beliefs_are_settled(
        x in some_zero(), n in 1..70_usize,
        factor in prop_oneof![3 => Just(1.0), 1 => Just(1e-280), 1 => Just(1e-306)],
    ) {
        let mut x = numbers(&x, n);
        let least = n / 2;
        x[least] *= factor;
        let sum: f64 = x.iter().sum();
        prop_assume!(sum >= 0.001);
        let expected: Vec<f64> = x.iter().map(|x| x / sum).collect();
        let any_tiny = expected.iter().any(|&p| 0.0 < p && p < 2.0_f64.powi(-900));
        let (settled, tiny) = everywhere(|isa| {
            let mut x = x.clone();
            let tiny = run_on(isa, Settle { x: &mut x, sum });
            (x, tiny)
        });
        if factor > 1e-300 {
            close(&settled, &expected)?;
            prop_assert_eq!(tiny, any_tiny);
        }
        // Lifted, what is below the smallest normal double becomes 0.
        let rounded = |&p: &f64| if p < f64::MIN_POSITIVE { 0.0 } else { p };
        let expected: Vec<f64> = expected.iter().map(rounded).collect();
        let any_tiny = expected.iter().any(|&p| 0.0 < p && p < 2.0_f64.powi(-900));
        let (lifted, out, tiny) = everywhere(|isa| {
            let mut x: Vec<f64> = x.iter().map(|x| x * LIFT).collect();
            let mut out = vec![f64::NAN; n];
            let tiny = run_on(isa, SettleAndLift { x: &mut x, out: &mut out, sum: sum * LIFT });
            (x, out, tiny)
        });
        close(&out, &expected)?;
        prop_assert_eq!(tiny, any_tiny);
        prop_assert!(lifted.iter().zip(&out).all(|(lifted, out)| *lifted == out * LIFT));
    }

    #[test]
    fn steps_back(rows in rows(), q in some_zero(), b in some_zero(), alpha in some_zero()) {
        let (n, matrix) = (rows.len(), sliced(&rows));
        let [q, b, alpha] = [q, b, alpha].map(|v| numbers(&v, n));
        let q: Vec<f64> = q.iter().map(|q| q * BACK_LIFT).collect();
        let ratio = everywhere(|isa| {
            let mut ratio = vec![f64::NAN; n];
            run_on(isa, Weigh { q: &q, likelihoods: &b, factor: 0.3, ratio: &mut ratio });
            ratio
        });
        let expected: Vec<f64> = q.iter().zip(&b).map(|(q, b)| q * b * 0.3).collect();
        close(&ratio, &expected)?;
        let (gamma, back, sum) = everywhere(|isa| {
            let (mut gamma, mut back) = (vec![f64::NAN; n], vec![f64::NAN; n]);
            let product = Part::all(Sparse { matrix: &matrix, x: &ratio });
            let retreat =
                Retreat { back: product, alpha: &alpha, gamma: &mut gamma, q: &mut back };
            let sum = run_on(isa, retreat);
            (gamma, back, sum)
        });
        let expected = product(&rows, &ratio);
        close(&back, &expected)?;
        let expected: Vec<f64> =
            expected.iter().zip(&alpha).map(|(q, alpha)| q / BACK_LIFT * alpha).collect();
        close(&gamma, &expected)?;
        sum_is(sum, &gamma)?;
    }

    /// They are doubles to the bit, in all that goes through a matrix.
    #[test]
    fn values_of_32_bits(rows in rows(), x in some_zero(), b in some_zero()) {
        let n = rows.len();
        let split: Vec<(Vec<u32>, Vec<f32>)> =
            rows.iter().map(|row| row.iter().map(|&(j, p)| (j, p as f32)).unzip()).collect();
        let single = Sliced::new(n, |line| (&split[line].0, &split[line].1));
        let rounded = |row: &Vec<(u32, f64)>| {
            row.iter().map(|&(j, p)| (j, f64::from(p as f32))).collect()
        };
        let double = sliced(&rows.iter().map(rounded).collect());
        let (x, b) = (numbers(&x, n), numbers(&b, n));
        let results = |matrix: &Sliced| everywhere(|isa| {
            let mut out = vec![vec![f64::NAN; n]; 5];
            let [product, updated, gamma, q, next] = &mut out[..] else { unreachable!() };
            let part = Part::all(Sparse { matrix, x: &x });
            run_on(isa, Multiply { product: part, out: product });
            let seen = run_on(isa, Update {
                prediction: part, lift: 1.0, likelihoods: &b, watch: Watch::Products, out: updated,
            });
            let sum = run_on(isa, Retreat { back: part, alpha: &b, gamma, q });
            let mut from = vec![0; n];
            let log2 = matrix.log2();
            let largest = run_on(isa, Maximize {
                matrix, log2: &log2, x: &x, likelihoods: None, next, from: &mut from,
            });
            (out, seen, sum, from, largest)
        });
        prop_assert_eq!(results(&single), results(&double));
    }

    /// Scores are small whole numbers, so that ties abound.
    #[test]
    fn best_ways(
        rows in rows(), x in scores(), b in scores(), observed in any::<bool>(),
        natural in any::<bool>(),
    ) {
        let rows: Rows = rows
            .iter()
            .map(|row| row.iter().map(|&(j, p)| (j, if p < 0.5 { 0.25 } else { 0.5 })).collect())
            .collect();
        let (n, matrix) = (rows.len(), sliced(&rows));
        let (x, b) = (numbers(&x, n), numbers(&b, n));
        let values = matrix.log2();
        let most = b.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let natural = (natural && most.is_finite()).then_some(most);
        let likelihoods = observed.then_some(Shifted { scores: &b, shift: 1.0, natural });
        let added = |i: usize| match natural {
            _ if !observed => 0.0,
            Some(most) => on_grid((b[i] - most) * std::f64::consts::LOG2_E) - 1.0,
            None => b[i] - 1.0,
        };
        let (next, from, largest) = everywhere(|isa| {
            let (mut next, mut from) = (vec![f64::NAN; n], vec![0; n]);
            let largest = run_on(isa, Maximize {
                matrix: &matrix, log2: &values, x: &x, likelihoods,
                next: &mut next, from: &mut from,
            });
            // Where nothing leads, from means nothing.
            let ways = next.iter().zip(&from);
            let from: Vec<u32> = ways.map(|(s, j)| if s.is_finite() { *j } else { 0 }).collect();
            (next, from, largest)
        });
        for (i, row) in rows.iter().enumerate() {
            let mut best = (f64::NEG_INFINITY, 0);
            for &(j, p) in row {
                let score = log2(p) + x[j as usize];
                if score > best.0 {
                    best = (score, j);
                }
            }
            let score = best.0 + added(i);
            prop_assert_eq!(next[i], score);
            prop_assert!(!score.is_finite() || from[i] == best.1, "{} {:?}", from[i], best);
        }
        prop_assert_eq!(largest, next.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        let (sums, most) = everywhere(|isa| {
            let mut scores = x.clone();
            let most = run_on(isa, Add { scores: &mut scores, added: likelihoods });
            (scores, most)
        });
        for (i, sum) in sums.iter().enumerate() {
            prop_assert_eq!(*sum, x[i] + added(i));
        }
        prop_assert_eq!(most, sums.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    }

    #[test]
    fn the_largest(
        mut x in vec(-3.0..3.0, 1..40_usize), at in any::<prop::sample::Index>(),
        odd in prop::sample::select(vec![
            0.0, -0.0, 1e300, -1e300, 1.1e300, -1.1e300, f64::MAX, f64::INFINITY,
            f64::NEG_INFINITY, f64::NAN,
        ]),
    ) {
        let at = at.index(x.len());
        x[at] = odd;
        let logs = odd.abs() <= 1e300 || odd == f64::NEG_INFINITY;
        let found = everywhere(|isa| run_on(isa, Largest { x: &x, valid: Valid::Logs }));
        prop_assert_eq!(found.1, logs);
        if logs {
            prop_assert_eq!(found.0, x.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        }
        x.iter_mut().enumerate().filter(|(i, _)| *i != at).for_each(|(_, x)| *x = x.abs());
        let likelihoods = odd >= 0.0 && odd.is_finite();
        let found = everywhere(|isa| run_on(isa, Largest { x: &x, valid: Valid::Likelihoods }));
        prop_assert_eq!(found.1, likelihoods);
        if likelihoods {
            prop_assert_eq!(found.0, x.iter().copied().fold(0.0, f64::max));
        }
    }

    /// Rows of any lengths, some of which do not begin on a line of a cache.
    #[test]
    fn unravelled(
        eights in vec(vec(0.0..1.0, LANES), 1..20), counts in vec(0..20_usize, LANES),
        shift in 0..2_usize, stream in any::<bool>(),
    ) {
        let mut from: Vec<Abreast> =
            eights.iter().map(|eight| Abreast(std::array::from_fn(|l| eight[l]))).collect();
        from.resize(from.len().next_multiple_of(LANES), Abreast::default());
        let counts: Vec<usize> = counts.iter().map(|c| (*c).min(from.len() / LANES)).collect();
        let all = everywhere(|isa| {
            let mut all = Aligned::new(counts.iter().sum::<usize>() * LANES + shift, -1.0);
            let mut left = all[shift..].as_chunks_mut::<LANES>().0;
            let mut rows: [&mut [Eight]; LANES] = std::array::from_fn(|_| &mut [][..]);
            for (row, count) in rows.iter_mut().zip(&counts) {
                let (own, others) = left.split_at_mut(*count);
                (*row, left) = (own, others);
            }
            run_on(isa, Unravel { from: &from, rows, stream });
            all[shift..].to_vec()
        });
        let mut all = all.iter();
        for (l, count) in counts.iter().enumerate() {
            for from in &from[..count * LANES] {
                prop_assert_eq!(all.next(), Some(&from[l]));
            }
        }
        prop_assert_eq!(all.next(), None);
    }

    #[test]
    fn logarithms(logs in vec(prop_oneof![1 => Just(f64::NEG_INFINITY), 9 => -900.0..700.0], 1..40)) {
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        prop_assume!(largest.is_finite());
        let found = everywhere(|isa| {
            let mut out = vec![f64::NAN; logs.len()];
            run_on(isa, Log2OfLogs { logs: &logs, largest, out: &mut out });
            out
        });
        for (found, log) in found.iter().zip(&logs) {
            prop_assert_eq!(*found, on_grid((log - largest) * std::f64::consts::LOG2_E));
        }
    }

    /// Products of matrices over eight segments, then both recursions in each.
    #[test]
    fn segments(
        columns in vec(some_zero(), 3), steps in 1..40_usize, b in vec(0.001..2.0, 300),
        sharp in any::<bool>(), zero in any::<prop::sample::Index>(),
    ) {
        const N: usize = 3;
        let columns: [[f64; N]; N] =
            std::array::from_fn(|j| std::array::from_fn(|i| columns[j][i] + f64::from(i == j)));
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
        let unlooked = if sharp { 1 } else { 4 };
        let mut likelihoods = vec![[Abreast::default(); N]; steps];
        let values = likelihoods.as_flattened_mut().iter_mut().flat_map(|b| b.0.iter_mut());
        for (to, (number, b)) in values.zip(b.iter().cycle().enumerate()) {
            *to = b * if sharp && number % 7 == 0 { 1e-10 } else { 1.0 };
        }
        likelihoods[zero.index(steps)][1].0[5] = 0.0;
        let model = Few { columns: &columns, rows: &rows, unlooked };
        let products = everywhere(|isa| run_on(isa, Products { model, likelihoods: &likelihoods }));
        let products = products.expect("no range is too wide");
        let (starts, ends) = ([[0.3; 8]; N], [[0.7; 8]; N]);
        let smoothed = everywhere(|isa| {
            let mut out = vec![[Abreast::default(); N]; steps];
            let likelihoods = &likelihoods;
            let work = Smooth { model, starts: &starts, ends: &ends, likelihoods, out: &mut out };
            (run_on(isa, work), out)
        });
        prop_assert!(smoothed.0);
        let filtered = everywhere(|isa| {
            let mut out = vec![[Abreast::default(); N]; steps];
            let mut normalisers = vec![Abreast::default(); steps];
            let work = Filter {
                model, starts: &starts, likelihoods: &likelihoods,
                out: &mut out, normalisers: &mut normalisers,
            };
            (run_on(isa, work), out, normalisers)
        });
        prop_assert!(filtered.0);
        let survey = everywhere(|isa| run_on(isa, Look(&likelihoods)));
        let all = || likelihoods.as_flattened().iter().flat_map(|b| b.0);
        let most = |k: usize, l| likelihoods[k].iter().map(|b| b.0[l]).fold(0.0, f64::max);
        let each = || (0..steps).flat_map(|k| (0..8).map(move |l| most(k, l)));
        let lowest = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::INFINITY, f64::min);
        prop_assert_eq!(survey.largest, all().fold(0.0, f64::max));
        prop_assert_eq!(survey.least, lowest(&mut all().filter(|b| *b > 0.0)));
        prop_assert_eq!(survey.least_largest, lowest(&mut each()));
        prop_assert!(!survey.nan);
        let mut broken = likelihoods.clone();
        broken[zero.index(steps)][2].0[zero.index(8)] = f64::NAN;
        prop_assert!(everywhere(|isa| run_on(isa, Look(&broken)).nan));

        for l in 0..8 {
            let b = |k: usize| likelihoods[k].map(|b| b.0[l]);
            // In logarithms to base 2 of the scale, and a vector of any scale.
            let forward = |x: [f64; N], until: usize| (0..until).fold((x, 0.0), |(x, log), k| {
                let product: [f64; N] =
                    std::array::from_fn(|i| b(k)[i] * (0..N).map(|j| rows[i][j] * x[j]).sum::<f64>());
                let sum = product.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                (product.map(|p| p / sum), log + sum.log2())
            });
            let backward = |after: usize| (after..steps).rev().fold([0.7; N], |r, k| {
                let r: [f64; N] = std::array::from_fn(|i| b(k)[i] * r[i]);
                let product: [f64; N] =
                    std::array::from_fn(|j| (0..N).map(|i| columns[j][i] * r[i]).sum());
                let sum: f64 = product.iter().sum();
                product.map(|p| p / sum)
            });
            for (j, column) in products.iter().enumerate() {
                let (x, log) = forward(std::array::from_fn(|i| f64::from(i == j)), steps);
                let found = column.values.map(|x| x[l]);
                let sum: f64 = found.iter().sum();
                if sum == 0.0 {
                    prop_assert_eq!(x, [0.0; N]);
                    continue;
                }
                close(&found.map(|x| x / sum), &x)?;
                let exponent = sum.log2() + column.exponents[l];
                prop_assert!((exponent - log).abs() <= 1e-9, "{exponent}, expected {log}");
            }
            for k in 0..steps {
                let (x, r) = (forward([0.3; N], k + 1).0, backward(k + 1));
                let sum: f64 = (0..N).map(|i| x[i] * r[i]).sum();
                let expected: [f64; N] = std::array::from_fn(|i| x[i] * r[i] / sum);
                close(&smoothed.1[k].map(|x| x.0[l]), &expected)?;
                close(&filtered.1[k].map(|x| x.0[l]), &x)?;
                let log = forward([0.3; N], k + 1).1 - forward([0.3; N], k).1;
                // The first vector does not sum to one.
                let log = log - if k == 0 { 0.9_f64.log2() } else { 0.0 };
                prop_assert!((filtered.2[k].0[l].log2() - log).abs() <= 1e-10);
            }
        }
    }
}
