//! The limits of each routine, and how close it comes: measures the machine's ceilings, and
//! compares routines with the time that they take at least.
//!
//! ```text
//! cargo bench -p wayfix-benches --bench bounds
//! WAYFIX_GRAPH=path/to/folder cargo bench -p wayfix-benches --bench bounds --features faer,rayon
//! cargo bench -p wayfix-benches --bench bounds -- dense
//! ```
//!
//! With faer there is a ceiling of operations, with rayon the largest map is on all
//! processors; everything else is on one. A part of a case's name, or `ceilings`,
//! restricts the run to it.
//! Both tables are printed, and written to `target/bounds`.
//!
//! # Bounds
//!
//! A step takes at least the longest of these, since they may overlap, plus the time for fresh
//! memory, during which the processor is the system's:
//!
//! - **Bytes**, at the rate measured with a working set of the same size. A sparse product
//!   reads 8 E bytes of values and 4 G of indices, for E entries that take G
//!   loads of x; a dense one 8 n². A filter reads a belief, writes one (16 n), and reads
//!   likelihoods (8 n), which come from the cache that holds all observations. The smoother does
//!   so twice, and reads and writes a row of the result (16 n). A decoder has scores in place of
//!   the belief. Data in different caches are counted separately; the longest time counts.
//! - **Gathers**: loads at indices that are loaded first. G counts the diagonals that eight rows
//!   have. Each takes one load of x however many entries lie on it, since these can be loaded side
//!   by side. They are timed with the case's own indices.
//! - **Operations**: two for each entry and product, of a decoder four (add, compare, and
//!   select a value and a state), of learning two more, at half of faer's peak: faer fuses two
//!   into one, which the library doesn't, so that it gives the same bits everywhere.
//! - **Chain**: x_k waits for x_{k-1}. Up to eight states are kept in registers, and a step then
//!   waits only for a multiplication with A, log2 n additions and a multiplication with the
//!   likelihood, or log2 n + 2 additions of a decoder. With two states, eight segments run side
//!   by side: an eighth of that.
//! - **Fresh**: results are allocated, written and freed (8 n a step of the smoother, 4 n of
//!   the decoder for the way back); the system clears new pages.
//!
//! In lock-step eight sequences share the reads of the matrix, but each has its own loads of
//! x: for a sparse one 8 E bytes per product, from the first cache. Beliefs and likelihoods of a
//! group are written once and read once (32 n). Their results come in large pages, so that
//! clearing them counts as bytes: likelihoods are read, results cleared and written (24 n).
//!
//! The first cache is faster than the loops here show, so that bounds of data that fit into it
//! may be too high; they are too low for dependent steps with more than eight states, which no
//! formula here covers.

mod cases;
mod ceilings;
#[path = "../models/mod.rs"]
mod models;
mod needs;

use std::fmt::Write as _;
use std::fs;

use cases::Row;
use ceilings::{Bandwidth, Machine};
use needs::Bound;

const KB: usize = 1 << 10;
const MB: usize = 1 << 20;

/// Heading and cells.
struct Table(Vec<Vec<String>>);

impl Table {
    fn new<const N: usize>(heading: [&str; N]) -> Self {
        Self(vec![heading.map(String::from).to_vec()])
    }

    /// Prints a table as Markdown, and writes it as CSV.
    fn show(&self, name: &str) -> std::io::Result<()> {
        let mut text = String::new();
        for (number, cells) in self.0.iter().enumerate() {
            let _ = writeln!(text, "| {} |", cells.join(" | "));
            if number == 0 {
                let _ = writeln!(text, "|{}", "---|".repeat(cells.len()));
            }
        }
        println!("{text}");
        let lines: Vec<String> = self.0.iter().map(|cells| cells.join(",")).collect();
        fs::create_dir_all("target/bounds")?;
        fs::write(format!("target/bounds/{name}.csv"), lines.join("\n") + "\n")
    }
}

/// Table of the ceilings alone.
fn ceilings(machine: &Machine) -> Table {
    let mut table = Table::new(["ceiling", "working set", "rate", "unit"]);
    let mut row = |what: &str, set: &str, rate: f64, unit: &str| {
        table.0.push(vec![what.into(), set.into(), format!("{rate:.2}"), unit.into()]);
    };
    let sizes = [(24 * KB, "24 KB"), (MB, "1 MB"), (16 * MB, "16 MB"), (512 * MB, "512 MB")];
    for (bytes, set) in sizes {
        let Bandwidth { compare, copy, triad } = Bandwidth::of(bytes, 1);
        for (what, rate) in [("compare", compare), ("copy", copy), ("triad", triad)] {
            row(what, set, rate / 1e9, "GB/s");
        }
    }
    for (bytes, set) in &sizes[..3] {
        row("gather at random", set, ceilings::random_gather(bytes / 8) * 1e9, "ns");
    }
    for (bytes, set) in &sizes[1..] {
        let rate = *bytes as f64 / ceilings::fresh(1, *bytes);
        row("allocate, write and free", set, rate / 1e9, "GB/s");
    }
    row("multiplication, in a chain", "", machine.multiplication * 1e9, "ns");
    row("addition, in a chain", "", machine.addition * 1e9, "ns");
    if machine.peak.is_finite() {
        row("multiply and add, fused", "", machine.peak / 1e9, "GFLOP/s");
    }
    table
}

fn bounds(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "case",
        "routine",
        "measured µs",
        "bound µs",
        "ratio",
        "limit",
        "bytes",
        "gathers",
        "operations",
        "chain",
        "fresh",
    ]);
    for Row { case, routine, measured, bound: Bound { parts, fresh } } in rows {
        let (mut limit, mut longest) = ("", 0.0);
        for &(part, seconds) in parts {
            if seconds > longest {
                (limit, longest) = (part, seconds);
            }
        }
        let bound = longest + fresh;
        let limit = if *fresh > longest { "fresh" } else { limit };
        let mut cells = vec![case.clone(), (*routine).into(), micros(*measured), micros(bound)];
        cells.extend([format!("{:.1}", measured / bound), limit.into()]);
        cells.extend(parts.iter().map(|(_, seconds)| micros(*seconds)));
        cells.push(micros(*fresh));
        table.0.push(cells);
    }
    table
}

fn micros(seconds: f64) -> String {
    match seconds * 1e6 {
        0.0 => String::new(),
        micros @ ..0.1 => format!("{micros:.4}"),
        micros @ ..10.0 => format!("{micros:.2}"),
        micros => format!("{micros:.0}"),
    }
}

fn main() -> std::io::Result<()> {
    let only = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let machine = Machine::measured();
    if only.as_ref().is_none_or(|only| "ceilings".contains(only.as_str())) {
        ceilings(&machine).show("ceilings")?;
    }
    let rows = cases::all(&machine, only.as_deref());
    if rows.is_empty() { Ok(()) } else { bounds(&rows).show("bounds") }
}
