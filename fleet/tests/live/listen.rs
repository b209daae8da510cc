//! Lines from connections.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::os::unix::net::UnixStream;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use rand::RngExt;
use serde_json::{Value, json};
use wayfix_fleet::pool::{Control, ServiceJob, position, serve};

use crate::clients::*;
use crate::kit::*;
use crate::service::*;

/// Lines of vehicles of one client, with offsets; independent of other clients.
fn lines_of(client: i64, count: i64) -> Vec<String> {
    let mut rng = rng(client as u64);
    let line = |at| {
        let (vehicle, seen) = (100 * client + rng.random_range(0..40), rng.random_range(0..5));
        let line = json!({"vehicle": vehicle, "time": at, "observation": seen, "offset": at});
        format!("{line}\n")
    };
    (0..count).map(line).collect()
}

#[test]
fn answers_come_back_to_those_who_asked() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    for address in ["127.0.0.1:0".to_owned(), at(&socket)] {
        let run = Running::begin(ServiceJob { listen: Some(address), ..job(&folder) });
        let clients = (0..6).map(|client| {
            let text = lines_of(client, 4000).concat();
            let expected = answers(&job(&folder), &text).1;
            let address = run.address.clone();
            thread::spawn(move || {
                let mut found = String::new();
                // When a connection has sent its last line, its answers go on.
                if let Some(path) = address.strip_prefix("unix:") {
                    let stream = UnixStream::connect(path).unwrap();
                    (&stream).write_all(text.as_bytes()).unwrap();
                    stream.shutdown(Shutdown::Write).unwrap();
                    (&stream).read_to_string(&mut found).unwrap();
                } else {
                    let stream = TcpStream::connect(&address).unwrap();
                    (&stream).write_all(text.as_bytes()).unwrap();
                    stream.shutdown(Shutdown::Write).unwrap();
                    (&stream).read_to_string(&mut found).unwrap();
                }
                let found: Vec<Value> =
                    found.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
                assert_eq!(found, expected);
            })
        });
        let clients: Vec<_> = clients.collect();
        clients.into_iter().for_each(|client| client.join().unwrap());
        assert_eq!(run.end().lines, 24_000);
    }
    assert!(!socket.exists());
}

#[test]
fn one_run_listens_and_one_connection_has_a_name() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let listening = ServiceJob { listen: Some(at(&socket)), ..job(&folder) };
    let run = Running::begin(listening.clone());
    let second = serve(&listening, &Control::new(), io::empty(), Vec::new(), |_| ());
    assert!(second.unwrap_err().to_string().contains("another run is listening"));

    let (mut first, lines) = (Client::new(&socket).unwrap(), lines_of(1, 10));
    assert_eq!(first.name("gate").unwrap(), None);
    first.send(&lines[..4].concat()).unwrap();
    (0..4).for_each(|at| assert_eq!(first.answer().unwrap()["offset"], json!(at)));
    let mut other = Client::new(&socket).unwrap();
    assert_eq!(other.name("other").unwrap(), None);
    let mut again = Client::new(&socket).unwrap();
    assert_eq!(again.name("gate").unwrap(), Some(3));
    // The first is cut off: the two could not be told apart.
    assert!(first.answer().is_err());
    again.send(&lines[4..].concat()).unwrap();
    (4..10).for_each(|at| assert_eq!(again.answer().unwrap()["offset"], json!(at)));
    other.send(&line(7, 1, 3)).unwrap();
    assert_eq!(other.answer().unwrap()["vehicle"], json!(7));
    assert_eq!(run.end().errors, 0);

    let (_, refused) = answers(&job(&folder), "{\"client\": \"gate\"}\n");
    assert_eq!(refused[0]["error_kind"], json!("line"));
    // Not a socket, so it is left alone.
    fs::write(&socket, "of others").unwrap();
    assert!(serve(&listening, &Control::new(), io::empty(), Vec::new(), |_| ()).is_err());
    assert_eq!(fs::read(&socket).unwrap(), b"of others");
}

#[test]
fn lines_that_wait_are_answered_where_they_came_from() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let listen = Some(at(&socket));
    let run = Running::begin(ServiceJob { listen, lateness: Some(10), ..job(&folder) });
    let (mut a, mut b) = (Client::new(&socket).unwrap(), Client::new(&socket).unwrap());
    a.send(&line(1, 5, 2)).unwrap();
    // Answered at once, so the lines before it have been taken.
    a.send("no line\n").unwrap();
    assert_eq!(a.answer().unwrap()["error_kind"], json!("line"));
    b.send(&(line(2, 3, 2) + &line(2, 30, 2))).unwrap();
    let first = b.answer().unwrap();
    assert_eq!((&first["vehicle"], &first["time"]), (&json!(2), &json!(3)));
    assert_eq!(a.answer().unwrap()["vehicle"], json!(1));
    run.end();
}

