//! Requests to a run from outside its input.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};

use super::input::Event;

/// Handle for requests to a run from outside its input. Clones belong to the same run.
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

    /// Ends the run in an orderly way: lines that have arrived are answered, then the snapshot is
    /// written.
    pub fn stop(&self) {
        self.ask(&self.0.stop);
    }

    /// Requests a snapshot.
    pub fn snapshot(&self) {
        self.ask(&self.0.snapshot);
    }

    /// Reads the model file again, and continues with it.
    pub fn read_model(&self) {
        self.ask(&self.0.model);
    }

    fn ask(&self, what: &AtomicBool) {
        // The flag first, then the wake-up: any event that the run receives after this finds the
        // flag set.
        what.store(true, Ordering::SeqCst);
        if let Some(run) = &*self.0.run.lock().unwrap_or_else(PoisonError::into_inner) {
            // If the queue is full, the run is awake anyway, and checks the flag after each batch.
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

/// Lets signals control a run: SIGTERM and SIGINT stop it, and a second one ends the process at
/// once; SIGUSR1 requests a snapshot; SIGHUP reads the model again. Systems other than Unix
/// lack these signals.
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
