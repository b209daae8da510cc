//! Choice of an engine for a model and a call, with all thresholds in one place.
//!
//! | call | model | engine |
//! |---|---|---|
//! | a step of a stream | any | [`Engine::Steps`] |
//! | a whole sequence of 8 steps or more | no control, up to 8 states | [`Engine::Chain`] |
//! | the same of more than 64 steps | no control, 2 to 4 states | [`Engine::Segments`] |
//! | a sequence of 65 to 2,047 steps to learn from | no control, up to 8 states, a stored matrix without small entries | the two above |
//! | 4 sequences or more in an `_all` | a stored matrix without small entries, more than 8 states; sparse ones only while a group fits the cache | eight sequences, one in each lane: [`lanes`](super::lanes) |
//! | 2 sequences or more to learn from | the same, any number of states | the same |
//! | a long sequence to learn from | the same, if the model forgets fast enough | eight segments of it, one in each lane: [`lanes`](super::lanes) |
//! | a long sequence to smooth | as in `smooth_all`, likewise | the same |
//! | all others | any | [`Engine::Steps`] |
//!
//! A sequence that leaves the range of an engine, or causes an error there, is processed in steps.
//!
//! Other choices are made where the loops are: the instruction set (`kernels/simd`), loads instead
//! of gather instructions on AMD processors (`kernels/simd/x86`), and the layout of a sparse
//! matrix, by its slots (`kernels/layout/sliced`). With 98,304 states or more, threads share the
//! lines of a product (`kernels/parallel`).
//!
//! Measured on 2-core servers: Intel Sapphire Rapids unless noted.

use std::ops::Range;

use wayfix_kernels::{LANES, Packed};

/// Engine of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Engine {
    /// Step by step, for any model: [`Step`](crate::inference::step).
    Steps,
    /// Many steps in one kernel call, one state in each lane: [`few_states`](super::few_states).
    Chain,
    /// Eight segments of a sequence, one in each lane: [`few_states`](super::few_states).
    Segments,
}

/// Most states for one state in each lane.
const MOST_FEW_STATES: usize = 8;
/// Fewest steps for which reading the matrix pays, which takes a product for each state.
const FEWEST_STEPS: usize = 8;
/// Most states in segments. The product of a segment has a column for each state: with 8 states, a
/// step would take 64 multiplications for each column. With 4, filter and smoother are faster in
/// segments, and scores equally fast.
const MOST_STATES_IN_SEGMENTS: usize = 4;
/// Steps of a segment, if there are enough: eight segments stay in the first-level cache, and the
/// few products between them cost next to nothing.
const SEGMENT: usize = 128;
/// Fewest steps of a segment; for shorter ones, the products take longer than the steps.
const SHORTEST_SEGMENT: usize = 8;
/// Steps of a chain that are gathered at a time, so that they stay in the first-level cache.
pub(crate) const GATHERED: usize = 128;
/// Fewest sequences for lanes; fewer are faster one by one.
const FEWEST_SEQUENCES: usize = 4;
/// Fewest sequences for learning in lanes, which gains more.
const FEWEST_TO_LEARN: usize = 2;
/// Most bytes that a group of eight sequences may keep for its steps.
const MOST_KEPT: usize = 64 << 20;
/// Least number of entries a column for which lanes always pay. Each entry is read once for eight
/// sequences and needs no gather, which saves more time than fetching vectors of eight from beyond
/// the second-level cache costs. With 8 entries and 8,000 states lanes take 0.8 of the time, with
/// 64 entries 0.4 to 0.5.
const MANY_ENTRIES: usize = 8;
/// With fewer entries, most bytes of the vectors that a step of a group touches, three of eight
/// doubles for each state: half of a second-level cache, since the matrix and other vectors need
/// room too. With 4,500 states lanes take 0.9 to 1.2 of the time, with 20,000 they take 1.2 to 2.
const MOST_IN_STEP: usize = 1 << 20;
/// With fewer entries, most bytes that a group may keep: together with the results, about two
/// second-level caches. With 3 MB lanes take 0.9 of the time, with 13 MB 1.1.
const MOST_CACHED: usize = 4 << 20;
/// Fewest steps of a sequence that is cut into segments for lanes: 64 warm-ups of 32 steps.
const FEWEST_TO_CUT: usize = 2048;
/// Least length of a segment, in warm-ups. With two warm-ups for each segment, lanes then take half
/// as long again, which is still a fraction of the time of one piece.
const FEWEST_WARM_UPS: usize = 4;
/// Length of a segment, in warm-ups, if there are enough steps: warm-ups then take a tenth of the
/// time.
const WARM_UPS: usize = 16;
/// Bytes that a group of segments keeps if its warm-ups are short: half of a second-level cache.
const KEPT_OF_SEGMENTS: usize = 1 << 20;
/// Factor by which a warm-up that was too short is lengthened.
pub(crate) const LONGER: usize = 4;
/// Number of groups of segments that run before they are verified, at first and later. If they are
/// not valid, their time is lost.
pub(crate) const FIRST_GROUPS: usize = 4;
pub(crate) const GROUPS_AT_A_TIME: usize = 64;
/// Most sequences of a chunk that run one by one.
const MOST_IN_CHUNK: usize = 64;
/// Numbers that fill a chunk whose sequences run one by one: enough work to make the cost of
/// handing it to a thread negligible.
const ENOUGH: usize = 1 << 15;
/// Numbers that fill a chunk in lanes whose results are all collected, a block of 32 MB: large
/// blocks cost less than many small ones, and a single result that is kept holds no more than that.
const ENOUGH_IN_LANES: usize = (32 << 20) / size_of::<f64>();
/// Chunks for each thread that are in progress or waiting to be collected. With fewer, one long
/// sequence would make the other threads wait.
pub(crate) const CHUNKS_AHEAD: usize = 4;
/// Least size of results, in numbers, that are written past the caches, where they would not stay.
pub(crate) const STREAMED: usize = (8 << 20) / size_of::<f64>();

