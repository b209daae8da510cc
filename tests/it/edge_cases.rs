//! Ties, empty and single-step sequences, one state, factors, and numbers at
//! the limits of a double.

use wayfix::error::At;
use wayfix::inference::Order;
use wayfix::transition::{KroneckerTransition, RestartTransition, SwitchedTransition};
use wayfix::{
    Belief, DenseTransition, Diagonal, FusedLikelihood, Hmm, HmmError, Likelihood, LikelihoodError,
    LikelihoodVector, OptionalLikelihood, Prior, Scratch, SparseTransition, TableLikelihood,
    Transition, TransitionEntries,
};

use crate::kit::rng;

fn before(belief: Belief) -> Prior {
    Prior::BeforeFirstTransition(belief)
}

fn uniform(n: usize) -> Belief {
    Belief::uniform(n).unwrap()
}

fn identity(n: usize) -> DenseTransition {
    DenseTransition::from_fn(n, |i, j| f64::from(i == j)).unwrap()
}

/// All paths by probability, best first, and ties by the last state, then the last but one, and so
/// on, as documented. Products of powers of two are exact.
fn first_best(prior: &[f64], a: &[[f64; 3]; 3], ys: &[[f64; 3]]) -> Vec<usize> {
    let mut best = (0.0, Vec::new());
    for number in 0..3_usize.pow(ys.len() as u32) {
        // The last state is the most significant digit: ascending order is
        // the order of ties.
        let digits = (0..ys.len() as u32).map(|k| number / 3_usize.pow(k) % 3);
        let path: Vec<usize> = digits.collect();
        let mut p = prior[path[0]] * ys[0][path[0]];
        for k in 1..path.len() {
            p *= a[path[k]][path[k - 1]] * ys[k][path[k]];
        }
        if p > best.0 {
            best = (p, path);
        }
    }
    best.1
}

fn check_ties<A: TransitionEntries<Control = ()>>(make: impl Fn(&[[f64; 3]]) -> A) {
    let columns = [[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.125, 0.125, 0.75], [0.5, 0.5, 0.0]];
    let prior = [0.25, 0.5, 0.25];
    let rows = [[1.0, 1.0, 1.0], [0.5, 1.0, 0.25], [1.0, 0.5, 0.5], [0.0, 1.0, 1.0]];
    for model in 0..4 * 4 * 4 {
        let column = |j: usize| columns[model / [1, 4, 16][j] % 4];
        let a: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| column(j)[i]));
        let hmm = Hmm::new(
            Prior::AtFirstObservation(Belief::new(prior.to_vec()).unwrap()),
            make(&a),
            LikelihoodVector::linear(3),
        )
        .unwrap();
        for sequence in 0..4_usize.pow(4) {
            let ys: Vec<[f64; 3]> = (0..4).map(|k| rows[sequence / 4_usize.pow(k) % 4]).collect();
            let expected = first_best(&prior, &a, &ys);
            if let Ok(path) = hmm.viterbi(&ys) {
                assert_eq!(path.states(), expected, "{a:?} {ys:?}");
            }
        }
    }
}

#[test]
fn viterbi_ties_go_to_the_lowest_last_state_then_the_last_but_one() {
    check_ties(|a| DenseTransition::from_rows(a).unwrap());
    check_ties(|a| SparseTransition::from_rows(a).unwrap());
}

/// Two states that never change, and have the same factors in different orders: the path is in the
/// lower one, whatever the factors.
#[test]
fn the_same_factors_in_another_order_tie() {
    for prior in [before(uniform(2)), Prior::AtFirstObservation(uniform(2))] {
        let hmm = Hmm::new(prior, identity(2), LikelihoodVector::linear(2)).unwrap();
        let mut factor = 0.123_456_789;
        for _ in 0..5000 {
            let mut factors = [0.0; 5];
            for f in &mut factors {
                factor = (factor * 1_000.0 + 0.618_033_988_7_f64).fract();
                *f = factor.max(1e-6);
            }
            let order = [3, 0, 4, 1, 2];
            let ys: Vec<[f64; 2]> = (0..5).map(|k| [factors[k], factors[order[k]]]).collect();
            assert_eq!(hmm.viterbi(&ys).unwrap().states(), [0; 5], "{ys:?}");
        }
    }
}

