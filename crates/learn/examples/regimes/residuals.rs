//! Picture of pseudo-residuals, which show whether the returns are distributed as the model says.

use std::error::Error;
use std::path::Path;

use plotters::coord::{Shift, types::RangedCoordf64};
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::HmmError;
use wayfix_learn::{PseudoResiduals, Tails};

use super::Model;
use super::market::Year;
use super::picture::{PALE, font};

/// Blue of Okabe and Ito's palette.
const POINT: RGBColor = RGBColor(0, 114, 178);
/// Normal quantile u with 95% of the probability between −u and u.
const USUAL: f64 = 1.96;

type Drawn = Result<(), Box<dyn Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Number of points at either end of the QQ plot that are all drawn.
const ENDS: usize = 40;
/// Step between the points drawn elsewhere.
const STEP: usize = 10;

/// Normal forecast residuals of the returns of all years, and of the last one.
pub(crate) struct Residuals {
    all: Vec<f64>,
    last: Vec<f64>,
}

impl Residuals {
    pub(crate) fn new(model: &Model, years: &[Year]) -> Result<Self, HmmError> {
        let (mut all, mut last) = (Vec::new(), Vec::new());
        for year in years {
            let residuals = PseudoResiduals::new(model, year, 0)?;
            // No day is missing, so that `flatten` keeps them all in order.
            last = residuals.forecast().iter().flatten().map(Tails::normal).collect();
            all.extend_from_slice(&last);
        }
        Ok(Self { all, last })
    }

    /// Prints the moments of the residuals, and the share that is far from 0.
    pub(crate) fn describe(&self) {
        let count = self.all.len() as f64;
        let mean = self.all.iter().sum::<f64>() / count;
        let square = self.all.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / count;
        let far = self.all.iter().filter(|z| z.abs() > USUAL).count() as f64 / count;
        println!(
            "\nforecast residuals of returns (under the true model: mean 0, deviation 1, 5% beyond ±{USUAL}):"
        );
        println!("mean {mean:.3}, deviation {:.3}, {:.1}% beyond", square.sqrt(), 100.0 * far);
    }

    /// Draws a QQ plot of all days, and the residuals of the last year over time.
    pub(crate) fn draw(&self, file: &Path) -> Drawn {
        let area = SVGBackend::new(file, (860, 470)).into_drawing_area();
        area.fill(&WHITE)?;
        let (head, below) = area.split_vertically(70);
        let title = "Does the model fit? Forecast residuals of the returns";
        head.draw(&Text::new(title, (20, 22), font(24, HPos::Left)))?;
        let note = "normal quantiles of where each day's return was in its forecast; grey: 95% of a true model";
        head.draw(&Text::new(note, (20, 52), font(18, HPos::Left)))?;
        let (left, right) = below.split_horizontally(400);
        self.quantiles(&left)?;
        self.course(&right)?;
        Ok(area.present()?)
    }

    /// Largest absolute residual, but at least 3.5, with a margin.
    fn range(&self) -> f64 {
        self.all.iter().fold(3.5, |most, z| f64::max(most, z.abs())) + 0.3
    }

    fn chart<'a>(
        &self,
        area: &Area<'a>,
        (least, most): (f64, f64),
        [x, y]: [&str; 2],
    ) -> Result<Chart<'a>, Box<dyn Error>> {
        let range = self.range();
        let mut chart = ChartBuilder::on(area)
            .margin_right(20)
            .margin_left(4)
            .margin_top(8)
            .y_label_area_size(62)
            .x_label_area_size(54)
            .build_cartesian_2d(least..most, -range..range)?;
        chart
            .configure_mesh()
            .x_labels(7)
            .y_labels(9)
            .x_desc(x)
            .y_desc(y)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:.0}"))
            .label_style(font(16, HPos::Left))
            .axis_desc_style(font(18, HPos::Left))
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .draw()?;
        Ok(chart)
    }

    /// Draws the sorted residuals against quantiles of the normal distribution.
    fn quantiles(&self, area: &Area<'_>) -> Drawn {
        let range = self.range();
        let mut chart =
            self.chart(area, (-range, range), ["normal quantile", "residual, all years in order"])?;
        let mut sorted = self.all.clone();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len() as f64;
        // The k-th of n is compared with the quantile at (k − ½) / n.
        let place = |at: usize| {
            let below = (at as f64 + 0.5) / count;
            Tails { below, at: 0.0, above: 1.0 - below }.normal()
        };
        let line = [(-range, -range), (range, range)];
        chart.draw_series([PathElement::new(line, BLACK.stroke_width(1))])?;
        // Thousands of points overlap in the middle, where a tenth of them looks the same.
        let is_drawn =
            |at: usize| at < ENDS || at + ENDS >= sorted.len() || at.is_multiple_of(STEP);
        let points = sorted.iter().enumerate().filter(|(at, _)| is_drawn(*at));
        let points = points.map(|(at, z)| (place(at), *z));
        chart.draw_series(points.map(|point| Circle::new(point, 2, POINT.filled())))?;
        Ok(())
    }

    /// Draws the residuals of the last year, day by day.
    fn course(&self, area: &Area<'_>) -> Drawn {
        let days = self.last.len() as f64;
        let mut chart = self.chart(area, (0.0, days), ["day of the last year", "residual"])?;
        let band = [(0.0, -USUAL), (days, USUAL)];
        chart.draw_series([Rectangle::new(band, PALE.filled())])?;
        chart.draw_series([PathElement::new([(0.0, 0.0), (days, 0.0)], BLACK.stroke_width(1))])?;
        let points = self.last.iter().enumerate().map(|(day, z)| (day as f64 + 0.5, *z));
        chart.draw_series(points.map(|point| Circle::new(point, 2, POINT.filled())))?;
        Ok(())
    }
}
