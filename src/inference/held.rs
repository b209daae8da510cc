//! The forms in which a step takes a belief and leaves one.

use std::f64::consts::LN_2;

use crate::kernels::{self, Aligned, LIFT};
use crate::transition::TransitionEntries;

/// For how many steps to lift once a result was too small without.
const LIFT_FOR: u32 = 64;

/// A distribution; as logarithms too, if it has values above 0 that doubles
/// do not hold.
#[derive(Debug, Clone, Copy)]
pub(super) struct Held<'a> {
    pub(super) linear: &'a [f64],
    pub(super) logs: Option<&'a [f64]>,
}

impl Held<'_> {
    /// The logarithm of one probability.
    pub(super) fn log(&self, state: usize) -> f64 {
        self.logs.map_or_else(|| self.linear[state].ln(), |logs| logs[state])
    }

    /// The ways into a state i in proportion to α(j) A\[i, j\], with the states j
    /// that they come from; NaN or all 0 if there are none. `in_logs` if the step
    /// needs logarithms.
    pub(super) fn ways<A: TransitionEntries>(
        &self,
        transition: &A,
        control: &A::Control,
        to: usize,
        in_logs: bool,
        ways: &mut Vec<(usize, f64)>,
    ) {
        ways.clear();
        if !in_logs && self.logs.is_none() {
            let incoming = transition.incoming(control, to);
            ways.extend(incoming.map(|(from, p)| (from, self.linear[from] * LIFT * p)));
            let total: f64 = ways.iter().map(|way| way.1).sum();
            // (Of no entries at all, some may be too small to be listed so.)
            let nothing = || !ways.is_empty() && ways.iter().all(|way| self.linear[way.0] == 0.0);
            if (1.0 / LIFT..=f64::MAX).contains(&total) || nothing() {
                return;
            }
        }
        // Too small for doubles, or some of it is.
        ways.clear();
        let incoming = transition.incoming_log2(control, to);
        ways.extend(incoming.map(|(from, log2)| (from, self.log(from) + log2 * LN_2)));
        let largest = ways.iter().map(|way| way.1).fold(f64::NEG_INFINITY, f64::max);
        ways.iter_mut().for_each(|way| way.1 = (way.1 - largest).exp());
    }

    /// The logarithms, from wherever they are.
    pub(super) fn logs_to(&self, out: &mut [f64]) {
        match self.logs {
            Some(logs) => out.copy_from_slice(logs),
            None => out.iter_mut().zip(self.linear).for_each(|(out, p)| *out = p.ln()),
        }
    }
}

/// The belief before a step in the form that products take: lifted by
/// [`LIFT`], unless it and the matrix have nothing so small that it matters.
#[derive(Debug, Clone)]
pub(super) struct Lifted {
    values: Aligned,
    /// Whether `values` are those of the present belief.
    valid: bool,
    /// Whether the belief has a value above 0 and below 2^-900.
    tiny: bool,
    /// For how many steps more to lift in any case: results have been small.
    more: u32,
}

impl Lifted {
    pub(super) fn new(belief: &[f64]) -> Self {
        let values = Aligned::new(belief.len(), 0.0);
        let mut new = Self { values, valid: false, tiny: false, more: 0 };
        new.follow(belief);
        new
    }

    /// Takes another belief.
    pub(super) fn follow(&mut self, belief: &[f64]) {
        (self.valid, self.tiny) = (false, kernels::any_tiny(belief));
    }

    /// Whether products take the lifted belief.
    pub(super) fn is_needed(&self) -> bool {
        self.tiny || self.more > 0
    }

    /// After a result that was too small.
    pub(super) fn lift_for_some_steps(&mut self) {
        self.more = LIFT_FOR;
    }

    /// The lifted belief.
    pub(super) fn values(&mut self, belief: &[f64]) -> &[f64] {
        if !self.valid {
            kernels::lift(belief, &mut self.values);
            self.valid = true;
        }
        &self.values
    }

    /// After a step that has put the belief into its results.
    pub(super) fn commit(&mut self, form: Form, lifted: &mut Aligned) {
        self.more = self.more.saturating_sub(1);
        match form {
            Form::Plain { tiny } => (self.valid, self.tiny) = (false, tiny),
            Form::Lifted { tiny } => {
                std::mem::swap(&mut self.values, lifted);
                (self.valid, self.tiny) = (true, tiny);
            }
            Form::Other => {}
        }
    }
}

/// In which form a step has left its result.
#[derive(Debug, Clone, Copy)]
pub(super) enum Form {
    /// The belief is in [`Results::lifted`], not lifted.
    Plain { tiny: bool },
    /// It is in [`Results::after`], and lifted in `lifted`.
    Lifted { tiny: bool },
    /// It is in [`Results::after`] alone.
    Other,
}

/// Where a step writes its results.
pub(super) struct Results<'a> {
    /// The prediction, lifted, which then sums to [`LIFT`] but for rounding and for
    /// evidence on the move; not written where it need not be kept.
    pub(super) predicted: &'a mut [f64],
    /// The belief after the observation.
    pub(super) after: &'a mut [f64],
    /// The same lifted, as [`Form`] says.
    pub(super) lifted: &'a mut [f64],
    /// Its logarithms, if the step says so.
    pub(super) logs: &'a mut [f64],
}

/// What else a step gives.
pub(super) struct Advanced {
    /// ln N, the log-likelihood of the observation and of evidence on the move.
    pub(super) log: f64,
    /// N itself, for the likelihoods as the sensor gave them, where the step was
    /// taken with those; else 0.
    pub(super) normalizer: f64,
    /// Whether the step was taken in logarithms.
    pub(super) by_logs: bool,
    /// Whether the belief has to be kept as logarithms too.
    pub(super) in_logs: bool,
    /// Where the belief is.
    pub(super) form: Form,
}
