//! Each kernel with every instruction set that the machine has: the same bits, and the result of a
//! loop over the entries.

use proptest::collection::vec;
use proptest::prelude::*;

use super::layout::{Arrangement, Dense, Packed, Panels, Sliced};
use super::memory::{Aligned, LARGE, LINE, in_large_pages};
use super::ops::*;
use super::parallel::{PART, Splits, in_turn, run_in_parts};
use super::simd::{Eight, Isa, LANES, with_isa};
use super::vector::{dot, sum};
use crate::limits::{BACK_LIFT, LIFT};

type EntryRows = Vec<Vec<(u32, f64)>>;

/// Rows with diagonals, scattered entries, and now and then a very long one.
fn rows() -> impl Strategy<Value = EntryRows> {
    // Some about the ends of windows of groups.
    let borders = (250..270_usize, 1..3_usize).prop_map(|(lines, windows)| lines * windows);
    prop_oneof![7 => 1..70_usize, 1 => borders].prop_flat_map(|n| {
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

const ARRANGEMENTS: [Arrangement; 3] =
    [Arrangement::Slices, Arrangement::Groups, Arrangement::Rows];

/// In each arrangement.
fn sliced(rows: &EntryRows) -> [Sliced; 3] {
    let split: Vec<(Vec<u32>, Vec<f64>)> =
        rows.iter().map(|row| row.iter().copied().unzip()).collect();
    let line = |line: usize| (&split[line].0[..], &split[line].1[..]);
    ARRANGEMENTS.map(|arrangement| Sliced::arranged(arrangement, rows.len(), line))
}

fn product(rows: &EntryRows, x: &[f64]) -> Vec<f64> {
    let sum = |row: &Vec<(u32, f64)>| row.iter().map(|&(j, p)| p * x[j as usize]).sum();
    rows.iter().map(sum).collect()
}

/// Result of a kernel, the same with every instruction set.
fn everywhere<R: PartialEq + std::fmt::Debug>(call: impl Fn() -> R) -> R {
    let expected = with_isa(Isa::Portable, &call);
    for (name, isa) in Isa::ALL.into_iter().filter(|(_, isa)| isa.is_here()) {
        assert_eq!(with_isa(isa, &call), expected, "{name}");
    }
    expected
}

/// The same with each arrangement of a sparse matrix.
fn in_layouts<R: PartialEq + std::fmt::Debug>(
    [slices, others @ ..]: &[Sliced; 3],
    call: impl Fn(&Sliced) -> R,
) -> R {
    let expected = everywhere(|| call(slices));
    for other in others {
        assert_eq!(everywhere(|| call(other)), expected);
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

/// Repeats numbers up to a length.
fn numbers(from: &[f64], n: usize) -> Vec<f64> {
    from.iter().copied().cycle().take(n).collect()
}

fn some_zero() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(0.0), 5 => 0.001..1.0], 71)
}

fn scores() -> impl Strategy<Value = Vec<f64>> {
    vec(prop_oneof![1 => Just(f64::NEG_INFINITY), 3 => (-4..4).prop_map(f64::from)], 71)
}

/// A step of the filter: results and sums.
fn forward(
    prediction: Product<'_>,
    lift: f64,
    likelihoods: &[f64],
    watch: Watch,
) -> (Vec<f64>, ForwardSums) {
    let mut out = vec![f64::NAN; likelihoods.len()];
    let sums = forward_step(ForwardStep { prediction, lift, likelihoods, watch, out: &mut out });
    (out, sums)
}

/// Number of cases in `WAYFIX_CASES`, or 256.
fn cases() -> ProptestConfig {
    let cases = std::env::var("WAYFIX_CASES").ok().and_then(|text| text.parse().ok());
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases.unwrap_or(256)) }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn forward_steps(
        rows in rows(), x in some_zero(), b in some_zero(), lifted in any::<bool>(),
        watch in prop::sample::select(vec![Watch::Nothing, Watch::Products, Watch::Predictions]),
        tiny in prop_oneof![4 => Just(1.0), 1 => Just(1e-305)],
    ) {
        let (n, matrix) = (rows.len(), sliced(&rows));
        let lift = if lifted { LIFT } else { 1.0 };
        let x: Vec<f64> = numbers(&x, n).iter().map(|x| x * lift).collect();
        let b: Vec<f64> = numbers(&b, n).iter().map(|b| b * tiny).collect();
        let p = product(&rows, &x);
        let found = in_layouts(&matrix, |matrix| {
            let mut out = vec![f64::NAN; n];
            matrix.multiply(&x, &mut out);
            out
        });
        close(&found, &p)?;

        let expected: Vec<f64> = p.iter().zip(&b).map(|(p, b)| p * b).collect();
        let (out, sums) = in_layouts(&matrix, |matrix| {
            forward(Product::Sparse { matrix, x: &x }, lift, &b, watch)
        });
        if tiny == 1.0 || lifted {
            close(&out, &expected)?;
            sum_is(sums.products, &expected)?;
        }
        let small = p.iter().zip(&b).any(|(&p, &b)| {
            p > 0.0 && (b > 0.0 || watch == Watch::Predictions) && p * b < lift / LIFT
        });
        prop_assert_eq!(sums.small, small && watch != Watch::Nothing);
        prop_assert_eq!(sums.largest_likelihood, b.iter().copied().fold(0.0, f64::max));
        prop_assert!(!sums.negative_likelihood);
        // A computed prediction is summed and checked.
        let (seen, computed) = everywhere(|| forward(Product::Computed(&found), lift, &b, watch));
        sum_is(computed.predicted, &found)?;
        prop_assert_eq!(computed.products, sums.products);
        prop_assert_eq!(seen, out);
    }

    #[test]
    fn bad_likelihoods_and_predictions_are_seen(
        good in vec(0.1..1.0, 1..40_usize), at in any::<prop::sample::Index>(),
        bad in prop::sample::select(vec![-1.0, f64::NAN, f64::INFINITY]), which in any::<bool>(),
    ) {
        let mut other = good.clone();
        other[at.index(good.len())] = bad;
        let (p, likelihoods) = if which { (&other, &good) } else { (&good, &other) };
        let seen = everywhere(|| {
            let (_, sums) = forward(Product::Computed(p), 1.0, likelihoods, Watch::Products);
            (sums.products.is_finite(), sums.negative_predicted, sums.negative_likelihood)
        });
        prop_assert_eq!(seen, (bad == -1.0, bad == -1.0 && which, bad == -1.0 && !which));
    }

    #[test]
    fn beliefs_are_normalized(
        x in some_zero(), n in 1..70_usize,
        factor in prop_oneof![3 => Just(1.0), 1 => Just(1e-280), 1 => Just(1e-306)],
    ) {
        let mut x = numbers(&x, n);
        x[n / 2] *= factor;
        let sum: f64 = x.iter().sum();
        prop_assume!(sum >= 0.001);
        let expected: Vec<f64> = x.iter().map(|x| x / sum).collect();
        let any_tiny = |p: &[f64]| p.iter().any(|&p| 0.0 < p && p < 2.0_f64.powi(-900));
        let (normalized, tiny) = everywhere(|| {
            let mut x = x.clone();
            let tiny = normalize_in_place(&mut x, sum);
            (x, tiny)
        });
        if factor > 1e-300 {
            close(&normalized, &expected)?;
            prop_assert_eq!(tiny, any_tiny(&expected));
        }
        // With a lift, what is below the smallest normal double becomes 0.
        let rounded = |&p: &f64| if p < f64::MIN_POSITIVE { 0.0 } else { p };
        let expected: Vec<f64> = expected.iter().map(rounded).collect();
        let (lifted, out, tiny) = everywhere(|| {
            let mut x: Vec<f64> = x.iter().map(|x| x * LIFT).collect();
            let mut out = vec![f64::NAN; n];
            let tiny = normalize_and_lift(&mut x, &mut out, sum * LIFT);
            (x, out, tiny)
        });
        close(&out, &expected)?;
        prop_assert_eq!(tiny, any_tiny(&expected));
        prop_assert!(lifted.iter().zip(&out).all(|(lifted, out)| *lifted == out * LIFT));
    }

    #[test]
    fn backward_steps(rows in rows(), q in some_zero(), b in some_zero(), alpha in some_zero()) {
        let (n, matrix) = (rows.len(), sliced(&rows));
        let [q, b, alpha] = [q, b, alpha].map(|v| numbers(&v, n));
        let q: Vec<f64> = q.iter().map(|q| q * BACK_LIFT).collect();
        let ratio = everywhere(|| {
            let mut ratio = vec![f64::NAN; n];
            divide_by_prediction(&q, &b, 0.3, &mut ratio);
            ratio
        });
        let expected: Vec<f64> = q.iter().zip(&b).map(|(q, b)| q * b * 0.3).collect();
        close(&ratio, &expected)?;
        let (gamma, back, sum) = in_layouts(&matrix, |matrix| {
            let (mut gamma, mut q) = (vec![f64::NAN; n], vec![f64::NAN; n]);
            let product = Product::Sparse { matrix, x: &ratio };
            let step = BackwardStep { product, alpha: &alpha, gamma: &mut gamma, q: &mut q };
            let sum = backward_step(step);
            (gamma, q, sum)
        });
        let expected = product(&rows, &ratio);
        close(&back, &expected)?;
        let expected: Vec<f64> =
            expected.iter().zip(&alpha).map(|(q, alpha)| q / BACK_LIFT * alpha).collect();
        close(&gamma, &expected)?;
        sum_is(sum, &gamma)?;
    }

    /// They are doubles to the bit.
    #[test]
    fn values_of_32_bits(rows in rows(), x in some_zero()) {
        let (n, x) = (rows.len(), numbers(&x, rows.len()));
        let split: Vec<(Vec<u32>, Vec<f32>)> =
            rows.iter().map(|row| row.iter().map(|&(j, p)| (j, p as f32)).unzip()).collect();
        let line = |line: usize| (&split[line].0[..], &split[line].1[..]);
        let single = ARRANGEMENTS.map(|arrangement| Sliced::arranged(arrangement, n, line));
        let rounded = |row: &Vec<(u32, f64)>| {
            row.iter().map(|&(j, p)| (j, f64::from(p as f32))).collect()
        };
        let double = sliced(&rows.iter().map(rounded).collect());
        let results = |matrix: &[Sliced; 3]| in_layouts(matrix, |matrix| {
            let (mut product, mut next, mut from) = (vec![0.0; n], vec![0.0; n], vec![0; n]);
            matrix.multiply(&x, &mut product);
            max_step(matrix, &matrix.log2(), &x, None, &mut next, &mut from);
            (product, next)
        });
        prop_assert_eq!(results(&single), results(&double));
    }

    /// Scores are small whole numbers, so that ties abound.
    #[test]
    fn max_steps(
        rows in rows(), x in scores(), b in scores(), observed in any::<bool>(), form in 0..3_u8,
    ) {
        let rows: EntryRows = rows
            .iter()
            .map(|row| row.iter().map(|&(j, p)| (j, if p < 0.5 { 0.25 } else { 0.5 })).collect())
            .collect();
        let (n, matrix) = (rows.len(), sliced(&rows));
        let (x, mut b) = (numbers(&x, n), numbers(&b, n));
        let most = b.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let form = match form {
            0 if most.is_finite() => ScoresIn::Ln(most),
            1 => {
                b.iter_mut().for_each(|b| *b = b.exp2());
                ScoresIn::Linear
            }
            _ => ScoresIn::Log2,
        };
        let likelihoods = observed.then_some(Scores { values: &b, form, shift: 1.0 });
        let added = |i: usize| match form {
            _ if !observed => 0.0,
            ScoresIn::Ln(most) => on_grid((b[i] - most) * std::f64::consts::LOG2_E) - 1.0,
            ScoresIn::Linear => log2(b[i]) - 1.0,
            ScoresIn::Log2 => b[i] - 1.0,
        };
        let (next, from, largest) = in_layouts(&matrix, |matrix| {
            let (mut next, mut from) = (vec![f64::NAN; n], vec![0; n]);
            let largest = max_step(matrix, &matrix.log2(), &x, likelihoods, &mut next, &mut from);
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
        let (sums, most) = everywhere(|| {
            let mut scores = x.clone();
            let most = add_scores(&mut scores, likelihoods);
            (scores, most)
        });
        for (i, sum) in sums.iter().enumerate() {
            prop_assert_eq!(*sum, x[i] + added(i));
        }
        prop_assert_eq!(most, sums.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    }

    /// Entries of few values, so that many tie; some are 0.
    #[test]
    fn dense_products(n in 1..70_usize, a in vec(0..5_u8, 71), x in vec(0..5_u8, 71)) {
        let entry = |i: usize, j: usize| f64::from(a[(i * 7 + j * 13) % 71]);
        let x: Vec<f64> = x[..n].iter().map(|x| f64::from(*x)).collect();
        let mut matrix = Dense::filled(n, 0.0);
        for j in 0..n {
            (0..n).for_each(|i| matrix.column_mut(j)[i] = entry(i, j));
        }
        let logs = Panels::log2(n, entry);
        let scores: Vec<f64> = x.iter().map(|x| log2(*x)).collect();
        let found = everywhere(|| {
            let (mut out, mut back, mut best) = (vec![0.0; n], vec![0.0; n], vec![ZERO_SCORE; n]);
            let mut from = vec![0; n];
            matrix.multiply(&x, &mut out);
            matrix.multiply_transpose(&x, &mut back);
            logs.maximize(&scores, &mut best, &mut from);
            (out, back, best, from)
        });
        for i in 0..n {
            prop_assert_eq!(found.0[i], (0..n).map(|j| entry(i, j) * x[j]).sum::<f64>());
            prop_assert_eq!(found.1[i], (0..n).map(|j| entry(j, i) * x[j]).sum::<f64>());
            let mut best = (ZERO_SCORE, 0);
            for (j, x) in scores.iter().enumerate() {
                let score = log2(entry(i, j)) + x;
                if score > best.0 {
                    best = (score, j as u32);
                }
            }
            prop_assert_eq!(found.2[i], best.0);
            prop_assert!(best.0 == ZERO_SCORE || found.3[i] == best.1);
        }
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
        let most = |x: &[f64], least| x.iter().copied().fold(least, f64::max);
        let logs = odd.abs() <= 1e300 || odd == f64::NEG_INFINITY;
        let found = everywhere(|| largest(&x, Valid::Logs));
        prop_assert_eq!(found, if logs { Ok(most(&x, f64::NEG_INFINITY)) } else { Err(at) });
        x.iter_mut().enumerate().filter(|(i, _)| *i != at).for_each(|(_, x)| *x = x.abs());
        let likelihoods = odd >= 0.0 && odd.is_finite();
        let found = everywhere(|| largest(&x, Valid::Likelihoods));
        prop_assert_eq!(found, if likelihoods { Ok(most(&x, 0.0)) } else { Err(at) });
    }

    /// Rows of any lengths, some of which do not begin on a cache line.
    #[test]
    fn packing(
        eights in vec(vec(0.0..1.0, LANES), 1..20), counts in vec(0..20_usize, LANES),
        shift in 0..2_usize, stream in any::<bool>(),
    ) {
        let mut from: Vec<Packed> =
            eights.iter().map(|eight| Packed(std::array::from_fn(|l| eight[l]))).collect();
        let lane = |l: usize| -> Vec<f64> { eights.iter().map(|eight| eight[l]).collect() };
        let rows: Vec<Vec<f64>> = (0..LANES).map(lane).collect();
        let (unpacked, packed) = everywhere(|| {
            let mut out = vec![vec![f64::NAN; from.len()]; LANES];
            let mut each = out.iter_mut();
            unpack(&from, std::array::from_fn(|_| &mut each.next().expect("eight")[..]));
            let mut packed = vec![Packed::default(); from.len()];
            let _range = pack(std::array::from_fn(|l| &rows[l][..]), &mut packed);
            (out, packed)
        });
        prop_assert_eq!((&unpacked, &packed), (&rows, &from));
        from.resize(from.len().next_multiple_of(LANES), Packed::default());
        let counts: Vec<usize> = counts.iter().map(|c| (*c).min(from.len() / LANES)).collect();
        let all = everywhere(|| {
            let mut all = Aligned::new(counts.iter().sum::<usize>() * LANES + shift, -1.0);
            let mut left = all[shift..].as_chunks_mut::<LANES>().0;
            let mut rows: [&mut [Eight]; LANES] = std::array::from_fn(|_| &mut [][..]);
            for (row, count) in rows.iter_mut().zip(&counts) {
                let (own, others) = left.split_at_mut(*count);
                (*row, left) = (own, others);
            }
            unpack_rows(&from, rows, stream);
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

    /// Filter, smoother and decoder through eight segments and through a chain, and their products.
    #[test]
    fn few_states(
        columns in vec(some_zero(), 3), steps in 1..40_usize, b in vec(0.001..2.0, 300),
        zero in any::<prop::sample::Index>(),
    ) {
        const N: usize = 3;
        let columns: [[f64; N]; N] =
            std::array::from_fn(|j| std::array::from_fn(|i| columns[j][i] + f64::from(i == j)));
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
        let few = Few { columns, rows, least: 0.0 };
        let logs = Few { columns: columns.map(|c| c.map(log2)), rows, least: ZERO_SCORE };
        let mut likelihoods = vec![[Packed::default(); N]; steps];
        let values = likelihoods.as_flattened_mut().iter_mut().flat_map(|b| b.0.iter_mut());
        values.zip(b.iter().cycle()).for_each(|(to, b)| *to = *b);
        likelihoods[zero.index(steps)][1].0[5] = 0.0;
        let scores: Vec<[Packed; N]> =
            likelihoods.iter().map(|b| b.map(|b| Packed(b.0.map(log2)))).collect();
        let multiplied = everywhere(|| multiply_segments(SumProduct, &few, &likelihoods));
        let best = everywhere(|| multiply_segments(MaxPlus, &logs, &scores));
        let (starts, ends) = ([[0.3; 8]; N], [[0.7; 8]; N]);
        let found = everywhere(|| {
            let mut filtered = vec![[Packed::default(); N]; steps];
            let (mut smoothed, mut from) = (filtered.clone(), vec![[[0; 2]; N]; steps]);
            let mut normalizers = vec![Packed::default(); steps];
            filter_segments(&few, &starts, &likelihoods, &mut filtered, &mut normalizers)?;
            smooth_segments(&few, &starts, &ends, &likelihoods, &mut smoothed)?;
            decode_segments(&logs, &[[0.0; 8]; N], &scores, &mut from)?;
            Some((filtered, normalizers, smoothed, from))
        });
        // A state may fall far behind.
        let all = multiplied.zip(best).zip(found);
        prop_assume!(all.is_some());
        let ((multiplied, best), (filtered, normalizers, smoothed, from)) = all.expect("assumed");
        // One lane as a chain of padded lines.
        let mut padded = [[Packed::default(); LANES]; 2];
        let mut log_columns = [Packed([ZERO_SCORE; LANES]); LANES];
        for j in 0..N {
            for i in 0..N {
                (padded[0][j][i], padded[1][i][j]) = (columns[j][i], columns[j][i]);
                log_columns[j][i] = log2(columns[j][i]);
            }
        }
        for l in 0..LANES {
            let lane = |b: &[[Packed; N]]| -> Vec<f64> {
                b.iter().flat_map(|b| b.map(|b| b.0[l])).collect()
            };
            let (row, row_scores) = (lane(&likelihoods), lane(&scores));
            let (rows, sums, posteriors, pointers) = everywhere(|| {
                let (mut rows, mut normalizers) = (vec![0.0; steps * N], vec![0.0; steps]);
                let mut state = ChainState::new(0.0);
                state.values[..N].fill(0.3);
                let sums = &mut normalizers;
                assert!(chain_forward(&padded[0], &mut state, N, &row, &mut rows, sums));
                let (mut posteriors, mut state) = (rows.clone(), ChainState::new(0.7));
                assert!(chain_backward(&padded[1], &mut state, N, &row, &mut posteriors));
                let (mut from, mut state) = (vec![[0; 3]; steps], ChainState::new(ZERO_SCORE));
                state.values[..N].fill(0.0);
                assert!(chain_decode(&log_columns, &mut state, N, &row_scores, &mut from));
                (rows, normalizers, posteriors, from)
            });
            let b = |k: usize| likelihoods[k].map(|b| b.0[l]);
            // A vector of sum one, with the logarithm to base 2 of its scale.
            let forward = |x: [f64; N], until: usize| (0..until).fold((x, 0.0), |(x, log), k| {
                let product: [f64; N] =
                    std::array::from_fn(|i| b(k)[i] * (0..N).map(|j| columns[j][i] * x[j]).sum::<f64>());
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
            for (j, column) in multiplied.iter().enumerate() {
                let (x, log) = forward(std::array::from_fn(|i| f64::from(i == j)), steps);
                let found = column.values.map(|x| x[l]);
                let sum: f64 = found.iter().sum();
                if sum == 0.0 {
                    prop_assert_eq!(x, [0.0; N]);
                    continue;
                }
                close(&found.map(|x| x / sum), &x)?;
                prop_assert!((sum.log2() + column.exponents[l] - log).abs() <= 1e-9);
            }
            let mut x = [0.0; N];
            for k in 0..steps {
                let before = x;
                for i in 0..N {
                    let ways = (0..N).map(|j| log2(columns[j][i]) + before[j]);
                    let largest = ways.clone().fold(ZERO_SCORE, f64::max);
                    x[i] = largest + log2(b(k)[i]);
                    if largest > ZERO_SCORE {
                        let first = ways.clone().position(|way| way == largest);
                        let bits = from[k][i].map(|bits| usize::from(bits >> l & 1));
                        prop_assert_eq!(Some(bits[0] + 2 * bits[1]), first);
                        let bits = pointers[k].map(|bits| usize::from(bits >> i & 1));
                        prop_assert_eq!(Some(bits[0] + 2 * bits[1] + 4 * bits[2]), first);
                    }
                }
            }
            let through = (0..N).map(|i| {
                best.iter().map(|c| c.values[i][l] + c.exponents[l]).fold(ZERO_SCORE, f64::max)
            });
            prop_assert_eq!(through.collect::<Vec<_>>(), x.to_vec());
            for k in 0..steps {
                let (x, r) = (forward([0.3; N], k + 1).0, backward(k + 1));
                let sum: f64 = (0..N).map(|i| x[i] * r[i]).sum();
                let expected: [f64; N] = std::array::from_fn(|i| x[i] * r[i] / sum);
                close(&smoothed[k].map(|x| x.0[l]), &expected)?;
                close(&posteriors[k * N..][..N], &expected)?;
                close(&filtered[k].map(|x| x.0[l]), &x)?;
                close(&rows[k * N..][..N], &x)?;
                let log = forward([0.3; N], k + 1).1 - forward([0.3; N], k).1;
                // The first vector does not sum to one.
                let log = log - if k == 0 { 0.9_f64.log2() } else { 0.0 };
                prop_assert!((normalizers[k].0[l].log2() - log).abs() <= 1e-10);
                prop_assert!((sums[k].log2() - log).abs() <= 1e-10);
            }
        }
    }
}

const ZERO_SCORE: f64 = f64::NEG_INFINITY;

#[test]
fn log2_is_right_and_adds_one_for_a_doubling() {
    assert_eq!(log2(0.0), ZERO_SCORE);
    assert!([-1.0, f64::NAN, f64::INFINITY].iter().all(|&x| log2(x).is_nan()));
    let is_on_grid = |x: f64| (x * (1_u64 << 45) as f64).fract() == 0.0;
    assert!((1..20_000).all(|i| is_on_grid(on_grid(f64::from(i) * -0.013_7))));
    let fixed = [1.0, 0.75, 0.1, 1.0 / 3.0, 1.999_999, 1e-300, 5e-324, f64::MAX];
    let many = (1..3000).map(|i| f64::from(i) * 0.000_7);
    for x in fixed.into_iter().chain(many) {
        // The grid is 2.8e-14 wide.
        assert!((log2(x) - x.log2()).abs() <= 1.5e-14 + x.log2().abs() * 1e-15, "{x}");
        for halvings in 1..60 {
            let halved = x * 0.5_f64.powi(halvings);
            if halved.is_normal() {
                assert_eq!(log2(halved), log2(x) - f64::from(halvings), "{halved}");
            }
        }
        let all = everywhere(|| {
            let mut values = vec![x, 0.0, 1.0, 5e-324, x, x, x, x, x];
            log2_in_place(&mut values);
            values
        });
        assert_eq!(all[..4], [log2(x), ZERO_SCORE, 0.0, -1074.0]);
        assert!(all[4..].iter().all(|log| *log == log2(x)));
    }
}

#[test]
fn sums_and_memory_of_every_length() {
    for n in 0..40_usize {
        let x: Vec<f64> = (1..=n).map(|i| i as f64).collect();
        assert_eq!(sum(&x), (n * (n + 1) / 2) as f64);
        assert_eq!(dot(&x, &vec![2.0; n]), (n * (n + 1)) as f64);
        let mut aligned = Aligned::new(n, 2.0);
        aligned.copy_from_slice(&x);
        let copy = aligned.clone();
        assert_eq!(copy[..], x);
        assert!([&aligned, &copy].iter().all(|v| v.as_ptr().addr() % LINE == 0));
    }
    for count in [0, 1, 1000, LARGE / 8, 3 * LARGE / 8 + 5] {
        let mut vec = in_large_pages(vec![1.5; count]);
        assert_eq!(vec, vec![1.5; count]);
        vec.push(2.5);
        assert_eq!(vec.iter().sum::<f64>(), 1.5 * count as f64 + 2.5);
    }
}

/// Not a multiple of eight, nor of parts; neighbours, some entries far, a few long lines.
#[test]
fn parts_give_the_result_of_all_lines_at_once() {
    const N: usize = 4 * PART + 1003;
    let values =
        |factor: f64| -> Vec<f64> { (1..=N).map(|i| (i as f64 * factor).fract()).collect() };
    let (x, b) = (values(0.618_033_988_7), values(0.414_213_562_3));
    let line = |i: usize| {
        let far = i.is_multiple_of(5).then_some((i * 7919) % N);
        let many = (0..if i.is_multiple_of(1009) { 40 } else { 0 }).map(|k| (i + 50 * k) % N);
        let near = [i, (i + 1) % N];
        let mut line: Vec<u32> =
            near.into_iter().chain(far).chain(many).map(|j| j as u32).collect();
        line.sort_unstable();
        line.dedup();
        let values = line.iter().map(|j| f64::from(j % 13) + 1.0).collect();
        (line, values)
    };
    let lines: Vec<(Vec<u32>, Vec<f64>)> = (0..N).map(line).collect();
    let [grouped, matrix] = [Arrangement::Groups, Arrangement::Slices].map(|arrangement| {
        Sliced::arranged(arrangement, N, |i| (&lines[i].0[..], &lines[i].1[..]))
    });
    let mut outs = [vec![f64::NAN; N], vec![f64::NAN; N], vec![f64::NAN; N], vec![f64::NAN; N]];
    let [parts, whole, turn, groups] = outs.each_mut();
    let step = |matrix, out| {
        let (prediction, likelihoods) = (SparseRows::all(matrix, &x), &b[..]);
        ForwardRows { prediction, lift: LIFT, likelihoods, watch: Watch::Products, out }
    };
    let sums = [
        run_in_parts(step(&matrix, parts)),
        super::run(step(&matrix, whole)),
        in_turn(step(&matrix, turn)),
        run_in_parts(step(&grouped, groups)),
    ];
    let [parts, whole, turn, groups] = outs;
    let (parts, whole) = ((parts, sums[0]), (whole, sums[1]));
    assert_eq!((&turn, sums[2]), (&parts.0, sums[0])); // threads do not change a bit
    assert_eq!((&groups, sums[3]), (&parts.0, sums[0])); // nor do groups
    assert_eq!(parts.0, whole.0);
    assert!((parts.1.products - whole.1.products).abs() <= 1e-12 * whole.1.products);
    assert_eq!(ForwardSums { products: parts.1.products, ..whole.1 }, parts.1);
    for (i, (indices, values)) in lines.iter().enumerate().step_by(7) {
        let sum: f64 = indices.iter().zip(values).map(|(&j, a)| a * x[j as usize]).sum();
        assert!((sum * b[i] - parts.0[i]).abs() <= 1e-13 * sum);
    }
    for tiny in [None, Some(0), Some(PART - 1), Some(PART), Some(N - 1)] {
        let mut x = vec![0.5; N];
        tiny.into_iter().for_each(|at| x[at] = 1e-280);
        let kernel = Normalize::<false> { x: &mut x, out: &mut [], sum: 0.5 };
        assert_eq!(kernel.lines(), N);
        assert_eq!(run_in_parts(kernel), tiny.is_some());
        assert_eq!(x[N - 1], if tiny == Some(N - 1) { 2e-280 } else { 1.0 });
    }
}
