//! Speeds of a vehicle along a route, and their changes: the grid, the shares r, the matrix G and the
//! distributions w(m, v) of the moves of a speed (`guide::formulas`, Route). Columns of G sum to one,
//! and so do the weights of each v.
//!
//! Odometry, given a speed, is Student's t about scale · v + bias, relative to its largest value,
//! which is a constant of the model.

use wayfix::TransitionError;
use wayfix::error::OutOfRange;
use wayfix::transition::kit::{check_probability, check_sum};

/// Largest number of speeds: changes take memory and time for each pair of them.
const MOST_SPEEDS: usize = 1024;
/// Default slack.
const SLACK: f64 = 0.04;
/// Largest speed, in places a step.
const FASTEST: f64 = 64.0;

/// Number of nodes: speeds, evenly spaced over the cell, that stand for a speed of the grid.
const NODES: usize = 8;
/// Probability that a vehicle at a speed of the grid drives it exactly. Many do, above all at the
/// speed at which the route was recorded.
const EXACT: f64 = 0.5;

/// A grid of speeds, in places a step, and the probabilities of their changes.
///
/// From one step to the next, a speed may change to a neighbour on the grid (the vehicle
/// accelerates or brakes), or to any speed (it stops, sets off, turns round). Negative speeds
/// reverse.
///
/// A speed of the grid stands for itself with probability ½, else for its cell: all speeds nearer
/// to it than to its neighbours. Speed 0 is standing still. So a vehicle at 1.1 places a step,
/// which passes one reference in most steps and two in one of ten, is tracked with speeds of 1 and
/// 1⅛.
///
/// The default grid, −2, −1, 0, ¼, eighths from ½ to 1½, 2 and 3, was chosen on some recordings,
/// with drives at constant and changing speeds, stops and reversals. In a long dark stretch a
/// vehicle between two speeds of the grid drifts: at constant speeds from 0.7 to 1.6, filters with
/// quarters instead of eighths were right in 0.90 to 0.95 of the steps instead of 0.96 to 0.98;
/// with twentieths, in 0.98.
///
/// ```
/// use wayfix_recognition::motion::Speeds;
///
/// let speeds = Speeds::default();
/// assert_eq!(speeds.values().len(), 15);
/// // 150 steps at ¾ place a step, then a stop.
/// let moves: Vec<f64> = (1..=150).map(|k| f64::from(k * 3 / 4 - (k - 1) * 3 / 4)).collect();
/// let learned = speeds.fit(&[moves, vec![0.0; 20]])?;
/// let share = |speed: f64| learned.shares()[learned.nearest(speed)];
/// assert!(share(0.75) > 0.5 && share(0.0) > share(2.0));
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Speeds {
    values: Vec<f64>,
    shares: Vec<f64>,
    nearby: f64,
    anywhere: f64,
    slack: f64,
    /// Distribution of the moves of each speed.
    pub(super) windows: Vec<Window>,
}

impl Default for Speeds {
    fn default() -> Self {
        let eighths = (4..=12).map(|k| 0.125 * f64::from(k));
        let values: Vec<f64> =
            [-2.0, -1.0, 0.0, 0.25].into_iter().chain(eighths).chain([2.0, 3.0]).collect();
        let shares = usual_shares(&values);
        Self::build(values, shares, [0.01, 0.005, SLACK])
    }
}

