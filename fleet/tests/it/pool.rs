//! Pools of live vehicles against filters of the library.

use std::collections::HashMap;
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use tempfile::TempDir;
use wayfix::likelihood::SparseObservation;
use wayfix::map::Position;
use wayfix::{
    Filter, Hmm, InferenceError, Likelihood, LikelihoodVector, OptionalLikelihood,
    SparseLikelihood, Transition,
};
use wayfix_fleet::places::{Fix, Places};
use wayfix_fleet::pool::{
    LiveJob, LiveSummary, Pool, PoolOptions, Update, UpdateResult, VehicleId, live,
};
use wayfix_fleet::{FleetError, model::Model};

use crate::kit::*;

/// Filters of single vehicles.
struct Filters<'a, A: Transition, B: Likelihood> {
    hmm: &'a Hmm<A, B>,
    vehicles: HashMap<VehicleId, Seen<'a, A, B>>,
}

/// Time of the last update, and the filter.
type Seen<'a, A, B> = (i64, Filter<&'a Hmm<A, B>>);

/// State, and the bits of its probability and of the log-likelihood; or the kind of an error.
type Expected = Result<(usize, u64, u64), &'static str>;

impl<'a, A, B> Filters<'a, A, B>
where
    A: Transition<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    fn new(hmm: &'a Hmm<A, B>) -> Self {
        Self { hmm, vehicles: HashMap::new() }
    }

    fn take(&mut self, update: &Update<B::Observation>) -> Expected {
        let known = self.vehicles.get(&update.vehicle);
        if known.is_some_and(|known| update.time <= known.0) {
            return Err("time");
        }
        let known = known.filter(|_| !update.restart);
        let mut filter = known.map_or_else(|| self.hmm.filter(), |known| known.1.clone());
        let log = filter.step(&update.observation).map_err(|error| match error {
            InferenceError::Impossible { .. } => "impossible",
            InferenceError::Likelihood(_) => "likelihood",
            other => panic!("{other}"),
        })?;
        let (state, probability) = filter.belief().peak();
        self.vehicles.insert(update.vehicle.clone(), (update.time, filter));
        Ok((state, probability.to_bits(), log.to_bits()))
    }
}

fn bits(answer: &UpdateResult) -> Expected {
    let bits = |number: f64| number.to_bits();
    match answer {
        Ok(answer) => Ok((answer.state, bits(answer.probability), bits(answer.log_likelihood))),
        Err(error) => Err(error.kind()),
    }
}

/// Updates of vehicles at random, some of them late or twice, and some from the start.
fn updates<Y>(
    rng: &mut ChaCha8Rng,
    count: usize,
    mut see: impl FnMut(&mut ChaCha8Rng) -> Y,
) -> Vec<Update<Y>> {
    let mut times: HashMap<i64, i64> = HashMap::new();
    let mut update = |_| {
        let vehicle = rng.random_range(0..60);
        let time = times.entry(vehicle).or_insert(rng.random_range(-5..5));
        *time += if rng.random_bool(0.1) { -1 } else { rng.random_range(0..4) };
        let (time, seen) = (*time, see(rng));
        let mut update = match vehicle {
            0..30 => Update::new(vehicle, time, seen),
            _ => Update::new(format!("vehicle {vehicle}"), time, seen),
        };
        update.restart = rng.random_bool(0.02);
        update
    };
    (0..count).map(&mut update).collect()
}

