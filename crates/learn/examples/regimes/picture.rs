//! Picture of a year: the price, the returns and the probabilities of the regimes for each day,
//! with their forecasts.

use std::error::Error;
use std::path::Path;

use plotters::coord::{Shift, types::RangedCoordf64};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::forecast::Forecast;
use super::market::Year;

/// Colours of the regimes from calm to panic: Okabe and Ito's palette, which is safe for the
/// colour-blind.
const COLOURS: [RGBColor; 6] = [
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(0, 158, 115),
    RGBColor(0, 114, 178),
];
pub(crate) const PALE: RGBColor = RGBColor(225, 225, 225);
/// Colours of the central 90% and of the central half of the futures.
const FAN: [RGBColor; 2] = [RGBColor(205, 205, 205), RGBColor(140, 140, 140)];
const SIZE: (u32, u32) = (860, 800);
const HEAD: u32 = 96;

type Drawn = Result<(), Box<dyn Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Contents of the picture.
pub(crate) struct Shown<'a> {
    pub(crate) year: &'a Year,
    /// Names of the regimes.
    pub(crate) names: Vec<String>,
    /// Probabilities of the regimes on each day of the year and of the forecast.
    pub(crate) beliefs: Vec<Vec<f64>>,
    pub(crate) forecast: Forecast,
}

pub(crate) fn font(size: i32, horizontal: HPos) -> TextStyle<'static> {
    let style = TextStyle::from(("sans-serif", size).into_font()).color(&BLACK);
    style.pos(Pos::new(horizontal, VPos::Center))
}

