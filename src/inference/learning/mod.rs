//! Learning without labels and counting with them, choice among models, standard errors (section 9
//! of the [formulas](crate::guide::formulas)).

pub(crate) mod baum_welch;
pub(crate) mod e_step;
mod entry_sums;
pub(crate) mod labels;
pub(crate) mod learned_model;
mod m_step;
pub(crate) mod restarts;
