//! How much was checked, and what with.

use std::collections::BTreeMap;
use std::fmt;

/// Numbers of checks by their names.
#[derive(Debug, Clone, Default)]
pub struct Counts {
    numbers: BTreeMap<&'static str, u64>,
    /// Whether to print what a target makes of its bytes.
    pub verbose: bool,
}

impl Counts {
    /// Counts one check.
    pub fn add(&mut self, what: &'static str) {
        *self.numbers.entry(what).or_default() += 1;
    }

    /// Prints something, if that is wanted.
    pub fn note(&self, text: impl FnOnce() -> String) {
        if self.verbose {
            println!("{}", text());
        }
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.numbers.iter().try_for_each(|(what, count)| writeln!(f, "  {count:>12} {what}"))
    }
}
