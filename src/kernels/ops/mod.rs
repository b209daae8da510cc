//! Loops of inference over vectors and products.

mod backward;
mod batch;
mod chain;
mod exp;
mod forward;
mod largest;
mod lines;
mod log2;
mod max_product;
mod packing;
mod product;
mod row_sums;
mod segment_vectors;
mod segments;
mod semiring;

pub(crate) use backward::{BackwardStep, backward_step, divide_by_prediction};
pub(crate) use batch::{batch_backward, batch_forward, batch_max, batch_normalize};
pub(crate) use batch::{batch_ratio, count_moves};
pub(crate) use chain::{ChainPointers, ChainState, chain_backward, chain_decode, chain_forward};
pub(crate) use exp::{batch_exp, exp_in_place};
pub(crate) use forward::normalize_in_place;
pub(crate) use forward::{ForwardStep, ForwardSums, Watch, forward_step, normalize_and_lift};
pub(crate) use largest::{Valid, largest};
pub(crate) use lines::Lines;
pub(crate) use log2::{ln_to_log2, log2, log2_in_place, on_grid};
pub(crate) use max_product::{Scores, ScoresIn, add_scores, max_step};
pub(crate) use packing::{pack, unpack, unpack_rows};
pub(crate) use product::Product;
pub(crate) use row_sums::{RowSums, Sink};
pub(crate) use segment_vectors::{Scaled, SmallModel};
pub(crate) use segments::{
    Backpointers, decode_segments, filter_segments, multiply_segments, smooth_segments,
};
pub(crate) use semiring::{MaxPlus, SumProduct};

#[cfg(test)]
pub(in crate::kernels) use {
    forward::{ForwardRows, Normalize},
    product::SparseRows,
};