impl Shown<'_> {
    /// Draws the price at the top, the returns below it, and the regimes at the bottom.
    pub(crate) fn draw(&self, file: &Path) -> Drawn {
        let area = SVGBackend::new(file, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let (head, below) = area.split_vertically(HEAD);
        let (price, below) = below.split_vertically(200);
        let (returns, regimes) = below.split_vertically(220);
        self.head(&head)?;
        self.price(&price)?;
        self.returns(&returns)?;
        self.regimes(&area, &regimes)?;
        Ok(area.present()?)
    }

    fn head(&self, area: &Area<'_>) -> Drawn {
        let title = "Regimes of a simulated market, by volatility, with a forecast";
        area.draw(&Text::new(title, (20, 22), font(24, HPos::Left)))?;
        // About eight pixels for a character: text is not measured.
        let mut x = 20;
        for (name, colour) in self.names.iter().zip(COLOURS) {
            area.draw(&Rectangle::new([(x, 48), (x + 18, 62)], colour.filled()))?;
            area.draw(&Text::new(name.clone(), (x + 25, 55), font(18, HPos::Left)))?;
            x += 46 + i32::try_from(8 * name.chars().count())?;
        }
        for (number, text) in ["forecast: central 90%", "central half"].iter().enumerate() {
            let left = 20 + 240 * i32::try_from(number)?;
            area.draw(&Rectangle::new([(left, 76), (left + 18, 90)], FAN[number].filled()))?;
            area.draw(&Text::new(*text, (left + 25, 83), font(18, HPos::Left)))?;
        }
        let note = "strip above the regimes: the true ones";
        Ok(area.draw(&Text::new(note, (840, 83), font(18, HPos::Right)))?)
    }

    /// Draws axes over the days of the year and of the forecast.
    fn chart<'a>(
        &self,
        area: &Area<'a>,
        [above, below]: [u32; 2],
        name: &str,
        [least, most]: [f64; 2],
        digits: usize,
    ) -> Result<Chart<'a>, Box<dyn Error>> {
        let mut chart = ChartBuilder::on(area)
            .margin_right(20)
            .margin_left(4)
            .margin_top(above)
            .y_label_area_size(70)
            .x_label_area_size(below)
            .build_cartesian_2d(0.0..self.beliefs.len() as f64, least..most)?;
        // Only the lowest chart has room for labels of its days.
        let days = if below > 20 { 8 } else { 0 };
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(days)
            .y_labels(5)
            .x_desc(if days > 0 { "day" } else { "" })
            .y_desc(name)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:.digits$}"))
            .label_style(font(16, HPos::Left))
            .axis_desc_style(font(18, HPos::Left))
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .draw()?;
        Ok(chart)
    }

    /// Draws a line between the year and the forecast.
    fn today(&self, chart: &mut Chart<'_>, [least, most]: [f64; 2]) -> Drawn {
        let today = self.year.days.len() as f64;
        let line = [(today, least), (today, most)];
        chart.draw_series([PathElement::new(line, BLACK.stroke_width(2))])?;
        Ok(())
    }

    /// Draws the quantiles of the days after the year as two nested bands.
    fn fan(&self, chart: &mut Chart<'_>, days: &[[f64; 4]]) -> Drawn {
        let first = self.year.days.len() as f64 + 0.5;
        // The wide band first. Each polygon runs forward along its lower edge and back along the
        // upper one.
        for ((low, high), colour) in [(0, 3), (1, 2)].into_iter().zip(FAN) {
            let x = |day: usize| first + day as f64;
            let lower = days.iter().enumerate().map(|(day, at)| (x(day), at[low]));
            let upper = days.iter().enumerate().map(|(day, at)| (x(day), at[high]));
            let outline: Vec<(f64, f64)> = lower.chain(upper.rev()).collect();
            chart.draw_series([Polygon::new(outline, colour.filled())])?;
        }
        Ok(())
    }

    fn price(&self, area: &Area<'_>) -> Drawn {
        // Returns are logarithmic: a price is 100 times the exponential of their sum.
        let mut sum = 0.0;
        let price = |percent: f64| 100.0 * (percent / 100.0).exp();
        let days = self.year.days.iter().map(|seen| {
            sum += seen[0];
            price(sum)
        });
        let prices: Vec<(f64, f64)> =
            days.enumerate().map(|(day, level)| (day as f64 + 0.5, level)).collect();
        let ahead: Vec<[f64; 4]> =
            self.forecast.total.iter().map(|day| day.map(|percent| price(sum + percent))).collect();
        let levels = prices.iter().map(|point| point.1).chain(ahead.iter().flatten().copied());
        let range = around(levels);
        let mut chart = self.chart(area, [6, 8], "price", range, 0)?;
        self.fan(&mut chart, &ahead)?;
        chart.draw_series(LineSeries::new(prices, BLACK.stroke_width(2)))?;
        self.today(&mut chart, range)
    }

    fn returns(&self, area: &Area<'_>) -> Drawn {
        let ahead = &self.forecast.returns;
        let seen = self.year.days.iter().map(|seen| seen[0]);
        let range = around(seen.clone().chain(ahead.iter().flatten().copied()));
        let mut chart = self.chart(area, [12, 8], "return of a day, %", range, 0)?;
        self.fan(&mut chart, ahead)?;
        let bars = seen.enumerate().map(|(day, percent)| {
            let x = day as f64 + 0.5;
            PathElement::new([(x, 0.0), (x, percent)], BLACK.stroke_width(1))
        });
        chart.draw_series(bars)?;
        self.today(&mut chart, range)
    }

    /// Draws the probabilities as stacked bands, and the true regimes as a strip above them.
    fn regimes(&self, whole: &Area<'_>, area: &Area<'_>) -> Drawn {
        let mut chart = self.chart(area, [28, 54], "probability", [0.0, 1.0], 1)?;
        for (state, colour) in COLOURS.iter().enumerate().take(self.names.len()) {
            // The band of a regime is between the sums of the probabilities before it and up to it.
            let up_to = |belief: &[f64], count: usize| belief[..count].iter().sum::<f64>();
            let x = |day: usize| day as f64 + 0.5;
            let days = self.beliefs.iter().enumerate();
            let lower = days.clone().map(|(day, belief)| (x(day), up_to(belief, state)));
            let upper = days.map(|(day, belief)| (x(day), up_to(belief, state + 1)));
            let outline: Vec<(f64, f64)> = lower.chain(upper.rev()).collect();
            chart.draw_series([Polygon::new(outline, colour.filled())])?;
        }
        self.today(&mut chart, [0.0, 1.0])?;

        // The strip is outside the axes, so it is drawn on the whole picture in pixels.
        let plot = chart.plotting_area();
        let mut day = 0;
        for run in self.year.regimes.chunk_by(|a, b| a == b) {
            let [(left, top), (right, _)] =
                [day, day + run.len()].map(|day| plot.map_coordinate(&(day as f64, 1.0)));
            day += run.len();
            let strip = [(left, top - 16), (right, top - 5)];
            whole.draw(&Rectangle::new(strip, COLOURS[run[0]].filled()))?;
        }
        let middle = 0.5 * (day + self.beliefs.len()) as f64;
        let (middle, top) = plot.map_coordinate(&(middle, 1.0));
        Ok(whole.draw(&Text::new("forecast", (middle, top - 11), font(18, HPos::Center)))?)
    }
}

/// Range of values, with a margin.
fn around(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let (least, most) = values.fold(ends, |range, value| (range.0.min(value), range.1.max(value)));
    let room = 0.06 * (most - least);
    [least - room, most + room]
}
