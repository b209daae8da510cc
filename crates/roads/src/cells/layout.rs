//! Numbering of cells: in the order of the edges, and along each from its start.

use crate::NetworkError;
use std::ops::Range;

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
