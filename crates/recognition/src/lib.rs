//! Visual place recognition along a route with known reference images: where is the camera, with what
//! probability, and is it on the route at all?
//!
//! You drove a route once and kept an image every few metres, each as a descriptor: a vector by a
//! network, a histogram of gradients, or the pixels of a small image. Now a camera passes again, at
//! another time of day or year. A [`Recognizer`] of the references turns each query into a place and
//! a probability. It is a hidden Markov model on [`wayfix`]: single images err, and the motion from
//! one to the next puts them right. Where images err together, as in snow, a tunnel, or a street like
//! another one, the camera is taken to be [distracted](guide::formulas), and the vehicle goes on by
//! its motion. Nothing has to be tuned or trained first.
//!
//! ```
//! use wayfix_recognition::observation::Distance;
//! use wayfix_recognition::{Options, Recognizer};
//!
//! # let image = |place: usize| -> Vec<f32> {
//! #     (1..17).map(|k| ((place * 16 + k).pow(2) as f32 * 0.37).sin()).collect()
//! # };
//! # let frames: Vec<Vec<f32>> = (12..40).map(image).collect();
//! let references: Vec<Vec<f32>> = (0..60).map(image).collect(); // a descriptor for each image
//! let recognizer = Recognizer::from_descriptors(&references, Distance::Cosine, Options::default())?;
//!
//! let mut track = recognizer.track(); // live: the camera may be anywhere at first
//! for frame in &frames {
//!     let answer = track.step(frame)?; // with odometry: track.step_with(1.03, frame)
//!     match answer.place {
//!         Some(place) => println!("at reference {place} ± 1: {:.2}", answer.probability),
//!         None => println!("on none of them: {:.2}", answer.off_map),
//!     }
//! }
//! let answers = recognizer.recording(&frames, &[])?.smoothed()?.answers(); // afterwards
//! assert_eq!(answers[27].place, Some(39));
//! # Ok::<(), wayfix_recognition::RecognitionError>(())
//! ```
//!
//! # Which type when
//!
//! | you have | take |
//! |---|---|
//! | descriptors of the references, of one pass or of several | [`Recognizer::from_descriptors`], [`Recognizer::from_traverses`] |
//! | distances or similarities by a comparison of your own | [`Recognizer::from_distances`] |
//! | another route, camera or vehicle than usual | [`Options`], each with its default and the reason |
//! | frames as they come | [`Recognizer::track`], a [`Track`] with [`step`](Track::step), [`step_with`](Track::step_with) odometry and [`predict`](Track::predict) for a lost frame; a [`TrackSnapshot`] survives a restart |
//! | a whole drive | [`Recognizer::recording`], a [`Recording`] that is [filtered](Recording::filtered), [smoothed](Recording::smoothed), smoothed with a [lag](Recording::lagged) or [decoded](Recording::decoded) |
//! | a part of a drive whose places are known | [`LabelledPart`] and [`Recognizer::fit`], which gives [`Parameters`] to store, with [`Warning`]s |
//! | a drive without labels | [`Recognizer::learn`], which learns how the vehicle drives |
//! | no references yet | [`Mapper`], which keeps new views as references and recognises old ones |
//! | answers and the truth | [`ThresholdCurve`], and the scores of [`wayfix::evaluate`] |
//!
//! The parts serve alone, too. [`motion`] has the transition operator of a vehicle at hidden speeds
//! along a route, with odometry and changes of the view as evidence, for any [`wayfix::Hmm`].
//! [`observation`] has what looks at images: distances of descriptors, scores that are comparable
//! between references, odds, and changes of the view.
//!
//! The [guide](guide::from_descriptors) goes from descriptors to a position, with fitting, odometry,
//! stops, detours, evaluation, measured accuracies and known failures.
//!
//! # What it does not do
//!
//! - It computes no descriptors: bring those of any network or method.
//! - Places lie in a row, open or [closed](Options::with_closed). For a road network, take the
//!   [map](wayfix::map) of the core with the sensors of [`observation`].
//! - An answer is a reference, not a pose: references should be as close together as answers need to
//!   be told apart.
//! - It does not index millions of references: each query is compared with all, 100,000 of 128
//!   numbers in some milliseconds.
//!
//! # Features
//!
//! - `serde`: [`Parameters`], [`TrackSnapshot`], [`Mapper`] and the parts of a model can be stored,
//!   exact to the bit.
//!
//! None is a default.

mod advantage;
mod curves;
mod decode;
mod error;
mod examine;
mod fit;
pub mod guide;
mod learn;
mod mapper;
pub mod motion;
pub mod observation;
mod options;
mod parameters;
mod readings;
mod recognizer;
mod recording;
mod references;
mod sensor;
mod track;
mod views;
mod warning;

pub use curves::{ThresholdCurve, ThresholdPoint};
pub use error::RecognitionError;
pub use fit::LabelledPart;
pub use mapper::Mapper;
pub use options::Options;
pub use parameters::Parameters;
pub use recognizer::{Answer, Recognizer};
pub use recording::{PlaceBeliefs, Recording};
pub use track::{Track, TrackSnapshot};
pub use warning::Warning;
