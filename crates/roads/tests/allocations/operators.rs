//! Steps on cells of roads allocate nothing after the first.

use wayfix::likelihood::GroupedLikelihood;
use wayfix::map::{PlanePosition, RoadClass};
use wayfix::{Belief, Hmm, LikelihoodVector, Prior};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::cells::{CellTransition, RoadCells, TurnWeights, WheelTransition, Wheels};

use crate::allocations;

/// Steps of a filter within a cell, and with a change of scales.
#[test]
fn wheels_allocate_nothing() {
    let mut builder = NetworkBuilder::new();
    builder.node(1, PlanePosition { x: 0.0, y: 0.0 }).unwrap();
    builder.node(2, PlanePosition { x: 30.0, y: 0.0 }).unwrap();
    builder.both_ways(1, 2, RoadClass::Street).unwrap();
    let cells = RoadCells::new(builder.build().unwrap(), 1.0).unwrap();
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let motion = WheelTransition::new(motion, Wheels::default()).unwrap();
    let mut odometer = motion.odometer();
    let controls = [0.1, 1.3, 2.0].map(|metres| odometer.add(metres, 1e-3).unwrap());
    let start = motion.spread(&Belief::uniform(cells.states()).unwrap()).unwrap();
    let sensor = LikelihoodVector::linear(cells.states());
    let sensor = GroupedLikelihood::new(sensor, motion.cell_groups()).unwrap();
    let hmm = Hmm::new(Prior::AtFirstObservation(start), motion, sensor).unwrap();
    let mut filter = hmm.filter();
    let seen = vec![0.5; cells.states()];
    controls.iter().for_each(|control| _ = filter.step_with(control, &seen).unwrap());
    let found = allocations(|| {
        for k in 0..30 {
            filter.step_with(&controls[k % 3], &seen).unwrap();
        }
    });
    assert_eq!(found, 0, "wheels");
}
