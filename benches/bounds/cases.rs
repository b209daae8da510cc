//! The cases, each with what a step can't do without.

use std::collections::HashMap;
use std::hint::black_box;

use wayfix::{Hmm, Likelihood, LikelihoodVector, SparseTransition, Transition, TransitionEntries};

use crate::ceilings::{Bandwidth, fresh, gathers, seconds};
use crate::models::{self, Model};

/// What all cases take from the machine.
pub(crate) struct Machine {
    pub(crate) chain: f64,
    pub(crate) peak: Option<f64>,
    /// Part of the name of what is to be measured.
    pub(crate) only: Option<String>,
}

/// Seconds of a step.
pub(crate) struct Row {
    pub(crate) case: String,
    pub(crate) routine: &'static str,
    pub(crate) measured: f64,
    /// What may overlap.
    pub(crate) parts: [(&'static str, f64); 4],
    pub(crate) fresh: f64,
}

/// What a step can't do without.
#[derive(Default)]
struct Needs {
    /// Bytes, and the working set that they are of.
    bytes: Vec<(usize, usize)>,
    /// Seconds.
    gathers: f64,
    operations: usize,
    chains: f64,
    /// Results, and bytes of each, of all steps.
    fresh: Option<(usize, usize)>,
    threads: usize,
}

impl Needs {
    fn row(self, machine: &Machine, case: &str, routine: &'static str, steps: usize) -> Row {
        let threads = self.threads.max(1);
        let moved = |(bytes, set)| bytes as f64 / Bandwidth::of(set, threads).best();
        let bytes = self.bytes.into_iter().map(moved).fold(0.0, f64::max);
        let operations = machine.peak.map_or(0.0, |peak| 2.0 * self.operations as f64 / peak);
        let parts = [
            ("bytes", bytes),
            ("gathers", self.gathers / threads as f64),
            ("operations", operations / threads as f64),
            ("chain", self.chains * machine.chain),
        ];
        let fresh = self.fresh.map_or(0.0, |(count, bytes)| fresh(count, bytes) / steps as f64);
        Row { case: case.into(), routine, measured: 0.0, parts, fresh }
    }
}

/// A matrix, as a product has to read it.
#[derive(Clone, Copy)]
struct Matrix {
    states: usize,
    bytes: usize,
    entries: usize,
    gathers: f64,
}

impl Matrix {
    fn dense(n: usize) -> Self {
        Self { states: n, bytes: 8 * n * n, entries: n * n, gathers: 0.0 }
    }

    fn sparse(a: &SparseTransition) -> Self {
        let (n, entries) = (a.states(), a.entries());
        let gathered = gathered(a);
        let bytes = 8 * entries + 4 * gathered.len();
        Self { states: n, bytes, entries, gathers: gathers(n, &gathered) }
    }

    /// A step of the filter, where so many steps are seen.
    fn filter(self, seen: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let bytes = vec![(bytes + 16 * n, bytes + 16 * n), (8 * n, 8 * n * seen)];
        Needs { bytes, gathers, operations: 2 * entries, ..Needs::default() }
    }

    /// One of the smoother, there and back.
    fn smooth(self, steps: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let (vectors, result) = (32 * n, 8 * n * (steps + 1));
        let bytes =
            vec![(2 * bytes + vectors, 2 * bytes + vectors), (16 * n, result), (16 * n, result)];
        let (gathers, fresh) = (2.0 * gathers, Some((1, result)));
        Needs { bytes, gathers, operations: 4 * entries, fresh, ..Needs::default() }
    }

    /// One of the decoder, whose likelihoods are of so many bytes in all.
    fn viterbi(self, steps: usize, seen: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let bytes = vec![(bytes + 16 * n, bytes + 16 * n), (8 * n, seen)];
        let fresh = Some((1, 4 * n * steps));
        Needs { bytes, gathers, operations: 4 * entries, fresh, ..Needs::default() }
    }
}

/// The indices, row after row, of entries that have their diagonal for themselves among
/// eight rows.
fn gathered(a: &SparseTransition) -> Vec<u32> {
    let n = a.states();
    let mut indices = Vec::new();
    for first in (0..n).step_by(8) {
        let rows = first..(first + 8).min(n);
        let entries: Vec<(usize, usize)> =
            rows.flat_map(|to| a.incoming(&(), to).map(move |(from, _)| (to, from))).collect();
        let diagonal = |&(to, from): &(usize, usize)| n + from - to;
        let mut shared: HashMap<usize, usize> = HashMap::new();
        entries.iter().for_each(|entry| *shared.entry(diagonal(entry)).or_default() += 1);
        let alone = entries.iter().filter(|entry| shared[&diagonal(entry)] == 1);
        indices.extend(alone.map(|entry| entry.1 as u32));
    }
    indices
}

/// The rows, and which are wanted.
struct Rows<'m> {
    machine: &'m Machine,
    rows: Vec<Row>,
}

impl Rows<'_> {
    fn wants(&self, case: &str) -> bool {
        self.machine.only.as_ref().is_none_or(|only| case.contains(only.as_str()))
    }

