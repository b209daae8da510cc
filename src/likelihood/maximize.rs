//! Re-estimation of the sensors of this module, the M-step of Baum-Welch: tables by shares of
//! expected counts, compositions by their parts.

use std::error::Error;

use super::{
    FusedLikelihood, GroupedLikelihood, LearnLikelihood, Likelihood, OptionalLikelihood,
    SparseLikelihood, SparseObservation, TableLikelihood,
};
use crate::fixed::Fixed;
use crate::free_parameters::{Displacement, FreeParameters};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Probabilities in proportion to counts plus a pseudo-count. Those of 0 stay 0, and without counts
/// all stay as they are.
#[must_use]
pub fn shares(old: &[f64], counts: &[f64], pseudo_count: f64) -> Vec<f64> {
    let pairs = old.iter().zip(counts);
    let weight = |(p, count): (&f64, &f64)| if *p > 0.0 { count + pseudo_count } else { 0.0 };
    let weights: Vec<f64> = pairs.map(weight).collect();
    let sum: f64 = weights.iter().sum();
    // False for a NaN, which then spreads to the row, and is reported where the row is checked.
    if sum < f64::MIN_POSITIVE {
        return old.to_vec();
    }
    weights.iter().map(|weight| weight / sum).collect()
}

impl LearnLikelihood for TableLikelihood {
    /// Expected counts of symbol y in state i, at y n + i.
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        vec![0.0; self.columns.len()]
    }

    // Called for each step of each sequence; with few states a call costs more than the sums.
    #[inline]
    fn add(&self, statistics: &mut Vec<f64>, &symbol: &usize, posterior: &[f64]) {
        let column = &mut statistics[symbol * posterior.len()..];
        column.iter_mut().zip(posterior).for_each(|(sum, p)| *sum += p);
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(&self, statistics: &Vec<f64>, pseudo_count: f64) -> Outcome<Self> {
        let row = |state: usize| {
            let row = |all: &[f64]| -> Vec<f64> {
                all[state..].iter().step_by(self.states()).copied().collect()
            };
            // A NaN is reported by the table's own check.
            shares(&row(&self.columns), &row(statistics), pseudo_count)
        };
        let rows: Vec<Vec<f64>> = (0..self.states()).map(row).collect();
        Self::from_rows(&rows).map_err(Into::into)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        // The usual case, which need not compute n m logarithms.
        if pseudo_count == 0.0 {
            return 0.0;
        }
        let possible = self.columns.iter().filter(|p| **p > 0.0);
        pseudo_count * possible.map(|p| p.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        // Each row sums to one, which determines one of its values.
        self.columns.iter().filter(|p| **p > 0.0).count() - self.states()
    }
}

/// Log-odds of the probabilities above 0, row by row, against the largest of the row. Those of 0
/// count as being at a bound.
impl FreeParameters for TableLikelihood {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let mut rows = self.to_rows();
        rows.iter_mut().for_each(|row| by.distribution(row));
        Self::from_rows(&rows).map_err(Into::into)
    }
}

/// Implements learning for a wrapper by learning its inner sensor. `$add` turns the observation and
/// posterior of the wrapper into those of the inner sensor, `$with` rebuilds the wrapper.
macro_rules! learns_the_inner {
    ($($wrapper:ident [$($bound:tt)*], $inner:tt,
        add($self:ident, $statistics:ident, $y:ident, $posterior:ident) $add:expr,
        with($learned:ident) $with:expr;)*) => {$(
        impl<B: LearnLikelihood<$($bound)*>> LearnLikelihood for $wrapper<B> {
            type Statistics = B::Statistics;

            fn statistics(&self) -> B::Statistics {
                self.$inner.statistics()
            }

            fn add(&$self, $statistics: &mut B::Statistics, $y: &Self::Observation, $posterior: &[f64]) {
                $add
            }

            fn merge(&self, statistics: &mut B::Statistics, other: &B::Statistics) {
                self.$inner.merge(statistics, other);
            }

            fn maximize(&$self, statistics: &B::Statistics, pseudo_count: f64) -> Outcome<Self> {
                let $learned = $self.$inner.maximize(statistics, pseudo_count)?;
                Ok($with)
            }

            fn log_prior(&self, pseudo_count: f64) -> f64 {
                self.$inner.log_prior(pseudo_count)
            }

            fn free_parameters(&self) -> usize {
                self.$inner.free_parameters()
            }
        }

        /// Parameters of the inner sensor.
        impl<B: FreeParameters> FreeParameters for $wrapper<B> {
            fn displaced(&$self, by: &mut Displacement<'_>) -> Outcome<Self> {
                let $learned = $self.$inner.displaced(by)?;
                Ok($with)
            }
        }
    )*};
}

