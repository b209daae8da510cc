//! A step along a route by its definition: a matrix, entry by entry.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix_recognition::motion::{
    Driven, OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChange,
    ViewChangeRates, ViewEvidence,
};

use crate::kit::{Matrix, transposed, weighted};

/// Parameters of a route.
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    pub(crate) places: usize,
    pub(crate) closed: bool,
    pub(crate) speeds: Speeds,
    pub(crate) odometry: OdometryModel,
    pub(crate) views: Option<ViewChangeRates>,
    pub(crate) off_map: Option<OffMap>,
}

/// Speeds that a speed of the grid stands for, with their shares: itself half of the time,
/// otherwise evenly spread over its cell; and the distance between these.
fn nodes(values: &[f64], g: usize) -> (Vec<(f64, f64)>, f64) {
    let (v, last) = (values[g], values.len() - 1);
    if v == 0.0 || last == 0 {
        return (vec![(v, 1.0)], 0.0);
    }
    let half = |a: usize| 0.5 * (values[a + 1] - values[a]);
    let low = v - half(if g == 0 { 0 } else { g - 1 });
    let high = v + half(if g == last { last - 1 } else { g });
    let spacing = (high - low) / 8.0;
    let even = (0..8).map(|q| (low + spacing * (f64::from(q) + 0.5), 0.5 / 8.0));
    (even.chain([(v, 0.5)]).collect(), spacing)
}

impl Parts {
    pub(crate) fn route(&self) -> RouteTransition {
        let make = if self.closed { RouteTransition::closed } else { RouteTransition::open };
        let route = make(self.places, self.speeds.clone()).unwrap();
        let mut route = route.with_odometry(self.odometry).unwrap();
        if let Some(rates) = self.views {
            route = route.with_views(rates).unwrap();
        }
        match self.off_map {
            Some(off_map) => route.with_off_map(off_map).unwrap(),
            None => route,
        }
    }

    /// p(odometry | v), over its largest value.
    fn driven(&self, control: &RouteControl, v: f64, spacing: f64) -> f64 {
        let Some(reading) = control.odometry else { return 1.0 };
        let OdometryModel { scale, bias, deviation } = self.odometry;
        let s = (deviation.powi(2) + (scale * spacing).powi(2) / 12.0).sqrt();
        let off = (reading - scale * v - bias) / s;
        deviation / s * (1.0 + off * off / 4.0).powf(-2.5)
    }

    /// p(view | standing, moved), divided by the largest of them, to the power of the weight; and
    /// the logarithm of the divisor.
    fn seen(&self, control: &RouteControl) -> ([f64; 2], Option<f64>) {
        let (Some(rates), Some(evidence)) = (&self.views, control.view) else {
            return ([1.0; 2], None);
        };
        let p = [rates.standing, rates.moved].map(|p| match evidence.view {
            ViewChange::Unchanged => p,
            ViewChange::Changed => 1.0 - p,
        });
        let largest = p.into_iter().fold(0.0, f64::max);
        let powers = p.map(|p| (p / largest).powf(evidence.weight));
        (powers, Some(evidence.weight * largest.ln()))
    }

    /// Log factor that is taken out of the entries of a step with evidence.
    pub(crate) fn log_factor(&self, control: &RouteControl) -> Option<f64> {
        let view = self.seen(control).1;
        let driven = control.odometry.map(|_| (0.375 / self.odometry.deviation).ln());
        (view.is_some() || driven.is_some()).then(|| view.unwrap_or(0.0) + driven.unwrap_or(0.0))
    }

    /// G\[new, old\].
    fn change(&self, new: usize, old: usize) -> f64 {
        let (k, (nearby, anywhere)) = (self.speeds.values().len(), self.speeds.changes());
        let neighbors = usize::from(old > 0) + usize::from(old + 1 < k);
        let mut p = anywhere * self.speeds.shares()[new];
        if new == old {
            p += (1.0 - anywhere - if neighbors > 0 { nearby } else { 0.0 }).max(0.0);
        }
        if new.abs_diff(old) == 1 {
            p += nearby / neighbors as f64;
        }
        p
    }

    fn near(&self, left: usize, to: usize) -> bool {
        let apart = left.abs_diff(to);
        let apart = if self.closed { apart.min(self.places - apart) } else { apart };
        self.off_map.is_some_and(|off_map| apart <= off_map.within)
    }

    /// `matrix[to][from]`.
    pub(crate) fn matrix(&self, control: &RouteControl) -> Matrix {
        let (n, k) = (self.places, self.speeds.values().len());
        let count = n * (k + usize::from(self.off_map.is_some()));
        transposed(&(0..count).map(|from| self.column(control, from, count)).collect())
    }

