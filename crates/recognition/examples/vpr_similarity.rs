//! Locates each image of a drive along a route, given its similarity to each image of an earlier
//! pass, or the descriptors of both, by any method. Without files, a synthetic recording is used.
//!
//! ```text
//! cargo run --release --example vpr_similarity -- --similarity S.npy --truth T.csv
//! cargo run --release --example vpr_similarity -- --reference R.npy --query Q.npy
//! ```

#[path = "vpr/mod.rs"]
mod vpr;

#[path = "vpr/tables.rs"]
mod tables;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use wayfix_recognition::observation::{Distance, ReferenceDescriptors};

use vpr::{Common, Fallible, Recording, synthetic};

/// Locates the images of a drive by those of a map, and compares the answers with those of simpler
/// methods. Matrices are .npy or CSV files without a header, a line for each image in order.
#[derive(Parser)]
struct Arguments {
    /// Similarity of each query image (line) to each reference image (column).
    #[arg(long, value_name = "FILE")]
    similarity: Option<PathBuf>,
    /// The matrix holds distances: smaller is more alike, inf is surely not there.
    #[arg(long, requires = "similarity")]
    distances: bool,
    /// Descriptors of the references.
    #[arg(long, value_name = "FILE", requires = "query", conflicts_with = "similarity")]
    reference: Option<PathBuf>,
    /// Descriptors of the queries.
    #[arg(long, value_name = "FILE", requires = "reference")]
    query: Option<PathBuf>,
    /// Distance of two descriptors, cosine (for networks) or euclidean (for pixels).
    #[arg(long, requires = "reference", default_value = "cosine", value_parser = ["cosine", "euclidean"])]
    distance: String,
    /// CSV file of `query,first,last`, from 0: the first and the last of the references that show
    /// the place of the query; both empty or -1 if none does. Without it, nothing is learned or
    /// scored.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    vpr::exit_code(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Fallible {
    let common = &arguments.common;
    let mut recording = match (&arguments.similarity, &arguments.reference, &arguments.query) {
        (Some(file), ..) => similarities(file, arguments.distances)?,
        (_, Some(reference), Some(query)) => compared(reference, query, &arguments.distance)?,
        _ => {
            let (pass, drive) = (synthetic::pass(common), synthetic::drive(common.off_map)?);
            pass.recording(&pass.queries.select(&drive.frames), &drive)?
        }
    };
    recording.closed = common.closed;
    if let Some(file) = &arguments.truth {
        recording.truth = Some(tables::truth(file, recording.steps(), recording.references)?);
    }
    vpr::run(&recording, common, "vpr_similarity").map(drop)
}

fn similarities(file: &Path, distances: bool) -> Result<Recording, String> {
    let (references, mut values) = tables::matrix(file, distances)?;
    if !distances {
        // Everything downstream takes distances: smaller is more alike.
        values.iter_mut().for_each(|value| *value = -*value);
    }
    let (name, distances) = (vpr::name(&[file]), values);
    Ok(Recording { name, references, distances, ..Recording::default() })
}

fn compared(reference: &Path, query: &Path, distance: &str) -> Result<Recording, String> {
    let (dimension, references) = tables::matrix(reference, false)?;
    let (found, queries) = tables::matrix(query, false)?;
    let name = query.display();
    if found != dimension {
        return Err(format!("{name} has {found} columns, expected {dimension} as the references"));
    }
    let cosine = distance == "cosine";
    let distance = if cosine { Distance::Cosine } else { Distance::Euclidean };
    let references = ReferenceDescriptors::new(dimension, references, distance)
        .map_err(|error| format!("{}: {error}", reference.display()))?;
    let mut distances = Vec::new();
    let bar = vpr::bar("comparing images", queries.len() / dimension);
    let compared = references.distances_each(&queries, |_, row| {
        distances.extend_from_slice(row);
        bar.inc(1);
    });
    bar.finish_and_clear();
    compared.map_err(|error| format!("{name}: {error}"))?;
    let (name, references) = (vpr::name(&[query, reference]), references.count());
    Ok(Recording { name, references, distances, ..Recording::default() })
}