#[test]
fn when_all_is_tied_state_0_it_is() {
    for n in [1, 2, 9, 20] {
        let a = SparseTransition::from_rows(&vec![vec![1.0 / n as f64; n]; n]).unwrap();
        let hmm = Hmm::new(before(uniform(n)), a, LikelihoodVector::linear(n)).unwrap();
        let ys = vec![vec![1.0; n]; 5];
        assert_eq!(hmm.viterbi(&ys).unwrap().states(), [0; 5]);
        assert_eq!(hmm.filter().belief().mode(), 0);
        assert_eq!(hmm.smooth(&ys).unwrap().posteriors().modes(), [0; 5]);
    }
}

#[test]
fn an_empty_sequence_leaves_the_prior() {
    for prior in [before(uniform(3)), Prior::AtFirstObservation(uniform(3))] {
        let hmm = Hmm::new(prior, identity(3), LikelihoodVector::linear(3)).unwrap();
        let none: [[f64; 3]; 0] = [];
        let smoothing = hmm.smooth(&none).unwrap();
        assert_eq!(smoothing.log_likelihood(), 0.0);
        assert_eq!(smoothing.posteriors().steps(), 0);
        assert_eq!(smoothing.posteriors().get(0).unwrap().as_slice(), uniform(3).as_slice());
        assert!(smoothing.posteriors().modes().is_empty());
        let path = hmm.viterbi(&none).unwrap();
        assert_eq!((path.states(), path.log_probability()), (&[][..], 0.0));
        assert_eq!(hmm.filter().forecast(0).unwrap(), uniform(3));
    }
}

#[test]
fn one_state_is_always_that_state() {
    let a = SparseTransition::from_rows(&[[1.0]]).unwrap();
    let hmm = Hmm::new(before(uniform(1)), a, LikelihoodVector::linear(1)).unwrap();
    let smoothing = hmm.smooth(&[[0.5], [1e-300], [1e300]]).unwrap();
    assert!(smoothing.posteriors().as_slice().iter().all(|p| *p == 1.0));
    assert!((smoothing.log_likelihood() - 0.5_f64.ln()).abs() <= 1e-12);
    let impossible = hmm.smooth(&[[0.5], [0.0]]).unwrap_err();
    assert!(matches!(impossible, HmmError::Impossible { step: 2 }));
}

/// A sensor with a factor taken out.
struct Factored;

impl Likelihood for Factored {
    type Observation = ([f64; 2], f64);
    fn states(&self) -> usize {
        2
    }
    fn diagonal<'a>(
        &'a self,
        (values, log_factor): &'a Self::Observation,
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(Diagonal::linear(values).with_log_factor(*log_factor))
    }
}

#[test]
fn log_factors_are_added_back_wherever_the_step_is_taken() {
    let hmm = Hmm::new(before(Belief::certain(2, 0).unwrap()), identity(2), Factored).unwrap();
    // The second observation contradicts the belief so much that the step is taken in logarithms.
    let ys = [([0.5, 0.5], 3.0), ([1e-200, 1.0], -7.0), ([1e-250, 1e-250], 1.0)];
    let expected = 0.5_f64.ln() + 3.0 + 1e-200_f64.ln() - 7.0 + 1e-250_f64.ln() + 1.0;
    let close = |found: f64| assert!((found - expected).abs() <= 1e-11, "{found} {expected}");
    close(hmm.smooth(&ys).unwrap().log_likelihood());
    close(hmm.viterbi(&ys).unwrap().log_probability());
    let mut filter = hmm.filter();
    for y in &ys {
        filter.step(y).unwrap();
    }
    close(filter.log_likelihood());

    let wrong = hmm.filter().step(&([1.0, 1.0], f64::NAN)).unwrap_err();
    assert_eq!(
        wrong.to_string(),
        "step 1 has no valid likelihood: the log factor is NaN, expected a value from -1e300 to 1e300"
    );

    // Fused: factors add up, and a product below the range of a double is kept.
    let fused = FusedLikelihood::new(Factored, Factored).unwrap();
    let hmm = Hmm::new(before(uniform(2)), identity(2), fused).unwrap();
    let tiny = ([1e-200, 3e-200], 1.0);
    let mut filter = hmm.filter();
    filter.step(&(tiny, tiny)).unwrap();
    assert!((filter.belief().as_slice()[0] - 0.1).abs() <= 1e-12);
    let expected = 5.0_f64.ln() + 2.0 * (1e-200_f64.ln() + 1.0);
    assert!((filter.log_likelihood() - expected).abs() <= 1e-11);
}

