//! Steps of filter and smoother.

use proptest::collection::vec;
use proptest::prelude::*;

use super::{
    cases, close, everywhere, in_layouts, numbers, product, rows, sliced, some_zero, sum_is,
};
use crate::limits::{BACK_LIFT, LIFT};
use crate::*;

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
        // Without a lift, products of 1e-305 may lack digits: they are only to be reported.
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
            let (mut x, mut alone, mut rows) = (x.clone(), x.clone(), vec![2.0]);
            let tiny = normalize_in_place(&mut x, sum, Some(&mut rows));
            assert_eq!((&rows[..1], &rows[1..]), (&[2.0][..], &x[..]));
            assert_eq!(normalize_in_place(&mut alone, sum, None), tiny);
            assert_eq!(alone, x);
            (x, tiny)
        });
        if factor > 1e-300 {
            close(&normalized, &expected)?;
            prop_assert_eq!(tiny, any_tiny(&expected));
        }
        // With a lift, values below the smallest normal double become 0.
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
}
