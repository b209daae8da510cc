//! Statements of the paper about its map and its results, which the reconstruction fulfils.

use wayfix::map::{RoadClass, RoadMap};
use wayfix::observation::Confusion;
use wayfix::{Transition, canberra, evaluate};

use crate::kit::rng;

/// Φ between places by the paper's numbers.
fn phi(from: usize, to: usize) -> f64 {
    canberra::turning().get(from - 1, to - 1)
}

fn has_main_road(map: &RoadMap, place: usize) -> bool {
    map.roads_from(place).any(|(_, road)| road.class == RoadClass::Main)
}

#[test]
fn there_are_105_places_numbered_from_1_and_315_roads_on_which_all_can_be_reached() {
    let map = canberra::map();
    assert_eq!(map.places().len(), 105);
    assert_eq!(canberra::PLACES, 105);
    assert_eq!(map.roads().len(), 315);
    assert!(map.places().iter().zip(1..).all(|(place, id)| place.id == id));
    assert!(map.is_strongly_connected());
    // No road is shorter than the line between its ends (rounded to metres).
    for (i, _) in map.places().iter().enumerate() {
        for (j, road) in map.roads_from(i) {
            assert!(road.metres >= map.metres_between(i, j).unwrap() - 2.0, "{road:?}");
        }
    }
}

#[test]
fn place_1_leads_to_2_and_70_and_going_on_is_likelier_than_turning_than_stopping() {
    assert!(phi(1, 2) > phi(1, 70));
    assert!(phi(1, 70) > phi(1, 1));
    assert!(phi(1, 1) > 0.0);
}

#[test]
fn places_1_to_9_go_straight_on_more_and_stop_less() {
    let (map, turning) = (canberra::map(), canberra::turning());
    let off_main = (0..105).filter(|&i| !has_main_road(&map, i));
    let least_stop = off_main.map(|i| turning.get(i, i)).fold(1.0, f64::min);
    for place in 0..9 {
        assert!(has_main_road(&map, place));
        assert!(turning.get(place, place) < least_stop, "place {}", place + 1);
        // Each way along the main road draws more than any other way or a stop.
        let along = map.roads_from(place).filter(|(_, road)| road.class == RoadClass::Main);
        let along: Vec<usize> = along.map(|(to, _)| to).collect();
        let least = along.iter().map(|&to| turning.get(place, to)).fold(1.0, f64::min);
        let others = turning.row(place).filter(|(to, _)| !along.contains(to));
        let most = others.map(|(_, p)| p).fold(0.0, f64::max);
        assert!(least > most, "place {}: {least} along, {most} else", place + 1);
        assert!(along.iter().map(|&to| turning.get(place, to)).sum::<f64>() > 0.5);
    }
}

#[test]
fn place_66_goes_every_way_about_equally_and_may_park() {
    let turning = canberra::turning();
    let ways: Vec<f64> = turning.row(65).filter(|(to, _)| *to != 65).map(|(_, p)| p).collect();
    assert!(ways.len() >= 3);
    let (low, high) =
        (ways.iter().copied().fold(1.0, f64::min), ways.iter().copied().fold(0.0, f64::max));
    assert!(high - low < 0.05, "{ways:?}");
    assert!(turning.get(65, 65) > 0.1);
    assert!(turning.get(65, 65) > turning.get(0, 0));
}

#[test]
fn rows_of_phi_and_columns_of_a_sum_to_one() {
    let turning = canberra::turning();
    for place in 0..105 {
        let sum: f64 = turning.row(place).map(|(_, p)| p).sum();
        assert!((sum - 1.0).abs() <= 1e-15, "place {}", place + 1);
    }
    let a = turning.into_transition();
    assert_eq!(a.entries(), 315 + 105);
    let mut sums = vec![0.0; 105];
    a.apply_transpose(&(), &[1.0; 105], &mut sums);
    assert!(sums.iter().all(|sum| (sum - 1.0).abs() <= 1e-15));
}

#[test]
fn the_mean_diagonal_of_p_c_is_0_7_and_only_neighbours_are_confused() {
    let map = canberra::map();
    let confusion = Confusion::new(&map, canberra::MEAN_CORRECT).unwrap();
    let diagonal = (0..105).map(|i| confusion.probability(i, i).unwrap());
    let mean = diagonal.sum::<f64>() / 105.0;
    assert!((mean - 0.7).abs() <= 1e-12, "{mean}");
    for i in 0..105 {
        let joined = map.joined(i);
        for j in 0..105 {
            let p = confusion.probability(i, j).unwrap();
            assert_eq!(p > 0.0, i == j || joined.contains(&j));
            // The right place is much likelier than any single wrong one.
            assert!(i == j || p < 0.25 * confusion.probability(i, i).unwrap());
        }
    }
}