/// Runs a pool over updates in batches, and compares all answers and states. With `stops` it goes on
/// from a snapshot several times.
fn compare<A, B>(
    hmm: Hmm<A, B>,
    updates: &[Update<B::Observation>],
    options: &PoolOptions,
    stops: bool,
) where
    A: Transition<Control = ()> + Send + Sync,
    B: Likelihood<Observation: Sized + Sync> + Send + Sync,
{
    let mut rng = rng(updates.len() as u64);
    let folder = TempDir::new().unwrap();
    let hmm = Arc::new(hmm);
    let mut filters = Filters::new(&hmm);
    let mut pool = Pool::new(Arc::clone(&hmm), "model", options).unwrap();
    let mut refused = 0;
    let mut rest = updates;
    while !rest.is_empty() {
        let (batch, others) = rest.split_at(rng.random_range(1..=400).min(rest.len()));
        rest = others;
        let answers = match batch {
            [one] => vec![pool.update(one)],
            _ => pool.update_all(batch),
        };
        let found: Vec<Expected> = answers.iter().map(bits).collect();
        let expected: Vec<Expected> = batch.iter().map(|update| filters.take(update)).collect();
        assert_eq!(found, expected);
        refused += found.iter().filter(|found| found.is_err()).count();
        if stops {
            let file = folder.path().join("pool.bin");
            let length = pool.snapshot(&file).unwrap();
            assert_eq!(fs::metadata(&file).unwrap().len(), length);
            drop(pool); // the folder on the disk is for one at a time
            pool = Pool::restore(&file, Arc::clone(&hmm), "model", options).unwrap();
        }
        assert!(pool.take_spill_error().is_none());
    }
    assert!(refused > updates.len() / 20 && refused < updates.len() / 2, "{refused}");
    assert_eq!(pool.usage().vehicles, filters.vehicles.len());
    for (vehicle, (time, filter)) in &filters.vehicles {
        assert_eq!(pool.time(vehicle), Some(*time));
        assert_eq!(pool.state(vehicle).unwrap(), Some(filter.snapshot()));
    }
}

fn threads(threads: usize) -> PoolOptions {
    PoolOptions { threads, memory: None, spill: None }
}

/// Memory for one vehicle in each part of the pool.
fn tiny(folder: &Path) -> PoolOptions {
    PoolOptions { threads: 2, memory: Some(1), spill: Some(folder.join("spill")) }
}

/// Logarithms beyond the range of doubles, so that beliefs have to be kept as logarithms too; with
/// impossible states.
fn wide(rng: &mut ChaCha8Rng) -> Vec<f64> {
    let scale = [1.0, 30.0, 2000.0][rng.random_range(0..3)];
    let nearly_none = rng.random_bool(0.1);
    let never = if nearly_none { 0.95 } else { 0.1 };
    let value = |_| {
        if rng.random_bool(never) { f64::NEG_INFINITY } else { scale * rng.random_range(-1.0..0.0) }
    };
    (0..STATES).map(value).collect()
}

fn all_ways<A, B>(hmm: &Hmm<A, B>, updates: &[Update<B::Observation>])
where
    A: Transition<Control = ()> + Send + Sync + Clone,
    B: Likelihood<Observation: Sized + Sync> + Send + Sync + Clone,
{
    for count in 1..4 {
        compare(hmm.clone(), updates, &threads(count), false);
    }
    compare(hmm.clone(), updates, &threads(2), true);
    let folder = TempDir::new().unwrap();
    compare(hmm.clone(), updates, &tiny(folder.path()), false);
    compare(hmm.clone(), updates, &tiny(folder.path()), true);
}

#[test]
fn answers_are_those_of_filters_to_the_bit() {
    for seed in 0..3 {
        let mut rng = rng(seed);
        let symbols = updates(&mut rng, 5000, |rng| match rng.random_range(0..50) {
            0 => RARE as usize,
            1 => 6, // does not exist
            _ => rng.random_range(0..5),
        });
        all_ways(&model(seed), &symbols);
        all_ways(&model(seed).with_rounded_tails(), &symbols);
    }
}

#[test]
fn states_in_logarithms_too() {
    let mut rng = rng(7);
    let sensor = LikelihoodVector::log(STATES).owned();
    let hmm = Hmm::new(prior(), transition(&mut rng), sensor).unwrap();
    let seen = updates(&mut rng, 3000, wide);
    let mut filters = Filters::new(&hmm);
    seen.iter().for_each(|update| _ = filters.take(update));
    assert!(filters.vehicles.values().any(|vehicle| vehicle.1.steps_in_logs() > 0));
    all_ways(&hmm, &seen);
}

