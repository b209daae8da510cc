//! Observation models for places: the likelihood of a sensor's output, given the place.
//!
//! The paper's sensor names a place. Most of the time it is right, sometimes it takes a place for
//! one of its neighbours (the discrete part P_c), and it has Gaussian noise on top (eqs. 2 to 4).
//!
//! ```
//! use wayfix::canberra;
//! use wayfix::observation::{Confusion, Metric};
//!
//! let map = canberra::map();
//! let confusion = Confusion::new(&map, 0.7)?;
//! assert!(confusion.probability(0, 0).unwrap() > 0.5); // place 1 is mostly seen as itself
//! assert_eq!(confusion.probability(0, 104), Some(0.0)); // and never as one far away
//!
//! let camera = confusion.with_gaussian(&map, Metric::Metres, 150.0)?;
//! # let _: wayfix::TableLikelihood = camera;
//! # Ok::<(), wayfix::error::OutOfRange>(())
//! ```
//!
//! A confusion alone is also a sensor, for any number of places: from a map, or from
//! [counts](Confusion::from_weights) of places seen as others.
//!
//! Descriptors of images are matched in wayfix-recognition; positions on road networks and tags are in
//! wayfix-roads.

mod confusion;
mod gaussian;
mod seen_places;

pub use confusion::Confusion;
pub use gaussian::Metric;
