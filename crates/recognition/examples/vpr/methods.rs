//! All methods on a recording: the library's, and the baselines to compare them with.

use std::time::Instant;

use wayfix::BeliefView;
use wayfix_recognition::{Answer, Parameters, PlaceBeliefs};

use super::{Fallible, Recording, Task, fit, plain, seqslam, sixty, waiting};

/// Answers of one method, one value per step.
#[derive(Debug, Default)]
pub(crate) struct Method {
    pub(crate) name: &'static str,
    /// Places; `None` means "not on the map".
    pub(crate) places: Vec<Option<usize>>,
    /// Confidence on any scale.
    pub(crate) confidence: Vec<f64>,
    /// Probability that the answer is right, for each tolerance; empty if the method has none.
    pub(crate) probability: Vec<Vec<f64>>,
    /// Probability of the true places, likewise.
    pub(crate) truth_mass: Vec<Vec<f64>>,
    /// Probability of being off the map, if that is modelled.
    pub(crate) off_map: Option<Vec<f64>>,
}

pub(crate) struct Estimates {
    pub(crate) fit: Parameters,
    /// Answers of filter, fixed lag and smoother, with the names of their files.
    pub(crate) answers: [(&'static str, Vec<Answer>); 3],
    /// Smoothed beliefs over the references, T × n.
    pub(crate) belief: Vec<f32>,
    /// Empty if the truth is unknown.
    pub(crate) methods: Vec<Method>,
    pub(crate) notes: Vec<String>,
}

pub(crate) fn estimate(task: Task<'_>) -> Fallible<Estimates> {
    let Task { recording, common, .. } = task;
    let recognizer = fit::recognizer(task)?;
    let (rows, start) = (recording.rows(), Instant::now());
    let seen = waiting("filter", || recognizer.recording(&rows, &recording.odometry))?;
    let filtered = seen.filtered();
    let ms = 1e3 * start.elapsed().as_secs_f64() / recording.steps() as f64;
    let mut notes = fit::notes(recognizer.parameters());
    notes.extend(seen.warnings().iter().map(|warning| format!("WARNING: {warning}")));
    notes.push(format!("a step takes {ms:.3} ms beside the comparison of images"));

    let mut methods = Vec::new();
    if recording.truth.is_some() {
        methods = vec![nearest(recording), task.of_beliefs("single", &seen.single())];
        for (length, method) in seqslam::run(task) {
            notes.push(format!("{}: lines of {length} steps", method.name));
            methods.push(method);
        }
        let temperature = waiting("plain HMM", || plain::temperature(task))?;
        notes.push(format!("plain_hmm: temperature {temperature}"));
        methods.extend(waiting("plain HMM", || task.plain(temperature))?);
        let [live, afterwards] = waiting("simple filter", || sixty::beliefs(recording));
        methods.push(task.simple("simple_filter", live));
        methods.push(task.simple("simple_smoother", afterwards));
    }
    methods.push(task.of_beliefs("filter", &filtered));
    let live = filtered.answers();
    // Beliefs of all steps are T × n numbers: each set is dropped before the next is made.
    drop(filtered);
    let mut lagged = Vec::new();
    for beliefs in waiting("fixed lag", || seen.lagged(&[common.lag]))? {
        methods.push(task.of_beliefs("fixed_lag", &beliefs));
        lagged = beliefs.answers();
    }
    let beliefs = waiting("smoother", || seen.smoothed())?;
    methods.push(task.of_beliefs("smoother", &beliefs));
    // Without a truth there is nothing to measure; the answers themselves are kept above.
    methods.retain(|_| recording.truth.is_some());
    let (rows, n) = (beliefs.iter().map(BeliefView::as_slice), recording.references);
    let belief = rows.flat_map(|row| row[..n].iter().map(|p| *p as f32)).collect();
    let answers = [("answers", live), ("lagged", lagged), ("smoothed", beliefs.answers())];
    Ok(Estimates { fit: recognizer.parameters().clone(), answers, belief, methods, notes })
}

/// Returns the reference at the smallest distance, as given.
fn nearest(recording: &Recording) -> Method {
    let rows = recording.distances.chunks_exact(recording.references);
    let nearest = rows.map(|row| {
        let all = row.iter().enumerate().filter(|(_, d)| d.is_finite());
        let least = all.min_by(|a, b| a.1.total_cmp(b.1));
        (least.map(|(i, _)| i), least.map_or(f64::NEG_INFINITY, |(_, d)| -f64::from(*d)))
    });
    let (places, confidence) = nearest.unzip();
    Method { name: "nearest", places, confidence, ..Method::default() }
}

impl Task<'_> {
    fn plain(self, temperature: f64) -> Fallible<[Method; 2]> {
        let hmm = plain::model(self.recording)?;
        let logs = plain::log_likelihoods(self.recording, temperature);
        let (mut filter, mut places, mut beliefs) = (hmm.filter(), Vec::new(), Vec::new());
        for logs in &logs {
            filter.step(logs)?;
            places.push(Some(filter.belief().mode()));
            beliefs.push(filter.belief().as_slice().to_vec());
        }
        let live = self.method("plain_hmm", places, beliefs.iter().map(Vec::as_slice));
        drop(beliefs);
        let smoothed = hmm.smooth(&logs)?;
        let places = smoothed.posteriors().modes().into_iter().map(Some).collect();
        let beliefs = smoothed.posteriors().iter().map(BeliefView::as_slice);
        Ok([live, self.method("plain_hmm_smoothed", places, beliefs)])
    }

    /// Answers of the simple filter or smoother. As with the library, each is the middle of the most
    /// probable three places, and if the map is never left, of a vehicle that is not lost.
    fn simple(self, name: &'static str, mut beliefs: Vec<Vec<f64>>) -> Method {
        let Self { recording: &Recording { references: n, closed, .. }, common, .. } = self;
        let mut places = Vec::new();
        for belief in &mut beliefs {
            if !common.off_map {
                belief.truncate(n);
                let sum: f64 = belief.iter().sum();
                belief.iter_mut().for_each(|p| *p /= sum);
            }
            let near = |place: usize| {
                let around = (place..place + 3).filter(|i| closed || (1..=n).contains(i));
                around.map(|i| belief[(i + n - 1) % n]).sum::<f64>()
            };
            let best = (0..n).rev().max_by(|a, b| near(*a).total_cmp(&near(*b)));
            places.push(best.filter(|_| belief.get(n).is_none_or(|lost| *lost <= 0.5)));
        }
        let off_map = common.off_map.then(|| beliefs.iter().map(|belief| belief[n]).collect());
        Method { off_map, ..self.method(name, places, beliefs.iter().map(Vec::as_slice)) }
    }

    fn of_beliefs(self, name: &'static str, beliefs: &PlaceBeliefs) -> Method {
        let answers = beliefs.answers();
        let places = answers.iter().map(|answer| answer.place).collect();
        let off_map = answers.iter().map(|answer| answer.off_map).collect();
        let off_map = Some(off_map).filter(|_| self.common.off_map);
        Method { off_map, ..self.method(name, places, beliefs.iter().map(BeliefView::as_slice)) }
    }

    /// Builds a method from answers, with the probabilities that beliefs give to them and to the
    /// truth.
    fn method<'b>(
        self,
        name: &'static str,
        places: Vec<Option<usize>>,
        beliefs: impl Iterator<Item = &'b [f64]>,
    ) -> Method {
        let Self { recording, split, common } = self;
        let mut probability = vec![Vec::new(); common.tolerance.len()];
        let mut truth_mass = probability.clone();
        for ((belief, place), label) in beliefs.zip(&places).zip(recording.truth.iter().flatten()) {
            let place = place.map(|place| place..=place);
            for (at, tolerance) in common.tolerance.iter().enumerate() {
                // An answer is one place, a label a range: half its usual length widens the answer
                // to match.
                let reach = tolerance.saturating_add(split.width);
                probability[at].push(recording.mass(belief, &place, reach));
                truth_mass[at].push(recording.mass(belief, label, *tolerance));
            }
        }
        let confidence = probability[0].clone();
        Method { name, places, confidence, probability, truth_mass, off_map: None }
    }
}