/// Log-likelihoods of any size keep the digits of their differences, fused or
/// not, in linear space or in logarithms; and no sum becomes NaN.
#[test]
fn large_shifts_cost_no_digits() {
    for shift in [0.0, 1e6, 1e9] {
        let prior = Belief::new(vec![1.0, 1e-300]).unwrap();
        let y = [shift, shift + 750.0];
        let difference = (y[1] - y[0]) + 1e-300_f64.ln();
        let expected = 1.0 / (1.0 + (-difference).exp());
        let log = Hmm::new(before(prior.clone()), identity(2), LikelihoodVector::log(2)).unwrap();
        let mut filter = log.filter();
        filter.step(&y).unwrap();
        assert!((filter.belief().as_slice()[1] - expected).abs() <= 1e-12);

        let table = TableLikelihood::from_rows(&[[0.5, 0.5]; 2]).unwrap();
        let fused = FusedLikelihood::new(LikelihoodVector::log(2).owned(), table).unwrap();
        let fused = Hmm::new(before(prior), identity(2), fused).unwrap();
        let mut filter = fused.filter();
        filter.step(&(y.to_vec(), 1)).unwrap();
        assert!((filter.belief().as_slice()[1] - expected).abs() <= 1e-12);
    }
    let hmm = Hmm::new(before(uniform(2)), identity(2), LikelihoodVector::log(2)).unwrap();
    for huge in [1e300, -1e300] {
        let ys = [[huge; 2]; 2];
        let smoothing = hmm.smooth(&ys).unwrap();
        assert_eq!(smoothing.log_likelihood(), 2.0 * huge);
        assert_eq!(hmm.viterbi(&ys).unwrap().log_probability(), 2.0 * huge);
        assert_eq!(smoothing.posteriors().get(2).unwrap().as_slice(), [0.5, 0.5]);
    }
}

/// Values that underflow in an otherwise ordinary step.
#[test]
fn small_likelihoods_of_a_step_keep_their_digits() {
    let prior = Belief::new(vec![0.4, 1e-9, 0.6 - 1e-9]).unwrap();
    let never = f64::NEG_INFINITY;
    let hmm = Hmm::new(before(prior), identity(3), LikelihoodVector::log(3)).unwrap();
    let ys = [[-745.5, 0.0, never], [0.0, -735.0, 0.0]];
    let mut filter = hmm.filter();
    filter.step(&ys[0]).unwrap();
    filter.step(&ys[1]).unwrap();
    let odds = 1e-9 / 0.4 * (745.5_f64 - 735.0).exp();
    assert!((filter.belief().as_slice()[0] - 1.0 / (1.0 + odds)).abs() <= 1e-12);

    let prior = Belief::new(vec![1e-150, 1e-9, 1.0 - 1e-9]).unwrap();
    let hmm = Hmm::new(before(prior), identity(3), LikelihoodVector::linear(3)).unwrap();
    let mut filter = hmm.filter();
    filter.step(&[3e-170, 1e-3, 0.0]).unwrap();
    assert!((filter.belief().as_slice()[0] / 3e-308 - 1.0).abs() <= 1e-12);
}

/// Values that pass through 1e-600 within a step come out right.
#[test]
fn a_step_through_numbers_beyond_a_double_is_exact() {
    let prior = Belief::new(vec![1.0, 1e-300]).unwrap();
    let a =
        SparseTransition::from_triplets(3, [(0, 0, 1.0), (2, 1, 1e-300), (1, 1, 1.0), (2, 2, 1.0)]);
    let prior = Belief::new([prior.into_vec(), vec![0.0]].concat()).unwrap();
    let hmm = Hmm::new(before(prior), a.unwrap(), LikelihoodVector::linear(3)).unwrap();
    let mut filter = hmm.filter();
    filter.step(&[0.0, 0.0, 0.5]).unwrap();
    assert_eq!(filter.belief().as_slice(), [0.0, 0.0, 1.0]);
    let expected = 2.0 * 1e-300_f64.ln() + 0.5_f64.ln();
    assert!((filter.log_likelihood() - expected).abs() <= 1e-11);
    let smoothing = hmm.smooth(&[[0.0, 0.0, 0.5]]).unwrap();
    assert_eq!(smoothing.posteriors().get(0).unwrap().as_slice(), [0.0, 1.0, 0.0]);
    assert_eq!(hmm.viterbi(&[[0.0, 0.0, 0.5]]).unwrap().states(), [2]);
}

