//! Times routines in turn, so that other load on the machine affects all of them equally.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::Failure;

/// Least duration of a repetition; shorter routines are called repeatedly.
const REPETITION: Duration = Duration::from_millis(20);

/// Routine of one library.
pub(crate) struct Contender<'a> {
    who: &'static str,
    /// Difference of its answer from that of wayfix.
    difference: f64,
    work: Box<dyn FnMut() + 'a>,
}

impl<'a> Contender<'a> {
    pub(crate) fn wayfix(work: impl FnMut() + 'a) -> Self {
        Self::peer("wayfix", 0.0, work)
    }

    pub(crate) fn peer(who: &'static str, difference: f64, work: impl FnMut() + 'a) -> Self {
        Self { who, difference, work: Box::new(work) }
    }

    fn time(&mut self, calls: u32) -> Duration {
        let start = Instant::now();
        (0..calls).for_each(|_| (self.work)());
        start.elapsed()
    }
}

struct Row {
    case: &'static str,
    routine: &'static str,
    who: &'static str,
    /// Microseconds per step, in ascending order.
    times: Vec<f64>,
    difference: f64,
}

/// Times of all contenders.
pub(crate) struct Races {
    repetitions: u32,
    rows: Vec<Row>,
}

impl Races {
    pub(crate) fn new(repetitions: u32) -> Self {
        Self { repetitions, rows: Vec::new() }
    }

    /// Times each contender in turn; a call takes this many steps.
    pub(crate) fn run(
        &mut self,
        case: &'static str,
        routine: &'static str,
        steps: usize,
        mut contenders: Vec<Contender<'_>>,
    ) {
        let calls: Vec<u32> = contenders
            .iter_mut()
            .map(|contender| {
                contender.time(1); // warms up
                let once = contender.time(1).max(Duration::from_nanos(1));
                REPETITION.as_nanos().div_ceil(once.as_nanos()) as u32
            })
            .collect();
        let mut times = vec![Vec::new(); contenders.len()];
        for _ in 0..self.repetitions {
            for ((contender, &calls), times) in contenders.iter_mut().zip(&calls).zip(&mut times) {
                let microseconds = contender.time(calls).as_secs_f64() * 1e6;
                times.push(microseconds / (f64::from(calls) * steps as f64));
            }
        }
        for (contender, times) in contenders.into_iter().zip(times) {
            let Contender { who, difference, .. } = contender;
            self.add(case, routine, who, difference, times);
        }
    }

    pub(crate) fn repetitions(&self) -> u32 {
        self.repetitions
    }

    /// Adds times, in microseconds per step.
    pub(crate) fn add(
        &mut self,
        case: &'static str,
        routine: &'static str,
        who: &'static str,
        difference: f64,
        mut times: Vec<f64>,
    ) {
        times.sort_by(f64::total_cmp);
        let row = Row { case, routine, who, times, difference };
        eprintln!("{case}, {routine}, {who}: {:.4} µs", row.median());
        self.rows.push(row);
    }

    pub(crate) fn write(&self, path: &Path) -> Result<(), Failure> {
        let mut file = csv::Writer::from_path(path)?;
        file.write_record([
            "case",
            "routine",
            "who",
            "median_us",
            "min_us",
            "max_us",
            "difference",
        ])?;
        for row in &self.rows {
            let numbers = [row.median(), row.times[0], row.times[row.times.len() - 1]];
            let numbers = numbers.map(|time| time.to_string());
            let names = [row.case, row.routine, row.who];
            let names = names.into_iter().chain(numbers.iter().map(String::as_str));
            file.write_record(names.chain([format!("{:e}", row.difference).as_str()]))?;
        }
        Ok(file.flush()?)
    }
}

impl Row {
    fn median(&self) -> f64 {
        let middle = self.times.len() / 2;
        if self.times.len() % 2 == 1 {
            self.times[middle]
        } else {
            f64::midpoint(self.times[middle - 1], self.times[middle])
        }
    }
}
