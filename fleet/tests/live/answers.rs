//! Answers of pools are those of the library's filters.

use std::sync::Arc;

use rand::RngExt;
use wayfix::{Hmm, LikelihoodVector};
use wayfix_fleet::pool::{Pool, Update, VehicleId};

use crate::filters::*;
use crate::kit::*;

#[test]
fn answers_are_those_of_filters_to_the_bit() {
    for seed in 0..3 {
        let mut rng = rng(seed);
        let symbols = updates(&mut rng, 5000, |rng| match rng.random_range(0..50) {
            0 => RARE as usize,
            1 => 6, // does not exist
            _ => rng.random_range(0..5),
        });
        all_ways(&model(seed), &symbols);
        all_ways(&model(seed).with_rounded_tails(), &symbols);
    }
}

#[test]
fn states_in_logarithms_too() {
    let mut rng = rng(7);
    let sensor = LikelihoodVector::log(STATES).owned();
    let hmm = Hmm::new(prior(), transition(&mut rng), sensor).unwrap();
    let seen = updates(&mut rng, 3000, wide);
    let mut filters = Filters::new(&hmm);
    seen.iter().for_each(|update| _ = filters.take(update));
    assert!(filters.vehicles.values().any(|vehicle| vehicle.1.steps_in_logs() > 0));
    all_ways(&hmm, &seen);
}

#[test]
fn a_removed_vehicle_begins_at_the_prior() {
    let hmm = Arc::new(model(4));
    let mut filters = Filters::new(&hmm);
    let mut pool = Pool::new(Arc::clone(&hmm), "model", &threads(1)).unwrap();
    let mut rng = rng(3);
    for step in 0..2000 {
        let vehicle = VehicleId::from(rng.random_range(0..40));
        if rng.random_bool(0.3) {
            assert_eq!(pool.remove(&vehicle), filters.vehicles.remove(&vehicle).is_some());
        } else {
            let update = Update::new(0, step, rng.random_range(0..5));
            let update = Update { vehicle, ..update };
            assert_eq!(bits(&pool.update(&update)), filters.take(&update));
        }
        assert_eq!(pool.usage().vehicles, filters.vehicles.len());
    }
}
