//! [`DistractedTransition`]: a sensor that is attentive, or for a while follows something else.
//!
//! A step is M ⊗ A, with the moves A of the base and a matrix M of two modes, rates times
//! likelihoods. Every method takes that of the base for each mode, and mixes the two results.

use super::kronecker::extremes;
use super::log::{self, LARGEST_LINEAR_ENTRY};
use super::{Stored, Transition, TransitionEntries, buffers, product_or_zero};
use super::{check_count, check_probability, check_slices, delegate, validate};
use crate::error::{OutOfRange, TransitionError};
use wayfix_kernels::{self as kernels, limits, log2};

/// An operator for a sensor that for a while follows something else: a camera whose view looks like
/// another place, a radar that follows a neighbouring car, GPS by a reflected signal.
///
/// An attentive sensor's observations depend on the state. A distraction begins with some probability
/// in each step, and ends likewise; meanwhile observations say nothing of the state, but are like
/// one another. Robust sensors with outliers drawn anew at each step can't tell that: three alike
/// observations in a row are to them three independent witnesses.
///
/// The mode m is 0 (attentive) or 1 (distracted), the base A has N states, and the state (m, i) is
/// m N + i of 2 N. The control carries the likelihoods of the observation that ends the step if the
/// sensor is distracted, which depend on whether the distraction begins there or goes on; so it is
/// [evidence on moves](Transition::evidence). With the [rates](DistractionRates) a and b, the
/// entries (to, from) are
///
/// ```text
/// (0, i), (0, j): (1 − a) A[i, j]
/// (1, i), (0, j): a begins A[i, j]
/// (0, i), (1, j): b A[i, j]
/// (1, i), (1, j): (1 − b) continues A[i, j]
/// ```
///
/// The sensor of the model must then have likelihood 1 in all distracted states, which have theirs
/// from the control. Attentive and distracted likelihoods are of one scale: a factor taken out of
/// the ones is to be taken out of the others.
/// [`Distractor`](crate::inference::Distractor) computes `begins` and `continues` from a model of
/// what a distracted sensor follows.
///
/// A step takes two products with A and O(N), in decoding two max-products. Evidence on moves of the
/// base stays what it is.
///
/// Two places, and a vehicle that is known to be at the first. Three images in a row look like the
/// second: it may have moved, or the view may deceive.
///
/// ```
/// use wayfix::transition::{DistractedTransition, Distraction, DistractionRates};
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition};
///
/// let drive = SparseTransition::from_rows(&[[0.995, 0.0], [0.005, 1.0]])?;
/// let rates = DistractionRates { begin: 0.05, end: 0.2 };
/// let a = DistractedTransition::new(drive, rates)?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(4, 0)?); // place 0, attentive
/// let hmm = Hmm::new(prior, a, LikelihoodVector::linear(4))?;
/// let mut filter = hmm.filter();
/// let seen = [0.1, 0.9, 1.0, 1.0]; // the likelihoods of an image like place 1
/// // A deceptive view is first any image, and then remains as it is.
/// let image = Distraction { control: (), begins: 0.5, continues: 0.9 };
/// for _ in 0..3 {
///     filter.step_with(&image, &seen)?;
/// }
/// let [attentive, distracted] = hmm.transition().mode_masses(filter.belief().as_slice());
/// assert!(attentive + distracted > 0.999_999 && distracted > 0.5);
/// assert!(filter.belief().mass([0, 2])? > 0.7); // still at place 0
///
/// // An image like place 0 shows that it was a deception.
/// let image = Distraction { control: (), begins: 0.5, continues: 0.1 };
/// filter.step_with(&image, &[0.9, 0.1, 1.0, 1.0])?;
/// assert!(filter.belief().mass([0, 2])? > 0.9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct DistractedTransition<A> {
    base: A,
    rates: DistractionRates,
}

/// Probabilities per step that a distraction begins, and that it ends, each from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct DistractionRates {
    /// Probability that an attentive sensor is distracted in the next step, a.
    pub begin: f64,
    /// Probability that a distracted sensor is attentive in the next step, b. A distraction lasts
    /// 1 / b steps on average.
    pub end: f64,
}

impl DistractionRates {
    /// Checks that both are from 0 to 1.
    pub(crate) fn check(self) -> Result<(), TransitionError> {
        check_probability(self.begin, || "the probability that a distraction begins".to_owned())?;
        check_probability(self.end, || "the probability that a distraction ends".to_owned())
    }
}

