//! The maximum of a concave objective by Newton's method, damped where a step would go too far
//! (Levenberg 1944, Marquardt 1963).
//!
//! **No step lowers the objective.** A step that changes the scores of each row by a range of at
//! most 1/2 raises it: along the step the information grows by a factor below e^{1/2} (its
//! derivative is a third cumulant, at most the range times the variance), and g · δ − e^{1/2} δ' H
//! δ / 2 > 0. A longer step is taken only if the objective is seen to rise; otherwise it is
//! shortened, then damped.

/// A step that changes scores by at most this is the last: the next one would be its square.
const LAST: f64 = 1e-7;
/// Range of changes of scores up to which a step needs no test.
const SAFE: f64 = 0.5;
/// A predicted gain below this part of the expected number of steps is rounding.
const ROUNDING: f64 = 1e-14;
/// The same for the gain of a damped step.
const NOTHING: f64 = 1e-10;
/// A step that goes too far is tried again at this length.
const SHORTER: f64 = 0.25;
/// The least damping.
const DAMPING: f64 = 1e-3;
/// Largest number of steps tried. Newton's method takes about ten, inputs that separate moves 40.
const MOST: usize = 200;

/// One origin: its moves, and how often they were seen at each row of inputs.
#[derive(Debug)]
pub(super) struct OriginCounts {
    /// Number of its first move among all moves.
    pub(super) first: usize,
    /// Groups of slopes of its moves, numbered within the part, ascending.
    pub(super) groups: Vec<usize>,
    /// The group of each move, numbered within the part.
    pub(super) group_of: Vec<Option<usize>>,
    /// The move that was seen most often, whose intercept stays: it is not rare, so that the
    /// intercepts of the others are well determined.
    pub(super) reference: usize,
    /// Numbers of rows, and for each row the weights of the moves.
    pub(super) rows: Vec<usize>,
    pub(super) weights: Vec<f64>,
}

impl OriginCounts {
    pub(super) fn rows<'a>(
        &'a self,
        part: &'a Component<'_>,
    ) -> impl Iterator<Item = (&'a [f64], &'a [f64])> {
        let rows =
            self.rows.iter().map(|row| &part.inputs_of_rows[row * part.inputs..][..part.inputs]);
        rows.zip(self.weights.chunks_exact(self.group_of.len()))
    }

    /// Score of a move or, for the numbers of a step, its change by the step.
    #[inline]
    pub(super) fn score(&self, at: usize, intercepts: &[f64], slopes: &[f64], x: &[f64]) -> f64 {
        let slopes = match self.group_of[at] {
            Some(group) => &slopes[group * x.len()..(group + 1) * x.len()],
            None => &[],
        };
        intercepts[at] + slopes.iter().zip(x).map(|(b, x)| b * x).sum::<f64>()
    }
}

/// Origins that share slopes, directly or through others, and so are maximised together.
#[derive(Debug)]
pub(super) struct Component<'a> {
    pub(super) inputs: usize,
    /// Rows of inputs, one after another, for all parts.
    pub(super) inputs_of_rows: &'a [f64],
    /// Precision of the prior on the slopes of each input.
    pub(super) ridge: &'a [f64],
    pub(super) origins: Vec<OriginCounts>,
    /// Its groups of slopes among all groups, ascending, from 0.
    pub(super) groups: Vec<usize>,
}

/// Coefficients of a part.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// By origin, then by move.
    pub(super) intercepts: Vec<Vec<f64>>,
    pub(super) slopes: Vec<f64>,
}

impl Point {
    fn zeros(&self) -> Self {
        Self {
            intercepts: self.intercepts.iter().map(|values| vec![0.0; values.len()]).collect(),
            slopes: vec![0.0; self.slopes.len()],
        }
    }

    fn after(&self, step: &Step) -> Self {
        let add = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        let pairs = self.intercepts.iter().zip(&step.intercepts);
        Self {
            intercepts: pairs.map(|(a, b)| add(a, b)).collect(),
            slopes: add(&self.slopes, &step.slopes),
        }
    }
}

/// Largest range, over all rows, of the changes of the scores of a row by a step.
fn score_range(part: &Component<'_>, step: &Step) -> f64 {
    let mut range = 0.0_f64;
    for (seen, intercepts) in part.origins.iter().zip(&step.intercepts) {
        for (x, _) in seen.rows(part) {
            let changes =
                (0..intercepts.len()).map(|at| seen.score(at, intercepts, &step.slopes, x));
            let (low, high) = changes.fold((f64::INFINITY, f64::NEG_INFINITY), |range, change| {
                (range.0.min(change), range.1.max(change))
            });
            range = range.max(high - low);
        }
    }
    range
}

