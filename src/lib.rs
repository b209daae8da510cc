//! Exact inference in hidden Markov models (HMMs), made for telling where a
//! vehicle is: a map gives the transitions, a sensor the likelihoods, and
//! filter, smoother and decoder turn noisy sightings into a position.
//!
//! ```
//! use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
//!
//! // Three places in a row; the vehicle stays or goes one on.
//! let motion = SparseTransition::from_triplets(
//!     3, // (to, from, probability)
//!     [(0, 0, 0.2), (1, 0, 0.8), (1, 1, 0.2), (2, 1, 0.8), (2, 2, 1.0)],
//! )?;
//! // How often each place is seen as each place.
//! let camera = TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])?;
//! let start = Prior::BeforeFirstTransition(Belief::certain(3, 0)?);
//! let hmm = Hmm::new(start, motion, camera)?;
//!
//! let mut filter = hmm.filter(); // live, one sighting at a time
//! filter.step(&0)?;
//! assert_eq!(filter.belief().mode(), 0); // still at the start? so it looks
//! filter.step(&2)?;
//! filter.step(&2)?;
//!
//! let sightings = [0, 2, 2]; // afterwards, with all of them
//! let smoothing = hmm.smooth(&sightings)?;
//! assert_eq!(smoothing.posteriors().modes(), [1, 2, 2]); // it had left already
//! assert_eq!(hmm.viterbi(&sightings)?.states(), [1, 2, 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Overview
//!
//! The one type to know is [`Hmm`]: a [`Prior`], a [`Transition`] operator and
//! a [`Likelihood`] operator. For a **live stream** it makes a state that takes one
//! observation at a time:
//!
//! | verb | gives |
//! |---|---|
//! | [`Hmm::filter`] | [`Filter`]: p(now, given all so far), predictions and forecasts |
//! | [`Hmm::fixed_lag`] | [`FixedLag`]: the last L steps, given all so far |
//! | [`Hmm::pruned_filter`] | [`PrunedFilter`]: the filter for millions of states, within a bound that it proves |
//! | [`Hmm::online_viterbi`] | [`OnlineViterbi`]: the most probable path, as far as it is final |
//!
//! A stream is plain data: `snapshot` and `restore` copy it,
//! [`to_bytes`](inference::FilterSnapshot::to_bytes) and `from_bytes` store it, to the bit.
//!
//! For a **whole [`Sequence`]** of observations, or of observations with
//! [controls](Controlled):
//!
//! | verb | gives |
//! |---|---|
//! | [`Hmm::forward`] | each step given those up to it ([`FilteredSequence`](inference::FilteredSequence)) |
//! | [`Hmm::smooth`] | each step given all ([`SmoothedSequence`](inference::SmoothedSequence)) |
//! | [`Hmm::smooth_each`] | the same in O(n √T) memory, with pairwise posteriors, to a visitor |
//! | [`Hmm::log_likelihood`] | ln p(y_1 … y_T) |
//! | [`Hmm::viterbi`], [`Hmm::k_best`], [`Hmm::beam_viterbi`] | the most probable paths |
//! | [`Hmm::path_sampler`] | paths drawn given all observations |
//! | [`Hmm::expected_moves`], [`Hmm::path_entropy`] | how often each move was made; how unsure the whole path is |
//! | [`Hmm::learn`], [`Hmm::learn_labelled`] | a model of maximum likelihood, from sequences without labels or with |
//!
//! [`Hmm::forward_all`], [`Hmm::smooth_all`], [`Hmm::log_likelihood_all`] and
//! [`Hmm::viterbi_all`] take many sequences at once; [`Hmm::simulate`] and
//! [`Filter::simulate`] draw from the model. Methods of a stream that end in `_with` take a
//! control.
//!
//! The root holds the names that nearly every program needs. Everything else is in a
//! module, whose front page says when to take what:
//!
//! | module | holds |
//! |---|---|
//! | [`transition`] | operators: sparse, dense, windows, switched, dwell times, evidence on moves |
//! | [`likelihood`] | sensors: tables, vectors, sparse, missing, fused, grouped |
//! | [`inference`] | options and results of the verbs above |
//! | [`map`] | places and roads, and the transitions that follow from them |
//! | [`motion`] | vehicles: speeds along a route, odometry, distances on a map, off the map |
//! | [`observation`] | images by their descriptors or distances, sensors that confuse neighbouring places |
//! | [`recognition`] | places by images, from references and queries to answers, live and afterwards |
//! | [`evaluate`] | recall, precision, calibration and other scores |
//! | [`canberra`] | the paper's instance with 105 intersections, built from public parts alone |
//! | [`guide`] | pages to read: [formulas](guide::formulas), [performance](guide::performance), [from descriptors to a position](guide::from_descriptors) |
//!
//! Or implement [`Transition`] or [`Likelihood`] yourself: each has an example
//! of a dozen lines; [`with_scratch`](transition::with_scratch) lends an operator memory.
//! With [`LearnTransition`](transition::LearnTransition) or
//! [`LearnLikelihood`](likelihood::LearnLikelihood), [`Hmm::learn`] estimates them, too.
//!
//! # Conventions
//!
//! - **States** are numbered from 0, as slices are. **Steps** k are numbered
//!   from 1: `ys[k - 1]` is y_k.
//! - A\[i, j\] = p(X_k = i | X_{k-1} = j): **columns** sum to one.
//! - The prior is either of X_0, [before the first
//!   transition](Prior::BeforeFirstTransition), or of X_1, [at the first
//!   observation](Prior::AtFirstObservation). You say which; libraries differ,
//!   and so do the results.
//! - Entries are given and asked for as (to, from), like the indices of A; moves
//!   and turns as (from, to). Rows of a [`TableLikelihood`] sum to one.
//! - A **control** k drives the transition from k − 1 to k, the one before y_k.
//! - **Ties** go to the lowest state.
//! - Logarithms are natural.
//! - An error says what is wrong and why: its text ends with that of its cause, which its
//!   variant holds, too. Its `source` is what is behind the cause, so that a chain of errors
//!   says nothing twice.
//!
//! # Exact or an error
//!
//! Recursions are scaled and run in linear space; nothing is clamped, and no
//! zero is softened. Likelihoods may have any scale, as numbers or as
//! logarithms: adding a constant to the log-likelihoods of a step changes the
//! log-likelihood by it, and nothing else but by rounding. Where doubles do not
//! hold a belief, it is kept in logarithms, so that one wild sighting does not
//! rule out for good what it makes 1e-1000 as likely.
//!
//! A step in logarithms takes some ten times as long. Where tails are not to be
//! believed anyway, such as those of the sensors of [`observation`] with a Gaussian,
//! a model [`with_rounded_tails`](Hmm::with_rounded_tails) spares them.
//!
//! An observation that the model rules out is an
//! [error](InferenceError::Impossible) with its step, and leaves a filter as it
//! was. Input that is not valid is an error that says what and where. Only
//! direct calls of an operator's own methods with slices of a wrong length, or
//! with states that do not exist, panic, as slices do; and so does an operator
//! of your own that lists such states as its entries.
//!
//! # What it does not do
//!
//! - Learn what structured operators are made of (a window's weights, dwell
//!   times, rates), or whether there should be another state.
//! - Continuous states: no Kalman or particle filters.
//! - See: descriptors of images, or their similarities, come from elsewhere.
//! - Work without `std`.
//!
//! # Crate features
//!
//! - **`csv`** (default): `RoadMap::from_csv_files` reads maps.
//! - **`faer`**: operators and tables from [faer](https://docs.rs/faer)
//!   matrices, dense operators as faer views. Adds most to compile time.
//! - **`rayon`**: many sequences, and the lines of large sparse maps, in parallel, with
//!   the same results.
//! - **`serde`**: models and snapshots as JSON or in any other format of
//!   [serde](https://serde.rs), to the bit; the module `persistence` says how.
//!
//! Random numbers come from any generator of rand 0.10.
//!
//! Equations are cited from B. Guo, B. Zhao and Z. Zhou, *Visual Place
//! Recognition*, Australian National University. Where one of them reads wrongly,
//! the docs of the item say what is meant.

mod belief;
mod error;
mod fixed;
mod groups;
mod hmm;
mod kernels;
mod random;
mod sequence;

pub mod canberra;
pub mod evaluate;
pub mod guide;
pub mod inference;
pub mod likelihood;
pub mod map;
pub mod motion;
pub mod observation;
#[cfg(feature = "serde")]
pub mod persistence;
pub mod recognition;
pub mod transition;

pub use belief::{Belief, BeliefView};
pub use error::{BeliefError, HmmError, InferenceError, LikelihoodError, TransitionError};
pub use fixed::Fixed;
pub use hmm::{Hmm, Prior};
#[doc(inline)]
pub use inference::{Filter, FixedLag, OnlineViterbi, PrunedFilter};
#[doc(inline)]
pub use likelihood::{
    Diagonal, FusedLikelihood, Likelihood, LikelihoodVector, OptionalLikelihood, Scratch,
    SparseLikelihood, TableLikelihood,
};
pub use sequence::{Controlled, Sequence};
#[doc(inline)]
pub use transition::{DenseTransition, SparseTransition, Transition, TransitionEntries};

/// The README's example compiles.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
