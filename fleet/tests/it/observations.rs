//! Every kind of observation, from Parquet and CSV.

use std::fs;
use std::sync::Arc;

use arrow::array::{
    Array, ArrayRef, Float32Array, Float64Array, Float64Builder, Int64Array, Int64Builder,
    ListArray, ListBuilder, RecordBatch,
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
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::places::{Fix, Places};

use crate::kit::*;

const DRIVES: usize = 40;
const STEPS: usize = 7;

/// A table in the long form: drives of seven steps with these observations.
fn table(columns: Vec<(&str, ArrayRef)>) -> RecordBatch {
    let rows = 0..(DRIVES * STEPS) as i64;
    let ids = Int64Array::from_iter_values(rows.clone().map(|row| row / STEPS as i64));
    let steps = Int64Array::from_iter_values(rows);
    let first: Vec<(&str, ArrayRef)> = vec![("trace_id", Arc::new(ids)), ("step", Arc::new(steps))];
    RecordBatch::try_from_iter(first.into_iter().chain(columns)).unwrap()
}

/// The same in the nested form.
fn nest(rows: &RecordBatch) -> RecordBatch {
    let ids = Int64Array::from_iter_values(0..DRIVES as i64);
    let first: (&str, ArrayRef) = ("trace_id", Arc::new(ids));
    let schema = rows.schema();
    let others = schema.fields().iter().zip(rows.columns()).skip(1).map(|(field, column)| {
        let item = Arc::new(Field::new_list_field(column.data_type().clone(), true));
        let offsets = OffsetBuffer::from_lengths([STEPS; DRIVES]);
        let lists = ListArray::try_new(item, offsets, column.clone(), None).unwrap();
        (field.name().as_str(), Arc::new(lists) as ArrayRef)
    });
    RecordBatch::try_from_iter(std::iter::once(first).chain(others)).unwrap()
}

/// Compares log-likelihoods and states of all forms with those of the library.
fn compare<B: Likelihood<Observation: Sized>>(
    folder: &Folder,
    expected: &Hmm<impl wayfix::Transition<Control = ()>, B>,
    rows: &RecordBatch,
    csv: Option<&str>,
    observations: &[B::Observation],
) {
    folder.write("long.parquet", rows, 50);
    folder.write("nested.parquet", &nest(rows), 9);
    let mut inputs = vec!["long.parquet", "nested.parquet"];
    if let Some(csv) = csv {
        fs::write(folder.path("rows.csv"), csv).unwrap();
        inputs.push("rows.csv");
    }
    for input in inputs {
        let mut job = folder.job(input, &format!("{input}.out"), Verb::Smooth, Table::Steps);
        job.form = Some(wayfix_fleet::input::Form::Long);
        let (summary, found) = folder.results(&job);
        assert_eq!((summary.drives, summary.failed), (DRIVES as u64, 0), "{input}");
        let (state, p) = (states(&found, "state"), numbers(&found, "probability"));
        let logs = numbers(&found, "log_likelihood");
        for drive in 0..DRIVES {
            let range = drive * STEPS..(drive + 1) * STEPS;
            let smoothed = expected.smooth(&References(&observations[range.clone()])).unwrap();
            for (row, belief) in range.zip(smoothed.posteriors().iter()) {
                let (mode, probability) = belief.peak();
                assert_eq!(state[row], Some(mode as u32), "{input}, row {row}");
                close(p[row].unwrap(), probability);
                close(logs[row].unwrap(), smoothed.log_likelihood());
            }
        }
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

fn csv<'a>(header: &str, fields: impl IntoIterator<Item = String> + 'a) -> String {
    let lines = fields.into_iter().enumerate();
    let lines = lines.map(|(row, field)| format!("{},{row},{field}\n", row / STEPS));
    format!("trace_id,step,{header}\n{}", lines.collect::<String>())
}

#[test]
fn likelihoods_and_logarithms_of_all_states() {
    let mut rng = rng(1);
    let transition = transition(&mut rng);
    let values: Vec<Vec<f64>> = (0..DRIVES * STEPS)
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
        let folder = Folder::new(&model);
        let mut lists = ListBuilder::new(Float64Builder::new());
        values.iter().for_each(|row| lists.append_value(row.iter().map(|&p| Some(p))));
        let rows = table(vec![("observation", Arc::new(lists.finish()))]);
        let text = |row: &Vec<f64>| {
            row.iter().map(f64::to_string).collect::<Vec<_>>().join(if log { ";" } else { " " })
        };
        let text = csv("observation", values.iter().map(text).collect::<Vec<_>>());
        compare(&folder, &model, &rows, Some(&text), &values);
    }
    // Fixed-size lists of other number types; and a dense matrix.
    let matrix: Vec<Vec<f64>> =
        (0..STATES).map(|to| (0..STATES).map(|from| transition.get(to, from)).collect()).collect();
    let dense = DenseTransition::from_rows(&matrix).unwrap();
    let model = Hmm::new(prior(), dense, LikelihoodVector::linear(STATES).owned()).unwrap();
    let folder = Folder::new(&model);
    let numbers: Float32Array = values.iter().flatten().map(|&p| p as f32).collect();
    let item = Arc::new(Field::new_list_field(DataType::Float32, true));
    let lists = arrow::array::FixedSizeListArray::new(item, STATES as i32, Arc::new(numbers), None);
    compare(&folder, &model, &table(vec![("observation", Arc::new(lists))]), None, &values);
}

#[test]
fn a_few_states() {
    let mut rng = rng(2);
    let seen: Vec<SparseObservation> = (0..DRIVES * STEPS)
        .map(|_| {
            let mut listed: Vec<(usize, f64)> = (0..3)
                .map(|k| (4 * k + rng.random_range(0..3), rng.random_range(0.1..1.0)))
                .collect();
            if rng.random_bool(0.5) {
                listed.reverse();
            }
            SparseObservation::new(listed, rng.random_range(0.01..0.1)).unwrap()
        })
        .collect();
    let model = Hmm::new(prior(), transition(&mut rng), SparseLikelihood::new(STATES)).unwrap();
    let folder = Folder::new(&model);
    let lists = lists_of_pairs(seen.iter().map(SparseObservation::listed));
    let elsewhere = Float64Array::from_iter_values(seen.iter().map(SparseObservation::elsewhere));
    let rows = table(vec![("observation", Arc::new(lists)), ("elsewhere", Arc::new(elsewhere))]);
    let text = |seen: &SparseObservation| {
        let pairs = seen.listed().iter().map(|(state, p)| format!("{state}:{p}"));
        format!("{},{}", pairs.collect::<Vec<_>>().join(" "), seen.elsewhere())
    };
    let text = csv("observation,elsewhere", seen.iter().map(text).collect::<Vec<_>>());
    compare(&folder, &model, &rows, Some(&text), &seen);
}

#[test]
fn symbols_of_a_sparse_table_and_missing_ones() {
    let mut rng = rng(3);
    let transition = transition(&mut rng);
    let lists: Vec<(Vec<(usize, f64)>, f64)> = (0..5)
        .map(|k| (vec![(k, 0.7), (2 * k + 1, 0.9)], 0.05))
        .map(|(mut l, e): (Vec<_>, f64)| {
            l.dedup_by_key(|entry: &mut (usize, f64)| entry.0);
            (l, e)
        })
        .collect();
    let table_of = SparseTableLikelihood::from_lists(STATES, &lists).unwrap();
    let model = Hmm::new(prior(), transition.clone(), table_of).unwrap();
    let symbols: Vec<usize> = (0..DRIVES * STEPS).map(|_| rng.random_range(0..5)).collect();
    let column = Int64Array::from_iter_values(symbols.iter().map(|&symbol| symbol as i64));
    let rows = table(vec![("observation", Arc::new(column))]);
    let text = csv("observation", symbols.iter().map(usize::to_string).collect::<Vec<_>>());
    compare(&Folder::new(&model), &model, &rows, Some(&text), &symbols);

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
    let rows = table(vec![("observation", Arc::new(column.finish()))]);
    let text = |symbol: &Option<usize>| symbol.map_or(String::new(), |symbol| symbol.to_string());
    let text = csv("observation", seen.iter().map(text).collect::<Vec<_>>());
    compare(&Folder::new(&model), &model, &rows, Some(&text), &seen);
}

#[test]
fn positions() {
    let mut rng = rng(4);
    let place = |k: usize| Position { latitude: -35.3 + 1e-3 * k as f64, longitude: 149.1 };
    let places = Places::new((0..STATES).map(place).collect(), 3.0).unwrap();
    let model = Hmm::new(prior(), transition(&mut rng), places.clone()).unwrap();
    let seen: Vec<Fix> = (0..DRIVES * STEPS)
        .map(|_| Fix {
            latitude: rng.random_range(-35.301..-35.289),
            longitude: rng.random_range(149.099..149.101),
            deviation: rng.random_range(5.0..100.0),
        })
        .collect();
    // The density at 0 m, and its tails: (1 + q / 3)^(-5/2).
    let near = Fix { latitude: -35.3, longitude: 149.1, deviation: 20.0 };
    let far = Fix { latitude: -35.3 + 180.0 / 111_195.0, ..near };
    let one = Hmm::new(
        wayfix::Prior::AtFirstObservation(wayfix::Belief::uniform(1).unwrap()),
        DenseTransition::from_rows(&[[1.0]]).unwrap(),
        Places::new(vec![place(0)], 3.0).unwrap(),
    )
    .unwrap();
    let log = |fix| one.log_likelihood(&References(&[fix])).unwrap();
    close(log(near), -(2.0 * std::f64::consts::PI * 400.0).ln());
    assert!((log(far) - log(near) + 2.5 * 28.0_f64.ln()).abs() < 1e-3);

    let column = |of: &dyn Fn(&Fix) -> f64| -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(seen.iter().map(of)))
    };
    let rows = table(vec![
        ("latitude", column(&|fix| fix.latitude)),
        ("longitude", column(&|fix| fix.longitude)),
        ("deviation", column(&|fix| fix.deviation)),
    ]);
    let text = |fix: &Fix| format!("{},{},{}", fix.latitude, fix.longitude, fix.deviation);
    let text = csv("latitude,longitude,deviation", seen.iter().map(text).collect::<Vec<_>>());
    compare(&Folder::new(&model), &model, &rows, Some(&text), &seen);
}
