//! Following a vehicle allocates nothing after the first two steps, and comparing views nothing
//! after the first.

use wayfix_recognition::motion::OffMap;
use wayfix_recognition::observation::{Distance, ViewComparison};
use wayfix_recognition::{Options, Recognizer, Track};

use crate::allocations;
use wayfix_test_kit::noise;

const PLACES: usize = 50;
const DIMENSION: usize = 16;

fn options(off_map: bool) -> Options {
    Options::default().with_off_map(off_map.then(OffMap::default))
}

fn check(name: &str, mut track: Track, queries: &[Vec<f32>]) {
    let drive = |track: &mut Track, from: usize| {
        for k in from..from + 60 {
            // It drives, and stands from time to time.
            let query = &queries[(k - k / 5 % 3) % queries.len()];
            let reading = (k % 4 > 0).then_some(0.9);
            std::hint::black_box(track.step_with(reading, query).unwrap());
        }
    };
    track.step(&queries[0]).unwrap();
    track.step_with(1.0, &queries[1]).unwrap();
    assert_eq!(allocations(|| drive(&mut track, 2)), 0, "{name}");
    // After a query that is refused, and after a relocation.
    assert!(track.step(&[f32::NAN; 3]).is_err());
    assert_eq!(allocations(|| drive(&mut track, 60)), 0, "{name}, after an error");
    assert_eq!(allocations(|| track.relocate()), 0, "{name}");
    assert_eq!(allocations(|| drive(&mut track, 90)), 0, "{name}, anew");
}

#[test]
fn a_step_allocates_nothing() {
    let rows = |count: usize, seed| -> Vec<Vec<f32>> {
        noise(DIMENSION * count, seed).chunks(DIMENSION).map(<[f32]>::to_vec).collect()
    };
    let (references, other) = (rows(PLACES, 1), rows(PLACES, 2));
    for off_map in [false, true] {
        let distances: Vec<Vec<f32>> =
            noise(PLACES * 40, 3).chunks(PLACES).map(<[f32]>::to_vec).collect();
        let by_distances = Recognizer::from_distances(PLACES, options(off_map)).unwrap();
        check("distances", by_distances.track(), &distances);
        for distance in [Distance::Cosine, Distance::Euclidean] {
            let one = Recognizer::from_descriptors(&references, distance, options(off_map));
            check("descriptors", one.unwrap().track(), &rows(40, 4));
            let passes = [&references[..], &other[..]];
            let two = Recognizer::from_traverses(&passes, distance, options(off_map));
            check("two traverses", two.unwrap().track(), &rows(40, 4));
        }
    }
}

#[test]
fn views_allocate_nothing() {
    let n = 60;
    let row = |k: usize| -> Vec<f32> {
        let distance = |i: usize| 0.2 + ((i * 37 + k * 11) % 101) as f32;
        let far = |i: usize| k % 3 == 1 && i % 7 == 2;
        (0..n).map(|i| if far(i) { f32::INFINITY } else { distance(i) }).collect()
    };
    // Then a row of equal distances, and one of infinite ones.
    let mut rows: Vec<Vec<f32>> = (0..20).map(row).collect();
    rows.extend([vec![0.5; n], vec![f32::INFINITY; n]]);

    let mut views = ViewComparison::new(0.1).unwrap();
    views.next(&rows[0]).unwrap();
    let found = allocations(|| {
        for row in rows.iter().chain(&rows) {
            views.next(row).unwrap();
        }
    });
    assert_eq!(found, 0, "views");
}
