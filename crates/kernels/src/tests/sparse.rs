//! Max-products with sparse matrices.

use proptest::prelude::*;

use super::{EntryRows, cases, everywhere, in_layouts, numbers, rows, scores, sliced};
use crate::*;

proptest! {
    #![proptest_config(cases())]

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
            // Without a way into a state, the pointer is arbitrary, and is not compared.
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
}
