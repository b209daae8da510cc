//! Figures of the paper as SVG: the map, true and estimated places; and Table 1 as intervals.

#![expect(clippy::cast_possible_wrap, reason = "pixels and places are small numbers")]

use std::error::Error;
use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use wayfix::canberra;
use wayfix::map::{RoadClass, RoadMap};

use crate::experiment::{Drive, Estimator, Row, SETTINGS, STEPS};
use crate::layout::{self, Layout};
use crate::matrix;
use crate::moment::{self, Moment};

/// A picture with its caption.
pub(crate) struct Figure {
    pub(crate) file: String,
    pub(crate) caption: String,
}

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(crate) type Drawn = Result<(), Box<dyn Error>>;

// Okabe and Ito's palette, which colour-blind readers can tell apart.
pub(crate) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(crate) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(crate) const GREY: RGBColor = RGBColor(110, 110, 110);
const RED: RGBColor = RGBColor(190, 30, 45);

fn colour(estimator: Estimator) -> RGBColor {
    match estimator {
        Estimator::Raw => GREY,
        Estimator::Filter => VERMILLION,
        Estimator::Smoother => BLUE,
        Estimator::Viterbi => GREEN,
    }
}

pub(crate) fn font(size: i32) -> TextStyle<'static> {
    TextStyle::from(("sans-serif", size).into_font()).color(&BLACK)
}

