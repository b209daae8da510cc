//! The matrix of any operator, and the order in which it adds.

use super::{LEAST_FACTOR, MOST_STATES};
use crate::inference::step::is_one;
use crate::kernels::LIFT;
use crate::transition::Transition;

/// How often products are compared for each row.
const TRIALS: usize = 64;

/// A, column after column, by a product for each state. `None` if an entry is
/// too small, or the columns do not sum to one.
pub(super) fn of<A: Transition>(transition: &A, control: &A::Control) -> Option<Vec<f64>> {
    let n = transition.states();
    let (mut unit, mut columns) = (vec![0.0; n], vec![0.0; n * n]);
    for (from, column) in columns.chunks_exact_mut(n).enumerate() {
        // Lifted, so that an entry that is a product of small ones is not lost.
        unit[from] = LIFT;
        transition.apply(control, &unit, column);
        unit[from] = 0.0;
        column.iter_mut().for_each(|entry| *entry /= LIFT);
        let valid = |&entry: &f64| entry == 0.0 || entry >= LEAST_FACTOR;
        if !(column.iter().all(valid) && is_one(column.iter().sum())) {
            return None;
        }
    }
    Some(columns)
}

/// The order in which a product adds its terms.
#[derive(Debug, Clone, Copy)]
pub(super) enum Order {
    /// (a₀x₀ + a₁x₁) + a₂x₂ …
    OneByOne,
    /// ((a₀x₀ + a₁x₁) + (a₂x₂ + a₃x₃)) …, and what is left one by one.
    ByFours,
}

/// The order in which an operator adds, by comparing products of vectors
/// without a pattern to the bit. `None` if it is neither.
///
/// For each row of the matrix, the vectors make its terms of about one size:
/// sums of them in another order, or of other terms, round otherwise about every
/// third time, and do not get through.
pub(super) fn order<A: Transition>(
    transition: &A,
    control: &A::Control,
    columns: &[f64],
) -> Option<Order> {
    let n = transition.states();
    let (mut x, mut out) = (vec![0.0; n], vec![0.0; n]);
    let mut same = [true; 2];
    let mut number = 0_u64;
    for trial in 0..TRIALS * n {
        let row = || columns[trial % n..].iter().step_by(n).copied();
        let least = row().filter(|a| *a > 0.0).fold(1.0, f64::min);
        for (x, a) in x.iter_mut().zip(row()) {
            // Multiples of the golden ratio modulo one, their bits mixed.
            number = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mixed = (number ^ number >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let weight = 0.5 + (mixed >> 11) as f64 / (1_u64 << 54) as f64;
            *x = weight * LIFT * if a > 0.0 { least / a } else { 1.0 };
        }
        transition.apply(control, &x, &mut out);
        for (same, fours) in same.iter_mut().zip([false, true]) {
            *same &= out.iter().enumerate().all(|(i, out)| {
                let mut terms = [0.0; MOST_STATES];
                let row = columns[i..].iter().step_by(n).zip(&x).map(|(a, x)| a * x);
                terms.iter_mut().zip(row).for_each(|(term, product)| *term = product);
                out.to_bits() == sum_of(&terms[..n], fours).to_bits()
            });
        }
        if same == [false; 2] {
            return None;
        }
    }
    Some(if same[0] { Order::OneByOne } else { Order::ByFours })
}

fn sum_of(terms: &[f64], fours: bool) -> f64 {
    let (groups, rest) = terms.as_chunks::<4>();
    let groups = if fours { groups } else { &[] };
    let rest = if fours { rest } else { terms };
    let sum = groups.iter().fold(0.0, |sum, [a, b, c, d]| sum + ((a + b) + (c + d)));
    rest.iter().fold(sum, |sum, term| sum + term)
}

/// Σ_j a_j x_j, in one of the orders.
#[inline]
pub(super) fn product<const N: usize, const FOURS: bool>(
    columns: &[[f64; N]; N],
    x: &[f64; N],
) -> [f64; N] {
    let term = |i: usize, j: usize| columns[j][i] * x[j];
    let mut out = [0.0; N];
    for (i, out) in out.iter_mut().enumerate() {
        *out = term(i, 0);
    }
    let mut j = 1;
    if FOURS && N >= 4 {
        for (i, out) in out.iter_mut().enumerate() {
            *out = (*out + term(i, 1)) + (term(i, 2) + term(i, 3));
        }
        j = 4;
    }
    while FOURS && j + 4 <= N {
        for (i, out) in out.iter_mut().enumerate() {
            *out += (term(i, j) + term(i, j + 1)) + (term(i, j + 2) + term(i, j + 3));
        }
        j += 4;
    }
    while j < N {
        for (i, out) in out.iter_mut().enumerate() {
            *out += term(i, j);
        }
        j += 1;
    }
    out
}
