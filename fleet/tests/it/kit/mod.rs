//! Models, drives and files.

mod columns;
mod folder;
mod learning;

use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, ListArray, RecordBatch, StringArray, UInt32Array};
use arrow::buffer::OffsetBuffer;
use arrow::datatypes::{DataType, Field};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};

#[allow(unused_imports, reason = "not all tests look at columns")]
pub(crate) use columns::*;
pub(crate) use folder::*;
#[allow(unused_imports, reason = "not all tests learn")]
pub(crate) use learning::*;

/// Number of states of the models.
pub(crate) const STATES: usize = 11;
/// A symbol that only state 0 emits.
pub(crate) const RARE: u32 = 5;

pub(crate) type Drives = Vec<Vec<u32>>;
pub(crate) type Model = Hmm<SparseTransition, TableLikelihood>;

pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A ring with random moves ahead; place 0 is left at once and never entered again.
pub(crate) fn transition(rng: &mut ChaCha8Rng) -> SparseTransition {
    let mut entries = Vec::new();
    for from in 0..STATES {
        let stay = if from == 0 { 0.0 } else { rng.random_range(0.1..0.8) };
        let next = if from + 1 == STATES { 1 } else { from + 1 };
        entries.extend([(from, from, stay), (next, from, 1.0 - stay)]);
    }
    SparseTransition::from_triplets(STATES, entries).unwrap()
}

pub(crate) fn prior() -> Prior {
    Prior::AtFirstObservation(Belief::uniform(STATES).unwrap())
}

/// A model of six symbols.
pub(crate) fn model(seed: u64) -> Hmm<SparseTransition, TableLikelihood> {
    let mut rng = rng(seed);
    let transition = transition(&mut rng);
    let rows: Vec<Vec<f64>> = (0..STATES)
        .map(|state| {
            let mut row: Vec<f64> = (0..6).map(|_| rng.random_range(0.05..1.0)).collect();
            if state > 0 {
                row[RARE as usize] = 0.0;
            }
            let sum: f64 = row.iter().sum();
            row.iter().map(|p| p / sum).collect()
        })
        .collect();
    Hmm::new(prior(), transition, TableLikelihood::from_rows(&rows).unwrap()).unwrap()
}

/// Drives of up to `most` steps, some with a rare symbol that makes the rest impossible.
pub(crate) fn drives(seed: u64, count: usize, least: usize, most: usize) -> Drives {
    let mut rng = rng(seed);
    let drive = |_| {
        let length = rng.random_range(least..=most);
        let rare = rng.random_bool(0.2);
        (0..length).map(|_| rng.random_range(0..if rare { 6 } else { 5 })).collect()
    };
    (0..count).map(drive).collect()
}

/// Step of a drive in the long form; steps need not be 1, 2, …
pub(crate) fn step(index: usize) -> i64 {
    10 * index as i64 + 3
}

pub(crate) fn nested(drives: &[Vec<u32>]) -> RecordBatch {
    let item = Arc::new(Field::new_list_field(DataType::UInt32, false));
    let symbols = UInt32Array::from(drives.concat());
    let offsets = OffsetBuffer::from_lengths(drives.iter().map(Vec::len));
    let lists = ListArray::try_new(item, offsets, Arc::new(symbols), None).unwrap();
    let ids = (0..drives.len()).map(|drive| Some(format!("drive {drive:05}")));
    let columns: [(&str, ArrayRef); 2] =
        [("trace_id", Arc::new(ids.collect::<StringArray>())), ("observation", Arc::new(lists))];
    RecordBatch::try_from_iter(columns).unwrap()
}

pub(crate) fn long(drives: &[Vec<u32>]) -> RecordBatch {
    let rows = || {
        let of = |(drive, symbols): (usize, &Vec<u32>)| {
            symbols.iter().enumerate().map(|(k, &s)| (drive, k, s)).collect::<Vec<_>>()
        };
        drives.iter().enumerate().flat_map(of)
    };
    let columns: [(&str, ArrayRef); 3] = [
        ("trace_id", Arc::new(Int64Array::from_iter_values(rows().map(|row| row.0 as i64)))),
        ("step", Arc::new(Int64Array::from_iter_values(rows().map(|row| step(row.1))))),
        ("observation", Arc::new(UInt32Array::from_iter_values(rows().map(|row| row.2)))),
    ];
    RecordBatch::try_from_iter(columns).unwrap()
}
