//! Snapshots are of one moment, and refused when they are damaged or of another model.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use rand::RngExt;
use tempfile::TempDir;
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{Pool, PoolOptions, Update};

use crate::filters::*;
use crate::kit::*;

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
    // A folder is in the place of the temporary file.
    fs::create_dir(folder.path().join("pool.bin.partial")).unwrap();
    assert!(pool.snapshot(&folder.path().join("pool.bin")).is_err());
    assert_eq!(fs::read(folder.path().join("pool.bin")).unwrap(), bytes);
}

#[test]
fn a_snapshot_is_of_one_moment_while_updates_go_on() {
    let folder = Folder::new(&model(1));
    let spill = folder.path("spill");
    for options in [
        PoolOptions { threads: 2, memory: None, spill: None },
        PoolOptions { threads: 2, memory: Some(100_000), spill: Some(spill) },
    ] {
        let hmm = std::sync::Arc::new(model(1));
        let mut pool = Pool::new(hmm.clone(), "model", &options).unwrap();
        let mut rng = rng(3);
        let mut batch = |time: i64, count: usize| -> Vec<Update<usize>> {
            (0..count)
                .map(|at| {
                    let vehicle = rng.random_range(0..3000);
                    Update::new(vehicle, time + at as i64, rng.random_range(0..5))
                })
                .collect()
        };
        let mut changed = 0;
        for round in 0..20 {
            let time = round * 100_000;
            pool.update_all(&batch(time, 5000));
            let (still, moving) = (folder.path("still.bin"), folder.path("moving.bin"));
            pool.snapshot(&still).unwrap();
            let writing = pool.begin_snapshot(&moving).unwrap();
            // One at a time; but the first may just have ended.
            let second = pool.begin_snapshot(&folder.path("second.bin"));
            if let Ok(second) = second {
                second.wait().unwrap();
            }
            let mut next = time + 10_000;
            while !writing.is_finished() {
                changed += 1;
                pool.update_all(&batch(next, 200));
                pool.remove(&(next % 3000).into());
                pool.update(&Update::new(format!("new {next}"), next, 2)).unwrap();
                next += 200;
            }
            writing.wait().unwrap();
            let unlimited = PoolOptions { threads: 2, memory: None, spill: None };
            let open = |path: &Path| Pool::restore(path, hmm.clone(), "model", &unlimited).unwrap();
            let (still, moving) = (open(&still), open(&moving));
            assert_eq!(still.usage().vehicles, moving.usage().vehicles);
            let mut found = 0;
            for vehicle in (0..3000_i64).map(Into::into) {
                assert_eq!(still.time(&vehicle), moving.time(&vehicle));
                assert_eq!(still.state(&vehicle).unwrap(), moving.state(&vehicle).unwrap());
                found += usize::from(still.time(&vehicle).is_some());
            }
            assert!(found > 1000);
        }
        assert!(changed > 20, "{changed} batches came meanwhile");
    }
}
