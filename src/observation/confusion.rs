//! Confusion of places, the discrete part P_c of the sensor: a column-stochastic matrix of p(seen |
//! place), stored once by what is seen, which is how a filter reads it.

use crate::error::{OutOfRange, TransitionError};
use crate::likelihood::table::{invalid, row_sum};
use crate::likelihood::{SparseObservation, SparseTableLikelihood, TableLikelihood};
use crate::map::RoadMap;
use crate::transition::{Compressed, SparseTransition};

/// Confusion probabilities P_c: a place is observed as itself, or mistaken for a few others.
///
/// [From a map](Self::new), a place is mistaken for the places joined to it by a road (in either
/// direction), and for no other (paper section II-B). Each neighbour takes the same share q of a
/// place's probability, so a busy junction is harder to tell from its neighbours than a quiet
/// corner: P_c(i | i) = 1 − q dᵢ for a place with dᵢ neighbours. The share is chosen so that the
/// mean of P_c(i | i) over all places is the given one, 0.7 in the paper. For measured confusions
/// there are [`from_entries`](Self::from_entries) and [`from_weights`](Self::from_weights).
///
/// Only entries above 0 are stored, in 20 bytes an entry and 28 a place: 100,000 places with a few
/// confusions each take some megabytes. A confusion is itself a sensor, a [sparse
/// table](crate::likelihood::SparseTableLikelihood) whose observation is the index of the place
/// that is seen, at the costs of the table. A sensor with [Gaussian noise](Self::with_gaussian), as
/// a [table](Self::into_table), holds n² numbers: it is for up to some thousands of places. See the
/// [module](super) for an example.
#[derive(Debug, Clone, PartialEq)]
pub struct Confusion {
    /// P_c(j | i) of each place i that may be seen as j, by j.
    pub(super) by_seen: SparseTableLikelihood,
    /// For each place, the places that it may be seen as, ascending; their probabilities are stored
    /// in `by_seen` alone.
    seen: Vec<u32>,
    /// Start of each place in `seen`, and the end of the last.
    starts: Vec<u32>,
}

impl Confusion {
    /// Creates the confusion of the places of a map, with the given mean probability of a correct
    /// observation. O((places + roads) log).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the mean is not above 0 and at most 1, if it is below 1 and no
    /// place has a neighbour, or if a place has so many neighbours that no probability is left
    /// for itself.
    pub fn new<P>(map: &RoadMap<P>, mean_correct: f64) -> Result<Self, OutOfRange> {
        if !(mean_correct > 0.0 && mean_correct <= 1.0) {
            return Err(OutOfRange::new(
                "the mean probability of a correct observation",
                mean_correct,
                "above 0 and at most 1",
            ));
        }
        let n = map.places().len();
        let joined: Vec<Vec<usize>> = (0..n).map(|i| map.joined(i)).collect();
        let pairs: usize = joined.iter().map(Vec::len).sum();
        if pairs == 0 && mean_correct < 1.0 {
            let what = "the mean probability of a correct observation";
            return Err(OutOfRange::new(what, mean_correct, "1, as no place has a neighbour"));
        }
        // With the share q of each of the dᵢ neighbours and the mean m, n m = Σ (1 − q dᵢ) = n − q
        // Σ dᵢ.
        let share = if pairs == 0 { 0.0 } else { (1.0 - mean_correct) * n as f64 / pairs as f64 };
        let mut entries = Vec::with_capacity(n + pairs);
        for (i, joined) in joined.iter().enumerate() {
            let correct = 1.0 - share * joined.len() as f64;
            // A junction with 1 / q neighbours or more would have nothing left for itself.
            if correct <= 0.0 {
                let (id, neighbors) = (map.places()[i].id, joined.len());
                let what = format!(
                    "the probability of a correct observation of place {id}, which has {neighbors} neighbours,"
                );
                return Err(OutOfRange::new(what, correct, "a value above 0"));
            }
            entries.push((i, i, correct));
            entries.extend(joined.iter().map(|&j| (i, j, share)));
        }
        Self::from_entries(n, entries)
    }

