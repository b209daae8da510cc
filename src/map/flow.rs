//! Consistent flows from counts of traffic on roads.

use super::components::components;
use super::{MapError, RoadMap};

/// Largest difference between what enters and what leaves a node, relative to both.
const TOLERANCE: f64 = 1e-9;
/// Rounds after which balancing gives up.
const ROUNDS: usize = 100_000;

impl<P> RoadMap<P> {
    /// Flow nearest to counts of traffic, one per road, in the order of [`roads`](Self::roads): at
    /// each place, as much enters as leaves.
    ///
    /// Counts of different days and detectors don't add up at junctions. Of all flows x ≥ 0 that
    /// do, this is the one with the smallest relative entropy Σ x ln(x / c) − x + c to the counts
    /// c: each count, times a factor of the place where the road ends, divided by one of the place
    /// where it starts. Roads without traffic stay without. O(rounds × roads); far apart
    /// imbalances on large maps need many rounds.
    ///
    /// ```
    /// use wayfix::canberra;
    ///
    /// let map = canberra::map();
    /// let flow = map.consistent_flow(&vec![100.0; map.roads().len()])?;
    /// let into: f64 = map.roads().iter().zip(&flow).filter(|x| x.0.to == 5).map(|x| x.1).sum();
    /// let out: f64 = map.roads().iter().zip(&flow).filter(|x| x.0.from == 5).map(|x| x.1).sum();
    /// assert!((into / out - 1.0).abs() < 1e-8);
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MapError::RoadCounts`] and [`MapError::RoadCount`] for counts that are none;
    /// [`MapError::NoWayBack`] where there is no flow; [`MapError::Unbalanced`] after 100,000
    /// rounds.
    pub fn consistent_flow(&self, counts: &[f64]) -> Result<Vec<f64>, MapError> {
        let places = self.places();
        let ends =
            (0..places.len()).flat_map(|from| self.roads_from(from).map(move |(to, _)| [from, to]));
        balance(places.len(), &ends.collect::<Vec<_>>(), counts, |i| places[i].id)
    }
}

/// Scales counts until in- and outflow of each node are equal, node by node.
pub fn balance(
    nodes: usize,
    ends: &[[usize; 2]],
    counts: &[f64],
    id: impl Fn(usize) -> u64,
) -> Result<Vec<f64>, MapError> {
    let (found, expected) = (counts.len(), ends.len());
    if found != expected {
        return Err(MapError::RoadCounts { found, expected });
    }
    for (&[from, to], &value) in ends.iter().zip(counts) {
        if !(0.0..=1e150).contains(&value) {
            return Err(MapError::RoadCount { from: id(from), to: id(to), value });
        }
    }
    // Scaled: squares and sums of the smallest and the largest counts stay in range.
    let largest = counts.iter().copied().fold(0.0, f64::max);
    let mut flow: Vec<f64> =
        counts.iter().map(|c| if *c > 0.0 { c / largest } else { 0.0 }).collect();
    let mut roads = [vec![Vec::new(); nodes], vec![Vec::new(); nodes]];
    for (road, &[from, to]) in ends.iter().enumerate().filter(|road| flow[road.0] > 0.0) {
        // A loop enters and leaves as often, whatever its flow.
        if from != to {
            roads[0][to].push(road);
            roads[1][from].push(road);
        }
    }
    let part = components(nodes, |node| roads[1][node].iter().map(|&road| ends[road][1]));
    for (&[from, to], &value) in ends.iter().zip(counts) {
        if value > 0.0 && part[from] != part[to] {
            return Err(MapError::NoWayBack { from: id(from), to: id(to), value });
        }
    }
    let [into, out] = &roads;
    let mut worst = (0.0, 0);
    for _ in 0..ROUNDS {
        worst = (0.0, 0);
        for (node, (arrivals, departures)) in into.iter().zip(out).enumerate() {
            let [into, out] =
                [arrivals, departures].map(|roads| roads.iter().map(|&r| flow[r]).sum::<f64>());
            let error = if into == out { 0.0 } else { (into - out).abs() / (into + out) };
            if error > worst.0 {
                worst = (error, node);
            }
            let factor = (out / into).sqrt();
            if into != out && factor > 0.0 && factor.is_finite() {
                arrivals.iter().for_each(|&road| flow[road] *= factor);
                departures.iter().for_each(|&road| flow[road] /= factor);
            }
        }
        if worst.0 <= TOLERANCE {
            flow.iter_mut().for_each(|flow| *flow *= largest);
            return Ok(flow);
        }
    }
    Err(MapError::Unbalanced { id: id(worst.1), error: worst.0 })
}
