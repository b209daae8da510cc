//! [`check`]: all methods of an operator against one another.
//!
//! The product with a unit vector is a column of A, and that of the transpose a row. So one method
//! gives the matrix, entry by entry, and each other method is compared with it where it speaks of
//! the same entry; whatever it gets wrong is found with its states. Products with mixed vectors then
//! show what single entries cannot: sums, scales, and ties.

use std::f64::consts::LN_2;

use super::{best_of, check_count, log_sum};
use crate::belief::SUM_TOLERANCE;
use crate::error::{Disagreement, OutOfRange, TransitionError};
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels::limits;

/// Largest relative difference of values that count as equal, and absolute difference of logarithms
/// near 0.
const TOLERANCE: f64 = 1e-9;

/// Entries below this part of the largest may differ: an entry that is a difference of larger ones
/// carries their rounding errors.
const ROUNDING: f64 = 1e-12;

/// Checks the methods of an operator under a control against one another, and returns the first
/// disagreement.
///
/// The products, products in logarithms, products by blocks and the step of Viterbi must be those of
/// one matrix, and so must the lists of entries, the stored matrix and the smallest entry. Entries
/// must be finite and at least 0; columns sum to one, unless the control is
/// [evidence](Transition::evidence). The control must be accepted. Values are compared to nine digits;
/// differences below 1e-12 of the largest entry are taken for rounding. A method that is not
/// implemented has a default that calls others, and may be the one that is named: a wrong `incoming`
/// shows in `max_product`. How the operator is learned is not checked.
///
/// Meant for tests, with operators of some dozens of states: O(n · (a product)) time and O(entries)
/// memory. The front page of [`kit`](super) has an example.
///
/// # Errors
///
/// [`TransitionError::Disagreement`] with the method, the states, and both values;
/// [`TransitionError::Contract`] for lists that are not in order or name states that do not exist;
/// [`Entry`](TransitionError::Entry) and [`ColumnSum`](TransitionError::ColumnSum) for
/// matrices that are not stochastic; and what [`check_control`](Transition::check_control)
/// returns.
pub fn check<A: TransitionEntries>(
    operator: &A,
    control: &A::Control,
) -> Result<(), TransitionError> {
    let n = operator.states();
    if n == 0 {
        return Err(TransitionError::Empty);
    }
    check_count("states", n)?;
    operator.check_control(control)?;
    let evidence = operator.evidence(control);
    if let Some(factor) = evidence.filter(|factor| !limits::is_log(*factor)) {
        let what = "the log factor of the evidence";
        return Err(OutOfRange::new(what, factor, "a value from -1e300 to 1e300").into());
    }
    let in_logs = evidence.is_some() && operator.entries_need_logs(control);
    if evidence.is_some() && operator.needs_logs(control) && !in_logs {
        let problem = "is false, though `needs_logs` is true".to_owned();
        return Err(TransitionError::Contract { method: "entries_need_logs", problem });
    }
    let matrix = Matrix::of(operator, control, in_logs)?;
    if evidence.is_none() {
        matrix.check_columns()?;
    }
    let check = Check { operator, control, matrix, stochastic: evidence.is_none() };
    (0..n).try_for_each(|from| check.column(from))?;
    (0..n).try_for_each(|to| check.row(to))?;
    check.mixtures()?;
    check.decoding()
}

/// The matrix that all methods must agree with.
struct Matrix {
    /// Entries (to, log2 p) of each column, ascending.
    columns: Vec<Vec<(usize, f64)>>,
    /// Entries (from, log2 p) of each row, ascending.
    rows: Vec<Vec<(usize, f64)>>,
    /// Entries are beyond doubles, and have only logarithms.
    in_logs: bool,
    /// Logarithm below which entries may differ.
    least: f64,
}

