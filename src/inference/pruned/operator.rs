//! Transition operator of a step, and bounds on its entries (R and m of section 13 of the
//! [formulas](crate::guide::formulas)).
//!
//! If the inactive states have mass t in all and δ at most each, then one state receives at most
//! m t (m the largest entry) and at most R δ (R the largest row sum) from them.

use std::f64::consts::LN_2;

use crate::transition::{Transition, TransitionEntries, constant_control};

/// Upper bound on the sum of a stochastic column, including its tolerance of 1e-9 and rounding.
const COLUMN: f64 = 1.0 + 1.1e-9;
/// Relative error of an entry whose base-2 logarithm was rounded to the grid.
const GRID: f64 = 4e-14;
/// Relative rounding error of an exponential, for each unit of the logarithms' sizes.
const ROUNDING: f64 = f64::EPSILON;
/// Power of two by which the largest entry out of active states may fall short of the largest
/// entry.
const SPREAD: f64 = 500.0;
/// Largest entry in linear form; above it, a power of two is taken out.
const LARGEST: f64 = 1e30;

/// Bounds on the entries of A: the largest entry, and the largest sums of a row and of a column.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) entry: f64,
    pub(crate) row: f64,
    pub(crate) column: f64,
    /// Largest number of entries of a row and smallest entry, where these were counted; else 0.
    pub(crate) terms: usize,
    pub(crate) smallest: f64,
}

/// Form of the entries: numbers, or powers of two divided by a common whole one.
#[derive(Debug, Clone, Copy, PartialEq)]
enum EntryForm {
    Linear,
    Log2 { taken_out: f64 },
}

/// Transition operator of a step.
pub(crate) struct StepOperator<'a, A: Transition> {
    pub(crate) transition: &'a A,
    pub(crate) control: &'a A::Control,
    pub(crate) bounds: Bounds,
    /// Log factor of the evidence, if any.
    pub(crate) evidence: Option<f64>,
    form: EntryForm,
}

impl Bounds {
    const NONE: Self = Self { entry: 0.0, row: 0.0, column: 0.0, terms: 0, smallest: 0.0 };

    /// Computes the bounds on an operator that is the same at all steps, without controls and
    /// without evidence; `None` for others. O(E).
    pub(crate) fn constant<A: TransitionEntries>(transition: &A) -> Option<Self> {
        let control = constant_control::<A>()?;
        transition.check_control(control).ok()?;
        if transition.evidence(control).is_some() {
            return None;
        }
        let mut largest = Self { entry: 0.0, row: 0.0, column: COLUMN, terms: 0, smallest: 1.0 };
        for i in 0..transition.states() {
            // A sum of m non-negative numbers has a relative error of at most m roundings.
            let (mut sum, mut terms) = (0.0, 0_u32);
            for (_, a) in transition.incoming(control, i) {
                largest.entry = f64::max(largest.entry, a);
                if a > 0.0 {
                    largest.smallest = largest.smallest.min(a);
                }
                sum += a;
                terms += 1;
            }
            largest.terms = largest.terms.max(terms as usize);
            largest.row = f64::max(largest.row, sum * (1.0 + f64::from(terms) * f64::EPSILON));
        }
        Some(largest)
    }
}

impl<'a, A: TransitionEntries> StepOperator<'a, A> {
    /// Creates the operator of a step. If inactive states may have mass (`is_open`), bounds on all
    /// entries are needed; with evidence they take O(E).
    pub(crate) fn new(
        transition: &'a A,
        control: &'a A::Control,
        evidence: Option<f64>,
        constant: Option<Bounds>,
        (followed, is_open): (&[usize], bool),
    ) -> Self {
        // Without constant bounds and evidence, columns still sum to one: no entry is larger.
        let unknown = Bounds { entry: COLUMN, row: f64::INFINITY, column: COLUMN, ..Bounds::NONE };
        let bounds = constant.unwrap_or(unknown);
        let mut moves = Self { transition, control, bounds, evidence, form: EntryForm::Linear };
        // Without evidence all entries are probabilities, and the linear form is sufficient:
        // products with a lifted belief keep their digits. Evidence may have any scale.
        if evidence.is_some() {
            if transition.entries_need_logs(control) {
                return moves.in_powers_of_two(followed, is_open);
            }
            if is_open {
                moves.bounds = moves.largest();
                if moves.bounds.entry > LARGEST {
                    return moves.in_powers_of_two(followed, is_open);
                }
            }
        }
        moves
    }

