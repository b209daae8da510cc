//! [`GroupedLikelihood`], a sensor that observes only the group of a state. The sensor is evaluated
//! once per group, and its values are copied to the states.

use rand::Rng;

use super::Values;
use super::{Diagonal, Likelihood, SampleObservation, Scratch};
use crate::error::{HmmError, LikelihoodError};
use crate::groups::Groups;
use wayfix_kernels::{self as kernels, Valid};

/// A sensor of groups as a sensor of states: all states of a group have the likelihood of the
/// group. For a camera that observes the place, but not how long the vehicle has been there or
/// where it is heading.
///
/// Costs O(n) a step on top of the inner sensor.
///
/// ```
/// use wayfix::likelihood::GroupedLikelihood;
/// use wayfix::likelihood::Groups;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
///
/// // Two states of place 0 and one of place 1.
/// let camera = TableLikelihood::from_rows(&[[0.75, 0.25], [0.25, 0.75]])?;
/// let camera = GroupedLikelihood::new(camera, Groups::new(vec![0, 0, 1])?)?;
/// let prior = Prior::AtFirstObservation(Belief::new(vec![0.25, 0.25, 0.5])?);
/// let hmm = Hmm::new(prior, DenseTransition::from_fn(3, |_, _| 1.0 / 3.0)?, camera)?;
/// let mut filter = hmm.filter();
/// filter.step(&1)?;
/// assert_eq!(filter.belief().as_slice(), [0.125, 0.125, 0.75]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct GroupedLikelihood<B> {
    pub(crate) sensor: B,
    pub(super) groups: Groups,
}

impl<B: Likelihood> GroupedLikelihood<B> {
    /// Creates a sensor from one whose states are the groups.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the sensor does not have one state per group.
    pub fn new(sensor: B, groups: Groups) -> Result<Self, HmmError> {
        let (found, expected) = (sensor.states(), groups.count());
        if found != expected {
            let (part, first) = ("sensor", "number of groups");
            return Err(HmmError::StateCount { part, found, first, expected });
        }
        Ok(Self { sensor, groups })
    }

    /// Returns the sensor of the groups.
    #[must_use]
    pub fn sensor(&self) -> &B {
        &self.sensor
    }

    /// Returns the groups of states.
    pub fn groups(&self) -> &Groups {
        &self.groups
    }
}

impl<B: Likelihood> Likelihood for GroupedLikelihood<B> {
    type Observation = B::Observation;

    fn states(&self) -> usize {
        self.groups.as_slice().len()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let n = self.states();
        let (states, parts) = scratch.with_parts(n, 2);
        let (inner, logs) = parts.split_at_mut(1);
        let diagonal = self.sensor.diagonal(observation, &mut inner[0])?;
        let (found, expected) = (diagonal.len(), self.groups.count());
        if found != expected {
            return Err(LikelihoodError::WrongLength { found, expected });
        }
        let expand = |groups: &[f64], out: &mut [f64]| self.groups.expand(groups, out);
        let values = match diagonal.values {
            // Checked here once per group instead of once per state. An invalid value is passed on
            // unchecked, so that the caller finds it and names the state.
            Values::Linear(groups) => {
                expand(groups, states);
                match kernels::largest(groups, Valid::Likelihoods) {
                    Ok(largest) => Values::Checked { linear: states, largest, log2: None },
                    Err(_) => Values::Linear(states),
                }
            }
            Values::Log(groups) => {
                expand(groups, states);
                Values::Log(states)
            }
            // No group is empty, so the maximum over the states is that over the groups.
            Values::Checked { linear, largest, log2 } => {
                expand(linear, states);
                let log2 = log2.map(|log2| {
                    let out = logs[0].values(n);
                    expand(log2, out);
                    &*out
                });
                Values::Checked { linear: states, largest, log2 }
            }
        };
        Ok(Diagonal { values, ..diagonal })
    }

    fn by_groups<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Option<Result<(Diagonal<'a>, &'a Groups), LikelihoodError>> {
        let diagonal = self.sensor.diagonal(observation, scratch);
        Some(diagonal.map(|diagonal| (diagonal, &self.groups)))
    }
}

impl<B: SampleObservation> SampleObservation for GroupedLikelihood<B> {
    type Sample = B::Sample;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> B::Sample {
        self.sensor.sample(self.groups.as_slice()[state], rng)
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [B: Likelihood] GroupedLikelihood<B>: [B], |grouped| {
        sensor: B = grouped.sensor,
        groups: Groups = grouped.groups(),
    } => Self::new(sensor, groups);
}
