//! Probabilities of the parts of a route.

use wayfix_roads::matching::{MatchedDrive, Stretch};

/// Metres along a route within which roads count as the same part of it: near a junction, a point
/// may be on either side.
const NEAR: f64 = 150.0;

/// Probability of each part of the route: the mean smoothed probability of being on the route
/// nearby, over the points on the part. Parts between points have the lower of the probabilities
/// beside them.
pub(crate) fn probabilities(drive: &MatchedDrive) -> Vec<f64> {
    let route = drive.route();
    let mut sums = vec![(0.0, 0_usize); route.len()];
    let mut at = 0;
    for point in 0..drive.points().len() {
        let answer = drive.smoothed(point);
        if let Some(ahead) = route[at..].iter().position(|stretch| stretch.edge == answer.edge) {
            // Points advance along the route with the answers. An answer beside the route may match
            // an edge of it much later, by chance: it is skipped.
            let metres: f64 = route[at..at + ahead].iter().map(Stretch::metres).sum();
            if metres < 3000.0 {
                at += ahead;
                sums[at].0 += match answer.edge {
                    Some(_) => {
                        let near = near(route, at);
                        let on_route = |edge| near.iter().any(|s| s.edge == Some(edge));
                        let edges = drive.edges(point);
                        // Rounding may add up to more than 1.
                        edges.iter().filter(|e| on_route(e.0)).map(|e| e.1).sum::<f64>().min(1.0)
                    }
                    None => answer.probability,
                };
                sums[at].1 += 1;
            }
        }
    }
    // `None` for parts without a point.
    let known = |&(sum, count): &(f64, usize)| (count > 0).then(|| sum / count as f64);
    let known: Vec<Option<f64>> = sums.iter().map(known).collect();
    let near = |number: usize| {
        let before = known[..number].iter().rev().find_map(|p| *p);
        let after = known[number..].iter().find_map(|p| *p);
        before.unwrap_or(1.0).min(after.unwrap_or(1.0))
    };
    (0..route.len()).map(|number| known[number].unwrap_or_else(|| near(number))).collect()
}

/// Parts of a route within [`NEAR`] metres of part `at`.
fn near(route: &[Stretch], at: usize) -> &[Stretch] {
    let within = |parts: &mut dyn Iterator<Item = &Stretch>| {
        let mut metres = 0.0;
        let is_near = |part: &&Stretch| {
            // By the metres before the part, so one that begins near counts as near.
            let near = metres < NEAR;
            metres += part.metres();
            near
        };
        parts.take_while(is_near).count()
    };
    let before = within(&mut route[..at].iter().rev());
    let after = within(&mut route[at + 1..].iter());
    &route[at - before..=at + after]
}
