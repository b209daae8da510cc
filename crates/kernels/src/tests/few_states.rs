//! Models of few states: segments and chains.

use proptest::collection::vec;
use proptest::prelude::*;

use super::{ZERO_SCORE, cases, close, everywhere, some_zero};
use crate::*;

proptest! {
    #![proptest_config(cases())]

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
        let few = SmallModel { columns, rows, least: 0.0 };
        let logs = SmallModel { columns: columns.map(|c| c.map(log2)), rows, least: ZERO_SCORE };
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
        // A state may fall too far behind for segments, which then give up, as they should.
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
            // A vector that sums to one, and the logarithm to base 2 of its scale.
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
