//! Answers to lines of JSON, themselves lines of JSON.

use serde::Serialize;

use super::lines::BadLine;
use super::{UpdateResult, VehicleId};

#[derive(Serialize)]
struct Accepted<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    offset: Option<&'a VehicleId>,
    vehicle: &'a VehicleId,
    time: i64,
    state: usize,
    probability: f64,
    log_likelihood: f64,
}

#[derive(Serialize)]
struct Refused<'a> {
    line: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset: Option<&'a VehicleId>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle: Option<&'a VehicleId>,
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<i64>,
    error_kind: &'a str,
    error: String,
}

/// Writes the answer to an update.
pub(super) fn answer(
    out: &mut Vec<u8>,
    line: u64,
    offset: Option<&VehicleId>,
    (vehicle, time): (&VehicleId, i64),
    answer: &UpdateResult,
) {
    match answer {
        Ok(answer) => {
            let (state, probability) = (answer.state, answer.probability);
            let log_likelihood = answer.log_likelihood;
            write(out, &Accepted { offset, vehicle, time, state, probability, log_likelihood });
        }
        Err(error) => write(
            out,
            &Refused {
                line,
                offset,
                vehicle: Some(vehicle),
                time: Some(time),
                error_kind: error.kind(),
                error: error.to_string(),
            },
        ),
    }
}

/// Writes the answer to a bad line.
pub(super) fn refuse(out: &mut Vec<u8>, line: u64, bad: &BadLine) {
    let BadLine { vehicle, time, offset, kind, message } = bad;
    write(
        out,
        &Refused {
            line,
            offset: offset.as_ref(),
            vehicle: vehicle.as_ref(),
            time: *time,
            error_kind: kind,
            error: message.clone(),
        },
    );
}

#[derive(Serialize)]
struct Removal<'a> {
    line: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset: Option<&'a VehicleId>,
    vehicle: &'a VehicleId,
    removed: bool,
}

/// Writes the answer to a line that removes a vehicle, which may not have existed.
pub(super) fn removed(
    out: &mut Vec<u8>,
    line: u64,
    offset: Option<&VehicleId>,
    (vehicle, removed): (&VehicleId, bool),
) {
    write(out, &Removal { line, offset, vehicle, removed });
}

#[derive(Serialize)]
struct Exchanged<'a> {
    line: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset: Option<&'a VehicleId>,
    model: &'a str,
    hash: &'a str,
    vehicles_kept: usize,
    vehicles_begun_anew: usize,
}

/// Writes the answer to a line that replaces the model: its name and hash, and how many vehicles
/// kept or lost their belief.
pub(super) fn exchanged(
    out: &mut Vec<u8>,
    line: u64,
    offset: Option<&VehicleId>,
    (model, hash): (&str, &str),
    (vehicles_kept, vehicles_begun_anew): (usize, usize),
) {
    write(out, &Exchanged { line, offset, model, hash, vehicles_kept, vehicles_begun_anew });
}

#[derive(Serialize)]
struct Named<'a> {
    client: &'a str,
    offset: Option<&'a VehicleId>,
    saved: Option<&'a VehicleId>,
}

/// Writes the answer to a client that named itself: its last offset received, and its last offset
/// in a snapshot.
pub(super) fn named(
    out: &mut Vec<u8>,
    client: &str,
    offset: Option<&VehicleId>,
    saved: Option<&VehicleId>,
) {
    write(out, &Named { client, offset, saved });
}

fn write(out: &mut Vec<u8>, line: &impl Serialize) {
    // Writing to memory does not fail, nor does serialising these structs.
    _ = serde_json::to_writer(&mut *out, line);
    out.push(b'\n');
}