    /// Creates a confusion from entries (place, seen as, probability) by index, in any order.
    /// Missing entries are 0. O(places + entries).
    ///
    /// ```
    /// use wayfix::observation::Confusion;
    ///
    /// // Aisles 0 and 1 look alike; aisle 2 is never confused.
    /// let entries = [(0, 0, 0.8), (0, 1, 0.2), (1, 1, 0.9), (1, 0, 0.1), (2, 2, 1.0)];
    /// let confusion = Confusion::from_entries(3, entries)?;
    /// assert_eq!(confusion.probability(0, 1), Some(0.2));
    /// assert_eq!(confusion.probability(2, 1), Some(0.0));
    /// # Ok::<(), wayfix::error::OutOfRange>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for no places, an index out of range, a probability that is
    /// NaN, negative or infinite, an entry above 0 given twice, a place whose
    /// probabilities do not sum to one within 1e-9, or more than 2^31 − 1 places or
    /// 2^32 − 1 entries.
    pub fn from_entries(
        places: usize,
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, OutOfRange> {
        let entries = entries.into_iter().map(|(place, seen_as, p)| (seen_as, place, p));
        Self::of(SparseTransition::compressed(places, entries))
    }

    /// Creates a confusion from weights (place, seen as, weight) of any scale, such as counts of
    /// how often a place was seen as another. Weights of the same pair are added, and the weights
    /// of a place are divided by their sum. O(places + weights).
    ///
    /// ```
    /// use wayfix::observation::Confusion;
    ///
    /// let seen = [(0, 0, 1.0), (0, 1, 1.0), (0, 0, 2.0), (1, 1, 5.0)];
    /// let confusion = Confusion::from_weights(2, seen)?;
    /// assert_eq!(confusion.probability(0, 0), Some(0.75));
    /// # Ok::<(), wayfix::error::OutOfRange>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for no places, an index out of range, a weight that is NaN,
    /// negative or infinite, a place without a weight above 0, or more than 2^31 − 1
    /// places or 2^32 − 1 weights.
    pub fn from_weights(
        places: usize,
        weights: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, OutOfRange> {
        let weights = weights.into_iter().map(|(place, seen_as, w)| (seen_as, place, w));
        Self::of(SparseTransition::compressed_weights(places, weights))
    }

    /// Creates a confusion from the rows and columns of a matrix of p(to: seen | from: place),
    /// whose columns sum to one, like those of a transition matrix.
    fn of(lines: Result<(Compressed, Compressed), TransitionError>) -> Result<Self, OutOfRange> {
        let (by_seen, by_place) = lines.map_err(|error| of_pairs(&error))?;
        let symbol =
            |seen| SparseObservation { listed: by_seen.line(seen).collect(), elsewhere: 0.0 };
        let places = by_seen.lines();
        let by_seen = SparseTableLikelihood::from_valid(places, (0..places).map(symbol).collect());
        let (starts, seen) = by_place.into_pattern();
        Ok(Self { by_seen, seen, starts })
    }

    /// Number of places.
    #[must_use]
    pub fn places(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of probabilities above 0.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.seen.len()
    }

    /// Returns P_c(seen | place), by index, or `None` if a place does not exist. O(log (places seen
    /// as that one)).
    #[must_use]
    pub fn probability(&self, place: usize, seen: usize) -> Option<f64> {
        self.by_seen.likelihood(place, seen)
    }

    /// Maps each entry (place, seen as, probability), in the order of the places.
    #[cfg(feature = "serde")]
    pub(crate) fn entries_of<T>(&self, part: impl Fn(usize, usize, f64) -> T) -> Vec<T> {
        let places = 0..self.places();
        let entries = places.flat_map(|place| {
            let line = self.line(place);
            line.map(move |(seen_as, p)| (place, seen_as, p))
        });
        entries.map(|(place, seen_as, p)| part(place, seen_as, p)).collect()
    }

    /// Creates a confusion from a stored list of entries, given as one slice per component.
    #[cfg(feature = "serde")]
    pub(crate) fn from_lists(
        places: usize,
        place: &[u32],
        seen_as: &[u32],
        probability: &[f64],
    ) -> Result<Self, OutOfRange> {
        for (what, found) in [
            ("the number of values in `seen_as`", seen_as.len()),
            ("the number of values in `probability`", probability.len()),
        ] {
            if found != place.len() {
                return Err(OutOfRange::new(what, found as f64, "as many as in `place`"));
            }
        }
        if place.len() < places {
            // Each place has an entry at least, since its probabilities sum to one. This is checked
            // before anything is allocated per place, so that a wrong number cannot exhaust memory.
            let (what, value) = ("the number of places", places as f64);
            let expected = "at most as many as entries";
            return Err(OutOfRange::new(what, value, expected));
        }
        let entries = place.iter().zip(seen_as).zip(probability);
        let entries = entries.map(|((place, seen_as), p)| (*place as usize, *seen_as as usize, *p));
        Self::from_entries(places, entries)
    }

    /// Places that a place may be seen as, with their probabilities.
    pub(super) fn line(&self, place: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let seen = &self.seen[self.starts[place] as usize..self.starts[place + 1] as usize];
        let entry = move |&seen: &u32| {
            let probability = self.by_seen.likelihood(place, seen as usize);
            (seen as usize, probability.unwrap_or(0.0))
        };
        seen.iter().map(entry)
    }

    /// For each place, the places that may be seen as it, with their probabilities.
    pub(super) fn symbols(&self) -> impl Iterator<Item = (usize, &[(usize, f64)])> + Clone {
        let symbol = |seen| self.by_seen.symbol(seen).map_or(&[][..], SparseObservation::listed);
        (0..self.places()).map(move |seen| (seen, symbol(seen)))
    }

    /// Row i of the table: P_c(j | i) over all j.
    pub(super) fn row(&self, place: usize) -> Vec<f64> {
        let mut row = vec![0.0; self.places()];
        self.line(place).for_each(|(seen, p)| row[seen] = p);
        row
    }

    /// Converts to a table without Gaussian noise; each step then borrows its diagonal from the
    /// table instead of writing it. O(n²) time and memory.
    ///
    /// # Errors
    ///
    /// None in practice, since the rows sum to one.
    pub fn into_table(self) -> Result<TableLikelihood, OutOfRange> {
        let rows: Vec<_> = (0..self.places()).map(|place| self.row(place)).collect();
        TableLikelihood::from_rows(&rows)
    }
}

/// Converts an error of the underlying sparse matrix to terms of places.
fn of_pairs(error: &TransitionError) -> OutOfRange {
    match *error {
        TransitionError::Empty => OutOfRange::none("the number of places"),
        TransitionError::OutOfRange { to, from, states } if from >= states => {
            OutOfRange::index(format!("a place that is seen as place {to}"), from, states)
        }
        TransitionError::OutOfRange { to, from, states } => {
            OutOfRange::index(format!("a place that place {from} is seen as"), to, states)
        }
        TransitionError::Entry { to, from, value } => invalid(from, to, value),
        TransitionError::Weight { to, from, value } => {
            let what = format!("the weight of place {from} seen as {to}");
            OutOfRange::new(what, value, "a finite value of at least 0")
        }
        TransitionError::Duplicate { to, from } => {
            OutOfRange::count(format!("the number of entries of place {from} seen as {to}"), 2, 1)
        }
        TransitionError::ColumnSum { column, sum }
        | TransitionError::RowsSumToOne { column, sum } => row_sum(column, sum),
        TransitionError::NoWeight { column } => {
            let what = format!("the sum of the weights of place {column}");
            OutOfRange::new(what, 0.0, "a value above 0")
        }
        TransitionError::TooMany { what: "states", count } => {
            OutOfRange::new("the number of places", count as f64, "at most 2147483647")
        }
        // The only error left is that of too many entries.
        _ => OutOfRange::new("the number of entries", f64::INFINITY, "at most 4294967295"),
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] Confusion: [], |confusion| {
        places: usize = confusion.places(),
        place: Vec<u32> = confusion.entries_of(|place, _, _| place as u32),
        seen_as: Vec<u32> = confusion.entries_of(|_, seen_as, _| seen_as as u32),
        probability: Vec<f64> = confusion.entries_of(|_, _, p| p),
    } => Self::from_lists(places, &place, &seen_as, &probability);
}
