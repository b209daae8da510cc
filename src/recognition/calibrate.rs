//! A cautious choice of the temperature, by the filter's log score in blocks of labels.

use super::fit::Calibrated;
use super::labels::LabelledPart;
use super::warning::Warning;
use super::{Options, RecognitionError, Recognizer};

/// Candidate factors of the temperature.
const FACTORS: [f64; 5] = [2.0, 1.4, 1.0, 0.7, 0.5];
const UNCHANGED: usize = 2;
/// Most blocks that labelled steps are cut into, and the fewest steps of a block.
const BLOCKS: usize = 4;
const BLOCK: usize = 25;
/// Least gain in every block, in nats a step, for a hotter temperature; and for a colder one.
const WORTH: f64 = 0.02;
const WORTH_COLDER: f64 = 0.05;
/// Steps left out at the beginning of a part, in which the vehicle is still being localised.
const FINDING: usize = 10;
/// Places on either side of a label that count as right, too.
const BESIDE: usize = 1;

impl Recognizer {
    /// Chooses the temperature with the largest gain in its worst block, or leaves it as it is.
    ///
    /// Another temperature must be better in **every** block of the labelled part: easy parts
    /// score alike at all temperatures, and are no reason to be colder.
    pub(super) fn calibrate<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<(Options, Option<Calibrated>, Option<Warning>), RecognitionError> {
        let before = self.options().clone();
        let steps: usize = parts.iter().map(|part| part.places.len().saturating_sub(FINDING)).sum();
        let blocks = (steps / BLOCK).min(BLOCKS);
        if blocks < 2 {
            return Ok((before, None, None));
        }
        let mut options = Vec::new();
        for factor in FACTORS {
            let temperature = before.odds.temperature() * factor;
            let Ok(odds) = before.odds.with_temperature(temperature) else {
                return Ok((before, None, None));
            };
            options.push(Options { odds, ..before.clone() });
        }
        let mut scores = Vec::new();
        for options in &options {
            let all = self.log_scores(options, parts)?;
            let cut = |block: usize| block * all.len() / blocks;
            let mean = |block: usize| {
                let block = &all[cut(block)..cut(block + 1)];
                block.iter().sum::<f64>() / block.len() as f64
            };
            scores.push((0..blocks).map(mean).collect::<Vec<f64>>());
        }
        let gain = |at: usize| {
            let pairs = scores[at].iter().zip(&scores[UNCHANGED]);
            pairs.map(|(a, b)| a - b).fold(f64::INFINITY, f64::min)
        };
        let better = |best: usize, at: usize| {
            let worth = if at < UNCHANGED { WORTH } else { WORTH_COLDER };
            let least = if best == UNCHANGED { worth } else { worth.max(gain(best)) };
            if gain(at) > least { at } else { best }
        };
        let chosen = (0..FACTORS.len()).fold(UNCHANGED, better);
        let temperatures: Vec<f64> =
            options.iter().map(|options| options.odds.temperature()).collect();
        let at_edge = chosen == 0 || chosen + 1 == FACTORS.len();
        let edge = at_edge.then(|| Warning::Edge { temperature: temperatures[chosen] });
        let calibrated = Calibrated { temperatures, scores, chosen };
        Ok((options.swap_remove(chosen), Some(calibrated), edge))
    }

    /// Log-probability that the filter gives to the truth at each labelled step, without the
    /// first steps of each part.
    fn log_scores<Q: AsRef<[f32]>>(
        &self,
        options: &Options,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Vec<f64>, RecognitionError> {
        let recognizer = self.with_fit(self.fit().clone().with_options(options.clone()))?;
        let mut scores = Vec::new();
        for part in parts {
            let beliefs = recognizer.recording(part.queries, part.odometry)?.filtered()?;
            for (at, places) in part.places.iter().enumerate().skip(FINDING) {
                let beside = |range: &std::ops::RangeInclusive<usize>| {
                    range.start().saturating_sub(BESIDE)..=range.end().saturating_add(BESIDE)
                };
                let mass = beliefs.mass(at, places.as_ref().map(beside).as_ref());
                scores.push(mass.max(f64::MIN_POSITIVE).ln());
            }
        }
        Ok(scores)
    }
}
