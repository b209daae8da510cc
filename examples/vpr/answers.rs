//! From beliefs to answers: where, and how probably.

use wayfix::{BeliefView, GroupError, Groups};

use super::estimate::Task;
use super::recording::Answers;

impl Task<'_> {
    /// The answer of a belief: off the map, if that is more probable than not.
    pub(super) fn place(&self, belief: &[f64]) -> Option<usize> {
        let n = self.recording.references;
        let on_map = belief.get(n).is_none_or(|off| *off <= 0.5);
        on_map.then(|| mode(&belief[..n]))
    }

    /// The probability that a place is right to a tolerance, or of off the map.
    pub(super) fn mass_near(&self, belief: &[f64], place: Option<usize>, tolerance: usize) -> f64 {
        let (n, tolerance) = (self.recording.references, tolerance.saturating_add(self.width));
        let Some(place) = place else { return belief.get(n).copied().unwrap_or(0.0) };
        let sum = if self.recording.closed {
            let near = |i: &usize| {
                let apart = i.abs_diff(place);
                apart.min(n - apart) <= tolerance
            };
            (0..n).filter(near).map(|i| belief[i]).sum::<f64>()
        } else {
            let end = place.saturating_add(tolerance).saturating_add(1).min(n);
            belief[place.saturating_sub(tolerance)..end].iter().sum()
        };
        sum.min(1.0)
    }

    /// The probability of what is true.
    pub(super) fn true_mass(&self, belief: &[f64], step: usize, tolerance: usize) -> f64 {
        let n = self.recording.references;
        if self.recording.truth[step].is_none() {
            return belief.get(n).copied().unwrap_or(0.0);
        }
        let right = (0..n).filter(|i| self.recording.is_right(step, Some(*i), tolerance));
        right.map(|i| belief[i]).sum::<f64>().min(1.0)
    }

    pub(super) fn answers(&self, method: &str, beliefs: &[Vec<f64>]) -> Answers {
        let n = self.recording.references;
        let places = beliefs.iter().map(|belief| self.place(belief)).collect();
        let truth = |tolerance: &usize| {
            let steps = beliefs.iter().enumerate();
            steps.map(|(step, belief)| self.true_mass(belief, step, *tolerance)).collect()
        };
        let on_map = || beliefs.iter().map(|belief| 1.0 - belief[n].min(1.0)).collect();
        Answers {
            truth_mass: Some(self.settings.tolerances.iter().map(truth).collect()),
            on_map: self.settings.off_map.then(on_map),
            ..self.answers_at(method, places, beliefs)
        }
    }

    /// The best path, as probable as the smoother thinks.
    pub(super) fn path_answers(&self, path: &[usize], smoothed: &[Vec<f64>]) -> Answers {
        let n = self.recording.references;
        let places = path.iter().map(|place| (*place < n).then_some(*place)).collect();
        self.answers_at("viterbi", places, smoothed)
    }

    /// Places, as probable as the beliefs say.
    fn answers_at(
        &self,
        method: &str,
        places: Vec<Option<usize>>,
        beliefs: &[Vec<f64>],
    ) -> Answers {
        let near = |tolerance: &usize| {
            let pairs = beliefs.iter().zip(&places);
            pairs.map(|(belief, place)| self.mass_near(belief, *place, *tolerance)).collect()
        };
        let probability: Vec<Vec<f64>> = self.settings.tolerances.iter().map(near).collect();
        Answers {
            method: method.into(),
            confidence: probability[0].clone(),
            probability: Some(probability),
            places,
            ..Answers::default()
        }
    }
}

/// The probability of each group.
pub(super) fn places(groups: &Groups, belief: BeliefView<'_>) -> Result<Vec<f64>, GroupError> {
    Ok(groups.marginal(&belief)?.into_vec())
}

fn mode(values: &[f64]) -> usize {
    let better = |best: usize, i: usize| if values[i] > values[best] { i } else { best };
    (0..values.len()).fold(0, better)
}
