//! The cases; models are called as in the bench `routines`.

use std::hint::black_box;

use wayfix::inference::LearningOptions;
use wayfix::{Hmm, Likelihood, LikelihoodVector, Transition, TransitionEntries};

use crate::ceilings::{Machine, seconds};
use crate::models::{self, Given, Model};
use crate::needs::{Bound, Matrix, Needs};

/// Seconds of a step.
pub(crate) struct Row {
    pub(crate) case: String,
    pub(crate) routine: &'static str,
    pub(crate) measured: f64,
    pub(crate) bound: Bound,
}

/// Rows so far.
struct Report<'m> {
    machine: &'m Machine,
    /// Part of the names of the cases to measure.
    only: Option<&'m str>,
    rows: Vec<Row>,
}

const POSSIBLE: &str = "the observations are possible";

impl Report<'_> {
    fn wants(&self, case: &str) -> bool {
        self.only.is_none_or(|only| case.contains(only))
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
        let bound = needs.bound(self.machine, steps);
        self.rows.push(Row { case: case.into(), routine, measured, bound });
    }

    fn filter<A, B>(&mut self, case: &str, model: &Model<A, B>, needs: Needs)
    where
        A: Transition<Control = ()>,
        B: Likelihood<Observation: Sized>,
    {
        let mut filter = model.hmm.filter();
        let mut seen = model.seen.iter().cycle();
        self.add((case, "filter"), 1, needs, || {
            black_box(seen.next().map(|y| filter.step(y))).expect("seen").expect(POSSIBLE);
        });
    }

    fn smooth<A, B>(&mut self, case: &str, model: &Model<A, B>, needs: Needs)
    where
        A: Transition<Control = ()>,
        B: Likelihood<Observation: Sized>,
    {
        self.add((case, "smooth"), model.seen.len(), needs, || {
            black_box(model.hmm.smooth(&model.seen)).expect(POSSIBLE);
        });
    }

    fn viterbi<A, B>(&mut self, case: &str, model: &Model<A, B>, needs: Needs)
    where
        A: TransitionEntries<Control = ()>,
        B: Likelihood<Observation: Sized>,
    {
        self.add((case, "viterbi"), model.seen.len(), needs, || {
            black_box(model.hmm.viterbi(&model.seen)).expect(POSSIBLE);
        });
    }

    /// With likelihoods given; the decoder with their logarithms.
    fn verbs<A>(&mut self, case: &str, matrix: Matrix, model: Model<A, Given>)
    where
        A: TransitionEntries<Control = ()>,
    {
        let (n, steps) = (matrix.states, model.seen.len());
        self.filter(case, &model, matrix.filter(steps));
        self.smooth(case, &model, matrix.smooth(steps));
        let Model { hmm, mut seen } = model;
        seen.iter_mut().flatten().for_each(|b| *b = b.ln());
        let (prior, transition, _) = hmm.into_parts();
        let hmm = Hmm::new(prior, transition, LikelihoodVector::log(n).owned());
        let model = Model { hmm: hmm.expect("one size"), seen };
        self.viterbi(case, &model, matrix.viterbi(steps, 8 * n * steps));
    }

    fn canberra(&mut self) {
        let (case, steps) = ("sparse 105", 1000);
        if self.wants(case) {
            let a = models::canberra();
            let matrix = Matrix::sparse(&a);
            self.verbs(case, matrix, models::given(a, steps));
            let needs = matrix.viterbi(steps, 8 * matrix.states * matrix.states);
            self.viterbi("sparse 105 table", &models::canberra_table(steps), needs);
        }
    }

    fn metro(&mut self) {
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

    fn few(&mut self) {
        for n in [2, 8] {
            let (case, steps) = (format!("dense {n}"), 100_000);
            if !self.wants(&case) {
                continue;
            }
            let model = models::table(n, steps);
            let seen = (size_of::<usize>(), size_of_val(&model.seen[..]));
            // Dependent additions of a sum of n values, or of their maximum.
            let sum = f64::from(n.ilog2());
            // Segments of the sequence that run side by side.
            let segments = if n == 2 { 8.0 } else { 1.0 };
            let needs = |operations, chain, fresh| {
                let fresh = Some((1, fresh * steps));
                Needs { bytes: vec![seen], operations, chain, fresh, ..Needs::default() }
            };
            let needed =
                Needs { fresh: None, ..needs(2 * n * n, (2.0 / segments, sum / segments), 0) };
            self.add((&case, "score"), steps, needed, || {
                black_box(model.hmm.log_likelihood(&model.seen)).expect(POSSIBLE);
            });
            self.smooth(&case, &model, needs(4 * n * n, (2.0 / segments, sum / segments), 8 * n));
            let states = size_of::<usize>();
            self.viterbi(&case, &model, needs(4 * n * n, (0.0, (2.0 + sum) / segments), states));
        }
    }

    fn smooth_all<A>(&mut self, case: &str, model: &Model<A, Given>, steps: usize, needs: Needs)
    where
        A: Transition<Control = ()> + Sync,
    {
        let sequences = model.sequences(model.seen.len() / steps, steps);
        let one = OneProcessor::new();
        self.add((case, "smooth_all"), model.seen.len(), needs, || {
            one.run(|| {
                black_box(model.hmm.smooth_all(&sequences));
            });
        });
    }

    fn many(&mut self) {
        let (case, count, steps) = ("sparse 105 in 2000 × 50 steps", 2000, 50);
        if self.wants(case) {
            let model = models::given(models::canberra(), count * steps);
            let matrix = Matrix::sparse(model.hmm.transition());
            let mut needs = matrix.smooth_all(count, steps);
            needs.bytes.push((16 * matrix.entries, 2 * 64 * matrix.states));
            self.smooth_all(case, &model, steps, needs);
        }
        let (case, count, steps, n) = ("dense 105 in 64 × 50 steps", 64, 50, 105);
        if self.wants(case) {
            let model = models::given(models::dense(n), count * steps);
            self.smooth_all(case, &model, steps, Matrix::dense(n).smooth_all(count, steps));
            let Model { hmm, seen } = &model;
            let sequences = model.sequences(count, steps);
            let once = LearningOptions::default().with_iterations(1).with_tolerance(0.0);
            // Two E-steps, each with the two products and the outer one.
            let mut needs = Matrix::dense(n).smooth_all(count, steps);
            (needs.operations, needs.fresh) = (needs.operations + 2 * n * n, None);
            let one = OneProcessor::new();
            self.add((case, "learn"), 2 * seen.len(), needs, || {
                one.run(|| {
                    black_box(hmm.learn(&sequences, &once)).expect("it can be learned");
                });
            });
        }
    }

    fn town(&mut self) {
        let case = "sparse 1000000";
        if self.wants(case) {
            let a = models::town(1_000_000);
            let matrix = Matrix::sparse(&a);
            let model = models::given(a, 2);
            // Everything exceeds the caches.
            let bytes = matrix.bytes + 24 * matrix.states;
            let mut needs = matrix.filter(2);
            (needs.bytes, needs.threads) = (vec![(bytes, bytes)], processors());
            self.filter(&format!("{case} on {}", processors()), &model, needs);
        }
    }
}

/// Number of processors for the largest map.
fn processors() -> usize {
    #[cfg(feature = "rayon")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    1
}

/// Number of threads of a measurement that may use all processors.
struct OneProcessor {
    #[cfg(feature = "rayon")]
    pool: rayon::ThreadPool,
}

impl OneProcessor {
    fn new() -> Self {
        #[cfg(feature = "rayon")]
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        Self {
            #[cfg(feature = "rayon")]
            pool,
        }
    }

    #[cfg_attr(not(feature = "rayon"), expect(clippy::unused_self, reason = "there is no pool"))]
    fn run(&self, work: impl FnOnce() + Send) {
        #[cfg(feature = "rayon")]
        self.pool.install(work);
        #[cfg(not(feature = "rayon"))]
        work();
    }
}

/// Measures the ceilings.
pub(crate) fn all(machine: &Machine, only: Option<&str>) -> Vec<Row> {
    let mut report = Report { machine, only, rows: Vec::new() };
    report.few();
    report.canberra();
    report.dense();
    report.metro();
    report.many();
    report.town();
    report.rows
}
