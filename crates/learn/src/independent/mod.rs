//! Families of independent components, and the distributions of a single component.
//!
//! Given the state, ln b_i(y) is the sum of the components' log densities, and the M step of
//! section 9 of the formulas is one for each state and component. Statistics are centred on the
//! present parameters (a deviation from the mean, a divergence, an angle to the mean direction), so
//! that a narrow distribution far from 0 loses no digits.
//!
//! Files, each of which uses only those before it: `univariate` (the trait of a distribution),
//! `family` and `learn` (the family), `counts` (expectations over counts), `zeros` (the number of
//! zeros that a distribution expects), and one for each distribution.

mod bernoulli;
mod beta;
mod binomial;
mod counts;
mod displaced;
mod exponential;
mod family;
mod gamma;
mod hurdle;
mod learn;
mod log_normal;
mod negative_binomial;
mod poisson;
mod skewed_t;
mod univariate;
mod von_mises;
mod weibull;
mod wrapped_cauchy;
mod zero_inflated;
mod zeros;

pub use bernoulli::Bernoulli;
pub use beta::Beta;
pub use binomial::Binomial;
pub use exponential::Exponential;
pub use family::Independent;
#[cfg(feature = "serde")]
pub(crate) use family::with_settings;
pub use gamma::Gamma;
pub use hurdle::Hurdle;
pub use log_normal::LogNormal;
pub use negative_binomial::NegativeBinomial;
pub use poisson::Poisson;
pub(super) use poisson::{is_count, log_probability};
pub use skewed_t::SkewedT;
pub use univariate::{Cumulative, Sums, Univariate};
pub use von_mises::VonMises;
pub use weibull::Weibull;
pub use wrapped_cauchy::WrappedCauchy;
pub use zero_inflated::ZeroInflated;