impl Matrix {
    fn of<A: TransitionEntries>(
        operator: &A,
        control: &A::Control,
        in_logs: bool,
    ) -> Result<Self, TransitionError> {
        let n = operator.states();
        let mut columns = Vec::with_capacity(n);
        let (mut x, mut out) = (vec![0.0; n], vec![f64::NAN; n]);
        for from in 0..n {
            if in_logs {
                let column: Vec<_> = operator.outgoing_log2(control, from).collect();
                check_list("outgoing_log2", from, n, &column, f64::NEG_INFINITY)?;
                columns.push(column);
                continue;
            }
            x[from] = 1.0;
            out.fill(f64::NAN);
            operator.apply(control, &x, &mut out);
            x[from] = 0.0;
            if let Some(to) = out.iter().position(|p| !(*p >= 0.0 && p.is_finite())) {
                return Err(TransitionError::Entry { to, from, value: out[to] });
            }
            let entries = out.iter().enumerate().filter(|entry| *entry.1 > 0.0);
            columns.push(entries.map(|(to, p)| (to, p.log2())).collect());
        }
        let mut rows = vec![Vec::new(); n];
        for (from, column) in columns.iter().enumerate() {
            column.iter().for_each(|&(to, log)| rows[to].push((from, log)));
        }
        let all = columns.iter().flatten().map(|entry: &(usize, f64)| entry.1);
        let largest = all.fold(f64::NEG_INFINITY, f64::max);
        // Where entries are beyond the range of doubles, small ones matter as much as large ones.
        let least = if in_logs { f64::NEG_INFINITY } else { largest + ROUNDING.log2() };
        Ok(Self { columns, rows, in_logs, least })
    }

    fn check_columns(&self) -> Result<(), TransitionError> {
        for (column, entries) in self.columns.iter().enumerate() {
            let sum: f64 = entries.iter().map(|entry| entry.1.exp2()).sum();
            if (sum - 1.0).abs() > SUM_TOLERANCE {
                return Err(TransitionError::ColumnSum { column, sum });
            }
        }
        Ok(())
    }
}

/// Units of what a method returns.
#[derive(Clone, Copy, PartialEq)]
enum Unit {
    Linear,
    Natural,
    Base2,
}

impl Unit {
    /// A base-2 logarithm in this unit.
    fn of(self, log2: f64) -> f64 {
        match self {
            Self::Linear => log2.exp2(),
            Self::Natural => log2 * LN_2,
            Self::Base2 => log2,
        }
    }

    /// A value of this unit as a base-2 logarithm; NaN for a negative number.
    fn log2(self, value: f64) -> f64 {
        match self {
            Self::Linear => value.log2(),
            Self::Natural => value / LN_2,
            Self::Base2 => value,
        }
    }
}

/// True if two base-2 logarithms count as equal; false for NaN.
fn close(found: f64, expected: f64, least: f64) -> bool {
    // Relative to an entry of 0, whose logarithm is infinite, nothing is close.
    let relative =
        expected.is_finite() && (found - expected).abs() <= TOLERANCE * expected.abs().max(1.0);
    found == expected
        || relative
        // Both are at most rounding errors of larger entries.
        || (found <= least && expected <= least)
}

/// Checks that a list ascends and names only states that exist, with values above `zero`.
fn check_list(
    method: &'static str,
    state: usize,
    states: usize,
    list: &[(usize, f64)],
    zero: f64,
) -> Result<(), TransitionError> {
    let wrong = |problem: String| {
        let problem = format!("of state {state} lists {problem}");
        Err(TransitionError::Contract { method, problem })
    };
    for (at, &(listed, value)) in list.iter().enumerate() {
        if listed >= states {
            return wrong(format!("state {listed}, but there are {states} states"));
        }
        // Also false for NaN.
        if !(value > zero && value < f64::INFINITY) {
            return wrong(format!("state {listed} with {value}, expected entries above {zero}"));
        }
        if at > 0 && list[at - 1].0 >= listed {
            let before = list[at - 1].0;
            return wrong(format!(
                "state {listed} after state {before}, expected ascending states"
            ));
        }
    }
    Ok(())
}

