//! Consistent flows from counts of traffic on roads, by balancing the nodes one after the other.
//!
//! The flow x that minimises Σ x ln(x / c) − x + c subject to equal in- and outflow at each node
//! has the form x = c f(to) / f(from), as the Lagrangian shows. Every update keeps this form, so a
//! balanced result is the minimum.

use super::components::components;
use super::{MapError, RoadMap};

/// Largest difference between the inflow and outflow of a node, relative to their sum.
const TOLERANCE: f64 = 1e-9;
/// Rounds before balancing gives up.
const ROUNDS: usize = 100_000;

impl<P> RoadMap<P> {
    /// Flow nearest to counts of traffic, one per road in the order of [`roads`](Self::roads), such
    /// that inflow equals outflow at each place.
    ///
    /// Counts of different days and detectors don't add up at junctions. Of all flows x ≥ 0 that
    /// do, this is the one with the smallest relative entropy Σ x ln(x / c) − x + c to the counts
    /// c: each count, times a factor of the place where the road ends, divided by the factor of the
    /// place where it starts. Roads without traffic remain without. O(rounds × roads); distant
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
    /// [`MapError::RoadCounts`] and [`MapError::RoadCount`] for invalid counts;
    /// [`MapError::NoWayBack`] if no such flow exists; [`MapError::Unbalanced`] after 100,000
    /// rounds.
    pub fn consistent_flow(&self, counts: &[f64]) -> Result<Vec<f64>, MapError> {
        let places = self.places();
        let ends =
            (0..places.len()).flat_map(|from| self.roads_from(from).map(move |(to, _)| [from, to]));
        balance(places.len(), &ends.collect::<Vec<_>>(), counts, |i| places[i].id)
    }
}

/// Scales counts until inflow equals outflow at each node, node by node.
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
    // Relative to the largest, so that sums and quotients of counts stay in range.
    let largest = counts.iter().copied().fold(0.0, f64::max);
    let mut flow: Vec<f64> =
        counts.iter().map(|c| if *c > 0.0 { c / largest } else { 0.0 }).collect();
    let mut roads = [vec![Vec::new(); nodes], vec![Vec::new(); nodes]];
    for (road, &[from, to]) in ends.iter().enumerate().filter(|road| flow[road.0] > 0.0) {
        // A loop enters its node as often as it leaves it, whatever its flow.
        if from != to {
            roads[0][to].push(road);
            roads[1][from].push(road);
        }
    }
    // A circulation decomposes into cycles, so there is one with flow on all counted roads if and
    // only if each of them lies on a cycle: both its ends are in one component.
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
            // A node without traffic has 0 = 0.
            let error = if into == out { 0.0 } else { (into - out).abs() / (into + out) };
            if error > worst.0 {
                worst = (error, node);
            }
            // With f = √(out / in), the inflow f · in equals the outflow out / f: this balances the
            // node exactly and unbalances its neighbours, ever less.
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