#[test]
fn a_run_is_stopped_while_lines_come_without_end() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let run = Running::begin(ServiceJob { listen: Some(at(&socket)), ..job(&folder) });
    let (tell, answered) = channel();
    let floods = (0..3).map(|_| {
        let stream = UnixStream::connect(&socket).unwrap();
        let (mut reader, tell) = (stream.try_clone().unwrap(), tell.clone());
        thread::spawn(move || {
            reader.read_exact(&mut [0]).unwrap();
            _ = tell.send(());
            io::copy(&mut reader, &mut io::sink())
        });
        thread::spawn(move || while (&stream).write_all(&b"no line\n".repeat(1000)).is_ok() {})
    });
    let floods: Vec<_> = floods.collect();
    answered.recv().unwrap();
    let mut client = Client::new(&socket).unwrap();
    client.send(&line(1, 1, 2)).unwrap();
    client.answer().unwrap();
    assert!(run.end().lines > 1);
    floods.into_iter().for_each(|flood| flood.join().unwrap());
}

/// Peak memory of a process, in bytes.
#[cfg(target_os = "linux")]
fn most_memory(child: &Child) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().strip_suffix(" kB").unwrap().parse::<u64>().unwrap() << 10
}

#[test]
fn a_client_that_names_itself_again_and_again_costs_others_nothing() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let mut of_run = job(&folder);
    of_run.listen = Some(at(&socket));
    let running = Running::begin(of_run);
    let mut many = Client::new(&socket).unwrap();
    many.send(&"{\"client\":\"a\"}\n".repeat(16_000)).unwrap();
    let mut other = Client::new(&socket).unwrap();
    // Earlier, all lines after each such line were parsed again with it, which took minutes.
    other.0.get_ref().set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    other.send(&lines_of(1, 1)[0]).unwrap();
    assert_eq!(other.answer().unwrap()["offset"], 0);
    drop(many);
    running.end();
}

/// A client learns which of its lines a snapshot includes: it keeps the others.
#[test]
fn a_client_knows_which_of_its_lines_are_saved() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let mut of_run = job(&folder);
    of_run.listen = Some(at(&socket));
    of_run.live.snapshot = Some(folder.path("snapshot"));
    let running = Running::begin(of_run);
    let mut client = Client::new(&socket).unwrap();
    assert_eq!(client.name("a").unwrap(), None);
    let text = lines_of(1, 20);
    client.send(&text[..10].concat()).unwrap();
    (0..10).for_each(|_| _ = client.answer().unwrap());
    let saved = |client: &mut Client| {
        client.send("{\"client\":\"a\"}\n").unwrap();
        let answer = client.answer().unwrap();
        (answer["offset"].as_i64(), answer["saved"].as_i64())
    };
    assert_eq!(saved(&mut client), (Some(9), None));
    running.control.snapshot();
    let start = Instant::now();
    while saved(&mut client).1.is_none() {
        assert!(start.elapsed() < Duration::from_mins(1));
        thread::sleep(Duration::from_millis(5));
    }
    client.send(&text[10..].concat()).unwrap();
    (0..10).for_each(|_| _ = client.answer().unwrap());
    assert_eq!(saved(&mut client), (Some(19), Some(9)));
    drop(client);
    running.end();
}

#[cfg(target_os = "linux")]
#[test]
fn clients_that_never_read_or_end_a_line_cost_others_nothing() {
    let folder = Folder::new(&model(1));
    let socket = folder.path("socket");
    let mut child = command(&folder, &["--listen", &at(&socket)]).spawn().unwrap();
    while UnixStream::connect(&socket).is_err() {
        thread::sleep(Duration::from_millis(1));
    }
    let text = lines_of(1, 2000);
    let ask = |from: usize| {
        let mut client = Client::new(&socket).unwrap();
        client.send(&text[from..from + 500].concat()).unwrap();
        (0..500).for_each(|at| assert_eq!(client.answer().unwrap()["offset"], json!(from + at)));
    };
    ask(0);
    let before = most_memory(&child);
    // Answers are longer than lines. If a write takes long, the other end has stopped reading.
    let deaf = UnixStream::connect(&socket).unwrap();
    deaf.set_write_timeout(Some(Duration::from_millis(500))).unwrap();
    let lines = b"no\n".repeat(10_000);
    let mut sent = 0;
    while let Ok(count) = (&deaf).write(&lines) {
        sent += count;
        assert!(sent < 50_000_000, "lines are taken whose answers nobody reads");
    }
    ask(500);
    // Half a line of a client that goes away is not taken.
    let mut half = UnixStream::connect(&socket).unwrap();
    half.write_all(&text[1000].as_bytes()[..30]).unwrap();
    drop(half);
    let endless = UnixStream::connect(&socket).unwrap();
    let part = vec![b'x'; 1 << 20];
    (0..300).for_each(|_| (&endless).write_all(&part).unwrap());
    ask(1000);
    drop(deaf);
    ask(1500);
    let more = most_memory(&child) - before;
    assert!(more < 60_000_000, "{more} bytes more");
    // A line without an end is answered when the end arrives.
    let mut endless = Client(BufReader::new(endless));
    endless.send("\n").unwrap();
    assert!(endless.answer().unwrap()["error"].as_str().unwrap().contains("too long"));
    signal(&child, "TERM");
    assert!(child.wait().unwrap().success());
    assert!(!socket.exists());
}

