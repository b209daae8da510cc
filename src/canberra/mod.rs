//! The paper's instance: 105 intersections of central Canberra.
//!
//! This is a reconstruction. The figures that hold the paper's two matrices are lost, so places and
//! roads are taken from the real street network, numbered to agree with the text (1 to 9 run along
//! the main road, 1 leads to 2 and 70, 66 is off it), and probabilities follow from stated rules:
//! the defaults of [`TurningRule`], and [`Confusion`] with the paper's mean of 0.7 and its Gaussian
//! over the place index. No number was fitted to the paper's accuracies.
//!
//! Places have the paper's numbers, 1 to 105; states are counted from 0, so place 5 is
//! state 4.
//!
//! Road geometry © OpenStreetMap contributors, ODbL 1.0.
//!
//! ```
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//! use wayfix::{canberra, evaluate};
//!
//! let hmm = canberra::hmm(5, 1.0)?;
//! let drive = hmm.simulate(50, &mut ChaCha8Rng::seed_from_u64(1));
//! let smoothing = hmm.smooth(drive.observations())?;
//! let accuracy = evaluate::accuracy(drive.states(), &smoothing.posteriors().modes())?;
//! # assert!(accuracy > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::belief::Belief;
use crate::error::OutOfRange;
use crate::hmm::{Hmm, Prior};
use crate::likelihood::TableLikelihood;
use crate::map::{Place, Position, Road, RoadMap, TurningProbabilities, TurningRule};
use crate::observation::{Confusion, Metric};
use crate::transition::SparseTransition;

/// Mean probability of a correct observation, before Gaussian noise (paper section II-B).
pub const MEAN_CORRECT: f64 = 0.7;

/// Number of places.
pub const PLACES: usize = 105;

/// Places and roads in the format of `RoadMap::from_csv_files`.
const PLACES_CSV: &str = include_str!("places.csv");
const ROADS_CSV: &str = include_str!("roads.csv");

/// Returns the 105 places and 315 directed roads.
///
/// Road geometry © OpenStreetMap contributors, ODbL 1.0.
#[must_use]
#[expect(clippy::missing_panics_doc, reason = "the table is constant, and tested")]
pub fn map() -> RoadMap {
    // Parsed by hand, without the feature `csv`: the table has no quotes. A line that does not
    // parse would be dropped here, so tests count places and roads.
    let lines = |text: &'static str| {
        let lines = text.lines().skip(1).map(|line| line.splitn(4, ','));
        lines.filter_map(|mut line| Some([line.next()?, line.next()?, line.next()?, line.next()?]))
    };
    let places = lines(PLACES_CSV).filter_map(|[id, latitude, longitude, name]| {
        let (latitude, longitude) = (latitude.parse().ok()?, longitude.parse().ok()?);
        let position = Position { latitude, longitude };
        Some(Place { id: id.parse().ok()?, position, name: name.to_owned() })
    });
    let roads = lines(ROADS_CSV).filter_map(|[from, to, class, metres]| {
        let (from, to) = (from.parse().ok()?, to.parse().ok()?);
        Some(Road { from, to, class: class.parse().ok()?, metres: metres.parse().ok()? })
    });
    RoadMap::new(places, roads).expect("the table is a valid map")
}

/// Returns the turning probabilities Φ of [`map`], by the default rule.
#[must_use]
#[expect(clippy::missing_panics_doc, reason = "the table is constant, and tested")]
pub fn turning() -> TurningProbabilities {
    TurningProbabilities::by_rule(&map(), &TurningRule::default()).expect("the rule is valid")
}

/// Returns the sensor: the discrete part with mean 0.7, and a Gaussian over the place index with
/// standard deviation `sigma` (paper eqs. 2 to 4; it tries 1 and 2).
///
/// # Errors
///
/// [`OutOfRange`] unless `sigma` is finite and above 0.
pub fn sensor(sigma: f64) -> Result<TableLikelihood, OutOfRange> {
    let map = map();
    Confusion::new(&map, MEAN_CORRECT)?.with_gaussian(&map, Metric::Index, sigma)
}

/// Returns the model of the paper's experiments: the vehicle starts at the place with the number
/// `initial` (the paper tries 5 and 90), one transition before the first observation; the sensor
/// has Gaussian noise of `sigma`, with tails [rounded](Hmm::with_rounded_tails).
///
/// # Errors
///
/// [`OutOfRange`] if the place does not exist, or `sigma` is not above 0.
#[expect(clippy::missing_panics_doc, reason = "the parts are all of the same map")]
pub fn hmm(initial: u64, sigma: f64) -> Result<Hmm<SparseTransition, TableLikelihood>, OutOfRange> {
    // `initial` is the id of a place, which `index_of_id` turns into a state.
    let certain = map().index_of_id(initial).and_then(|i| Belief::certain(PLACES, i).ok());
    let place = || OutOfRange::new("the initial place", initial as f64, "1 to 105");
    let prior = Prior::BeforeFirstTransition(certain.ok_or_else(place)?);
    let hmm = Hmm::new(prior, turning().into_transition(), sensor(sigma)?);
    Ok(hmm.expect("all parts have the same places").with_rounded_tails())
}
