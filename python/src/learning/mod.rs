//! Learning of models of the package's own interface.

mod baum_welch;
mod family;

pub(crate) use baum_welch::{PyLearned, learn};
pub(crate) use family::PyFamily;
