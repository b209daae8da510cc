//! Learning without labels and counting with them, choice among models, standard errors (section 9
//! of the [formulas](crate::guide::formulas)).

pub(crate) mod baum_welch;
pub(crate) mod criteria;
mod curvature;
mod e_step;
mod entry_sums;
pub(crate) mod expectations;
mod few_states;
mod information;
mod jackknife;
pub(crate) mod labels;
pub(crate) mod learned_model;
mod m_step;
pub(crate) mod model_selection;
pub(crate) mod restarts;
pub(crate) mod standard_errors;
mod stationary;
