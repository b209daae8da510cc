//! Pictures of curves as SVG: precision and recall, and reliability. The library's methods have
//! solid lines, baselines dashed ones.

use std::path::Path;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Fallible, Measured};

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Curve = (&'static str, Vec<(f64, f64)>);

pub(crate) const GREY: RGBColor = RGBColor(110, 110, 110);
/// Methods with their colours, from Okabe and Ito's palette for the colour-blind, and lengths of
/// dashes, 0 for a solid line.
const METHODS: [(&str, RGBColor, u32); 11] = [
    ("nearest", GREY, 3),
    ("single", BLACK, 3),
    ("seqslam_trailing", RGBColor(86, 180, 233), 9),
    ("seqslam_centred", RGBColor(0, 114, 178), 9),
    ("plain_hmm", RGBColor(230, 159, 0), 6),
    ("plain_hmm_smoothed", RGBColor(204, 121, 167), 6),
    ("simple_filter", RGBColor(213, 94, 0), 3),
    ("simple_smoother", RGBColor(0, 158, 115), 3),
    ("filter", RGBColor(213, 94, 0), 0),
    ("fixed_lag", RGBColor(230, 159, 0), 0),
    ("smoother", RGBColor(0, 158, 115), 0),
];
/// Number of steps below which a bin is not drawn.
const FEW: usize = 10;

pub(crate) fn font(size: i32) -> TextStyle<'static> {
    TextStyle::from(("sans-serif", size).into_font()).color(&BLACK)
}

/// Draws text anchored at its left end and middle.
pub(crate) fn label(area: &Area<'_>, text: &str, at: (i32, i32), size: i32) -> Fallible {
    let style = font(size).pos(Pos::new(HPos::Left, VPos::Center));
    Ok(area.draw(&Text::new(text.to_owned(), at, style))?)
}

/// Draws the title of a picture, and the name of the recording, shortened to the width.
pub(crate) fn head(area: &Area<'_>, title: &str, name: &str) -> Fallible {
    area.fill(&WHITE)?;
    let name: String = name.chars().take(area.dim_in_pixel().0 as usize / 9).collect();
    label(area, title, (20, 24), 24)?;
    label(area, &name, (20, 52), 17)
}

fn look(method: &str) -> (RGBColor, u32) {
    let known = METHODS.iter().find(|known| known.0 == method);
    known.map_or((GREY, 0), |&(_, colour, dash)| (colour, dash))
}

/// Draws a line in the style of a method.
pub(crate) fn path(area: &Area<'_>, method: &str, points: Vec<(i32, i32)>) -> Fallible {
    let (colour, dash) = look(method);
    let style = colour.stroke_width(2);
    if dash == 0 {
        return Ok(area.draw(&PathElement::new(points, style))?);
    }
    Ok(area.draw(&DashedPathElement::new(points, dash, dash / 2 + 2, style))?)
}

/// Draws a legend entry: a short line and the name of the method.
pub(crate) fn legend(area: &Area<'_>, method: &str, (x, y): (i32, i32)) -> Fallible {
    path(area, method, vec![(x, y), (x + 34, y)])?;
    label(area, &method.replace('_', " "), (x + 44, y), 17)
}

/// Draws curves from 0 to 1, with a legend beside them.
fn draw(file: &Path, titles: [&str; 3], axes: [&str; 2], curves: &[Curve]) -> Fallible {
    let area = SVGBackend::new(file, (700, 520)).into_drawing_area();
    head(&area, titles[0], titles[1])?;
    let all = curves.iter().flat_map(|curve| &curve.1);
    // The axis starts at the tenth below the lowest point, but shows at least the top tenth.
    let bottom = (all.map(|point| point.1).fold(1.0, f64::min) * 10.0).floor().min(9.0) / 10.0;
    let part = area.clone().shrink((8, 72), (440, 440));
    let mut chart = ChartBuilder::on(&part)
        .caption(titles[2], font(18))
        .margin_right(16)
        .x_label_area_size(50)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..1.0, bottom..1.0)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(axes[0]).y_desc(axes[1]).x_labels(6).y_labels(6);
    mesh.x_label_formatter(&|x| format!("{x:.1}")).y_label_formatter(&|y| format!("{y:.2}"));
    mesh.axis_desc_style(font(18)).label_style(font(16)).light_line_style(TRANSPARENT).draw()?;
    let plot = chart.plotting_area().as_coord_spec();
    for (n, (method, points)) in (0..).zip(curves) {
        let mut pixels: Vec<_> = points.iter().map(|point| plot.translate(point)).collect();
        pixels.dedup();
        for pixel in pixels.iter().filter(|_| pixels.len() < 12) {
            area.draw(&Circle::new(*pixel, 4, look(method).0.stroke_width(2)))?;
        }
        path(&area, method, pixels)?;
        legend(&area, method, (458, 112 + 28 * n))?;
    }
    Ok(area.present()?)
}

/// Draws precision and recall of each method as steps, which is how the area is computed.
pub(crate) fn precision_recall(file: &Path, name: &str, first: &[&Measured]) -> Fallible {
    let mut curves: Vec<Curve> = Vec::new();
    for score in first {
        let (mut points, mut recall) = (Vec::new(), 0.0);
        for point in score.curve.points() {
            points.extend([(recall, point.precision), (point.recall, point.precision)]);
            recall = point.recall;
        }
        curves.push((score.name, points));
    }
    let title = format!("within {} of the truth", first[0].tolerance);
    draw(file, ["Precision and recall", name, &title], ["recall", "precision"], &curves)
}

/// Draws the reliability diagrams of all methods with probabilities.
pub(crate) fn reliability(file: &Path, name: &str, first: &[&Measured]) -> Fallible {
    let mut curves: Vec<Curve> = vec![("as it says", vec![(0.0, 0.0), (1.0, 1.0)])];
    for (score, diagram) in first.iter().flat_map(|of| of.reliability.iter().map(move |d| (of, d)))
    {
        let points = diagram.iter().filter(|bin| bin.count >= FEW);
        let points = points.map(|bin| (bin.mean_probability, bin.fraction_true));
        curves.push((score.name, points.collect()));
    }
    let title = format!("within {} of the truth, bins of at least {FEW} steps", first[0].tolerance);
    let axes = ["probability that the answer is right", "fraction that is right"];
    draw(file, ["Reliability", name, &title], axes, &curves)
}
