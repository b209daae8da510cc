//! Picture of a year: the price, the probabilities of the regimes day by day, and the forecast.

use std::error::Error;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::market::Year;

// Okabe and Ito's palette, which is safe for the colour-blind, from calm to panic.
const COLOURS: [RGBColor; 6] = [
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(0, 158, 115),
    RGBColor(0, 114, 178),
];
const GREY: RGBColor = RGBColor(110, 110, 110);
const PALE: RGBColor = RGBColor(225, 225, 225);
const SIZE: (u32, u32) = (900, 560);

fn font(size: i32) -> TextStyle<'static> {
    TextStyle::from(("sans-serif", size).into_font()).color(&BLACK)
}

/// Draws the price above, and the regimes below it.
pub(crate) fn draw(
    file: &Path,
    year: &Year,
    probabilities: &[Vec<f64>],
    forecast: &[Vec<f64>],
) -> Result<(), Box<dyn Error>> {
    let area = SVGBackend::new(file, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    area.draw(&Text::new("Regimes of a simulated market, with a forecast", (20, 14), font(20)))?;
    let days = year.days.len();
    let all = (days + forecast.len()) as f64;
    let (_, below) = area.split_vertically(70);
    let (price, regimes) = below.split_vertically(220);

    let mut level = 100.0;
    let prices: Vec<(f64, f64)> = (1..)
        .zip(&year.days)
        .map(|(day, seen)| {
            level *= (seen[0] / 100.0).exp();
            (f64::from(day), level)
        })
        .collect();
    let (least, most) = prices
        .iter()
        .fold((100.0_f64, 100.0_f64), |range, point| (range.0.min(point.1), range.1.max(point.1)));
    let room = 0.08 * (most - least);
    let mut chart = ChartBuilder::on(&price)
        .margin_right(20)
        .margin_left(10)
        .y_label_area_size(64)
        .x_label_area_size(12)
        .build_cartesian_2d(0.0..all, least - room..most + room)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(0)
        .y_labels(5)
        .y_desc("price")
        .y_label_formatter(&|y| format!("{y:.0}"))
        .label_style(font(13))
        .axis_desc_style(font(15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .draw()?;
    chart.draw_series(LineSeries::new(prices, BLACK.stroke_width(2)))?;

    let mut chart = ChartBuilder::on(&regimes)
        .margin_right(20)
        .margin_left(10)
        .margin_top(22)
        .margin_bottom(8)
        .y_label_area_size(64)
        .x_label_area_size(44)
        .build_cartesian_2d(0.0..all, 0.0..1.0)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(8)
        .y_labels(5)
        .x_desc("day")
        .y_desc("probability of the regime")
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.2}"))
        .label_style(font(13))
        .axis_desc_style(font(15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .draw()?;
    let states = probabilities[0].len();
    let beliefs: Vec<&Vec<f64>> = probabilities.iter().chain(forecast).collect();
    for (state, colour) in COLOURS.iter().enumerate().take(states) {
        let up_to = |belief: &[f64], count: usize| belief[..count].iter().sum::<f64>();
        let x = |day: usize| day as f64 + 0.5;
        let lower = beliefs.iter().enumerate().map(|(day, b)| (x(day), up_to(b, state)));
        let upper = beliefs.iter().enumerate().map(|(day, b)| (x(day), up_to(b, state + 1)));
        let outline: Vec<(f64, f64)> = lower.chain(upper.rev()).collect();
        chart.draw_series([Polygon::new(outline, colour.filled())])?;
    }
    let today = days as f64;
    chart.draw_series([PathElement::new([(today, 0.0), (today, 1.0)], BLACK.stroke_width(2))])?;

    let plot = chart.plotting_area().clone();
    let (_, top) = plot.map_coordinate(&(0.0, 1.0));
    for (day, &regime) in year.regimes.iter().enumerate() {
        let (left, _) = plot.map_coordinate(&(day as f64, 1.0));
        let (right, _) = plot.map_coordinate(&(day as f64 + 1.0, 1.0));
        let colour = COLOURS[regime].filled();
        area.draw(&Rectangle::new([(left, top - 14), (right, top - 5)], colour))?;
    }
    let (middle, _) = plot.map_coordinate(&(today + 0.5 * forecast.len() as f64, 1.0));
    let centred = font(14).pos(Pos::new(HPos::Center, VPos::Center));
    area.draw(&Text::new("forecast", (middle, top - 10), centred))?;

    let left = font(14).pos(Pos::new(HPos::Left, VPos::Center));
    for (state, colour) in COLOURS.iter().enumerate().take(states) {
        let x = 84 + 110 * i32::try_from(state)?;
        area.draw(&Rectangle::new([(x, 48), (x + 18, 60)], colour.filled()))?;
        area.draw(&Text::new(format!("regime {state}"), (x + 25, 54), left.clone()))?;
    }
    let note = font(13).color(&GREY).pos(Pos::new(HPos::Right, VPos::Center));
    area.draw(&Text::new("thin band: the true regimes", (880, 54), note))?;
    Ok(area.present()?)
}
