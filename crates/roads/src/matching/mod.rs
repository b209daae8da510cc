//! Map matching: positions of a vehicle on a road network, live and afterwards, with
//! probabilities.
//!
//! A [`Matcher`] holds a [`RoadNetwork`](crate::RoadNetwork). The states of a point are the
//! roads near it, each at its nearest place, and one state off the road; routes connect the states
//! of consecutive points. This is the model of Newson and Krumm (2009), with every answer that a
//! hidden Markov model has: the [road now](Vehicle::live), a few [points late](Vehicle::late),
//! [with all points](MatchedDrive::smoothed), the most probable [route](MatchedDrive::route), and
//! [distinct routes](Matcher::routes), each with a probability. The [guide](crate::guide)
//! leads from files to routes and says when another model fits
//! better.
//!
//! ```
//! use wayfix_roads::NetworkBuilder;
//! use wayfix::map::{Position, RoadClass};
//! use wayfix_roads::matching::{Matcher, TracePoint};
//!
//! // Two streets, 55 m apart, joined at both ends.
//! let at = |latitude, longitude| Position { latitude, longitude };
//! let mut builder = NetworkBuilder::new();
//! builder.node(1, at(-35.2800, 149.13))?;
//! builder.node(2, at(-35.2800, 149.14))?;
//! builder.node(3, at(-35.2805, 149.13))?;
//! builder.node(4, at(-35.2805, 149.14))?;
//! for (from, to) in [(1, 2), (3, 4), (1, 3), (2, 4)] {
//!     builder.both_ways(from, to, RoadClass::Street)?;
//! }
//! let matcher = Matcher::new(builder.build()?);
//!
//! // East along the southern street, with noise.
//! let point = |k: f64, off: f64| {
//!     TracePoint::new(10.0 * k, at(-35.2805 + off, 149.131 + 0.001 * k))
//! };
//! let drive = [point(0.0, 5e-5), point(1.0, 1e-4), point(2.0, -5e-5), point(3.0, 0.0)];
//!
//! let matched = matcher.match_drive(&drive)?;
//! let road = matched.smoothed(1);
//! let edge = matcher.network().edges()[road.edge.expect("on a road")];
//! assert_eq!([edge.from, edge.to], [2, 3]); // nodes 3 and 4
//! assert!(road.probability > 0.9);
//!
//! // The same live, point by point.
//! let mut vehicle = matcher.start(&drive[0], 3)?;
//! for point in &drive[1..] {
//!     vehicle.step(&matcher, point)?;
//! }
//! assert_eq!(vehicle.live(), matched.live(3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **The model.** The error of a position is a slowly moving offset plus white noise. Each state
//! carries the joint distribution of the offset and its place along the road, so a persistent error
//! counts once rather than at each point. Reception is usual, or [poor](MatchModel::poor) for a
//! minute or so, with errors four times as large; or the receiver is rough, with errors twice as
//! large and a larger share of white noise. Each state carries the probability of each kind, and
//! the error of a stationary vehicle hardly changes. The likelihood of a position is its density
//! across the road, given the positions before, plus a share of [outliers](MatchModel::outliers),
//! which are spread over some 30 σ and thin out beyond.
//!
//! Moves are weighted by what was measured between the two points, and these weights are not
//! normalised: the density of the length, for a vehicle that is stationary or drives at up to some
//! 1.3 times the speed of the road (one in ten at any speed, and one in ten in a queue); the detour
//! relative to the straight line, exponential with a mean that grows with time; the
//! [turns](Matcher::with_turns) at junctions, by their angles and the classes of the roads; and
//! U-turns. A move off the road pays for the area where it may end, just as a move on roads pays
//! for its length, its junctions and the position across. Only between points in quick succession
//! does it pay a constant, so that stretches off the road are found where no road is near. Where
//! positions are far off, states continue along their roads at the last speed, and no length counts
//! as measured, so neither a bad position nor a gap breaks a drive.
//!
//! **The parameters** of a [`MatchModel`] can be [learned](Matcher::learn) from unlabelled drives.
//! All other numbers, such as the width of the outlier density and the weight of choices, are
//! constants chosen on 19 recorded drives and on simulated ones.
//!
//! **Limits.** Candidates are the nearest 64 edges within 10 m plus four standard deviations of a
//! position, averaged over all kinds of reception; routes are searched up to some 1.3 times the
//! straight distance, and up to 1.2 times the distance covered at 40 m/s. Moves into a state are
//! merged by the first two moments of their errors. States with less than 6e-6 of the belief have
//! no successors. The default model does not follow a receiver that is off by more than 40 m for
//! minutes. A car park is told from the road beside it only by points at least some five seconds
//! apart.
//!
//! **The layers**, each built on the ones before it: the model and the points; the receiver and its
//! errors; the candidates of a point, the ways between them, and the weights of moves; one step of
//! a matcher, which adds its candidates and moves to a trellis; and on top of the step, vehicles,
//! learning, and drives with their distinct routes.

mod answer;
mod candidates;
mod drive;
mod error;
#[cfg(any(feature = "csv", feature = "geojson", feature = "gpx"))]
mod files;
mod lasting;
mod learn;
mod matcher;
mod model;
mod moves;
mod point;
mod receiver;
mod route;
mod routes;
mod sighting;
mod step;
mod vehicle;
#[cfg(feature = "csv")]
mod writer;

pub use answer::{RoadAnswer, Stretch, Stretches};
pub use drive::MatchedDrive;
pub use error::MatchError;
#[cfg(any(feature = "csv", feature = "geojson", feature = "gpx"))]
pub use files::{Trace, TraceReport, read_traces, read_traces_from};
pub use learn::LearnedMatchModel;
pub use matcher::Matcher;
pub use model::MatchModel;
pub use point::TracePoint;
pub use routes::RankedRoutes;
pub use vehicle::Vehicle;
#[cfg(feature = "csv")]
pub use writer::AnswerWriter;