#[test]
fn memory_is_within_the_limit_and_counted() {
    let folder = TempDir::new().unwrap();
    let hmm = Arc::new(model(1));
    let memory = 1 << 20;
    let spill = folder.path().join("a").join("b");
    let options = PoolOptions { threads: 2, memory: Some(memory), spill: Some(spill.clone()) };
    let mut pool = Pool::new(Arc::clone(&hmm), "model", &options).unwrap();
    let mut free = Pool::new(Arc::clone(&hmm), "model", &threads(2)).unwrap();
    let batch: Vec<Update<usize>> = (0..8000).map(|id| Update::new(id, 0, 3)).collect();
    for pool in [&mut pool, &mut free] {
        assert!(pool.update_all(&batch).iter().all(Result::is_ok));
    }
    let (usage, all) = (pool.usage(), free.usage());
    assert!(usage.bytes <= memory && usage.bytes > memory / 2, "{usage:?}");
    assert_eq!((usage.vehicles, all.vehicles, all.in_memory), (8000, 8000, 8000));
    assert!(usage.in_memory > 500 && usage.in_memory < 5000, "{usage:?}");
    assert!(usage.file_bytes > 0 && all.file_bytes == 0);
    let each = all.bytes / 8000;
    assert!((8 * STATES + 100..8 * STATES + 250).contains(&each), "{each}");

    // The last that was seen in each part is in memory, and files do not grow without need.
    let again: Vec<Update<usize>> = (0..8000).map(|id| Update::new(id, 1, 2)).collect();
    assert!(pool.update_all(&again).iter().all(Result::is_ok));
    assert!(pool.usage().file_bytes <= usage.file_bytes * 11 / 10);

    // In use, and removed in the end.
    let refused = Pool::new(Arc::clone(&hmm), "model", &options).unwrap_err();
    assert!(matches!(&refused, FleetError::Settings(text) if text.contains("another pool")));
    drop(pool);
    let left: Vec<_> = fs::read_dir(&spill).unwrap().map(|file| file.unwrap().path()).collect();
    assert_eq!(left, [spill.join("pool.lock")]);
    let no_folder = PoolOptions { spill: None, ..options };
    assert!(matches!(Pool::new(hmm, "model", &no_folder), Err(FleetError::Settings(_))));
}

#[test]
fn those_not_seen_for_longest_go_to_the_disk() {
    let folder = TempDir::new().unwrap();
    let mut pool = Pool::new(Arc::new(model(1)), "model", &tiny(folder.path())).unwrap();
    for id in 0..500 {
        pool.update(&Update::new(id, 0, 3)).unwrap();
    }
    let usage = pool.usage();
    assert!(usage.in_memory <= 16, "{usage:?}");
    // Damage on the disk concerns those that are there.
    for file in fs::read_dir(folder.path().join("spill")).unwrap() {
        let path = file.unwrap().path();
        let length = fs::metadata(&path).unwrap().len() as usize;
        fs::write(&path, vec![0; length]).unwrap();
    }
    let last = pool.update(&Update::new(499, 1, 3));
    assert!(last.is_ok(), "the last one seen is in memory");
    let answers: Vec<UpdateResult> =
        (0..499).map(|id| pool.update(&Update::new(id, 1, 3))).collect();
    let kinds: Vec<_> = answers.iter().filter_map(|answer| bits(answer).err()).collect();
    assert!(kinds.len() >= 480 && kinds.iter().all(|kind| *kind == "disk"), "{kinds:?}");
    let lost = answers.iter().position(Result::is_err).unwrap() as i64;
    assert_eq!(pool.time(&lost.into()), Some(0));
    let file = folder.path().join("pool.bin");
    assert!(pool.snapshot(&file).is_err());
    assert!(!file.exists() && !folder.path().join("pool.bin.partial").exists());
    // It can be begun again, or given up.
    let again = Update { restart: true, ..Update::new(lost, 1, 3) };
    assert!(pool.update(&again).is_ok());
    assert!(pool.remove(&lost.into()) && !pool.remove(&lost.into()));
    assert_eq!((pool.time(&lost.into()), pool.usage().vehicles), (None, 499));
    assert!(pool.update(&Update::new(lost, 0, 3)).is_ok());
}

