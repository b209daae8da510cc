//! Picture of the belief over time: steps along the first axis, places along the second, darker
//! for more probable, on a pale band that is the truth; below, the probability of being off the
//! map.

#![expect(
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "pixels and shades are small numbers"
)]

use std::fs;
use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::recording::{Answers, Recording};
use super::shades::{DECADES, SHADES, image, shade};
use super::style::{self, Area, Drawn, GREY, PALE, anchored, font, shortened};

/// Pale orange, in which all shades of blue are visible.
const TRUTH: RGBColor = RGBColor(255, 200, 110);
pub(crate) const LEFT: i32 = 72;
pub(crate) const TOP: i32 = 104;
pub(crate) const WIDTH: i32 = 720;
pub(crate) const HEIGHT: i32 = 400;
/// Top and height of the track below, if there is one.
const TRACK: (i32, i32) = (TOP + HEIGHT + 40, 100);

/// Draws beliefs, one row of places per step, and the probability of being off the map by each of
/// some methods, if it was estimated.
pub(crate) fn draw(
    file: &Path,
    recording: &Recording,
    belief: &[f32],
    methods: &[Answers],
    learned: &[Range<usize>],
) -> Drawn {
    let shown = ["filter", "smoother"].map(|name| methods.iter().find(|m| m.method == name));
    let shown: Vec<&Answers> =
        shown.into_iter().flatten().filter(|method| method.on_map.is_some()).collect();
    let bottom = if shown.is_empty() { TOP + HEIGHT } else { TRACK.0 + TRACK.1 };
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (900, bottom as u32 + 64)).into_drawing_area();
    area.fill(&WHITE)?;
    let scale = Scale { steps: recording.steps(), places: recording.references };
    scale.truth(&area, recording, bottom)?;
    // The image goes between the truth, which is drawn first, and the rest.
    area.draw(&Rectangle::new([(LEFT, TOP), (LEFT + WIDTH, TOP + HEIGHT)], GREY))?;
    scale.frame(&area, recording, bottom, learned)?;
    if !shown.is_empty() {
        scale.off_map(&area, &shown)?;
    }
    area.present()?;
    drop(area);
    let frame = format!("<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\"");
    let ground = svg.find(&frame).ok_or("the picture has no frame")?;
    svg.insert_str(ground, &image(belief, recording.references));
    Ok(fs::write(file, svg)?)
}

/// Numbers of steps and places, which the axes show.
struct Scale {
    steps: usize,
    places: usize,
}

impl Scale {
    fn x(&self, step: f64) -> i32 {
        LEFT + (step * f64::from(WIDTH) / self.steps as f64).round() as i32
    }

    fn y(&self, place: f64) -> i32 {
        TOP + HEIGHT - (place * f64::from(HEIGHT) / self.places as f64).round() as i32
    }

    /// Draws the truth as a band, interrupted where it leaves the map or goes around the loop,
    /// and a column for the steps off the map.
    fn truth(&self, area: &Area<'_>, recording: &Recording, bottom: i32) -> Drawn {
        let band = |mut line: Vec<(i32, i32)>| -> Drawn {
            line.dedup();
            Ok(area.draw(&PathElement::new(line, TRUTH.stroke_width(11)))?)
        };
        let mut line: Vec<(i32, i32)> = Vec::new();
        let mut before = None;
        for (step, truth) in recording.truth.iter().enumerate() {
            let middle = truth.as_ref().map(|t| 0.5 * (t.start() + t.end() + 1) as f64);
            let near =
                |m: f64| before.is_some_and(|b: f64| (m - b).abs() < 0.5 * self.places as f64);
            if !middle.is_some_and(near) && !line.is_empty() {
                band(std::mem::take(&mut line))?;
            }
            line.extend(middle.map(|middle| (self.x(step as f64 + 0.5), self.y(middle))));
            before = middle;
        }
        band(line)?;
        let mut step = 0;
        for run in recording.truth.chunk_by(|a, b| a.is_none() == b.is_none()) {
            let ends = [step, step + run.len()].map(|step| self.x(step as f64));
            step += run.len();
            if run[0].is_none() {
                let column = [(ends[0], TOP), (ends[1], bottom)];
                area.draw(&Rectangle::new(column, TRUTH.mix(0.5).filled()))?;
            }
        }
        Ok(())
    }

