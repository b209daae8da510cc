//! Curves as SVG: precision and recall, reliability, recall against lag, ROC.

#![expect(clippy::cast_possible_wrap, reason = "panels are few")]

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::evaluate::{PrecisionRecallPoint, ReliabilityBin};

use super::measures::Measured;
use super::style::{self, Area, Drawn, GREY, Look, PALE, Pixel, anchored, font, shortened};

const PANEL: i32 = 425;
const HEAD: i32 = 62;
const LEGEND: i32 = 250;
const GAP: i32 = 16;
/// Largest width of a picture that is readable on a page.
const WIDTH: i32 = 1100;
/// Number of steps below which a bin is drawn pale.
const FEW: usize = 10;

/// A curve of a chart.
struct Curve {
    name: String,
    look: Look,
    points: Vec<(f64, f64)>,
}

/// Axes of a panel, both from 0 to 1 by default.
struct Axes {
    title: String,
    /// Side of the panel, in pixels.
    side: i32,
    /// Space between the title and the plot, in pixels.
    space: i32,
    labels: [&'static str; 2],
    /// End of the first axis.
    x_end: f64,
    /// Start of the second axis.
    y_start: f64,
    diagonal: bool,
}

impl Axes {
    fn new(title: String, x: &'static str, y: &'static str) -> Self {
        let labels = [x, y];
        Self { title, side: PANEL, space: 6, labels, x_end: 1.0, y_start: 0.0, diagonal: false }
    }
}

fn picture(
    file: &Path,
    (width, height): Pixel,
    [title, name]: [&str; 2],
    with: impl Fn(&Area<'_>) -> Drawn,
) -> Drawn {
    let size = (width.unsigned_abs(), height.unsigned_abs());
    let area = SVGBackend::new(file, size).into_drawing_area();
    area.fill(&WHITE)?;
    area.draw(&Text::new(title.to_owned(), (20, 14), font(20)))?;
    let name = shortened(name, size.0 as usize / 8);
    area.draw(&Text::new(name, (20, 40), font(14).color(&GREY)))?;
    with(&area)?;
    Ok(area.present()?)
}

/// Draws a square panel with its upper left corner at a pixel; returns the map from values to
/// pixels.
fn panel(
    area: &Area<'_>,
    corner: Pixel,
    axes: &Axes,
) -> Result<impl Fn((f64, f64)) -> Pixel, Box<dyn std::error::Error>> {
    let part = area.clone().shrink(corner, (axes.side, axes.side));
    let title = Text::new(axes.title.clone(), (axes.side / 2 + 24, 8), anchored(15, HPos::Center));
    part.draw(&title)?;
    let mut chart = ChartBuilder::on(&part)
        .margin_top(18 + axes.space)
        .margin_right(16)
        .margin_left(4)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(0.0..axes.x_end, axes.y_start..1.0)?;
    let x_digits = usize::from(axes.x_end <= 5.0);
    let y_digits = if axes.y_start < 0.55 { 1 } else { 2 };
    chart
        .configure_mesh()
        .x_desc(axes.labels[0])
        .y_desc(axes.labels[1])
        .x_labels(6)
        .y_labels(6)
        .x_label_formatter(&|x| format!("{x:.x_digits$}"))
        .y_label_formatter(&|y| format!("{y:.y_digits$}"))
        .axis_desc_style(font(15))
        .label_style(font(13))
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .draw()?;
    let plot = chart.plotting_area().clone();
    let at = move |point| plot.map_coordinate(&point);
    if axes.diagonal {
        area.draw(&PathElement::new([at((0.0, 0.0)), at((1.0, 1.0))], GREY))?;
    }
    Ok(at)
}

/// Draws panels of curves, two in a row, with the legend of the first beside them.
fn curves(file: &Path, titles: [&str; 2], panels: &[(Axes, Vec<Curve>)]) -> Drawn {
    let (columns, rows) = (panels.len().clamp(1, 2), panels.len().div_ceil(2) as i32);
    let width = columns as i32 * PANEL;
    picture(file, (width + LEGEND, HEAD + rows * (PANEL + GAP)), titles, |area| {
        for (number, (axes, curves)) in panels.iter().enumerate() {
            let (column, row) = ((number % columns) as i32, (number / columns) as i32);
            let at = panel(area, (column * PANEL, HEAD + row * (PANEL + GAP)), axes)?;
            for (n, Curve { name, look, points }) in curves.iter().enumerate() {
                let mut pixels: Vec<Pixel> = points.iter().map(|point| at(*point)).collect();
                pixels.dedup();
                if pixels.len() < 20 {
                    look.path(area, &pixels)?;
                    pixels.iter().try_for_each(|pixel| look.mark(area, *pixel))?;
                } else {
                    look.line(area, &pixels, n)?;
                }
                if number == 0 {
                    let place = (width + 10, HEAD + 40 + 28 * n as i32);
                    look.legend(area, place, name.clone())?;
                }
            }
        }
        Ok(())
    })
}

/// Lower end of an axis that ends at 1, in tenths.
fn below(values: impl Iterator<Item = f64>) -> f64 {
    let least = values.fold(1.0, f64::min);
    (least * 10.0).floor().min(9.0) / 10.0
}

/// Formats a tolerance, as "within 1 reference".
pub(crate) fn within(tolerance: usize) -> String {
    format!("within {}", super::counted(tolerance, "reference"))
}

/// Draws one panel per tolerance and one curve per method, in steps, as the area is computed.
pub(crate) fn precision_recall(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let scores = measured.iter().flat_map(|method| &method.scores);
    let points = scores.flat_map(|score| score.curve.points());
    let least = below(points.map(PrecisionRecallPoint::precision));
    let tolerances = measured.first().into_iter().flat_map(|method| &method.scores);
    let panels = tolerances.enumerate().map(|(number, score)| {
        let steps = measured.iter().map(|method| {
            let (mut points, mut recall) = (Vec::new(), 0.0);
            for point in method.scores[number].curve.points() {
                points.push((recall, point.precision()));
                recall = point.recall();
                points.push((recall, point.precision()));
            }
            let (name, look) = style::of_method(&method.method);
            Curve { name: name.to_owned(), look, points }
        });
        let axes = Axes::new(within(score.tolerance), "recall", "precision");
        (Axes { y_start: least, ..axes }, steps.collect())
    });
    curves(file, ["Precision and recall", name], &panels.collect::<Vec<_>>())
}

/// Draws the ROC curve of each method for being on the map.
pub(crate) fn roc(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let lines = measured.iter().filter_map(|method| {
        let (name, look) = style::of_method(&method.method);
        let roc = method.roc.as_ref()?;
        let rates = roc.points().iter().map(|p| (p.false_positive_rate(), p.true_positive_rate()));
        let points = std::iter::once((0.0, 0.0)).chain(rates).collect();
        Some(Curve { name: format!("{name}: {:.3}", roc.area()), look, points })
    });
    let title = String::from("of the steps that are reported on, with areas");
    let axes = Axes::new(title, "off the map, but taken for on it", "on the map, and taken for it");
    let axes = Axes { diagonal: true, ..axes };
    curves(file, ["Is it on the map? ROC", name], &[(axes, lines.collect())])
}

/// Draws recall against lag, one curve per tolerance.
pub(crate) fn lags(
    file: &Path,
    name: &str,
    tolerances: &[usize],
    lags: &[(usize, Vec<f64>)],
) -> Drawn {
    let lines = tolerances.iter().enumerate().map(|(n, &tolerance)| Curve {
        name: within(tolerance),
        look: style::of_line(n),
        points: lags.iter().map(|(lag, recalls)| (*lag as f64, recalls[n])).collect(),
    });
    let longest = lags.iter().map(|lag| lag.0).max().unwrap_or(0).max(1);
    let axes = Axes {
        x_end: longest as f64,
        y_start: below(lags.iter().flat_map(|lag| lag.1.iter().copied())),
        ..Axes::new(String::from("fixed-lag smoother"), "lag, in steps", "recall")
    };
    curves(file, ["What waiting brings", name], &[(axes, lines.collect())])
}

/// Draws reliability diagrams, one panel for each tolerance and each method with probabilities.
pub(crate) fn reliability(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let diagrams = |at: usize| {
        measured.iter().filter_map(move |method| {
            let score = method.scores.get(at)?;
            Some((method, score.tolerance, score.reliability.as_ref()?))
        })
    };
    let (columns, side) = (3, WIDTH / 3);
    let rows = diagrams(0).count().div_ceil(columns);
    let tolerances = measured.first().map_or(0, |method| method.scores.len());
    let size = (WIDTH, HEAD + 30 + (rows * tolerances) as i32 * (side + GAP));
    let title = "Reliability: how often is an answer of some probability right?";
    picture(file, size, [title, name], |area| {
        let note = format!(
            "Marks grow with the steps of a bin, whose number is above; of fewer than {FEW} they \
             are pale. Bars: 95% intervals, were steps independent."
        );
        area.draw(&Text::new(note, (20, 64), font(13)))?;
        let panels = (0..tolerances).flat_map(|at| {
            diagrams(at).enumerate().map(move |(number, of)| (at * rows * columns + number, of))
        });
        for (number, (method, tolerance, diagram)) in panels {
            let (name, look) = style::of_method(&method.method);
            let title = format!("{name}, {}", within(tolerance));
            let x = "probability that the answer is right";
            let axes = Axes::new(title, x, "fraction that is right");
            let axes = Axes { side, space: 24, diagonal: true, ..axes };
            let (column, row) = ((number % columns) as i32, (number / columns) as i32);
            let at = panel(area, (column * side, HEAD + 30 + row * (side + GAP)), &axes)?;
            let mark = |bin: &ReliabilityBin| at((bin.mean_probability(), bin.fraction_true()));
            look.pale().path(area, &diagram.bins().iter().map(mark).collect::<Vec<_>>())?;
            let most = diagram.bins().iter().map(ReliabilityBin::count).max().unwrap_or(1);
            for bin in diagram.bins() {
                let look = if bin.count() < FEW { look.pale() } else { look };
                let (low, high) = interval(bin);
                let p = bin.mean_probability();
                let bar = [at((p, low)), at((p, high))];
                area.draw(&PathElement::new(bar, look.colour.stroke_width(1)))?;
                let radius = 3.0 + 4.0 * (bin.count() as f64 / most as f64).sqrt();
                look.sized_mark(area, mark(bin), radius)?;
                let middle = 0.5 * (bin.lower() + bin.upper());
                let above = (at((middle, 1.0)).0, at((0.0, 1.0)).1 - 14);
                let count = match bin.count() {
                    count if count < 10_000 => count.to_string(),
                    count => format!("{}k", count / 1000),
                };
                area.draw(&Text::new(count, above, anchored(11, HPos::Center).color(&GREY)))?;
            }
        }
        Ok(())
    })
}

/// Wilson's 95% interval for the fraction of right answers in a bin.
fn interval(bin: &ReliabilityBin) -> (f64, f64) {
    let (z, n, p) = (1.96, bin.count() as f64, bin.fraction_true());
    let scale = 1.0 + z * z / n;
    let middle = (p + z * z / (2.0 * n)) / scale;
    let half = z / scale * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    ((middle - half).max(0.0), (middle + half).min(1.0))
}