pub(crate) fn anchored(style: &TextStyle<'static>, horizontal: HPos) -> TextStyle<'static> {
    style.pos(Pos::new(horizontal, VPos::Center))
}

/// Draws all pictures into a folder, in the order of the page.
pub(crate) fn draw_all(
    folder: &Path,
    map: &RoadMap,
    rows: &[Row],
    seed: u64,
) -> Result<Vec<Figure>, Box<dyn Error>> {
    let mut figures = Vec::new();
    let mut draw =
        |file: &str, size, caption: String, with: &dyn Fn(&Area<'_>) -> Drawn| -> Drawn {
            let path = folder.join(file);
            let area = SVGBackend::new(&path, size).into_drawing_area();
            area.fill(&WHITE)?;
            with(&area)?;
            area.present()?;
            figures.push(Figure { file: file.to_owned(), caption });
            Ok(())
        };

    let moment = Moment::of(&SETTINGS[0], seed)?;
    draw("belief.svg", moment::SIZE, moment.caption(map), &|area| moment.draw(area, map))?;

    let caption = "Table 1 as distributions: the mean accuracy (dot) and the central 95% of single \
                   drives (bar), with the paper's figure (diamond), which is one drive.";
    draw("table1.svg", (900, 480), caption.into(), &|area| table1(area, rows))?;

    let caption = "Fig. 1: the 105 places and the roads between them. Wider lines are higher \
                   classes; arrows mark one-way roads. Road geometry © OpenStreetMap \
                   contributors, ODbL 1.0.";
    draw("fig01_map.svg", (layout::WIDTH, layout::HEIGHT), caption.into(), &|area| {
        road_map(area, map)
    })?;

    // The paper's figures 2 to 10: filter, smoother and both, for each setting.
    let mut number = 2;
    for setting in &SETTINGS {
        let drive = setting.drive(seed, 0)?;
        for shown in [
            &[Estimator::Filter][..],
            &[Estimator::Smoother],
            &[Estimator::Filter, Estimator::Smoother],
        ] {
            let names: Vec<String> = shown.iter().map(Estimator::to_string).collect();
            let names = names.join(" and ");
            let caption = format!(
                "Fig. {number}: true and estimated place by {names}; {setting}. The first drive of \
                 the seed, not a chosen one."
            );
            let title = format!("{setting}: {names}");
            let file = format!(
                "fig{number:02}_start{}_sigma{}_{}.svg",
                setting.initial,
                setting.sigma,
                names.replace(' ', "_")
            );
            draw(&file, (900, 440), caption, &|area| track(area, &title, &drive, shown))?;
            number += 1;
        }
    }

    let transition = canberra::turning().into_transition();
    let caption = "Fig. A: the transition matrix. Columns, the ways out of a place, sum to one.";
    draw("figA_transition.svg", (970, 860), caption.into(), &|area| {
        matrix::draw(
            area,
            "Transition matrix A",
            "from place",
            "to place",
            &matrix::entries(&transition),
        )
    })?;
    let sensor = canberra::sensor(1.0)?;
    let diagonal = (0..canberra::PLACES).filter_map(|i| sensor.probability(i, i)).sum::<f64>();
    let caption = format!(
        "Fig. B: the observation matrix with Gaussian noise of sigma 1. The mean of the diagonal is \
         {} before the noise and {:.2} with it. Columns sum to one.",
        canberra::MEAN_CORRECT,
        diagonal / canberra::PLACES as f64
    );
    draw("figB_observation.svg", (970, 860), caption, &|area| {
        // Transposed beside the table of the sensor, whose rows are places: a column is a true
        // place.
        let places = 0..canberra::PLACES;
        let pairs = places.clone().flat_map(|y| places.clone().map(move |x| (y, x)));
        let values = pairs.filter_map(|(y, x)| Some((y, x, sensor.probability(x, y)?)));
        matrix::draw(
            area,
            "Observation matrix",
            "true place",
            "place seen",
            &values.collect::<Vec<_>>(),
        )
    })?;
    Ok(figures)
}

/// Draws means and intervals beside the paper's values.
fn table1(area: &Area<'_>, rows: &[Row]) -> Drawn {
    let (left, right, top, step) = (230, 870, 66, 28);
    let x =
        |accuracy: f64| left + (f64::from(right - left) * (accuracy - 0.2) / 0.8).round() as i32;
    area.draw(&Text::new("Accuracy over 50 steps", (20, 16), font(24)))?;
    let bottom = top + SETTINGS.len() as i32 * (4 * step + 16) - 10;
    for tenth in 2..=10 {
        let at = x(f64::from(tenth) / 10.0);
        area.draw(&PathElement::new([(at, top - 14), (at, bottom)], RGBColor(220, 220, 220)))?;
        let label = format!("{:.1}", f64::from(tenth) / 10.0);
        area.draw(&Text::new(label, (at, bottom + 14), anchored(&font(17), HPos::Center)))?;
    }
    for (i, row) in rows.iter().enumerate() {
        let group = (i / 4) as i32;
        let y = top + i as i32 * step + group * 16;
        let style = colour(row.estimator);
        if i % 4 == 0 {
            let name = format!("start {}, σ = {}", row.setting.initial, row.setting.sigma);
            area.draw(&Text::new(name, (20, y), anchored(&font(17), HPos::Left)))?;
        }
        let name = row.estimator.to_string();
        area.draw(&Text::new(name, (left - 14, y), anchored(&font(17), HPos::Right)))?;
        let bar = [(x(row.lo95.max(0.2)), y - 5), (x(row.hi95), y + 5)];
        area.draw(&Rectangle::new(bar, style.mix(0.35).filled()))?;
        area.draw(&Circle::new((x(row.mean), y), 5, style.filled()))?;
        if let Some(paper) = row.paper() {
            area.draw(&diamond((x(paper), y)))?;
        }
    }
    let y = 26;
    area.draw(&Rectangle::new([(400, y - 5), (450, y + 5)], GREY.mix(0.35).filled()))?;
    area.draw(&Text::new("95% of drives", (458, y), anchored(&font(17), HPos::Left)))?;
    area.draw(&Circle::new((590, y), 5, GREY.filled()))?;
    area.draw(&Text::new("mean", (602, y), anchored(&font(17), HPos::Left)))?;
    area.draw(&diamond((670, y)))?;
    area.draw(&Text::new("the paper (one drive)", (682, y), anchored(&font(17), HPos::Left)))?;
    Ok(())
}

fn diamond((x, y): (i32, i32)) -> Polygon<(i32, i32)> {
    Polygon::new([(x, y - 7), (x + 7, y), (x, y + 7), (x - 7, y)], BLACK.filled())
}

/// Draws places as numbered dots, and roads as lines.
fn road_map(area: &Area<'_>, map: &RoadMap) -> Drawn {
    let layout = Layout::of(map);
    let stroke = |class| match class {
        RoadClass::Main => 8,
        RoadClass::Arterial => 5,
        RoadClass::Collector => 3,
        RoadClass::Street => 1,
    };
    for road in &layout.roads {
        let style = BLUE.mix(0.75).stroke_width(stroke(road.class));
        area.draw(&PathElement::new(road.line, style))?;
        if let Some(arrow) = road.arrow() {
            area.draw(&Polygon::new(arrow, BLUE.filled()))?;
        }
    }
    for (place, &at) in map.places().iter().zip(&layout.places) {
        area.draw(&Circle::new(at, 12, RED.filled()))?;
        let style = anchored(&font(14).color(&WHITE), HPos::Center);
        area.draw(&Text::new(place.id.to_string(), at, style))?;
    }
    let title = "Central Canberra: 105 places, 315 directed roads";
    area.draw(&Text::new(title, (40, 18), font(26)))?;
    let mut x = 700;
    for class in [RoadClass::Main, RoadClass::Arterial, RoadClass::Collector, RoadClass::Street] {
        let line = [(x, 32), (x + 40, 32)];
        area.draw(&PathElement::new(line, BLUE.mix(0.75).stroke_width(stroke(class))))?;
        area.draw(&Text::new(class.to_string(), (x + 48, 32), anchored(&font(18), HPos::Left)))?;
        x += 150;
    }
    let line = [(x, 32), (x + 40, 32)];
    area.draw(&PathElement::new(line, BLUE.mix(0.75).stroke_width(2)))?;
    area.draw(&Polygon::new(layout::arrow(line), BLUE.filled()))?;
    area.draw(&Text::new("one way", (x + 48, 32), anchored(&font(18), HPos::Left)))?;
    let credit = "Road geometry © OpenStreetMap contributors, ODbL 1.0";
    let at = (layout::WIDTH as i32 - 20, layout::HEIGHT as i32 - 18);
    area.draw(&Text::new(credit, at, anchored(&font(16), HPos::Right)))?;
    Ok(())
}

/// Draws the true place at each step, and estimates.
fn track(area: &Area<'_>, title: &str, drive: &Drive, shown: &[Estimator]) -> Drawn {
    let (head, body) = area.split_vertically(44);
    head.draw(&Text::new(title.to_owned(), (20, 14), font(18)))?;
    let mut chart = ChartBuilder::on(&body)
        .margin_right(20)
        .margin_left(8)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..STEPS as f64 + 1.0, 0.0..107.0)?;
    chart
        .configure_mesh()
        .x_desc("step")
        .y_desc("place")
        .x_labels(11)
        .y_labels(11)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .axis_desc_style(font(15))
        .label_style(font(13))
        .light_line_style(TRANSPARENT)
        .draw()?;
    let points = |places: &[usize]| -> Vec<(f64, f64)> {
        places.iter().zip(1..).map(|(&i, k)| (f64::from(k), i as f64 + 1.0)).collect()
    };
    let mut truth = vec![(0.0, drive.initial as f64 + 1.0)];
    truth.extend(points(&drive.truth));
    chart.draw_series(LineSeries::new(truth.clone(), BLACK.mix(0.6)))?;
    chart.draw_series(truth.into_iter().map(|at| Circle::new(at, 3, BLACK.filled())))?;

    let mut x = 330;
    let legend =
        |x: i32, text: String| Text::new(text, (x + 16, 24), anchored(&font(14), HPos::Left));
    head.draw(&Circle::new((x, 24), 3, BLACK.filled()))?;
    head.draw(&legend(x, "true place".into()))?;
    x += 130;
    for &estimator in shown {
        let estimate = &drive.estimates[estimator as usize];
        let style = colour(estimator).stroke_width(2);
        let correct = estimate.iter().zip(&drive.truth).filter(|(a, b)| a == b).count();
        let accuracy = correct as f64 / estimate.len() as f64;
        let text = format!("{estimator} ({accuracy:.2} right)");
        head.draw(&legend(x, text))?;
        if estimator == Estimator::Filter {
            head.draw(&Cross::new((x, 24), 6, style))?;
            chart.draw_series(points(estimate).into_iter().map(|at| Cross::new(at, 6, style)))?;
        } else {
            head.draw(&Circle::new((x, 24), 7, style))?;
            chart.draw_series(points(estimate).into_iter().map(|at| Circle::new(at, 7, style)))?;
        }
        x += 200;
    }
    Ok(())
}
