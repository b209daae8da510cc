//! Exact inference in hidden Markov models (HMMs), made for localising vehicles: a map gives the
//! transitions, a sensor the likelihoods, and filter, smoother and decoder turn noisy
//! observations into a position.
//!
//! ```
//! use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
//!
//! // Three places in a row; the vehicle stays or moves on by one.
//! let motion = SparseTransition::from_triplets(
//!     3, // (to, from, probability)
//!     [(0, 0, 0.2), (1, 0, 0.8), (1, 1, 0.2), (2, 1, 0.8), (2, 2, 1.0)],
//! )?;
//! // Row i: the probabilities of what is seen at place i.
//! let camera = TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])?;
//! let start = Prior::BeforeFirstTransition(Belief::certain(3, 0)?);
//! let hmm = Hmm::new(start, motion, camera)?;
//!
//! let mut filter = hmm.filter(); // live, one observation at a time
//! filter.step(&0)?;
//! assert_eq!(filter.belief().mode(), 0); // apparently still at the start
//! filter.step(&2)?;
//! filter.step(&2)?;
//!
//! let sightings = [0, 2, 2]; // afterwards, with all observations
//! let smoothing = hmm.smooth(&sightings)?;
//! assert_eq!(smoothing.posteriors().modes(), [1, 2, 2]); // in hindsight, it had left
//! assert_eq!(hmm.viterbi(&sightings)?.states(), [1, 2, 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Overview
//!
//! The main type is [`Hmm`]: a [`Prior`], a [`Transition`] operator and a [`Likelihood`]
//! operator. For a **live stream** it creates a state that takes one observation at a time:
//!
//! | method | returns |
//! |---|---|
//! | [`Hmm::filter`] | [`Filter`]: p(state now, given all observations so far), predictions and forecasts |
//! | [`Hmm::fixed_lag`] | [`FixedLag`]: the last L steps, given all observations so far |
//! | [`Hmm::pruned_filter`] | [`PrunedFilter`]: the filter for millions of states, with a proven error bound |
//! | [`Hmm::online_viterbi`] | [`OnlineViterbi`]: the final part of the most probable path |
//!
//! A stream is plain data: `snapshot` and `restore` copy it, and with the feature `serde` its state
//! is [stored](guide::storing), exact to the bit. A filter's state also has compact
//! [bytes](inference::FilterSnapshot::to_bytes), without a feature.
//!
//! For a **whole [`Sequence`]** of observations, or of observations with
//! [controls](Controlled):
//!
//! | method | returns |
//! |---|---|
//! | [`Hmm::forward`] | each step, given the observations up to it ([`FilteredSequence`](inference::FilteredSequence)) |
//! | [`Hmm::smooth`] | each step, given all observations ([`SmoothedSequence`](inference::SmoothedSequence)) |
//! | [`Hmm::log_likelihood`] | ln p(y_1 … y_T) |
//! | [`Hmm::viterbi`], [`Hmm::k_best`], [`Hmm::beam_viterbi`] | the most probable paths |
//! | [`Hmm::path_sampler`] | paths drawn given all observations |
//! | [`Hmm::expected_moves`], [`Hmm::path_entropy`] | the expected count of each move; the entropy of the whole path |
//! | [`Hmm::learn`], [`Hmm::fit`] | a maximum-likelihood model, from sequences without labels or [with some](guide::labels); the same with all |
//! | [`Hmm::simulate`] | states and observations drawn from the model |
//!
//! [`guide::routines`] lists all routines, those for many sequences among them, with their
//! limitations. Methods of a stream whose names end in `_with` take a control.
//!
//! The root holds the names that nearly every program needs. Everything else is in a module,
//! whose front page tells which item to use:
//!
//! | module | holds |
//! |---|---|
//! | [`transition`] | operators: sparse, dense, windows, switched, dwell times, evidence on moves; [`transition::kit`] for your own |
//! | [`likelihood`] | sensors: tables, vectors, sparse, missing, fused, grouped; [`likelihood::kit`] for your own |
//! | [`inference`] | options and results of the methods above; trellises |
//! | [`map`] | places and roads, and the transitions derived from them |
//! | [`motion`] | vehicles: the distance driven as evidence, off the map |
//! | [`observation`] | sensors that confuse neighbouring places, measured positions, places that are seen or not |
//! | [`evaluate`] | recall, precision, calibration and other scores |
//! | `canberra` | the paper's instance with 105 intersections, built from public items only (feature `canberra`) |
//! | [`error`] | all errors |
//! | [`guide`] | chapters: [which routine](guide::routines), [formulas](guide::formulas), [performance](guide::performance), [labels of all steps or of some](guide::labels), [silent states](guide::silent_states), [a lost robot on a grid](guide::lost_robot), [storing models](guide::storing), [from dynamax](guide::from_dynamax) |
//!
//! You can also implement [`Transition`] or [`Likelihood`] yourself: each has an example of a dozen
//! lines, and a `kit` with tools and a test of all methods. With
//! [`LearnFromMoves`](transition::LearnFromMoves) or
//! [`LearnLikelihood`](likelihood::LearnLikelihood), [`Hmm::learn`] also estimates them.
//!
//! # When to take another crate
//!
//! | for | take |
//! |---|---|
//! | Gaussians, counts, angles and other families that are learned, regression, starts, choice of models, standard errors, residuals | [wayfix-learn](https://docs.rs/wayfix-learn) |
//! | road networks, imported maps, GPS points matched to roads | [wayfix-roads](https://docs.rs/wayfix-roads) |
//! | places recognised by images | [wayfix-recognition](https://docs.rs/wayfix-recognition) |
//!
//! They stand on this crate, and their operators and sensors work with every method of [`Hmm`].
//!
//! # Conventions
//!
//! - **States** are numbered from 0, as in slices. **Steps** k are numbered from 1: `ys[k - 1]`
//!   is y_k.
//! - A\[i, j\] = p(X_k = i | X_{k-1} = j): **columns** sum to one.
//! - The prior is the distribution either of X_0, [before the first
//!   transition](Prior::BeforeFirstTransition), or of X_1, [at the first
//!   observation](Prior::AtFirstObservation), which may be the [stationary](Prior::Stationary)
//!   one. The choice is explicit, since libraries differ, and so do the results.
//! - Entries are addressed as (to, from), like the indices of A; moves and turns as (from, to).
//!   Rows of a [`TableLikelihood`] sum to one.
//! - A **control** k drives the transition from k − 1 to k, the one before y_k.
//! - **Ties** go to the lowest state.
//! - Logarithms are natural.
//! - The message of an error includes that of its cause, which its variant also holds. Its `source`
//!   is the source of the cause, so that a printed chain of errors repeats nothing.
//!
//! # Exact or an error
//!
//! Recursions are scaled and run in linear space; nothing is clamped, and no zero is softened.
//! Likelihoods may have any scale, as numbers or as logarithms: adding a constant to the
//! log-likelihoods of a step changes the log-likelihood by that constant, and nothing else except
//! by rounding. Where a belief is out of the range of doubles, it is kept in logarithms, so that
//! one outlier does not rule out for good a state that it makes 1e-1000 as likely.
//!
//! A step in logarithms takes some ten times as long. Where tails carry no meaning, as with the
//! sensors of [`observation`] with a Gaussian, a model
//! [`with_rounded_tails`](Hmm::with_rounded_tails) avoids most of them.
//!
//! An observation that the model rules out is an [error](HmmError::Impossible) with its
//! step, and leaves the filter unchanged. Invalid input is an error that names the value and its
//! position. Panics occur only in direct calls of an operator's own methods with slices of a
//! wrong length, or with states that do not exist, as with slices; and if an operator of your own
//! lists such states as its entries.
//!
//! # Not included
//!
//! - Learning the parameters of structured operators (a window's weights, rates of restarts).
//! - Continuous states (Kalman and particle filters).
//! - Families of observations with their own M steps: they are in wayfix-learn.
//! - Computer vision: descriptors of images, or their similarities, are inputs.
//! - Silent states, which emit nothing and take no step; a [chapter](guide::silent_states) shows how to
//!   compose the moves through them into an operator.
//! - Reading `.npy` files: a crate such as `npyz` does, and every input here is a slice.
//! - `no_std`.
//!
//! # Platforms
//!
//! Any with the standard library. Tests run on x86-64 (with and without AVX2 and AVX-512), aarch64 and
//! WebAssembly (`wasm32-wasip1`), where everything runs on one thread.
//!
//! # Crate features
//!
//! None is on by default.
//!
//! - **`canberra`**: the module `canberra`, the instance of the paper. Compiles in its places and roads,
//!   which alone in the crate are under the Open Database License 1.0.
//! - **`csv`**: `RoadMap::from_csv_files` reads maps.
//! - **`faer`**: operators and tables from [faer](https://docs.rs/faer)
//!   matrices, dense operators as faer views. Adds most to compile time.
//! - **`rayon`**: many sequences, and the rows of large sparse matrices, in parallel, with
//!   identical results.
//! - **`serde`**: models and snapshots as JSON or in any other format of
//!   [serde](https://serde.rs), exact to the bit; [a chapter](guide::storing) has the formats.
//!
//! Random numbers come from any generator of rand 0.10.
//!
//! Equations are cited from B. Guo, B. Zhao and Z. Zhou, *Visual Place Recognition*, Australian
//! National University. Where the printed equation has an error, the docs of the item give the
//! intended one.

