//! Picture of the belief over time: steps along the first axis, places along the second, darker
//! for more probable, with the true places as a thin line.

#![expect(
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "pixels and shades are small numbers"
)]

use std::fmt::Write;
use std::fs;
use std::ops::Range;
use std::path::Path;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::recording::Recording;
use super::style::{Area, Drawn, GREY, VERMILLION, anchored, font, shortened};

/// Number of shades: four for each factor of ten, down to 0.0001.
const SHADES: u8 = 16;
const DECADES: i32 = 4;
const BACKGROUND: &str = "/>\n";
/// Most runs of one shade; each takes some twenty bytes.
const MOST_RUNS: usize = 40_000;
const CELLS: (usize, usize) = (600, 400);
const LEFT: i32 = 72;
const TOP: i32 = 84;
const WIDTH: i32 = 900;
const HEIGHT: i32 = 480;

/// Shade of blue from white (0) to almost black, ever darker.
fn shade(level: u8) -> RGBColor {
    let stops = [(255, 255, 255), (170, 212, 240), (60, 140, 200), (0, 70, 140), (0, 15, 50)];
    let at = f64::from(level) / f64::from(SHADES) * (stops.len() - 1) as f64;
    let below = (at.floor() as usize).min(stops.len() - 2);
    let part = at - below as f64;
    let mix = |a: i32, b: i32| (f64::from(a) + part * f64::from(b - a)).round() as u8;
    let (a, b) = (stops[below], stops[below + 1]);
    RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
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
fn image(belief: &[f32], places: usize) -> String {
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
        let RGBColor(red, green, blue) = shade(level);
        let mut path = String::new();
        for (_, column, rows) in all.iter().filter(|run| run.0 == level) {
            let (left, width) = (x(*column), x(column + 1) - x(*column));
            let (top, height) = (y(rows.end), y(rows.start) - y(rows.end));
            write!(path, "M{left} {top}h{width}v{height}h-{width}z")
                .expect("a String takes all that is written");
        }
        if !path.is_empty() {
            svg.push_str(&format!(
                "<path fill=\"#{red:02x}{green:02x}{blue:02x}\" d=\"{path}\"/>\n"
            ));
        }
    }
    svg.push_str("</g>\n");
    svg
}

/// Draws beliefs, one row of places per step.
pub(crate) fn draw(
    file: &Path,
    recording: &Recording,
    belief: &[f32],
    learned: &[Range<usize>],
) -> Drawn {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (1080, 640)).into_drawing_area();
    area.fill(&WHITE)?;
    frame(&area, recording, learned)?;
    area.present()?;
    drop(area);
    // The image goes between the background, which comes first, and the rest.
    let ground = svg.find(BACKGROUND).map_or(0, |at| at + BACKGROUND.len());
    svg.insert_str(ground, &image(belief, recording.references));
    Ok(fs::write(file, svg)?)
}