/// The control of a [`DistractedTransition`]: that of its base, and the likelihoods of the
/// observation that ends the step if the sensor is distracted, each finite and at least 0.
///
/// They are p(y | distracted), in the scale of the likelihoods of an attentive sensor. With none,
/// as for a step without an observation, both are 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Distraction<C> {
    /// Control of the base.
    pub control: C,
    /// Likelihood of the observation if the distraction begins with it.
    pub begins: f64,
    /// Likelihood of the observation if the distraction had begun before, and goes on.
    pub continues: f64,
}

impl<C> Distraction<C> {
    /// The control of a step without an observation: both likelihoods are 1.
    #[must_use]
    pub fn none(control: C) -> Self {
        Self { control, begins: 1.0, continues: 1.0 }
    }
}

/// A number for each pair of modes, `[to][from]`.
type Modes<T> = [[T; 2]; 2];

impl<A: Transition> DistractedTransition<A> {
    /// Creates the operator of a sensor that may be distracted, on the moves of `base`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless both rates are from 0 to 1,
    /// [`TransitionError::TooMany`] if there are more than 2^32 − 1 states, two for each of the
    /// base, or as [`Hmm::new`](crate::Hmm::new) for a base that is not stochastic.
    pub fn new(base: A, rates: DistractionRates) -> Result<Self, TransitionError> {
        rates.check()?;
        check_count("states", base.states().saturating_mul(2))?;
        // A model can't check it: this operator has evidence.
        validate(&base)?;
        Ok(Self { base, rates })
    }

    /// The operator of the moves, without modes.
    #[must_use]
    pub fn base(&self) -> &A {
        &self.base
    }

    /// Probabilities that a distraction begins and ends.
    #[must_use]
    pub fn rates(&self) -> DistractionRates {
        self.rates
    }

    /// The state of a mode and a state of the base, or `None` if that does not exist.
    pub fn index(&self, distracted: bool, state: usize) -> Option<usize> {
        let n = self.base.states();
        (state < n).then_some(if distracted { n + state } else { state })
    }

    /// Returns the probabilities of the modes, attentive and distracted: the sum of each half of a
    /// belief. O(N).
    ///
    /// # Panics
    ///
    /// Unless there is a value for each of the 2 N states.
    pub fn mode_masses(&self, belief: &[f64]) -> [f64; 2] {
        assert_eq!(belief.len(), self.states(), "the belief must have one value per state");
        let (attentive, distracted) = belief.split_at(self.base.states());
        [kernels::sum(attentive), kernels::sum(distracted)]
    }

    /// Rates and likelihoods, whose products are the factors of A.
    fn parts(&self, control: &Distraction<A::Control>) -> Modes<(f64, f64)> {
        let DistractionRates { begin, end } = self.rates;
        [
            [(1.0 - begin, 1.0), (end, 1.0)],
            [(begin, control.begins), (1.0 - end, control.continues)],
        ]
    }

    /// Factors of A.
    fn factors(&self, control: &Distraction<A::Control>) -> Modes<f64> {
        self.parts(control).map(|row| row.map(|(rate, likelihood)| rate * likelihood))
    }

    /// Natural logarithms of the factors, which may be beyond doubles.
    fn log_factors(&self, control: &Distraction<A::Control>) -> Modes<f64> {
        self.parts(control).map(|row| row.map(|(rate, likelihood)| rate.ln() + likelihood.ln()))
    }

    /// Base-2 logarithms of the factors, on the grid of scores.
    fn log2_factors(&self, control: &Distraction<A::Control>) -> Modes<f64> {
        self.parts(control).map(|row| row.map(|(rate, likelihood)| log2(rate) + log2(likelihood)))
    }

    /// The least and the largest factor above 0; ∞ and 0 if there are none.
    fn factor_range(&self, control: &Distraction<A::Control>) -> (f64, f64) {
        let all = self.factors(control).into_iter().flatten().filter(|factor| *factor > 0.0);
        all.fold((f64::INFINITY, 0.0), |(least, most), factor| {
            (factor.min(least), factor.max(most))
        })
    }

    /// Applies a product of the base to each half, and mixes the results by the factors.
    fn product(
        &self,
        x: &[f64],
        out: &mut [f64],
        factors: Modes<f64>,
        product: impl Fn(&[f64], &mut [f64]),
        mix: impl Fn([f64; 2], f64, f64) -> f64,
    ) {
        check_slices(self.states(), x, out);
        let n = self.base.states();
        let [to_attentive, to_distracted] = factors;
        let ((x0, x1), (out0, out1)) = (x.split_at(n), out.split_at_mut(n));
        product(x0, out0);
        product(x1, out1);
        for (first, second) in out0.iter_mut().zip(out1) {
            let (attentive, distracted) = (*first, *second);
            *first = mix(to_attentive, attentive, distracted);
            *second = mix(to_distracted, attentive, distracted);
        }
    }

