//! Runs that accept connections, and clients.

use std::io::{self, BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::mpsc::channel;
use std::thread::{self, JoinHandle};

use serde_json::{Value, json};
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{Control, LiveSummary, Notice, ServiceJob, serve};

/// A run that accepts connections, on a thread.
pub(crate) struct Running {
    pub(crate) control: Control,
    pub(crate) address: String,
    pub(crate) thread: JoinHandle<Result<LiveSummary, FleetError>>,
}

impl Running {
    pub(crate) fn begin(job: ServiceJob) -> Self {
        let control = Control::new();
        let (of_run, (say, said)) = (control.clone(), channel());
        let thread = thread::spawn(move || {
            serve(&job, &of_run, io::empty(), Vec::new(), |notice| {
                if let Notice::Listen(address) = notice {
                    say.send(address.clone()).unwrap();
                }
            })
        });
        let address = said.recv().unwrap();
        Self { control, address, thread }
    }

    pub(crate) fn end(self) -> LiveSummary {
        self.control.stop();
        self.thread.join().unwrap().unwrap()
    }
}

pub(crate) fn at(path: &Path) -> String {
    format!("unix:{}", path.display())
}

/// A connection of a client.
pub(crate) struct Client(pub(crate) BufReader<UnixStream>);

impl Client {
    pub(crate) fn new(path: &Path) -> io::Result<Self> {
        UnixStream::connect(path).map(|stream| Self(BufReader::new(stream)))
    }

    pub(crate) fn send(&mut self, text: &str) -> io::Result<()> {
        self.0.get_mut().write_all(text.as_bytes())
    }

    pub(crate) fn answer(&mut self) -> io::Result<Value> {
        let mut line = String::new();
        match self.0.read_line(&mut line)? {
            0 => Err(ErrorKind::UnexpectedEof.into()),
            _ => Ok(serde_json::from_str(&line)?),
        }
    }

    /// States its name, and returns the last offset that the run has from it.
    pub(crate) fn name(&mut self, name: &str) -> io::Result<Option<i64>> {
        self.send(&format!("{}\n", json!({ "client": name })))?;
        let answer = self.answer()?;
        assert_eq!(answer["client"], name, "{answer}");
        Ok(answer["offset"].as_i64())
    }
}