/// Climbs to the maximum. Returns `None` if the point is the maximum already, up to rounding.
pub(super) fn climb(part: &Component<'_>, start: &Point) -> Option<Point> {
    let (mut point, mut damping) = (None::<Point>, 0.0_f64);
    let mut now = Expansion::at(part, start);
    let mut gain_before = f64::INFINITY;
    for _ in 0..MOST {
        let step = now.step(part, damping);
        let (range, rounding) = (score_range(part, &step), ROUNDING * now.weight);
        // Ends if numbers leave the doubles, or if even a damped step, which follows any gradient,
        // gains nothing.
        if !step.gain.is_finite() || (damping > 0.0 && step.gain <= rounding) {
            break;
        }
        let after = |step: &Step| point.as_ref().unwrap_or(start).after(step);
        // Coefficients that run to infinity have long steps for hardly any gain. Newton's method
        // squares a small gain at each step, so a gain that does not even fall fourfold is
        // rounding.
        let flat = step.gain <= rounding && (range > SAFE || step.gain > gain_before / 4.0);
        if damping == 0.0 && (flat || range <= LAST) {
            // Where a probability is so near to 0 or 1 that the information underflows, there may
            // still be a gradient.
            let damped = now.step(part, DAMPING).gain;
            if damped > step.gain && damped > NOTHING * now.weight {
                // The scores may be farther out than steps can lead back from: coefficients of 0
                // may be better.
                let zeros = start.zeros();
                let at_zeros = Expansion::at(part, &zeros);
                if at_zeros.value > now.value {
                    (point, now, gain_before) = (Some(zeros), at_zeros, f64::INFINITY);
                } else {
                    damping = DAMPING;
                }
                continue;
            }
            let moves = step.gain > 0.0 && range <= SAFE;
            return if moves { Some(after(&step)) } else { point };
        }
        // A step that goes too far is taken in part: coefficients that run to infinity rise by
        // small steps.
        let (mut step, mut left) = (step, range);
        let found = loop {
            let next_point = after(&step);
            let next = Expansion::at(part, &next_point);
            if range <= SAFE || next.value > now.value {
                break Some((next_point, next));
            }
            if damping > 0.0 || left <= SAFE {
                break None;
            }
            (step, left) = (step.scaled(SHORTER), left * SHORTER);
        };
        if let Some((next_point, next)) = found {
            (point, now, gain_before) = (Some(next_point), next, step.gain);
            damping = if damping > DAMPING { damping / 10.0 } else { 0.0 };
        } else {
            damping = (damping * 10.0).max(DAMPING);
        }
    }
    point
}

/// Moves whose probability a further step would lower by a factor of √e or more at some row, as
/// pairs (origin within the part, move of the origin).
pub(super) fn diverging_moves(part: &Component<'_>, point: &Point) -> Vec<(usize, usize)> {
    let step = Expansion::at(part, point).step(part, 0.0);
    let mut found = Vec::new();
    for (origin, (seen, intercepts)) in part.origins.iter().zip(&point.intercepts).enumerate() {
        let mut falls = vec![false; intercepts.len()];
        for (x, _) in seen.rows(part) {
            let score = |at: usize| seen.score(at, intercepts, &point.slopes, x);
            let change = |at: usize| seen.score(at, &step.intercepts[origin], &step.slopes, x);
            let all = 0..intercepts.len();
            let largest = all.clone().map(score).fold(f64::NEG_INFINITY, f64::max);
            let weights = || all.clone().map(|at| (at, (score(at) - largest).exp()));
            // To first order, ln p of a move changes by the change of its score less the mean.
            let mean = weights().map(|(at, weight)| weight * change(at)).sum::<f64>()
                / weights().map(|entry| entry.1).sum::<f64>();
            let moves = falls.iter_mut().enumerate();
            moves.for_each(|(at, falls)| *falls |= change(at) - mean < -SAFE);
        }
        found.extend((0..falls.len()).filter(|at| falls[*at]).map(|at| (origin, at)));
    }
    found
}

// The objective of the M-step around a point, to second order: its value, gradient and information
// (minus the Hessian), and the step that maximises it.
//
// Origins have intercepts of their own, and share slopes. So the information has a small block for
// the intercepts of each origin, a block for all slopes, and cross terms between each origin and
// the slopes. The intercepts are eliminated origin by origin (the Schur complement), which leaves
// a system in the slopes.

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
    complement: Vec<f64>,
    /// Weights of all other moves.
    others: Vec<f64>,
    /// For each group of slopes: the sums of p over the moves inside and outside of it, and the
    /// sums of their weights.
    group_sums: Vec<[f64; 4]>,
}

/// For each value the sum of all others, without a subtraction.
fn sums_of_others(values: &[f64], out: &mut Vec<f64>) {
    // First the sums of all values before, then of all values after. The total less a value would
    // cancel if the value is nearly the total.
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
    fn fill(&mut self, seen: &OriginCounts, scores: impl Iterator<Item = f64>, weights: &[f64]) {
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
        sums_of_others(&self.p, &mut self.complement);
        sums_of_others(weights, &mut self.others);
        self.group_sums.clear();
        for group in &seen.groups {
            let mut sums = [0.0; 4];
            for (at, other) in seen.group_of.iter().enumerate() {
                let inside = other == &Some(*group);
                sums[usize::from(!inside)] += self.p[at];
                sums[2 + usize::from(!inside)] += weights[at];
            }
            self.group_sums.push(sums);
        }
    }
}

