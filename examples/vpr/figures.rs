//! Curves as SVG: precision and recall, reliability, recall against lag, ROC.

#![expect(clippy::cast_possible_wrap, reason = "panels are few")]

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::evaluate::{PrecisionRecallPoint, ReliabilityBin};

use super::measures::Measured;
use super::style::{self, Area, Drawn, GREY, Look, PALE, Pixel, anchored, font, shortened};

const PANEL: i32 = 440;
const HEAD: i32 = 62;
const LEGEND: i32 = 220;
/// Pictures are at most so wide, so that they can be read on a page.
const WIDTH: i32 = 1100;
/// Bins of fewer steps are drawn pale.
const FEW: usize = 10;

/// A line of a chart.
struct Curve {
    name: String,
    look: Look,
    points: Vec<(f64, f64)>,
}

/// What the axes of a panel are.
struct Axes<'a> {
    title: String,
    /// Of the panel, in pixels.
    side: i32,
    /// Pixels between the title and the plot.
    space: i32,
    x: &'a str,
    y: &'a str,
    x_range: (f64, f64),
    y_range: (f64, f64),
}

fn picture(file: &Path, size: Pixel, with: impl Fn(&Area<'_>) -> Drawn) -> Drawn {
    let size = (size.0.unsigned_abs(), size.1.unsigned_abs());
    let area = SVGBackend::new(file, size).into_drawing_area();
    area.fill(&WHITE)?;
    with(&area)?;
    area.present()?;
    Ok(())
}

fn head(area: &Area<'_>, title: &str, name: &str) -> Drawn {
    area.draw(&Text::new(title.to_owned(), (20, 14), font(20)))?;
    let (width, _) = area.dim_in_pixel();
    let name = shortened(name, width as usize / 8);
    area.draw(&Text::new(name, (20, 40), font(14).color(&GREY)))?;
    Ok(())
}

/// A square panel with its upper left corner at a pixel; returns where values
/// lie in the picture.
fn panel(
    area: &Area<'_>,
    (left, top): Pixel,
    axes: &Axes<'_>,
) -> Result<impl Fn((f64, f64)) -> Pixel, Box<dyn std::error::Error>> {
    let part = area.clone().shrink((left, top), (axes.side, axes.side));
    let title = Text::new(axes.title.clone(), (axes.side / 2 + 24, 8), anchored(15, HPos::Center));
    part.draw(&title)?;
    let mut chart = ChartBuilder::on(&part)
        .margin_top(18 + axes.space)
        .margin_right(16)
        .margin_left(4)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(axes.x_range.0..axes.x_range.1, axes.y_range.0..axes.y_range.1)?;
    let digits = |range: (f64, f64)| match range.1 - range.0 {
        wide if wide > 5.0 => 0,
        wide if wide > 0.45 => 1,
        _ => 2,
    };
    let (x_digits, y_digits) = (digits(axes.x_range), digits(axes.y_range));
    chart
        .configure_mesh()
        .x_desc(axes.x)
        .y_desc(axes.y)
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
    Ok(move |at| plot.map_coordinate(&at))
}

/// Draws curves into a panel, one pixel a point at most.
fn draw(area: &Area<'_>, curves: &[Curve], at: impl Fn((f64, f64)) -> Pixel) -> Drawn {
    for (n, Curve { look, points, .. }) in curves.iter().enumerate() {
        let mut pixels: Vec<Pixel> = points.iter().map(|point| at(*point)).collect();
        pixels.dedup();
        look.line(area, &pixels, n)?;
    }
    Ok(())
}

fn legend(area: &Area<'_>, x: i32, curves: &[Curve]) -> Drawn {
    (0..).zip(curves).try_for_each(|(n, Curve { name, look, .. })| {
        look.legend(area, (x, HEAD + 40 + 28 * n), name.clone())
    })
}

/// A lower end of an axis that ends at 1, in tenths.
fn below(values: impl Iterator<Item = f64>) -> f64 {
    let least = values.fold(1.0, f64::min);
    (least * 10.0).floor().min(9.0) / 10.0
}

/// "within 1 reference".
pub(crate) fn within(tolerance: usize) -> String {
    format!("within {}", super::counted(tolerance, "reference"))
}

/// A panel for each tolerance, a curve for each method: steps, as the area is
/// counted.
pub(crate) fn precision_recall(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let panels = measured.first().map_or(0, |method| method.scores.len());
    let (columns, rows) = (panels.clamp(1, 2) as i32, panels.div_ceil(2) as i32);
    let width = columns * PANEL;
    picture(file, (width + LEGEND, HEAD + rows * PANEL + 10), |area| {
        head(area, "Precision and recall", name)?;
        let precisions = measured.iter().flat_map(|method| &method.scores);
        let precisions = precisions.flat_map(|score| score.curve.points());
        let least = below(precisions.map(PrecisionRecallPoint::precision));
        for number in 0..panels {
            let curves = measured.iter().map(|method| {
                let (mut points, mut recall) = (Vec::new(), 0.0);
                for point in method.scores[number].curve.points() {
                    points.push((recall, point.precision()));
                    recall = point.recall();
                    points.push((recall, point.precision()));
                }
                let (name, look) = style::of_method(&method.method);
                Curve { name: name.to_owned(), look, points }
            });
            let curves: Vec<Curve> = curves.collect();
            let axes = Axes {
                title: within(measured[0].scores[number].tolerance),
                side: PANEL,
                space: 6,
                x: "recall",
                y: "precision",
                x_range: (0.0, 1.0),
                y_range: (least, 1.0),
            };
            let (column, row) = (number as i32 % columns, number as i32 / columns);
            let at = panel(area, (column * PANEL, HEAD + row * PANEL), &axes)?;
            draw(area, &curves, at)?;
            if number == 0 {
                legend(area, width + 10, &curves)?;
            }
        }
        Ok(())
    })
}

/// How well each method knows whether it is on the map; nothing is drawn if no
/// method has a curve.
pub(crate) fn roc(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    picture(file, (PANEL + LEGEND + 40, HEAD + PANEL + 10), |area| {
        head(area, "Is it on the map? ROC", name)?;
        let curves = measured.iter().filter_map(|method| {
            let (name, look) = style::of_method(&method.method);
            let roc = method.roc.as_ref()?;
            let rates =
                roc.points().iter().map(|p| (p.false_positive_rate(), p.true_positive_rate()));
            let points = std::iter::once((0.0, 0.0)).chain(rates).collect();
            Some(Curve { name: format!("{name}, area {:.3}", roc.area()), look, points })
        });
        let curves: Vec<Curve> = curves.collect();
        let axes = Axes {
            title: String::from("of the steps that are reported on"),
            side: PANEL,
            space: 6,
            x: "off the map, but taken for on it",
            y: "on the map, and taken for it",
            x_range: (0.0, 1.0),
            y_range: (0.0, 1.0),
        };
        let at = panel(area, (0, HEAD), &axes)?;
        area.draw(&PathElement::new([at((0.0, 0.0)), at((1.0, 1.0))], PALE))?;
        draw(area, &curves, at)?;
        legend(area, PANEL + 10, &curves)
    })
}

/// Recall against lag, a line for each tolerance.
pub(crate) fn lags(
    file: &Path,
    name: &str,
    tolerances: &[usize],
    lags: &[(usize, Vec<f64>)],
) -> Drawn {
    picture(file, (PANEL + LEGEND, HEAD + PANEL + 10), |area| {
        head(area, "What waiting brings", name)?;
        let curves = tolerances.iter().enumerate().map(|(n, &tolerance)| Curve {
            name: within(tolerance),
            look: style::of_line(n),
            points: lags.iter().map(|(lag, recalls)| (*lag as f64, recalls[n])).collect(),
        });
        let curves: Vec<Curve> = curves.collect();
        let longest = lags.iter().map(|lag| lag.0).max().unwrap_or(0);
        let axes = Axes {
            title: String::from("fixed-lag smoother"),
            side: PANEL,
            space: 6,
            x: "lag, in steps",
            y: "recall",
            x_range: (0.0, longest.max(1) as f64),
            y_range: (below(lags.iter().flat_map(|lag| lag.1.iter().copied())), 1.0),
        };
        let at = panel(area, (0, HEAD), &axes)?;
        for Curve { look, points, .. } in &curves {
            let pixels: Vec<Pixel> = points.iter().map(|point| at(*point)).collect();
            look.path(area, &pixels)?;
            pixels.into_iter().try_for_each(|pixel| look.mark(area, pixel))?;
        }
        legend(area, PANEL + 10, &curves)
    })
}

/// How often answers of some probability are right: for each tolerance, a panel
/// for each method that has probabilities.
pub(crate) fn reliability(file: &Path, name: &str, measured: &[Measured]) -> Drawn {
    let diagrams = |at: usize| {
        measured.iter().filter_map(move |method| {
            let score = method.scores.get(at)?;
            Some((method, score.tolerance, score.reliability.as_ref()?))
        })
    };
    let (columns, side, gap) = (3, WIDTH / 3, 16);
    let rows = diagrams(0).count().div_ceil(columns);
    let tolerances = measured.first().map_or(0, |method| method.scores.len());
    let size = (WIDTH, HEAD + 30 + (rows * tolerances) as i32 * (side + gap));
    picture(file, size, |area| {
        head(area, "Reliability: how often is an answer of some probability right?", name)?;
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
            let axes = Axes {
                title: format!("{name}, {}", within(tolerance)),
                side,
                space: 24,
                x: "probability that the answer is right",
                y: "fraction that is right",
                x_range: (0.0, 1.0),
                y_range: (0.0, 1.0),
            };
            let (column, row) = ((number % columns) as i32, (number / columns) as i32);
            let at = panel(area, (column * side, HEAD + 30 + row * (side + gap)), &axes)?;
            area.draw(&PathElement::new([at((0.0, 0.0)), at((1.0, 1.0))], GREY))?;
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

/// Wilson's interval of 95% for the fraction of a bin that is right.
fn interval(bin: &ReliabilityBin) -> (f64, f64) {
    let (z, n, p) = (1.96, bin.count() as f64, bin.fraction_true());
    let scale = 1.0 + z * z / n;
    let middle = (p + z * z / (2.0 * n)) / scale;
    let half = z / scale * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    ((middle - half).max(0.0), (middle + half).min(1.0))
}
