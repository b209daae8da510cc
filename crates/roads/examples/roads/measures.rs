//! Measures of matched drives against the true routes.

use std::collections::{HashMap, HashSet};

use wayfix::error::OutOfRange;
use wayfix::evaluate::{ReliabilityBin, reliability};
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::{RoadAnswer, Stretch};

/// Names of the answers for points, in the order of display.
pub(crate) const ESTIMATORS: [&str; 3] = ["live", "late", "smoothed"];

/// Nodes where an edge starts and ends: truths don't tell parallel edges apart.
type Ends = (usize, usize);

/// Edge of a true route, with the metres along it where it was entered and left.
pub(crate) type Driven = (usize, [f64; 2]);

/// Lengths of true and of matched routes, in metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Lengths {
    /// Length of the true route.
    pub(crate) truth: f64,
    /// Length of the matched route that is not in the true one.
    pub(crate) added: f64,
    /// Length of the true route that is not in the matched one.
    pub(crate) missed: f64,
}

impl Lengths {
    /// Compares a matched route with the edges of the true one.
    ///
    /// An edge counts as often as a route passes it. No truth tells exactly where on its first and
    /// last edge a drive started and ended: there, any part is right, and only an edge that is
    /// missing altogether counts as missed, with the metres given.
    pub(crate) fn of(network: &RoadNetwork, truth: &[Driven], matched: &[Stretch]) -> Self {
        let ends = |edge: usize| (network.edges()[edge].from, network.edges()[edge].to);
        let mut driven: HashMap<Ends, f64> = HashMap::new();
        for stretch in matched {
            if let Some(edge) = stretch.edge {
                *driven.entry(ends(edge)).or_default() += stretch.exit - stretch.enter;
            }
        }
        // For each edge the length driven, and the least and the most matched length that is right:
        // less than the least is missed, more than the most is added.
        let mut right: HashMap<Ends, [f64; 3]> = HashMap::new();
        for (number, &(edge, [enter, exit])) in truth.iter().enumerate() {
            let metres = network.edges()[edge].metres;
            let enter = enter.clamp(0.0, metres);
            let passed = exit.clamp(enter, metres) - enter;
            let is_end = number == 0 || number + 1 == truth.len();
            let is_there = driven.contains_key(&ends(edge));
            let [length, low, high] = right.entry(ends(edge)).or_default();
            *length += passed;
            *low += if is_end && is_there { 0.0 } else { passed };
            *high += if is_end { metres } else { passed };
        }
        let mut lengths = Self::default();
        for (ends, &[length, least, _]) in &right {
            lengths.truth += length;
            lengths.missed += (least - driven.get(ends).unwrap_or(&0.0)).max(0.0);
        }
        for (ends, metres) in &driven {
            lengths.added += (metres - right.get(ends).map_or(0.0, |right| right[2])).max(0.0);
        }
        lengths
    }

    pub(crate) fn add(&mut self, other: Self) {
        self.truth += other.truth;
        self.added += other.added;
        self.missed += other.missed;
    }

    /// Route mismatch of Newson and Krumm (2009): length added and missed, over the true length.
    pub(crate) fn mismatch(&self) -> f64 {
        (self.added + self.missed) / self.truth
    }

    /// Share of the true length that was found.
    pub(crate) fn found(&self) -> f64 {
        1.0 - self.missed / self.truth
    }
}

/// Edges of a true route, by their ends.
pub(crate) fn edges_of(network: &RoadNetwork, truth: impl Iterator<Item = usize>) -> HashSet<Ends> {
    truth.map(|edge| (network.edges()[edge].from, network.edges()[edge].to)).collect()
}

/// True if the edge of an answer is among these.
pub(crate) fn is_among(network: &RoadNetwork, edges: &HashSet<Ends>, answer: &RoadAnswer) -> bool {
    let edge = answer.edge.map(|edge| &network.edges()[edge]);
    edge.is_some_and(|edge| edges.contains(&(edge.from, edge.to)))
}

/// Probabilities of answers and whether they were right, for each estimator.
#[derive(Debug, Clone, Default)]
pub(crate) struct Forecasts(pub(crate) [Vec<(f64, bool)>; 3]);

