//! Times wayfix beside the crates bio, hmmm and faer, in one process, and
//! writes the models, the observations and the answers for `peers.py`.

mod cases;
mod check;
mod model;
mod npy;
mod race;

use std::path::PathBuf;

use clap::Parser;

use race::Races;

/// Why nothing is reported.
type Failure = Box<dyn std::error::Error>;

/// Times wayfix beside the crates bio, hmmm and faer, after their answers were
/// compared.
#[derive(Parser)]
struct Arguments {
    /// The folder for models, answers and times.csv.
    #[arg(long, default_value = "target/peers")]
    out: PathBuf,
    /// A folder with a road graph: nodes.csv (node, longitude, latitude) and
    /// edges.csv (from, to, class, metres), with nodes numbered from 0.
    #[arg(long)]
    graph: Option<PathBuf>,
    /// How often each routine is timed.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(7..))]
    repetitions: u32,
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    let out = &arguments.out;
    std::fs::create_dir_all(out)?;
    let mut races = Races::new(arguments.repetitions);
    cases::road_map::run(&mut races, out)?;
    if let Some(graph) = &arguments.graph {
        cases::graph::run(&mut races, out, graph)?;
    }
    cases::symbols::run(&mut races)?;
    cases::many::run(&mut races, out)?;
    cases::two_states::run(&mut races, out)?;
    cases::thousand::run(&mut races, out)?;
    cases::learning::run(&mut races, out)?;
    races.write(&out.join("times.csv"))?;
    Ok(())
}
