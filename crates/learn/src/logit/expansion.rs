//! The objective of the M-step around a point, to second order: its value, gradient and information
//! (minus the Hessian), and the step that maximises it.
//!
//! Origins have intercepts of their own, and share slopes. So the information has a small block for
//! the intercepts of each origin, a block for all slopes, and cross terms between each origin and
//! the slopes. The intercepts are eliminated origin by origin (the Schur complement), which leaves
//! a system in the slopes.

use super::factor::Factor;
use super::newton::{Part, Point, Seen};

/// Terms of the intercepts of one origin. The reference has rows of 0, which leaves it out.
#[derive(Debug)]
struct Intercepts {
    gradient: Vec<f64>,
    information: Vec<f64>,
    /// One row for each move, with a column for each slope of the origin.
    cross: Vec<f64>,
    /// Expected number of steps that leave the origin.
    weight: f64,
}

/// The objective around a point.
#[derive(Debug)]
pub(super) struct Expansion {
    pub(super) value: f64,
    /// Expected number of steps.
    pub(super) weight: f64,
    origins: Vec<Intercepts>,
    gradient: Vec<f64>,
    information: Vec<f64>,
    /// Σ weight x² for each slope: a variance p (1 − p) is at most 1/4, so that this is four times
    /// a bound on its information.
    size: Vec<f64>,
}

/// A step from a point, with the gain predicted by the expansion.
#[derive(Debug)]
pub(super) struct Step {
    /// By origin, then by move.
    pub(super) intercepts: Vec<Vec<f64>>,
    pub(super) slopes: Vec<f64>,
    pub(super) gain: f64,
}

impl Step {
    /// Returns a fraction of the step; the predicted gain stays that of the whole.
    pub(super) fn scaled(mut self, part: f64) -> Self {
        let intercepts = self.intercepts.iter_mut().flatten();
        intercepts.chain(&mut self.slopes).for_each(|value| *value *= part);
        self
    }
}

/// Memory for one row of inputs at one origin.
#[derive(Debug, Default)]
struct Row {
    /// ln p, p and 1 − p of each move; the last is summed over the other moves, so that it has all
    /// its digits.
    logs: Vec<f64>,
    p: Vec<f64>,
    not: Vec<f64>,
    /// Weights of all other moves.
    others: Vec<f64>,
    /// For each group of slopes: the sums of p over the moves inside and outside of it, and the
    /// sums of their weights.
    of_slopes: Vec<[f64; 4]>,
}

/// For each value the sum of all others, without a subtraction.
fn sums_of_others(values: &[f64], out: &mut Vec<f64>) {
    // Sums of those before, then of those after: the total less a value would cancel if the value
    // is nearly the total.
    out.clear();
    let mut before = 0.0;
    for value in values {
        out.push(before);
        before += value;
    }
    let mut after = 0.0;
    for (out, value) in out.iter_mut().zip(values).rev() {
        *out += after;
        after += value;
    }
}

impl Row {
    fn fill(&mut self, seen: &Seen, scores: impl Iterator<Item = f64>, weights: &[f64]) {
        self.logs.clear();
        self.logs.extend(scores);
        let (best, largest) =
            (0..).zip(&self.logs).fold((0, f64::NEG_INFINITY), |best, (at, score)| {
                if *score > best.1 { (at, *score) } else { best }
            });
        self.p.clear();
        self.p.extend(self.logs.iter().map(|score| (score - largest).exp()));
        // The largest term is 1: the logarithm of a sum near 1 keeps its digits.
        let rest: f64 = self.p.iter().enumerate().filter(|p| p.0 != best).map(|p| p.1).sum();
        let log_sum = rest.ln_1p();
        self.logs.iter_mut().for_each(|log| *log = *log - largest - log_sum);
        self.p.iter_mut().for_each(|p| *p /= 1.0 + rest);
        sums_of_others(&self.p, &mut self.not);
        sums_of_others(weights, &mut self.others);
        self.of_slopes.clear();
        for group in &seen.groups {
            let mut sums = [0.0; 4];
            for (at, other) in seen.group_of.iter().enumerate() {
                let inside = other == &Some(*group);
                sums[usize::from(!inside)] += self.p[at];
                sums[2 + usize::from(!inside)] += weights[at];
            }
            self.of_slopes.push(sums);
        }
    }
}

impl Expansion {
    /// Expands the objective of a part around a point. O(rows (m² + m k + k²)) for each origin,
    /// with m moves and k slopes.
    pub(super) fn at(part: &Part<'_>, point: &Point) -> Self {
        let p = part.inputs;
        let slopes = part.groups.len() * p;
        let mut sum = Self {
            value: 0.0,
            weight: 0.0,
            origins: Vec::with_capacity(part.origins.len()),
            gradient: vec![0.0; slopes],
            information: vec![0.0; slopes * slopes],
            size: vec![0.0; slopes],
        };
        let mut row = Row::default();
        for (seen, intercepts) in part.origins.iter().zip(&point.intercepts) {
            sum.add_origin(part, seen, (intercepts, &point.slopes), &mut row);
        }
        // The prior, −λ / 2 Σ b².
        for (at, &slope) in point.slopes.iter().enumerate() {
            let ridge = part.ridge[at % p];
            sum.value -= 0.5 * ridge * slope * slope;
            sum.gradient[at] -= ridge * slope;
            sum.information[at * slopes + at] += ridge;
        }
        sum
    }