/// A parked car, a position sensor with Gaussian log-likelihoods, one fix that is a kilometre off
/// (more than doubles hold), and then good ones: the filter recovers, and so does the
/// log-likelihood.
#[test]
fn one_large_outlier_is_forgotten() {
    let places = 40;
    let fix =
        |place: usize| move |i: usize| -0.5 * (i.abs_diff(place) as f64 * 100.0 / 20.0).powi(2);
    let fixes: Vec<usize> = std::iter::once(25).chain([15; 30]).collect();
    let ys: Vec<Vec<f64>> = fixes.iter().map(|&at| (0..places).map(fix(at)).collect()).collect();
    let hmm = Hmm::new(before(uniform(places)), identity(places), LikelihoodVector::log(places));
    let hmm = hmm.unwrap();
    let mut filter = hmm.filter();
    for y in &ys {
        filter.step(y).unwrap();
    }
    assert_eq!(filter.belief().mode(), 15);
    // All paths stay where they are.
    let sums = (0..places).map(|i| ys.iter().map(|y| y[i]).sum::<f64>() - (places as f64).ln());
    let best = sums.fold(f64::NEG_INFINITY, f64::max);
    let close = |found: f64| assert!((found - best).abs() <= 1e-9, "{found} {best}");
    close(filter.log_likelihood());
    let smoothing = hmm.smooth(&ys).unwrap();
    close(smoothing.log_likelihood());
    assert_eq!(smoothing.posteriors().modes(), [15; 31]);
    close(hmm.viterbi(&ys).unwrap().log_probability());

    // It continues from a snapshot, too, where doubles alone would have lost it.
    let mut first = hmm.filter();
    first.step(&ys[0]).unwrap();
    assert_eq!(first.belief().as_slice()[15], 0.0);
    let mut second = hmm.filter();
    second.restore(&first.snapshot()).unwrap();
    for y in &ys[1..] {
        second.step(y).unwrap();
    }
    assert_eq!(second.snapshot(), filter.snapshot());
    // A prediction in between keeps it, too.
    first.predict().unwrap();
    for y in &ys[1..] {
        first.step(y).unwrap();
    }
    assert_eq!(first.belief().mode(), 15);
    first.relocate(&Belief::certain(places, 3).unwrap()).unwrap();
    assert_eq!(first.belief().mode(), 3);
}

/// Log-likelihoods so far apart that their sums are rounded to hundredths: less exact, but not an
/// error.
#[test]
fn a_centimetre_sensor_may_be_wrong_by_kilometres() {
    // 0 and 1 are one component, 2 another; neither can be left.
    let a = SparseTransition::from_rows(&[[0.3, 0.6, 0.0], [0.7, 0.4, 0.0], [0.0, 0.0, 1.0]]);
    let hmm = Hmm::new(before(uniform(3)), a.unwrap(), LikelihoodVector::log(3)).unwrap();
    for far in [1e8, 1e10, 1.3e12, 1e14] {
        let ys = [[-far, -far, 0.0], [0.0, -1.0, -2.0 * far], [-1.0, 0.0, 0.0]];
        let smoothing = hmm.smooth(&ys).unwrap_or_else(|error| panic!("{far}: {error}"));
        assert!(smoothing.posteriors().with_start().all(|belief| belief.as_slice()[2] == 0.0));
        assert!((smoothing.log_likelihood() + far).abs() <= 10.0);
    }
}

#[test]
fn what_is_far_behind_is_not_impossible() {
    let hmm = Hmm::new(before(uniform(2)), identity(2), LikelihoodVector::log(2)).unwrap();
    let ys = [[0.0, -800.0], [f64::NEG_INFINITY, 0.0]];
    let smoothing = hmm.smooth(&ys).unwrap();
    assert!((smoothing.log_likelihood() - (-800.0 - 2_f64.ln())).abs() <= 1e-12);
    assert_eq!(smoothing.posteriors().get(0).unwrap().as_slice(), [0.0, 1.0]);
}

