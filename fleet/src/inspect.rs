//! The subcommand `model`: validates a model file and describes it.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use wayfix::{Hmm, Prior, TransitionEntries};

use crate::error::Outcome;
use crate::model::{Model, Operator, with_hmm};
use crate::sensor::{Kind, Sensor};

/// Maximum number of states that a warning lists.
const NAMED: usize = 5;

/// Inspects a model file.
#[derive(Debug, Clone, Subcommand)]
pub enum ModelCommand {
    /// Validates the file, and warns of likely mistakes in it.
    Check {
        /// Model, the JSON of a wayfix `Hmm`.
        file: PathBuf,
    },
    /// Shows size, kind and hash of the model.
    Show {
        /// Model, the JSON of a wayfix `Hmm`.
        file: PathBuf,
    },
}

impl ModelCommand {
    /// Returns the report about the file.
    ///
    /// # Errors
    ///
    /// [`FleetError`](crate::FleetError) if it is not a model, naming the first wrong number and
    /// its place.
    pub fn run(&self) -> Outcome<String> {
        match self {
            Self::Check { file } => {
                let warnings = warnings(&Model::load(file)?);
                let mut lines = vec![format!("{}: valid", file.display())];
                lines.extend(warnings.iter().map(|warning| format!("warning: {warning}")));
                Ok(lines.join("\n"))
            }
            Self::Show { file } => Ok(show(&Model::load(file)?, file)),
        }
    }
}

/// Returns likely mistakes in a valid model: states that are never reached or never left, and
/// symbols that are never seen.
#[must_use]
pub fn warnings(model: &Model) -> Vec<String> {
    with_hmm!(model, hmm => of_states(hmm).into_iter().chain(of_symbols(hmm.likelihood())).collect())
}

fn of_states<A: TransitionEntries<Control = ()>>(hmm: &Hmm<A, Sensor>) -> Vec<String> {
    let (n, transition) = (hmm.states(), hmm.transition());
    let moves = |from: usize| transition.outgoing(&(), from).filter(|(_, p)| *p > 0.0);
    let first = hmm.prior().belief().as_slice().iter().enumerate();
    let first: Vec<usize> = first.filter(|(_, p)| **p > 0.0).map(|(state, _)| state).collect();
    let mut next = match hmm.prior() {
        // The prior is that of X_0, and the first observation is made in X_1.
        Prior::BeforeFirstTransition(_) => {
            first.iter().flat_map(|&from| moves(from).map(|(to, _)| to)).collect()
        }
        _ => first,
    };
    // Depth-first search from the possible first states.
    let mut is_reached = vec![false; n];
    while let Some(state) = next.pop() {
        if !std::mem::replace(&mut is_reached[state], true) {
            // Only states not yet reached are pushed, so the stack holds at most one entry per
            // move.
            next.extend(moves(state).map(|(to, _)| to).filter(|&to| !is_reached[to]));
        }
    }
    let unreached: Vec<usize> = (0..n).filter(|&state| !is_reached[state]).collect();
    // A column of A sums to one, so a state is absorbing if all its moves lead back to it.
    let is_kept = |state: &usize| moves(*state).all(|(to, _)| to == *state);
    let kept: Vec<usize> = (0..n).filter(is_kept).collect();
    let reached = "cannot be reached from the prior, so no observation is ever made there";
    let mut warnings = Vec::new();
    warnings.extend(named("state", &unreached, reached));
    // A single state is absorbing by necessity.
    if n > 1 {
        warnings.extend(named("state", &kept, "cannot be left (absorbing)"));
    }
    warnings
}

fn of_symbols(sensor: &Sensor) -> Option<String> {
    let unseen: Vec<usize> = match sensor.kind() {
        Kind::Table(table) => {
            let rows = table.to_rows();
            let is_seen = |symbol: &usize| rows.iter().any(|row| row[*symbol] > 0.0);
            (0..table.symbols()).filter(|symbol| !is_seen(symbol)).collect()
        }
        Kind::SparseTable(table) => {
            let is_seen = |symbol: &usize| {
                table.symbol(*symbol).is_some_and(|seen| {
                    seen.elsewhere() > 0.0 || seen.listed().iter().any(|(_, p)| *p > 0.0)
                })
            };
            (0..table.symbols()).filter(|symbol| !is_seen(symbol)).collect()
        }
        _ => return None,
    };
    named(
        "symbol",
        &unseen,
        "has probability 0 in every state, so a drive that contains it is impossible",
    )
}

/// A warning about states or symbols, which lists the first few.
fn named(what: &str, which: &[usize], how: &str) -> Option<String> {
    let (first, rest) = which.split_at(which.len().min(NAMED));
    let first: Vec<String> = first.iter().map(ToString::to_string).collect();
    match (first.as_slice(), rest) {
        ([], _) => None,
        ([only], []) => Some(format!("{what} {only} {how}")),
        (_, []) => Some(format!("{what}s {}: each {how}", first.join(", "))),
        (_, rest) => {
            Some(format!("{what}s {} and {} more: each {how}", first.join(", "), rest.len()))
        }
    }
}

/// Description of a model, in lines.
fn show(model: &Model, file: &Path) -> String {
    let states = model.states();
    let (kind, entries) = match model.operator() {
        Operator::Sparse(hmm) => ("SparseTransition", entries(hmm)),
        Operator::Dense(hmm) => ("DenseTransition", entries(hmm)),
    };
    let (convention, possible) = with_hmm!(model, hmm => {
        let convention = match hmm.prior() {
            Prior::BeforeFirstTransition(_) => "before the first transition",
            Prior::AtFirstObservation(_) => "at the first observation",
            Prior::Stationary(_) => "stationary, at the first observation",
        };
        (convention, hmm.prior().belief().as_slice().iter().filter(|p| **p > 0.0).count())
    });
    let sensor = match model.sensor().kind() {
        Kind::Table(table) => format!("TableLikelihood, {} symbols", table.symbols()),
        Kind::SparseTable(table) => format!("SparseTableLikelihood, {} symbols", table.symbols()),
        Kind::Vector { log: false, .. } => "LikelihoodVector of likelihoods".to_owned(),
        Kind::Vector { log: true, .. } => "LikelihoodVector of logarithms".to_owned(),
        Kind::Sparse(_) => "SparseLikelihood".to_owned(),
        Kind::Places(_) => "places".to_owned(),
    };
    let optional = if model.sensor().is_optional() { ", null if nothing was seen" } else { "" };
    let (file, hash) = (file.display(), model.hash());
    format!(
        "states      {states}\n\
         transition  {kind}, {entries} entries above 0\n\
         prior       {convention}, {possible} states above 0\n\
         sensor      {sensor}{optional}\n\
         name        {file}#{hash}"
    )
}

fn entries<A: TransitionEntries<Control = ()>>(hmm: &Hmm<A, Sensor>) -> usize {
    let column = |from| hmm.transition().outgoing(&(), from).filter(|(_, p)| *p > 0.0).count();
    (0..hmm.states()).map(column).sum()
}
