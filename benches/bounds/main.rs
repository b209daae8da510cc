//! What limits each routine, and how close it is: the machine's ceilings are measured, and
//! routines beside the time that they can't do without.
//!
//! ```text
//! cargo bench --bench bounds
//! WAYFIX_GRAPH=path/to/folder cargo bench --bench bounds --features faer,rayon
//! cargo bench --bench bounds -- dense
//! ```
//!
//! With faer there is a ceiling of operations, with rayon the largest map is on all
//! processors; everything else is on one. A part of a case's name does that alone.
//! Both tables are printed, and written to `target/bounds`.
//!
//! # Bounds
//!
//! A step takes at least the longest of these, for what it can't do without may overlap, and
//! then the time that fresh memory takes, in which the processor is the system's:
//!
//! - **Bytes**, at the rate measured with a working set of the same size. A sparse product
//!   reads 8 E bytes of values and 4 G of indices, for E entries of which G have to be
//!   gathered; a dense one 8 n². A filter reads a belief, writes one (16 n), and reads
//!   likelihoods (8 n), which come from where all that is seen fits. The smoother does so
//!   twice, and reads and writes a row of the result (16 n). A decoder has scores for the
//!   belief. What differs in where it fits is counted apart; the longest counts.
//! - **Gathers**: loads at indices that are loaded first. G counts what lies on a diagonal
//!   by itself among eight rows; the others can be loaded side by side. They are timed
//!   with the case's own indices.
//! - **Operations**: of the smoother and the filter two for each entry and product, of a decoder
//!   four (add, compare, and select a value and a state), at half of faer's peak: it fuses
//!   two to one, which the library doesn't, so as to give the same bits everywhere.
//! - **Chain**: x_k waits for x_{k-1}, by a multiplication with A, an addition and a
//!   multiplication with the likelihood. Two states are gone through from both ends at once:
//!   half a chain a step.
//! - **Fresh**: the results are allocated, written and freed; pages that are new are cleared
//!   by the system.
//!
//! In lock-step eight sequences share the reads of the matrix, but each has its own loads of
//! x, 8 E a product, from the first cache; beliefs and likelihoods of a group are written once
//! and read once (32 n).

mod cases;
mod ceilings;
#[path = "../models/mod.rs"]
mod models;

use std::fmt::Write as _;
use std::fs;

use cases::{Machine, Row};
use ceilings::Bandwidth;

const KB: usize = 1 << 10;
const MB: usize = 1 << 20;

/// Heading and cells.
struct Table(Vec<Vec<String>>);

impl Table {
    fn new<const N: usize>(heading: [&str; N]) -> Self {
        Self(vec![heading.map(String::from).to_vec()])
    }

    /// Prints it as Markdown, and writes it as CSV.
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

/// The ceilings by themselves.
fn ceilings(machine: &Machine) -> Table {
    let mut table = Table::new(["ceiling", "working set", "rate"]);
    let mut row = |what: &str, set: &str, rate: String| {
        table.0.push(vec![what.into(), set.into(), rate]);
    };
    let sizes = [(24 * KB, "24 KB"), (MB, "1 MB"), (16 * MB, "16 MB"), (512 * MB, "512 MB")];
    for (bytes, set) in sizes {
        let Bandwidth { compare, copy, triad } = Bandwidth::of(bytes, 1);
        for (what, rate) in [("compare", compare), ("copy", copy), ("triad", triad)] {
            row(what, set, format!("{:.1} GB/s", rate / 1e9));
        }
    }
    for (bytes, set) in &sizes[..3] {
        let n = bytes / 8;
        let mut index = 1_u32;
        let indices: Vec<u32> = (0..n.max(10_000))
            .map(|_| {
                index = index.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (index >> 8) % n as u32
            })
            .collect();
        let each = ceilings::gathers(n, &indices) / indices.len() as f64;
        row("gather at random", set, format!("{:.2} ns each", each * 1e9));
    }
    row("multiply, add, multiply in a chain", "", format!("{:.2} ns", machine.chain * 1e9));
    if let Some(peak) = machine.peak {
        row("multiply and add, fused (faer)", "", format!("{:.1} GFLOP/s", peak / 1e9));
    }
    for (bytes, set) in &sizes[1..] {
        let rate = *bytes as f64 / ceilings::fresh(1, *bytes);
        row("allocate, write and free", set, format!("{:.1} GB/s", rate / 1e9));
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
    let micros = |seconds: f64| match seconds * 1e6 {
        0.0 => "–".to_string(),
        micros @ ..0.1 => format!("{micros:.4}"),
        micros @ ..10.0 => format!("{micros:.2}"),
        micros => format!("{micros:.0}"),
    };
    for Row { case, routine, measured, parts, fresh } in rows {
        let (limit, longest) = parts
            .iter()
            .fold(("", 0.0), |longest, part| if part.1 > longest.1 { *part } else { longest });
        let limit = if *fresh > longest { "fresh" } else { limit };
        let bound = longest + fresh;
        let ratio = format!("{:.1}", measured / bound);
        let (case, routine) = (case.clone(), (*routine).into());
        let mut cells = vec![case, routine, micros(*measured), micros(bound), ratio, limit.into()];
        cells.extend(parts.iter().map(|(_, seconds)| micros(*seconds)));
        cells.push(micros(*fresh));
        table.0.push(cells);
    }
    table
}

fn main() -> std::io::Result<()> {
    let only = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let machine = Machine { chain: ceilings::chain(), peak: ceilings::peak(), only };
    if machine.only.is_none() {
        ceilings(&machine).show("ceilings")?;
    }
    bounds(&cases::all(&machine)).show("bounds")
}
