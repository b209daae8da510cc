//! Positions along roads as states: directed edges, cut into cells of nearly equal length, numbered
//! in the order of the edges and along each from its start; and their groups by edge, road and
//! place.

use std::ops::Range;
use std::sync::Arc;

use crate::{NearEdge, NetworkError, RoadNetwork};
use wayfix::error::OutOfRange;
use wayfix::likelihood::Groups;
use wayfix::map::{Coordinates, Position};

/// Cells of directed edges.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// Cells of edge e are `starts[e]..starts[e + 1]`; each edge has at least one.
    starts: Vec<u32>,
    /// Edge of each cell.
    edges: Vec<u32>,
}

impl Layout {
    /// Cuts edges into cells, each into the number whose cells come closest to the spacing.
    #[expect(clippy::cast_sign_loss, reason = "lengths and the spacing are above 0")]
    pub(super) fn new(
        lengths: impl Iterator<Item = f64> + Clone,
        spacing: f64,
    ) -> Result<Self, NetworkError> {
        let count = |metres: f64| (metres / spacing).round().max(1.0);
        let total: f64 = lengths.clone().map(count).sum();
        if total == 0.0 {
            return Err(NetworkError::NoRoads);
        }
        // Checked as a double before anything is allocated: lengths over a tiny spacing are huge or
        // infinite.
        if !(1.0..=f64::from(u32::MAX)).contains(&total) {
            return Err(NetworkError::Cells { cells: total, spacing });
        }
        let (mut starts, mut edges) = (vec![0], Vec::with_capacity(total as usize));
        for (edge, metres) in (0..).zip(lengths) {
            edges.extend(std::iter::repeat_n(edge, count(metres) as usize));
            starts.push(edges.len() as u32);
        }
        Ok(Self { starts, edges })
    }

    pub(crate) fn states(&self) -> usize {
        self.edges.len()
    }

    pub(crate) fn edge_count(&self) -> usize {
        self.starts.len() - 1
    }

    pub(crate) fn edge(&self, cell: usize) -> usize {
        self.edges[cell] as usize
    }

    pub(crate) fn cells(&self, edge: usize) -> Range<usize> {
        self.starts[edge] as usize..self.starts[edge + 1] as usize
    }

    pub(crate) fn first(&self, edge: usize) -> usize {
        self.starts[edge] as usize
    }

    pub(crate) fn last(&self, edge: usize) -> usize {
        self.starts[edge + 1] as usize - 1
    }
}

/// Cells of a road network: each directed edge is cut into equal pieces of about a given length,
/// which are the states of a vehicle whose position along its road matters.
///
/// With intersections as states, a model cannot tell how far a vehicle has come between two of
/// them, nor its road and direction before it arrives. With cells it can, for
/// ticks of centimetres and jumps of kilometres alike;
/// [`CellTransition`](crate::cells::CellTransition) moves them.
///
/// An edge of L metres has max(1, round(L / spacing)) cells, numbered from its start; cells are in
/// the order of the edges. The belief is over cells: the vehicle is somewhere in its cell. Cells of
/// different edges differ in length, by at most half if edges are at least as long as the spacing.
/// Motion counts in cells of the [mean length](Self::mean_metres), and so takes an edge of c cells
/// for c times that length: an error of at most about half a cell on each edge passed, or a whole
/// one on an edge shorter than half the spacing. Its variance per metre driven is
/// [`rounding`](Self::rounding), which motion adds to that of the odometer. On a network whose
/// edges are multiples of the spacing, such as the aisles of a warehouse, it is 0.
///
/// **Spacing**: about the standard deviation of the position sensor, or less than half the distance
/// that is to be resolved. A metropolitan network at 20 m has some 370,000 cells. Memory: 4 bytes
/// per cell and 4 bytes per edge, besides the network, which is shared.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::cells::RoadCells;
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 12.0, y: 0.0 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let cells = RoadCells::new(builder.build()?, 3.0)?;
///
/// assert_eq!(cells.states(), 8); // four in each direction
/// assert_eq!(cells.cell_at(0, 7.0), 2);
/// assert_eq!(cells.stretch(2), 6.0..9.0);
/// assert_eq!(cells.position(2), PlanePosition { x: 7.5, y: 0.0 });
/// // Where a position is along the nearest road: the first of both directions.
/// let at = cells.project(PlanePosition { x: 7.0, y: 1.5 });
/// assert_eq!((at.edge, at.metres_along, at.metres_off), (0, 7.0, 1.5));
/// // Both directions of a stretch are one place.
/// let places = cells.by_place();
/// assert_eq!(places.group_of(2), places.group_of(5));
/// # Ok::<(), wayfix_roads::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct RoadCells<P = Position> {
    pub(super) network: Arc<RoadNetwork<P>>,
    pub(super) layout: Arc<Layout>,
    mean_metres: f64,
    rounding: f64,
}

