//! Products of operators allocate nothing after the first.

use wayfix::transition::LearnTransition;
use wayfix::transition::WindowTransition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior, TransitionEntries};
use wayfix_learn::{GeneratorTransition, LogitTransition};

use crate::allocations;

fn check_with<A: TransitionEntries>(name: &str, a: &A, control: &A::Control) {
    let mut products = wayfix_test_kit::all_products(a, control);
    products();
    assert_eq!(allocations(|| (0..3).for_each(|_| products())), 0, "{name}");
}

/// By a short series and a long one, and by a matrix; with a filter, and what a step adds to
/// statistics.
#[test]
fn a_generator_allocates_nothing() {
    let line = |n: usize| (1..n).flat_map(|i| [(i, i - 1, 1.0), (i - 1, i, 0.5)]);
    let few = GeneratorTransition::from_triplets(20, line(20)).unwrap();
    let many = GeneratorTransition::from_triplets(600, line(600)).unwrap();
    for time in [0.0, 0.3, 40.0, 1e6] {
        check_with("generator", &few, &time);
        let (b, mut after, mut sums) = (vec![0.05; 20], vec![0.0; 20], few.statistics());
        after[0] = 20.0;
        few.add_step(&mut sums, &time, &b, &after, 1.0);
        let found = allocations(|| _ = few.add_step(&mut sums, &time, &b, &after, 1.0));
        assert_eq!(found, 0, "statistics of a step of {time}");
    }
    check_with("generator", &many, &2.0);
    let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
    let hmm = Hmm::new(prior, few, LikelihoodVector::linear(20)).unwrap();
    let mut filter = hmm.filter();
    let times = [0.1, 3.0, 500.0, 1e5];
    times.iter().for_each(|time| _ = filter.step_with(time, &[0.5; 20]).unwrap());
    let found = allocations(|| {
        for k in 0..100 {
            filter.step_with(&times[k % 4], &[0.5; 20]).unwrap();
        }
    });
    assert_eq!(found, 0, "generator");
}

/// One with moves by inputs, near and below the range of doubles.
#[test]
fn moves_by_inputs_allocate_nothing() {
    let route = WindowTransition::open(20, -1, &[0.25, 0.25, 0.5]).unwrap();
    let by_inputs = LogitTransition::new(&route, 2).unwrap();
    let by_inputs = by_inputs.with_slopes(3, 4, &[1.0, -300.0]).unwrap();
    check_with("by inputs", &by_inputs, &vec![0.5, -1.0]);

    let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
    let hmm = Hmm::new(prior, by_inputs, LikelihoodVector::linear(20)).unwrap();
    let mut filter = hmm.filter();
    let inputs = [vec![0.5, -1.0], vec![0.0, 4.0]];
    inputs.iter().for_each(|u| _ = filter.step_with(u, &[0.5; 20]).unwrap());
    let found = allocations(|| {
        for k in 0..100 {
            filter.step_with(&inputs[k % 2], &[0.5; 20]).unwrap();
            filter.predict_with(&inputs[0]).unwrap();
        }
    });
    assert_eq!(found, 0, "by inputs");
}
