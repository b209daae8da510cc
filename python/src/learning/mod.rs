//! Learning of an `Hmm` and of families of observations, for `wayfix.learning`.

mod baum_welch;
mod family;
mod kinds;
mod learned;
mod matrices;

pub(crate) use baum_welch::learn;
pub(crate) use family::PyFamily;
pub(crate) use learned::PyLearned;
