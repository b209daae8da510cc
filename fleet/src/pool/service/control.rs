//! What is asked of a run from outside of its input.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};

use super::input::Event;

/// What is asked of a run from outside of its input. Clones are of the same run.
#[derive(Debug, Clone, Default)]
pub struct Control(Arc<Asked>);

#[derive(Debug, Default)]
struct Asked {
    stop: AtomicBool,
    snapshot: AtomicBool,
    model: AtomicBool,
    run: Mutex<Option<SyncSender<Event>>>,
}

impl Control {
    /// Creates a control for one run.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Ends the run in order: lines that have come are answered, then the snapshot is written.
    pub fn stop(&self) {
        self.ask(&self.0.stop);
    }

    /// Begins a snapshot.
    pub fn snapshot(&self) {
        self.ask(&self.0.snapshot);
    }

    /// Reads the file of the model again, and goes on with it.
    pub fn read_model(&self) {
        self.ask(&self.0.model);
    }

    fn ask(&self, what: &AtomicBool) {
        what.store(true, Ordering::SeqCst);
        if let Some(run) = &*self.0.run.lock().unwrap_or_else(PoisonError::into_inner) {
            // With a full queue, the run is awake.
            _ = run.try_send(Event::Wake);
        }
    }

    pub(super) fn attach(&self, run: SyncSender<Event>) {
        *self.0.run.lock().unwrap_or_else(PoisonError::into_inner) = Some(run);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.0.stop.load(Ordering::SeqCst)
    }

    pub(super) fn take_snapshot(&self) -> bool {
        self.0.snapshot.swap(false, Ordering::SeqCst)
    }

    pub(super) fn take_model(&self) -> bool {
        self.0.model.swap(false, Ordering::SeqCst)
    }
}

/// Lets the signals of the system control a run: SIGTERM and SIGINT stop it, a second one of them ends
/// the process at once; SIGUSR1 begins a snapshot; SIGHUP reads the model again. Other systems than
/// Unix have no such signals.
///
/// # Errors
///
/// [`std::io::Error`] if the system refuses.
#[cfg(unix)]
pub fn signals(control: &Control) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
    use signal_hook::iterator::Signals;
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGUSR1, SIGHUP])?;
    let control = control.clone();
    std::thread::spawn(move || {
        for signal in &mut signals {
            match signal {
                SIGUSR1 => control.snapshot(),
                SIGHUP => control.read_model(),
                _ if control.is_stopped() => std::process::exit(128 + signal),
                _ => control.stop(),
            }
        }
    });
    Ok(())
}

/// Does nothing on this system.
///
/// # Errors
///
/// None.
#[cfg(not(unix))]
pub fn signals(_: &Control) -> std::io::Result<()> {
    Ok(())
}
