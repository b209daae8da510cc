//! Picture of the belief over time: the more probable, the darker, with the truth as a pale band;
//! below it, the probability of being off the map.

#![expect(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "small numbers")]

use std::{ops::Range, path::Path};

use plotters::prelude::*;

use super::pictures::{Area, GREY, font, head, label, legend, path};
use super::{Estimates, Fallible, Task};

/// Pale orange: all shades of blue are visible on it.
const TRUTH: RGBColor = RGBColor(255, 200, 110);
const BELIEF: RGBColor = RGBColor(0, 40, 100);
/// Number of shades: two for each factor of ten, down to 0.0001.
const SHADES: usize = 8;
/// Heights of the head, of the picture below it, and of the track for off the map.
const HEIGHTS: [i32; 3] = [92, 470, 170];

/// Draws smoothed beliefs, and the probability of being off the map, if it was estimated.
pub(crate) fn draw(file: &Path, task: Task<'_>, estimates: &Estimates) -> Fallible {
    let Task { recording, split, .. } = task;
    let off_map = estimates.fit.options().off_map().is_some();
    let [top, main, track] = HEIGHTS;
    let height = (top + main + if off_map { track } else { 0 }).unsigned_abs();
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (900, height)).into_drawing_area();
    head(&area, "Where the smoother believes it is", &recording.name)?;
    let part = |top: i32, height: i32| area.clone().shrink((8, top), (892, height));
    let ends = (recording.steps() as f64, recording.references as f64);
    let plot = Plot::new(&part(top, main), ends, ["step", "reference"])?;
    if off_map {
        let track = Plot::new(&part(top + main, track), (ends.0, 1.0), ["", ""])?;
        let (left, top) = (track.across.start, track.down.start - 12);
        label(&area, "probability of being off the map", (left, top), 17)?;
        let [(_, live), _, (_, smoothed)] = &estimates.answers;
        for (n, (name, answers)) in (1..).zip([("filter", live), ("smoother", smoothed)]) {
            let at = |(step, p)| (track.x(step as f64 + 0.5), track.y(p));
            let points = answers.iter().map(|answer| answer.off_map).enumerate().map(at);
            path(&area, name, points.collect())?;
            legend(&area, name, (left + 130 + 150 * n, top))?;
        }
    }
    let truth = recording.truth.as_ref();
    let off = truth.is_some_and(|truth| truth.contains(&None));
    let entries = [
        (true, BELIEF.mix(0.25), 12, "0.001"),
        (true, BELIEF.mix(0.5), 12, "0.01"),
        (true, BELIEF.mix(0.75), 12, "0.1"),
        (true, BELIEF.mix(1.0), 12, "1, belief"),
        (truth.is_some(), TRUTH.mix(1.0), 12, "truth"),
        (off, TRUTH.mix(0.5), 18, "off the map"),
        (!split.fit_on.is_empty(), GREY.mix(1.0), 6, "learned from"),
    ];
    let mut left = plot.across.start;
    for (_, colour, tall, text) in entries.into_iter().filter(|entry| entry.0) {
        let mark = [(left, 84 - tall / 2), (left + 26, 84 + tall / 2)];
        area.draw(&Rectangle::new(mark, colour.filled()))?;
        label(&area, text, (left + 32, 84), 17)?;
        left += 56 + 8 * text.len() as i32;
    }
    area.present()?;
    drop(area);
    // Thousands of cells are small as paths, one for each shade; they go above what was drawn.
    let end = svg.rfind("</svg>").ok_or("the picture has no end")?;
    svg.insert_str(end, &image(task, &estimates.belief, &plot));
    Ok(std::fs::write(file, svg)?)
}

/// Axes from 0, and the pixels that they take.
struct Plot {
    across: Range<i32>,
    down: Range<i32>,
    ends: (f64, f64),
}

