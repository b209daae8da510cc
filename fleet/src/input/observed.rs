//! Observations of many steps, in columns.
//!
//! Types, lengths and ranges are checked once for all steps when the columns are read, so
//! [`Observed::get`] can index without doubt. Values of likelihoods are left to the sensor.

use std::ops::Range;

use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, Float64Array, Int64Array};
use arrow_buffer::{NullBuffer, ScalarBuffer};
use wayfix::Likelihood;
use wayfix::likelihood::SparseObservation;

use super::lists::{Locate, integers, lists, no_nulls, numbers};
use crate::error::{FleetError, Outcome};
use crate::places::Fix;
use crate::sensor::{Kind, Observation, Sensor};

/// Observations of consecutive steps, in columns.
#[derive(Debug)]
pub struct Observed {
    column: String,
    missing: Option<NullBuffer>,
    values: Values,
}

#[derive(Debug)]
enum Values {
    Symbols(Int64Array),
    /// Likelihoods or their logarithms: the first of each step and at the end their number, and the
    /// values.
    Vectors(Vec<usize>, ScalarBuffer<f64>),
    Sparse {
        offsets: Vec<usize>,
        states: Int64Array,
        likelihoods: Float64Array,
        elsewhere: Option<Float64Array>,
    },
    Fixes([Float64Array; 3]),
}

impl Observed {
    /// Name of the column of the observations.
    #[must_use]
    pub fn column(&self) -> &str {
        &self.column
    }

    /// Reads the columns of a sensor, each with a value per step.
    pub(super) fn new(
        sensor: &Sensor,
        columns: &[(&str, ArrayRef)],
        locate: Locate<'_>,
    ) -> Outcome<Self> {
        let (column, array) = (columns[0].0, &columns[0].1);
        // Only the first column tells whether a step has an observation. `logical_nulls`: a
        // dictionary has its nulls in the values.
        let missing = array.logical_nulls().filter(|nulls| nulls.null_count() > 0);
        if !sensor.is_optional() {
            no_nulls(array, column, locate)?;
        }
        let refuse = |element: usize, message: String| {
            let (row, message) = locate(element, &message);
            Err(FleetError::value(column, row, message))
        };
        // A missing observation may leave anything in the other columns, and an empty list in this
        // one.
        let is_there = |k: usize| missing.as_ref().is_none_or(|missing| missing.is_valid(k));
        let values = match sensor.kind() {
            Kind::Table(table) => symbols(array, table.symbols(), column, locate)?,
            Kind::SparseTable(table) => symbols(array, table.symbols(), column, locate)?,
            Kind::Vector { vector, .. } => {
                let lists = lists(array);
                let offsets = lists.offsets.clone();
                let inner = in_list(&offsets, locate);
                let values = numbers(&lists.values, column, &inner)?;
                no_nulls(&values, column, &inner)?;
                let states = vector.states();
                let lengths = lists.offsets.windows(2).map(|pair| pair[1] - pair[0]);
                // A likelihood for each state, no more and no fewer: checked here, because only
                // here is the row known.
                let wrong = |&(k, length): &(usize, usize)| length != states && is_there(k);
                if let Some((element, length)) = lengths.enumerate().find(wrong) {
                    let message = format!(
                        "has {length} values, expected one for each of the {states} states of the \
                         model"
                    );
                    return refuse(element, message);
                }
                Values::Vectors(lists.offsets, values.values().clone())
            }
            Kind::Sparse(sparse) => {
                let lists = lists(array);
                let offsets = lists.offsets.clone();
                let inner = in_list(&offsets, locate);
                // The fields inside a null struct need not be null, so their own checks would miss
                // the struct.
                no_nulls(&lists.values, column, &inner)?;
                let fields = lists.values.as_struct();
                let field = |name: &str| {
                    fields.column_by_name(name).ok_or_else(|| {
                        FleetError::column(column, format!("has no field `{name}` in its structs"))
                    })
                };
                let states = integers(field("state")?, column, &inner)?;
                let likelihoods = numbers(field("likelihood")?, column, &inner)?;
                no_nulls(&states, column, &inner)?;
                no_nulls(&likelihoods, column, &inner)?;
                let count = sparse.states();
                let outside = |state: &i64| state.cast_unsigned() >= count as u64; // also if negative
                if let Some(at) = states.values().iter().position(outside) {
                    let (row, message) = inner(
                        at,
                        &format!(
                            "lists state {}, but the model has {count} states (0 to {})",
                            states.value(at),
                            count.saturating_sub(1)
                        ),
                    );
                    return Err(FleetError::value(column, row, message));
                }
                let elsewhere = match columns.get(1) {
                    // Without the column, states that are not listed have likelihood 0.
                    None => None,
                    Some((name, array)) => {
                        let array = numbers(array, name, locate)?;
                        no_nulls(&array, name, locate)?;
                        Some(array)
                    }
                };
                Values::Sparse { offsets: lists.offsets, states, likelihoods, elsewhere }
            }
            Kind::Places(_) => {
                // The other two columns must have a value wherever the first one has one.
                let read = |(name, array): &(&str, ArrayRef)| {
                    let array = numbers(array, name, locate)?;
                    if let Some(k) = (0..array.len()).find(|&k| array.is_null(k) && is_there(k)) {
                        let (row, message) = locate(k, "is null, expected a value");
                        return Err(FleetError::value(name, row, message));
                    }
                    Ok(array)
                };
                Values::Fixes([read(&columns[0])?, read(&columns[1])?, read(&columns[2])?])
            }
        };
        Ok(Self { column: column.to_owned(), missing, values })
    }