// A missing observation adds nothing; a group has the sum of the probabilities of its states.
learns_the_inner! {
    OptionalLikelihood [Observation: Sized], sensor,
        add(self, statistics, y, posterior) if let Some(y) = y {
            self.sensor.add(statistics, y, posterior);
        },
        with(sensor) Self { sensor, ones: self.ones.clone() };
    GroupedLikelihood [], sensor,
        add(self, statistics, y, posterior) {
            let mut groups = vec![0.0; self.groups.count()];
            let states = self.groups.as_slice().iter().zip(posterior);
            states.for_each(|(&group, p)| groups[group] += p);
            self.sensor.add(statistics, y, &groups);
        },
        with(sensor) Self { sensor, groups: self.groups.clone() };
}

impl<B1, B2> LearnLikelihood for FusedLikelihood<B1, B2>
where
    B1: LearnLikelihood<Observation: Sized>,
    B2: LearnLikelihood<Observation: Sized>,
{
    type Statistics = (B1::Statistics, B2::Statistics);

    fn statistics(&self) -> Self::Statistics {
        (self.first.statistics(), self.second.statistics())
    }

    fn add(&self, statistics: &mut Self::Statistics, y: &Self::Observation, posterior: &[f64]) {
        self.first.add(&mut statistics.0, &y.0, posterior);
        self.second.add(&mut statistics.1, &y.1, posterior);
    }

    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
        self.first.merge(&mut statistics.0, &other.0);
        self.second.merge(&mut statistics.1, &other.1);
    }

    // ln (b₁ b₂) is a sum, so each part is maximised by itself.
    fn maximize(&self, statistics: &Self::Statistics, pseudo_count: f64) -> Outcome<Self> {
        Ok(Self {
            first: self.first.maximize(&statistics.0, pseudo_count)?,
            second: self.second.maximize(&statistics.1, pseudo_count)?,
        })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        self.first.log_prior(pseudo_count) + self.second.log_prior(pseudo_count)
    }

    fn free_parameters(&self) -> usize {
        self.first.free_parameters() + self.second.free_parameters()
    }
}

/// Parameters of the first sensor, then of the second.
impl<B1: FreeParameters, B2: FreeParameters> FreeParameters for FusedLikelihood<B1, B2> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let (first, second) = (self.first.displaced(by)?, self.second.displaced(by)?);
        Ok(Self { first, second })
    }
}

/// It has no free parameters.
impl FreeParameters for SparseLikelihood {
    fn displaced(&self, _: &mut Displacement<'_>) -> Outcome<Self> {
        Ok(*self)
    }
}

/// Does nothing, since there is nothing to learn. [Known states](SparseObservation::known), fused
/// with another sensor, make learning semi-supervised.
impl LearnLikelihood for SparseLikelihood {
    type Statistics = ();

    fn statistics(&self) {}

    fn add(&self, (): &mut (), _: &SparseObservation, _: &[f64]) {}

    fn merge(&self, (): &mut (), (): &()) {}

    fn maximize(&self, (): &(), _: f64) -> Outcome<Self> {
        Ok(*self)
    }

    fn free_parameters(&self) -> usize {
        0
    }
}

impl<B: Likelihood + Clone> LearnLikelihood for Fixed<B> {
    type Statistics = ();

    fn statistics(&self) {}

    fn add(&self, (): &mut (), _: &B::Observation, _: &[f64]) {}

    fn merge(&self, (): &mut (), (): &()) {}

    fn maximize(&self, (): &(), _: f64) -> Outcome<Self> {
        Ok(self.clone())
    }

    fn free_parameters(&self) -> usize {
        0
    }
}
