//! Motion along a route: hidden speeds, odometry, changes of the view.
//!
//! | for | take |
//! |---|---|
//! | places in a row (reference images), with steps of any length | [`RouteTransition`], with hidden [`Speeds`] and a [`RouteControl`] |
//! | errors of odometry along a route | [`OdometryModel`] |
//! | a vehicle that may leave the route | [`OffMap`] |

mod fit;
mod route;
mod speeds;

pub use route::{
    Driven, OffMap, RouteControl, RouteTransition, ViewChange, ViewChangeRates, ViewEvidence,
};
pub use speeds::{OdometryModel, Speeds};
