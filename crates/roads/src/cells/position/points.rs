//! Middles of cells, with their directions and lengths, projected to the plane of the map.

use super::grid::Grid;
use crate::cells::RoadCells;
use wayfix::map::Coordinates;

/// Side of the squares of the grid, in mean cells.
const SQUARE: f64 = 8.0;

/// Middles of the cells in the plane.
#[derive(Debug)]
pub(super) struct Points {
    pub(super) middles: Vec<[f64; 2]>,
    /// Unit vector along each cell, or zero.
    pub(super) directions: Vec<[f32; 2]>,
    /// ℓ² / 12, in square metres, of each cell.
    pub(super) squares: Vec<f32>,
    pub(super) largest_square: f64,
    pub(super) grid: Grid,
}

impl Points {
    pub(super) fn new<P: Coordinates>(cells: &RoadCells<P>) -> Self {
        let n = cells.states();
        let (mut middles, mut directions) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut squares = Vec::with_capacity(n);
        let network = cells.network();
        let (mut line, mut marks) = (Vec::new(), Vec::new());
        for (edge, road) in network.edges().iter().enumerate() {
            let count = cells.cells(edge).len();
            line.clear();
            line.extend(P::unwrap(network.shape(edge).iter().copied()));
            // Start, middle and end of each cell: successive cells share a mark.
            divide(&line, 2 * count, &mut marks);
            for ends in marks.windows(3).step_by(2) {
                let [dx, dy] = [ends[2][0] - ends[0][0], ends[2][1] - ends[0][1]];
                let length = dx.hypot(dy);
                let unit = |d: f64| if length > 0.0 { (d / length) as f32 } else { 0.0 };
                middles.push(ends[1]);
                directions.push([unit(dx), unit(dy)]);
                squares.push(((road.metres / count as f64).powi(2) / 12.0) as f32);
            }
        }
        let largest_square = squares.iter().copied().fold(0.0, f32::max).into();
        let grid = Grid::new(&middles, SQUARE * cells.mean_metres());
        Self { middles, directions, squares, largest_square, grid }
    }
}

/// Points that divide a line into parts of equal length, including both ends.
fn divide(line: &[[f64; 2]], parts: usize, marks: &mut Vec<[f64; 2]>) {
    let length = |pair: &[[f64; 2]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
    let total: f64 = line.windows(2).map(length).sum();
    let (mut piece, mut before) = (0, 0.0);
    marks.clear();
    for mark in 0..=parts {
        let along = total * mark as f64 / parts as f64;
        // Marks ascend, so the piece only moves on. It stops at the last one, which rounding of the
        // sum must not pass.
        while piece + 2 < line.len() && before + length(&line[piece..piece + 2]) < along {
            before += length(&line[piece..piece + 2]);
            piece += 1;
        }
        let (a, b) = (line[piece], line[piece + 1]);
        let here = length(&[a, b]);
        let share = if here > 0.0 { ((along - before) / here).clamp(0.0, 1.0) } else { 0.0 };
        marks.push([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
    }
}
