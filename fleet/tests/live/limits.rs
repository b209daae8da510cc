//! Vehicles beyond the memory limit.

use std::fs;
use std::io::Cursor;
use std::sync::Arc;

use tempfile::TempDir;
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{
    Control, Notice, Pool, PoolOptions, ServiceJob, Update, UpdateResult, serve,
};

use crate::filters::*;
use crate::kit::*;
use crate::service::*;

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

    // The last vehicle updated in each shard is in memory, and files do not grow needlessly.
    let again: Vec<Update<usize>> = (0..8000).map(|id| Update::new(id, 1, 2)).collect();
    assert!(pool.update_all(&again).iter().all(Result::is_ok));
    assert!(pool.usage().file_bytes <= usage.file_bytes * 11 / 10);

    // In use, and removed at the end.
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
    // Damage on disk affects only the vehicles there.
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
    // Such a vehicle can be restarted or removed.
    let again = Update { restart: true, ..Update::new(lost, 1, 3) };
    assert!(pool.update(&again).is_ok());
    assert!(pool.remove(&lost.into()) && !pool.remove(&lost.into()));
    assert_eq!((pool.time(&lost.into()), pool.usage().vehicles), (None, 499));
    assert!(pool.update(&Update::new(lost, 0, 3)).is_ok());
}

#[test]
fn ids_beyond_the_limit_are_said() {
    let folder = Folder::new(&model(1));
    let mut job = job(&folder);
    let text: String = (0..5000).map(|id| line(id, 0, 3)).collect();
    let said = |job: &ServiceJob| {
        let mut said = Vec::new();
        serve(job, &Control::new(), Cursor::new(text.clone()), Vec::new(), |notice| {
            if let Notice::Ids { bytes, limit } = notice {
                said.push((*bytes, *limit));
            }
        })
        .unwrap();
        said
    };
    job.live.options.spill = Some(folder.path("spill"));
    job.live.options.memory = Some(100_000);
    let found = said(&job);
    assert!(found.len() == 1 && found[0].0 > 300_000 && found[0].1 == 100_000, "{found:?}");
    // Another folder: commands of other tests may hold the lock of the first for a moment.
    job.live.options.spill = Some(folder.path("another"));
    job.live.options.memory = Some(1 << 20);
    assert_eq!(said(&job), []);
}
