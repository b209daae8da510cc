//! Connections that are taken at an address.

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

/// Time before another connection is taken, if the system refuses one.
const PAUSE: Duration = Duration::from_millis(50);

/// An address at which connections are taken until it is dropped.
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
    /// Takes connections at `unix:PATH` or `HOST:PORT` on a thread of its own.
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

    /// The address, with the port that the system chose.
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
        // Wakes the thread.
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

/// Binds a socket with a name. One that a killed run has left is replaced.
#[cfg(unix)]
fn at_file(path: PathBuf) -> io::Result<(Socket, Address)> {
    use std::os::unix::fs::FileTypeExt;
    let is_socket = path.symlink_metadata().is_ok_and(|found| found.file_type().is_socket());
    if is_socket {
        match UnixStream::connect(&path) {
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                std::fs::remove_file(&path)?;
            }
            _ => return Err(io::Error::new(io::ErrorKind::AddrInUse, "another run listens there")),
        }
    }
    let socket = UnixListener::bind(&path)?;
    Ok((Socket::File(socket), Address::File(path)))
}

#[cfg(not(unix))]
fn at_file(_: PathBuf) -> io::Result<(Socket, Address)> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "this system has no such sockets"))
}

/// Takes connections until the run has ended.
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

/// Begins the two threads of a connection, one that reads and one that sends.
fn begin(
    stream: Arc<Stream>,
    source: Source,
    seat: Arc<Seat>,
    events: &SyncSender<Event>,
) -> io::Result<()> {
    if let Stream::Net(stream) = &*stream {
        stream.set_nodelay(true)?;
    }
    let events = events.clone();
    let outbox = Arc::new(Outbox::new(Arc::clone(&seat)));
    let peer = Peer { outbox: Arc::clone(&outbox), stream: Arc::clone(&stream) };
    let (to_send, sent) = (Arc::clone(&outbox), Arc::clone(&stream));
    thread::Builder::new().spawn(move || {
        to_send.send(&*sent);
        // The thread that reads ends, too.
        sent.shut();
    })?;
    let full = Arc::clone(&outbox);
    let reader = thread::Builder::new().spawn(move || {
        if events.send(Event::Open(source, peer)).is_ok() {
            let ready = || {
                seat.heard();
                full.wait_for_room();
            };
            read(&*stream, source, &events, ready);
        }
    });
    reader.map(drop).inspect_err(|_| outbox.abandon())
}

impl Stream {
    pub(super) fn shut(&self) {
        // It may be closed already.
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