/// Returns the engine of a whole sequence, for a model without a control.
pub(crate) fn for_sequence(states: usize, steps: usize) -> Engine {
    match states {
        ..=MOST_FEW_STATES if steps < FEWEST_STEPS => Engine::Steps,
        2..=MOST_STATES_IN_SEGMENTS if is_long(steps) => Engine::Segments,
        ..=MOST_FEW_STATES => Engine::Chain,
        _ => Engine::Steps,
    }
}

/// Returns true if a sequence of this length should go through an engine for whole sequences.
pub(crate) fn is_whole(states: usize, steps: usize) -> bool {
    for_sequence(states, steps) != Engine::Steps
}

/// Returns true if learning keeps whole passes of a sequence. Longer ones run in lanes, or step by
/// step in less memory.
pub(crate) fn learns_whole(states: usize, steps: usize) -> bool {
    is_whole(states, steps) && steps < FEWEST_TO_CUT
}

/// Returns true if a sequence is long enough for segments. Beliefs of shorter whole sequences are
/// those of a stream to the bit.
pub(crate) fn is_long(steps: usize) -> bool {
    steps > LANES * SHORTEST_SEGMENT
}

/// Takes eight segments of equal length off the remaining steps, if there are enough.
pub(crate) fn next_segments(remaining: &mut Range<usize>) -> Option<Range<usize>> {
    // The steps left over after the last eight segments go through a chain.
    let length = (remaining.len() / LANES).min(SEGMENT);
    (length >= SHORTEST_SEGMENT).then(|| take_first(remaining, LANES * length))
}

/// Takes as many steps off the remaining ones as go through a chain at a time.
pub(crate) fn next_steps(remaining: &mut Range<usize>) -> Option<Range<usize>> {
    (remaining.start < remaining.end).then(|| take_first(remaining, remaining.len().min(GATHERED)))
}

fn take_first(remaining: &mut Range<usize>, count: usize) -> Range<usize> {
    let start = remaining.start;
    remaining.start += count;
    start..remaining.start
}

/// Plan for many sequences through one model: which of them run in lanes, and how many fill a
/// chunk, the work of one thread.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ManyPlan {
    pub(crate) states: usize,
    /// True if results include a row for each step.
    has_rows: bool,
    /// Number of entries of a stored matrix that is suited to lanes, if there is one.
    pub(crate) entries: Option<usize>,
}

impl ManyPlan {
    pub(crate) fn new(states: usize, has_rows: bool) -> Self {
        Self { states, has_rows, entries: None }
    }

    /// Returns true if lanes may pay for at most this many sequences, so that the matrix is worth
    /// a look.
    pub(crate) fn may_use_lanes(self, sequences: usize) -> bool {
        sequences >= FEWEST_SEQUENCES && self.states > MOST_FEW_STATES
    }

    /// Returns true if a group runs in lanes, given its number of sequences and the steps of the
    /// longest.
    pub(crate) fn runs_in_lanes(self, sequences: usize, longest: usize) -> bool {
        let Some(entries) = self.entries else { return false };
        // A step touches three vectors of eight doubles for each state. Two of them, beliefs and
        // likelihoods, are kept for every step if rows are stored; otherwise the length does not
        // matter.
        let eights = |vectors: usize| self.states.saturating_mul(vectors * size_of::<Packed>());
        let cached = eights(3) <= MOST_IN_STEP
            && (!self.has_rows || eights(2).saturating_mul(longest) <= MOST_CACHED);
        self.may_use_lanes(sequences)
            && (cached || entries / MANY_ENTRIES >= self.states)
            && fits_in_lanes(self.states, longest)
    }

