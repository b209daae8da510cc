//! Pictures of roads and of a matched drive, as SVG.

#![expect(clippy::cast_sign_loss, reason = "pixels are small numbers above 0")]

use std::collections::HashMap;
use std::error::Error;
use std::path::Path;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use wayfix::map::{Position, RoadClass};
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::{MatchedDrive, Stretch};

use super::certainty::probabilities;
use super::line_between;

pub(crate) type Drawn = Result<(), Box<dyn Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Pixel = (i32, i32);

const WIDTH: f64 = 860.0;
const LEAST_HEIGHT: f64 = 420.0;
const MOST_HEIGHT: f64 = 800.0;
/// Height above the map for title and legend.
const HEAD: f64 = 76.0;
const MARGIN: f64 = 24.0;

pub(crate) const GREY: RGBColor = RGBColor(214, 214, 214);
/// Colours (from Okabe and Ito's palette) and widths of a route with at least these probabilities.
const CERTAINTY: [(f64, &str, RGBColor, u32); 3] = [
    (0.9, "probability 0.9 or more", RGBColor(0, 114, 178), 4),
    (0.5, "0.5 to 0.9", RGBColor(230, 159, 0), 7),
    (0.0, "below 0.5", RGBColor(213, 94, 0), 10),
];
const OFF_ROAD: RGBColor = RGBColor(204, 121, 167);

/// Drawing area that shows a part of the Earth.
pub(crate) struct Canvas<'a> {
    area: Area<'a>,
    title: String,
    /// Pixels per metre.
    scale: f64,
    corner: Position,
    cosine: f64,
    offset: [f64; 2],
    size: [f64; 2],
}

fn font(size: i32, horizontal: HPos) -> TextStyle<'static> {
    let style = TextStyle::from(("sans-serif", size).into_font()).color(&BLACK);
    style.pos(Pos::new(horizontal, VPos::Center))
}

const DEGREE: f64 = 111_195.0;

/// Returns a longitude, shifted to within 180° of another, so that a picture may cross the
/// antimeridian.
fn turned(longitude: f64, near: f64) -> f64 {
    longitude + 360.0 * ((near - longitude) / 360.0).round()
}