#[test]
fn a_probability_of_1e_300_keeps_its_digits() {
    let prior = Belief::new(vec![1.0, 3e-300]).unwrap();
    let hmm = Hmm::new(before(prior), identity(2), LikelihoodVector::linear(2)).unwrap();
    let mut filter = hmm.filter();
    for _ in 0..1000 {
        filter.step(&[0.25, 0.25]).unwrap();
        filter.predict().unwrap();
    }
    assert!((filter.belief().as_slice()[1] / 3e-300 - 1.0).abs() <= 1e-12);
    filter.step(&[0.0, 1.0]).unwrap();
    assert_eq!(filter.belief().as_slice(), [0.0, 1.0]);
}

#[test]
fn a_missing_observation_is_a_prediction() {
    let a = DenseTransition::from_rows(&[[0.7, 0.2], [0.3, 0.8]]).unwrap();
    let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]]).unwrap();
    let hmm = Hmm::new(before(uniform(2)), a, OptionalLikelihood::new(table)).unwrap();
    let (mut missing, mut predicted) = (hmm.filter(), hmm.filter());
    missing.step(&Some(0)).unwrap();
    predicted.step(&Some(0)).unwrap();
    missing.step(&None).unwrap();
    predicted.predict().unwrap();
    for (a, b) in missing.belief().as_slice().iter().zip(predicted.belief().as_slice()) {
        assert!((a - b).abs() <= 1e-16);
    }
    assert!((missing.log_likelihood() - predicted.log_likelihood()).abs() <= 1e-15);
}

#[test]
fn a_filter_restarts_at_the_prior() {
    let hmm = Hmm::new(before(uniform(2)), identity(2), LikelihoodVector::linear(2)).unwrap();
    let mut filter = hmm.filter();
    let fresh = filter.snapshot();
    filter.step(&[0.9, 0.2]).unwrap();
    assert_ne!(filter.snapshot(), fresh);
    filter.restart();
    assert_eq!(filter.snapshot(), fresh);
}

/// A table whose symbols speak against a state by 1e-300 each, again and again, and then for it: no
/// possible state has been lost.
#[test]
fn a_table_erases_nothing() {
    let table = TableLikelihood::from_rows(&[[1.0, 0.0, 1e-300], [1e-300, 1.0, 0.0]]).unwrap();
    let hmm = Hmm::new(before(uniform(2)), identity(2), table).unwrap();
    let ys = [0, 0, 0, 0, 0, 1];
    let smoothing = hmm.smooth(&ys).unwrap();
    assert_eq!(smoothing.posteriors().modes(), [1; 6]);
    let expected = 5.0 * 1e-300_f64.ln() + 0.5_f64.ln();
    assert!((smoothing.log_likelihood() - expected).abs() < 1e-9);
    assert_eq!(hmm.viterbi(&ys).unwrap().states(), [1; 6]);
    assert_eq!(hmm.expected_moves(&ys).unwrap().get(1, 1), 6.0);
    assert_eq!(hmm.path_entropy(&ys).unwrap(), 0.0);
}

/// Every routine on one state, no steps, and one step.
#[test]
fn every_routine_has_an_answer_for_next_to_nothing() {
    for n in [1, 3] {
        for prior in [before(uniform(n)), Prior::AtFirstObservation(uniform(n))] {
            let moves = f64::from(prior == before(uniform(n)));
            let hmm = Hmm::new(prior, identity(n), LikelihoodVector::linear(n)).unwrap();
            let none: [[f64; 3]; 0] = [];
            let none = none.map(|y| y[..n].to_vec());
            assert_eq!(hmm.log_likelihood(&none).unwrap(), 0.0);
            assert_eq!(hmm.forward(&none).unwrap().posteriors().steps(), 0);
            assert_eq!(hmm.path_entropy(&none).unwrap(), 0.0);
            assert_eq!(hmm.expected_moves(&none).unwrap().moves().len(), 0);
            assert_eq!(hmm.k_best(&none, 5).unwrap().len(), 1);
            assert!(hmm.k_best(&none, 0).unwrap().is_empty());
            assert!(hmm.online_viterbi().undecided().is_empty());
            let mut visited = 0;
            hmm.smooth_each(&none, Order::Forward, |step| {
                assert!(step.moves().is_none());
                assert_eq!(step.smoothed().as_slice(), uniform(n).as_slice());
                visited += 1;
            })
            .unwrap();
            assert_eq!(visited, 1);
            assert_eq!(hmm.fixed_lag(2).lagged().as_slice(), uniform(n).as_slice());
            let mut rng = rng(1);
            assert!(hmm.path_sampler(&none).unwrap().draw(&mut rng).unwrap().is_empty());

            let one = [vec![0.5; n]];
            assert!((hmm.log_likelihood(&one).unwrap() - 0.5_f64.ln()).abs() < 1e-15);
            assert!((hmm.path_entropy(&one).unwrap() - (n as f64).ln()).abs() < 1e-15);
            let paths = hmm.k_best(&one, 5).unwrap();
            let states: Vec<_> = paths.iter().map(|path| path.states()[0]).collect();
            assert_eq!(states, (0..n).collect::<Vec<_>>(), "tied: by state");
            let sum: f64 = hmm.expected_moves(&one).unwrap().moves().map(|m| m.weight).sum();
            assert!((sum - moves).abs() < 1e-15);
            let mut decoder = hmm.online_viterbi();
            let committed = decoder.step(&one[0]).unwrap().to_vec();
            assert_eq!([committed, decoder.undecided()].concat(), [0]);
            assert!(hmm.path_sampler(&one).unwrap().draw(&mut rng).unwrap()[0] < n);
        }
    }
}

