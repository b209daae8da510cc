//! Image of beliefs as SVG: cells of one shade, darker for more probable.

#![expect(
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "pixels and shades are small numbers"
)]

use std::fmt::Write;
use std::ops::Range;

use plotters::prelude::*;

use super::belief::{HEIGHT, LEFT, TOP, WIDTH};

/// Number of shades: four for each factor of ten, down to 0.0001.
pub(crate) const SHADES: u8 = 16;
pub(crate) const DECADES: i32 = 4;
/// Most runs of one shade; each takes some twenty bytes.
const MOST_RUNS: usize = 40_000;
const CELLS: (usize, usize) = (600, 400);
/// Shade of blue from white (0) to almost black, ever darker.
pub(crate) fn shade(level: u8) -> RGBColor {
    let stops = [(255, 255, 255), (170, 212, 240), (60, 140, 200), (0, 70, 140), (0, 15, 50)];
    let at = f64::from(level) / f64::from(SHADES) * (stops.len() - 1) as f64;
    let below = (at.floor() as usize).min(stops.len() - 2);
    let part = at - below as f64;
    let mix = |a: i32, b: i32| (f64::from(a) + part * f64::from(b - a)).round() as u8;
    let (a, b) = (stops[below], stops[below + 1]);
    RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}

/// Most transparent colour that looks like a shade on white, with its opacity: the truth remains
/// visible below.
fn glaze(RGBColor(red, green, blue): RGBColor) -> (RGBColor, f64) {
    let opacity = 1.0 - f64::from(red.min(green).min(blue)) / 255.0;
    let part = |part: u8| (255.0 - f64::from(255 - part) / opacity.max(0.01)).round() as u8;
    (RGBColor(part(red), part(green), part(blue)), opacity)
}

/// Shade of a probability: 0 below 0.0001, the darkest at 1.
fn level(p: f32) -> u8 {
    let part = 1.0 + f64::from(p).log10() / f64::from(DECADES);
    // A sum of probabilities may exceed 1 by rounding.
    if part > 0.0 { ((part * f64::from(SHADES)).ceil() as u8).min(SHADES) } else { 0 }
}

/// Maxima of a matrix over cells, column by column, with at most the given numbers of steps
/// (columns) and places (rows).
fn cells(belief: &[f32], places: usize, (columns, rows): (usize, usize)) -> Vec<Vec<f32>> {
    let steps = belief.len() / places;
    let (columns, rows) = (columns.min(steps), rows.min(places));
    let mut cells = vec![vec![0.0_f32; rows]; columns];
    for (step, row) in belief.chunks_exact(places).enumerate() {
        let column = &mut cells[step * columns / steps];
        for (place, p) in row.iter().enumerate() {
            let cell = &mut column[place * rows / places];
            *cell = cell.max(*p);
        }
    }
    cells
}

/// Runs of cells of equal shade within a column: shade, column, rows.
fn runs(cells: &[Vec<f32>]) -> Vec<(u8, usize, Range<usize>)> {
    let mut runs = Vec::new();
    for (column, values) in cells.iter().enumerate() {
        let levels: Vec<u8> = values.iter().map(|p| level(*p)).collect();
        let mut start = 0;
        for run in levels.chunk_by(|a, b| a == b) {
            let rows = start..start + run.len();
            start = rows.end;
            if run[0] > 0 {
                runs.push((run[0], column, rows));
            }
        }
    }
    runs
}

/// Image as SVG with one path per shade; coarser if there are too many runs.
pub(crate) fn image(belief: &[f32], places: usize) -> String {
    let (mut size, mut grid) = (CELLS, cells(belief, places, CELLS));
    let mut all = runs(&grid);
    while all.len() > MOST_RUNS {
        size = (size.0 / 2, size.1 / 2);
        grid = cells(belief, places, size);
        all = runs(&grid);
    }
    let (columns, rows) = (grid.len() as i32, grid.first().map_or(1, Vec::len) as i32);
    let x = |column: usize| LEFT + column as i32 * WIDTH / columns;
    let y = |row: usize| TOP + HEIGHT - row as i32 * HEIGHT / rows;
    let mut svg = String::from("<g shape-rendering=\"crispEdges\">\n");
    for level in 1..=SHADES {
        let (RGBColor(red, green, blue), opacity) = glaze(shade(level));
        let mut path = String::new();
        for (_, column, rows) in all.iter().filter(|run| run.0 == level) {
            let (left, width) = (x(*column), x(column + 1) - x(*column));
            let (top, height) = (y(rows.end), y(rows.start) - y(rows.end));
            write!(path, "M{left} {top}h{width}v{height}h-{width}z")
                .expect("a String takes all that is written");
        }
        if !path.is_empty() {
            svg.push_str(&format!(
                "<path fill=\"#{red:02x}{green:02x}{blue:02x}\" fill-opacity=\"{opacity:.3}\" \
                 d=\"{path}\"/>\n"
            ));
        }
    }
    svg.push_str("</g>\n");
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shades_are_decades() {
        let levels =
            [0.0, 1e-5, 9.9e-5, 1.01e-4, 9.9e-4, 0.0011, 0.099, 0.9, 1.0, 1.000_001].map(level);
        assert_eq!(levels, [0, 0, 0, 1, 4, 5, 12, 16, 16, 16]);
        assert_eq!((shade(0), shade(SHADES)), (WHITE, RGBColor(0, 15, 50)));
    }

    #[test]
    fn cells_keep_the_largest() {
        // Three steps of five places.
        let belief: Vec<f32> = (0..15_u8).map(f32::from).collect();
        assert_eq!(cells(&belief, 5, (9, 9)).concat(), belief);
        assert_eq!(cells(&belief, 5, (2, 3)), [[6.0, 8.0, 9.0], [11.0, 13.0, 14.0]]);
        let columns = [vec![0.0, 1.0, 1.0, 0.0], vec![0.099, 0.08, 1.0, 1.0]];
        assert_eq!(runs(&columns), [(16, 0, 1..3), (12, 1, 0..2), (16, 1, 2..4)]);
    }

    #[test]
    fn an_image_stays_small() {
        // The largest possible number of different cells.
        let (steps, places) = (1000, 900);
        let belief =
            (0..steps * places).map(|i| if (i + i / places) % 2 == 0 { 1.0 } else { 0.01 });
        let image = image(&belief.collect::<Vec<f32>>(), places);
        assert!(image.len() < 1_000_000, "{}", image.len());
    }
}
