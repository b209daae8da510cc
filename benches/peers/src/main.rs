//! Times wayfix against the crates bio, hmmm and faer, in one process, and
//! writes the models, the observations and the answers for `peers.py`.

mod cases;
mod check;
mod model;
mod npy;
mod race;

use std::path::PathBuf;

use clap::Parser;

use race::Races;

/// Reason for not reporting anything.
type Failure = Box<dyn std::error::Error>;

/// Folders that a case writes to and reads from.
struct Folders {
    out: PathBuf,
    graph: PathBuf,
}

/// Answers, compares and times.
type Run = fn(&mut Races, &Folders) -> Result<(), Failure>;

/// Times wayfix against the crates bio, hmmm and faer, after comparing their answers.
#[derive(Parser)]
struct Arguments {
    /// The folder for models, answers and times.csv.
    #[arg(long, default_value = "target/peers")]
    out: PathBuf,
    /// A folder with a road graph: nodes.csv (node, longitude, latitude) and
    /// edges.csv (from, to, class, metres), with nodes numbered from 0.
    #[arg(long)]
    graph: Option<PathBuf>,
    /// Run only the case of this name.
    #[arg(long)]
    case: Option<String>,
    /// Number of repetitions for each routine.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(7..))]
    repetitions: u32,
}

fn main() -> Result<(), Failure> {
    let Arguments { out, graph, case, repetitions } = Arguments::parse();
    let mut cases: Vec<(&str, Run)> = vec![
        (cases::road_map::CASE, cases::road_map::run),
        (cases::symbols::CASE, cases::symbols::run),
        (cases::many::CASE, cases::many::run),
        (cases::two_states::CASE, cases::two_states::run),
        (cases::thousand::CASE, cases::thousand::run),
        (cases::switching::REGRESSION, cases::switching::regression),
        (cases::switching::WITH_INPUTS, cases::switching::with_inputs),
    ];
    cases.extend(cases::families::CASES);
    if graph.is_some() {
        cases.insert(1, (cases::graph::CASE, cases::graph::run));
    }
    cases.retain(|(name, _)| case.as_ref().is_none_or(|case| case == name));
    if cases.is_empty() {
        return Err("there is no case of this name".into());
    }
    let folders = Folders { out, graph: graph.unwrap_or_default() };
    std::fs::create_dir_all(&folders.out)?;
    let mut races = Races::new(repetitions);
    cases.iter().try_for_each(|(_, run)| run(&mut races, &folders))?;
    races.write(&folders.out.join("times.csv"))
}