// On docs.rs, labels items with the features that they need.
#![cfg_attr(docsrs, feature(doc_cfg))]

mod belief;
#[allow(
    missing_docs,
    clippy::missing_errors_doc,
    reason = "hidden: what the sibling crates share has no promise"
)]
mod files;
mod fixed;
mod free_parameters;
mod groups;
mod hmm;
mod random;
mod reorder;
mod sequence;
#[cfg(feature = "serde")]
mod stored;

#[cfg(feature = "canberra")]
pub mod canberra;
pub mod error;
pub mod evaluate;
pub mod guide;
pub mod inference;
#[doc(hidden)]
pub mod internal;
pub mod likelihood;
pub mod map;
pub mod motion;
pub mod observation;
pub mod transition;

pub use belief::{Belief, BeliefView};
pub use error::{HmmError, LikelihoodError, TransitionError};
pub use fixed::Fixed;
pub use hmm::{Hmm, Prior};
#[doc(inline)]
pub use inference::{Filter, FixedLag, OnlineViterbi, PrunedFilter};
#[doc(inline)]
pub use likelihood::{
    Diagonal, FusedLikelihood, Likelihood, LikelihoodVector, OptionalLikelihood, Scratch,
    SparseLikelihood, TableLikelihood,
};
pub use reorder::ReorderStates;
pub use sequence::{Controlled, Sequence};
#[doc(inline)]
pub use transition::{DenseTransition, SparseTransition, Transition, TransitionEntries};

/// Doc test of the README's example.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
