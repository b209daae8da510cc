//! Simulation of autoregressive models.

use rand::Rng;

use super::LinearRegression;
use crate::emission::EmissionError;
use crate::hmm::Hmm;
use crate::inference::Simulation;
use crate::transition::TransitionEntries;

impl<A: TransitionEntries<Control = ()>> Hmm<A, LinearRegression> {
    /// Draws `steps` hidden states and outputs of an autoregressive model, whose input are the
    /// outputs before, as of [`Rows::lagged`](crate::emission::Rows::lagged).
    ///
    /// `first` are the outputs before step 1, the oldest first: as many numbers as an input has.
    /// Observations are rows as the model takes them, each with its input and then its output.
    /// The same generator in the same state gives the same sequence. A step costs as one of
    /// [`simulate`](Self::simulate), and O(d (p + d)).
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use wayfix::emission::LinearRegression;
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior};
    ///
    /// // Each value is 0.9 of the one before, with much noise in state 1.
    /// let family = LinearRegression::diagonal(&[[0.9]; 2], &[[0.0]; 2], &[[0.01], [4.0]])?;
    /// let hmm = Hmm::new(
    ///     Prior::AtFirstObservation(Belief::uniform(2)?),
    ///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
    ///     family,
    /// )?;
    /// let drawn = hmm.simulate_autoregressive(&[3.0], 100, &mut ChaCha8Rng::seed_from_u64(1))?;
    /// let series: Vec<f64> = drawn.observations().iter().map(|row| row[1]).collect();
    /// assert_eq!(drawn.observations()[7], [series[6], series[7]]);
    ///
    /// let path = hmm.viterbi(drawn.observations())?;
    /// let right = path.states().iter().zip(drawn.states()).filter(|(a, b)| a == b).count();
    /// assert!(right > 80);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if the input has no multiple of the output's components, if `first` has
    /// another number of values or one that is not finite, or, with the step, if outputs grow
    /// beyond the range of doubles.
    pub fn simulate_autoregressive<R: Rng + ?Sized>(
        &self,
        first: &[f64],
        steps: usize,
        rng: &mut R,
    ) -> Result<Simulation<Vec<f64>>, EmissionError> {
        let family = self.likelihood();
        check(family, first)?;
        let (p, d) = (family.inputs(), family.outputs());
        let mut row = [first, &vec![0.0; d]].concat();
        let next = |step: usize, state: usize, rng: &mut R| {
            let output = family.sample(state, &row[..p], rng)?;
            if let Some(component) = output.iter().position(|y| !y.is_finite()) {
                let value = output[component];
                return Err(EmissionError::Diverged { step, component, value });
            }
            row[p..].copy_from_slice(&output);
            let seen = row.clone();
            row.copy_within(d.., 0);
            Ok(seen)
        };
        self.draw_with(self.prior().belief().as_slice(), 0, &vec![(); steps], rng, next)
    }
}

/// Checks that the input are outputs before, and their first values.
fn check(family: &LinearRegression, first: &[f64]) -> Result<(), EmissionError> {
    let (p, d) = (family.inputs(), family.outputs());
    let parameter = |what, component, value, expected| {
        Err(EmissionError::Parameter { what, state: None, component, value, expected })
    };
    if !p.is_multiple_of(d) {
        let expected = "a multiple of that of the output, as of an autoregressive model";
        return parameter("number of components of the input", None, p as f64, expected);
    }
    if first.len() != p {
        let (what, state, found, expected) = ("list of first values", None, first.len(), p);
        return Err(EmissionError::Length { what, state, found, expected });
    }
    match first.iter().position(|y| !y.is_finite()) {
        None => Ok(()),
        Some(at) => parameter("list of first values", Some(at), first[at], "finite values"),
    }
}