impl Forecasts {
    /// Takes the answers for a point in the order of the [`ESTIMATORS`].
    pub(crate) fn push(&mut self, answers: [RoadAnswer; 3], right: impl Fn(&RoadAnswer) -> bool) {
        for (forecasts, answer) in self.0.iter_mut().zip(answers) {
            // Sums of probabilities may exceed 1 by rounding.
            forecasts.push((answer.probability.clamp(0.0, 1.0), right(&answer)));
        }
    }

    pub(crate) fn extend(&mut self, other: &Self) {
        for (forecasts, other) in self.0.iter_mut().zip(&other.0) {
            forecasts.extend_from_slice(other);
        }
    }

    /// Share of right answers of each estimator.
    pub(crate) fn right(&self) -> [f64; 3] {
        self.0
            .each_ref()
            .map(|all| all.iter().filter(|forecast| forecast.1).count() as f64 / all.len() as f64)
    }

    /// Reliability of each estimator, in ten bins.
    pub(crate) fn reliability(&self) -> Result<[Vec<ReliabilityBin>; 3], OutOfRange> {
        let [live, late, smoothed] = self.0.each_ref().map(|all| reliability(all, 10));
        Ok([live?, late?, smoothed?])
    }

    /// Table of the stated probabilities and the shares that were right, in ten bins.
    pub(crate) fn table(&self) -> Result<String, OutOfRange> {
        let diagrams = self.reliability()?;
        let mut text = String::from("probability ");
        ESTIMATORS.iter().for_each(|name| text += &format!("  {name:>8}: stated, right, points"));
        text += "\n";
        for number in (0..10).rev() {
            let low = f64::from(number) / 10.0;
            text += &format!("{low:.1} to {:.1}  ", low + 0.1);
            for diagram in &diagrams {
                // Bins without forecasts are not listed, so bins are found by their lower edges.
                let near = |lower: f64| (lower - low).abs() < 0.01;
                text += &match diagram.iter().find(|bin| near(bin.lower)) {
                    Some(bin) => format!(
                        "          {:.3}   {:.3} {:7}",
                        bin.mean_probability, bin.fraction_true, bin.count
                    ),
                    None => format!("              -       - {:7}", 0),
                };
            }
            text += "\n";
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use wayfix::map::{Position, RoadClass};
    use wayfix_roads::NetworkBuilder;

    use super::*;

    /// Nodes 1 to 5 in a row, about 111 m apart, with roads both ways.
    fn row() -> RoadNetwork {
        let mut builder = NetworkBuilder::new();
        for id in 1..=5 {
            let position = Position { latitude: 0.0, longitude: 0.001 * id as f64 };
            builder.node(id, position).unwrap();
        }
        (1..5).for_each(|id| {
            builder.both_ways(id, id + 1, RoadClass::Street).unwrap();
        });
        builder.build().unwrap()
    }

    fn edge(network: &RoadNetwork, from: usize, to: usize) -> usize {
        network.edge_between(from - 1, to - 1).unwrap()
    }

    fn stretch(network: &RoadNetwork, ends: (usize, usize), enter: f64, exit: f64) -> Stretch {
        let edge = edge(network, ends.0, ends.1);
        let at = Position { latitude: 0.0, longitude: 0.0 };
        Stretch { edge: Some(edge), enter, exit, ends: [at, at] }
    }

    #[test]
    fn parts_of_the_ends_are_free_and_the_rest_counts() {
        let network = row();
        let block = network.edges()[0].metres;
        let truth = [((1, 2), [30.0, block]), ((2, 3), [0.0, block]), ((3, 4), [0.0, 40.0])]
            .map(|((from, to), part)| (edge(&network, from, to), part));
        let length = (block - 30.0) + block + 40.0;
        let compare = |matched: &[Stretch]| Lengths::of(&network, &truth, matched);

        // Right, though it starts and ends elsewhere on the first and last edge.
        let right = [
            stretch(&network, (1, 2), 80.0, block),
            stretch(&network, (2, 3), 0.0, block),
            stretch(&network, (3, 4), 0.0, 90.0),
        ];
        let found = compare(&right);
        assert!((found.truth - length).abs() < 1e-9);
        assert_eq!((found.added, found.missed), (0.0, 0.0));
        assert_eq!((found.mismatch(), found.found()), (0.0, 1.0));

        // An end that is missing counts with the part that was driven.
        assert_eq!(compare(&right[..2]).missed, 40.0);
        assert!((compare(&right[1..]).missed - (block - 30.0)).abs() < 1e-9);
        let nothing = compare(&[]);
        assert!((nothing.missed - length).abs() < 1e-9);
        assert!((nothing.mismatch() - 1.0).abs() < 1e-12);

        // Half an edge in the middle is missing; another edge was driven by 25 m.
        let mut wrong = right;
        wrong[1].exit = block / 2.0;
        assert!((compare(&wrong).missed - block / 2.0).abs() < 1e-9);
        let detour = [right.to_vec(), vec![stretch(&network, (4, 5), 0.0, 25.0)]].concat();
        assert_eq!((compare(&detour).added, compare(&detour).missed), (25.0, 0.0));
        // The other direction is another edge, and a second pass one too many.
        let back = [right.to_vec(), vec![stretch(&network, (3, 2), 0.0, 10.0)]].concat();
        assert_eq!(compare(&back).added, 10.0);
        let twice = [right.to_vec(), vec![right[1]]].concat();
        assert!((compare(&twice).added - block).abs() < 1e-9);
    }

    #[test]
    fn passes_are_counted() {
        let network = row();
        let block = network.edges()[0].metres;
        // There and back and there again.
        let there = edge(&network, 2, 3);
        let truth =
            [edge(&network, 1, 2), there, edge(&network, 3, 2), there, edge(&network, 3, 4)];
        let truth = truth.map(|edge| (edge, [0.0, block]));
        let once = [(1, 2), (2, 3), (3, 4)].map(|ends| stretch(&network, ends, 0.0, block));
        let lengths = Lengths::of(&network, &truth, &once);
        assert!((lengths.missed - 2.0 * block).abs() < 1e-9);
        assert_eq!(lengths.added, 0.0);
    }

    #[test]
    fn a_turn_on_the_way_is_where_it_was() {
        let network = row();
        let block = network.edges()[0].metres;
        let truth = [((1, 2), 0.0, block), ((2, 3), 0.0, 60.0), ((3, 2), block - 60.0, block)]
            .into_iter()
            .chain([((2, 1), 0.0, block)]);
        let driven = |((from, to), enter, exit)| (edge(&network, from, to), [enter, exit]);
        let matched: Vec<Stretch> =
            truth.clone().map(|(ends, enter, exit)| stretch(&network, ends, enter, exit)).collect();
        let truth: Vec<Driven> = truth.map(driven).collect();
        assert_eq!(Lengths::of(&network, &truth, &matched).mismatch(), 0.0);
        // 10 m too far, there and back.
        let mut far = matched;
        (far[1].exit, far[2].enter) = (70.0, block - 70.0);
        let lengths = Lengths::of(&network, &truth, &far);
        assert!((lengths.added - 20.0).abs() < 1e-9 && lengths.missed == 0.0, "{lengths:?}");
    }

    #[test]
    fn probabilities_meet_their_shares() {
        let answer = |edge, probability| RoadAnswer {
            edge: Some(edge),
            metres_along: 0.0,
            probability,
            entropy: 0.0,
            off_road: 0.0,
        };
        let network = row();
        let edges = edges_of(&network, std::iter::once(0));
        let mut forecasts = Forecasts::default();
        for number in 0..4 {
            // Live: one of four right at 0.75; late: three of four; smoothed: all, at 1.
            let answers = [
                answer(usize::from(number != 0), 0.75),
                answer(usize::from(number == 0), 0.75),
                answer(0, 1.0 + 1e-15),
            ];
            forecasts.push(answers, |answer| is_among(&network, &edges, answer));
        }
        assert_eq!(forecasts.right(), [0.25, 0.75, 1.0]);
        let errors = forecasts
            .reliability()
            .unwrap()
            .map(|bins| wayfix::evaluate::expected_calibration_error(&bins));
        assert_eq!(errors, [0.5, 0.0, 0.0]);
        assert_eq!(forecasts.table().unwrap().lines().count(), 11);
        assert!(Forecasts::default().reliability().is_err());
    }
}