    /// Observations of a range of steps.
    pub(super) fn part(&self, steps: Range<usize>) -> Self {
        let (first, count) = (steps.start, steps.len());
        // Only offsets are cut. They keep pointing into the whole column of values, which is
        // shared.
        let lists = |offsets: &[usize]| offsets[first..=first + count].to_vec();
        let values = match &self.values {
            Values::Symbols(symbols) => Values::Symbols(symbols.slice(first, count)),
            Values::Vectors(offsets, values) => Values::Vectors(lists(offsets), values.clone()),
            Values::Sparse { offsets, states, likelihoods, elsewhere } => Values::Sparse {
                offsets: lists(offsets),
                states: states.clone(),
                likelihoods: likelihoods.clone(),
                elsewhere: elsewhere.as_ref().map(|values| values.slice(first, count)),
            },
            Values::Fixes(fixes) => {
                Values::Fixes(fixes.each_ref().map(|values| values.slice(first, count)))
            }
        };
        let missing = self.missing.as_ref().map(|missing| missing.slice(first, count));
        Self { column: self.column.clone(), missing, values }
    }

    /// Symbols, if these are the observations and none is missing.
    pub(super) fn symbols(&self) -> Option<&[i64]> {
        match &self.values {
            Values::Symbols(symbols) if self.missing.is_none() => Some(symbols.values()),
            _ => None,
        }
    }

    /// Returns the observation of a step, or a description of what is wrong with it.
    pub(super) fn get(&self, k: usize) -> Result<Observation, String> {
        if self.missing.as_ref().is_some_and(|missing| missing.is_null(k)) {
            return Ok(Observation::Missing);
        }
        Ok(match &self.values {
            // Not negative: see `symbols`.
            Values::Symbols(symbols) => Observation::Symbol(symbols.values()[k] as usize),
            Values::Vectors(offsets, values) => {
                Observation::Vector(values.slice(offsets[k], offsets[k + 1] - offsets[k]))
            }
            Values::Sparse { offsets, states, likelihoods, elsewhere } => {
                let range = offsets[k]..offsets[k + 1];
                let pair = |at: usize| (states.value(at) as usize, likelihoods.value(at));
                let elsewhere = elsewhere.as_ref().map_or(0.0, |elsewhere| elsewhere.value(k));
                let listed = SparseObservation::new(range.map(pair).collect(), elsewhere);
                Observation::Sparse(listed.map_err(|error| error.to_string())?)
            }
            Values::Fixes([latitude, longitude, deviation]) => Observation::Fix(Fix {
                latitude: latitude.value(k),
                longitude: longitude.value(k),
                deviation: deviation.value(k),
            }),
        })
    }
}

fn symbols(array: &ArrayRef, count: usize, column: &str, locate: Locate<'_>) -> Outcome<Values> {
    let symbols = integers(array, column, locate)?;
    // A negative number is huge as an unsigned one, so one comparison checks both ends.
    let outside = |symbol: i64| symbol.cast_unsigned() >= count as u64;
    // This first check ignores nulls, so its loop vectorises. The value under a null is arbitrary,
    // so a hit is checked again.
    if symbols.values().iter().any(|&symbol| outside(symbol)) {
        let wrong = |&k: &usize| symbols.is_valid(k) && outside(symbols.value(k));
        if let Some(element) = (0..symbols.len()).find(wrong) {
            let message = format!(
                "symbol {} does not exist, the model has {count} symbols (0 to {})",
                symbols.value(element),
                count.saturating_sub(1)
            );
            let (row, message) = locate(element, &message);
            return Err(FleetError::value(column, row, message));
        }
    }
    Ok(Values::Symbols(symbols))
}

/// Locates a value in the list of its step.
fn in_list<'a>(
    offsets: &'a [usize],
    locate: Locate<'a>,
) -> impl Fn(usize, &str) -> (u64, String) + 'a {
    move |at, message| {
        // The last list starting at or before the value; this skips empty lists.
        let step = offsets.partition_point(|&offset| offset <= at).saturating_sub(1);
        locate(step, &format!("value {}: {message}", at - offsets[step]))
    }
}