    /// Lists entries of a line in both modes: those of the base, `plus` the factor of each.
    fn line<I: Iterator<Item = (usize, f64)>>(
        &self,
        factors: [f64; 2],
        zero: f64,
        line: impl Fn() -> I,
        plus: impl Fn(f64, f64) -> f64 + Copy,
    ) -> impl Iterator<Item = (usize, f64)> {
        let entries = move |(mode, factor): (usize, f64), entries: I| {
            let offset = mode * self.base.states();
            entries.map(move |(state, entry)| (offset + state, plus(factor, entry)))
        };
        let (attentive, distracted) = (line(), line());
        let all = entries((0, factors[0]), attentive).chain(entries((1, factors[1]), distracted));
        all.filter(move |entry| entry.1 > zero) // a factor may be 0, and a product underflow
    }

    /// The mode of a state, and the state of the base.
    fn split(&self, state: usize) -> (usize, usize) {
        let n = self.base.states();
        assert!(state < 2 * n, "state {state} of {} states", 2 * n);
        (state / n, state % n)
    }
}

/// Sum of two numbers in proportion to factors, in linear space.
fn mix_linear(factors: [f64; 2], a: f64, b: f64) -> f64 {
    product_or_zero(factors[0], a) + product_or_zero(factors[1], b)
}

/// The same in logarithms.
fn mix_logs(factors: [f64; 2], a: f64, b: f64) -> f64 {
    log::add(factors[0] + a, factors[1] + b)
}

fn transposed(factors: Modes<f64>) -> Modes<f64> {
    let [[a, b], [c, d]] = factors;
    [[a, c], [b, d]]
}

impl<A: Transition> Transition for DistractedTransition<A> {
    type Control = Distraction<A::Control>;

    delegate!(a, control => a.base, &control.control; has_restarts);

    fn states(&self) -> usize {
        2 * self.base.states()
    }

    fn apply(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        let base = |x: &[f64], out: &mut [f64]| self.base.apply(&control.control, x, out);
        self.product(x, out, self.factors(control), base, mix_linear);
    }

    fn apply_transpose(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        let base = |x: &[f64], out: &mut [f64]| self.base.apply_transpose(&control.control, x, out);
        self.product(x, out, transposed(self.factors(control)), base, mix_linear);
    }

    fn apply_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        let base = |x: &[f64], out: &mut [f64]| self.base.apply_log(&control.control, x, out);
        self.product(x, out, self.log_factors(control), base, mix_logs);
    }

    fn apply_transpose_log(&self, control: &Self::Control, x: &[f64], out: &mut [f64]) {
        let base =
            |x: &[f64], out: &mut [f64]| self.base.apply_transpose_log(&control.control, x, out);
        self.product(x, out, transposed(self.log_factors(control)), base, mix_logs);
    }

    fn evidence(&self, control: &Self::Control) -> Option<f64> {
        Some(self.base.evidence(&control.control).unwrap_or(0.0))
    }

    fn needs_logs(&self, control: &Self::Control) -> bool {
        let beyond = |&(rate, likelihood): &(f64, f64)| {
            let possible = rate > 0.0 && likelihood > 0.0;
            possible && !(f64::MIN_POSITIVE..=LARGEST_LINEAR_ENTRY).contains(&(rate * likelihood))
        };
        self.base.needs_logs(&control.control) || self.parts(control).iter().flatten().any(beyond)
    }

    fn apply_in_blocks(
        &self,
        control: &Self::Control,
        x: &[f64],
        take: &mut dyn FnMut(usize, &[f64]),
    ) {
        let n = self.base.states();
        assert_eq!(x.len(), 2 * n, "x must have one value per state");
        let (x0, x1) = x.split_at(n);
        // The halves are mixed before the product, not after it, since blocks of the base are gone
        // once they are taken.
        buffers::with(n, |mixed| {
            for (mode, factors) in self.factors(control).into_iter().enumerate() {
                for (mixed, (x0, x1)) in mixed.iter_mut().zip(x0.iter().zip(x1)) {
                    *mixed = mix_linear(factors, *x0, *x1);
                }
                let mut take_half = |first: usize, values: &[f64]| take(mode * n + first, values);
                self.base.apply_in_blocks(&control.control, mixed, &mut take_half);
            }
        });
    }

    fn smallest_entry(&self, control: &Self::Control) -> f64 {
        self.base.smallest_entry(&control.control) * self.factor_range(control).0.min(1.0)
    }

    fn check_control(&self, control: &Self::Control) -> Result<(), TransitionError> {
        let likelihoods = [
            ("the likelihood if the distraction begins", control.begins),
            ("the likelihood if the distraction goes on", control.continues),
        ];
        for (what, value) in likelihoods {
            let expected = "a finite value of at least 0";
            let checked = OutOfRange::check(what, value, 0.0..=f64::MAX, expected);
            checked.map_err(|error| TransitionError::Control(error.to_string()))?;
        }
        self.base.check_control(&control.control)
    }
}

