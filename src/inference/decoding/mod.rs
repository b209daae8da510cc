//! Most probable paths: Viterbi, and the k best paths.

pub(crate) mod k_best;
pub(crate) mod viterbi;
