//! Queries by parts of a sorted table: each is a task of its own.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use wayfix_fleet::sql::{Query, query};

use crate::kit::*;
use crate::tables::*;
use crate::{Cluster, on_cluster};

/// Scores of drives gathered from a long table.
fn gathering(folder: &Folder, input: &str, results: &str) -> Query {
    let sql = format!(
        "SELECT trace_id, {results}({}, array_agg(observation ORDER BY step)) AS results \
         FROM drives GROUP BY trace_id",
        model_of(folder)
    );
    over(folder, input, &["trace_id", "step"], &sql)
}

/// Stage numbers of all jobs for which an executor has files.
fn stages(cluster: &Cluster) -> Vec<usize> {
    let mut counts = Vec::new();
    for executor in ["executor1", "executor2"] {
        let jobs = fs::read_dir(cluster.folder.join(executor)).unwrap();
        let jobs = jobs.map(|job| job.unwrap().path());
        let jobs = jobs.filter(|job| !job.to_str().unwrap().contains("/datafusion-"));
        counts.extend(jobs.map(|job| fs::read_dir(job).unwrap().count()));
    }
    counts
}

#[test]
fn drives_are_gathered_without_an_exchange() {
    let folder = Folder::new(&model(8));
    let some = drives(43, 900, 1, 40);
    let rows_of = long(&some);
    folder.write("long.parquet", &rows_of, 700);
    // Files that end within drives.
    fs::create_dir(folder.path("days")).unwrap();
    for day in 0..3 {
        let from = day * 6000;
        let count = if day == 2 { rows_of.num_rows() - from } else { 6000 };
        folder.write(&format!("days/{day}.parquet"), &rows_of.slice(from, count), 700);
    }
    for input in ["long.parquet", "days"] {
        let of = gathering(&folder, input, "wayfix_smooth");
        let expected = rows(&Query { part: 0, ..of.clone() });
        assert_eq!(expected.num_rows(), 900);
        let cluster = Cluster::start(&folder);
        let remote = on_cluster(&cluster, &of);
        let done = query(&remote, |_| {}).unwrap();
        assert!(done.parts > 8, "{done:?}");
        same_rows(&read(&remote.output), &expected);
        let stages = stages(&cluster);
        assert_eq!(stages.iter().sum::<usize>(), done.parts, "{stages:?}");
        assert!(stages.iter().all(|&count| count <= 1), "{stages:?}");
        if input == "long.parquet" {
            let whole = Query { part: 0, sql: format!("{} ORDER BY 1", of.sql), ..remote };
            same_rows(&rows(&whole), &expected);
            assert!(self::stages(&cluster).iter().any(|&count| count > 1));
        }
        drop(cluster);
        fs::remove_dir_all(folder.path("cluster")).unwrap();
    }
}

/// Peak memory of the executors so far, in bytes.
#[cfg(target_os = "linux")]
fn peak(cluster: &Cluster) -> u64 {
    let of = |executor: &str| {
        let status = fs::read_to_string(format!("/proc/{}/status", cluster.pid(executor))).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
        line.trim().strip_suffix(" kB").unwrap().parse::<u64>().unwrap() * 1024
    };
    of("executor1").max(of("executor2"))
}

#[cfg(target_os = "linux")]
#[test]
fn memory_of_executors_is_flat() {
    let folder = Folder::new(&model(2));
    let some = drives(22, 24_000, 40, 60);
    folder.write("few.parquet", &long(&some[..6000]), 100_000);
    folder.write("many.parquet", &long(&some), 100_000);
    let cluster = Cluster::start(&folder);
    let mut peaks = Vec::new();
    for input in ["few.parquet", "many.parquet"] {
        let mut of = on_cluster(&cluster, &gathering(&folder, input, "wayfix_score"));
        (of.part, of.batch) = (100_000, 1024);
        rows(&of);
        peaks.push(peak(&cluster));
    }
    // Scalars of the additional steps would take 100 MB.
    assert!(peaks[1] < peaks[0] + (30 << 20), "{peaks:?}");
}