    fn column(&self, control: &RouteControl, from: usize, count: usize) -> Vec<f64> {
        let (n, values, shares) = (self.places, self.speeds.values(), self.speeds.shares());
        let k = values.len();
        let seen = self.seen(control).0;
        let mut column = vec![0.0; count];
        let mean = |g: usize| {
            let (nodes, spacing) = nodes(values, g);
            nodes.iter().map(|(v, share)| share * self.driven(control, *v, spacing)).sum::<f64>()
        };
        let means: Vec<f64> =
            (0..k).map(|g| if control.odometry.is_some() { mean(g) } else { 1.0 }).collect();
        let off = self.off(control, &means);
        let (old, i) = (from / n, from % n);
        if old < k {
            let keep = self.off_map.map_or(1.0, |off_map| 1.0 - off_map.leave);
            for new in 0..k {
                let (nodes, spacing) = nodes(values, new);
                let slack = if values[new] == 0.0 { 0.0 } else { self.speeds.slack() };
                for (v, share) in &nodes {
                    let share =
                        share * keep * self.change(new, old) * self.driven(control, *v, spacing);
                    let triangle = |m: f64| (1.0 - (m - v).abs()).max(0.0);
                    // All moves by a node of the speeds, and by the slack.
                    let least = v.floor() as isize - 1;
                    for m in least..=least + 4 {
                        let at = m as f64;
                        let beside = triangle(at - 1.0) + triangle(at + 1.0);
                        let weight = (1.0 - 2.0 * slack) * triangle(at) + slack * beside;
                        let to = i.cast_signed() + m;
                        let last = n.cast_signed() - 1;
                        let to =
                            if self.closed { to.rem_euclid(last + 1) } else { to.clamp(0, last) };
                        let to = to.cast_unsigned();
                        // A vehicle that is stopped by the end neither stands nor moves.
                        let factor = match () {
                            () if to == i && m != 0 && !self.closed => seen[0].min(seen[1]),
                            () => seen[usize::from(to != i)],
                        };
                        column[new * n + to] += share * weight * factor;
                    }
                }
            }
            if let Some(off_map) = self.off_map {
                column[k * n + i] += off_map.leave * off;
            }
        } else if let Some(off_map) = self.off_map {
            column[k * n + i] += (1.0 - off_map.back) * off;
            let near = (0..n).filter(|j| self.near(i, *j)).count() as f64;
            for j in 0..n {
                let beside = if self.near(i, j) { off_map.near / near } else { 0.0 };
                let back = off_map.back * off * ((1.0 - off_map.near) / n as f64 + beside);
                (0..k).for_each(|new| column[new * n + j] += back * shares[new]);
            }
        }
        column
    }

    /// The likelihood of measurements off the map: at the previous speed, or after a change at a
    /// speed by its share.
    fn off(&self, control: &RouteControl, means: &[f64]) -> f64 {
        let (values, shares, seen) =
            (self.speeds.values(), self.speeds.shares(), self.seen(control).0);
        let each = (0..values.len()).map(|g| {
            let factor = if values[g] == 0.0 { seen[0] } else { seen[1] };
            (values[g] == 0.0, shares[g], shares[g] * means[g] * factor)
        });
        let of = |standing: bool| {
            let (share, sum) = each
                .clone()
                .filter(|e| e.0 == standing)
                .fold((0.0, 0.0), |s, e| (s.0 + e.1, s.1 + e.2));
            (share, sum)
        };
        let any: f64 = each.clone().map(|e| e.2).sum();
        if self.log_factor(control).is_none() {
            return 1.0;
        }
        let Some(before) = control.before else { return any };
        let change = (self.speeds.changes().0 + self.speeds.changes().1).min(1.0);
        let stood = match of(true).0 {
            0.0 => 0.0,
            share if 1.0 - share < 1e-3 => 1.0,
            _ => before.standing,
        };
        let stands = if stood > 0.0 { of(true).1 / of(true).0 } else { 0.0 };
        let goes_on = match (control.odometry, before.odometry) {
            (Some(reading), Some((mean, count))) => {
                let width = (1.0 + 1.0 / f64::from(count)).sqrt();
                let off = (reading - mean) / (width * self.odometry.deviation);
                (1.0 + off * off / 4.0).powf(-2.5) / width * seen[1]
            }
            _ => of(false).1 / (1.0 - of(true).0).max(1e-3),
        };
        change * any + (1.0 - change) * (stood * stands + (1.0 - stood) * goes_on)
    }
}

/// Ascending grids of up to `most` speeds: values close together and far apart, on either side of
/// 0, and neighbours that differ by a few digits.
pub(crate) fn grid(most: usize) -> BoxedStrategy<Vec<f64>> {
    let value = prop_oneof![
        2 => -64.0..=64.0,
        4 => -3.0..3.0,
        4 => (-12..=12_i32).prop_map(|tenths| 0.1 * f64::from(tenths)),
        2 => (-64..=64_i32).prop_map(f64::from),
        2 => Just(0.0),
        1 => Just(-0.0),
        2 => (-3..=3_i32).prop_map(|at| f64::from(at) - 0.01),
        1 => proptest::sample::select(vec![5e-324, -5e-324, 1e-300, -1e-17, 1e-9, 64.0, -64.0]),
    ];
    let beside = prop_oneof![
        3 => Just(0.0),
        1 => Just(f64::MIN_POSITIVE),
        1 => Just(1e-15),
        1 => Just(1e-9),
        1 => 0.0..0.1,
    ];
    vec((value, beside), 1..=most.max(1))
        .prop_map(move |values| {
            let mut grid: Vec<f64> =
                values.iter().flat_map(|(value, beside)| [*value, value + beside]).collect();
            grid.retain(|value| value.abs() <= 64.0);
            grid.sort_by(f64::total_cmp);
            grid.dedup_by(|next, value| next <= value);
            grid.truncate(most);
            grid
        })
        .boxed()
}