    fn add_origin(
        &mut self,
        part: &Part<'_>,
        seen: &Seen,
        (intercepts, slopes): (&[f64], &[f64]),
        row: &mut Row,
    ) {
        let (m, p, all) = (intercepts.len(), part.inputs, slopes.len());
        let own = seen.groups.len() * p;
        let mut terms = Intercepts {
            gradient: vec![0.0; m],
            information: vec![0.0; m * m],
            cross: vec![0.0; m * own],
            weight: 0.0,
        };
        for (x, weights) in seen.rows(part) {
            let total: f64 = weights.iter().sum();
            row.fill(seen, (0..m).map(|at| seen.score(at, intercepts, slopes, x)), weights);
            terms.weight += total;
            self.value += weights.iter().zip(&row.logs).map(|(w, log)| w * log).sum::<f64>();
            for i in (0..m).filter(|i| *i != seen.reference) {
                // w − total p, in a form that keeps its digits where p is near 0 or 1.
                terms.gradient[i] += weights[i] * row.not[i] - row.others[i] * row.p[i];
                // Information of a multinomial, total (diag p − p p'): lower triangle only.
                for k in (0..i).filter(|k| *k != seen.reference) {
                    terms.information[i * m + k] -= total * row.p[i] * row.p[k];
                }
                terms.information[i * m + i] += total * row.p[i] * row.not[i];
                for (g, group) in seen.groups.iter().enumerate() {
                    let [inside, outside, ..] = row.of_slopes[g];
                    // cov(move i, group) = p_i ([i in the group] − P(group)).
                    let mine = seen.group_of[i] == Some(*group);
                    let joint = total * row.p[i] * if mine { outside } else { -inside };
                    let cross = &mut terms.cross[i * own + g * p..i * own + (g + 1) * p];
                    cross.iter_mut().zip(x).for_each(|(cross, x)| *cross += joint * x);
                }
            }
            for (g, first) in seen.groups.iter().enumerate() {
                let [inside, outside, seen_inside, seen_outside] = row.of_slopes[g];
                // Seen less expected in the group, w_in − total P(in), again without cancellation.
                let residual = seen_inside * outside - seen_outside * inside;
                for (k, x_k) in x.iter().enumerate() {
                    let at = first * p + k;
                    self.gradient[at] += residual * x_k;
                    self.size[at] += total * x_k * x_k;
                    for (h, second) in seen.groups[..=g].iter().enumerate() {
                        let other = if h == g { outside } else { -row.of_slopes[h][0] };
                        let joint = total * inside * other * x_k;
                        let until = if h == g { k + 1 } else { p };
                        let line = &mut self.information[at * all + second * p..][..until];
                        line.iter_mut().zip(x).for_each(|(sum, x)| *sum += joint * x);
                    }
                }
            }
        }
        self.weight += terms.weight;
        self.origins.push(terms);
    }

    /// The step that maximises the expansion, with the information increased by `damping` times a
    /// bound on its diagonal. Parameters that the data do not determine stay.
    pub(super) fn step(&self, part: &Part<'_>, damping: f64) -> Step {
        let (p, all) = (part.inputs, self.gradient.len());
        // With L L' the block of an origin, H_ss − C' (L L')⁻¹ C = H_ss − (L⁻¹ C)' (L⁻¹ C): the
        // system in the slopes, and the same with the gradient on its right-hand side.
        let mut information = self.information.clone();
        let mut slopes = self.gradient.clone();
        let mut eliminated = Vec::with_capacity(self.origins.len());
        for (terms, seen) in self.origins.iter().zip(&part.origins) {
            let (m, own) = (terms.gradient.len(), seen.groups.len() * p);
            let mut block = terms.information.clone();
            for i in (0..m).filter(|i| *i != seen.reference) {
                block[i * m + i] += damping * terms.weight;
            }
            let diagonal: Vec<f64> = (0..m).map(|i| block[i * m + i]).collect();
            let factor = Factor::new(block, &diagonal);
            let mut gradient = terms.gradient.clone();
            factor.forward(&mut gradient);
            // L⁻¹ cross, by columns.
            let mut cross: Vec<Vec<f64>> =
                (0..own).map(|c| (0..m).map(|i| terms.cross[i * own + c]).collect()).collect();
            cross.iter_mut().for_each(|column| factor.forward(column));
            let place = |c: usize| seen.groups[c / p] * p + c % p;
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for c in 0..own {
                slopes[place(c)] -= dot(&cross[c], &gradient);
                for d in 0..=c {
                    information[place(c) * all + place(d)] -= dot(&cross[c], &cross[d]);
                }
            }
            eliminated.push((factor, gradient, cross));
        }
        let mut diagonal = Vec::with_capacity(all);
        for (at, size) in self.size.iter().enumerate() {
            information[at * all + at] += damping * size;
            diagonal.push(self.information[at * all + at] + damping * size);
        }
        // Pivots are judged by the diagonal before the elimination: what it cancelled is rounding.
        let factor = Factor::new(information, &diagonal);
        factor.forward(&mut slopes);
        factor.backward(&mut slopes);
        let mut gain: f64 = self.gradient.iter().zip(&slopes).map(|(g, step)| g * step).sum();
        let mut intercepts = Vec::with_capacity(eliminated.len());
        for ((factor, mut step, cross), (terms, seen)) in
            eliminated.into_iter().zip(self.origins.iter().zip(&part.origins))
        {
            // Back substitution: L' step = L⁻¹ (gradient − C slopes). The gain of a step that
            // solves H step = gradient is gradient · step / 2.
            for (c, column) in cross.iter().enumerate() {
                let slope = slopes[seen.groups[c / p] * p + c % p];
                step.iter_mut().zip(column).for_each(|(step, cross)| *step -= cross * slope);
            }
            factor.backward(&mut step);
            gain += terms.gradient.iter().zip(&step).map(|(g, step)| g * step).sum::<f64>();
            intercepts.push(step);
        }
        Step { intercepts, slopes, gain: 0.5 * gain }
    }
}
