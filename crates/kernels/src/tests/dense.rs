//! Dense products, the largest value, and packing.

use proptest::collection::vec;
use proptest::prelude::*;

use super::{ZERO_SCORE, cases, everywhere};
use crate::*;

proptest! {
    #![proptest_config(cases())]

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

    /// Rows of any lengths, some of them not aligned to a cache line.
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
}
