//! Runs a target on pseudo-random bytes for a given time, and reports what was checked.
#![forbid(unsafe_code)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use wayfix_fuzz::{Counts, TARGETS, Target};

const USAGE: &str = "\
usage: seeded --target NAME [--seconds 60] [--seed 1] [--failures 1]
       seeded --target NAME --seed SEED --input NUMBER [--write FILE]
       seeded --target NAME --replay FILE";

fn main() -> ExitCode {
    match run(std::env::args().skip(1)) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("{problem}\n{USAGE}");
            ExitCode::from(2)
        }
    }
}

struct Options {
    target: Target,
    name: &'static str,
    most: usize,
    seconds: u64,
    seed: u64,
    failures: u64,
    input: Option<u64>,
    write: Option<String>,
    replay: Option<String>,
}

fn options(mut arguments: impl Iterator<Item = String>) -> Result<Options, String> {
    let (_, target, most) = TARGETS[0];
    let mut options = Options {
        target,
        name: "",
        most,
        seconds: 60,
        seed: 1,
        failures: 1,
        input: None,
        write: None,
        replay: None,
    };
    while let Some(key) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{key} needs a value"))?;
        let number =
            || value.parse::<u64>().map_err(|_| format!("{key} {value}: expected a number"));
        match key.as_str() {
            "--target" => {
                let found = TARGETS.iter().find(|target| target.0 == value);
                let names: Vec<&str> = TARGETS.iter().map(|target| target.0).collect();
                (options.name, options.target, options.most) = *found
                    .ok_or_else(|| format!("no target {value}; there are {}", names.join(", ")))?;
            }
            "--seconds" => options.seconds = number()?,
            "--seed" => options.seed = number()?,
            "--failures" => options.failures = number()?,
            "--input" => options.input = Some(number()?),
            "--write" => options.write = Some(value),
            "--replay" => options.replay = Some(value),
            _ => return Err(format!("no option {key}")),
        }
    }
    if options.name.is_empty() {
        return Err("which target?".to_owned());
    }
    Ok(options)
}

/// Returns the number of inputs that failed.
fn run(arguments: impl Iterator<Item = String>) -> Result<u64, String> {
    let options = options(arguments)?;
    let Options { target, name, most, seed, .. } = options;
    let mut verbose = Counts::default();
    verbose.verbose = true;
    if let Some(file) = &options.replay {
        let bytes = std::fs::read(file).map_err(|error| format!("{file}: {error}"))?;
        target(&bytes, &mut verbose);
        println!("{name}: {file} finds nothing");
        return Ok(0);
    }
    if let Some(number) = options.input {
        let bytes = bytes(seed, number, most);
        if let Some(file) = &options.write {
            std::fs::write(file, &bytes).map_err(|error| format!("{file}: {error}"))?;
        }
        target(&bytes, &mut verbose);
        println!("{name}: input {number} of seed {seed} finds nothing");
        return Ok(0);
    }
    let (start, time) = (Instant::now(), Duration::from_secs(options.seconds));
    let (mut counts, mut number, mut failed) = (Counts::default(), 0, 0);
    while start.elapsed() < time && failed < options.failures {
        let bytes = bytes(seed, number, most);
        if catch_unwind(AssertUnwindSafe(|| target(&bytes, &mut counts))).is_err() {
            failed += 1;
            eprintln!("{name} failed; again with --target {name} --seed {seed} --input {number}\n");
        }
        number += 1;
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{name}: {number} inputs of seed {seed} in {seconds:.0} s, {failed} failed");
    print!("{counts}");
    Ok(failed)
}

/// Returns the bytes of an input, of any length up to `most`; long ones are more frequent.
fn bytes(seed: u64, number: u64, most: usize) -> Vec<u8> {
    let mut state = mix(seed).wrapping_add(number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(state)
    };
    let length = (next() as usize % (most + 1)).max(next() as usize % (most + 1));
    let words = std::iter::repeat_with(|| next().to_le_bytes()).flatten();
    words.take(length).collect()
}

/// The mixing function of SplitMix64 (Steele, Lea and Flood 2014).
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
