//! The map at one step of a drive: the true place, the sighting, and the beliefs of filter and
//! smoother, as the replay shows them.

use std::error::Error;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::map::{RoadClass, RoadMap};

use crate::experiment::{Estimator, Setting};
use crate::figures::{Area, BLUE, Drawn, GREY, VERMILLION, anchored, font};
use crate::layout::Layout;
use crate::replay::{FULL, LEAST};

pub(crate) const SIZE: (u32, u32) = (860, 800);

/// Step at which, with the default seed, sighting, filter and smoother name three places.
const STEP: usize = 32;
const SCALE: f64 = 0.56;
/// Upper left corner of the map.
const CORNER: (i32, i32) = (10, 86);
const PALE: RGBColor = RGBColor(201, 201, 201);

type Pixel = (i32, i32);

/// A step of the first drive in a setting.
pub(crate) struct Moment {
    setting: Setting,
    /// True places, from the start to this step.
    trail: Vec<usize>,
    truth: usize,
    seen: usize,
    filter: Vec<f64>,
    smoother: Vec<f64>,
}

/// Most probable place with its probability; the first one on ties.
fn mode(belief: &[f64]) -> (usize, f64) {
    let most =
        |best: (usize, f64), p: (usize, &f64)| if *p.1 > best.1 { (p.0, *p.1) } else { best };
    belief.iter().enumerate().fold((0, 0.0), most)
}

fn scaled((x, y): Pixel) -> Pixel {
    let at = |value: i32| (SCALE * f64::from(value)).round() as i32;
    (CORNER.0 + at(x), CORNER.1 + at(y - 50))
}

fn text(area: &Area<'_>, text: String, size: i32, at: Pixel) -> Drawn {
    Ok(area.draw(&Text::new(text, at, anchored(&font(size), HPos::Left)))?)
}

impl Moment {
    pub(crate) fn of(setting: &Setting, seed: u64) -> Result<Self, Box<dyn Error>> {
        let drive = setting.drive(seed, 0)?;
        let [mut filter, mut smoother] = setting.beliefs(&drive)?;
        let at = STEP - 1;
        let mut trail = vec![drive.initial];
        trail.extend(&drive.truth[..=at]);
        Ok(Self {
            setting: *setting,
            trail,
            truth: drive.truth[at],
            seen: drive.estimates[Estimator::Raw as usize][at],
            filter: filter.swap_remove(at),
            smoother: smoother.swap_remove(at),
        })
    }

    /// Caption of the picture.
    pub(crate) fn caption(&self, map: &RoadMap) -> String {
        let name = |place: usize| map.places()[place].id;
        let [filter, smoother] = [&self.filter, &self.smoother].map(|belief| mode(belief));
        format!(
            "Step {STEP} of the first drive ({}): the vehicle is at place {}, its camera names {}. \
             The filter favours {} ({:.2}), the smoother {} ({:.2}). The area of a \
             circle is the probability of its place, the dark line the route driven. Road geometry \
             © OpenStreetMap contributors, ODbL 1.0.",
            self.setting,
            name(self.truth),
            name(self.seen),
            name(filter.0),
            filter.1,
            name(smoother.0),
            smoother.1
        )
    }

    pub(crate) fn draw(&self, area: &Area<'_>, map: &RoadMap) -> Drawn {
        let layout = Layout::of(map);
        let at = |place: usize| scaled(layout.places[place]);
        for road in &layout.roads {
            let width = match road.class {
                RoadClass::Street => 2,
                RoadClass::Collector => 3,
                RoadClass::Arterial => 5,
                RoadClass::Main => 7,
            };
            area.draw(&PathElement::new(road.line.map(scaled), PALE.stroke_width(width)))?;
        }
        for place in 0..layout.places.len() {
            area.draw(&Circle::new(at(place), 4, WHITE.filled()))?;
            area.draw(&Circle::new(at(place), 4, GREY))?;
        }
        let trail: Vec<Pixel> = self.trail.iter().map(|place| at(*place)).collect();
        area.draw(&PathElement::new(trail, BLACK.mix(0.55).stroke_width(3)))?;

        for (place, p) in self.filter.iter().enumerate().filter(|(_, p)| **p >= LEAST) {
            disc(area, at(place), SCALE * FULL * p.sqrt())?;
        }
        for (place, p) in self.smoother.iter().enumerate().filter(|(_, p)| **p >= LEAST) {
            ring(area, at(place), SCALE * FULL * p.sqrt())?;
        }
        sighting(area, at(self.seen), 21)?;
        truth(area, at(self.truth))?;
        self.probabilities(area, &layout)?;
        self.legend(area)?;
        let note = "area of a circle: its probability; dark line: the route driven";
        text(area, note.into(), 16, (16, SIZE.1.cast_signed() - 16))?;
        let credit = "Road geometry © OpenStreetMap contributors, ODbL 1.0";
        let corner = (SIZE.0.cast_signed() - 16, SIZE.1.cast_signed() - 16);
        let style = anchored(&font(16).color(&GREY), HPos::Right);
        Ok(area.draw(&Text::new(credit, corner, style))?)
    }

