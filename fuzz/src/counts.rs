//! Counts of checks, and printing of inputs.

use std::collections::BTreeMap;
use std::fmt;

/// Numbers of checks by name.
#[derive(Debug, Clone, Default)]
pub struct Counts {
    numbers: BTreeMap<&'static str, u64>,
    /// True if targets print the input that they make of their bytes.
    pub verbose: bool,
}

impl Counts {
    /// Counts one check.
    pub fn add(&mut self, what: &'static str) {
        *self.numbers.entry(what).or_default() += 1;
    }

    /// Prints a value, if printing is on.
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
