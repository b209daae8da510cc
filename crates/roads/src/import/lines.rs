//! Edges from lines that share points: each line is split where another one, or the line itself,
//! meets it.
//!
//! A point is a node if it is used more than once, where the ends of a line count twice; so ends
//! are always nodes. All lines must be known before the first is split.

use std::collections::HashMap;

use super::report::{ImportNote, ImportReport, LEAST_METRES};
use super::tags::RoadTags;
use crate::{EdgeOptions, NetworkBuilder, NetworkError};
use wayfix::map::Position;

/// A road through points, given by their keys.
#[derive(Debug)]
pub(super) struct Line {
    /// Keys of at least two points; consecutive ones differ, unless there are two in all.
    pub(super) points: Vec<u64>,
    pub(super) tags: RoadTags,
    /// Length, if known.
    pub(super) metres: Option<f64>,
}

/// A point on lines.
#[derive(Debug, Default)]
pub(super) struct Point {
    /// Number of uses by lines; the ends of a line count twice.
    uses: u32,
    pub(super) position: Option<Position>,
    /// Id of its node, once it has one.
    node: Option<u64>,
}

/// Lines and their points.
#[derive(Debug, Default)]
pub(super) struct Lines {
    pub(super) all: Vec<Line>,
    pub(super) points: HashMap<u64, Point>,
    /// True if nodes are numbered from 0 rather than by the keys of their points.
    pub(super) numbered: bool,
}

/// An edge as a piece of a line.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(feature = "osm"), expect(dead_code))]
pub(super) struct Piece {
    /// Index of the line.
    pub(super) line: usize,
    /// Keys of the points at its ends.
    pub(super) ends: [u64; 2],
    /// Number of the same piece in the other direction.
    pub(super) back: Option<usize>,
}

impl Lines {
    /// Adds a line and counts the uses of its points. False if it has fewer than two.
    pub(super) fn add(&mut self, points: Vec<u64>, tags: RoadTags, metres: Option<f64>) -> bool {
        let mut points = points;
        if points.len() < 2 {
            return false;
        }
        let last = points[points.len() - 1];
        points.dedup();
        // All points are the same: a line of two equal points, whose pieces are loops.
        if points.len() == 1 {
            points.push(last);
        }
        let ends = [points[0], points[points.len() - 1]];
        for point in points.iter().chain(&ends) {
            self.points.entry(*point).or_default().uses += 1;
        }
        self.all.push(Line { points, tags, metres });
        true
    }

    /// Adds an edge for each direction of each piece. Returns the pieces, indexed by the numbers of
    /// their edges.
    pub(super) fn split(
        mut self,
        builder: &mut NetworkBuilder,
        report: &mut ImportReport,
    ) -> Result<Vec<Piece>, NetworkError> {
        let mut pieces = Vec::new();
        for (index, line) in std::mem::take(&mut self.all).into_iter().enumerate() {
            let known = |point: &u64| self.points[point].position;
            let positions = || line.points.iter().filter_map(known).collect::<Vec<Position>>();
            let extent = line.metres.map_or(0.0, |_| length(&positions()));
            // Cut at points without a position: what is left on either side is a line of its own.
            let runs: Vec<&[u64]> =
                line.points.split(|p| known(p).is_none()).filter(|run| !run.is_empty()).collect();
            if runs.iter().map(|run| run.len()).sum::<usize>() < line.points.len() {
                report.note(ImportNote::MissingNode);
            }
            for run in runs {
                let mut start = 0;
                // A run of one point makes no piece.
                for end in 1..run.len() {
                    if end == run.len() - 1 || self.points[&run[end]].uses > 1 {
                        let piece = &run[start..=end];
                        let line = (index, &line, extent);
                        self.add_piece(builder, report, &mut pieces, line, piece)?;
                        start = end;
                    }
                }
            }
        }
        Ok(pieces)
    }

    /// Adds a piece of a line in each of its directions. A line with a given length also has an
    /// extent: the metres along its points.
    fn add_piece(
        &mut self,
        builder: &mut NetworkBuilder,
        report: &mut ImportReport,
        pieces: &mut Vec<Piece>,
        (index, line, extent): (usize, &Line, f64),
        piece: &[u64],
    ) -> Result<(), NetworkError> {
        let mut shape: Vec<Position> =
            piece.iter().filter_map(|p| self.points[p].position).collect();
        let straight = length(&shape);
        let ends = [piece[0], piece[piece.len() - 1]];
        // A given length is kept, however short. A piece of the line gets a share of it, in
        // proportion to its straight metres.
        let is_whole = piece.len() == line.points.len() || extent == 0.0;
        let share = if is_whole { 1.0 } else { (straight / extent).min(1.0) };
        let given = line.metres.map(|metres| share * metres).filter(|metres| *metres > 0.0);
        // Without a given length, the piece takes its length from its points.
        if given.is_none() && straight < LEAST_METRES {
            if ends[0] == ends[1] {
                report.note(ImportNote::LoopWithoutLength);
                return Ok(());
            }
            report.note(ImportNote::ShortLine);
        }
        let RoadTags { class, forward, backward, speed, roundabout } = line.tags;
        let metres = given.or(Some(straight.max(LEAST_METRES)));
        let [from, to] = [self.node(builder, ends[0])?, self.node(builder, ends[1])?];
        let mut between = shape.split_off(1);
        between.pop();
        let mut options = EdgeOptions { class, metres, speed, roundabout, between };
        let both = forward && backward;
        if forward {
            let edge = builder.edge(from, to, options.clone())?;
            // Edges and pieces are pushed together, so an edge's number is the index of its piece;
            // the edge back is the next.
            pieces.push(Piece { line: index, ends, back: both.then_some(edge + 1) });
        }
        if backward {
            options.between.reverse();
            let edge = builder.edge(to, from, options)?;
            let back = both.then(|| edge - 1);
            pieces.push(Piece { line: index, ends: [ends[1], ends[0]], back });
            if let Some(there) = back {
                builder.pair(there, edge);
            }
        }
        Ok(())
    }

    /// Id of the node at a point, added if it is new.
    fn node(&mut self, builder: &mut NetworkBuilder, key: u64) -> Result<u64, NetworkError> {
        let point = self.points.entry(key).or_default();
        if let (None, Some(position)) = (point.node, point.position) {
            let id = if self.numbered { builder.nodes() as u64 } else { key };
            builder.node(id, position)?;
            point.node = Some(id);
        }
        Ok(point.node.unwrap_or(key))
    }
}

/// Length of the line through positions.
fn length(positions: &[Position]) -> f64 {
    positions.windows(2).map(|pair| pair[0].metres_to(pair[1])).sum()
}