impl<A: TransitionEntries> TransitionEntries for DistractedTransition<A> {
    fn incoming(&self, control: &Self::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (mode, i) = self.split(to);
        let line = move || self.base.incoming(&control.control, i);
        self.line(self.factors(control)[mode], 0.0, line, |factor, entry| factor * entry)
    }

    fn outgoing(&self, control: &Self::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let (mode, j) = self.split(from);
        let line = move || self.base.outgoing(&control.control, j);
        let factors = transposed(self.factors(control))[mode];
        self.line(factors, 0.0, line, |factor, entry| factor * entry)
    }

    fn incoming_log2(
        &self,
        control: &Self::Control,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let (mode, i) = self.split(to);
        let line = move || self.base.incoming_log2(&control.control, i);
        let factors = self.log2_factors(control)[mode];
        self.line(factors, f64::NEG_INFINITY, line, |factor, entry| factor + entry)
    }

    fn outgoing_log2(
        &self,
        control: &Self::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let (mode, j) = self.split(from);
        let line = move || self.base.outgoing_log2(&control.control, j);
        let factors = transposed(self.log2_factors(control))[mode];
        self.line(factors, f64::NEG_INFINITY, line, |factor, entry| factor + entry)
    }

    fn entries_need_logs(&self, control: &Self::Control) -> bool {
        let base = &control.control;
        if self.base.entries_need_logs(base) || self.needs_logs(control) {
            return true;
        }
        let (least, most) = self.factor_range(control);
        if most == 0.0 {
            return false;
        }
        // Without evidence no entry of the base is above 1, and often a bound from below is known,
        // which saves the search for the least.
        let no_tiny = self.base.stored(base).is_some_and(Stored::has_no_tiny_entries);
        let bound = if no_tiny { limits::LEAST_ENTRY } else { self.base.smallest_entry(base) };
        if self.base.evidence(base).is_none() && least * bound >= f64::MIN_POSITIVE {
            return false;
        }
        let (least_entry, most_entry) = extremes(&self.base, base);
        least * least_entry < f64::MIN_POSITIVE || most * most_entry > LARGEST_LINEAR_ENTRY
    }

    fn max_product(&self, control: &Self::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        let n = self.base.states();
        let [to_attentive, to_distracted] = self.log2_factors(control);
        let ((x0, x1), (out0, out1)) = (x.split_at(n), out.split_at_mut(n));
        let (from0, from1) = from.split_at_mut(n);
        // The best predecessor within a mode is the same for both modes of the state that is
        // reached, since a factor shifts all scores alike.
        self.base.max_product(&control.control, x0, out0, from0);
        self.base.max_product(&control.control, x1, out1, from1);
        let values = out0.iter_mut().zip(out1);
        for ((first, second), (from0, from1)) in values.zip(from0.iter_mut().zip(from1)) {
            let (attentive, distracted) = ((*first, *from0), (*second, *from1));
            let best = |factors: [f64; 2]| {
                let scores = [factors[0] + attentive.0, factors[1] + distracted.0];
                // All attentive states are below all distracted ones, so that they keep a tie. A
                // state that nothing leads to has no predecessor.
                match scores {
                    [_, score] if score > scores[0] => (score, distracted.1 + n as u32),
                    [f64::NEG_INFINITY, _] => (f64::NEG_INFINITY, 0),
                    [score, _] => (score, attentive.1),
                }
            };
            (*first, *from0) = best(to_attentive);
            (*second, *from1) = best(to_distracted);
        }
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition] DistractedTransition<A>: [A], |a| {
        base: A = a.base,
        begin: f64 = a.rates.begin,
        end: f64 = a.rates.end,
    } => Self::new(base, DistractionRates { begin, end });
}
