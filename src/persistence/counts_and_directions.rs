//! Formats of families of counts, durations and directions.

use super::stored;
use crate::emission;

stored! {
    [] Bernoulli in emission: [], |family| {
        probabilities: Vec<Vec<f64>> = family.probabilities(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::Bernoulli, f64)> = family.prior(),
    } => Self::new(&probabilities).and_then(|family| family.restored(missing, prior));

    [] Multinomial in emission: [], |family| {
        probabilities: Vec<Vec<f64>> = family.probabilities(),
        missing: bool = family.takes_missing(),
        trials: u32 = family.trials(),
    } => Self::new(&probabilities).map(|family| family.restored(missing, trials));

    [] Poisson in emission: [], |family| {
        rates: Vec<Vec<f64>> = family.rates(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::Poisson, f64)> = family.prior(),
    } => Self::new(&rates).and_then(|family| family.restored(missing, prior));

    [] Gamma in emission: [], |family| {
        shapes: Vec<Vec<f64>> = family.shapes(),
        scales: Vec<Vec<f64>> = family.scales(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::Gamma, f64)> = family.prior(),
    } => Self::new(&shapes, &scales).and_then(|family| family.restored(missing, prior));

    [] LogNormal in emission: [], |family| {
        means: Vec<Vec<f64>> = family.means(),
        deviations: Vec<Vec<f64>> = family.deviations(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::LogNormal, f64)> = family.prior(),
    } => Self::new(&means, &deviations).and_then(|family| family.restored(missing, prior));

    [] VonMises in emission: [], |family| {
        means: Vec<Vec<f64>> = family.means(),
        concentrations: Vec<Vec<f64>> = family.concentrations(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::VonMises, f64)> = family.prior(),
    } => Self::new(&means, &concentrations).and_then(|family| family.restored(missing, prior));

    [] VonMisesFisher in emission: [], |family| {
        means: Vec<Vec<f64>> = family.means(),
        concentrations: Vec<f64> = family.concentrations(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::VonMisesFisher, f64)> = family.prior(),
    } => Self::new(&means, &concentrations).and_then(|family| family.restored(missing, prior));
}