impl<'a> Canvas<'a> {
    /// Creates a picture of all positions, with a border of at least `around` metres.
    pub(crate) fn new(
        file: &'a Path,
        title: &str,
        positions: impl Iterator<Item = Position>,
        around: f64,
    ) -> Result<Self, Box<dyn Error>> {
        let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let mut first = None;
        for Position { latitude, longitude } in positions {
            let near = *first.get_or_insert(longitude);
            for (axis, value) in [turned(longitude, near), latitude].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        // An equirectangular projection, true to scale at the middle latitude.
        let cosine = (0.5 * (low[1] + high[1])).to_radians().cos().max(0.01);
        let units = [DEGREE * cosine, DEGREE];
        let extent = [0, 1].map(|axis| (high[axis] - low[axis]) * units[axis] + 2.0 * around);
        let inner = WIDTH - 2.0 * MARGIN;
        // The tighter of both axes.
        let scale = (inner / extent[0]).min((MOST_HEIGHT - 2.0 * MARGIN) / extent[1]);
        let height = (scale * extent[1] + 2.0 * MARGIN).clamp(LEAST_HEIGHT, MOST_HEIGHT);
        let corner = Position {
            longitude: low[0] - around / units[0],
            latitude: high[1] + around / units[1],
        };
        let offset = [0.5 * (WIDTH - scale * extent[0]), HEAD + 0.5 * (height - scale * extent[1])];
        let size = [WIDTH, HEAD + height];
        let area =
            SVGBackend::new(file, (WIDTH as u32, (HEAD + height) as u32)).into_drawing_area();
        area.fill(&WHITE)?;
        let title = title.to_owned();
        Ok(Self { area, title, scale, corner, cosine, offset, size })
    }

    fn pixel(&self, Position { latitude, longitude }: Position) -> Pixel {
        // Longitudes nearest to the middle of the picture, whatever side of the antimeridian they
        // are on.
        let middle = self.corner.longitude + 0.5 * self.size[0] / self.scale / self.cosine / DEGREE;
        let east = (turned(longitude, middle) - self.corner.longitude) * DEGREE * self.cosine;
        let south = (self.corner.latitude - latitude) * DEGREE;
        let [x, y] = [self.offset[0] + self.scale * east, self.offset[1] + self.scale * south];
        (x.round() as i32, y.round() as i32)
    }

    /// Draws a line, unless it is a single pixel or outside the picture.
    pub(crate) fn line(&self, line: &[Position], style: ShapeStyle) -> Drawn {
        if let Some(pixels) = self.visible(line) {
            self.area.draw(&PathElement::new(pixels, style))?;
        }
        Ok(())
    }

    fn visible(&self, line: &[Position]) -> Option<Vec<Pixel>> {
        let mut pixels: Vec<Pixel> = line.iter().map(|&position| self.pixel(position)).collect();
        pixels.dedup();
        let [width, height] = self.size.map(|size| size as i32);
        let left_of = |x: i32| pixels.iter().all(|pixel| pixel.0 < x);
        let above = |y: i32| pixels.iter().all(|pixel| pixel.1 < y);
        // All pixels beyond one border: an approximation that never drops a visible line.
        let outside = left_of(0)
            || above(HEAD as i32)
            || pixels.iter().all(|pixel| pixel.0 > width)
            || pixels.iter().all(|pixel| pixel.1 > height);
        (pixels.len() > 1 && !outside).then_some(pixels)
    }

    /// Draws the roads of a network, both directions of a road as one line, minor roads first.
    pub(crate) fn roads(
        &self,
        network: &RoadNetwork,
        style: impl Fn(RoadClass) -> ShapeStyle,
    ) -> Drawn {
        let classes =
            [RoadClass::Street, RoadClass::Collector, RoadClass::Arterial, RoadClass::Main];
        for class in classes {
            for (edge, road) in network.edges().iter().enumerate() {
                let is_drawn = network.reverse(edge).is_some_and(|back| back < edge);
                if road.class == class && !is_drawn {
                    self.line(network.shape(edge), style(class))?;
                }
            }
        }
        Ok(())
    }

    /// Draws the title, the scale, and a row of texts, each beside a line in its style, on a white
    /// background. Returns the x at which the row ends.
    pub(crate) fn legend(&self, entries: &[(&str, ShapeStyle)]) -> Result<i32, Box<dyn Error>> {
        let head = [(0, 0), (WIDTH as i32, HEAD as i32 - 2)];
        self.area.draw(&Rectangle::new(head, WHITE.filled()))?;
        self.area.draw(&Text::new(self.title.clone(), (24, 22), font(22, HPos::Left)))?;
        self.draw_scale()?;
        let mut x = 24;
        for (text, style) in entries {
            self.area.draw(&PathElement::new([(x, 54), (x + 26, 54)], *style))?;
            self.area.draw(&Text::new((*text).to_owned(), (x + 32, 54), font(17, HPos::Left)))?;
            x += 48 + (6.7 * text.chars().count() as f64) as i32;
        }
        Ok(x)
    }

    /// Draws positions; if there are many, only those that are apart. Returns the number drawn.
    fn points(
        &self,
        positions: impl ExactSizeIterator<Item = Position>,
    ) -> Result<usize, Box<dyn Error>> {
        let is_thinned = positions.len() > MOST_POINTS;
        let mut drawn = HashMap::<Pixel, Vec<Pixel>>::new();
        let (mut count, mut last) = (0, None);
        for (x, y) in positions.map(|position| self.pixel(position)) {
            let (column, row) = (x.div_euclid(APART), y.div_euclid(APART));
            // Squares as wide as the distance: a point nearer than that is in one of the nine
            // around.
            let squares = (-1..=1).flat_map(|i| [-1, 0, 1].map(|j| (column + i, row + j)));
            let mut around = squares.filter_map(|square| drawn.get(&square)).flatten();
            let within = |(u, v): Pixel, most: i32| (x - u).pow(2) + (y - v).pow(2) < most * most;
            // Far from the last one drawn keeps points of one pass evenly spread; far from all
            // keeps passes of the same road apart.
            let near = last.is_some_and(|last| within(last, ONWARD))
                || around.any(|&other| within(other, APART));
            if !is_thinned || !near {
                drawn.entry((column, row)).or_default().push((x, y));
                self.point((x, y))?;
                (count, last) = (count + 1, Some((x, y)));
            }
        }
        Ok(count)
    }

    fn point(&self, at: Pixel) -> Drawn {
        self.area.draw(&Circle::new(at, 5, WHITE.filled()))?;
        Ok(self.area.draw(&Circle::new(at, 3, BLACK.filled()))?)
    }

    fn draw_scale(&self) -> Drawn {
        let lengths =
            [10.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5, 2e5, 1e6];
        let longest = lengths.iter().rev().find(|&&metres| metres * self.scale < 0.2 * WIDTH);
        let metres = longest.copied().unwrap_or(1.0);
        let right = (WIDTH - MARGIN) as i32;
        let left = right - (metres * self.scale) as i32;
        let ticks = [(left, 18), (left, 24), (right, 24), (right, 18)];
        self.area.draw(&PathElement::new(ticks, BLACK.stroke_width(1)))?;
        let text =
            if metres < 1000.0 { format!("{metres} m") } else { format!("{} km", metres / 1000.0) };
        Ok(self.area.draw(&Text::new(text, (left - 8, 21), font(17, HPos::Right)))?)
    }

    pub(crate) fn finish(&self) -> Drawn {
        Ok(self.area.present()?)
    }
}

/// Largest number of points that are all drawn; with more, least pixels from one drawn point to the
/// next, and between any two.
const MOST_POINTS: usize = 100;
const ONWARD: i32 = 40;
const APART: i32 = 14;

/// Draws a drive: roads, points, and the route by its probability.
pub(crate) fn draw_drive(
    file: &Path,
    title: &str,
    network: &RoadNetwork,
    drive: &MatchedDrive,
) -> Drawn {
    let points = drive.points().iter().map(|point| point.position);
    let on_route = drive.route().iter().flat_map(|stretch| stretch.ends);
    let canvas = Canvas::new(file, title, points.chain(on_route), 80.0)?;
    canvas.roads(network, |class| match class {
        RoadClass::Street => GREY.stroke_width(2),
        RoadClass::Collector => GREY.stroke_width(3),
        RoadClass::Arterial | RoadClass::Main => GREY.stroke_width(5),
    })?;
    let mut route: Vec<(&Stretch, f64)> = drive.route().iter().zip(probabilities(drive)).collect();
    // Where a drive takes a road twice, the less certain pass is drawn on top.
    route.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (stretch, probability) in route {
        let Some(edge) = stretch.edge else {
            if let Some(pixels) = canvas.visible(&stretch.ends) {
                let style = OFF_ROAD.stroke_width(5);
                canvas.area.draw(&DashedPathElement::new(pixels, 8, 6, style))?;
            }
            continue;
        };
        let level = CERTAINTY.iter().find(|level| probability >= level.0);
        let style = level.map_or(BLACK.into(), |level| level.2.stroke_width(level.3));
        canvas.line(&line_between(network, edge, stretch.enter, stretch.exit), style)?;
    }
    let count = canvas.points(drive.points().iter().map(|point| point.position))?;
    let route = drive.route();
    let ends = route.first().zip(route.last()).into_iter().flat_map(|(first, last)| {
        // The direction of the route at its ends, over up to three stretches.
        let near = 2.min(route.len() - 1);
        let [after, before] = [route[near].ends[1], route[route.len() - 1 - near].ends[0]];
        [("start", first.ends[0], after), ("end", last.ends[1], before)]
    });
    for (text, position, toward) in ends {
        let [(x, y), (to_x, to_y)] = [position, toward].map(|position| canvas.pixel(position));
        let style = if text == "start" { BLACK.stroke_width(2) } else { BLACK.filled() };
        canvas.area.draw(&Circle::new((x, y), 8, style))?;
        // Labels are placed away from the route.
        let (x, side) = if to_x > x { (x - 10, HPos::Right) } else { (x + 10, HPos::Left) };
        let y = if to_y > y { y - 16 } else { y + 16 };
        canvas.area.draw(&Text::new(text, (x, y), font(18, side)))?;
    }
    let mut entries: Vec<(&str, ShapeStyle)> =
        CERTAINTY.iter().map(|level| (level.1, level.2.stroke_width(level.3))).collect();
    if drive.route().iter().any(|stretch| stretch.edge.is_none()) {
        entries.push(("off the road", OFF_ROAD.stroke_width(5)));
    }
    entries.push(("roads", GREY.stroke_width(5)));
    let end = canvas.legend(&entries)?;
    canvas.point((end + 10, 54))?;
    let text = match drive.points().len() {
        all if all == count => String::from("GPS points"),
        all => format!("{count} of {all} points"),
    };
    canvas.area.draw(&Text::new(text, (end + 22, 54), font(17, HPos::Left)))?;
    canvas.finish()
}
