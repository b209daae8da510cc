//! Routines that take little of most programs' time.

use std::cell::LazyCell;
use std::hint::black_box;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::{LabelledSequence, LearningOptions, Order};
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;

use crate::models::Model;
use crate::timed::{Group, POSSIBLE};

pub(crate) fn bench<A, B, F>(group: &mut Group<'_>, steps: usize, model: &LazyCell<Model<A, B>, F>)
where
    A: LearnTransition<Control = ()> + Clone,
    B: LearnLikelihood<Observation: Sized + Sync> + Clone,
    F: FnOnce() -> Model<A, B>,
{
    let one = || {
        let Model { hmm, seen } = &**model;
        (hmm, &seen[..steps])
    };
    group.single("online viterbi", 1, || {
        let Model { hmm, seen } = &**model;
        let (mut decoder, mut seen) = (hmm.online_viterbi(), seen.iter().cycle());
        move || seen.next().map(|y| decoder.step(y).expect(POSSIBLE).len())
    });
    group.single("forecast of 10", 10, || {
        let filter = model.hmm.filter();
        move || filter.forecast(10)
    });
    let orders = [("forward", Order::Forward), ("backward", Order::Backward)];
    for (name, order) in orders {
        group.single(&format!("smooth each {name}"), steps, || {
            let (hmm, ys) = one();
            move || {
                hmm.smooth_each(ys, order, |step| {
                    black_box(step.smoothed().as_slice()[0]);
                })
            }
        });
    }
    group.single("expected moves", steps, || {
        let (hmm, ys) = one();
        move || hmm.expected_moves(ys)
    });
    group.single("path entropy", steps, || {
        let (hmm, ys) = one();
        move || hmm.path_entropy(ys)
    });
    group.single("10 best paths", steps, || {
        let (hmm, ys) = one();
        move || hmm.k_best(ys, 10)
    });
    group.single("draw a path", steps, || {
        let (hmm, ys) = one();
        let sampler = hmm.path_sampler(ys).expect(POSSIBLE);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        move || sampler.draw(&mut rng)
    });
    let once = &LearningOptions::default().with_iterations(1);
    group.single("learn labelled", steps, || {
        let (hmm, ys) = one();
        let path = hmm.viterbi(ys).expect(POSSIBLE).into_states();
        move || hmm.fit(&[LabelledSequence { initial: None, states: &path, sequence: ys }], once)
    });
}
