//! After warm-up, a camera allocates nothing.

use wayfix::observation::{AppearanceLikelihood, Offsets, Spread, ViewComparison};
use wayfix::transition::WindowTransition;
use wayfix::{Belief, Hmm, OptionalLikelihood, Prior};

use crate::allocations;

#[test]
fn a_step_allocates_nothing() {
    let n = 60;
    let row = |k: usize| -> Vec<f32> {
        let distance = |i: usize| 0.2 + ((i * 37 + k * 11) % 101) as f32;
        let far = |i: usize| k % 3 == 1 && i % 7 == 2;
        (0..n).map(|i| if far(i) { f32::INFINITY } else { distance(i) }).collect()
    };
    // Then one in which all are equal, and one in which all are infinite.
    let mut rows: Vec<Option<Vec<f32>>> = (0..20).map(|k| Some(row(k))).collect();
    rows.extend([Some(vec![0.5; n]), None, Some(vec![f32::INFINITY; n])]);
    let invalid = Some(vec![f32::NAN; n]);
    for spread in [
        Spread::Query,
        Spread::Local { radius: 4, closed: false },
        Spread::Local { radius: 4, closed: true },
        Spread::Local { radius: 1000, closed: true },
        Spread::Fixed(0.3),
    ] {
        // Of likelihoods as numbers, and as logarithms.
        for temperature in [0.5, 1e-4] {
            for off_map in [false, true] {
                let camera = AppearanceLikelihood::new(n).unwrap().with_spread(spread).unwrap();
                let camera = camera.with_offsets(Offsets::All, &[row(3), row(5)], 1.0).unwrap();
                let mut camera = camera.with_temperature(temperature).unwrap();
                if off_map {
                    camera = camera.with_off_map(0.2).unwrap();
                }
                let states = n + usize::from(off_map);
                let prior = Prior::AtFirstObservation(Belief::uniform(states).unwrap());
                let motion = WindowTransition::new(states, -20, &[1.0 / 41.0; 41], true);
                let camera = OptionalLikelihood::new(camera);
                let hmm = Hmm::new(prior, motion.unwrap(), camera).unwrap();
                let mut filter = hmm.filter();
                filter.step(&rows[0]).unwrap();
                let found = allocations(|| {
                    for row in &rows[..21 + usize::from(off_map) * 2] {
                        filter.step(row).unwrap();
                    }
                });
                assert_eq!(found, 0, "{spread:?}, temperature {temperature}");
                // What is not valid makes an error on the heap, and no more.
                assert!(allocations(|| drop(filter.step(&invalid))) <= 1);
                let found = allocations(|| drop(filter.step(&rows[1])));
                assert_eq!(found, 0, "{spread:?}, after an error");
            }
        }
    }

    let mut views = ViewComparison::new(0.1).unwrap();
    views.next(&row(0)).unwrap();
    let rows: Vec<Vec<f32>> = rows.into_iter().flatten().collect();
    let found = allocations(|| {
        for row in rows.iter().chain(&rows) {
            views.next(row).unwrap();
        }
    });
    assert_eq!(found, 0, "views");
}
