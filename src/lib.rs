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
//! a [`Likelihood`] operator. Its verbs for a **live stream** make a state that
//! takes one observation at a time:
//!
//! | verb | gives |
//! |---|---|
//! | [`Hmm::filter`] | [`Filter`]: p(now, given all so far), predictions and forecasts |
//! | [`Hmm::pruned_filter`] | [`PrunedFilter`]: the same for millions of states, within a bound that it proves |
//! | [`Hmm::fixed_lag`] | [`FixedLag`]: the last L steps, given all so far |
//! | [`Hmm::online_viterbi`] | [`OnlineViterbi`]: the best path, as far as it is final |
//!
//! What a stream knows is plain data: `snapshot` and `restore` copy it, and
//! [`to_bytes`](FilterState::to_bytes) and `from_bytes` store it, to the bit.
//!
//! Those for a **whole [`Sequence`]** take observations, or observations with
//! [controls](Controlled):
//!
//! | verb | gives |
//! |---|---|
//! | [`Hmm::forward`] | [`Filtering`]: every step given those up to it |
//! | [`Hmm::smooth`] | [`Smoothing`]: every step given all |
//! | [`Hmm::smooth_each`] | the same in O(n √T) memory, with pairwise posteriors, to a visitor |
//! | [`Hmm::expected_moves`] | [`MoveCounts`]: how often each move was made |
//! | [`Hmm::score`] | ln p(y_1 … y_T) |
//! | [`Hmm::path_entropy`] | how unsure the whole path is |
//! | [`Hmm::viterbi`], [`Hmm::k_best`] | [`ViterbiPath`]: the most probable paths, legal ones |
//! | [`Hmm::beam_viterbi`] | [`BeamPath`]: the same for millions of states, and whether it is proven |
//! | [`Hmm::path_sampler`] | [`PathSampler`]: paths drawn given all observations |
//! | [`Hmm::learn`] | [`Learned`]: the model that explains many sequences best |
//! | [`Hmm::learn_labelled`] | the model that labelled drives show |
//!
//! For many sequences at once there are [`Hmm::forward_all`],
//! [`Hmm::smooth_all`], [`Hmm::score_all`] and [`Hmm::viterbi_all`]; and
//! [`Hmm::simulate`] and [`Filter::simulate`] draw from the model. A method of
//! a stream that ends in `_with` takes a control.
//!
//! What moves and what is seen are operators, to be composed:
//!
//! | for | take |
//! |---|---|
//! | a map, a matrix | [`SparseTransition`], [`DenseTransition`] |
//! | a route | [`WindowTransition`] |
//! | a route, at hidden speeds, with odometry and what the camera says of a step | [`RouteTransition`](motion::RouteTransition) |
//! | metres driven, on a map | [`DistanceTransition`], with [`Odometry`] as its control |
//! | what was measured between two steps, by its likelihood for each move | [`EvidenceTransition`] |
//! | other controls, a matrix for each step | [`SwitchedTransition`], or an operator of your own with a control |
//! | a vehicle that may turn up anywhere | [`RestartTransition`] |
//! | places that are on no map, or seen for the first time | [`OffMapTransition`] |
//! | stops of any length | [`DwellTransition`], with a [`GroupedLikelihood`] |
//! | two things that move side by side | [`KroneckerTransition`] |
//! | sightings only every few steps | [`PowerTransition`] |
//! | few parameters for many moves, to be learned | [`TiedTransition`] |
//! | symbols, such as the place that a classifier names | [`TableLikelihood`] |
//! | likelihoods or their logarithms from elsewhere | [`LikelihoodVector`], [`LogLikelihoodFn`] |
//! | likelihoods of a few states among millions | [`SparseLikelihood`] |
//! | sightings that may be missing | [`OptionalLikelihood`] |
//! | images along a route, from references and queries to answers | [`Recognizer`](recognition::Recognizer) |
//! | images, by distances to reference images | [`AppearanceLikelihood`](observation::AppearanceLikelihood) |
//! | several sensors | [`FusedLikelihood`] |
//! | places that are known at some steps | [`KnownState`], fused with a sensor |
//! | a sensor that sees only part of a state | [`GroupedLikelihood`], with [`Groups`] |
//! | places with several reference images each | [`PooledLikelihood`] |
//! | tails that need not be exact | [`RoundedTails`] |
//! | what must not be learned | [`Fixed`] |
//!
//! Or implement [`Transition`] or [`Likelihood`] yourself: each has an example
//! of a dozen lines. With [`LearnTransition`] or [`LearnLikelihood`],
//! [`Hmm::learn`] estimates them, too.
//!
//! On top stand [`map`] (places and roads, and the transitions that follow),
//! [`motion`] (speeds along a route, with odometry and changes of the view as evidence),
//! [`observation`] (images by their descriptors or distances, and sensors that
//! take a place for its neighbours), [`recognition`] (places by images: the two together,
//! live and afterwards), [`evaluate`] (recall, precision and recall,
//! calibration and other scores), and [`canberra`], an instance with
//! 105 intersections, built from the public parts alone.
//!
//! [`from_descriptors`] goes from an N × d matrix of image descriptors to a live
//! position. [`formulas`] derives what every routine computes, with its cost, its
//! exactness and its sources. [`performance`] says what limits each, and what to use when.
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
//! - An error says what is wrong; what is behind it is its `source`.
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
//! A step in logarithms takes some ten times as long. Where the tails of a
//! sensor are not to be believed anyway, [`RoundedTails`] spares them; the
//! sensors of [`observation`] with a Gaussian come so.
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
mod inference;
mod kernels;
mod likelihood;
mod random;
mod sequence;
mod transition;

pub mod canberra;
pub mod evaluate;
pub mod map;
pub mod motion;
pub mod observation;
#[cfg(feature = "serde")]
pub mod persistence;
pub mod recognition;

pub use belief::{Belief, BeliefView};
pub use error::{
    BeliefError, HmmError, InferenceError, LearnError, LikelihoodError, SequenceError,
    SnapshotError, TableError, TransitionError,
};
pub use fixed::Fixed;
pub use groups::{GroupError, Groups};
pub use hmm::{Hmm, Prior};
pub use inference::{
    BeamPath, Certificate, Filter, FilterState, Filtering, FixedLag, FixedLagState, Labelled,
    LearnLikelihood, LearnTransition, Learned, Learning, Move, MoveCounts, OnlineViterbi,
    OnlineViterbiState, Order, Pairs, PathSampler, Posteriors, PrunedFilter, PrunedFilterState,
    Pruning, Simulation, SmoothedStep, Smoothing, StopReason, ViterbiPath,
};
pub use likelihood::{
    Diagonal, FusedLikelihood, GroupedLikelihood, KnownState, Likelihood, LikelihoodVector,
    LocalLikelihood, LogLikelihoodFn, OptionalLikelihood, PooledLikelihood, RoundedTails,
    SampleObservation, Scratch, SparseLikelihood, SparseObservation, TableLikelihood, Unlisted,
};
pub use sequence::{Controlled, Sequence};
pub use transition::{
    DenseTransition, DistanceTransition, DwellTransition, Ends, EvidenceTransition,
    KroneckerTransition, Odometry, OffMapTransition, PowerTransition, RestartTransition,
    SparseTransition, Stored, SwitchedTransition, TiedTransition, Transition, TransitionEntries,
    WindowTransition,
};

#[doc = include_str!("formulas.md")]
pub mod formulas {}

#[doc = include_str!("performance.md")]
pub mod performance {}

#[doc = include_str!("from_descriptors.md")]
pub mod from_descriptors {}

/// The README's example compiles.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
