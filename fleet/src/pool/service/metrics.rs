//! Metrics of a run in the text format of Prometheus, and its health.
//!
//! Counters are independent atomics with relaxed ordering: a scrape need not be of one moment.

use std::fmt::Write as _;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::error::{FleetError, Outcome};

/// Kinds of errors in answers; all others count as the last one.
const KINDS: [&str; 8] =
    ["line", "time", "impossible", "impossible_move", "likelihood", "transition", "disk", "other"];
/// Maximum length of a request, and the time it may take.
const REQUEST: usize = 4096;
const PATIENCE: Duration = Duration::from_secs(2);
/// Maximum number of requests at a time.
const MOST: usize = 64;

/// Metrics of a run.
#[derive(Debug)]
pub(super) struct Metrics {
    pub(super) lines: AtomicU64,
    pub(super) accepted: AtomicU64,
    refused: [AtomicU64; KINDS.len()],
    pub(super) vehicles: AtomicU64,
    pub(super) in_memory: AtomicU64,
    pub(super) memory_bytes: AtomicU64,
    pub(super) disk_bytes: AtomicU64,
    pub(super) waiting: AtomicU64,
    /// `i64::MIN` before the first update.
    pub(super) latest: AtomicI64,
    pub(super) snapshots: AtomicU64,
    pub(super) snapshots_failed: AtomicU64,
    /// Time of the last snapshot in milliseconds since 1970, 0 before the first; and the
    /// milliseconds it took.
    pub(super) snapshot_at: AtomicU64,
    pub(super) snapshot_took: AtomicU64,
    /// 1 if the last snapshot failed, else 0.
    pub(super) is_ill: AtomicU64,
}

impl Default for Metrics {
    fn default() -> Self {
        let zero = AtomicU64::default;
        Self {
            lines: zero(),
            accepted: zero(),
            refused: Default::default(),
            vehicles: zero(),
            in_memory: zero(),
            memory_bytes: zero(),
            disk_bytes: zero(),
            waiting: zero(),
            latest: AtomicI64::new(i64::MIN),
            snapshots: zero(),
            snapshots_failed: zero(),
            snapshot_at: zero(),
            snapshot_took: zero(),
            is_ill: zero(),
        }
    }
}

/// Milliseconds since 1970.
pub(super) fn now() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| since.as_millis() as u64)
}

impl Metrics {
    pub(super) fn refuse(&self, kind: &str) {
        let at = KINDS.iter().position(|&name| name == kind).unwrap_or(KINDS.len() - 1);
        self.refused[at].fetch_add(1, Relaxed);
    }

    /// All metrics as text.
    fn text(&self) -> String {
        let mut text = String::new();
        let mut put = |name: &str, kind: &str, help: &str, value: &dyn std::fmt::Display| {
            let name = format!("wayfix_fleet_{name}");
            // Writing to memory does not fail.
            _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}\n{name} {value}");
        };
        let of = |value: &AtomicU64| value.load(Relaxed);
        put("lines_total", "counter", "Lines taken.", &of(&self.lines));
        put("accepted_total", "counter", "Updates that were taken.", &of(&self.accepted));
        put("vehicles", "gauge", "Vehicles.", &of(&self.vehicles));
        let help = "Vehicles whose state is in memory.";
        put("vehicles_in_memory", "gauge", help, &of(&self.in_memory));
        let on_disk = of(&self.vehicles).saturating_sub(of(&self.in_memory));
        put("vehicles_on_disk", "gauge", "Vehicles whose state is on disk.", &on_disk);
        let help = "Memory for vehicles, with their ids.";
        put("memory_bytes", "gauge", help, &of(&self.memory_bytes));
        put("disk_bytes", "gauge", "Files for vehicles beyond memory.", &of(&self.disk_bytes));
        put("waiting_lines", "gauge", "Lines that wait for late ones.", &of(&self.waiting));
        let latest = self.latest.load(Relaxed);
        if latest > i64::MIN {
            put("latest_time", "gauge", "Largest time of an update, in its unit.", &latest);
        }
        put("snapshots_total", "counter", "Snapshots written.", &of(&self.snapshots));
        let failed = of(&self.snapshots_failed);
        put("snapshots_failed_total", "counter", "Snapshots not written.", &failed);
        let at = of(&self.snapshot_at);
        if at > 0 {
            let age = now().saturating_sub(at) as f64 / 1e3;
            put("snapshot_age_seconds", "gauge", "Time since the last snapshot.", &age);
            let took = of(&self.snapshot_took) as f64 / 1e3;
            put("snapshot_duration_seconds", "gauge", "Time that it took.", &took);
        }
        let name = "wayfix_fleet_refused_total";
        _ = writeln!(text, "# HELP {name} Lines answered with an error.\n# TYPE {name} counter");
        for (kind, count) in KINDS.iter().zip(&self.refused) {
            _ = writeln!(text, "{name}{{kind=\"{kind}\"}} {}", of(count));
        }
        text
    }

    /// Serves requests at an address, on a thread of its own.
    pub(super) fn listen(self: &Arc<Self>, address: &str) -> Outcome<std::net::SocketAddr> {
        let wrong =
            |error: io::Error| FleetError::Settings(format!("metrics at {address}: {error}"));
        let listener = TcpListener::bind(address).map_err(wrong)?;
        let local = listener.local_addr().map_err(wrong)?;
        let metrics = Arc::clone(self);
        thread::spawn(move || {
            let seats = Arc::new(());
            for stream in listener.incoming().flatten() {
                // A thread per request, so that a silent client delays nobody. Requests beyond
                // `MOST` are dropped: the strong count is the number of running threads plus this
                // one.
                if Arc::strong_count(&seats) > MOST {
                    continue;
                }
                let (metrics, seat) = (Arc::clone(&metrics), Arc::clone(&seats));
                let answer = move || {
                    // The client may have gone away.
                    _ = metrics.answer(stream);
                    drop(seat);
                };
                _ = thread::Builder::new().spawn(answer);
            }
        });
        Ok(local)
    }

    fn answer(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut request = Vec::new();
        let mut part = [0; 512];
        let is_whole = |request: &[u8]| request.windows(4).any(|end| end == b"\r\n\r\n");
        let start = Instant::now();
        // The read timeout alone does not bound the time: a client could send a byte every second.
        while !is_whole(&request) && request.len() < REQUEST && start.elapsed() < PATIENCE {
            match stream.read(&mut part)? {
                0 => break,
                count => request.extend(&part[..count]),
            }
        }
        let first = request.split(|&byte| byte == b'\r').next().unwrap_or_default();
        let words: Vec<&[u8]> = first.split(|&byte| byte == b' ').collect();
        let plain = "text/plain; version=0.0.4; charset=utf-8";
        let (status, body) = match words.as_slice() {
            [b"GET", b"/metrics", ..] => ("200 OK", self.text()),
            [b"GET", b"/health", ..] if self.is_ill.load(Relaxed) == 0 => {
                ("200 OK", "ok\n".to_owned())
            }
            [b"GET", b"/health", ..] => {
                ("503 Service Unavailable", "the last snapshot failed\n".to_owned())
            }
            _ => ("404 Not Found", "GET /metrics or /health\n".to_owned()),
        };
        let length = body.len();
        write!(
            stream,
            "HTTP/1.1 {status}\r\nContent-Type: {plain}\r\nContent-Length: {length}\r\n\
             Connection: close\r\n\r\n{body}"
        )
    }
}
