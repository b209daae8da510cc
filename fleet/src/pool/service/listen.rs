//! Connections accepted at an address.
//!
//! A connection has two threads: one reads its lines into the queue of the run, the other sends
//! answers from its [`Outbox`]. Either one shuts the socket when it ends, which ends the other, so
//! none is left behind.

use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
#[cfg(unix)]
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::Duration;

use super::input::{Event, STANDARD, Source, read};
use super::outbox::Outbox;
use super::seats::{Seat, Seats};
use crate::error::{FleetError, Outcome};

/// Pause after the system refused a connection.
const PAUSE: Duration = Duration::from_millis(50);

/// An address at which connections are accepted until this is dropped.
#[derive(Debug)]
pub(super) struct Listener {
    address: Address,
    is_ended: Arc<AtomicBool>,
}

#[derive(Debug, Clone)]
enum Address {
    Net(SocketAddr),
    #[cfg(unix)]
    File(PathBuf),
}

enum Socket {
    Net(TcpListener),
    #[cfg(unix)]
    File(UnixListener),
}

#[derive(Debug)]
pub(super) enum Stream {
    Net(TcpStream),
    #[cfg(unix)]
    File(UnixStream),
}

impl Listener {
    /// Accepts connections at `unix:PATH` or `HOST:PORT` on a thread of its own.
    pub(super) fn open(text: &str, events: SyncSender<Event>) -> Outcome<Self> {
        let wrong = |error: io::Error| FleetError::Settings(format!("listen at {text}: {error}"));
        let (socket, address) = if let Some(path) = text.strip_prefix("unix:") {
            at_file(PathBuf::from(path)).map_err(wrong)?
        } else {
            let socket = TcpListener::bind(text).map_err(wrong)?;
            let address = socket.local_addr().map_err(wrong)?;
            (Socket::Net(socket), Address::Net(address))
        };
        let is_ended = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&is_ended);
        thread::spawn(move || take(&socket, &events, &ended));
        Ok(Self { address, is_ended })
    }

    /// The address, with the port chosen by the system.
    pub(super) fn address(&self) -> String {
        match &self.address {
            Address::Net(address) => address.to_string(),
            #[cfg(unix)]
            Address::File(path) => format!("unix:{}", path.display()),
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.is_ended.store(true, Ordering::SeqCst);
        // A connection wakes the thread that blocks in `accept`; it then sees the flag and ends.
        match &self.address {
            Address::Net(address) => drop(TcpStream::connect_timeout(address, PAUSE)),
            #[cfg(unix)]
            Address::File(path) => {
                drop(UnixStream::connect(path));
                _ = std::fs::remove_file(path);
            }
        }
    }
}

/// Binds a named socket. One left behind by a killed run is replaced.
#[cfg(unix)]
fn at_file(path: PathBuf) -> io::Result<(Socket, Address)> {
    use std::os::unix::fs::FileTypeExt;
    let is_socket = path.symlink_metadata().is_ok_and(|found| found.file_type().is_socket());
    if is_socket {
        // Only a socket without a listener refuses connections. Any other file is left alone, and
        // `bind` reports it.
        match UnixStream::connect(&path) {
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                std::fs::remove_file(&path)?;
            }
            _ => {
                return Err(io::Error::new(
                    io::ErrorKind::AddrInUse,
                    "another run is listening there",
                ));
            }
        }
    }
    let socket = UnixListener::bind(&path)?;
    Ok((Socket::File(socket), Address::File(path)))
}

#[cfg(not(unix))]
fn at_file(_: PathBuf) -> io::Result<(Socket, Address)> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "this system has no Unix sockets"))
}

/// Accepts connections until the run has ended.
fn take(socket: &Socket, events: &SyncSender<Event>, is_ended: &AtomicBool) {
    let mut seats = Seats::default();
    for source in STANDARD + 1.. {
        let stream = match socket {
            Socket::Net(socket) => socket.accept().map(|(stream, _)| Stream::Net(stream)),
            #[cfg(unix)]
            Socket::File(socket) => socket.accept().map(|(stream, _)| Stream::File(stream)),
        };
        if is_ended.load(Ordering::SeqCst) {
            return;
        }
        let begun = stream.and_then(|stream| {
            let stream = Arc::new(stream);
            let Some(seat) = seats.take(&stream) else {
                let text = r#"{"error_kind":"busy","error":"too many connections"}"#;
                return writeln!(&*stream, "{text}");
            };
            begin(stream, source, seat, events)
        });
        // For example too many open files: try again later instead of spinning.
        if begun.is_err() {
            thread::sleep(PAUSE);
        }
    }
}

/// The other end of a connection.
#[derive(Debug)]
pub(super) struct Peer {
    pub(super) outbox: Arc<Outbox>,
    stream: Arc<Stream>,
}

impl Peer {
    /// Ends the connection at once.
    pub(super) fn cut(&self) {
        self.outbox.abandon();
        self.stream.shut();
    }
}

/// Starts the two threads of a connection, one to read and one to send.
fn begin(
    stream: Arc<Stream>,
    source: Source,
    seat: Arc<Seat>,
    events: &SyncSender<Event>,
) -> io::Result<()> {
    if let Stream::Net(stream) = &*stream {
        // Answers are short, and are wanted at once.
        stream.set_nodelay(true)?;
    }
    let events = events.clone();
    let outbox = Arc::new(Outbox::new(Arc::clone(&seat)));
    let peer = Peer { outbox: Arc::clone(&outbox), stream: Arc::clone(&stream) };
    let (to_send, sent) = (Arc::clone(&outbox), Arc::clone(&stream));
    thread::Builder::new().spawn(move || {
        to_send.send(&*sent);
        // This also ends the reading thread.
        sent.shut();
    })?;
    let full = Arc::clone(&outbox);
    let reader = thread::Builder::new().spawn(move || {
        // Sent before the first chunk and from the same thread, so events of a connection are in
        // order.
        if events.send(Event::Open(source, peer)).is_ok() {
            let ready = || {
                seat.heard();
                full.wait_for_room();
            };
            read(&*stream, source, &events, ready);
        }
    });
    // Without a reader nobody would ever close the outbox, and the sender would wait forever.
    reader.map(drop).inspect_err(|_| outbox.abandon())
}

impl Stream {
    pub(super) fn shut(&self) {
        // It may already be closed.
        _ = match self {
            Self::Net(stream) => stream.shutdown(Shutdown::Both),
            #[cfg(unix)]
            Self::File(stream) => stream.shutdown(Shutdown::Both),
        };
    }
}

impl Read for &Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Net(stream) => (&mut &*stream).read(bytes),
            #[cfg(unix)]
            Stream::File(stream) => (&mut &*stream).read(bytes),
        }
    }
}

impl Write for &Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Stream::Net(stream) => (&mut &*stream).write(bytes),
            #[cfg(unix)]
            Stream::File(stream) => (&mut &*stream).write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
