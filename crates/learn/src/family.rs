//! Families of rows with a known width.

use std::rc::Rc;
use std::sync::Arc;

use wayfix::Fixed;
use wayfix::Likelihood;

/// A likelihood of rows of numbers with a known width, so that a [`Product`](super::Product) can
/// tell which part of a longer row belongs to it.
///
/// All families of this module implement it. A sensor of your own takes part with its
/// [`Likelihood`] and one more method:
///
/// ```
/// use wayfix_learn::{Family, Poisson, Product};
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// /// Height above the ground, by a barometer: floors of three metres.
/// struct Barometer(usize);
///
/// impl Likelihood for Barometer {
///     type Observation = [f64];
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn diagonal<'a>(&'a self, height: &'a [f64], scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let logs = scratch.values(self.0);
///         logs.iter_mut().enumerate().for_each(|(i, log)| *log = -(height[0] - 3.0 * i as f64).powi(2));
///         Ok(Diagonal::log(logs))
///     }
/// }
///
/// impl Family for Barometer {
///     fn components(&self) -> usize {
///         1
///     }
/// }
///
/// let networks = Poisson::family(&[[2.0], [9.0]])?; // that are received on either floor
/// let both = Product::new(Barometer(2), networks)?;
/// assert_eq!(both.components(), 2);
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
pub trait Family: Likelihood<Observation = [f64]> {
    /// Number of components of a row, d.
    fn components(&self) -> usize;
}

macro_rules! delegates {
    ($($wrapper:ty [$($bound:tt)*], |$this:ident| $inner:expr;)*) => {$(
        impl<B: Family $($bound)*> Family for $wrapper {
            fn components(&self) -> usize {
                let $this = self;
                $inner.components()
            }
        }
    )*};
}

delegates! {
    Fixed<B> [], |fixed| fixed.0;
    &B [+ ?Sized], |family| (**family);
    Box<B> [+ ?Sized], |family| (**family);
    Rc<B> [+ ?Sized], |family| (**family);
    Arc<B> [+ ?Sized], |family| (**family);
}

/// Changes a family, if it was changed before.
#[cfg(feature = "serde")]
pub(crate) fn when<F>(changed: bool, family: F, change: fn(F) -> F) -> F {
    if changed { change(family) } else { family }
}

/// Values of all states.
#[cfg(feature = "serde")]
pub(crate) fn by_state(values: impl Fn(usize) -> Option<Vec<f64>>) -> Vec<Vec<f64>> {
    (0..).map_while(values).collect()
}