struct Check<'a, A: Transition> {
    operator: &'a A,
    control: &'a A::Control,
    matrix: Matrix,
    /// Columns sum to one.
    stochastic: bool,
}

impl<A: TransitionEntries> Check<'_, A> {
    fn states(&self) -> usize {
        self.matrix.columns.len()
    }

    /// Compares all values of a line with the entries of the matrix; `at` gives (to, from).
    fn line(
        &self,
        method: &'static str,
        unit: Unit,
        found: &[f64],
        expected: &[(usize, f64)],
        at: impl Fn(usize) -> (Option<usize>, Option<usize>),
    ) -> Result<(), TransitionError> {
        let mut expected = expected.iter().peekable();
        for (state, &found) in found.iter().enumerate() {
            let entry = expected.next_if(|entry| entry.0 == state);
            let expected = entry.map_or(f64::NEG_INFINITY, |entry| entry.1);
            if !close(unit.log2(found), expected, self.matrix.least) {
                let (to, from) = at(state);
                let expected = unit.of(expected);
                return Err(Disagreement { method, to, from, found, expected }.into());
            }
        }
        Ok(())
    }

    /// Compares a list of entries with those of the matrix.
    fn list(
        &self,
        method: &'static str,
        unit: Unit,
        state: usize,
        found: &[(usize, f64)],
        expected: &[(usize, f64)],
        at: impl Fn(usize) -> (Option<usize>, Option<usize>),
    ) -> Result<(), TransitionError> {
        let zero = unit.of(f64::NEG_INFINITY);
        check_list(method, state, self.states(), found, zero)?;
        let mut values = vec![zero; self.states()];
        found.iter().for_each(|&(state, value)| values[state] = value);
        self.line(method, unit, &values, expected, at)
    }

    /// What comes out of a state.
    fn column(&self, from: usize) -> Result<(), TransitionError> {
        let Self { operator, control, .. } = *self;
        let n = self.states();
        let expected = &self.matrix.columns[from][..];
        let at = |to| (Some(to), Some(from));
        let list: Vec<_> = operator.outgoing_log2(control, from).collect();
        self.list("outgoing_log2", Unit::Base2, from, &list, expected, at)?;
        let (mut x, mut out) = (vec![f64::NEG_INFINITY; n], vec![f64::NAN; n]);
        x[from] = 0.0;
        operator.apply_log(control, &x, &mut out);
        self.line("apply_log", Unit::Natural, &out, expected, at)?;
        let mut predecessors = vec![u32::MAX; n];
        out.fill(f64::NAN);
        operator.max_product(control, &x, &mut out, &mut predecessors);
        self.line("max_product", Unit::Base2, &out, expected, at)?;
        for &(to, log) in expected.iter().filter(|entry| entry.1 > self.matrix.least) {
            if predecessors[to] as usize != from {
                let (method, found) = ("the predecessor of max_product", f64::NEG_INFINITY);
                let from = Some(predecessors[to] as usize);
                return Err(
                    Disagreement { method, to: Some(to), from, found, expected: log }.into()
                );
            }
        }
        if self.matrix.in_logs {
            return Ok(());
        }
        let list: Vec<_> = operator.outgoing(control, from).collect();
        self.list("outgoing", Unit::Linear, from, &list, expected, at)?;
        x.fill(0.0);
        x[from] = 1.0;
        self.line("apply_in_blocks", Unit::Linear, &self.by_blocks(&x)?, expected, at)?;
        if let Some(stored) = operator.stored(control).filter(|_| self.stochastic) {
            self.line("stored", Unit::Linear, &stored.column(from), expected, at)?;
        }
        // The bound must hold for all entries except those that are rounding errors.
        let smallest = operator.smallest_entry(control);
        let entries = expected.iter().filter(|entry| entry.1 > self.matrix.least);
        for (to, p) in entries.map(|entry| (entry.0, entry.1.exp2())) {
            let holds = smallest * (1.0 - TOLERANCE) <= p; // false for NaN
            if !holds {
                let (to, from) = at(to);
                let method = "smallest_entry";
                return Err(Disagreement { method, to, from, found: smallest, expected: p }.into());
            }
        }
        Ok(())
    }

    /// What leads into a state.
    fn row(&self, to: usize) -> Result<(), TransitionError> {
        let Self { operator, control, .. } = *self;
        let n = self.states();
        let expected = &self.matrix.rows[to][..];
        let at = |from| (Some(to), Some(from));
        let list: Vec<_> = operator.incoming_log2(control, to).collect();
        self.list("incoming_log2", Unit::Base2, to, &list, expected, at)?;
        let (mut x, mut out) = (vec![f64::NEG_INFINITY; n], vec![f64::NAN; n]);
        x[to] = 0.0;
        operator.apply_transpose_log(control, &x, &mut out);
        self.line("apply_transpose_log", Unit::Natural, &out, expected, at)?;
        if self.matrix.in_logs {
            return Ok(());
        }
        let list: Vec<_> = operator.incoming(control, to).collect();
        self.list("incoming", Unit::Linear, to, &list, expected, at)?;
        x.fill(0.0);
        x[to] = 1.0;
        out.fill(f64::NAN);
        operator.apply_transpose(control, &x, &mut out);
        self.line("apply_transpose", Unit::Linear, &out, expected, at)
    }

    /// The product by blocks; each state must come exactly once.
    fn by_blocks(&self, x: &[f64]) -> Result<Vec<f64>, TransitionError> {
        let (mut out, mut times) = (vec![f64::NAN; x.len()], vec![0_u32; x.len()]);
        let mut beyond = None;
        self.operator.apply_in_blocks(self.control, x, &mut |first, values| {
            for (state, &value) in (first..).zip(values) {
                match times.get_mut(state) {
                    Some(times) => (*times, out[state]) = (*times + 1, value),
                    None => beyond = Some(state),
                }
            }
        });
        let wrong = times.iter().position(|times| *times != 1).or(beyond);
        wrong.map_or(Ok(out), |state| {
            let times = times.get(state).copied().unwrap_or(0);
            let problem =
                format!("passes state {state} {times} times, expected once for each state");
            Err(TransitionError::Contract { method: "apply_in_blocks", problem })
        })
    }

    /// Products with vectors of many states, at several scales, and in logarithms of a huge range.
    fn mixtures(&self) -> Result<(), TransitionError> {
        let Self { operator, control, .. } = *self;
        let n = self.states();
        let weights: Vec<f64> = irregular(n, 0.0).collect();
        let wide: Vec<f64> = irregular(n, f64::NEG_INFINITY).map(|x| 2500.0 * (x - 1.0)).collect();
        let narrow: Vec<f64> = weights.iter().map(|x| x.ln()).collect();
        let mut out = vec![f64::NAN; n];
        let [rows, columns] = [&self.matrix.rows, &self.matrix.columns];
        for x in [&wide, &narrow] {
            operator.apply_log(control, x, &mut out);
            self.sums("apply_log", Unit::Natural, &out, &sums_of(rows, x), |i| (Some(i), None))?;
            operator.apply_transpose_log(control, x, &mut out);
            let sums = sums_of(columns, x);
            self.sums("apply_transpose_log", Unit::Natural, &out, &sums, |j| (None, Some(j)))?;
        }
        if self.matrix.in_logs {
            return Ok(());
        }
        for exponent in [0, -500, 500] {
            let scale = 2.0_f64.powi(exponent);
            let x: Vec<f64> = weights.iter().map(|x| x * scale).collect();
            let unscaled = |out: &mut [f64]| out.iter_mut().for_each(|out| *out /= scale);
            operator.apply(control, &x, &mut out);
            unscaled(&mut out);
            let sums = sums_of(rows, &narrow);
            self.sums("apply", Unit::Linear, &out, &sums, |i| (Some(i), None))?;
            operator.apply_transpose(control, &x, &mut out);
            unscaled(&mut out);
            let sums = sums_of(columns, &narrow);
            self.sums("apply_transpose", Unit::Linear, &out, &sums, |j| (None, Some(j)))?;
        }
        Ok(())
    }

    /// Compares sums with those of the matrix, in natural logarithms.
    fn sums(
        &self,
        method: &'static str,
        unit: Unit,
        found: &[f64],
        expected: &[f64],
        at: impl Fn(usize) -> (Option<usize>, Option<usize>),
    ) -> Result<(), TransitionError> {
        let expected = expected.iter().map(|log| log / LN_2).enumerate();
        let expected: Vec<_> = expected.filter(|entry| entry.1 > f64::NEG_INFINITY).collect();
        self.line(method, unit, found, &expected, at)
    }

    /// The step of Viterbi on scores that tie: the best sum, and the lowest state that attains it.
    fn decoding(&self) -> Result<(), TransitionError> {
        let Self { operator, control, .. } = *self;
        let n = self.states();
        let scores = irregular(n, f64::NEG_INFINITY).map(|x| (8.0 * x).floor());
        let scores: Vec<f64> = scores.collect();
        for x in [scores, vec![0.0; n]] {
            let (mut out, mut predecessors) = (vec![f64::NAN; n], vec![u32::MAX; n]);
            operator.max_product(control, &x, &mut out, &mut predecessors);
            for (to, (&found, predecessor)) in out.iter().zip(predecessors).enumerate() {
                let list = || {
                    let list = operator.incoming_log2(control, to);
                    list.map(|(from, log)| (from as u32, log))
                };
                let (expected, lowest) = best_of(list(), &x);
                let method = "max_product";
                if !close(found, expected, self.matrix.least) {
                    let to = Some(to);
                    return Err(Disagreement { method, to, from: None, found, expected }.into());
                }
                if expected <= self.matrix.least || predecessor == lowest {
                    continue;
                }
                // Another predecessor may be equally good up to rounding, but not exactly as good
                // and higher.
                let entry = list().find(|entry| entry.0 == predecessor);
                let score = entry.map_or(f64::NEG_INFINITY, |(from, log)| log + x[from as usize]);
                if score == expected || !close(score, expected, self.matrix.least) {
                    let method = "the predecessor of max_product";
                    let (to, from, found) = (Some(to), Some(predecessor as usize), score);
                    return Err(Disagreement { method, to, from, found, expected }.into());
                }
            }
        }
        Ok(())
    }
}

