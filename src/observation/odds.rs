//! Odds of a place, given a score.

use std::sync::Arc;

use super::ObservationError;

/// The odds that a reference with some [score](super::Standardizer) is the right one,
/// against a wrong one, as
///
/// o(z) = ((1 − e) min(exp(−s (z − z₀)), exp(t)) + e)^(1/τ).
///
/// Scores in standard deviations of each reference have much the same odds whatever the
/// descriptor and the season: on eleven recordings and descriptors, from 16 × 32 pixels to
/// networks, they fell by two nats for each unit from −3 to 0, were even near −1.15, and
/// levelled off below −3 and above 0. So they need no labels. With probability e a frame
/// says nothing (it is of the inside of a tunnel, or of a lorry), so that no frame speaks
/// against a place by more than ln e.
///
/// The **temperature** τ is for frames in sequence, which err together: of five frames in
/// a row hardly two are independent. Places off the map have odds of 1: all references are
/// wrong ones.
///
/// ```
/// use wayfix::observation::MatchOdds;
///
/// let single = MatchOdds::default().with_temperature(1.0)?;
/// assert!((single.log_odds(-1.15)).abs() < 1e-12);
/// assert!(single.log_odds(-3.0) > 3.5 && single.log_odds(5.0) > -2.4);
/// # Ok::<(), wayfix::observation::ObservationError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOdds {
    pub(crate) slope: f64,
    pub(crate) even: f64,
    pub(crate) most: f64,
    pub(crate) nothing: f64,
    pub(crate) temperature: f64,
}

impl Default for MatchOdds {
    /// s = 2, z₀ = −1.15, t = 6, e = 0.1, and a temperature of 2.5.
    fn default() -> Self {
        Self { slope: 2.0, even: -1.15, most: 6.0, nothing: 0.1, temperature: 2.5 }
    }
}

impl MatchOdds {
    /// With another temperature: above 1 for frames in sequence, 1 for single ones.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] unless it is from 0.01 to 1000.
    pub fn with_temperature(self, temperature: f64) -> Result<Self, ObservationError> {
        if !(0.01..=1000.0).contains(&temperature) {
            let (what, expected) = ("the temperature", "from 0.01 to 1000");
            return Err(ObservationError::Parameter { what, value: temperature, expected });
        }
        Ok(Self { temperature, ..self })
    }

    /// With another probability that a frame says nothing.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] unless it is from 1e-12 to 1.
    pub fn with_nothing(self, nothing: f64) -> Result<Self, ObservationError> {
        if !(1e-12..=1.0).contains(&nothing) {
            let (what, expected) = ("the probability that a frame says nothing", "from 1e-12 to 1");
            return Err(ObservationError::Parameter { what, value: nothing, expected });
        }
        Ok(Self { nothing, ..self })
    }

    /// Itself, if its numbers are ones that give finite odds.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, ObservationError> {
        let Self { slope, even, most, nothing, temperature } = self;
        let named = [
            ("the slope of the odds", slope, 0.0..=100.0, "from 0 to 100"),
            ("the score with even odds", even, -100.0..=100.0, "from -100 to 100"),
            ("the logarithm of the highest odds", most, 0.0..=6.0, "from 0 to 6"),
        ];
        for (what, value, range, expected) in named {
            if !range.contains(&value) {
                return Err(ObservationError::Parameter { what, value, expected });
            }
        }
        self.with_nothing(nothing)?.with_temperature(temperature)
    }

    /// The temperature.
    #[must_use]
    pub fn temperature(&self) -> f64 {
        self.temperature
    }

    /// The probability that a frame says nothing.
    #[must_use]
    pub fn nothing(&self) -> f64 {
        self.nothing
    }

    /// ln of the odds of a score, divided by the temperature; −∞ of an infinite one, which
    /// is surely wrong.
    #[must_use]
    pub fn log_odds(&self, score: f64) -> f64 {
        if score == f64::INFINITY {
            return f64::NEG_INFINITY;
        }
        let says = (-self.slope * (score - self.even)).min(self.most).exp();
        ((1.0 - self.nothing) * says + self.nothing).ln() / self.temperature
    }

    /// Odds and what takes from them, to look up.
    pub(crate) fn table(&self, habituation: f64) -> OddsTable {
        let scores = (0..=CELLS).map(|at| LOWEST + at as f64 / PER_UNIT);
        let logs: Vec<f64> = scores.map(|score| self.log_odds(score)).collect();
        let spent = (0..=CELLS).map(|at| (-habituation * at as f64 * self.per_cell()).exp());
        OddsTable {
            odds: logs.iter().map(|log| log.exp()).collect(),
            gains: logs.iter().map(|log| log.max(0.0)).collect(),
            spent: spent.collect(),
            cells: 1.0 / self.per_cell(),
        }
    }

    /// Log-odds from 0 to the largest, in as many cells as there are of scores.
    fn per_cell(&self) -> f64 {
        (self.most / self.temperature).max(1e-3) / CELLS as f64
    }
}

