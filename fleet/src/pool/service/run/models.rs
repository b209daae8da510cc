//! Replacing the model of a run.

use std::io::Write;
use std::path::{Component, Path};

use super::super::input::Source;
use super::super::work::parse;
use super::super::{Notice, ServiceJob};
use super::Run;
use crate::error::{FleetError, Outcome};
use crate::model::Model;
use crate::pool::VehicleId;
use crate::pool::answers;
use crate::pool::lines::BadLine;

/// Loads a model named by a line.
pub(super) fn load(job: &ServiceJob, name: &str) -> Outcome<Model> {
    let refused = |why: &str| Err(FleetError::Settings(format!("model {name:?}: {why}")));
    let Some(folder) = &job.models else {
        return refused("no folder of models was given (--models)");
    };
    let mut parts = Path::new(name).components();
    // A single plain component: no `..`, no path, no drive. Lines may come from anyone who can
    // connect.
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(part)), None) if part == name => Model::load(&folder.join(name)),
        _ => refused("is not the name of a file in the folder of models"),
    }
}

impl<W: Write, R: FnMut(&Notice)> Run<'_, W, R> {
    /// Continues with a model named by a line, and answers the line.
    pub(super) fn exchange(
        &mut self,
        source: Source,
        name: &str,
        offset: Option<&VehicleId>,
    ) -> Outcome<()> {
        let number = self.position.lines;
        let mut out = Vec::new();
        match load(self.job, name) {
            Ok(model) => {
                let counts = self.go_on_with(&model)?;
                self.position.model = Some(name.to_owned());
                answers::exchanged(&mut out, number, offset, (name, model.hash()), counts);
            }
            Err(error) => {
                let bad = BadLine { offset: offset.cloned(), ..BadLine::new(error.to_string()) };
                return self.refuse(source, &bad);
            }
        }
        self.put(&[out], &[source])
    }

    /// Reads the model file again, and continues with it.
    pub(super) fn read_model(&mut self) -> Outcome<()> {
        match Model::load(&self.job.live.model) {
            Ok(model) => {
                self.go_on_with(&model)?;
                self.position.model = None;
                // The last snapshot is of the old model, and a run that restores it would find the
                // new one in the file.
                self.asked = self.job.live.snapshot.is_some();
            }
            Err(error) => (self.report)(&Notice::ModelFailed(error)),
        }
        Ok(())
    }

    /// Continues with a model. Returns the number of vehicles that keep their belief, and of those
    /// that lose it.
    fn go_on_with(&mut self, model: &Model) -> Outcome<(usize, usize)> {
        // A snapshot must not contain vehicles of two models.
        self.wait_for_snapshot();
        // Forgotten vehicles do not count as kept.
        self.vehicles.forget();
        let before = self.vehicles.usage().vehicles;
        let options = &self.job.live.options;
        self.vehicles = self.vehicles.exchange(model, options)?;
        let kept = self.vehicles.usage().vehicles;
        if let Some(order) = &mut self.order {
            order.read_again(self.vehicles.sensor(), parse);
        }
        let hash = model.hash().to_owned();
        (self.report)(&Notice::Model { hash, kept, anew: before - kept });
        Ok((kept, before - kept))
    }
}
