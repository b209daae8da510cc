//! Positions of places, roads and place numbers in pixels.

use wayfix::map::{RoadClass, RoadMap};

pub(crate) const WIDTH: u32 = 1500;
pub(crate) const HEIGHT: u32 = 1240;

/// A number is legible if its middle is farther than this from roads and other numbers.
const ROOM: f64 = 14.0;
const FARTHER: f64 = 1.6;

type Pixel = (i32, i32);

/// Layout of the map in a picture of [`WIDTH`] by [`HEIGHT`] pixels.
pub(crate) struct Layout {
    pub(crate) places: Vec<Pixel>,
    /// Roads, one line for both directions.
    pub(crate) roads: Vec<RoadLine>,
}

/// A road, drawn as a straight line.
pub(crate) struct RoadLine {
    pub(crate) line: [Pixel; 2],
    pub(crate) class: RoadClass,
    pub(crate) one_way: bool,
}

impl Layout {
    pub(crate) fn of(map: &RoadMap) -> Self {
        let positions: Vec<_> = map.places().iter().map(|place| place.position).collect();
        let bounds = |of: &dyn Fn(usize) -> f64| {
            let values = (0..positions.len()).map(of);
            values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)))
        };
        let (south, north) = bounds(&|i| positions[i].latitude);
        let (west, east) = bounds(&|i| positions[i].longitude);
        // Degrees of longitude are shorter than those of latitude by the cosine of the latitude.
        let shrink = (0.5 * (south + north)).to_radians().cos();
        let scale = ((f64::from(WIDTH) - 80.0) / ((east - west) * shrink))
            .min((f64::from(HEIGHT) - 110.0) / (north - south));
        let places: Vec<Pixel> = positions
            .iter()
            .map(|position| {
                let x = 40.0 + (position.longitude - west) * shrink * scale;
                let y = 70.0 + (north - position.latitude) * scale;
                (x.round() as i32, y.round() as i32)
            })
            .collect();

        let mut roads = Vec::new();
        for from in 0..places.len() {
            for (to, road) in map.roads_from(from) {
                // Both directions share a line: it is listed from the lower place.
                let two_way = map.neighbors(to).any(|back| back == from);
                if two_way && from > to {
                    continue;
                }
                let line = [places[from], places[to]];
                roads.push(RoadLine { line, class: road.class, one_way: !two_way });
            }
        }
        Self { places, roads }
    }

    /// Direction from each place that puts its number, `away` from it, farthest from roads and from
    /// the numbers placed before it. The length is 1, or [`FARTHER`] if nothing nearer is legible.
    pub(crate) fn directions(&self, away: f64) -> Vec<(f64, f64)> {
        let mut numbers: Vec<(f64, f64)> = Vec::new();
        let mut directions = Vec::new();
        for &(x, y) in &self.places {
            let at = |(dx, dy): (f64, f64)| (f64::from(x) + away * dx, f64::from(y) + away * dy);
            let clear = |direction: (f64, f64)| {
                let here = at(direction);
                let roads = self.roads.iter().map(|road| road.distance(here));
                // Numbers are wider than high.
                let others =
                    numbers.iter().map(|(x, y)| (0.6 * (here.0 - x).abs()).max((here.1 - y).abs()));
                roads.chain(others).fold(f64::MAX, f64::min)
            };
            let best = |length: f64| {
                let turns = (0..16).map(|sixteenth| f64::from(sixteenth) / 16.0);
                turns
                    .map(|turn| (turn * std::f64::consts::TAU).sin_cos())
                    .map(|(dx, dy)| (length * dx, length * dy))
                    .max_by(|&a, &b| clear(a).total_cmp(&clear(b)))
                    .unwrap_or((0.0, -length))
            };
            // Near the place if it is legible there; otherwise farther out, legible or not.
            let nearest = Some(best(1.0)).filter(|&near| clear(near) > ROOM);
            let best = nearest.unwrap_or_else(|| best(FARTHER));
            numbers.push(at(best));
            directions.push(best);
        }
        directions
    }
}

impl RoadLine {
    /// Triangle a little beyond the middle of a one-way road, pointing along it.
    pub(crate) fn arrow(&self) -> Option<[Pixel; 3]> {
        self.one_way.then(|| arrow(self.line))
    }

    fn distance(&self, point: (f64, f64)) -> f64 {
        let [from, to] = self.line.map(|(x, y)| (f64::from(x), f64::from(y)));
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let along = (point.0 - from.0) * dx + (point.1 - from.1) * dy;
        let fraction = (along / (dx * dx + dy * dy).max(1.0)).clamp(0.0, 1.0);
        distance(point, (from.0 + fraction * dx, from.1 + fraction * dy))
    }
}

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

/// Triangle a little beyond the middle of a line, pointing along it.
pub(crate) fn arrow([from, to]: [Pixel; 2]) -> [Pixel; 3] {
    let (dx, dy) = (f64::from(to.0 - from.0), f64::from(to.1 - from.1));
    let length = dx.hypot(dy).max(1.0);
    let (ux, uy) = (dx / length, dy / length);
    let tip = (f64::from(from.0) + 0.5 * dx + 9.0 * ux, f64::from(from.1) + 0.5 * dy + 9.0 * uy);
    let at = |along: f64, across: f64| {
        let (x, y) = (tip.0 - along * ux - across * uy, tip.1 - along * uy + across * ux);
        (x.round() as i32, y.round() as i32)
    };
    [at(0.0, 0.0), at(18.0, 8.0), at(18.0, -8.0)]
}
