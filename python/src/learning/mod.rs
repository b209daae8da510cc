//! Learning of models of the package's own interface.

mod baum_welch;
mod family;
mod kinds;
mod learned;
mod matrices;

pub(crate) use baum_welch::learn;
pub(crate) use family::PyFamily;
pub(crate) use learned::PyLearned;