fn speeds(most: usize) -> BoxedStrategy<Speeds> {
    let grids: Vec<Vec<f64>> = [
        &[1.0][..],
        &[0.0],
        &[-0.4],
        &[0.0, 1.0],
        &[-1.0, 2.0],
        &[0.0, 0.5, 1.0],
        &[-2.0, -0.5, 0.0, 0.3, 1.7],
        &[-3.0, -2.0, -1.0, -0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0],
    ]
    .into_iter()
    .filter(|grid| grid.len() <= most)
    .map(<[f64]>::to_vec)
    .collect();
    let changes = prop_oneof![
        6 => (0.0..0.5, 0.0..0.5),
        1 => Just((0.0, 0.0)),
        1 => Just((0.9, 0.1)),
        1 => Just((0.0, 1.0)),
        1 => Just((0.01, 0.005)),
    ];
    let slack = prop_oneof![2 => Just(0.0), 1 => Just(0.02), 1 => 0.0..0.5, 1 => Just(0.5)];
    prop_oneof![proptest::sample::select(grids), grid(most.min(4))]
        .prop_flat_map(move |grid| {
            let weight = prop_oneof![1 => Just(0.0), 3 => 0.01..1.0];
            let shares = proptest::option::of(weighted(weight, grid.len()));
            (Just(grid), shares, changes.clone(), slack.clone()).prop_map(
                |(grid, shares, (nearby, anywhere), slack)| {
                    let speeds =
                        Speeds::new(&grid).unwrap().with_changes(nearby, anywhere).unwrap();
                    let speeds = speeds.with_slack(slack).unwrap();
                    match shares {
                        Some(shares) => speeds.with_shares(&shares).unwrap(),
                        None => speeds,
                    }
                },
            )
        })
        .boxed()
}

fn off_map() -> BoxedStrategy<OffMap> {
    let rate = || prop_oneof![3 => 0.01..0.99, 1 => Just(1.0), 1 => Just(0.5), 1 => Just(1e-9)];
    let near = prop_oneof![2 => 0.0..1.0, 1 => Just(0.0), 1 => Just(1.0)];
    (rate(), rate(), near, 0..14_usize)
        .prop_map(|(leave, back, near, within)| OffMap { leave, back, near, within })
        .boxed()
}

/// Routes with limited numbers of places and of speeds.
pub(crate) fn parts(places: usize, speeds_at_most: usize) -> BoxedStrategy<Parts> {
    let rate = || prop_oneof![4 => 0.01..0.99, 1 => Just(0.5), 1 => Just(1e-9)];
    let odometry = (0.5..2.0, -0.3..0.3, 0.05..1.0)
        .prop_map(|(scale, bias, deviation)| OdometryModel { scale, bias, deviation });
    let odometry = prop_oneof![1 => Just(OdometryModel::default()), 2 => odometry];
    (1..=places, any::<bool>(), speeds(speeds_at_most), odometry)
        .prop_flat_map(move |(places, closed, speeds, odometry)| {
            let rates =
                (rate(), rate()).prop_map(|(standing, moved)| ViewChangeRates { standing, moved });
            let views = proptest::option::weighted(0.7, rates);
            let off_map = proptest::option::weighted(0.6, off_map());
            (views, off_map).prop_map(move |(views, off_map)| Parts {
                places,
                closed,
                speeds: speeds.clone(),
                odometry,
                views,
                off_map,
            })
        })
        .boxed()
}

pub(crate) fn control() -> BoxedStrategy<RouteControl> {
    let odometry = prop_oneof![
        4 => -4.0..4.0,
        2 => (-3..4_i32).prop_map(f64::from),
        1 => -60.0..60.0,
    ];
    let weight = prop_oneof![3 => 0.0..1.0, 1 => Just(0.0), 2 => Just(1.0)];
    let view = prop_oneof![Just(ViewChange::Changed), Just(ViewChange::Unchanged)];
    let view = (view, weight).prop_map(|(view, weight)| ViewEvidence { view, weight });
    let before = (0.0..=1.0, proptest::option::of((-4.0..4.0, 1..12_u32)));
    let before = before.prop_map(|(standing, odometry)| Driven { standing, odometry });
    let odometry = proptest::option::weighted(0.6, odometry);
    (odometry, proptest::option::weighted(0.7, view), proptest::option::of(before))
        .prop_map(|(odometry, view, before)| RouteControl { odometry, view, before })
        .boxed()
}
