//! Every kind of observation.

use std::sync::Arc;

use arrow::array::{
    Array, ArrayRef, Float32Array, Float64Array, Float64Builder, Int64Array, Int64Builder,
    LargeListArray, ListArray, ListBuilder, RecordBatch,
};
use arrow::buffer::OffsetBuffer;
use arrow::datatypes::{DataType, Field};
use rand::RngExt;
use wayfix::likelihood::{SparseObservation, SparseTableLikelihood};
use wayfix::map::Position;
use wayfix::{
    DenseTransition, Hmm, Likelihood, LikelihoodVector, OptionalLikelihood, SparseLikelihood,
    TableLikelihood,
};
use wayfix_fleet::places::{Fix, Places};

use crate::kit::*;
use crate::tables::*;

const DRIVES: usize = 40;
const STEPS: usize = 7;
const ALL: usize = DRIVES * STEPS;

/// Lists of seven elements each, and the ids of their drives.
fn nest(columns: &[(&str, ArrayRef)]) -> RecordBatch {
    let ids: ArrayRef = Arc::new(Int64Array::from_iter_values(0..DRIVES as i64));
    let lists = columns.iter().map(|(name, column)| {
        let item = Arc::new(Field::new_list_field(column.data_type().clone(), true));
        let offsets = OffsetBuffer::from_lengths([STEPS; DRIVES]);
        let lists = ListArray::try_new(item, offsets, column.clone(), None).unwrap();
        (*name, Arc::new(lists) as ArrayRef)
    });
    RecordBatch::try_from_iter(std::iter::once(("trace_id", ids)).chain(lists)).unwrap()
}

/// Compares all functions with the library.
fn compare<B: Likelihood<Observation: Sized>>(
    expected: &Hmm<impl wayfix::TransitionEntries<Control = ()>, B>,
    folder: &Folder,
    table: &RecordBatch,
    arguments: &str,
    observations: &[B::Observation],
) {
    folder.write("drives.parquet", table, 9);
    let model = model_of(folder);
    let sql = format!(
        "SELECT trace_id, wayfix_score({model}, {arguments}) AS score, \
         wayfix_smooth({model}, {arguments}) AS smooth, \
         wayfix_filter({model}, {arguments}) AS filter, \
         wayfix_decode({model}, {arguments}) AS decode FROM drives"
    );
    let found = rows(&over(folder, "drives.parquet", &["trace_id"], &sql));
    assert!(integers(&found, "trace_id").into_iter().eq((0..DRIVES as i64).map(Some)));
    let logs = numbers(&fields(&found, "score"), "log_likelihood");
    for drive in 0..DRIVES {
        let seen = References(&observations[drive * STEPS..(drive + 1) * STEPS]);
        let smoothed = expected.smooth(&seen).unwrap();
        let filtered = expected.forward(&seen).unwrap();
        close(logs[drive].unwrap(), smoothed.log_likelihood());
        for (name, posteriors) in
            [("smooth", smoothed.posteriors()), ("filter", filtered.posteriors())]
        {
            let items = items_of(&list(&found, name), drive).unwrap();
            let (state, p) = (states(&items, "state"), numbers(&items, "probability"));
            assert_eq!(p.len(), STEPS);
            for (k, belief) in posteriors.iter().enumerate() {
                assert_eq!(state[k], Some(belief.peak().0 as u32), "{arguments}, drive {drive}");
                close(p[k].unwrap(), belief.peak().1);
            }
        }
        let path = expected.viterbi(&seen).unwrap();
        let items = items_of(&list(&found, "decode"), drive).unwrap();
        let found = states(&items, "state");
        assert!(found.into_iter().eq(path.states().iter().map(|&state| Some(state as u32))));
    }
}

/// Observations that need not be copied.
struct References<'a, Y>(&'a [Y]);

impl<Y> wayfix::Sequence<(), Y> for References<'_, Y> {
    fn steps(&self) -> usize {
        self.0.len()
    }
    fn control(&self, _: usize) -> &() {
        &()
    }
    fn observation(&self, step: usize) -> &Y {
        &self.0[step - 1]
    }
}

#[test]
fn likelihoods_and_logarithms_of_all_states() {
    let mut rng = rng(1);
    let transition = transition(&mut rng);
    let values: Vec<Vec<f64>> = (0..ALL)
        .map(|_| (0..STATES).map(|_| f64::from(rng.random_range(0.01..1.0_f32))).collect())
        .collect();
    for log in [false, true] {
        let sensor =
            if log { LikelihoodVector::log(STATES) } else { LikelihoodVector::linear(STATES) };
        let model = Hmm::new(prior(), transition.clone(), sensor.owned()).unwrap();
        let values: Vec<Vec<f64>> = if log {
            // Beyond the range of a double.
            values.iter().map(|row| row.iter().map(|p| 3000.0 * (p - 2.0)).collect()).collect()
        } else {
            values.clone()
        };
        let mut lists = ListBuilder::new(Float64Builder::new());
        values.iter().for_each(|row| lists.append_value(row.iter().map(|&p| Some(p))));
        let table = nest(&[("seen", Arc::new(lists.finish()))]);
        compare(&model, &Folder::new(&model), &table, "seen", &values);
    }
    // Fixed-size lists of other number types, in a large list; and a dense matrix.
    let matrix: Vec<Vec<f64>> =
        (0..STATES).map(|to| (0..STATES).map(|from| transition.get(to, from)).collect()).collect();
    let dense = DenseTransition::from_rows(&matrix).unwrap();
    let model = Hmm::new(prior(), dense, LikelihoodVector::linear(STATES).owned()).unwrap();
    let numbers: Float32Array = values.iter().flatten().map(|&p| p as f32).collect();
    let item = Arc::new(Field::new_list_field(DataType::Float32, true));
    let lists = arrow::array::FixedSizeListArray::new(item, STATES as i32, Arc::new(numbers), None);
    let item = Arc::new(Field::new_list_field(lists.data_type().clone(), true));
    let offsets = OffsetBuffer::<i64>::from_lengths([STEPS; DRIVES]);
    let lists: ArrayRef = Arc::new(LargeListArray::new(item, offsets, Arc::new(lists), None));
    let ids: ArrayRef = Arc::new(Int64Array::from_iter_values(0..DRIVES as i64));
    let table = RecordBatch::try_from_iter([("trace_id", ids), ("seen", lists)]).unwrap();
    compare(&model, &Folder::new(&model), &table, "seen", &values);
}

