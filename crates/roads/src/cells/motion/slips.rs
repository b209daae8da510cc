//! Cells lost in slips: a compound Poisson distribution of geometric losses (Pólya and Aeppli), by
//! Panjer's recursion (1981).

/// Probability, relative to the largest, at which the tail ends.
const TAIL: f64 = 1e-20;
/// Limit beyond which values are scaled down.
const LARGE: f64 = 1e200;

/// Slips of wheels, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slips {
    /// Slips in each metre.
    pub(super) rate: f64,
    /// Mean metres lost in each slip.
    pub(super) metres: f64,
}

impl Slips {
    /// Probabilities of the number of whole cells lost over a distance; they sum to one, up to
    /// the tail. O(largest number).
    pub(super) fn lost(&self, driven: f64, cell: f64) -> Vec<f64> {
        // A slip loses j cells with probability (1 − q) q^j. So slips that lose any cells come q
        // times as often, and lose 1 + j.
        let q = self.metres / (self.metres + cell);
        let events = self.rate * driven * q;
        if events == 0.0 {
            return vec![1.0];
        }
        // Panjer, with e events: s P(s) = e (1 − q) W(s), W(s) = Σ j q^(j−1) P(s − j). With
        // U(s) = Σ q^(j−1) P(s − j) both sums follow from those of s − 1, and nothing cancels:
        // U(s) = P(s − 1) + q U(s − 1), W(s) = U(s) + q W(s − 1).
        let mut lost = vec![1.0];
        let (mut u, mut w, mut largest) = (0.0, 0.0, 1.0_f64);
        let mut past = false;
        for cells in 1.. {
            u = lost[cells - 1] + q * u;
            w = u + q * w;
            let p = events * (1.0 - q) * w / cells as f64;
            // The tail ends below a share of the largest value, but not while values rise.
            past |= p < lost[cells - 1];
            largest = largest.max(p);
            if past && p < TAIL * largest {
                break;
            }
            lost.push(p);
            // Starting at 1 instead of e^−events, which may underflow, values can grow; the
            // recursion is linear, so scaling all of its state changes nothing.
            if p > LARGE {
                (u, w, largest) = (u / LARGE, w / LARGE, largest / LARGE);
                lost.iter_mut().for_each(|p| *p /= LARGE);
            }
        }
        let sum: f64 = lost.iter().rev().sum();
        lost.iter_mut().for_each(|p| *p /= sum);
        lost
    }
}

/// Variance of the number of cells between the cell where a vehicle is and the one where it should
/// be, for an error of this variance (in squared cells), if it is equally likely anywhere in its
/// cell.
///
/// An error of x cells becomes ⌊x⌋ with probability 1 − f and ⌊x⌋ + 1 with f, the fraction of x, so
/// f (1 − f) adds to the variance. On average over a Gaussian the total is E|x| if the error is
/// small, and 1/6 more than its variance if it is large.
pub(super) fn rounded(variance: f64) -> f64 {
    let deviation = variance.sqrt();
    // f (1 − f) = |x| − x² for |x| ≤ 1, which is seven deviations here: the total is E|x| = σ √(2 /
    // π).
    if deviation < 1.0 / 7.0 {
        return deviation * std::f64::consts::FRAC_2_PI.sqrt();
    }
    // Fourier series of f (1 − f), averaged term by term: E cos(2 π n x) = exp(−2 π² n² σ²).
    let square = std::f64::consts::PI.powi(2);
    let term = |n: f64| (-2.0 * square * n * n * variance).exp() / (square * n * n);
    variance + 1.0 / 6.0 - (1..=9).map(|n| term(f64::from(n))).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_those_of_the_sum_over_numbers_of_slips() {
        let slips = Slips { rate: 0.3, metres: 0.7 };
        let (driven, cell) = (4.0, 0.5);
        let found = slips.lost(driven, cell);
        let q: f64 = 0.7 / 1.2;
        let events = slips.rate * driven;
        // Poisson number of slips, each with a geometric loss, which may be 0.
        let first = Some(1.0 - q);
        let geometric = std::iter::successors(first, |p| Some(p * q)).take(found.len());
        let geometric: Vec<f64> = geometric.collect();
        let mut power = vec![0.0; found.len()];
        power[0] = 1.0;
        let (mut expected, mut share) = (vec![0.0; found.len()], (-events).exp());
        for number in 1..60 {
            expected.iter_mut().zip(&power).for_each(|(sum, p)| *sum += share * p);
            share *= events / f64::from(number);
            power = (0..power.len())
                .map(|s| (0..=s).map(|j| geometric[j] * power[s - j]).sum())
                .collect();
        }
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn mean_and_variance_are_those_of_the_model() {
        for (rate, metres, driven) in [(0.02, 0.1, 1.0), (1.0, 3.0, 50.0), (500.0, 0.1, 2000.0)] {
            let slips = Slips { rate, metres };
            let lost = slips.lost(driven, 0.5);
            let cells = |k: usize| k as f64;
            let mean: f64 = lost.iter().enumerate().map(|(k, p)| p * cells(k)).sum();
            let off = |(k, p): (usize, &f64)| p * (cells(k) - mean).powi(2);
            let variance: f64 = lost.iter().enumerate().map(off).sum();
            let expected = rate * driven * metres / 0.5;
            assert!((mean / expected - 1.0).abs() < 1e-9, "{mean} {expected}");
            let each = metres / 0.5;
            let expected = rate * driven * each * (1.0 + 2.0 * each);
            assert!((variance / expected - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn rounding_is_that_of_a_vehicle_anywhere_in_its_cell() {
        for deviation in [0.01, 0.1, 0.142, 0.143, 0.3, 1.0, 4.0] {
            // By the midpoint rule over errors.
            let step = deviation / 2000.0;
            let (mut sum, mut expected) = (0.0, 0.0);
            for k in -16_000..16_000 {
                let x = (f64::from(k) + 0.5) * step;
                let p = (-0.5 * (x / deviation).powi(2)).exp();
                let f = x - x.floor();
                sum += p;
                expected += p * (x * x + f * (1.0 - f));
            }
            let found = rounded(deviation * deviation);
            assert!((found / (expected / sum) - 1.0).abs() < 1e-6, "{deviation}: {found}");
        }
        assert_eq!(rounded(0.0), 0.0);
    }
}
