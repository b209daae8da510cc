//! A page that replays drives: the map, and at each step the true place, the observation, and the
//! beliefs of filter and smoother.

use std::error::Error;
use std::fmt::Write;
use std::num::NonZeroUsize;

use serde_json::{Value, json};
use wayfix::map::{RoadClass, RoadMap};

use crate::experiment::{Estimator, SETTINGS, STEPS, Setting};
use crate::layout::{Layout, RoadLine};

/// Number of drives of each setting that can be replayed.
const DRIVES: usize = 10;
/// Least probability that the page includes; the `LISTED` most probable places are always included.
pub(crate) const LEAST: f64 = 0.001;
const LISTED: usize = 5;
/// Radius of the circle of probability 1, in pixels of the layout.
pub(crate) const FULL: f64 = 70.0;
/// Probabilities are written in units of 1 / `UNITS`.
const UNITS: f64 = 10_000.0;

const TEMPLATE: &str = include_str!("replay.html");
const SCRIPT: &str = include_str!("replay.js");

/// Creates the page with all its data.
pub(crate) fn html(map: &RoadMap, runs: NonZeroUsize, seed: u64) -> Result<String, Box<dyn Error>> {
    let drives = runs.get().min(DRIVES) as u64;
    let settings = SETTINGS.iter().map(|setting| {
        let drives = (0..drives).map(|run| drive(setting, seed, run));
        Ok(json!({
            "name": format!("start {}, σ = {}", setting.initial, setting.sigma),
            "drives": drives.collect::<Result<Vec<Value>, Box<dyn Error>>>()?,
        }))
    });
    let places = map.places().iter().map(|place| json!([place.id, place.name]));
    let data = json!({
        "units": UNITS,
        "listed": LISTED,
        "full": FULL,
        "places": places.collect::<Vec<_>>(),
        "settings": settings.collect::<Result<Vec<Value>, Box<dyn Error>>>()?,
    });
    // Prevents names from closing the element that holds the data.
    let data = data.to_string().replace('<', "\\u003c");
    let layout = Layout::of(map);
    Ok(TEMPLATE
        .replace("{{steps}}", &STEPS.to_string())
        .replace("{{seed}}", &seed.to_string())
        .replace("{{map}}", &svg(&layout))
        .replace("{{numbers}}", &numbers(map, &layout))
        .replace("{{script}}", SCRIPT)
        .replace("{{data}}", &data))
}

fn drive(setting: &Setting, seed: u64, run: u64) -> Result<Value, Box<dyn Error>> {
    let drive = setting.drive(seed, run)?;
    let [filter, smoother] = setting.beliefs(&drive)?;
    Ok(json!({
        "initial": drive.initial,
        "truth": drive.truth,
        "seen": drive.estimates[Estimator::Raw as usize],
        "filter": filter.iter().map(|belief| told(belief)).collect::<Vec<_>>(),
        "smoother": smoother.iter().map(|belief| told(belief)).collect::<Vec<_>>(),
    }))
}

/// Encodes a belief as place, probability, place, probability …, most probable first; ties go to
/// the lowest place, so the first entry is the mode.
#[expect(clippy::cast_sign_loss, reason = "probabilities are not negative")]
fn told(belief: &[f64]) -> Vec<u32> {
    let mut places: Vec<(usize, f64)> = belief.iter().copied().enumerate().collect();
    places.sort_by(|a, b| b.1.total_cmp(&a.1));
    let told = places
        .iter()
        .enumerate()
        .take_while(|(i, (_, p))| *p > 0.0 && (*i < LISTED || *p >= LEAST));
    told.flat_map(|(_, &(place, p))| [place as u32, (p * UNITS).round() as u32]).collect()
}

/// Draws the map and, for each place, the circles of filter and smoother, which the script resizes.
fn svg(layout: &Layout) -> String {
    let mut svg = String::new();
    let mut put = |text: std::fmt::Arguments<'_>| {
        svg.write_fmt(text).expect("a String takes all that is written");
    };
    for class in [RoadClass::Street, RoadClass::Collector, RoadClass::Arterial, RoadClass::Main] {
        put(format_args!("<path class=\"road {class}\" d=\""));
        for road in layout.roads.iter().filter(|road| road.class == class) {
            let [(x, y), (to_x, to_y)] = road.line;
            put(format_args!("M{x} {y}L{to_x} {to_y}"));
        }
        put(format_args!("\"/>\n"));
    }
    put(format_args!("<path class=\"arrows\" d=\""));
    for [a, b, c] in layout.roads.iter().filter_map(RoadLine::arrow) {
        put(format_args!("M{} {}L{} {}L{} {}Z", a.0, a.1, b.0, b.1, c.0, c.1));
    }
    put(format_args!("\"/>\n"));
    for (group, radius) in [("places", 7), ("filter", 0), ("smoother", 0)] {
        if group == "filter" {
            put(format_args!("<polyline id=\"trail\"/>\n"));
        }
        put(format_args!("<g id=\"{group}\">"));
        for (x, y) in &layout.places {
            put(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>"));
        }
        put(format_args!("</g>\n"));
    }
    svg
}

/// Draws the number of each place, in the direction with the most room.
fn numbers(map: &RoadMap, layout: &Layout) -> String {
    let directions = layout.directions(24.0);
    let places = map.places().iter().zip(&layout.places).zip(directions);
    let texts = places.map(|((place, (x, y)), (dx, dy))| {
        format!("<text x=\"{x}\" y=\"{y}\" data-direction=\"{dx:.2} {dy:.2}\">{}</text>", place.id)
    });
    format!("<g id=\"numbers\">{}</g>\n", texts.collect::<String>())
}