    /// Labels the largest probability of each belief at its place, outside of what is drawn there.
    fn probabilities(&self, area: &Area<'_>, layout: &Layout) -> Drawn {
        let directions = layout.directions(40.0);
        let [filter, smoother] = [&self.filter, &self.smoother].map(|belief| mode(belief));
        let mut labels = vec![(filter.0, percent(filter.1))];
        if smoother.0 == filter.0 {
            labels[0].1 += &format!(", {}", percent(smoother.1));
        } else {
            labels.push((smoother.0, percent(smoother.1)));
        }
        for (place, label) in labels {
            let p = self.filter[place].max(self.smoother[place]);
            let clear: f64 = if place == self.seen { 21.0 } else { 8.0 };
            // In the direction with most room, far enough that neither circle nor mark is covered.
            let away = 26.0 + clear.max(SCALE * FULL * p.sqrt());
            let ((x, y), (dx, dy)) = (scaled(layout.places[place]), directions[place]);
            let away = away / dx.hypot(dy);
            let at = (x + (away * dx).round() as i32, y + (away * dy).round() as i32);
            let bold = TextStyle::from(("sans-serif", 24, FontStyle::Bold).into_font());
            let style = anchored(&bold.color(&BLACK), HPos::Center);
            let half = 7 * label.chars().map(|_| 1).sum::<i32>();
            let back = [(at.0 - half, at.1 - 12), (at.0 + half, at.1 + 12)];
            area.draw(&Rectangle::new(back, WHITE.mix(0.8).filled()))?;
            area.draw(&Text::new(label, at, style))?;
        }
        Ok(())
    }

    /// Explains the marks in words, so that the picture needs no caption.
    fn legend(&self, area: &Area<'_>) -> Drawn {
        let place = |place| if place == self.truth { "the right place" } else { "a wrong place" };
        let believed = |belief: &[f64]| {
            let (mode, p) = mode(belief);
            format!("{} at {}", percent(p), place(mode))
        };
        let left = CORNER.0 + 16;
        let right = left + 270;
        truth(area, (left + 4, 30))?;
        text(area, "where the car is".into(), 20, (left + 30, 30))?;
        sighting(area, (left + 4, 66), 10)?;
        text(area, format!("its camera: {}", place(self.seen)), 20, (left + 30, 66))?;
        disc(area, (right, 30), 12.0)?;
        let filter = format!("filter, from sightings so far: {}", believed(&self.filter));
        text(area, filter, 20, (right + 24, 30))?;
        ring(area, (right, 66), 12.0)?;
        let smoother = format!("smoother, from later ones too: {}", believed(&self.smoother));
        text(area, smoother, 20, (right + 24, 66))
    }
}

fn percent(p: f64) -> String {
    format!("{:.0}%", 100.0 * p)
}

/// Draws a circle of the filter.
fn disc(area: &Area<'_>, at: Pixel, radius: f64) -> Drawn {
    let radius = (radius.round() as i32).max(1);
    Ok(area.draw(&Circle::new(at, radius, VERMILLION.mix(0.7).filled()))?)
}

/// Draws a circle of the smoother as a ring, so that the filter's stays visible inside.
fn ring(area: &Area<'_>, at: Pixel, radius: f64) -> Drawn {
    let radius = (radius.round() as i32).max(1);
    let width = radius.min(5);
    let style = BLUE.stroke_width(width.unsigned_abs());
    Ok(area.draw(&Circle::new(at, radius - width / 2, style))?)
}

fn sighting(area: &Area<'_>, (x, y): Pixel, half: i32) -> Drawn {
    let corners = [(x, y - half), (x + half, y), (x, y + half), (x - half, y), (x, y - half)];
    for (colour, width) in [(WHITE, 6), (BLACK, 3)] {
        area.draw(&PathElement::new(corners, colour.stroke_width(width)))?;
    }
    Ok(())
}

fn truth(area: &Area<'_>, at: Pixel) -> Drawn {
    area.draw(&Circle::new(at, 9, WHITE.filled()))?;
    Ok(area.draw(&Circle::new(at, 7, BLACK.filled()))?)
}
