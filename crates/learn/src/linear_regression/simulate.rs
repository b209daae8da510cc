//! Linear regression on previous outputs: draws of autoregressive models (section 8 of the
//! formulas).

use rand::Rng;

use super::LinearRegression;
use crate::check::{check, check_components, check_values};
use wayfix::LikelihoodError;
use wayfix::likelihood::SampleNext;

/// For models whose inputs are the previous outputs, oldest first, as in
/// [`Rows::lagged`](crate::Rows::lagged).
impl SampleNext for LinearRegression {
    type Sample = Vec<f64>;

    /// Draws a row, an input followed by its output. The last p numbers of `before` are the input:
    /// `before` is the previous row, or for the first row the input itself.
    ///
    /// # Errors
    ///
    /// [`EmissionError`](crate::EmissionError) if the number of inputs is not a multiple
    /// of the number of outputs, if `before` has the length of neither a row nor an input, or if it
    /// or the output drawn is not finite.
    fn sample_next<R: Rng + ?Sized>(
        &self,
        state: usize,
        before: &[f64],
        rng: &mut R,
    ) -> Result<Vec<f64>, LikelihoodError> {
        let (p, d) = (self.inputs(), self.outputs());
        let (what, valid) = ("number of components of the input", p.is_multiple_of(d));
        check(what, p as f64, valid, "a multiple of that of the output")?;
        if before.len() != p + d {
            check_components(before, p)?;
        }
        // Dropping the first d numbers of the previous row shifts its lags by one step.
        let input = &before[before.len() - p..];
        let row = [input, &self.sample(state, input, rng)?].concat();
        check_values(&row, f64::is_finite, "a finite value, but the model diverges")?;
        Ok(row)
    }
}
