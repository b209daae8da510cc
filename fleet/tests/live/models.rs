//! Replacing models, and metrics.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::net::TcpStream;

use serde_json::json;
use wayfix_fleet::pool::{Control, Notice, ServiceJob, serve};

use crate::kit::*;
use crate::service::*;

#[test]
fn the_model_is_exchanged_while_it_runs() {
    let (old, new) = (model(2), model(3));
    let folder = Folder::new(&old);
    let models = folder.path("models");
    fs::create_dir(&models).unwrap();
    fs::write(models.join("new.json"), serde_json::to_vec(&new).unwrap()).unwrap();
    let other = wayfix::canberra::hmm(5, 1.0).unwrap();
    fs::write(models.join("other.json"), serde_json::to_vec(&other).unwrap()).unwrap();
    let name = |name: &str| format!("{}\n", json!({ "model": name }));
    let text = [
        line(1, 0, 3),
        line(1, 1, 2),
        name("new.json"),
        line(1, 2, 4),
        name("../model.json"),
        name("none.json"),
        name("other.json"),
        line(1, 3, 80), // of the other sensor
    ];
    let snapshot = folder.path("pool.bin");
    let mut job = ServiceJob { models: Some(models), replay: true, ..job(&folder) };
    job.live.restore = Some(snapshot.clone());
    job.live.snapshot = Some(snapshot);
    let (_, found) = answers(&job, &text.concat());
    assert_eq!(
        (&found[2]["vehicles_kept"], &found[2]["vehicles_begun_anew"]),
        (&json!(1), &json!(0))
    );
    assert_eq!(
        (&found[6]["vehicles_kept"], &found[6]["vehicles_begun_anew"]),
        (&json!(0), &json!(1))
    );
    assert!(found[4]["error"].as_str().unwrap().contains("not the name"), "{}", found[4]);
    assert!(found[5]["error"].as_str().unwrap().contains("none.json"), "{}", found[5]);
    let mut before = old.filter();
    before.step(&3).unwrap();
    before.step(&2).unwrap();
    let mut after = new.filter();
    after.restore(&before.snapshot()).unwrap();
    close(found[3]["log_likelihood"].as_f64().unwrap(), after.step(&4).unwrap());
    let mut anew = other.filter();
    close(found[7]["log_likelihood"].as_f64().unwrap(), anew.step(&80).unwrap());
    // The next run continues with it.
    let (summary, found) = answers(&job, &[&text.concat(), &line(1, 4, 81)[..]].concat());
    assert_eq!(summary.lines, 1);
    close(found[0]["log_likelihood"].as_f64().unwrap(), anew.step(&81).unwrap());
}

#[test]
fn figures_are_answered() {
    let folder = Folder::new(&model(1));
    let job = ServiceJob { metrics: Some("127.0.0.1:0".to_owned()), ..job(&folder) };
    let mut seen = None;
    let text = format!("{}{}none\n", line(1, 5, 2), line(1, 5, 2));
    serve(&job, &Control::new(), Cursor::new(text), Vec::new(), |notice| {
        if let Notice::Metrics(address) = notice {
            seen = Some(*address);
        }
    })
    .unwrap();
    // The metrics of a run outlive it.
    let get = |path: &str| {
        let mut stream = TcpStream::connect(seen.unwrap()).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    };
    let text = get("/metrics");
    for line in [
        "HTTP/1.1 200 OK",
        "wayfix_fleet_lines_total 3",
        "wayfix_fleet_accepted_total 1",
        "wayfix_fleet_refused_total{kind=\"time\"} 1",
        "wayfix_fleet_refused_total{kind=\"line\"} 1",
        "wayfix_fleet_vehicles 1",
        "wayfix_fleet_latest_time 5",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}: {text}");
    }
    assert!(get("/health").ends_with("\r\n\r\nok\n"));
    assert!(get("/other").starts_with("HTTP/1.1 404"));
}
