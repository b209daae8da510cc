//! Place recognition by images, from references and queries to answers: the place of the route
//! where the vehicle is, with its probability, or that it is off the map.
//!
//! ```
//! use wayfix_recognition::{LabelledPart, Options, Recognizer};
//!
//! # let row = |place: usize| -> Vec<f32> {
//! #     (0..60).map(|i| 0.4 + 0.02 * ((i * 7 + place * 3) % 11) as f32 - 0.3 * f32::from(u8::from(i == place))).collect()
//! # };
//! // Rows of distances, from a query to each of 60 references, however they were compared.
//! let queries: Vec<Vec<f32>> = (5..55).map(row).collect();
//! let recognizer = Recognizer::from_distances(60, Options::default())?;
//!
//! // Where the first queries were taken, if that is known.
//! let places: Vec<_> = (5..25).map(|place| Some(place..=place)).collect();
//! let part = LabelledPart { queries: &queries[..20], places: &places, odometry: &[] };
//! let recognizer = recognizer.fit(&[part])?;
//! for warning in recognizer.parameters().doubts() {
//!     eprintln!("{warning}"); // few steps are labelled
//! }
//!
//! // Live,
//! let mut track = recognizer.track();
//! for query in &queries {
//!     let answer = track.step(query, None)?;
//!     println!("{:?} {:.3} {:?}", answer.place, answer.probability, answer.around);
//! }
//! // or afterwards.
//! let recording = recognizer.recording(&queries, &[])?;
//! let answers = recording.smoothed()?.answers();
//! assert_eq!(answers[49].place, Some(54));
//! # Ok::<(), wayfix_recognition::RecognitionError>(())
//! ```
//!
//! Its parts can be used one by one: [motion](wayfix::motion) along the route at hidden speeds,
//! with odometry and changes of the view as evidence; a
//! [`Standardizer`](crate::observation::Standardizer), which makes the scores of references
//! comparable; and [`MatchOdds`](crate::observation::MatchOdds), which turn scores into odds.

#![allow(missing_docs)] // TEMP

mod answer;
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
mod recognizer;
mod recording;
mod references;
mod sensor;
mod temperature;
mod track;
mod views;
mod warning;

pub use answer::Answer;
pub use curves::{ThresholdCurve, ThresholdPoint};
pub use error::RecognitionError;
pub use fit::LabelledPart;
pub use mapper::Mapper;
pub use options::Options;
pub use parameters::Parameters;
pub use recognizer::Recognizer;
pub use recording::{PlaceBeliefs, Recording};
pub use track::{Track, TrackSnapshot};
pub use warning::Warning;
