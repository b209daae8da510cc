//! Free parameters of the operators that learn, for standard errors: log-odds of moves, or rates.
//!
//! Each implementation displaces its parameters in a fixed order, the same at every call, which is
//! how [`Displacement`] knows which one to move.

use std::error::Error;

use super::{
    ConstrainedTransition, DenseTransition, RestartTransition, SparseTransition,
    SwitchedTransition, Transition, TransitionEntries,
};
use crate::error::OutOfRange;
use crate::free_parameters::{Displacement, FreeParameters};
use crate::transition::constrained::FIXED;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Log-odds of the entries above 0, column by column, against the largest of their column.
impl FreeParameters for SparseTransition {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let mut entries = Vec::with_capacity(self.entries());
        for from in 0..self.states() {
            let (to, mut column): (Vec<usize>, Vec<f64>) = self.outgoing(&(), from).unzip();
            by.distribution(&mut column);
            entries.extend(to.into_iter().zip(column).map(|(to, p)| (to, from, p)));
        }
        Ok(Self::from_triplets(self.states(), entries)?)
    }
}

/// Log-odds of the entries above 0, column by column, against the largest of their column. Entries
/// of 0 count as being at a bound.
impl FreeParameters for DenseTransition {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let n = self.states();
        let mut columns: Vec<f64> = Vec::with_capacity(n * n);
        for from in 0..n {
            columns.extend((0..n).map(|to| self.get(to, from)));
            by.distribution(&mut columns[from * n..]);
        }
        Ok(Self::from_fn(n, |to, from| columns[from * n + to])?)
    }
}

/// Log-odds of the parameters of each kind of state, against the largest; fixed entries have none.
impl FreeParameters for ConstrainedTransition {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        // The parameters of a kind of state are one distribution. It is read from the first state
        // of the kind, the one whose parameters have no share yet. A share is p times the number of
        // entries of the parameter, over what the fixed entries leave.
        let mut shares: Vec<Option<f64>> = vec![None; self.parameters()];
        let mut all = self.parameters.iter();
        for from in 0..self.states() {
            let column = self.transition.outgoing(&(), from).zip(all.by_ref());
            let free: Vec<(usize, f64)> = column
                .filter(|(_, own)| own.0 != FIXED)
                .map(|((_, p), own)| (own.0 as usize, p * f64::from(own.1)))
                .collect();
            // Empty for a later state of a kind; then `distribution` has nothing to displace.
            let mut kind: Vec<(usize, f64)> = Vec::new();
            for entry in free {
                if shares[entry.0].is_none() && kind.iter().all(|other| other.0 != entry.0) {
                    kind.push(entry);
                }
            }
            let rest: f64 = kind.iter().map(|entry| entry.1).sum();
            let mut values: Vec<f64> = kind.iter().map(|entry| entry.1 / rest).collect();
            by.distribution(&mut values);
            kind.iter().zip(values).for_each(|(entry, value)| shares[entry.0] = Some(value));
        }
        let mut free = self.parameters.iter().filter(|own| own.0 != FIXED);
        let entries = self.map_free_columns(|column, rest| {
            for (entry, &(parameter, times)) in column.iter_mut().zip(free.by_ref()) {
                let share = shares[parameter as usize].unwrap_or(0.0);
                entry.2 = share / f64::from(times) * rest;
            }
        });
        let transition = SparseTransition::from_triplets(self.states(), entries)?;
        if transition.entries() != self.transition.entries() {
            // A sparse matrix drops entries of 0, and parameters are matched by position: one that
            // underflows would shift all after it.
            return Err(OutOfRange::new("a displaced probability", 0.0, "a value above 0").into());
        }
        let (parameters, pseudo_counts) = (self.parameters.clone(), self.pseudo_counts.clone());
        Ok(Self { transition, parameters, pseudo_counts })
    }
}

/// Parameters of each operator in turn.
impl<A: FreeParameters + Transition<Control = ()>> FreeParameters for SwitchedTransition<A> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let moved = self.operators.iter().map(|operator| operator.displaced(by));
        Ok(Self::new(moved.collect::<Result<_, _>>()?)?)
    }
}

/// Parameters of the inner operator; the rate and the states of restarts are not learned.
impl<A: FreeParameters + Transition> FreeParameters for RestartTransition<A> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        Ok(Self { jumps: self.jumps.with_inner(self.inner().displaced(by)?) })
    }
}