impl<P> RoadCells<P> {
    /// Cuts the edges of a network, which may be shared, into cells about `spacing` metres long.
    /// O(cells).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Parameter`] unless the spacing and the total length of all edges are above 0
    /// and finite, [`NetworkError::NoRoads`] for a network without edges, and
    /// [`NetworkError::Cells`] for more cells than 32-bit indices address.
    pub fn new(
        network: impl Into<Arc<RoadNetwork<P>>>,
        spacing: f64,
    ) -> Result<Self, NetworkError> {
        let network = network.into();
        let wrong = || OutOfRange::new("the spacing of cells", spacing, "metres above 0");
        if !(spacing > 0.0 && spacing.is_finite()) {
            return Err(wrong().into());
        }
        let lengths = network.edges().iter().map(|edge| edge.metres);
        let layout = Layout::new(lengths.clone(), spacing)?;
        let total: f64 = lengths.clone().sum();
        if total == f64::INFINITY {
            return Err(wrong().into());
        }
        let mean_metres = total / layout.states() as f64;
        // An edge of length L with c cells is off by L − c mean, once per passage. So the variance
        // per metre driven is Σ (L − c mean)² / Σ L.
        let error = |(edge, metres)| metres - layout.cells(edge).len() as f64 * mean_metres;
        let squares: f64 = lengths.enumerate().map(|edge| error(edge).powi(2)).sum();
        // Lengths that are exact multiples of the spacing leave only rounding errors, which must
        // not count as noise.
        let rounding = squares / total;
        let rounding = if rounding > 1e-20 * mean_metres { rounding } else { 0.0 };
        Ok(Self { network, layout: Arc::new(layout), mean_metres, rounding })
    }

    /// Number of cells, which are the states.
    #[must_use]
    pub fn states(&self) -> usize {
        self.layout.states()
    }

    /// Network of the cells.
    #[must_use]
    pub fn network(&self) -> &Arc<RoadNetwork<P>> {
        &self.network
    }

    /// Mean length of a cell in metres.
    #[must_use]
    pub fn mean_metres(&self) -> f64 {
        self.mean_metres
    }

    /// Variance of the error of taking all cells to have the mean length, in square metres per
    /// metre driven: Σ (L − c × mean)² / Σ L over edges of L metres and c cells.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        self.rounding
    }

    /// Edge of a cell.
    ///
    /// # Panics
    ///
    /// If the cell does not exist.
    #[must_use]
    pub fn edge(&self, cell: usize) -> usize {
        self.layout.edge(cell)
    }

    /// Cells of an edge, from its start.
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn cells(&self, edge: usize) -> Range<usize> {
        self.layout.cells(edge)
    }

    /// Stretch of a cell, in metres from the start of its edge.
    ///
    /// # Panics
    ///
    /// If the cell does not exist.
    #[must_use]
    pub fn stretch(&self, cell: usize) -> Range<f64> {
        let edge = self.edge(cell);
        let (cells, metres) = (self.cells(edge), self.network.edges()[edge].metres);
        let at = |number: usize| metres * number as f64 / cells.len() as f64;
        at(cell - cells.start)..at(cell - cells.start + 1)
    }

    /// Metres from the start of its edge to the middle of a cell.
    ///
    /// # Panics
    ///
    /// If the cell does not exist.
    #[must_use]
    pub fn metres_along(&self, cell: usize) -> f64 {
        let stretch = self.stretch(cell);
        f64::midpoint(stretch.start, stretch.end)
    }

    /// Cell of an edge at a distance in metres from its start. Distances off the edge are clamped:
    /// the first cell below 0 (and for NaN), the last at its length and beyond.
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    #[expect(clippy::cast_sign_loss, reason = "below 0 is the first cell")]
    pub fn cell_at(&self, edge: usize, metres: f64) -> usize {
        let (cells, length) = (self.cells(edge), self.network.edges()[edge].metres);
        // The cast saturates: negative numbers and NaN become 0.
        let number = (metres / length * cells.len() as f64) as usize;
        cells.start + number.min(cells.len() - 1)
    }

    pub(crate) fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }
}

impl<P: Coordinates> RoadCells<P> {
    /// Position of the middle of a cell, on the line of its edge. O(points of the edge).
    ///
    /// # Panics
    ///
    /// If the cell does not exist.
    #[must_use]
    pub fn position(&self, cell: usize) -> P {
        self.network.position_along(self.edge(cell), self.metres_along(cell))
    }