#[test]
fn a_few_states() {
    let mut rng = rng(2);
    let listed: Vec<Vec<(usize, f64)>> = (0..ALL)
        .map(|_| {
            (0..3).map(|k| (4 * k + rng.random_range(0..3), rng.random_range(0.1..1.0))).collect()
        })
        .collect();
    let elsewhere: Vec<f64> = (0..ALL).map(|_| rng.random_range(0.01..0.1)).collect();
    let lists = lists_of_pairs(listed.iter().map(Vec::as_slice));
    let table = nest(&[
        ("seen", Arc::new(lists)),
        ("others", Arc::new(Float64Array::from(elsewhere.clone()))),
    ]);
    let model = Hmm::new(prior(), transition(&mut rng), SparseLikelihood::new(STATES)).unwrap();
    let folder = Folder::new(&model);
    let observation = |elsewhere: &dyn Fn(usize) -> f64| -> Vec<SparseObservation> {
        let seen = listed.iter().enumerate();
        seen.map(|(k, l)| SparseObservation::new(l.clone(), elsewhere(k)).unwrap()).collect()
    };
    compare(&model, &folder, &table, "seen, others", &observation(&|k| elsewhere[k]));
    // Without a likelihood for the other states it is 0: some drives are ruled out.
    let sql = format!("SELECT wayfix_score({}, seen) AS score FROM drives", model_of(&folder));
    let mut query = over(&folder, "drives.parquet", &[], &sql);
    query.threads = 1;
    let logs = numbers(&fields(&rows(&query), "score"), "log_likelihood");
    for (seen, log) in observation(&|_| 0.0).chunks(STEPS).zip(&logs) {
        match (model.log_likelihood(seen), log) {
            (Ok(expected), Some(log)) => close(*log, expected),
            (expected, log) => assert!(expected.is_err() && log.is_none()),
        }
    }
    assert!(logs.iter().any(Option::is_none));
}

#[test]
fn symbols_of_a_sparse_table_and_missing_ones() {
    let mut rng = rng(3);
    let transition = transition(&mut rng);
    let lists: Vec<(Vec<(usize, f64)>, f64)> =
        (0..5).map(|k| (vec![(k, 0.7), (2 * k + 2, 0.9)], 0.05)).collect();
    let lists: Vec<_> = lists
        .into_iter()
        .map(|(list, elsewhere)| {
            (list.into_iter().filter(|(s, _)| *s < STATES).collect(), elsewhere)
        })
        .collect::<Vec<(Vec<(usize, f64)>, f64)>>();
    let sensor = SparseTableLikelihood::from_lists(STATES, &lists).unwrap();
    let model = Hmm::new(prior(), transition.clone(), sensor).unwrap();
    let symbols: Vec<usize> = (0..ALL).map(|_| rng.random_range(0..5)).collect();
    let column = Int64Array::from_iter_values(symbols.iter().map(|&symbol| symbol as i64));
    let table = nest(&[("seen", Arc::new(column))]);
    compare(&model, &Folder::new(&model), &table, "seen", &symbols);

    let rows: Vec<Vec<f64>> = (0..STATES)
        .map(|state| {
            let row: Vec<f64> = (0..5).map(|symbol| 1.0 + ((state * symbol) % 7) as f64).collect();
            row.iter().map(|p| p / row.iter().sum::<f64>()).collect()
        })
        .collect();
    let camera = OptionalLikelihood::new(TableLikelihood::from_rows(&rows).unwrap());
    let model = Hmm::new(prior(), transition, camera).unwrap();
    let seen: Vec<Option<usize>> =
        symbols.iter().map(|&symbol| rng.random_bool(0.7).then_some(symbol)).collect();
    let mut column = Int64Builder::new();
    seen.iter().for_each(|symbol| column.append_option(symbol.map(|symbol| symbol as i64)));
    let table = nest(&[("seen", Arc::new(column.finish()))]);
    compare(&model, &Folder::new(&model), &table, "seen", &seen);
}

#[test]
fn positions() {
    let mut rng = rng(4);
    let place = |k: usize| Position { latitude: -35.3 + 1e-3 * k as f64, longitude: 149.1 };
    let places = Places::new((0..STATES).map(place).collect(), 3.0).unwrap();
    let model = Hmm::new(prior(), transition(&mut rng), places).unwrap();
    let seen: Vec<Fix> = (0..ALL)
        .map(|_| Fix {
            latitude: rng.random_range(-35.301..-35.289),
            longitude: rng.random_range(149.099..149.101),
            deviation: rng.random_range(5.0..100.0),
        })
        .collect();
    let column = |of: &dyn Fn(&Fix) -> f64| -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(seen.iter().map(of)))
    };
    let table = nest(&[
        ("a", column(&|fix| fix.latitude)),
        ("b", column(&|fix| fix.longitude)),
        ("c", column(&|fix| fix.deviation)),
    ]);
    compare(&model, &Folder::new(&model), &table, "a, b, c", &seen);
}