/// Numbers above 0 and below 1 without a pattern that an operator could share, multiples of the
/// golden ratio modulo one; every fourth is `zero` instead, but for a single state.
fn irregular(states: usize, zero: f64) -> impl Iterator<Item = f64> {
    let golden = 0.618_033_988_749_894_9;
    (1..=states).map(move |i| if i % 4 == 0 { zero } else { (i as f64 * golden).fract() })
}

/// ln Σ 2^log2 · exp(`x[j]`) for each line of entries (j, log2).
fn sums_of(lines: &[Vec<(usize, f64)>], x: &[f64]) -> Vec<f64> {
    let sum = |line: &Vec<(usize, f64)>| {
        let terms: Vec<f64> = line.iter().map(|(j, log)| log * LN_2 + x[*j]).collect();
        log_sum((0..terms.len()).map(|at| (at, 1.0)), &terms)
    };
    lines.iter().map(sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_converted_both_ways() {
        for unit in [Unit::Linear, Unit::Natural, Unit::Base2] {
            for log in [f64::NEG_INFINITY, -3.0, 0.0, 2.5] {
                assert!(close(unit.log2(unit.of(log)), log, f64::NEG_INFINITY));
            }
        }
        assert!(!close(0.0, f64::NEG_INFINITY, -40.0) && !close(f64::NEG_INFINITY, 0.0, -40.0));
        assert!(!close(f64::NAN, 0.0, 1.0) && !close(Unit::Linear.log2(-1.0), 0.0, 1.0));
    }
}