fn frame(area: &Area<'_>, recording: &Recording, learned: &[Range<usize>]) -> Drawn {
    let (steps, places) = (recording.steps(), recording.references);
    let x = |step: f64| LEFT + (step * f64::from(WIDTH) / steps as f64).round() as i32;
    let y = |place: f64| TOP + HEIGHT - (place * f64::from(HEIGHT) / places as f64).round() as i32;
    area.draw(&Text::new("Belief of the smoother", (20, 14), font(20)))?;
    let name = shortened(&recording.name, 130);
    area.draw(&Text::new(name, (20, 40), font(14).color(&GREY)))?;

    // The truth, interrupted where it leaves the map or goes around the loop, in dashes through
    // which the belief is visible.
    let dashes = |mut line: Vec<(i32, i32)>| -> Drawn {
        line.dedup();
        let width = if steps.max(places) > 300 { 1 } else { 2 };
        let dashes = DashedPathElement::new(line, 4, 5, VERMILLION.stroke_width(width));
        Ok(area.draw(&dashes)?)
    };
    let mut line: Vec<(i32, i32)> = Vec::new();
    let mut before = None;
    for (step, truth) in recording.truth.iter().enumerate() {
        let middle = truth.as_ref().map(|t| 0.5 * (t.start() + t.end() + 1) as f64);
        let near = |m: f64| before.is_some_and(|b: f64| (m - b).abs() < 0.5 * places as f64);
        if !middle.is_some_and(near) && !line.is_empty() {
            dashes(std::mem::take(&mut line))?;
        }
        line.extend(middle.map(|middle| (x(step as f64 + 0.5), y(middle))));
        before = middle;
        if truth.is_none() {
            let mark = [(x(step as f64), TOP - 9), (x(step as f64 + 1.0), TOP - 3)];
            area.draw(&Rectangle::new(mark, VERMILLION.filled()))?;
        }
    }
    dashes(line)?;
    for range in learned {
        let mark =
            [(x(range.start as f64), TOP + HEIGHT + 3), (x(range.end as f64), TOP + HEIGHT + 9)];
        area.draw(&Rectangle::new(mark, GREY.filled()))?;
    }
    area.draw(&Rectangle::new([(LEFT, TOP), (LEFT + WIDTH, TOP + HEIGHT)], GREY))?;

    // Axes.
    for step in ticks(steps) {
        let at = (x(step as f64 + 0.5), TOP + HEIGHT + 22);
        area.draw(&Text::new(step.to_string(), at, anchored(13, HPos::Center)))?;
    }
    for place in ticks(places) {
        let at = (LEFT - 8, y(place as f64 + 0.5));
        area.draw(&Text::new(place.to_string(), at, anchored(13, HPos::Right)))?;
    }
    let at = (LEFT + WIDTH / 2, TOP + HEIGHT + 44);
    area.draw(&Text::new("step", at, anchored(15, HPos::Center)))?;
    let turned = anchored(15, HPos::Center).transform(FontTransform::Rotate270);
    area.draw(&Text::new("reference", (18, TOP + HEIGHT / 2), turned))?;

    // Legend.
    let legend = |left: i32, colour: RGBColor, text: &str| -> Drawn {
        let mark = [(left, 53), (left + 26, 59)];
        area.draw(&Rectangle::new(mark, colour.filled()))?;
        let at = (left + 34, 56);
        Ok(area.draw(&Text::new(text.to_owned(), at, anchored(13, HPos::Left)))?)
    };
    let left = LEFT + 480;
    dashes(vec![(left, 56), (left + 26, 56)])?;
    area.draw(&Text::new("truth", (left + 34, 56), anchored(13, HPos::Left)))?;
    if recording.truth.contains(&None) {
        legend(LEFT + 580, VERMILLION, "truly off the map")?;
    }
    legend(LEFT + 760, GREY, "learned from")?;

    // Colour scale.
    let (left, tall) = (LEFT + WIDTH + 24, 320);
    let height = |level: u8| TOP + tall - i32::from(level) * tall / i32::from(SHADES);
    area.draw(&Text::new("probability", (left - 4, TOP - 12), anchored(13, HPos::Left)))?;
    for level in 1..=SHADES {
        let cell = [(left, height(level)), (left + 18, height(level - 1))];
        area.draw(&Rectangle::new(cell, shade(level).filled()))?;
    }
    area.draw(&Rectangle::new([(left, TOP), (left + 18, TOP + tall)], GREY))?;
    for decade in 0..=DECADES {
        let at = (left + 24, TOP + decade * tall / DECADES);
        let text = 10_f64.powi(-decade).to_string();
        area.draw(&Text::new(text, at, anchored(13, HPos::Left)))?;
    }
    Ok(())
}

/// At most nine round numbers below an end.
fn ticks(end: usize) -> impl Iterator<Item = usize> {
    let decades = (0..).map_while(|k| 10_usize.checked_pow(k));
    let mut steps = decades.flat_map(|decade| [decade, 2 * decade, 5 * decade]);
    let step = steps.find(|step| end.div_ceil(*step) <= 9).unwrap_or(end);
    (0..end).step_by(step)
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

    #[test]
    fn ticks_are_round() {
        assert_eq!(
            ticks(1788).collect::<Vec<_>>(),
            [0, 200, 400, 600, 800, 1000, 1200, 1400, 1600]
        );
        assert_eq!(ticks(3).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(ticks(1).collect::<Vec<_>>(), [0]);
    }
}