/// Odds at scores from −8 to 8, 64 for each unit, with straight lines between: within 4e-4
/// of what they are at a temperature of 1, or 1% next to the bend where they level off, and
/// nearer at higher ones.
#[derive(Debug, Clone)]
pub(crate) struct OddsTable {
    odds: Arc<[f64]>,
    /// Log-odds, or 0 if they are below.
    gains: Arc<[f64]>,
    /// Factors of odds for gains that count no more.
    spent: Arc<[f64]>,
    /// Number of cells of `spent` for a unit of log-odds.
    cells: f64,
}

const LOWEST: f64 = -8.0;
const PER_UNIT: f64 = 64.0;
const CELLS: usize = 1024;
/// For so many frames a reference remembers what it said.
const REMEMBERED: f64 = 10.0;

impl OddsTable {
    /// The odds of a score alone (those at the ends beyond), and of a reference that has
    /// gained by the last frames what `gained` says, a mean of log-odds, which goes on.
    #[inline]
    pub(crate) fn odds(&self, score: f64, gained: &mut f32) -> (f64, f64) {
        let before = f64::from(*gained);
        let (spent, spent_part) = split(before * self.cells);
        let left = between(&self.spent, spent, spent_part);
        if score == f64::INFINITY {
            *gained = (before - before / REMEMBERED) as f32;
            return (0.0, 0.0);
        }
        let (cell, part) = split((score - LOWEST) * PER_UNIT);
        let gain = between(&self.gains, cell, part);
        *gained = (before + (gain - before) / REMEMBERED) as f32;
        let odds = between(&self.odds, cell, part);
        (odds, odds * left)
    }
}

/// A cell of a table, and how far beyond its beginning.
#[inline]
fn split(at: f64) -> (usize, f64) {
    let at = at.clamp(0.5, CELLS as f64 - 0.5);
    // The whole part, in the low bits: a conversion takes longer.
    let whole = at - 0.5 + WHOLE;
    (whole.to_bits() as usize & (2 * CELLS - 1), at - (whole - WHOLE))
}

#[inline]
fn between(values: &[f64], cell: usize, part: f64) -> f64 {
    let (low, high) = (values[cell], values[cell + 1]);
    low + part * (high - low)
}

/// 2^52: doubles from here on are whole numbers.
const WHOLE: f64 = (1_u64 << 52) as f64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_close() {
        for temperature in [0.5, 1.0, 2.5, 10.0] {
            let odds = MatchOdds::default().with_temperature(temperature).unwrap();
            let table = odds.table(0.8);
            for k in -900..900 {
                let score = f64::from(k) * 0.0123;
                let exact = odds.log_odds(score.clamp(-8.0, 8.0)).exp();
                let off = (table.odds(score, &mut 0.0).0 / exact - 1.0).abs();
                let bend = (score + 4.15).abs() < 1.0 / PER_UNIT;
                let rough = 0.02 * f64::from(score > 7.9) + 0.01 / temperature * f64::from(bend);
                let bound = 4e-4 / f64::min(temperature, 1.0).powi(2) + rough;
                assert!(off < bound, "{temperature}: {score} {off}");
            }
        }
        assert_eq!(MatchOdds::default().table(0.8).odds(f64::INFINITY, &mut 0.0), (0.0, 0.0));
        assert_eq!(MatchOdds::default().log_odds(f64::INFINITY), f64::NEG_INFINITY);
    }

    #[test]
    fn what_a_reference_says_again_and_again_counts_less() {
        let odds = MatchOdds::default();
        let (table, mut gained) = (odds.table(0.8), 0.0);
        let (alone, first) = table.odds(-3.0, &mut gained);
        assert!((first / alone - 1.0).abs() < 2e-3, "{first}");
        for _ in 0..200 {
            table.odds(-3.0, &mut gained);
        }
        let last = table.odds(-3.0, &mut gained).1.ln();
        assert!((last - 0.2 * odds.log_odds(-3.0)).abs() < 2e-3, "{last}");
        (0..200).for_each(|_| _ = table.odds(2.0, &mut gained));
        assert!(gained < 1e-3);
    }

    #[test]
    fn what_is_no_temperature() {
        assert!(MatchOdds::default().with_temperature(0.0).is_err());
        assert!(MatchOdds::default().with_temperature(f64::NAN).is_err());
        assert!(MatchOdds::default().with_nothing(0.0).is_err());
    }
}