    fn frame(
        &self,
        area: &Area<'_>,
        recording: &Recording,
        bottom: i32,
        learned: &[Range<usize>],
    ) -> Drawn {
        area.draw(&Text::new("Where the smoother believes it is", (20, 14), font(24)))?;
        let name = shortened(&recording.name, 100);
        area.draw(&Text::new(name, (20, 44), font(18).color(&GREY)))?;
        for range in learned {
            let ends = [range.start, range.end].map(|step| self.x(step as f64));
            let mark = [(ends[0], TOP + HEIGHT + 5), (ends[1], TOP + HEIGHT + 11)];
            area.draw(&Rectangle::new(mark, GREY.filled()))?;
        }

        // Axes.
        for step in ticks(self.steps) {
            let at = (self.x(step as f64 + 0.5), bottom + 20);
            area.draw(&Text::new(step.to_string(), at, anchored(18, HPos::Center)))?;
        }
        for place in ticks(self.places) {
            let at = (LEFT - 8, self.y(place as f64 + 0.5));
            area.draw(&Text::new(place.to_string(), at, anchored(18, HPos::Right)))?;
        }
        let at = (LEFT + WIDTH / 2, bottom + 44);
        area.draw(&Text::new("step", at, anchored(19, HPos::Center)))?;
        let turned = anchored(19, HPos::Center).transform(FontTransform::Rotate270);
        area.draw(&Text::new("reference", (18, TOP + HEIGHT / 2), turned))?;

        // Legend.
        let mut left = LEFT;
        let mut legend = |colour: RGBColor, tall: i32, text: &str, wide: i32| -> Drawn {
            let mark = [(left, 78 - tall / 2), (left + 26, 78 + tall / 2)];
            area.draw(&Rectangle::new(mark, colour.filled()))?;
            area.draw(&Text::new(text.to_owned(), (left + 34, 78), anchored(18, HPos::Left)))?;
            left += wide;
            Ok(())
        };
        legend(shade(SHADES - 2), 4, "belief", 116)?;
        legend(TRUTH, 12, "truth", 108)?;
        if recording.truth.contains(&None) {
            let RGBColor(red, green, blue) = TRUTH;
            let half = [red, green, blue].map(|part| part.midpoint(255));
            legend(RGBColor(half[0], half[1], half[2]), 18, "truly off the map", 196)?;
        }
        if !learned.is_empty() {
            legend(GREY, 6, "steps that it learned from", 0)?;
        }

        // Colour scale.
        let (left, tall) = (LEFT + WIDTH + 24, HEIGHT);
        let height = |level: u8| TOP + tall - i32::from(level) * tall / i32::from(SHADES);
        area.draw(&Text::new("probability", (left - 24, TOP - 20), anchored(18, HPos::Left)))?;
        for level in 1..=SHADES {
            let cell = [(left, height(level)), (left + 18, height(level - 1))];
            area.draw(&Rectangle::new(cell, shade(level).filled()))?;
        }
        area.draw(&Rectangle::new([(left, TOP), (left + 18, TOP + tall)], GREY))?;
        for decade in 0..=DECADES {
            let at = (left + 24, TOP + decade * tall / DECADES);
            let text = 10_f64.powi(-decade).to_string();
            area.draw(&Text::new(text, at, anchored(18, HPos::Left)))?;
        }
        Ok(())
    }

    /// Draws the probability of being off the map, by each method.
    fn off_map(&self, area: &Area<'_>, methods: &[&Answers]) -> Drawn {
        let (top, height) = TRACK;
        let y = |p: f64| top + height - (p * f64::from(height)).round() as i32;
        let text = "probability of being off the map, by";
        area.draw(&Text::new(text, (LEFT, top - 12), anchored(18, HPos::Left)))?;
        for p in [0.0, 0.5, 1.0] {
            let at = (LEFT - 8, y(p));
            area.draw(&Text::new(p.to_string(), at, anchored(18, HPos::Right)))?;
        }
        let middle = [(LEFT, y(0.5)), (LEFT + WIDTH, y(0.5))];
        area.draw(&PathElement::new(middle, PALE))?;
        for (number, method) in methods.iter().enumerate() {
            let (name, look) = style::of_method(&method.method);
            let on_map = method.on_map.iter().flatten().enumerate();
            let line: Vec<_> =
                on_map.map(|(step, p)| (self.x(step as f64 + 0.5), y(1.0 - p))).collect();
            look.path(area, &line)?;
            let x = LEFT + 300 + 110 * number as i32;
            look.path(area, &[(x, top - 12), (x + 26, top - 12)])?;
            area.draw(&Text::new(name.to_owned(), (x + 32, top - 12), anchored(18, HPos::Left)))?;
        }
        let ends = [(LEFT, top), (LEFT + WIDTH, top + height)];
        Ok(area.draw(&Rectangle::new(ends, GREY))?)
    }
}

/// At most nine round numbers below an end.
fn ticks(end: usize) -> impl Iterator<Item = usize> {
    let decades = (0..).map_while(|k| 10_usize.checked_pow(k));
    let mut steps = decades.flat_map(|decade| [decade, 2 * decade, 5 * decade]);
    let step = steps.find(|step| end.div_ceil(*step) <= 9).unwrap_or(end);
    (0..end).step_by(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        assert_eq!(
            ticks(1788).collect::<Vec<_>>(),
            [0, 200, 400, 600, 800, 1000, 1200, 1400, 1600]
        );
        assert_eq!(ticks(3).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(ticks(1).collect::<Vec<_>>(), [0]);
    }
}
