//! Curves as SVG: precision and recall, reliability, recall against lag, ROC.

#![expect(clippy::cast_possible_wrap, reason = "panels are few")]

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::evaluate::{PrecisionRecallPoint, ReliabilityBin};

use super::measures::Measured;
use super::style::{self, Area, Drawn, GREY, Look, PALE, Pixel, anchored, font, shortened};

const PANEL: i32 = 425;
const HEAD: i32 = 72;
const LEGEND: i32 = 250;
const GAP: i32 = 16;
/// Number of steps below which a bin is not drawn.
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
        Self { title, side: PANEL, labels, x_end: 1.0, y_start: 0.0, diagonal: false }
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
    area.draw(&Text::new(title.to_owned(), (20, 14), font(24)))?;
    let name = shortened(name, size.0 as usize / 8);
    area.draw(&Text::new(name, (20, 44), font(17).color(&GREY)))?;
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
    let title = Text::new(axes.title.clone(), (axes.side / 2 + 24, 8), anchored(18, HPos::Center));
    part.draw(&title)?;
    let mut chart = ChartBuilder::on(&part)
        .margin_top(28)
        .margin_right(16)
        .margin_left(4)
        .x_label_area_size(50)
        .y_label_area_size(64)
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
        .axis_desc_style(font(18))
        .label_style(font(16))
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

/// Draws the reliability diagrams of all methods with probabilities of their own, to the first
/// tolerance, in one panel. (Viterbi's are the smoother's.)
pub(crate) fn reliability(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let diagrams: Vec<_> = measured
        .iter()
        .filter(|method| method.method != "viterbi")
        .filter_map(|method| {
            let score = method.scores.first()?;
            Some((&method.method, score.tolerance, score.reliability.as_ref()?))
        })
        .collect();
    let side = 580;
    let title = "Reliability: how often is an answer of some probability right?";
    picture(file, (side + LEGEND, HEAD + side), [title, name], |area| {
        let tolerance = diagrams.first().map_or(0, |of| of.1);
        let title = format!("{}, in bins of at least {FEW} steps", within(tolerance));
        let axes =
            Axes::new(title, "probability that the answer is right", "fraction that is right");
        let axes = Axes { side, diagonal: true, ..axes };
        let at = panel(area, (0, HEAD), &axes)?;
        for (number, (method, _, diagram)) in diagrams.iter().enumerate() {
            let (name, look) = style::of_method(method);
            let bins: Vec<&ReliabilityBin> =
                diagram.bins().iter().filter(|bin| bin.count() >= FEW).collect();
            let mark = |bin: &ReliabilityBin| at((bin.mean_probability(), bin.fraction_true()));
            look.path(area, &bins.iter().map(|bin| mark(bin)).collect::<Vec<_>>())?;
            for bin in bins {
                let (low, high) = interval(bin);
                let bar = [low, high].map(|end| at((bin.mean_probability(), end)));
                area.draw(&PathElement::new(bar, look.pale().colour.stroke_width(1)))?;
                look.sized_mark(area, mark(bin), 5.0)?;
            }
            let (x, y) = (side + 10, HEAD + 60 + 56 * number as i32);
            look.legend(area, (x, y), name.to_owned())?;
            let error = format!("calibration error {:.3}", diagram.expected_calibration_error());
            area.draw(&Text::new(error, (x + 44, y + 22), anchored(16, HPos::Left).color(&GREY)))?;
        }
        let notes = [
            "On the diagonal, it is right",
            "as often as it says.",
            "",
            "Thin bars: 95% intervals,",
            "were steps independent.",
        ];
        for (line, note) in notes.iter().enumerate() {
            let y = HEAD + 90 + 56 * diagrams.len() as i32 + 22 * line as i32;
            area.draw(&Text::new(*note, (side + 10, y), anchored(16, HPos::Left)))?;
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