#[test]
fn models_are_those_of_a_folder() {
    let folder = Folder::new(&model(1));
    folder.write("drives.parquet", &nested(&drives(3, 200, 1, 9)), 50);
    fs::create_dir(folder.path("models")).unwrap();
    fs::copy(folder.path("model.json"), folder.path("models/a.json")).unwrap();
    let hash = wayfix_fleet::model::Model::load(&folder.path("model.json")).unwrap();
    let hash = hash.hash();
    let models = folder.path("models").to_str().unwrap().to_owned();
    let cluster = Cluster::start_with(&folder, &[("MODELS", &models)]);
    let outside = folder.path("model.json").to_str().unwrap().to_owned();
    let of = |name: &str| {
        let sql = format!("SELECT wayfix_score('{name}', observation) AS s FROM drives");
        on_cluster(&cluster, &over(&folder, "drives.parquet", &["trace_id"], &sql))
    };
    let expected = rows(&Query { scheduler: None, ..of(&outside) });
    // For parts, the client can only be sure that a model stays the same by its hash.
    for (name, has_parts) in [("a.json".to_owned(), false), (format!("a.json#{hash}"), true)] {
        let done = query(&of(&name), |_| {}).unwrap();
        assert_eq!((done.rows, done.parts > 0), (200, has_parts), "{name}");
        same_rows(&read(&of(&name).output), &expected);
    }
    fs::remove_file(of("").output).unwrap();
    for name in [outside.as_str(), "../model.json", "/etc/passwd", "/etc/none", "none.json"] {
        let message = error(&of(name)).to_string();
        let expected = "is not one of the models, expected the name of a file in their folder";
        assert!(message.contains(name) && message.contains(expected), "{message}");
    }
    let message = error(&Query { models: Some(models.into()), ..of("a.json") }).to_string();
    assert!(
        message.contains("--models is an option of the executors and the scheduler"),
        "{message}"
    );
}

fn command(folder: &Folder, of: &Query) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["sql", "--threads", "6", "--order", "trace_id,step", "--batch", "16"]);
    command.args(["--part", "1000", "--query", &of.sql]);
    command.arg("--table").arg(format!("drives={}", folder.path("long.parquet").display()));
    command.arg("--scheduler").arg(of.scheduler.as_ref().unwrap());
    command.arg("--output").arg(&of.output).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Starts a query in a process, and waits until it has some parts.
fn begin(folder: &Folder, of: &Query) -> Child {
    let size = || {
        let partial = of.output.with_extension("parquet.partial");
        fs::metadata(partial).map_or(0, |file| file.len())
    };
    let before = size();
    let mut child = command(folder, of).spawn().unwrap();
    while size() < before + 100_000 {
        assert!(child.try_wait().unwrap().is_none());
        thread::sleep(Duration::from_millis(2));
    }
    child
}

/// Of two processes with the same output, one is refused. A killed one continues, and one whose
/// scheduler is killed continues with another.
#[test]
fn an_output_is_of_one_process() {
    let folder = Folder::new(&model(8));
    folder.write("long.parquet", &long(&drives(44, 6000, 1, 40)), 700);
    let of = gathering(&folder, "long.parquet", "wayfix_smooth");
    let expected = rows(&of);
    let cluster = Cluster::start(&folder);
    let of = on_cluster(&cluster, &of);
    let mut first = begin(&folder, &of);
    let second = command(&folder, &of).output().unwrap();
    let told = String::from_utf8(second.stderr).unwrap();
    assert!(!second.status.success() && told.contains("another run holds the lock on"), "{told}");
    first.kill().unwrap();
    assert!(!first.wait().unwrap().success());
    assert!(folder.has_leftovers() && !of.output.exists());

    let third = begin(&folder, &of);
    cluster.kill("scheduler");
    let third = third.wait_with_output().unwrap();
    assert!(!third.status.success() && !third.stderr.is_empty());
    assert!(folder.has_leftovers() && !of.output.exists());

    cluster.script(&["stop"]);
    cluster.script(&["start"]);
    let last = command(&folder, &of).output().unwrap();
    let told = String::from_utf8(last.stdout).unwrap();
    assert!(told.starts_with("6000 rows; ") && told.contains("were there already"), "{told}");
    same_rows(&read(&of.output), &expected);
    assert!(!folder.has_leftovers());
}
