//! Loops of inference over vectors and products.

mod backward;
mod batch;
mod chain;
mod exp;
mod forward;
mod max_product;
mod segment_vectors;
mod segments;

pub use backward::{BackwardStep, backward_step, divide_by_prediction};
pub use batch::{Lines, batch_ratio, count_moves, pack, unpack, unpack_rows};
pub use batch::{batch_backward, batch_forward, batch_max, batch_normalize};
pub use chain::{ChainPointers, ChainState, chain_backward, chain_decode, chain_forward};
pub use exp::{batch_exp, exp_in_place};
#[cfg(test)]
pub(crate) use forward::{ForwardRows, Normalize};
pub use forward::{ForwardStep, ForwardSums, Watch, forward_step, normalize_and_lift};
pub use forward::{Valid, largest, normalize_in_place};
pub use max_product::{Scores, ScoresIn, add_scores, max_step};
pub use segment_vectors::{Scaled, SmallModel};
pub use segments::{
    Backpointers, decode_segments, filter_segments, multiply_segments, smooth_segments,
};
