//! Choice of the temperature by the filter's log score on steps that were not learned from (`guide::formulas`,
//! Match odds): likelihood alone would prefer temperatures that make answers too sure.

use super::fit::LabelledPart;
use super::parameters::Parameters;
use super::warning::Warning;
use super::{Options, RecognitionError, Recognizer};

/// Factors of the temperature to try.
const FACTORS: [f64; 5] = [2.0, 1.4, 1.0, 0.7, 0.5];
/// Standard deviation of the logarithm of the factor in the prior.
const DEVIATION: f64 = 0.25;
/// Number of steps that count as one in the log score, since steps err together.
const STEPS_PER_WITNESS: f64 = 10.0;
/// Smallest probability that counts for a step, so that no step decides alone.
const LEAST: f64 = 1e-3;
/// Fewest labelled steps of a half.
const HALF: usize = 30;
/// Steps left out at the beginning of a part, while the vehicle is still being localised.
const BURN_IN: usize = 10;
/// Probability of a label below which the filter contradicts it, and share of such labels above
/// which a warning is given. On drives with right labels the share was 0.42 at most.
const UNLIKELY: f64 = 0.1;
const CONTRADICTED_SHARE: f64 = 0.6;
/// Places on either side of a label that also count as right.
const BESIDE: usize = 1;

impl Recognizer {
    /// Chooses the temperature with the highest sum of log score and log-prior, given what was
    /// learned from all labels: each half of the labelled part is scored with what was learned from
    /// the other. `self` is the recogniser before learning.
    ///
    /// The steps at which temperatures differ decide the sum: easy steps score alike at all of
    /// them, and a step that is lost at all of them is bounded.
    pub(super) fn fit_temperature<Q: AsRef<[f32]>>(
        &self,
        mut fit: Parameters,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Parameters, RecognitionError> {
        let mut halves: [Vec<LabelledPart<'_, Q>>; 2] = [Vec::new(), Vec::new()];
        for part in parts {
            let middle = part.queries.len() / 2;
            let (first, last) = (part.cut(0, middle), part.cut(middle, part.queries.len()));
            halves[0].push(first);
            halves[1].push(last);
        }
        let long = |half: &Vec<LabelledPart<'_, Q>>| {
            let steps = half.iter().map(|part| part.places.len().saturating_sub(BURN_IN));
            steps.sum::<usize>() >= HALF && self.check_labels(half).is_ok()
        };
        // Too few labels to hold out a half: the temperature stays.
        if !halves.iter().all(long) {
            return Ok(fit);
        }
        let mut options = Vec::new();
        for factor in FACTORS {
            let temperature = fit.options.odds.temperature() * factor;
            let Ok(odds) = fit.options.odds.with_temperature(temperature) else {
                return Ok(fit);
            };
            options.push(Options { odds, ..fit.options.clone() });
        }
        let learned = [self.fit_at_temperature(&halves[1])?, self.fit_at_temperature(&halves[0])?];
        let (mut scores, mut shares) = (Vec::new(), Vec::new());
        for (options, factor) in options.iter().zip(FACTORS) {
            // Log-density of a normal prior of ln factor, centred at the present temperature.
            let mut score = -0.5 * (factor.ln() / DEVIATION).powi(2);
            let (mut steps, mut unlikely) = (0_u32, 0_u32);
            for (learned, half) in learned.iter().zip(&halves) {
                let own = learned.options().clone();
                let options = Options { odds: options.odds, ..own };
                let tried = learned.parameters().clone().with_options(options);
                for mass in learned.with_parameters(tried)?.label_masses(half)? {
                    score += mass.max(LEAST).ln() / STEPS_PER_WITNESS;
                    steps += 1;
                    unlikely += u32::from(mass < UNLIKELY);
                }
            }
            scores.push(score);
            shares.push(f64::from(unlikely) / f64::from(steps));
        }
        // Hottest first, and a later one must be strictly better, so a tie goes to the hotter, less
        // sure one.
        let better = |best: usize, at: usize| if scores[at] > scores[best] { at } else { best };
        let chosen = (0..FACTORS.len()).fold(0, better);
        let temperatures: Vec<f64> =
            options.iter().map(|options| options.odds.temperature()).collect();
        let at_edge = chosen == 0 || chosen + 1 == FACTORS.len();
        let edge = at_edge.then(|| Warning::Edge { temperature: temperatures[chosen] });
        let share = shares[chosen];
        let contradicted = (share > CONTRADICTED_SHARE).then_some(Warning::Contradicted { share });
        fit.warnings.extend(contradicted.into_iter().chain(edge));
        fit.temperature_scores = temperatures.into_iter().zip(scores).collect();
        fit.options = options.swap_remove(chosen);
        Ok(fit)
    }

    /// Probabilities that the filter gives to labels, without the first steps of each part.
    fn label_masses<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Vec<f64>, RecognitionError> {
        let mut masses = Vec::new();
        for part in parts {
            let beliefs = self.recording(part.queries, part.odometry)?.filtered()?;
            for (at, places) in part.places.iter().enumerate().skip(BURN_IN) {
                let beside = |range: &std::ops::RangeInclusive<usize>| {
                    range.start().saturating_sub(BESIDE)..=range.end().saturating_add(BESIDE)
                };
                masses.push(beliefs.mass(at, places.as_ref().map(beside).as_ref()));
            }
        }
        Ok(masses)
    }
}
