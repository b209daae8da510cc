//! Learning without labels and counting with them, choice among models, standard errors.

pub(crate) mod baum_welch;
pub(crate) mod criteria;
pub(crate) mod expectations;
pub(crate) mod jackknife;
pub(crate) mod labels;
pub(crate) mod restarts;