/// Restoring a fixed lag in logarithms with a model that does not know one of its controls is an
/// error, and leaves the smoother as it was.
#[test]
fn a_snapshot_with_an_unknown_control_is_refused() {
    let model = |operators: usize| {
        let gears = SwitchedTransition::new(vec![identity(2); operators]).unwrap();
        Hmm::new(before(uniform(2)), gears, LikelihoodVector::log(2)).unwrap()
    };
    let (three, two) = (model(3), model(2));
    for far in [-1.0, -2000.0] {
        let mut smoother = three.fixed_lag(2);
        smoother.step_with(&0, &[0.0, far]).unwrap();
        smoother.step_with(&2, &[0.0, far]).unwrap();
        let mut other = two.fixed_lag(2);
        other.step_with(&1, &[0.0, -1.0]).unwrap();
        let kept = other.snapshot();
        let error = other.restore(&smoother.snapshot()).unwrap_err();
        assert!(matches!(error, HmmError::Control(At { number: 2, .. })), "{error}");
        assert_eq!(other.snapshot(), kept);
    }
}

/// Entries of 1e-400, which only a product of operators can have.
#[test]
fn entries_beyond_a_double_are_right() {
    let half = || SparseTransition::from_triplets(2, [(1, 0, 1e-200), (0, 0, 1.0), (0, 1, 1.0)]);
    let both = KroneckerTransition::new(half().unwrap(), half().unwrap()).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(4, 0).unwrap());
    let hmm = Hmm::new(prior, both, LikelihoodVector::linear(4)).unwrap();
    let ys = [[1.0; 4], [0.0, 0.0, 0.0, 1.0]];
    let expected = -400.0 * 10.0_f64.ln();
    assert!((hmm.log_likelihood(&ys).unwrap() - expected).abs() < 1e-9);
    let path = hmm.viterbi(&ys).unwrap();
    assert_eq!(path.states(), [0, 3]);
    assert!((path.log_probability() - expected).abs() < 1e-9);
    assert_eq!(hmm.k_best(&ys, 2).unwrap(), [path]);
    assert_eq!(hmm.smooth(&ys).unwrap().posteriors().modes(), [0, 3]);
    assert!((hmm.expected_moves(&ys).unwrap().get(0, 3) - 1.0).abs() < 1e-12);
    assert_eq!(hmm.path_sampler(&ys).unwrap().draw(&mut rng(1)).unwrap(), [0, 3]);
}

/// The first step of a decoder, with numbers beyond the range of doubles.
#[test]
fn a_tiny_prior_keeps_its_digits_in_decoders() {
    let least = 2.3e-308;
    for to_2 in [1e-300, least, 1e-320] {
        let ways = [(0, 0, 1.0), (2, 1, to_2), (1, 1, 1.0), (2, 2, 1.0)];
        let a = SparseTransition::from_triplets(3, ways).unwrap();
        let prior = Belief::new(vec![1.0, least, 0.0]).unwrap();
        let hmm = Hmm::new(before(prior), a, LikelihoodVector::linear(3)).unwrap();
        let y = [[0.0, 0.0, 1.0]];
        let expected = least.ln() + to_2.ln();
        let close = |found: f64| assert!((found - expected).abs() < 1e-11, "{found} {expected}");
        close(hmm.log_likelihood(&y).unwrap());
        close(hmm.viterbi(&y).unwrap().log_probability());
        close(hmm.k_best(&y, 3).unwrap()[0].log_probability());
    }
}

