//! Choice of an engine for a model and a call, with all thresholds.
//!
//! | call | model | engine |
//! |---|---|---|
//! | a step of a stream | any | [`Step`](super::step) |
//! | a whole sequence | no control, up to 8 states, 8 steps or more | [`few`](super::few): one state in each lane |
//! | the same | up to 4 states, more than 64 steps | `few`: eight segments of the sequence, one in each lane |
//! | `_all`, `learn` | a stored matrix without small entries, more than 8 states (`learn`: any), 4 sequences or more (2) | [`batch`](super::batch): one sequence in each lane |
//! | all others, and sequences that leave the range of an engine or give an error there | any | `Step` |
//!
//! Two choices depend on the processor, and are made where the loops are: the instruction set
//! (`kernels/simd`; in portable code, products time sparse lines with and without slots of eight
//! when a matrix is made, `kernels/layout/sliced`), and gathers by loads instead of the instruction on AMD's processors (`kernels/simd/x86`). From
//! 98,304 states on, lines are shared by threads (`kernels/parallel`).
//!
//! Measured on 2-core servers: Intel Sapphire Rapids unless noted.

/// Most states with one state in each lane.
const MOST_FEW_STATES: usize = 8;
/// Fewest steps to read the matrix for: that takes a product for each state.
const FEWEST_STEPS: usize = 8;
/// Most states in segments, whose products take a column for each state. With 4, filter and
/// smoother are faster in segments and scores as fast; with 8 they take twice as long.
const MOST_STATES_IN_SEGMENTS: usize = 4;
/// Steps of a segment, where there are enough: eight of them stay in the first cache, and the
/// products of a few matrices are nothing beside.
const SEGMENT: usize = 128;
/// Fewest steps of a segment: for less, the products take longer than the steps.
const SHORTEST_SEGMENT: usize = 8;
/// Fewest sequences for lanes; fewer are faster one by one.
pub(super) const FEWEST_SEQUENCES: usize = 4;
/// The same for learning, which gains more.
pub(super) const FEWEST_TO_LEARN: usize = 2;
/// Most bytes that a group of eight sequences may keep for its steps.
const MOST_KEPT: usize = 64 << 20;
/// Most numbers of results that share their memory, 32 MB: large pieces cost less than many small
/// ones, and one result that is kept keeps no more than that.
pub(super) const MOST_SHARED: usize = (32 << 20) / size_of::<f64>();
/// Fewest numbers of results that are written past the caches: they would not stay there.
pub(super) const STREAMED: usize = (8 << 20) / size_of::<f64>();

/// Returns true if so many states and steps are for the engine of few states.
pub(super) fn suits_few(states: usize, steps: usize) -> bool {
    states <= MOST_FEW_STATES && steps >= FEWEST_STEPS
}

/// Returns true if so many states and steps are for segments.
pub(super) fn suits_segments(states: usize, steps: usize) -> bool {
    (2..=MOST_STATES_IN_SEGMENTS).contains(&states) && is_long(steps)
}

/// Returns true if so many steps are enough for segments. Up to there, beliefs of a whole sequence
/// are those of a stream to the bit.
pub(super) fn is_long(steps: usize) -> bool {
    steps > crate::kernels::LANES * SHORTEST_SEGMENT
}

/// Returns the length of each of the next eight segments, if enough steps are left.
pub(super) fn segment_length(left: usize) -> Option<usize> {
    let length = (left / crate::kernels::LANES).min(SEGMENT);
    (length >= SHORTEST_SEGMENT).then_some(length)
}

/// Returns true if so many sequences are for lanes.
pub(super) fn suits_batch(sequences: usize, states: usize) -> bool {
    sequences >= FEWEST_SEQUENCES && states > MOST_FEW_STATES
}

/// Returns true if a group of so many sequences, of up to so many steps, is for lanes.
pub(super) fn suits_group(sequences: usize, fewest: usize, states: usize, steps: usize) -> bool {
    let bytes = size_of::<crate::kernels::Packed>();
    let kept = states.saturating_mul(2).saturating_mul(steps).saturating_mul(bytes);
    sequences >= fewest && kept <= MOST_KEPT
}
