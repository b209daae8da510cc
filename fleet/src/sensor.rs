//! The sensors whose observations come in columns, as one type.

use std::error::Error;

use arrow_buffer::ScalarBuffer;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::Value;
use wayfix::likelihood::{LearnLikelihood, SparseObservation, SparseTableLikelihood};
use wayfix::{
    Diagonal, Likelihood, LikelihoodError, LikelihoodVector, Scratch, SparseLikelihood,
    TableLikelihood,
};

use crate::places::{Fix, Places, VERSION};

/// Observation of one step.
#[derive(Debug, Clone, PartialEq)]
pub enum Observation {
    /// Nothing was observed: a null, which an optional sensor allows.
    Missing,
    /// A symbol of a table, from 0.
    Symbol(usize),
    /// Likelihoods of all states, or their logarithms; shares the memory of its column.
    Vector(ScalarBuffer<f64>),
    /// Likelihoods of a few states.
    Sparse(SparseObservation),
    /// A measured position.
    Fix(Fix),
}

/// Kind of a sensor, which determines the type of its observations.
#[derive(Debug, Clone)]
pub enum Kind {
    /// A symbol per step.
    Table(TableLikelihood),
    /// A symbol per step, with a table that lists few states for each symbol.
    SparseTable(SparseTableLikelihood),
    /// A list of likelihoods per step, or of their logarithms.
    Vector {
        /// The sensor.
        vector: LikelihoodVector,
        /// True for logarithms.
        log: bool,
    },
    /// A list of states and their likelihoods per step.
    Sparse(SparseLikelihood),
    /// A position per step.
    Places(Places),
}

/// A sensor of the library as stored in a model file, or [`Places`].
///
/// In a file it has the format of the library: that of a `TableLikelihood`, `LikelihoodVector`,
/// `SparseLikelihood` or `SparseTableLikelihood`, or of an `OptionalLikelihood` around one of
/// these, which allows nulls.
#[derive(Debug, Clone)]
pub struct Sensor {
    kind: Kind,
    optional: bool,
    /// Likelihoods of a missing observation: all ones, since it says nothing about the state.
    ones: Vec<f64>,
}

impl Sensor {
    /// Creates a sensor; `optional` allows missing observations.
    #[must_use]
    pub fn new(kind: Kind, optional: bool) -> Self {
        let ones = if optional { vec![1.0; kind.states()] } else { Vec::new() };
        Self { kind, optional, ones }
    }

    /// Kind of the sensor.
    #[must_use]
    pub fn kind(&self) -> &Kind {
        &self.kind
    }

    /// True if observations may be missing.
    #[must_use]
    pub fn is_optional(&self) -> bool {
        self.optional
    }
}

impl Kind {
    fn states(&self) -> usize {
        match self {
            Self::Table(table) => table.states(),
            Self::SparseTable(table) => table.states(),
            Self::Vector { vector, .. } => vector.states(),
            Self::Sparse(sparse) => sparse.states(),
            Self::Places(places) => places.states(),
        }
    }
}

/// Error for an observation of another kind than the sensor.
#[derive(Debug, thiserror::Error)]
#[error("the observation is not of the kind that the sensor takes")]
struct OtherKind;

impl Likelihood for Sensor {
    type Observation = Observation;

    fn states(&self) -> usize {
        self.kind.states()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        match (&self.kind, observation) {
            (Kind::Table(table), Observation::Symbol(symbol)) => table.diagonal(symbol, scratch),
            (Kind::SparseTable(table), Observation::Symbol(symbol)) => {
                table.diagonal(symbol, scratch)
            }
            (Kind::Vector { vector, .. }, Observation::Vector(values)) => {
                vector.diagonal(values, scratch)
            }
            (Kind::Sparse(sparse), Observation::Sparse(listed)) => sparse.diagonal(listed, scratch),
            (Kind::Places(places), Observation::Fix(fix)) => places.diagonal(fix, scratch),
            (_, Observation::Missing) if self.optional => Ok(Diagonal::linear(&self.ones)),
            _ => Err(LikelihoodError::sensor(OtherKind)),
        }
    }

    fn is_precomputed(&self) -> bool {
        match &self.kind {
            Kind::Table(table) => table.is_precomputed(),
            Kind::SparseTable(table) => table.is_precomputed(),
            Kind::Vector { vector, .. } => vector.is_precomputed(),
            Kind::Sparse(sparse) => sparse.is_precomputed(),
            Kind::Places(places) => places.is_precomputed(),
        }
    }
}

/// A table is learned; all other sensors stay as they are.
impl LearnLikelihood for Sensor {
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        match &self.kind {
            Kind::Table(table) => table.statistics(),
            _ => Vec::new(),
        }
    }

    fn add(&self, statistics: &mut Vec<f64>, observation: &Observation, posterior: &[f64]) {
        // A missing observation adds nothing: it is as likely in every state.
        if let (Kind::Table(table), Observation::Symbol(symbol)) = (&self.kind, observation) {
            table.add(statistics, symbol, posterior);
        }
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        // Empty for sensors that are not learned.
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut learned = self.clone();
        if let Kind::Table(table) = &self.kind {
            learned.kind = Kind::Table(table.maximize(statistics, pseudo_count)?);
        }
        Ok(learned)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        match &self.kind {
            Kind::Table(table) => table.log_prior(pseudo_count),
            _ => 0.0,
        }
    }

    fn free_parameters(&self) -> usize {
        match &self.kind {
            Kind::Table(table) => table.free_parameters(),
            _ => 0,
        }
    }
}

impl Serialize for Sensor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Optional<'a> {
            version: u32,
            sensor: &'a Kind,
        }
        if self.optional {
            // The format of the library's `OptionalLikelihood`.
            return Optional { version: VERSION, sensor: &self.kind }.serialize(serializer);
        }
        self.kind.serialize(serializer)
    }
}

impl Serialize for Kind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Table(table) => table.serialize(serializer),
            Self::SparseTable(table) => table.serialize(serializer),
            Self::Vector { vector, .. } => vector.serialize(serializer),
            Self::Sparse(sparse) => sparse.serialize(serializer),
            Self::Places(places) => places.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Sensor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut value = Value::deserialize(deserializer)?;
        let inner = value.get_mut("sensor").map(Value::take);
        let optional = inner.is_some();
        let kind = kind(inner.unwrap_or(value)).map_err(de::Error::custom)?;
        Ok(Self::new(kind, optional))
    }
}

/// Reads a sensor; the fields present tell its kind.
fn kind(value: Value) -> Result<Kind, String> {
    fn read<T: de::DeserializeOwned>(value: Value) -> Result<T, String> {
        serde_json::from_value(value).map_err(|error| format!("the sensor: {error}"))
    }
    let has = |field: &str| value.get(field).is_some();
    // Each of these fields belongs to one format only, except `states`, which other formats also
    // have, so it comes last.
    if has("rows") {
        read(value).map(Kind::Table)
    } else if has("symbols") {
        read(value).map(Kind::SparseTable)
    } else if has("log") {
        let log = value["log"] == Value::Bool(true);
        read(value).map(|vector| Kind::Vector { vector, log })
    } else if has("places") {
        read(value).map(Kind::Places)
    } else if has("states") {
        read(value).map(Kind::Sparse)
    } else {
        Err("the sensor is not one of TableLikelihood (`rows`), LikelihoodVector (`log`), \
             SparseLikelihood (`states`), SparseTableLikelihood (`symbols`), places (`places`) or \
             an OptionalLikelihood of these (`sensor`)"
            .to_owned())
    }
}