    /// Switches to entries as powers of two, scaled so that the largest is near one; but if the
    /// largest entry out of an active state is far below, that one is near 2^-500.
    pub(crate) fn in_powers_of_two(mut self, followed: &[usize], is_open: bool) -> Self {
        let largest = |states: &mut dyn Iterator<Item = usize>| {
            let entries = states.flat_map(|j| self.transition.outgoing_log2(self.control, j));
            entries.map(|entry| entry.1).fold(f64::NEG_INFINITY, f64::max)
        };
        // At most 2^500 above the largest entry out of an active state: states that the belief
        // leads to must keep their digits, whereas for all others bounds suffice.
        let likely = largest(&mut followed.iter().copied());
        let all = if is_open { largest(&mut (0..self.transition.states())) } else { likely };
        let near = all.min(if likely.is_finite() { likely + SPREAD } else { all });
        let taken_out = if near.is_finite() { near.floor() } else { 0.0 };
        self.form = EntryForm::Log2 { taken_out };
        if is_open {
            self.bounds = self.largest();
        }
        self
    }

    /// Returns true if entries are powers of two already.
    pub(crate) fn is_in_powers_of_two(&self) -> bool {
        self.form != EntryForm::Linear
    }

    /// Returns the logarithm of the factor taken out of the entries, including that of the
    /// evidence.
    pub(crate) fn log_factor(&self) -> f64 {
        let taken_out = match self.form {
            EntryForm::Linear => 0.0,
            EntryForm::Log2 { taken_out } => taken_out * LN_2,
        };
        taken_out + self.evidence.unwrap_or(0.0)
    }

    /// Passes the entries into a state to `add`, each with a bound on its relative error. Powers of
    /// two below 2.2e-308 are passed as 0, and may truly be up to twice 2.2e-308.
    #[inline]
    pub(crate) fn incoming(&self, to: usize, mut add: impl FnMut(usize, f64, f64)) {
        match self.form {
            EntryForm::Linear => {
                let entries = self.transition.incoming(self.control, to);
                entries.for_each(|(j, a)| add(j, a, 0.0));
            }
            EntryForm::Log2 { taken_out } => {
                let entries = self.transition.incoming_log2(self.control, to);
                entries.for_each(|(j, log2)| {
                    add_power(log2, taken_out, |a, relative_error| add(j, a, relative_error));
                });
            }
        }
    }

    fn outgoing(&self, from: usize, mut add: impl FnMut(f64, f64)) {
        match self.form {
            EntryForm::Linear => {
                let entries = self.transition.outgoing(self.control, from);
                entries.for_each(|entry| add(entry.1, 0.0));
            }
            EntryForm::Log2 { taken_out } => {
                let entries = self.transition.outgoing_log2(self.control, from);
                entries.for_each(|entry| add_power(entry.1, taken_out, &mut add));
            }
        }
    }

    /// Computes the bounds from all entries. O(E).
    fn largest(&self) -> Bounds {
        let mut bounds = Bounds::NONE;
        for state in 0..self.transition.states() {
            // First the row of the state, for the bounds on an entry and on the sum of a row, then
            // its column.
            let mut line = LineBounds::default();
            self.incoming(state, |_, a, relative_error| line.add(a, relative_error));
            (bounds.entry, bounds.row) =
                (bounds.entry.max(line.largest), bounds.row.max(line.sum()));
            let mut line = LineBounds::default();
            self.outgoing(state, |a, relative_error| line.add(a, relative_error));
            bounds.column = bounds.column.max(line.sum());
        }
        bounds
    }
}

fn add_power(log2: f64, taken_out: f64, mut add: impl FnMut(f64, f64)) {
    let difference = log2 - taken_out;
    let a = difference.exp2();
    // A subnormal power has lost digits. As 0 it is covered by the 2 · 2.2e-308 that callers add to
    // upper bounds.
    let a = if a < f64::MIN_POSITIVE { 0.0 } else { a };
    // The logarithm was rounded relative to its size, which is large for evidence of 1e5 nats; the
    // difference rounds relative to its own, and exp2 once more.
    add(a, GRID + (log2.abs() + difference.abs() + 4.0) * ROUNDING);
}

/// Upper bounds on the largest entry of a row or column, and on its sum.
#[derive(Default)]
struct LineBounds {
    largest: f64,
    sum: f64,
    terms: u32,
}

impl LineBounds {
    fn add(&mut self, a: f64, relative_error: f64) {
        let most = if relative_error > 0.0 {
            a * (1.0 + relative_error) + 2.0 * f64::MIN_POSITIVE
        } else {
            a
        };
        self.largest = self.largest.max(most);
        self.sum += most;
        self.terms += 1;
    }

    fn sum(&self) -> f64 {
        self.sum * (1.0 + f64::from(self.terms) * f64::EPSILON)
    }
}
