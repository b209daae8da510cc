//! Groups of cells: directed edges, roads, places.

use super::RoadCells;
use wayfix::likelihood::Groups;

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
                    // The middle of cell i of m is at the share (2 i + 1) / 2 m of its edge, and at
                    // 1 minus this of the other edge, which has n cells: that is its cell ⌊(2 (m −
                    // i) − 1) n / 2 m⌋, computed in integers, and m − 1 − i if m = n. A middle on
                    // the border of two cells is in the one farther along the other edge. Cells of
                    // the lower edge without any middle are groups of their own.
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
            // The lower edge of a pair comes first, so its road has a number.
            let road = self.lower(edge).map_or(count, |lower| of[lower]);
            of.push(road);
            count = count.max(road + 1);
        }
        (of, count)
    }
}
