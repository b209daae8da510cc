//! Lower bound on the score of a reference, by the scores of its neighbours
//! (`guide::formulas`, Neighbours).

/// Margin, in deviations, by which a score may fall below that of its nearer neighbour before any
/// query, and number of queries that doubles it.
const ALONE: f64 = 1.25;
const ALONE_COUNT: f64 = 10.0;

/// Bounds each standardised score along a route from below: it may fall short of the smaller of its
/// neighbours' scores, or of 0, the score of a wrong place, if that is smaller, by a margin that
/// grows with `count`, the number of queries that usual scores were learned from. O(n).
///
/// A place looks like its neighbours, and a broken reference does not: one with all distances
/// divided by 100 is nearest to every query, and would hold the vehicle until its usual score is
/// known. Neighbours at an infinite distance were not compared, and bound nothing.
pub(crate) fn bound_by_neighbours(scores: &mut [f64], closed: bool, count: f64) {
    let [first, .., last] = *scores else { return };
    let alone = ALONE * (1.0 + count / ALONE_COUNT);
    let end = |score: f64| if closed { score } else { f64::INFINITY };
    let mut before = end(last);
    let mut bound = |score: &mut f64, after: f64| {
        let nearer = before.min(after);
        before = *score;
        let least = if nearer == f64::INFINITY { f64::NEG_INFINITY } else { nearer.min(0.0) };
        *score = score.max(least - alone);
    };
    for at in 1..scores.len() {
        let after = scores[at];
        bound(&mut scores[at - 1], after);
    }
    if let Some(last) = scores.last_mut() {
        bound(last, end(first));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounded(scores: &[f64], closed: bool, count: f64) -> Vec<f64> {
        let mut scores = scores.to_vec();
        bound_by_neighbours(&mut scores, closed, count);
        scores
    }

    #[test]
    fn a_reference_counts_as_little_more_than_its_neighbours() {
        let scores = [0.5, -9.0, 1.0, -3.0, -4.0, -3.0, 0.0, -5.0];
        let open = [0.5, -1.25, 1.0, -3.0, -4.0, -3.0, 0.0, -1.25];
        assert_eq!(bounded(&scores, false, 0.0), open);
        assert_eq!(bounded(&scores, false, 10.0)[1], -2.5);
        // Around a loop the last reference is beside the first.
        assert_eq!(bounded(&[-2.0, 0.0, 0.0, -3.0], true, 0.0), [-2.0, 0.0, 0.0, -3.0]);
        assert_eq!(bounded(&[-2.0, 0.0, 0.0, -3.0], false, 0.0), [-1.25, 0.0, 0.0, -1.25]);
    }

    #[test]
    fn a_reference_that_is_compared_alone_counts_in_full() {
        let far = f64::INFINITY;
        assert_eq!(bounded(&[far, -4.0, far, 0.0], false, 0.0), [far, -4.0, far, 0.0]);
        assert_eq!(bounded(&[far, -4.0, 0.0], false, 0.0), [far, -1.25, 0.0]);
        assert_eq!(bounded(&[-4.0], true, 0.0), [-4.0]);
        assert_eq!(bounded(&[-4.0], false, 0.0), [-4.0]);
    }
}
