//! The beginning of a run: everything is opened and checked before the first line is read.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::super::ServiceJob;
use super::super::input::{Event, WAITING, read_ahead};
use super::super::listen::Listener;
use super::super::position::{self, Position};
use super::super::vehicles::{self, Vehicles};
use super::models::load;
use crate::error::{FleetError, Outcome};
use crate::journal::Lock;
use crate::model::Model;
use crate::pool::file::check_replaced;
use crate::pool::latest::Latest;

/// Everything that a run begins with.
pub(super) struct Begin {
    pub(super) vehicles: Box<dyn Vehicles>,
    pub(super) position: Position,
    pub(super) file: Option<File>,
    pub(super) locked: Option<Lock>,
    pub(super) listener: Option<Listener>,
    pub(super) events: SyncSender<Event>,
    pub(super) queue: Receiver<Event>,
}

/// Opens the model, the snapshot, the output and the input.
pub(super) fn begin(job: &ServiceJob, mut input: impl Read + Send + 'static) -> Outcome<Begin> {
    let live = &job.live;
    if job.every.is_some() && live.snapshot.is_none() {
        return Err(FleetError::Settings("periodic snapshots need a --snapshot file".to_owned()));
    }
    if job.listen.is_some() && (job.input.is_some() || job.replay) {
        let message = "lines come either from connections or from an input, not both";
        return Err(FleetError::Settings(message.to_owned()));
    }
    let locked = live.snapshot.as_deref().map(Lock::new).transpose()?;
    // A file that cannot be examined may exist, and must not be replaced at the end: only a
    // definite no counts as missing.
    let is_missing = |path: &PathBuf| matches!(path.try_exists(), Ok(false));
    let is_first = |path: &PathBuf| live.snapshot.as_ref() == Some(path) && is_missing(path);
    // If snapshot and restore are the same file and it is not there yet, this is the first run of a
    // service that is restarted with the same command.
    let restore = live.restore.as_deref().filter(|_| !live.restore.as_ref().is_some_and(is_first));
    let mut position = match restore {
        Some(path) => position::position(path)?.unwrap_or_default(),
        None => Position::default(),
    };
    // A line may have replaced the model; the vehicles then belong to the new one.
    let model = match &position.model {
        Some(name) => load(job, name)?,
        None => Model::load(&live.model)?,
    };
    let mut vehicles = vehicles::open(&model, restore, &live.options)?;
    let latest = position.of_updates.take().unwrap_or_else(|| Latest::at(position.latest));
    vehicles.set_timing(job.timing, latest);
    let is_first = restore.is_none();
    let open = |path: &PathBuf| position::open_output(path, position.answers, is_first);
    let file = job.output.as_ref().map(open).transpose()?;
    // Checked once the output exists, since it might have the same name.
    live.snapshot.as_deref().map_or(Ok(()), check_replaced)?;
    if let (true, Some(_), Some(path)) = (is_first, &file, &live.snapshot) {
        // If the run is killed before its first snapshot, its output must still have a snapshot
        // that tells how much of it counts: none.
        vehicles.snapshot(path, &position.note())?;
    }
    let (events, queue) = sync_channel(WAITING);
    let mut listener = None;
    if let Some(address) = &job.listen {
        listener = Some(Listener::open(address, events.clone())?);
    } else if let Some(path) = &job.input {
        let input = position.open_input(path)?;
        read_ahead(position.rest(input).map_err(FleetError::file(path))?, events.clone());
    } else {
        let path = Path::new("standard input");
        if job.replay {
            position.skip(&mut input, path)?;
        }
        read_ahead(position.rest(input).map_err(FleetError::file(path))?, events.clone());
    }
    Ok(Begin { vehicles, position, file, locked, listener, events, queue })
}
