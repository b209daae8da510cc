//! Normal densities of vectors with cached Cholesky factors, the base of the Gaussian families.
//!
//! A covariance Σ = L L' is stored with W = L⁻¹, so that (y − μ)' Σ⁻¹ (y − μ) = ‖W (y − μ)‖² and
//! ln det Σ = −2 Σ ln W_rr. Eight densities are laid out side by side, one in each lane.
//!
//! Files, each of which uses only those before it: `form` (types of covariances), `factor`
//! (Cholesky), `lanes` (loops over eight densities), `moments` (the statistics of the M step),
//! `prior`, `settings`, `check`, `normals` (the densities), `step` (E step), `marginals`
//! (single components) and `maximize` (M step).

mod check;
mod factor;
mod form;
mod lanes;
mod marginals;
mod maximize;
mod moments;
mod normals;
mod prior;
mod settings;
mod step;

pub(super) use check::flatten_covariances;
pub(super) use factor::inverse_factor;
pub use form::CovarianceType;
pub(super) use form::Shape;
pub(super) use lanes::Differences;
pub use moments::GaussianStatistics;
pub(super) use moments::Moments;
pub(super) use normals::Normals;
pub use prior::GaussianPrior;
pub(super) use settings::{Settings, settings};
pub(super) use step::{add_missing, density, eights, in_blocks};
