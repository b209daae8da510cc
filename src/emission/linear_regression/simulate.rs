//! Simulation of autoregressive models.

use rand::Rng;

use super::LinearRegression;
use crate::emission::EmissionError;
use crate::error::LikelihoodError;
use crate::likelihood::SampleNext;

/// For models whose inputs are the outputs before, oldest first, as of
/// [`Rows::lagged`](crate::emission::Rows::lagged).
impl SampleNext for LinearRegression {
    type Sample = Vec<f64>;

    /// Draws a row with its input and its output. The last p numbers of `before` are the input:
    /// it may be the row before, or for a first row the input itself.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if the number of inputs is no multiple of that of outputs, if `before` is
    /// neither a row nor an input, or not finite, or if the output drawn is not.
    fn sample_next<R: Rng + ?Sized>(
        &self,
        state: usize,
        before: &[f64],
        rng: &mut R,
    ) -> Result<Vec<f64>, LikelihoodError> {
        let (p, d) = (self.inputs(), self.outputs());
        if !p.is_multiple_of(d) {
            let (what, state, component) = ("number of components of the input", None, None);
            let (value, expected) = (p as f64, "a multiple of that of the output");
            let error = EmissionError::Parameter { what, state, component, value, expected };
            return Err(error.into());
        }
        let (found, expected) = (before.len(), p);
        if found != p && found != p + d {
            return Err(EmissionError::Components { found, expected }.into());
        }
        let input = &before[found - p..];
        let output = self.sample(state, input, rng)?;
        match output.iter().position(|y| !y.is_finite()) {
            None => Ok([input, &output].concat()),
            Some(at) => {
                let (component, value) = (p + at, output[at]);
                let expected = "a finite value, but the model diverges";
                Err(EmissionError::Observation { component, value, expected }.into())
            }
        }
    }
}
