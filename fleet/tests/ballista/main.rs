//! Tests of queries on a cluster of two executors, each a process, against the same queries in one
//! process.
#![cfg(unix)]

#[path = "../it/kit/mod.rs"]
#[allow(dead_code, reason = "shared with the tests of files")]
mod kit;
mod learn;
mod parts;
#[path = "../sql/tables.rs"]
#[allow(dead_code, reason = "shared with the tests of functions")]
mod tables;

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use arrow::array::RecordBatch;
use wayfix_fleet::sql::Query;

use kit::*;
use tables::*;

/// A running cluster.
struct Cluster {
    folder: PathBuf,
    ports: Vec<u16>,
    environment: Vec<(String, String)>,
}

impl Cluster {
    fn start(folder: &Folder) -> Self {
        Self::start_with(folder, &[])
    }

    /// Starts a cluster with other settings of the script.
    fn start_with(folder: &Folder, environment: &[(&str, &str)]) -> Self {
        // All bound at the same time, so that they differ.
        let free: Vec<_> = (0..5).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let ports = free.iter().map(|free| free.local_addr().unwrap().port()).collect();
        drop(free);
        let environment =
            environment.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect();
        let cluster = Self { folder: folder.path("cluster"), ports, environment };
        cluster.script(&["start"]);
        cluster
    }

    fn script(&self, arguments: &[&str]) {
        let ports = self.ports.iter().map(u16::to_string).collect::<Vec<_>>().join(" ");
        let done = Command::new(concat!(env!("CARGO_MANIFEST_DIR"), "/cluster"))
            .args(arguments)
            .arg(&self.folder)
            .env("PORTS", ports)
            .env("CORES", "1")
            .env("TIMEOUT", "8")
            .envs(self.environment.iter().map(|(name, value)| (name, value)))
            .env("BIN", Path::new(env!("CARGO_BIN_EXE_wayfix-fleet-executor")).parent().unwrap())
            .output()
            .unwrap();
        let messages = || {
            ["scheduler", "executor1", "executor2"]
                .map(|name| fs::read_to_string(self.folder.join(format!("{name}.log"))))
                .map(Result::unwrap_or_default)
        };
        let errors = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{errors}{:?}", messages());
    }

    fn scheduler(&self) -> String {
        format!("127.0.0.1:{}", self.ports[0])
    }

    fn pid(&self, process: &str) -> String {
        let pid = fs::read_to_string(self.folder.join(format!("{process}.pid"))).unwrap();
        pid.trim().to_owned()
    }

    /// Kills a process without notice.
    fn kill(&self, process: &str) {
        assert!(Command::new("kill").args(["-9", &self.pid(process)]).status().unwrap().success());
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.script(&["stop"]);
    }
}

fn on_cluster(cluster: &Cluster, query: &Query) -> Query {
    Query {
        scheduler: Some(cluster.scheduler()),
        threads: 6,
        output: query.output.with_file_name("cluster.parquet"),
        ..query.clone()
    }
}

#[test]
fn answers_are_those_of_one_process() {
    let model = model(8);
    let folder = Folder::new(&model);
    let some = drives(41, 1000, 1, 30);
    folder.write("nested.parquet", &nested(&some), 50);
    folder.write("long.parquet", &long(&some), 1000);
    let cluster = Cluster::start(&folder);
    let name = model_of(&folder);
    let gathered = "SELECT trace_id, array_agg(observation ORDER BY step) AS seen FROM drives \
                    GROUP BY trace_id";
    for (input, key, sql) in [
        (
            "nested.parquet",
            &["trace_id"][..],
            format!(
                "SELECT trace_id, wayfix_score({name}, observation) AS score, \
                 wayfix_smooth({name}, observation) AS smooth, \
                 wayfix_filter({name}, observation) AS filter, \
                 wayfix_decode({name}, observation) AS decode FROM drives"
            ),
        ),
        (
            "nested.parquet",
            &[],
            format!(
                "SELECT trace_id, wayfix_smooth({name}, observation) AS smooth FROM drives \
                 ORDER BY trace_id DESC"
            ),
        ),
        (
            "nested.parquet",
            &[],
            format!(
                "SELECT cardinality(observation) AS steps, count(*) AS drives, \
                 count(wayfix_decode({name}, observation)) AS valid FROM drives \
                 GROUP BY cardinality(observation) ORDER BY steps"
            ),
        ),
        (
            "long.parquet",
            &["trace_id", "step"],
            format!(
                "SELECT trace_id, wayfix_decode({name}, seen) AS path FROM ({gathered}) \
                 ORDER BY trace_id"
            ),
        ),
    ] {
        let query = over(&folder, input, key, &sql);
        let expected = rows(&query);
        assert!(expected.num_rows() >= 30);
        // By parts where possible, and as a whole.
        for part in [query.part, 0] {
            let remote = Query { part, ..on_cluster(&cluster, &query) };
            same_rows(&rows(&remote), &expected);
        }
    }
    // An error is passed on, and leaves no output.
    let sql = format!("SELECT wayfix_smooth({name}, [0, 17]) AS s FROM drives WHERE trace_id > ''");
    let query = on_cluster(&cluster, &over(&folder, "nested.parquet", &[], &sql));
    fs::remove_file(&query.output).unwrap();
    let message = error(&query).to_string();
    assert!(message.contains("symbol 17 does not exist"), "{message}");
}

/// Files of rows that an executor has.
fn files(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    entries
        .flatten()
        .map(|entry| if entry.path().is_dir() { files(&entry.path()) } else { 1 })
        .sum()
}

/// Kills an executor at a given moment, and restarts it; returns the rows.
fn killed(cluster: &Cluster, query: &Query, is_now: impl Fn() -> bool) -> RecordBatch {
    thread::scope(|scope| {
        let found = scope.spawn(|| rows(query));
        let start = Instant::now();
        while !is_now() {
            assert!(start.elapsed() < Duration::from_mins(2));
            thread::sleep(Duration::from_millis(2));
        }
        cluster.kill("executor1");
        assert!(!found.is_finished());
        thread::sleep(Duration::from_millis(500));
        cluster.script(&["executor", "1"]);
        found.join().unwrap()
    })
}

#[test]
fn an_executor_may_be_killed() {
    let model = model(9);
    let folder = Folder::new(&model);
    let some = drives(42, 1000, 40, 60);
    let many: Drives = some.iter().cycle().take(40_000).cloned().collect();
    folder.write("nested.parquet", &nested(&many), 500);
    let name = model_of(&folder);
    let sql = format!("SELECT trace_id, wayfix_smooth({name}, observation) AS smooth FROM drives");
    let query = over(&folder, "nested.parquet", &["trace_id"], &sql);
    let expected = rows(&query);
    for (part, ending) in [(0, "parquet.unfinished"), (query.part, "parquet.partial")] {
        let cluster = Cluster::start(&folder);
        let mut remote = on_cluster(&cluster, &query);
        (remote.threads, remote.part) = (24, part);
        // After it has done some of its tasks.
        let done = || files(&cluster.folder.join("executor1")) >= 3;
        same_rows(&killed(&cluster, &remote, done), &expected);
        // After the tasks are done, when the client has only some of the rows: it submits the query
        // again.
        fs::remove_file(&remote.output).unwrap();
        let unfinished = remote.output.with_extension(ending);
        let begun = || fs::metadata(&unfinished).is_ok_and(|file| file.len() > 1 << 20);
        same_rows(&killed(&cluster, &remote, begun), &expected);
    }
}