#[test]
fn a_removed_vehicle_begins_at_the_prior() {
    let hmm = Arc::new(model(4));
    let mut filters = Filters::new(&hmm);
    let mut pool = Pool::new(Arc::clone(&hmm), "model", &threads(1)).unwrap();
    let mut rng = rng(3);
    for step in 0..2000 {
        let vehicle = VehicleId::from(rng.random_range(0..40));
        if rng.random_bool(0.3) {
            assert_eq!(pool.remove(&vehicle), filters.vehicles.remove(&vehicle).is_some());
        } else {
            let update = Update::new(0, step, rng.random_range(0..5));
            let update = Update { vehicle, ..update };
            assert_eq!(bits(&pool.update(&update)), filters.take(&update));
        }
        assert_eq!(pool.usage().vehicles, filters.vehicles.len());
    }
}

/// A snapshot of some vehicles, and its bytes.
fn snapshot(folder: &Path) -> Vec<u8> {
    let mut pool = Pool::new(Arc::new(model(1)), "model", &threads(1)).unwrap();
    for id in 0..5 {
        pool.update(&Update::new(id, 0, 3)).unwrap();
        pool.update(&Update::new(format!("bus {id}"), 0, 3)).unwrap();
    }
    let file = folder.join("pool.bin");
    pool.snapshot(&file).unwrap();
    fs::read(file).unwrap()
}

fn restore(file: &Path, hash: &str) -> Result<usize, FleetError> {
    let pool = Pool::restore(file, Arc::new(model(1)), hash, &threads(1))?;
    Ok(pool.usage().vehicles)
}

#[test]
fn a_damaged_snapshot_is_refused() {
    let folder = TempDir::new().unwrap();
    let bytes = snapshot(folder.path());
    let file = folder.path().join("damaged.bin");
    fs::write(&file, &bytes).unwrap();
    assert_eq!(restore(&file, "model").unwrap(), 10);
    let refused = |bytes: &[u8]| {
        fs::write(&file, bytes).unwrap();
        match restore(&file, "model") {
            Err(FleetError::Format { path, message }) => {
                assert_eq!(path, file);
                message
            }
            other => panic!("{other:?}"),
        }
    };
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        refused(&damaged);
        assert!(refused(&bytes[..at]).contains("damaged"), "cut off after {at}");
    }
    assert!(refused(&[&bytes[..], b"x"].concat()).contains("after the end"));
    assert!(refused(b"another file, long enough for a header of a pool").contains("not a snap"));
    assert!(matches!(restore(Path::new("/nowhere"), "model"), Err(FleetError::File { .. })));
}

#[test]
fn a_snapshot_of_another_model_is_refused() {
    let folder = TempDir::new().unwrap();
    snapshot(folder.path());
    let file = folder.path().join("pool.bin");
    let error = restore(&file, "another").unwrap_err().to_string();
    assert!(error.contains("another model") && error.contains("hash model"), "{error}");
    let smaller = Arc::new(wayfix::canberra::hmm(5, 1.0).unwrap());
    let error = Pool::restore(&file, smaller, "model", &threads(1)).unwrap_err().to_string();
    assert!(error.contains("11 states") && error.contains("expected 105"), "{error}");
}

#[test]
fn a_snapshot_that_cannot_be_written_leaves_the_last_one() {
    let folder = TempDir::new().unwrap();
    let bytes = snapshot(folder.path());
    let pool = Pool::new(Arc::new(model(1)), "model", &threads(1)).unwrap();
    // Where the file is under construction, there is a folder.
    fs::create_dir(folder.path().join("pool.bin.partial")).unwrap();
    assert!(pool.snapshot(&folder.path().join("pool.bin")).is_err());
    assert_eq!(fs::read(folder.path().join("pool.bin")).unwrap(), bytes);
}