    /// Returns true if a chunk takes no more sequences. Chunks in lanes consist of whole groups, so
    /// that lanes are empty only at the very end.
    pub(crate) fn is_full(self, chunk: ChunkSize) -> bool {
        let numbers = self.states.saturating_mul(chunk.steps);
        // Asked as for a full group, since sequences still to come may fill this one.
        if !self.runs_in_lanes(LANES, chunk.longest) {
            return chunk.sequences == MOST_IN_CHUNK || numbers >= ENOUGH;
        }
        numbers >= ENOUGH_IN_LANES && chunk.sequences.is_multiple_of(LANES)
    }
}

/// Size of a chunk of sequences.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ChunkSize {
    sequences: usize,
    steps: usize,
    longest: usize,
}

impl ChunkSize {
    pub(crate) fn add(&mut self, steps: usize) {
        self.sequences += 1;
        self.steps = self.steps.saturating_add(steps + 1);
        self.longest = self.longest.max(steps);
    }
}

/// Returns true if learning runs a group in lanes, given its number of sequences and the steps of
/// the longest, for a model with a stored matrix.
pub(crate) fn learns_in_lanes(states: usize, sequences: usize, longest: usize) -> bool {
    sequences >= FEWEST_TO_LEARN && fits_in_lanes(states, longest)
}

/// Returns true if beliefs and likelihoods of all steps of a group are not too large to keep.
fn fits_in_lanes(states: usize, longest: usize) -> bool {
    longest <= longest_kept(states, MOST_KEPT)
}

/// Returns the number of steps of a group whose beliefs and likelihoods fit in `bytes`.
fn longest_kept(states: usize, bytes: usize) -> usize {
    // Saturating: a caller may ask for more than an address space.
    bytes / states.saturating_mul(2 * size_of::<Packed>())
}

/// Returns true if a sequence of this length may be cut into segments for lanes.
pub(crate) fn is_worth_a_cut(steps: usize) -> bool {
    steps >= FEWEST_TO_CUT
}

/// Returns true if this number of sequences leaves so many lanes empty that running the segments of
/// each, with their warm-ups, is faster.
pub(crate) fn leaves_lanes_empty(sequences: usize) -> bool {
    2 * sequences <= LANES
}

/// Returns true if the smoother may cut such a sequence. With few states another engine is faster.
pub(crate) fn smooths_in_lanes(states: usize, steps: usize) -> bool {
    states > MOST_FEW_STATES && is_worth_a_cut(steps)
}

/// Returns the largest number of steps of a group of segments in learning.
pub(crate) fn longest_segments_to_learn(states: usize) -> usize {
    longest_kept(states, MOST_KEPT)
}

/// Returns the largest number of steps of a group of segments in smoothing, given the number of
/// entries of the matrix; 0 if it is not suited to lanes.
pub(crate) fn longest_segments_to_smooth(states: usize, entries: usize) -> usize {
    let plan = ManyPlan { entries: Some(entries), ..ManyPlan::new(states, true) };
    let longest = [MOST_KEPT, MOST_CACHED].map(|bytes| longest_kept(states, bytes));
    longest.into_iter().find(|longest| plan.runs_in_lanes(LANES, *longest)).unwrap_or(0)
}

/// Returns the largest number of steps of a trial of how fast a model forgets, for a sequence of
/// `steps` and groups of at most `longest`; `None` if a trial is not worth it.
pub(crate) fn longest_trial(steps: usize, longest: usize) -> Option<usize> {
    // A warm-up is twice as long as a trial, and each segment is followed by one.
    let most = (steps / LANES / FEWEST_WARM_UPS).min(longest / (FEWEST_WARM_UPS + 1)) / 2;
    (is_worth_a_cut(steps) && most > 0).then_some(most)
}

/// Returns the number of groups of segments that a sequence is cut into, or `None` without room for
/// warm-ups of this length.
pub(crate) fn segment_groups(
    states: usize,
    steps: usize,
    warm_up: usize,
    longest: usize,
) -> Option<usize> {
    // A segment is long enough for its warm-ups to cost little, and for its group to fill its share
    // of the cache, but no longer than the memory of a group allows.
    let length = (WARM_UPS * warm_up).max(longest_kept(states, KEPT_OF_SEGMENTS));
    let length = length.min(longest.checked_sub(warm_up)?);
    let groups = steps.div_ceil(LANES * length.max(1));
    (steps / (LANES * groups) >= FEWEST_WARM_UPS * warm_up).then_some(groups)
}