/// Default shares: slow rather than fast, and above all standing and one place a step, which is the
/// speed of the recorded route.
fn usual_shares(values: &[f64]) -> Vec<f64> {
    let usual = |v: &f64| if *v == 0.0 || *v == 1.0 { 3.0 } else { 1.0 };
    let weights: Vec<f64> = values.iter().map(|v| usual(v) * (-0.4 * v.abs()).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

impl Speeds {
    /// Creates a grid of speeds with the default changes and slack: in a step, to a neighbour with
    /// probability 0.01, to any speed with 0.005.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Empty`] for no speeds, or [`TransitionError::Parameter`] for more than
    /// 1,024 speeds, or if they do not ascend or are not from −64 to 64.
    pub fn new(values: &[f64]) -> Result<Self, TransitionError> {
        if values.is_empty() {
            return Err(TransitionError::Empty);
        }
        if values.len() > MOST_SPEEDS {
            let (what, value) = ("the number of speeds", values.len() as f64);
            return Err(OutOfRange::new(what, value, "at most 1024").into());
        }
        for (at, &value) in values.iter().enumerate() {
            let above = at == 0 || value > values[at - 1];
            if !(value.abs() <= FASTEST && above) {
                let what = format!("speed {at}");
                let expected = "a value from -64 to 64, above the one before";
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        Ok(Self::build(values.to_vec(), usual_shares(values), [0.01, 0.005, SLACK]))
    }

    /// Sets the probabilities of a change in a step: to one of the neighbouring speeds, and to any
    /// speed, by their [shares](Self::shares).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless both, and their sum, are from 0 to 1.
    pub fn with_changes(self, nearby: f64, anywhere: f64) -> Result<Self, TransitionError> {
        check_probability(nearby, || "the probability of a neighbouring speed".into())?;
        check_probability(anywhere, || "the probability of any speed".into())?;
        check_probability(nearby + anywhere, || "the probability of another speed".into())?;
        Ok(Self { nearby, anywhere, ..self })
    }

    /// Sets the shares of the speeds: the fraction of time at each, and its probability in a change
    /// to any speed.
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] if there are not as many shares as speeds, or
    /// [`TransitionError::Parameter`] unless they are probabilities that sum to one.
    pub fn with_shares(self, shares: &[f64]) -> Result<Self, TransitionError> {
        let (found, expected) = (shares.len(), self.values.len());
        if found != expected {
            return Err(TransitionError::PartStates { part: "shares of speeds", found, expected });
        }
        check_sum(shares, "the sum of the shares of speeds".into(), |g| {
            format!("the share of speed {g}")
        })?;
        Ok(Self { shares: shares.to_vec(), ..self })
    }

    /// Sets the slack, which is the noise of a step: the probability that a step leads one place
    /// farther than its speed, and also that of one place less. 0.04 by default, and always 0 for
    /// standing. A train has none; on a road, where speeds waver and references are unevenly
    /// spaced, it is 0.1 or so.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless it is from 0 to 0.5.
    pub fn with_slack(self, slack: f64) -> Result<Self, TransitionError> {
        if !(0.0..=0.5).contains(&slack) {
            let (what, expected) = ("the slack of speeds", "a value from 0 to 0.5");
            return Err(OutOfRange::new(what, slack, expected).into());
        }
        Ok(Self::build(self.values, self.shares, [self.nearby, self.anywhere, slack]))
    }

    fn build(values: Vec<f64>, shares: Vec<f64>, [nearby, anywhere, slack]: [f64; 3]) -> Self {
        let windows = (0..values.len()).map(|g| Window::new(&values, g, slack)).collect();
        Self { values, shares, nearby, anywhere, slack, windows }
    }

    /// The speeds, ascending, in places a step.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Share of time at each speed.
    #[must_use]
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// Probabilities of a change in a step: to a neighbouring speed, and to any.
    #[must_use]
    pub fn changes(&self) -> (f64, f64) {
        (self.nearby, self.anywhere)
    }

    /// Probability that a step leads one place farther than its speed, and also that of one place
    /// less.
    #[must_use]
    pub fn slack(&self) -> f64 {
        self.slack
    }

    /// Index of the grid speed nearest to a speed, the lower of two; 0 for NaN.
    #[must_use]
    pub fn nearest(&self, speed: f64) -> usize {
        // A fold from 0 that moves on only for a smaller distance: ties keep the lower index, and
        // NaN, for which no comparison holds, keeps 0.
        let closer = |best: usize, at: usize| {
            let off = |at: usize| (self.values[at] - speed).abs();
            if off(at) < off(best) { at } else { best }
        };
        (0..self.values.len()).fold(0, closer)
    }

    /// Transition matrix of the speeds, row by row: `[to * k + from]`.
    pub(super) fn switching(&self) -> Vec<f64> {
        let k = self.values.len();
        let mut matrix = Vec::with_capacity(k * k);
        for to in 0..k {
            for from in 0..k {
                // At an end of the grid the single neighbour takes all of `nearby`, and on a grid
                // of one speed nothing changes: columns sum to one in every case.
                let neighbors = usize::from(from > 0) + usize::from(from + 1 < k);
                let near = if neighbors == 0 { 0.0 } else { self.nearby / neighbors as f64 };
                let lost = if neighbors == 0 { 0.0 } else { self.nearby };
                // Rounding may take 1 − 0.9 − 0.1 below 0.
                let stay = if to == from { (1.0 - lost - self.anywhere).max(0.0) } else { 0.0 };
                let step = if to.abs_diff(from) == 1 { near } else { 0.0 };
                matrix.push(stay + step + self.anywhere * self.shares[to]);
            }
        }
        matrix
    }
}

/// Distribution of the number of places that a step moves on, at a speed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    /// Move of the first weight.
    pub(super) first: isize,
    pub(super) weights: Vec<f64>,
    /// Nodes of the cell; `by_node` has the weights of the moves of each, row by row.
    pub(super) nodes: Vec<f64>,
    by_node: Vec<f64>,
    /// Probability of each node.
    pub(super) shares: Vec<f64>,
    /// Width of the part of the cell that a node stands for.
    pub(super) spacing: f64,
}

impl Window {
    pub(super) fn new(values: &[f64], g: usize, slack: f64) -> Self {
        let half = |a: usize, b: usize| 0.5 * (values[b] - values[a]);
        let (mut low, mut high) = (values[g], values[g]);
        // Speed 0 has no cell; at the ends of the grid, cells are symmetric.
        if values[g] != 0.0 && values.len() > 1 {
            let last = values.len() - 1;
            low -= if g == 0 { half(0, 1) } else { half(g - 1, g) };
            high += if g == last { half(last - 1, last) } else { half(g, g + 1) };
        }
        // A cell without width (standing, or the only speed) is one node. Otherwise nodes are the
        // midpoints of eight equal parts, and the speed itself is a ninth.
        let count = if low == high { 1 } else { NODES };
        let spacing = (high - low) / count as f64;
        let mut nodes: Vec<f64> = (0..count).map(|q| low + spacing * (q as f64 + 0.5)).collect();
        let mut shares = vec![1.0 / count as f64; count];
        if count > 1 {
            shares.fill((1.0 - EXACT) / count as f64);
            nodes.push(values[g]);
            shares.push(EXACT);
        }
        let moves = values[g] != 0.0;
        let margin = isize::from(moves && slack > 0.0);
        // The speed itself may lie outside its nodes, which are inside the cell: if one neighbour
        // is near and the other far, nearly all of the cell lies on one side of the speed.
        let low = nodes.iter().copied().fold(f64::INFINITY, f64::min);
        let high = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let first = low.floor() as isize - margin;
        let last = high.ceil() as isize + margin;
        let width = (last - first + 1).unsigned_abs();
        // tri(m − v): a vehicle somewhere between two references, at speed v, passes m of them with
        // this probability. It sums to one over whole m, with the mean v.
        let triangle = |m: isize, v: f64| (1.0 - (m as f64 - v).abs()).max(0.0);
        let mut by_node = Vec::with_capacity(nodes.len() * width);
        for &v in &nodes {
            by_node.extend((first..=last).map(|m| {
                let beside = triangle(m - 1, v) + triangle(m + 1, v);
                let slack = if moves { slack } else { 0.0 };
                // w(m, v): the slack moves a part of the triangle to either side, which keeps its
                // mean.
                (1.0 - 2.0 * slack) * triangle(m, v) + slack * beside
            }));
        }
        let mut window = Self { first, weights: vec![0.0; width], nodes, by_node, shares, spacing };
        let mut weights = vec![0.0; width];
        window.weigh(|_| 1.0, &mut weights);
        window.weights = weights;
        window
    }

    pub(super) fn last(&self) -> isize {
        self.first + self.weights.len().cast_signed() - 1
    }

    /// Computes the weights of moves, given a likelihood of the speeds in the cell; returns the
    /// likelihood of the whole cell.
    pub(super) fn weigh(&self, likelihood: impl Fn(f64) -> f64, out: &mut [f64]) -> f64 {
        out.fill(0.0);
        let mut total = 0.0;
        let nodes = self.nodes.iter().zip(&self.shares);
        for ((&v, share), weights) in nodes.zip(self.by_node.chunks_exact(out.len())) {
            let p = share * likelihood(v);
            total += p;
            out.iter_mut().zip(weights).for_each(|(out, weight)| *out += p * weight);
        }
        total
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Speeds: [], |speeds| {
        values: Vec<f64> = speeds.values(),
        shares: Vec<f64> = speeds.shares(),
        nearby: f64 = speeds.changes().0,
        anywhere: f64 = speeds.changes().1,
        slack: f64 = speeds.slack(),
    } => Self::new(&values)
        .and_then(|speeds| speeds.with_shares(&shares))
        .and_then(|speeds| speeds.with_changes(nearby, anywhere))
        .and_then(|speeds| speeds.with_slack(slack));
}

/// Measurement model of odometry.
///
/// At a speed of v places a step, a reading, in places, is scale · v + bias with an error that
/// has heavier tails than a Gaussian (Student's t with four degrees of freedom, Lange, Little
/// and Taylor 1989): a wheel that slips once should not rule out the vehicle's place. Give
/// `None` for a step without a reading, and also while wheels are stuck or a counter has
/// stopped: a fault is not a slip, and each of its readings counts in full.
///
/// ```
/// use wayfix_recognition::motion::OdometryModel;
///
/// // Labelled steps: places moved on, and readings, which are 4% too large.
/// let moves: Vec<f64> = (0..300).map(|k| f64::from(k / 50 % 3)).collect();
/// let read: Vec<f64> = moves.iter().zip(0..).map(|(m, k)| 1.04 * m + [0.1, -0.1][k % 2]).collect();
/// let learned = OdometryModel::fit(&[(moves, read)])?;
/// assert!((learned.scale - 1.04).abs() < 0.01 && learned.bias.abs() < 0.02);
/// assert!(learned.deviation > 0.04 && learned.deviation < 0.2);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OdometryModel {
    /// Places read for each place driven.
    pub scale: f64,
    /// Places read while standing.
    pub bias: f64,
    /// Scale of the error, in places: two thirds of errors are within about 1.1 times this. For
    /// a grid speed that stands for a cell of speeds, the variance of an eighth of the cell is added
    /// to its square: (scale × width / 8)² / 12.
    pub deviation: f64,
}

impl Default for OdometryModel {
    /// Unbiased, with an error of 0.5 places: drives whose true error was 0.3 lost nothing by it,
    /// and with 0.3 the drives whose error was 1 went wrong.
    fn default() -> Self {
        Self { scale: 1.0, bias: 0.0, deviation: 0.5 }
    }
}

/// Density at 0 of Student's t with four degrees of freedom.
const PEAK: f64 = 0.375;
/// Largest absolute value of a valid reading.
pub(super) const FARTHEST: f64 = 1e6;

impl OdometryModel {
    pub(super) fn check(&self) -> Result<(), TransitionError> {
        let Self { scale, bias, deviation } = *self;
        let named = [("scale", scale, 0.01..=100.0), ("bias", bias, -FARTHEST..=FARTHEST)];
        for (name, value, range) in named {
            if !range.contains(&value) {
                let what = format!("the {name} of the odometry");
                let expected =
                    if name == "scale" { "from 0.01 to 100" } else { "from -1e6 to 1e6" };
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        if !(1e-3..=1e6).contains(&deviation) {
            let what = "the deviation of the odometry";
            let expected = "from 0.001 to 1e6";
            return Err(OutOfRange::new(what, deviation, expected).into());
        }
        Ok(())
    }

    pub(crate) fn check_reading(reading: f64) -> Result<(), TransitionError> {
        if reading.abs() <= FARTHEST {
            return Ok(());
        }
        let text = format!("an odometry of {reading} places, expected a value from -1e6 to 1e6");
        Err(TransitionError::Control(text))
    }

    /// Density of a reading at a speed known up to a cell of width `spacing`, relative to the
    /// largest density.
    pub(super) fn relative(&self, reading: f64, speed: f64, spacing: f64) -> f64 {
        let width = self.scale * spacing;
        // The variance of a uniform distribution over the cell is added.
        let s = (self.deviation * self.deviation + width * width / 12.0).sqrt();
        let r = (reading - self.scale * speed - self.bias) / s;
        // (1 + r² / 4)^(−5/2), the kernel of a t with four degrees of freedom; the ratio of the
        // scales is that of the peaks.
        let x = 1.0 + 0.25 * r * r;
        self.deviation / s / (x * x * x.sqrt())
    }

    /// Density of a reading given the mean of earlier readings at the same speed, relative to the
    /// largest density.
    pub(super) fn predictive_density(&self, reading: f64, mean: f64, count: u32) -> f64 {
        // Predictive density: the variance of the mean, 1 / count, adds to that of the reading.
        let width = (1.0 + 1.0 / f64::from(count)).sqrt();
        let r = (reading - mean) / (width * self.deviation);
        let x = 1.0 + 0.25 * r * r;
        1.0 / width / (x * x * x.sqrt())
    }

    /// Logarithm of the largest density.
    pub(super) fn log_peak(&self) -> f64 {
        (PEAK / self.deviation).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_distributions_with_the_mean_of_the_cell() {
        for slack in [0.0, 0.02, 0.3] {
            let speeds = Speeds::default().with_slack(slack).unwrap();
            for (g, window) in speeds.windows.iter().enumerate() {
                let sum: f64 = window.weights.iter().sum();
                let moves = window.weights.iter().zip(window.first..);
                let mean: f64 = moves.map(|(p, m)| p * m as f64).sum();
                let nodes = window.nodes.iter().zip(&window.shares);
                let cell: f64 = nodes.map(|(v, share)| v * share).sum();
                assert!((sum - 1.0).abs() < 1e-12 && (mean - cell).abs() < 1e-12, "{g}");
            }
            let k = speeds.values().len();
            let switching = speeds.switching();
            for from in 0..k {
                let sum: f64 = switching[from..].iter().step_by(k).sum();
                assert!((sum - 1.0).abs() < 1e-12);
            }
        }
        let alone = Speeds::new(&[1.0]).unwrap().with_slack(0.0).unwrap();
        assert_eq!(alone.windows[0].weights, [1.0]);
        assert_eq!(alone.switching(), [1.0]);
    }

    #[test]
    fn invalid_grids_are_errors() {
        assert!(Speeds::new(&[]).is_err());
        for wrong in [[0.0, 0.0], [1.0, 0.0], [0.0, f64::NAN], [0.0, 65.0]] {
            let error = Speeds::new(&wrong).unwrap_err().to_string();
            assert!(error.starts_with("speed 1 is"), "{error}");
        }
        let many: Vec<f64> = (0..60_000).map(|k| 0.001 * f64::from(k)).collect();
        assert!(Speeds::new(&many[..1024]).is_ok());
        let error = Speeds::new(&many).unwrap_err().to_string();
        assert_eq!(error, "the number of speeds is 60000, expected at most 1024");
        assert!(Speeds::default().with_changes(0.6, 0.6).is_err());
        assert!(Speeds::default().with_shares(&[1.0]).is_err());
        assert!(Speeds::default().with_slack(0.6).is_err());
    }

    #[test]
    fn the_density_is_one() {
        let model = OdometryModel { scale: 1.1, bias: 0.2, deviation: 0.4 };
        let step = 1e-3;
        let sum: f64 =
            (-400_000..400_000).map(|k| step * model.relative(f64::from(k) * step, 1.5, 0.0)).sum();
        assert!((sum * model.log_peak().exp() - 1.0).abs() < 1e-6, "{sum}");
    }
}