impl Expansion {
    /// Expands the objective of a part around a point. O(rows (m² + m k + k²)) for each origin,
    /// with m moves and k slopes.
    pub(super) fn at(part: &Component<'_>, point: &Point) -> Self {
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
        // The log prior, −λ / 2 Σ b², with a ridge λ for each input and the slopes b.
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
        part: &Component<'_>,
        seen: &OriginCounts,
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
                terms.gradient[i] += weights[i] * row.complement[i] - row.others[i] * row.p[i];
                // Information of a multinomial, total (diag p − p p'): lower triangle only.
                for k in (0..i).filter(|k| *k != seen.reference) {
                    terms.information[i * m + k] -= total * row.p[i] * row.p[k];
                }
                terms.information[i * m + i] += total * row.p[i] * row.complement[i];
                for (g, group) in seen.groups.iter().enumerate() {
                    let [inside, outside, ..] = row.group_sums[g];
                    // cov(move i, group) = p_i ([i in the group] − P(group)).
                    let mine = seen.group_of[i] == Some(*group);
                    let joint = total * row.p[i] * if mine { outside } else { -inside };
                    let cross = &mut terms.cross[i * own + g * p..i * own + (g + 1) * p];
                    cross.iter_mut().zip(x).for_each(|(cross, x)| *cross += joint * x);
                }
            }
            for (g, first) in seen.groups.iter().enumerate() {
                let [inside, outside, seen_inside, seen_outside] = row.group_sums[g];
                // Seen less expected in the group, w_in − total P(in), again without cancellation.
                let residual = seen_inside * outside - seen_outside * inside;
                for (k, x_k) in x.iter().enumerate() {
                    let at = first * p + k;
                    self.gradient[at] += residual * x_k;
                    self.size[at] += total * x_k * x_k;
                    for (h, second) in seen.groups[..=g].iter().enumerate() {
                        let other = if h == g { outside } else { -row.group_sums[h][0] };
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
    pub(super) fn step(&self, part: &Component<'_>, damping: f64) -> Step {
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

// Cholesky factors of information matrices, which may be singular.
//
// A parameter that the others determine (an input that is a sum of others, a label on all moves
// out of a state) has a pivot of 0, up to rounding. It is left out: its component of a solution is
// 0, and the others solve the system without it. (faer's factorisation leaves out none.)

/// A pivot that is this small a part of its diagonal entry has hardly a digit left: it is 0 up to
/// rounding.
const LEAST_PIVOT: f64 = 1e-12;

/// Lower triangle L of a symmetric matrix M = L L', row after row; a row of M that is left out has
/// a diagonal of 0 in L.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    size: usize,
    lower: Vec<f64>,
}

impl Factor {
    /// Factors a positive semi-definite matrix; only its lower triangle is read. Pivots are
    /// compared with `diagonal`. O(size³).
    pub(super) fn new(mut lower: Vec<f64>, diagonal: &[f64]) -> Self {
        let size = diagonal.len();
        for i in 0..size {
            let (above, row) = lower.split_at_mut(i * size);
            for j in 0..i {
                let other = &above[j * size..=j * size + j];
                let dot: f64 = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
                row[j] = if other[j] > 0.0 { (row[j] - dot) / other[j] } else { 0.0 };
            }
            let squares: f64 = row[..i].iter().map(|value| value * value).sum();
            let pivot = row[i] - squares;
            // A NaN fails the comparison, and is also left out.
            row[i] = if pivot > LEAST_PIVOT * diagonal[i] { pivot.sqrt() } else { 0.0 };
        }
        Self { size, lower }
    }

    /// Replaces b by L⁻¹ b. O(size²).
    pub(super) fn forward(&self, b: &mut [f64]) {
        for i in 0..self.size {
            let row = &self.lower[i * self.size..=i * self.size + i];
            let dot: f64 = row[..i].iter().zip(&b[..i]).map(|(l, b)| l * b).sum();
            b[i] = if row[i] > 0.0 { (b[i] - dot) / row[i] } else { 0.0 };
        }
    }

    /// Replaces b by L'⁻¹ b. O(size²).
    pub(super) fn backward(&self, b: &mut [f64]) {
        for i in (0..self.size).rev() {
            let column = (i + 1..self.size).map(|k| self.lower[k * self.size + i] * b[k]);
            let dot: f64 = column.sum();
            let pivot = self.lower[i * self.size + i];
            b[i] = if pivot > 0.0 { (b[i] - dot) / pivot } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_leave_out_what_is_determined() {
        // The third row is the sum of the first two.
        let m = [[4.0, 1.0, 5.0], [1.0, 3.0, 4.0], [5.0, 4.0, 9.0]];
        let factor = Factor::new(m.concat(), &[4.0, 3.0, 9.0]);
        let mut x = vec![6.0, 7.0, 13.0];
        factor.forward(&mut x);
        factor.backward(&mut x);
        assert_eq!(x[2], 0.0);
        for (row, b) in m.iter().zip([6.0, 7.0, 13.0]) {
            let product: f64 = row.iter().zip(&x).map(|(m, x)| m * x).sum();
            assert!((product - b).abs() < 1e-14, "{x:?}");
        }
    }
}
