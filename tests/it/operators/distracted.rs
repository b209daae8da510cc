//! A sensor that for a while follows something else.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::transition::{
    DistractedTransition, Distraction, DistractionRates, SwitchedTransition, WindowTransition,
};
use wayfix::{Transition, TransitionEntries};

use crate::kit::{
    Expected, Matrix, any_distribution, any_stochastic, assert_operator, cases, matrix, rate,
    sparse, still, stochastic, text, window,
};

/// The matrix, entry by entry from its definition.
fn distracted<C>(m: &Matrix, rates: DistractionRates, control: &Distraction<C>) -> Matrix {
    let DistractionRates { begin, end } = rates;
    let n = m.len();
    matrix(2 * n, |i, j| {
        let factor = match (i / n, j / n) {
            (0, 0) => 1.0 - begin,
            (1, 0) => begin * control.begins,
            (0, _) => end,
            _ => (1.0 - end) * control.continues,
        };
        factor * m[i % n][j % n]
    })
}

/// Likelihoods; `exact` ones have exact logarithms.
fn likelihood(exact: bool) -> BoxedStrategy<f64> {
    if exact {
        return prop_oneof![Just(0.0), Just(0.5), Just(1.0), Just(4.0)].boxed();
    }
    prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.01..10.0].boxed()
}

fn rates(exact: bool) -> impl Strategy<Value = DistractionRates> {
    (rate(exact), rate(exact)).prop_map(|(begin, end)| DistractionRates { begin, end })
}

/// Controls of three steps, the last one without an observation.
fn controls(exact: bool) -> impl Strategy<Value = Vec<Distraction<()>>> {
    vec([likelihood(exact), likelihood(exact)], 2).prop_map(|pairs| {
        let each = |[begins, continues]: [f64; 2]| Distraction { control: (), begins, continues };
        pairs.into_iter().map(each).chain([Distraction::none(())]).collect()
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn distracted_moves(
        (exact, m, rates, controls) in any::<bool>()
            .prop_flat_map(|e| (Just(e), any_stochastic(e, 4), rates(e), controls(e))),
    ) {
        let a = DistractedTransition::new(sparse(&m), rates).unwrap();
        let matrices: Vec<Matrix> =
            controls.iter().map(|control| distracted(&m, rates, control)).collect();
        let expected = Expected::each(&controls, &matrices).with_evidence(&[Some(0.0); 3]);
        assert_operator(a, expected.with_exact_ties(exact))?;
    }

    /// A base with a control, and one whose products come in blocks.
    #[test]
    fn distracted_bases(
        matrices in (1..=4_usize).prop_flat_map(|n| vec(stochastic(false, n), 3)),
        weights in any_distribution(false, 5), (n, first) in (1..=6_usize, -3..3_isize),
        rates in rates(false), plain in controls(false),
    ) {
        let base = SwitchedTransition::new(matrices.iter().map(sparse).collect()).unwrap();
        let a = DistractedTransition::new(base, rates).unwrap();
        let controls: Vec<Distraction<usize>> = (0..3)
            .zip(&plain)
            .map(|(control, &Distraction { begins, continues, .. })| Distraction { control, begins, continues })
            .collect();
        let all: Vec<Matrix> = controls
            .iter()
            .map(|control| distracted(&matrices[control.control], rates, control))
            .collect();
        assert_operator(a, Expected::each(&controls, &all).with_evidence(&[Some(0.0); 3]))?;

        let base = WindowTransition::closed(n, first, &weights).unwrap();
        let m = window(n, first, &weights, true);
        let a = DistractedTransition::new(base, rates).unwrap();
        let all: Vec<Matrix> =
            plain.iter().map(|control| distracted(&m, rates, control)).collect();
        assert_operator(a, Expected::each(&plain, &all).with_evidence(&[Some(0.0); 3]))?;
    }
}

#[test]
fn states_of_modes_are_numbered_in_halves() {
    let rates = DistractionRates { begin: 0.25, end: 0.5 };
    let a = DistractedTransition::new(still(3), rates).unwrap();
    assert_eq!((a.states(), a.rates(), a.base().states()), (6, rates, 3));
    let index = [(false, 2), (true, 0), (true, 2), (true, 3), (false, 3)];
    let found = index.map(|(distracted, state)| a.index(distracted, state));
    assert_eq!(found, [Some(2), Some(3), Some(5), None, None]);
    assert_eq!(a.mode_masses(&[0.25, 0.0, 0.25, 0.5, 0.0, 0.0]), [0.5, 0.5]);
    assert!(!a.has_restarts());
}

/// An entry beyond doubles, which is a product of numbers that are not.
#[test]
fn factors_beyond_doubles_take_logarithms() {
    let a = DistractedTransition::new(still(1), DistractionRates { begin: 1e-200, end: 0.5 });
    let a = a.unwrap();
    let control = |begins| Distraction { control: (), begins, continues: 1.0 };
    assert!(a.needs_logs(&control(1e-200)) && a.entries_need_logs(&control(1e-200)));
    assert!(!a.needs_logs(&control(1e-100)) && !a.needs_logs(&control(0.0)));
    let entries: Vec<(usize, f64)> = a.incoming_log2(&control(1e-200), 1).collect();
    assert!((entries[0].1 + 400.0 * 10_f64.log2()).abs() < 1e-9);
    assert_eq!(entries[1], (1, -1.0));
}

#[test]
fn bad_distractions_are_named() {
    let new = |begin, end| DistractedTransition::new(still(2), DistractionRates { begin, end });
    assert_eq!(
        text(new(-0.5, 0.0)),
        "the probability that a distraction begins is -0.5, expected a value from 0 to 1"
    );
    assert_eq!(
        text(new(0.5, f64::NAN)),
        "the probability that a distraction ends is NaN, expected a value from 0 to 1"
    );
    let long = WindowTransition::closed(1 << 31, 1, &[1.0]).unwrap();
    assert_eq!(
        text(DistractedTransition::new(long, DistractionRates { begin: 0.0, end: 0.0 })),
        "4294967296 states, expected at most 4294967295 (32-bit indices)"
    );
    let a = new(0.5, 0.5).unwrap();
    let check =
        |begins, continues| text(a.check_control(&Distraction { control: (), begins, continues }));
    assert_eq!(
        check(-1.0, 1.0),
        "the likelihood if the distraction begins is -1, expected a finite value of at least 0"
    );
    assert_eq!(
        check(1.0, f64::INFINITY),
        "the likelihood if the distraction goes on is inf, expected a finite value of at least 0"
    );
    let switched = SwitchedTransition::new(vec![still(2)]).unwrap();
    let a = DistractedTransition::new(switched, DistractionRates { begin: 0.5, end: 0.5 }).unwrap();
    assert!(a.check_control(&Distraction::none(0)).is_ok());
    assert!(a.check_control(&Distraction::none(1)).is_err());
}
