//! Appearance as a sensor, against its definitions: spreads, offsets, the state
//! off the map, temperatures and views.
#![allow(clippy::cast_sign_loss, reason = "ranks are from 0 to 1")]

mod definition;
mod labelled;
mod learning;
mod likelihood;
mod units;
mod views;
