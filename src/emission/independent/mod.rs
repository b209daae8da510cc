//! Families whose components are independent of each other, and the distributions of one.
//!
//! Files, each of which stands on those before it: `univariate` (the trait of a
//! distribution), `family` and `learn` (the family), and one for each distribution.

mod bernoulli;
mod family;
mod gamma;
mod learn;
mod log_normal;
mod poisson;
mod univariate;
mod von_mises;

pub use bernoulli::Bernoulli;
pub use family::Independent;
pub use gamma::Gamma;
pub use log_normal::LogNormal;
pub use poisson::Poisson;
pub(super) use poisson::{is_count, log_probability};
pub use univariate::Univariate;
pub use von_mises::VonMises;
