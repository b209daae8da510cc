//! Most probable paths: Viterbi, the k best, and their scores.

pub(crate) mod k_best;
pub(crate) mod viterbi;
