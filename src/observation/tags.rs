//! Readers of tags at nodes, and of the names of roads: tables of the cells that each tag speaks
//! for. With the part q of a cell that is in range of tag t, of T tags, the probability of reading
//! t is r q + m / T, of another tag m / T, and of none 1 − r q − m.

use std::cmp::Reverse;

use super::ObservationError;
use crate::error::Parameter;
use crate::likelihood::{Groups, SparseTableLikelihood};
use crate::map::RoadCells;

/// A tag and the part of a cell that is in range of it, if any is.
type InRange = Option<(usize, f32)>;

/// Readers of tags.
impl SparseTableLikelihood {
    /// Creates a sensor that reads at most one tag in a step, of tags at nodes of a map of roads,
    /// read from the cells nearby: an RFID tag, a toll gate, a stop that is announced. Tag t is at
    /// `nodes[t]`, read from so many metres along the road before a node and behind it. Where a cell
    /// is in range of several, that of the largest part counts, of equal ones the first.
    ///
    /// The observation is the number of a tag, or the number of tags if nothing was read, which
    /// speaks against the places where something should have been. In a step,
    ///
    /// - in range of a tag, it is read with probability `read`, in a cell of which only a part is
    ///   in range with that part of it;
    /// - with probability `misread`, in all cells, any tag is read, each as likely.
    ///
    /// **Both are per step.** Readings of successive steps depend on each other: at ten steps a
    /// second a vehicle beside a damaged tag misses it ten times. So `read` is best given low, or
    /// steps without a tag left out: a tag that is read then counts, and one that is missed hardly.
    ///
    /// With a `misread` of 0, a wrong reading is an
    /// [error](crate::InferenceError::Impossible) if the belief excludes the tag.
    ///
    /// O(cells + tags log tags). Memory: 32 bytes for each cell in range, and 32 for each tag.
    ///
    /// ```
    /// use wayfix::likelihood::SparseTableLikelihood;
    /// use wayfix::map::{NetworkBuilder, PlanePosition, RoadCells, RoadClass};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// builder.node(2, PlanePosition { x: 4.0, y: 0.0 })?;
    /// builder.one_way(1, 2, RoadClass::Street)?;
    /// let cells = RoadCells::new(builder.build()?, 1.0)?;
    ///
    /// // A tag at the second node is read within 1.5 m, four times out of five.
    /// let reader = SparseTableLikelihood::tags_at_nodes(&cells, &[1], 1.5, 0.8, 0.01)?;
    /// let likelihoods = |seen| [0, 1, 2, 3].map(|cell| reader.likelihood(cell, seen).unwrap());
    /// assert_eq!(likelihoods(0), [0.01, 0.01, 0.41000000000000003, 0.81]);
    /// assert_eq!(likelihoods(1)[..2], [0.99, 0.99]); // nothing was read
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] for a node that does not exist or is given twice, a range
    /// that is not above 0 and finite, or rates that are not probabilities with a sum of at most 1.
    pub fn tags_at_nodes<P>(
        cells: &RoadCells<P>,
        nodes: &[usize],
        range: f64,
        read: f64,
        misread: f64,
    ) -> Result<Self, ObservationError> {
        let network = cells.network();
        if !(range > 0.0 && range.is_finite()) {
            return parameter("the range of a reader", range, "metres above 0");
        }
        let mut tags = vec![None; network.nodes().len()];
        for (tag, &node) in nodes.iter().enumerate() {
            match tags.get_mut(node) {
                Some(known @ None) => *known = Some(tag),
                Some(_) => return parameter("the node of a tag", node as f64, "each node once"),
                None => return parameter("the node of a tag", node as f64, "a node of the map"),
            }
        }
        let in_range = |cell: usize| {
            let (edge, stretch) = (network.edges()[cells.edge(cell)], cells.stretch(cell));
            let length = stretch.end - stretch.start;
            let part = |tag: Option<usize>, from: f64, to: f64| {
                let overlap = to.min(stretch.end) - from.max(stretch.start);
                tag.map(|tag| (tag, (overlap / length).clamp(0.0, 1.0) as f32))
            };
            let before = part(tags[edge.to], edge.metres - range, edge.metres);
            let behind = part(tags[edge.from], 0.0, range);
            let found = [before, behind].into_iter().flatten().filter(|(_, part)| *part > 0.0);
            found.max_by(|a, b| a.1.total_cmp(&b.1).then(Reverse(a.0).cmp(&Reverse(b.0))))
        };
        let in_range: Vec<InRange> = (0..cells.states()).map(in_range).collect();
        Self::of_tags(&in_range, nodes.len(), read, misread)
    }

    /// Creates a reader of groups of states, such as [roads](RoadCells::by_road) by their names: the
    /// number of the group is the tag. In all else as [`tags_at_nodes`](Self::tags_at_nodes).
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] for rates that are not probabilities with a sum of at most
    /// 1.
    pub fn tags_of_groups(
        groups: &Groups,
        read: f64,
        misread: f64,
    ) -> Result<Self, ObservationError> {
        let in_range = groups.as_slice().iter().map(|&group| Some((group, 1.0)));
        let in_range: Vec<InRange> = in_range.collect();
        Self::of_tags(&in_range, groups.count(), read, misread)
    }

    fn of_tags(
        in_range: &[InRange],
        tags: usize,
        read: f64,
        misread: f64,
    ) -> Result<Self, ObservationError> {
        for (what, value) in [("the read rate", read), ("the misread rate", misread)] {
            if !(0.0..=1.0).contains(&value) {
                return parameter(what, value, "a value from 0 to 1");
            }
        }
        if read + misread > 1.0 {
            return parameter("the sum of read and misread rate", read + misread, "at most 1");
        }
        let by_mistake = misread / tags as f64;
        let nothing = |part: f32| (1.0 - read * f64::from(part) - misread).max(0.0);
        // The likelihood of reading nothing that most cells have: out of range, if any is.
        let part = |in_range: &InRange| in_range.map_or(0.0, |(_, part)| part);
        let least = in_range.iter().map(part).fold(1.0, f32::min);
        let mut symbols = vec![(Vec::new(), by_mistake); tags];
        symbols.push((Vec::new(), nothing(least)));
        for (cell, &(tag, part)) in
            in_range.iter().enumerate().filter_map(|(cell, tag)| Some((cell, tag.as_ref()?)))
        {
            symbols[tag].0.push((cell, read * f64::from(part) + by_mistake));
            if part > least {
                symbols[tags].0.push((cell, nothing(part)));
            }
        }
        Ok(Self::from_lists(in_range.len(), &symbols)?)
    }
}

fn parameter<T>(
    what: &'static str,
    value: f64,
    expected: &'static str,
) -> Result<T, ObservationError> {
    Err(Parameter::new(what, value, expected).into())
}