    fn add(
        &mut self,
        (case, routine): (&str, &'static str),
        steps: usize,
        needs: Needs,
        work: impl FnMut(),
    ) {
        eprintln!("{case}, {routine}");
        let measured = seconds(work) / steps as f64;
        self.rows.push(Row { measured, ..needs.row(self.machine, case, routine, steps) });
    }

    fn filter<A, B>(&mut self, case: &str, model: &Model<A, B>, needs: Needs)
    where
        A: Transition<Control = ()>,
        B: Likelihood<Observation: Sized>,
    {
        let mut filter = model.hmm.filter();
        let mut seen = model.seen.iter().cycle();
        self.add((case, "filter"), 1, needs, || {
            black_box(seen.next().map(|y| filter.step(y))).expect("seen").expect("possible");
        });
    }

    /// Filter and smoother with likelihoods given, and the decoder with their logarithms.
    fn verbs<A>(&mut self, case: &str, matrix: Matrix, model: Model<A, models::Given>)
    where
        A: TransitionEntries<Control = ()>,
    {
        let steps = model.seen.len();
        self.filter(case, &model, matrix.filter(steps));
        let Model { hmm, mut seen } = model;
        self.add((case, "smooth"), steps, matrix.smooth(steps), || {
            black_box(hmm.smooth(&seen)).expect("possible");
        });
        seen.iter_mut().flatten().for_each(|b| *b = b.ln());
        let (prior, transition, _) = hmm.into_parts();
        let sensor = LikelihoodVector::log(matrix.states).owned();
        let hmm = Hmm::new(prior, transition, sensor).expect("one size");
        let needs = matrix.viterbi(steps, 8 * matrix.states * steps);
        self.add((case, "viterbi"), steps, needs, || {
            black_box(hmm.viterbi(&seen)).expect("possible");
        });
    }

    fn canberra(&mut self) {
        let case = "sparse 105";
        if self.wants(case) {
            let a = models::canberra();
            self.verbs(case, Matrix::sparse(&a), models::given(a, 1000));
        }
    }

    fn graph(&mut self) {
        let Some(folder) = models::graph_folder() else { return };
        if self.wants("metro") {
            let a = models::graph(&folder);
            let case = format!("metro {}", a.states());
            self.verbs(&case, Matrix::sparse(&a), models::given(a, 50));
        }
    }

    fn dense(&mut self) {
        for (n, steps) in [(105, 200), (1000, 20)] {
            let case = format!("dense {n}");
            if self.wants(&case) {
                self.verbs(&case, Matrix::dense(n), models::given(models::dense(n), steps));
            }
        }
    }

    fn two(&mut self) {
        let (case, steps) = ("dense 2", 100_000);
        if self.wants(case) {
            let Model { hmm, seen } = models::table(2, steps);
            let bytes = vec![(size_of::<usize>(), size_of_val(&seen[..]))];
            // Four multiplications with A, two additions, two with the likelihoods.
            let needs = Needs { bytes, operations: 8, chains: 0.5, ..Needs::default() };
            self.add((case, "score"), steps, needs, || {
                black_box(hmm.score(&seen)).expect("possible");
            });
        }
    }

    fn many(&mut self) {
        let (case, count, steps) = ("sparse 105 in 2000 × 50 steps", 2000, 50);
        if !self.wants(case) {
            return;
        }
        let model = models::given(models::canberra(), count * steps);
        let (n, entries) = (model.hmm.states(), model.hmm.transition().entries());
        let vector = 64 * n;
        let bytes = vec![
            (16 * entries, 2 * vector),
            (32 * n, 2 * vector * (steps + 1)),
            (8 * n, 8 * n * count * steps),
        ];
        // Beside the products, for each state: times the likelihood, over the sum and lifted,
        // then over the prediction, times the likelihood, and times the belief.
        let (operations, fresh) = (4 * entries + 6 * n, Some((count, 8 * n * (steps + 1))));
        let needs = Needs { bytes, operations, fresh, ..Needs::default() };
        let sequences = model.sequences(count, steps);
        self.add((case, "smooth_all"), count * steps, needs, || {
            on_one_processor(|| {
                black_box(model.hmm.smooth_all(&sequences));
            });
        });
    }

    fn town(&mut self) {
        let case = "sparse 1000000";
        if self.wants(case) {
            let a = models::town(1_000_000);
            let matrix = Matrix::sparse(&a);
            let model = models::given(a, 2);
            let mut needs = matrix.filter(2);
            // All of it beyond the caches.
            let bytes = matrix.bytes + 24 * matrix.states;
            (needs.bytes, needs.threads) = (vec![(bytes, bytes)], processors());
            self.filter(&format!("{case} on {}", processors()), &model, needs);
        }
    }
}

/// How many a large map is gone through on.
fn processors() -> usize {
    #[cfg(feature = "rayon")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    1
}

fn on_one_processor(work: impl FnOnce() + Send) {
    #[cfg(feature = "rayon")]
    {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        pool.expect("a thread").install(work);
    }
    #[cfg(not(feature = "rayon"))]
    work();
}

/// Measures them.
pub(crate) fn all(machine: &Machine) -> Vec<Row> {
    let mut rows = Rows { machine, rows: Vec::new() };
    rows.canberra();
    rows.graph();
    rows.dense();
    rows.two();
    rows.many();
    rows.town();
    rows.rows
}