/// A factor of the prior ties with the same factor of a transition.
#[test]
fn priors_and_entries_tie_with_each_other() {
    for (a, b) in (1..70).flat_map(|a| (1..70).map(move |b| (f64::from(a), f64::from(b)))) {
        let (a, b) = (a * 0.005, b * 0.005);
        // 0 → 2 with b after a, 1 → 2 with a after b.
        let ways = [(0, 0, 1.0 - b), (2, 0, b), (1, 1, 1.0 - a), (2, 1, a), (2, 2, 1.0)];
        let motion = SparseTransition::from_triplets(3, ways).unwrap();
        let prior = Belief::new(vec![a, b, 1.0 - a - b]).unwrap();
        let hmm = Hmm::new(Prior::AtFirstObservation(prior), motion, LikelihoodVector::linear(3))
            .unwrap();
        let ys = [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(hmm.viterbi(&ys).unwrap().states(), [0, 2], "{a} {b}");
        let paths = hmm.k_best(&ys, 2).unwrap();
        assert_eq!(paths[0].log_probability(), paths[1].log_probability());
    }
}

#[test]
fn numbers_beyond_reason_are_errors() {
    let hmm = |a| Hmm::new(before(uniform(2)), a, LikelihoodVector::log(2)).unwrap();
    let error = hmm(identity(2)).log_likelihood(&[[1e308, 1e308]; 2]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "step 1 has no valid likelihood: state 0 has log-likelihood 1e308, expected a value from -1e300 to 1e300, or negative infinity"
    );
    assert!(
        hmm(identity(2)).log_likelihood(&[[1e300, -1e300], [-1e300, 1e300]]).unwrap().is_finite()
    );
    let restart = Belief::new(vec![1.0, 1e-200]).unwrap();
    let error = RestartTransition::new(identity(2), 1e-200, restart).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the probability of a restart in state 1 is 0, expected 0 or at least 2.2e-308, the smallest normal double"
    );
}

/// A negative prediction is found even if it is small.
#[test]
fn a_slightly_negative_prediction_is_an_error() {
    struct Negative;
    impl Transition for Negative {
        type Control = usize;
        fn states(&self) -> usize {
            2
        }
        fn apply(&self, _: &usize, x: &[f64], out: &mut [f64]) {
            let sum = x[0] + x[1];
            out.copy_from_slice(&[sum * (1.0 + 1e-9), sum * -1e-9]);
        }
        fn apply_transpose(&self, _: &usize, x: &[f64], out: &mut [f64]) {
            out.fill(x[0] * (1.0 + 1e-9) - x[1] * 1e-9);
        }
    }
    let hmm = Hmm::new(before(uniform(2)), Negative, LikelihoodVector::linear(2)).unwrap();
    let error = hmm.filter().step_with(&0, &[1.0, 1.0]).unwrap_err();
    assert!(matches!(error, HmmError::Predicted { step: 1, state: 1, value } if value < 0.0));
}

#[test]
fn a_missing_sighting_rounds_tails_too() {
    // State 1 keeps 1e-30 of itself at each step, from 1e-300 to below the range of doubles.
    let fade =
        SparseTransition::from_triplets(2, [(0, 0, 1.0), (0, 1, 1.0), (1, 1, 1e-30)]).unwrap();
    let prior = || Prior::AtFirstObservation(Belief::new(vec![1.0, 1e-300]).unwrap());
    let seen = [Some(vec![0.0, 0.0]), None, Some(vec![-2000.0, 0.0])];
    let vector = LikelihoodVector::log(2).owned();
    let exact = Hmm::new(prior(), &fade, OptionalLikelihood::new(vector)).unwrap();
    assert_eq!(exact.smooth(&seen).unwrap().posteriors().modes()[2], 1);
    let rounded = exact.with_rounded_tails();
    assert_eq!(rounded.smooth(&seen).unwrap().posteriors().modes()[2], 0);
}