/// Runs `live` over lines, and returns the answers.
fn answers(job: &LiveJob, text: &str) -> (LiveSummary, Vec<Value>) {
    let mut output = Vec::new();
    let input = Cursor::new(text.to_owned().into_bytes());
    let summary = live(job, input, &mut output, |error| panic!("{error}")).unwrap();
    let output = String::from_utf8(output).unwrap();
    (summary, output.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

fn job(folder: &Folder) -> LiveJob {
    let (model, options) = (folder.path("model.json"), threads(2));
    LiveJob { model, restore: None, snapshot: None, options }
}

/// Runs `live` over lines that are all updates, and compares the answers.
fn compare_lines<B: Likelihood<Observation: Sized>>(
    hmm: &Hmm<wayfix::SparseTransition, B>,
    seen: &[Update<B::Observation>],
    field: impl Fn(&B::Observation) -> Value,
) where
    Hmm<wayfix::SparseTransition, B>: serde::Serialize,
{
    let folder = Folder::new(hmm);
    let text: Vec<String> = seen
        .iter()
        .map(|update| {
            let vehicle = serde_json::to_value(&update.vehicle).unwrap();
            let mut line = json!({
                "vehicle": vehicle,
                "time": update.time,
                "observation": field(&update.observation),
                "more": {"is": ["not", "read"]},
            });
            if update.restart {
                line["restart"] = json!(true);
            }
            if let Some(elsewhere) = line["observation"].get("elsewhere").cloned() {
                line["observation"] = line["observation"]["listed"].take();
                line["elsewhere"] = elsewhere;
            }
            line.to_string()
        })
        .collect();
    let mut filters = Filters::new(hmm);
    let (summary, found) = answers(&job(&folder), &text.join("\n"));
    assert_eq!((summary.lines, found.len()), (seen.len() as u64, seen.len()));
    let mut errors = 0;
    for (at, (update, found)) in seen.iter().zip(&found).enumerate() {
        assert_eq!(found["vehicle"], serde_json::to_value(&update.vehicle).unwrap());
        assert_eq!(found["time"], json!(update.time));
        match filters.take(update) {
            Ok((state, probability, log_likelihood)) => {
                assert_eq!(found["state"], json!(state));
                let number = |name: &str| found[name].as_f64().unwrap().to_bits();
                assert_eq!(number("probability"), probability);
                assert_eq!(number("log_likelihood"), log_likelihood);
            }
            Err(kind) => {
                errors += 1;
                assert_eq!(found["error_kind"], json!(kind));
                assert_eq!(found["line"], json!(at + 1));
                assert!(!found["error"].as_str().unwrap().is_empty());
            }
        }
    }
    assert_eq!((summary.errors, summary.vehicles), (errors, filters.vehicles.len()));
}

#[test]
fn a_restart_that_comes_twice_is_refused() {
    let folder = Folder::new(&model(1));
    let line = |time: i64, seen: usize, restart: bool| {
        json!({"vehicle": 7, "time": time, "observation": seen, "restart": restart}).to_string()
    };
    let (again, last) = (line(1, 4, true), line(3, 2, false));
    let begin = [line(0, 3, false), again.clone(), line(2, 3, false)];
    let once = [&begin[..], std::slice::from_ref(&last)].concat();
    let twice = [&begin[..], &[again, last]].concat();
    let (_, once) = answers(&job(&folder), &once.join("\n"));
    let (summary, twice) = answers(&job(&folder), &twice.join("\n"));
    assert_eq!((summary.errors, &twice[3]["error_kind"]), (1, &json!("time")));
    assert_eq!((&twice[..3], &twice[4]), (&once[..3], &once[3]));
}

#[test]
fn the_first_run_has_no_snapshot_to_restore() {
    let folder = Folder::new(&model(1));
    let snapshot = Some(folder.path("pool.bin"));
    let job = LiveJob { restore: snapshot.clone(), snapshot, ..job(&folder) };
    let line = |time: i64| json!({"vehicle": 7, "time": time, "observation": 3}).to_string();
    let (summary, _) = answers(&job, &line(0));
    assert_eq!((summary.errors, summary.vehicles), (0, 1));
    // The second goes on where it ended.
    let (summary, found) = answers(&job, &line(0));
    assert_eq!((summary.errors, &found[0]["error_kind"]), (1, &json!("time")));
    // A snapshot from elsewhere has to be there.
    let job = LiveJob { restore: Some(folder.path("other.bin")), ..job };
    assert!(live(&job, Cursor::new(Vec::new()), &mut Vec::new(), |_| ()).is_err());
}

#[test]
fn lines_of_every_sensor() {
    let mut rng = rng(11);
    let symbols = updates(&mut rng, 1000, |rng| rng.random_range(0..6));
    compare_lines(&model(2), &symbols, |symbol| json!(symbol));

    let camera = model(2).into_parts().2;
    let optional =
        Hmm::new(prior(), transition(&mut rng), OptionalLikelihood::new(camera)).unwrap();
    let some = updates(&mut rng, 500, |rng| rng.random_bool(0.7).then(|| rng.random_range(0..5)));
    compare_lines(&optional, &some, |symbol| json!(symbol));

    let linear = LikelihoodVector::linear(STATES).owned();
    let linear = Hmm::new(prior(), transition(&mut rng), linear).unwrap();
    let rows = updates(&mut rng, 300, |rng| -> Vec<f64> {
        let count = if rng.random_bool(0.05) { STATES - 1 } else { STATES };
        (0..count).map(|_| rng.random_range(0.0..1.0)).collect()
    });
    compare_lines(&linear, &rows, |row| json!(row));

    let log = LikelihoodVector::log(STATES).owned();
    let log = Hmm::new(prior(), transition(&mut rng), log).unwrap();
    let rows = updates(&mut rng, 300, wide);
    compare_lines(&log, &rows, |row| {
        row.iter().map(|log| if log.is_finite() { json!(log) } else { Value::Null }).collect()
    });

    let sparse = SparseLikelihood::new(STATES);
    let sparse = Hmm::new(prior(), transition(&mut rng), sparse).unwrap();
    let lists = updates(&mut rng, 300, |rng| {
        let elsewhere = if rng.random_bool(0.5) { 0.0 } else { 0.01 };
        let listed = (0..3).map(|k| (4 * k + rng.random_range(0..4), rng.random_range(0.1..1.0)));
        SparseObservation::new(listed.collect(), elsewhere).unwrap()
    });
    compare_lines(&sparse, &lists, |seen| {
        let pairs = seen.listed().iter();
        let listed: Vec<Value> =
            pairs.map(|(state, p)| json!({"state": state, "likelihood": p})).collect();
        json!({"listed": listed, "elsewhere": seen.elsewhere()})
    });

    let place = |k: usize| Position { latitude: -35.3 + 1e-3 * k as f64, longitude: 149.1 };
    let places = Places::new((0..STATES).map(place).collect(), 3.0).unwrap();
    let places = Hmm::new(prior(), transition(&mut rng), places).unwrap();
    let fixes = updates(&mut rng, 300, |rng| Fix {
        latitude: rng.random_range(-35.301..-35.289),
        longitude: 149.1,
        deviation: rng.random_range(-1.0..100.0),
    });
    compare_lines(&places, &fixes, |fix| {
        json!({
            "latitude": fix.latitude, "longitude": fix.longitude, "deviation": fix.deviation
        })
    });
}

#[test]
fn a_bad_line_is_answered_and_the_run_goes_on() {
    let folder = Folder::new(&model(3));
    let too_long =
        format!(r#"{{"vehicle": "{}", "time": 0, "observation": 0}}"#, "x".repeat(2 << 20));
    let lines = [
        r#"{"vehicle": 1, "time": 5, "observation": 2}"#,
        "",
        r#"{"vehicle": 1, "time": 6"#,
        r#"{"vehicle": 1, "time": 6, "observation": "north"}"#,
        r#"{"vehicle": 1, "time": 6.5, "observation": 2}"#,
        r#"{"vehicle": 1, "observation": 2}"#,
        r#"{"vehicle": [1], "time": 6, "observation": 2}"#,
        r#"{"vehicle": 18446744073709551615, "time": 6, "observation": 2}"#,
        r#"{"vehicle": 1, "time": 6}"#,
        r#"{"vehicle": 1, "time": 6, "observation": null}"#,
        r#"{"vehicle": 1, "time": 6, "observation": -1}"#,
        &too_long,
        "\u{0}",
        "[1, 6, 2",
        r#"{"vehicle": "1", "time": 6, "observation": 2}"#,
        "{\"vehicle\": 1, \"time\": 6, \"observation\": 2}\r",
        r#"{"vehicle": 1, "time": 6, "observation": 3}"#,
        r#"{"vehicle": 1, "time": 7, "observation": 600}"#,
        r#"{"vehicle": 1, "time": 7, "observation": 3}"#,
    ];
    let (summary, found) = answers(&job(&folder), &lines.join("\n"));
    assert_eq!((summary.lines, found.len()), (lines.len() as u64, lines.len()));
    assert_eq!((summary.errors, summary.vehicles), (15, 2));
    for (at, found) in found.iter().enumerate() {
        let kind = match at {
            0 | 14 | 15 | 18 => {
                assert!(found["state"].is_u64() && found.get("error").is_none(), "{found}");
                continue;
            }
            16 => "time",
            17 => "likelihood",
            _ => "line",
        };
        assert_eq!((&found["error_kind"], &found["line"]), (&json!(kind), &json!(at + 1)));
        let message = found["error"].as_str().unwrap();
        assert!(!message.contains("line 1"), "{message}");
    }
    assert_eq!((&found[3]["vehicle"], &found[3]["time"]), (&json!(1), &json!(6)));
    assert!(found[3]["error"].as_str().unwrap().contains("\"north\""), "{}", found[3]);
    assert!(found[8]["error"].as_str().unwrap().contains("`observation`"), "{}", found[8]);
    assert!(found[11]["error"].as_str().unwrap().contains("too long"), "{}", found[11]);
    // Vehicle 1 has taken the three steps that count.
    let mut filter = model(3);
    filter = filter.with_rounded_tails();
    let mut filter = filter.filter();
    let logs = [2, 2, 3].map(|symbol| filter.step(&symbol).unwrap());
    for (at, log) in [0, 15, 18].into_iter().zip(logs) {
        close(found[at]["log_likelihood"].as_f64().unwrap(), log);
    }
}

#[test]
fn the_command_goes_on_from_its_snapshot() {
    let hmm = model(5);
    let folder = Folder::new(&hmm);
    let mut rng = rng(9);
    let seen = updates(&mut rng, 3000, |rng| rng.random_range(0..6));
    let line = |update: &Update<usize>| {
        let Update { vehicle, time, observation, restart } = update;
        let vehicle = serde_json::to_value(vehicle).unwrap();
        let line = json!({
            "vehicle": vehicle, "time": time, "observation": observation, "restart": restart
        });
        format!("{line}\n")
    };
    let text: Vec<String> = seen.iter().map(line).collect();
    let (_, expected) = answers(&job(&folder), &text.concat());
    let snapshot = folder.path("pool.bin");
    let run = |arguments: &[&str], text: String| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.args(["live", "--threads", "2"]).args(arguments);
        command.arg("--model").arg(folder.path("model.json"));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        let writer = std::thread::spawn(move || input.write_all(text.as_bytes()));
        let output = child.wait_with_output().unwrap();
        _ = writer.join().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        (output.status.success(), lines, String::from_utf8(output.stderr).unwrap())
    };
    let name = snapshot.to_str().unwrap();
    let spill = folder.path("spill");
    let limit = ["--memory", "16K", "--spill", spill.to_str().unwrap()];
    let (mut found, mut before) = (Vec::new(), Vec::new());
    for (part, lines) in text.chunks(1000).enumerate() {
        let mut arguments = vec!["--snapshot", name];
        arguments.extend(if part > 0 { vec!["--restore", name] } else { vec![] });
        arguments.extend(if part == 1 { vec![] } else { limit.to_vec() });
        let (success, lines, summary) = run(&arguments, lines.concat());
        assert!(success, "{summary}");
        assert!(summary.starts_with("1000 lines, "), "{summary}");
        found.extend(lines);
        before = fs::read(&snapshot).unwrap();
    }
    assert_eq!(found.len(), expected.len());
    for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let mut expected = expected.clone();
        if let Some(line) = expected.get_mut("line") {
            *line = json!(at % 1000 + 1);
        }
        assert_eq!(*found, expected, "line {at}");
    }
    // Another model: nothing is read, and the snapshot stays.
    let hash = Model::load(&folder.path("model.json")).unwrap().hash().to_owned();
    fs::write(folder.path("model.json"), serde_json::to_vec(&model(6)).unwrap()).unwrap();
    let (success, lines, error) =
        run(&["--restore", name, "--snapshot", name], text[..10].concat());
    assert!(!success && lines.is_empty() && error.contains(&hash), "{error}");
    assert_eq!(fs::read(&snapshot).unwrap(), before);
    assert!(!run(&["--memory", "16K"], String::new()).0, "no folder");
}