    /// Position `ahead` metres from the middle of a cell, as an
    /// [`Odometer`](crate::cells::Odometer::ahead) reports it, but not beyond the ends of its
    /// edge. O(points of the edge).
    ///
    /// # Panics
    ///
    /// If the cell does not exist.
    #[must_use]
    pub fn position_ahead(&self, cell: usize, ahead: f64) -> P {
        self.network.position_along(self.edge(cell), self.metres_along(cell) + ahead)
    }

    /// Nearest point of any edge to a position: edge, metres along and metres off. Ties, such as
    /// both directions of a road, go to the lowest edge. O(points of all edges): for many positions
    /// on a large network, `EdgeIndex::nearest` (feature `matching`) finds the edge without
    /// visiting all others, and [`cell_at`](Self::cell_at) its cell.
    ///
    /// A position alone often has the wrong road nearest; a filter with
    /// [`PositionLikelihood`](crate::cells::PositionLikelihood) takes all into account.
    #[must_use]
    pub fn project(&self, position: P) -> NearEdge {
        let mut best = self.network.project(0, position);
        for edge in 1..self.layout.edge_count() {
            let found = self.network.project(edge, position);
            if found.metres_off < best.metres_off {
                best = found;
            }
        }
        best
    }

    /// Cell at the nearest point of any edge. O(points of all edges), as
    /// [`project`](Self::project).
    #[must_use]
    pub fn nearest(&self, position: P) -> usize {
        let NearEdge { edge, metres_along, .. } = self.project(position);
        self.cell_at(edge, metres_along)
    }
}

impl<P> RoadCells<P> {
    /// Groups of the cells by directed edge: group e is edge e.
    #[must_use]
    pub fn by_edge(&self) -> Groups {
        let edges = (0..self.states()).map(|cell| self.edge(cell));
        Groups::numbered(edges.collect(), self.layout.edge_count())
    }

    /// Groups of the cells by road, whatever the direction: both edges of a pair are one group.
    /// Groups are numbered in the order of the lower edges.
    #[must_use]
    pub fn by_road(&self) -> Groups {
        let (of, count) = self.roads();
        let roads = (0..self.states()).map(|cell| of[self.edge(cell)]);
        Groups::numbered(roads.collect(), count)
    }

    /// Groups of the cells by place, whatever the direction: a cell of the lower edge of a pair,
    /// and the cells of the other edge whose middles lie in it. Groups are numbered in the order of
    /// the lower edges' cells.
    ///
    /// The pair of an edge is that of the network
    /// ([`RoadNetwork::reverse`](crate::RoadNetwork::reverse)). If the edges of a pair differ
    /// in length, positions are compared as shares of the length.
    #[must_use]
    pub fn by_place(&self) -> Groups {
        let (mut of, mut count) = (vec![0; self.states()], 0);
        for edge in 0..self.layout.edge_count() {
            let cells = self.cells(edge);
            match self.lower(edge) {
                Some(lower) => {
                    let there = self.cells(lower);
                    // The middle of cell i of m is at the share (2 i + 1) / 2 m of its edge, so at
                    // 1 minus this share of the other edge. Of the n cells there, it is in cell
                    // ⌊(2 (m − i) − 1) n / 2 m⌋, computed in integers; for m = n this is m − 1 − i.
                    // A middle on the border of two cells is in the one farther along the other
                    // edge. Cells of the lower edge without any middle are groups of their own.
                    let (m, n) = (cells.len(), there.len());
                    for (i, cell) in cells.enumerate() {
                        let part = (2 * (m - i) - 1) * n / (2 * m);
                        of[cell] = of[there.start + part.min(n - 1)];
                    }
                }
                None => {
                    for cell in cells {
                        (of[cell], count) = (count, count + 1);
                    }
                }
            }
        }
        Groups::numbered(of, count)
    }

    /// Other edge of a pair, if it is lower.
    fn lower(&self, edge: usize) -> Option<usize> {
        self.network.reverse(edge).filter(|&reverse| reverse < edge)
    }

    /// Road of each edge, and their number.
    fn roads(&self) -> (Vec<usize>, usize) {
        let (mut of, mut count) = (Vec::with_capacity(self.layout.edge_count()), 0);
        for edge in 0..self.layout.edge_count() {
            // The lower edge of a pair comes first, so its road already has a number.
            let road = self.lower(edge).map_or(count, |lower| of[lower]);
            of.push(road);
            count = count.max(road + 1);
        }
        (of, count)
    }
}