/// Eqs. 2 to 4 for one pair of places, by hand: place 1, seen as 2 (a
/// neighbour, index distance 1) and as 4 (no neighbour, distance 3).
#[test]
fn the_sensor_is_equations_2_to_4() {
    let map = canberra::map();
    let confusion = Confusion::new(&map, 0.7).unwrap();
    for sigma in [1.0_f64, 2.0] {
        let sensor = canberra::sensor(sigma).unwrap();
        let gaussian = |d: usize| {
            (-0.5 * (d as f64 / sigma).powi(2)).exp() / (std::f64::consts::TAU.sqrt() * sigma)
        };
        let normalizer = 1.0 + (0..105).map(gaussian).sum::<f64>();
        for (seen, d) in [(0, 0), (1, 1), (3, 3)] {
            let expected = (confusion.probability(0, seen).unwrap() + gaussian(d)) / normalizer;
            assert!((sensor.probability(0, seen).unwrap() - expected).abs() <= 1e-15);
        }
    }
}

#[test]
fn a_place_that_is_not_there_and_a_sigma_of_zero_are_errors() {
    let text = |initial, sigma| canberra::hmm(initial, sigma).unwrap_err().to_string();
    assert_eq!(text(106, 1.0), "the initial place is 106, expected 1 to 105");
    assert_eq!(text(0, 1.0), "the initial place is 0, expected 1 to 105");
    assert_eq!(text(5, 0.0), "sigma is 0, expected a finite value above 0");
    assert_eq!(text(5, f64::NAN), "sigma is NaN, expected a finite value above 0");
}

/// Table 1 with 500 drives a setting: the paper's figures lie within the
/// central 95% of single drives; smoother beats filter beats sensor by more
/// than four standard errors; more noise is worse.
///
/// The differences are about ten standard errors or more, so that a correct program would fail here
/// for fewer than one seed in a million.
#[test]
fn table_1() {
    let (runs, steps) = (500, 50);
    let mut means = Vec::new();
    for (initial, sigma, paper) in
        [(5, 1.0, [0.76, 0.88]), (5, 2.0, [0.68, 0.82]), (90, 1.0, [0.76, 0.82])]
    {
        let hmm = canberra::hmm(initial, sigma).unwrap();
        let mut rng = rng(2);
        let mut accuracies = [const { Vec::new() }; 3];
        for _ in 0..runs {
            let drive = hmm.simulate(steps, &mut rng);
            let smoothing = hmm.smooth(drive.observations()).unwrap();
            let estimates = [
                drive.observations().to_vec(),
                hmm.forward(drive.observations()).unwrap().posteriors().modes(),
                smoothing.posteriors().modes(),
            ];
            for (all, estimate) in accuracies.iter_mut().zip(&estimates) {
                all.push(evaluate::accuracy(drive.states(), estimate).unwrap());
            }
            let path = hmm.viterbi(drive.observations()).unwrap();
            assert_eq!(evaluate::illegal_moves(hmm.transition(), path.states()), Ok(0));
        }
        let statistics = accuracies.map(|mut all| {
            all.sort_by(f64::total_cmp);
            let mean = all.iter().sum::<f64>() / f64::from(runs);
            let variance =
                all.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / f64::from(runs - 1);
            (mean, (variance / f64::from(runs)).sqrt(), all[12], all[487])
        });
        for (better, worse) in [(2, 1), (1, 0)] {
            let (a, b) = (statistics[better], statistics[worse]);
            assert!(
                a.0 - b.0 > 4.0 * a.1.hypot(b.1),
                "start {initial}, sigma {sigma}: {statistics:?}"
            );
        }
        for (&(.., low, high), paper) in statistics[1..].iter().zip(paper) {
            assert!((low..=high).contains(&paper), "{paper} is not in {low} to {high}");
        }
        means.push(statistics.map(|s| s.0));
    }
    assert!((0..3).all(|estimator| means[1][estimator] < means[0][estimator]));
}

/// The tables are files in the format for maps.
#[cfg(feature = "csv")]
#[test]
fn the_tables_are_maps_in_csv() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/canberra");
    let read = RoadMap::<wayfix::map::Position>::from_csv_files(
        folder.join("places.csv"),
        folder.join("roads.csv"),
    );
    let (read, map) = (read.unwrap(), canberra::map());
    assert_eq!(read.places(), map.places());
    assert_eq!(read.roads(), map.roads());
    assert_eq!(map.places().len(), canberra::PLACES);
}