#[test]
fn clients_go_on_by_their_offsets_when_the_run_is_killed() {
    const CLIENTS: i64 = 3;
    const LINES: i64 = 6000;
    let folder = Folder::new(&model(1));
    let (socket, snapshot) = (folder.path("socket"), folder.path("pool.bin"));
    let output = folder.path("positions");
    let file = snapshot.to_str().unwrap();
    let address = at(&socket);
    let arguments = ["--listen", &address, "--restore", file, "--snapshot", file, "--every", ".01"];
    let arguments = [&arguments[..], &["--output", output.to_str().unwrap()]].concat();
    let begin = || command(&folder, &arguments).stderr(Stdio::null()).spawn().unwrap();
    let is_over = AtomicBool::new(false);
    let talk = |client: i64, lines: &[String], found: &mut BTreeMap<i64, Value>| {
        let mut connection = Client::new(&socket)?;
        let last = connection.name(&format!("client {client}"))?.unwrap_or(-1);
        // Lines already answered may have to be sent again, but none is left out.
        assert!(last < LINES && found.len() as i64 <= LINES);
        for part in lines[(last + 1) as usize..].chunks(50) {
            connection.send(&part.concat())?;
            for _ in part {
                let answer = connection.answer()?;
                let offset = answer["offset"].as_i64().unwrap();
                let before = found.insert(offset, answer.clone());
                assert!(before.is_none_or(|before| before == answer));
            }
        }
        io::Result::Ok(())
    };
    let all: Vec<Vec<String>> = (0..CLIENTS).map(|client| lines_of(client, LINES)).collect();
    let mut child = begin();
    let mut after_some = 0;
    thread::scope(|scope| {
        for (client, lines) in (0..).zip(&all) {
            let (talk, is_over) = (&talk, &is_over);
            scope.spawn(move || {
                let mut found = BTreeMap::new();
                // A killed run may ask again for lines that were answered.
                loop {
                    let is_last = is_over.load(Ordering::SeqCst);
                    if talk(client, lines, &mut found).is_ok() && is_last {
                        break;
                    }
                    thread::sleep(Duration::from_millis(2));
                }
                assert_eq!(found.len() as i64, LINES);
            });
        }
        let mut rng = rng(5);
        for _ in 0..10 {
            thread::sleep(Duration::from_millis(rng.random_range(20..120)));
            child.kill().unwrap();
            child.wait().unwrap();
            after_some +=
                usize::from(position(&snapshot).is_ok_and(|at| !at.unwrap().clients.is_empty()));
            child = begin();
        }
        is_over.store(true, Ordering::SeqCst);
    });
    assert!(after_some > 2, "{after_some} of the kills came after a snapshot");
    signal(&child, "TERM");
    assert!(child.wait().unwrap().success());
    // Each line of each client has one answer in the file, in the order of the client's lines.
    let mut found: Vec<Vec<Value>> = vec![Vec::new(); CLIENTS as usize];
    for line in fs::read_to_string(&output).unwrap().lines() {
        let answer: Value = serde_json::from_str(line).unwrap();
        if let Some(vehicle) = answer["vehicle"].as_i64() {
            found[(vehicle / 100) as usize].push(answer);
        }
    }
    for (lines, found) in all.iter().zip(&found) {
        let expected = answers(&job(&folder), &lines.concat()).1;
        let other = found.iter().zip(&expected).position(|(found, expected)| found != expected);
        if let Some(at) = other {
            panic!("answer {at} is {}, expected {}", found[at], expected[at]);
        }
        assert_eq!(found.len(), expected.len());
    }
    let at = position(&snapshot).unwrap().unwrap();
    assert!(at.clients.len() == CLIENTS as usize);
    assert!(at.clients.values().all(|offset| *offset == (LINES - 1).into()));
}
