//! Style of each method in pictures: colour, dashes and marks, so that pictures are readable for
//! the colour-blind and in print.

use std::error::Error;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(crate) type Drawn = Result<(), Box<dyn Error>>;
pub(crate) type Pixel = (i32, i32);

// Okabe and Ito's palette, which is safe for the colour-blind.
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(crate) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
const PURPLE: RGBColor = RGBColor(204, 121, 167);
pub(crate) const GREY: RGBColor = RGBColor(110, 110, 110);
pub(crate) const PALE: RGBColor = RGBColor(225, 225, 225);

/// Style of a line and its marks.
#[derive(Clone, Copy)]
pub(crate) struct Look {
    pub(crate) colour: RGBColor,
    /// Length of dashes and of the gaps between them; 0 for a solid line.
    dash: u32,
    mark: Mark,
}

/// Corners of a shape, or ends of strokes through its middle.
#[derive(Clone, Copy)]
enum Mark {
    Filled(&'static [(f64, f64)]),
    Strokes(&'static [(f64, f64)]),
    Circle,
}

const CROSS: Mark = Mark::Strokes(&[(1.0, 1.0), (1.0, -1.0)]);
const PLUS: Mark = Mark::Strokes(&[(1.2, 0.0), (0.0, 1.2)]);
const UP: Mark = Mark::Filled(&[(0.0, -1.3), (1.2, 0.9), (-1.2, 0.9)]);
const DOWN: Mark = Mark::Filled(&[(0.0, 1.3), (1.2, -0.9), (-1.2, -0.9)]);
const SQUARE: Mark = Mark::Filled(&[(0.9, 0.9), (0.9, -0.9), (-0.9, -0.9), (-0.9, 0.9)]);
const DIAMOND: Mark = Mark::Filled(&[(0.0, 1.4), (1.4, 0.0), (0.0, -1.4), (-1.4, 0.0)]);

const fn look(colour: RGBColor, dash: u32, mark: Mark) -> Look {
    Look { colour, dash, mark }
}

/// Methods in the order in which they are shown.
const METHODS: [(&str, &str, Look); 7] = [
    ("single", "single image", look(GREY, 3, CROSS)),
    ("seqslam_trailing", "SeqSLAM, trailing", look(SKY, 7, DOWN)),
    ("seqslam_centred", "SeqSLAM, centred", look(BLUE, 7, UP)),
    ("filter", "filter", look(VERMILLION, 0, Mark::Circle)),
    ("fixed_lag", "fixed lag", look(ORANGE, 0, SQUARE)),
    ("smoother", "smoother", look(GREEN, 0, DIAMOND)),
    ("viterbi", "Viterbi", look(PURPLE, 14, PLUS)),
];

/// Position of a method in that order; others come last.
pub(crate) fn order(method: &str) -> usize {
    METHODS.iter().position(|known| known.0 == method).unwrap_or(METHODS.len())
}

/// Name and style of a method in pictures.
pub(crate) fn of_method(method: &str) -> (&str, Look) {
    let known = METHODS.get(order(method));
    known.map_or((method, look(BLACK, 0, CROSS)), |known| (known.1, known.2))
}

/// Style of the n-th of several lines that are not methods.
pub(crate) fn of_line(n: usize) -> Look {
    METHODS[(n + 3) % METHODS.len()].2
}

pub(crate) fn font(size: i32) -> TextStyle<'static> {
    TextStyle::from(("sans-serif", size).into_font()).color(&BLACK)
}

/// Text style anchored at its left end, middle or right end.
pub(crate) fn anchored(size: i32, horizontal: HPos) -> TextStyle<'static> {
    font(size).pos(Pos::new(horizontal, VPos::Center))
}

/// Shortens a name to at most `most` characters.
pub(crate) fn shortened(name: &str, most: usize) -> String {
    if name.chars().count() <= most {
        return name.to_owned();
    }
    name.chars().take(most - 1).chain(['…']).collect()
}

impl Look {
    /// Draws a line through pixels, with some ten evenly spaced marks. The marks of different n
    /// are offset.
    pub(crate) fn line(&self, area: &Area<'_>, points: &[Pixel], n: usize) -> Drawn {
        self.path(area, points)?;
        let gap = 46.0;
        let mut next = gap * (0.15 + 0.13 * n as f64);
        for (&from, &to) in points.iter().zip(points.iter().skip(1)) {
            let (dx, dy) = (f64::from(to.0 - from.0), f64::from(to.1 - from.1));
            let length = dx.hypot(dy);
            while next < length {
                let share = next / length;
                let x = from.0 + (share * dx).round() as i32;
                self.mark(area, (x, from.1 + (share * dy).round() as i32))?;
                next += gap;
            }
            next -= length;
        }
        points.last().map_or(Ok(()), |&end| self.mark(area, end))
    }

    /// Draws the line without marks.
    pub(crate) fn path(&self, area: &Area<'_>, points: &[Pixel]) -> Drawn {
        let (points, style) = (points.to_vec(), self.colour.stroke_width(2));
        if self.dash == 0 {
            return Ok(area.draw(&PathElement::new(points, style))?);
        }
        let dashes = DashedPathElement::new(points, self.dash, self.dash, style);
        Ok(area.draw(&dashes)?)
    }

    pub(crate) fn mark(&self, area: &Area<'_>, at: Pixel) -> Drawn {
        self.sized_mark(area, at, 4.0)
    }

    /// Draws a mark of the given radius, in pixels.
    #[expect(clippy::cast_possible_truncation, reason = "pixels are small numbers")]
    pub(crate) fn sized_mark(&self, area: &Area<'_>, (x, y): Pixel, radius: f64) -> Drawn {
        let at = |(across, down): (f64, f64)| {
            (x + (radius * across).round() as i32, y + (radius * down).round() as i32)
        };
        match self.mark {
            Mark::Circle => area.draw(&Circle::new((x, y), radius, self.colour.filled()))?,
            Mark::Filled(corners) => {
                let corners: Vec<Pixel> = corners.iter().copied().map(at).collect();
                area.draw(&Polygon::new(corners, self.colour.filled()))?;
            }
            Mark::Strokes(ends) => {
                for &(across, down) in ends {
                    let ends = [at((across, down)), at((-across, -down))];
                    area.draw(&PathElement::new(ends, self.colour.stroke_width(2)))?;
                }
            }
        }
        Ok(())
    }

    /// The same style in a paler colour.
    pub(crate) fn pale(self) -> Self {
        let pale = |part: u8| 255 - (255 - part) / 2;
        let RGBColor(red, green, blue) = self.colour;
        Self { colour: RGBColor(pale(red), pale(green), pale(blue)), ..self }
    }

    /// Draws a legend entry: a short line with its mark, and the text.
    pub(crate) fn legend(&self, area: &Area<'_>, (x, y): Pixel, text: String) -> Drawn {
        self.path(area, &[(x, y), (x + 34, y)])?;
        self.mark(area, (x + 17, y))?;
        Ok(area.draw(&Text::new(text, (x + 44, y), anchored(17, HPos::Left)))?)
    }
}