impl Plot {
    fn new(area: &Area<'_>, ends: (f64, f64), names: [&str; 2]) -> Fallible<Self> {
        let mut chart = ChartBuilder::on(area)
            .margin_top(24)
            .margin_right(16)
            .x_label_area_size(46)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..ends.0, 0.0..ends.1)?;
        let (across, down) = chart.plotting_area().get_pixel_range();
        let mut mesh = chart.configure_mesh();
        mesh.disable_mesh().x_desc(names[0]).y_desc(names[1]).y_labels(down.len() / 50);
        mesh.x_label_formatter(&f64::to_string).y_label_formatter(&f64::to_string);
        mesh.axis_desc_style(font(18)).label_style(font(17)).draw()?;
        Ok(Self { across, down, ends })
    }

    fn x(&self, value: f64) -> i32 {
        self.across.start + (value * self.across.len() as f64 / self.ends.0).round() as i32
    }

    fn y(&self, value: f64) -> i32 {
        self.down.end - (value * self.down.len() as f64 / self.ends.1).round() as i32
    }
}

/// Shade of a probability: 0 below 0.0001, the darkest at 1.
fn shade(p: f32) -> usize {
    // A sum of probabilities may exceed 1 by rounding.
    ((1.0 + f64::from(p).log10() / 4.0) * SHADES as f64).ceil().clamp(0.0, SHADES as f64) as usize
}

/// Truth and belief as SVG paths, one for each colour.
fn image(Task { recording, split, .. }: Task<'_>, belief: &[f32], plot: &Plot) -> String {
    let n = recording.references;
    let mut paths = vec![(TRUTH, 1.0), (TRUTH, 0.5), (GREY, 1.0)];
    paths.extend((1..=SHADES).map(|shade| (BELIEF, shade as f64 / SHADES as f64)));
    let mut boxes = vec![String::new(); paths.len()];
    let mut fill = |path: usize, across: (f64, f64), (top, bottom): (i32, i32)| {
        let (left, wide) = (plot.x(across.0), plot.x(across.1) - plot.x(across.0));
        boxes[path] += &format!("M{left} {top}h{wide}v{}h-{wide}z", bottom - top);
    };
    let Range { start: top, end: bottom } = plot.down;
    for (step, truth) in recording.truth.iter().flatten().enumerate() {
        let across = (step as f64, step as f64 + 1.0);
        match truth.as_ref().map(|truth| [truth.end() + 1, *truth.start()]) {
            Some(ends) => {
                let [top, bottom] = ends.map(|place| plot.y(place as f64));
                let middle = top.midpoint(bottom);
                fill(0, across, (top.min(middle - 6), bottom.max(middle + 6)));
            }
            None => fill(1, across, (top, bottom)),
        }
    }
    for Range { start, end } in &split.fit_on {
        fill(2, (*start as f64, *end as f64), (top - 9, top - 3));
    }
    // Each cell shows its largest probability: a mean would hide a narrow belief.
    let (columns, rows) = (recording.steps().min(600), n.min(400));
    let mut cells = vec![0.0_f32; rows * columns];
    for (at, p) in belief.iter().enumerate() {
        let (column, row) = (at / n * columns / recording.steps(), at % n * rows / n);
        cells[column * rows + row] = cells[column * rows + row].max(*p);
    }
    let (wide, tall) = (plot.ends.0 / columns as f64, plot.ends.1 / rows as f64);
    for (column, cells) in cells.chunks_exact(rows).enumerate() {
        let mut row = 0;
        for run in cells.chunk_by(|a, b| shade(*a) == shade(*b)) {
            let [top, bottom] = [row + run.len(), row].map(|row| plot.y(tall * row as f64));
            row += run.len();
            if shade(run[0]) > 0 {
                let across = (wide * column as f64, wide * (column + 1) as f64);
                fill(2 + shade(run[0]), across, (top, bottom));
            }
        }
    }
    let paths = paths.iter().zip(boxes).map(|((RGBColor(r, g, b), opacity), boxes)| {
        format!("<path fill=\"rgb({r},{g},{b})\" fill-opacity=\"{opacity}\" d=\"{boxes}\"/>\n")
    });
    format!("<g shape-rendering=\"crispEdges\">\n{}</g>\n", paths.collect::<String>())
}
