//! Errors say what is wrong, and where.

use std::error::Error;

use wayfix::likelihood::LogLikelihoodFn;
use wayfix::map::{
    ByClass, Place, Position, Road, RoadClass, RoadMap, TurningProbabilities, TurningRule,
};
use wayfix::observation::{Confusion, Metric};
use wayfix::transition::SwitchedTransition;
use wayfix::{
    Belief, Controlled, DenseTransition, Diagonal, FusedLikelihood, Hmm, HmmError, Likelihood,
    LikelihoodError, LikelihoodVector, Prior, Scratch, SparseTransition, TableLikelihood,
    Transition, evaluate,
};

use crate::kit::{says, still, text};

#[test]
fn transitions() {
    let sparse = |entries: &[(usize, usize, f64)]| {
        SparseTransition::from_triplets(2, entries.iter().copied())
    };
    says(
        sparse(&[(0, 0, 1.0), (0, 1, 0.3), (1, 1, 0.6)]),
        "column 1 (the transitions out of state 1) sums to 0.8999999999999999, expected 1",
    );
    says(
        sparse(&[(0, 0, 1.0), (1, 1, f64::NAN)]),
        "the transition from state 1 to state 1 has probability NaN, expected a finite value of at least 0",
    );
    says(
        sparse(&[(0, 0, 1.5), (1, 0, -0.5), (1, 1, 1.0)]),
        "the transition from state 0 to state 1 has probability -0.5, expected a finite value of at least 0",
    );
    says(
        sparse(&[(0, 0, 1.0), (2, 1, 1.0)]),
        "the transition from state 1 to state 2 is out of range, there are 2 states (0 to 1)",
    );
    says(
        sparse(&[(0, 0, 0.5), (0, 0, 0.5), (1, 1, 1.0)]),
        "the transition from state 0 to state 0 is given twice",
    );
    says(
        SparseTransition::from_triplets(0, []),
        "a transition operator needs at least one state, found none",
    );
    says(
        DenseTransition::from_row_major(2, &[0.5; 3]),
        "3 values given for 2 states, expected 4 (states squared)",
    );
    says(
        SparseTransition::from_row_major(2, &[0.5; 5]),
        "5 values given for 2 states, expected 4 (states squared)",
    );
    says(
        DenseTransition::from_rows(&[[0.5, 0.45], [0.5, 0.45]]),
        "column 1 (the transitions out of state 1) sums to 0.9, expected 1",
    );
    says(
        DenseTransition::from_rows(&[[0.5, f64::INFINITY], [0.5, 0.0]]),
        "the transition from state 1 to state 0 has probability inf, expected a finite value of at least 0",
    );
    let long = [vec![0.5, 0.5], vec![0.5, 0.5, 0.0]];
    let found = "row 1 has 3 values, expected 2, as many as rows";
    says(DenseTransition::from_rows(&long), found);
    says(SparseTransition::from_rows(&long), found);
    let none = "a transition operator needs at least one state, found none";
    says(DenseTransition::from_rows::<[f64; 1]>(&[]), none);
    says(SparseTransition::from_rows::<[f64; 1]>(&[]), none);
    // Rows as in textbooks, p(to j | from i) at i, j.
    let rows = [[0.9, 0.1], [0.5, 0.5]];
    let transposed = "column 0 (the transitions out of state 0) sums to 1.4, expected 1, but the rows sum to one: transpose, so that the entry at row i and column j is p(to i | from j)";
    says(DenseTransition::from_rows(&rows), transposed);
    says(SparseTransition::from_rows(&rows), transposed);
    says(SparseTransition::from_row_major(2, rows.as_flattened()), transposed);
    says(DenseTransition::from_row_major(2, rows.as_flattened()), transposed);
    says(sparse(&[(0, 0, 0.9), (0, 1, 0.1), (1, 0, 0.5), (1, 1, 0.5)]), transposed);

    let weights = |weights: &[_]| SparseTransition::from_weights(2, weights.iter().copied());
    for (bad, found) in [(-1.0, "-1"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        says(
            weights(&[(0, 0, 2.0), (1, 0, bad), (1, 1, 1.0)]),
            &format!(
                "the transition from state 0 to state 1 has weight {found}, expected a finite value of at least 0"
            ),
        );
    }
    for of_1 in [&[(1, 0, 3.0)][..], &[(1, 0, 3.0), (0, 1, 0.0)]] {
        says(
            weights(of_1),
            "column 1 (the transitions out of state 1) has no weight above 0, expected at least one",
        );
    }
    says(
        weights(&[(0, 0, 1.0), (0, 2, 1.0)]),
        "the transition from state 2 to state 0 is out of range, there are 2 states (0 to 1)",
    );
    says(SparseTransition::from_weights(0, []), none);

    let of = |n| DenseTransition::from_fn(n, |i, j| f64::from(i == j)).unwrap();
    says(
        SwitchedTransition::new(vec![of(2), of(3)]),
        "operator 1 has 3 states, expected 2 to match operator 0",
    );
    says(
        SwitchedTransition::<DenseTransition>::new(vec![]),
        "a transition operator needs at least one state, found none",
    );
}

#[test]
fn tables() {
    says(
        TableLikelihood::from_rows(&[[0.5, 0.5], [0.5, 0.4]]),
        "the sum of the symbol probabilities of state 1 is 0.9, expected 1",
    );
    says(
        TableLikelihood::from_rows(&[vec![0.5, 0.5], vec![1.0]]),
        "the length of the row of state 1 is 1, expected 2",
    );
    says(
        TableLikelihood::from_rows(&[[0.5, 0.5], [1.5, -0.5]]),
        "the probability of symbol 1 in state 1 is -0.5, expected a finite value of at least 0",
    );
    says(
        TableLikelihood::from_rows::<[f64; 2]>(&[]),
        "the number of states of a table is 0, expected at least 1",
    );
}

/// A user's operator whose columns sum to 0.9.
struct Leaky;

impl Transition for Leaky {
    type Control = ();
    fn states(&self) -> usize {
        2
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[x[0], 0.9 * x[1]]);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.apply(&(), x, out);
    }
}

/// A user's operator that confuses the matrix and its transpose.
struct Twisted;

impl Transition for Twisted {
    type Control = ();
    fn states(&self) -> usize {
        2
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[0.5 * x[0] + 0.25 * x[1], 0.5 * x[0] + 0.75 * x[1]]);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[0.75 * x[0] + 0.25 * x[1], 0.5 * x[0] + 0.5 * x[1]]);
    }
}

/// An operator with a control, which can only be checked while it is used.
struct Rate;

impl Transition for Rate {
    type Control = f64;
    fn states(&self) -> usize {
        2
    }
    fn apply(&self, rate: &f64, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[(1.0 - rate) * x[0], rate * x[0] + x[1]]);
    }
    fn apply_transpose(&self, rate: &f64, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[(1.0 - rate) * x[0] + rate * x[1] * 0.5, x[1]]);
    }
}

fn at_0() -> Prior {
    Prior::BeforeFirstTransition(Belief::certain(2, 0).unwrap())
}

#[test]
fn models() {
    let table = TableLikelihood::from_rows(&[[1.0]; 3]).unwrap();
    says(
        Hmm::new(at_0(), still(2), table.clone()),
        "the likelihood operator has 3 states, expected 2 to match the prior",
    );
    let three = DenseTransition::from_fn(3, |i, j| f64::from(i == j)).unwrap();
    says(
        Hmm::new(at_0(), three, table.clone()),
        "the transition operator has 3 states, expected 2 to match the prior",
    );
    let error = Hmm::new(at_0(), Leaky, LikelihoodVector::linear(2)).err().unwrap();
    assert_eq!(
        error.to_string(),
        "the transition operator is not valid: column 1 (the transitions out of state 1) sums to 0.9, expected 1"
    );
    says(
        FusedLikelihood::new(table, LikelihoodVector::linear(2).owned()),
        "the second sensor has 2 states, expected 3 to match the first sensor",
    );
}

#[test]
fn operators_that_break_their_contract_give_errors_and_no_nan() {
    let error = Hmm::new(at_0(), Twisted, LikelihoodVector::linear(2)).err().unwrap();
    let text = error.to_string();
    assert!(text.ends_with("apply and apply_transpose differ"), "{text}");

    let hmm = Hmm::new(at_0(), Rate, LikelihoodVector::linear(2)).unwrap();
    let mut filter = hmm.filter();
    let before = filter.snapshot();
    let y = [0.5, 0.5];
    for rate in [2.0, -1.0, f64::NAN, f64::INFINITY] {
        for error in [
            filter.step_with(&rate, &y).unwrap_err(),
            filter.predict_with(&rate).unwrap_err(),
            filter.forecast_with(&[rate]).unwrap_err(),
            hmm.smooth(&Controlled::new(&[rate], &[y]).unwrap()).unwrap_err(),
        ] {
            assert!(matches!(error, HmmError::Predicted { step: 1, .. }), "{error}");
        }
        assert_eq!(filter.snapshot(), before);
    }
    says(
        filter.predict_with(&2.0),
        "at step 1 the transition operator predicts -1 for state 0, expected a probability",
    );
    // Its transposed product is wrong, which the smoother notices.
    let error = hmm.smooth(&Controlled::new(&[0.5, 0.5], &[y, y]).unwrap()).unwrap_err();
    assert!(matches!(error, HmmError::PredictedSum { .. }), "{error}");
}

#[test]
fn observations() {
    let hmm = Hmm::new(at_0(), still(2), LikelihoodVector::linear(2)).unwrap();
    let mut filter = hmm.filter();
    filter.step(&[0.5, 0.5]).unwrap();
    let before = filter.snapshot();
    for (y, problem) in [
        (&[0.5, f64::NAN][..], "state 1 has likelihood NaN, expected a finite value of at least 0"),
        (&[-0.5, 0.5], "state 0 has likelihood -0.5, expected a finite value of at least 0"),
        (
            &[f64::INFINITY, 0.5],
            "state 0 has likelihood inf, expected a finite value of at least 0",
        ),
        (&[0.5], "the likelihood has 1 values, expected one for each of 2 states"),
        (&[0.5; 3], "the likelihood has 3 values, expected one for each of 2 states"),
    ] {
        says(filter.step(y), &format!("step 2 has no valid likelihood: {problem}"));
        says(filter.update(y), &format!("step 1 has no valid likelihood: {problem}"));
        says(hmm.smooth(&[y]), &format!("step 1 has no valid likelihood: {problem}"));
        says(hmm.viterbi(&[y]), &format!("step 1 has no valid likelihood: {problem}"));
    }
    says(filter.step(&[0.0, 0.0]), "the observation of step 2 is impossible under the model");
    says(filter.step(&[0.0, 1.0]), "the observation of step 2 is impossible under the model");
    assert_eq!(filter.snapshot(), before, "an error leaves the filter as it was");

    let logs = Hmm::new(at_0(), still(2), LikelihoodVector::log(2)).unwrap();
    for (y, value) in [([f64::NAN, 0.0], "NaN"), ([f64::INFINITY, 0.0], "inf")] {
        let problem = format!(
            "step 1 has no valid likelihood: state 0 has log-likelihood {value}, expected a value from -1e300 to 1e300, or negative infinity"
        );
        says(logs.filter().step(&y), &problem);
        says(logs.viterbi(&[y]), &problem);
    }
    let nothing = [f64::NEG_INFINITY; 2];
    says(logs.filter().step(&nothing), "the observation of step 1 is impossible under the model");
    says(logs.viterbi(&[nothing]), "the observation of step 1 is impossible under the model");

    let table = TableLikelihood::from_rows(&[[0.5, 0.5]; 2]).unwrap();
    let table = Hmm::new(at_0(), still(2), table).unwrap();
    says(
        table.filter().step(&2),
        "step 1 has no valid likelihood: symbol 2 does not exist, the table has 2 symbols (0 to 1)",
    );

    let nan = LogLikelihoodFn::new(2, |(), i| if i == 0 { f64::NAN } else { 0.0 });
    let flat = LogLikelihoodFn::new(2, |(), _| 0.0);
    let fused = Hmm::new(at_0(), still(2), FusedLikelihood::new(flat, nan).unwrap()).unwrap();
    says(
        fused.filter().step(&((), ())),
        "step 1 has no valid likelihood: state 0 has log-likelihood NaN, expected a value from -1e300 to 1e300, or negative infinity",
    );
}

/// A user's sensor whose error has a source.
#[test]
fn the_text_ends_with_the_cause_and_the_source_is_what_is_behind_it() {
    #[derive(Debug)]
    struct Camera(std::io::Error);

    impl std::fmt::Display for Camera {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            write!(f, "no picture")
        }
    }

    impl Error for Camera {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            Some(&self.0)
        }
    }

    struct Broken;

    impl Likelihood for Broken {
        type Observation = ();

        fn states(&self) -> usize {
            2
        }

        fn diagonal<'a>(
            &'a self,
            (): &'a (),
            _: &'a mut Scratch,
        ) -> Result<Diagonal<'a>, LikelihoodError> {
            Err(LikelihoodError::sensor(Camera(std::io::Error::other("cable"))))
        }
    }

    let hmm = Hmm::new(at_0(), still(2), Broken).unwrap();
    let error = hmm.filter().step(&()).unwrap_err();
    let said = "step 1 has no valid likelihood: the sensor failed: no picture";
    assert_eq!(error.to_string(), said);
    assert_eq!(error.source().unwrap().to_string(), "cable");
    let error = hmm.smooth_all(&[[()]]).remove(0).unwrap_err();
    assert_eq!(error.to_string(), format!("sequence 0 failed: {said}"));
    assert_eq!(text::<()>(Err(error)), format!("sequence 0 failed: {said}: cable"));
}

#[test]
fn snapshots_of_another_model() {
    let two = Hmm::new(at_0(), still(2), LikelihoodVector::linear(2)).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(3).unwrap());
    let three = DenseTransition::from_fn(3, |i, j| f64::from(i == j)).unwrap();
    let three = Hmm::new(prior, three, LikelihoodVector::linear(3)).unwrap();
    says(
        two.filter().restore(&three.filter().snapshot()),
        "the snapshot has 3 states, expected 2 to match the model",
    );
}

#[test]
fn a_snapshot_in_logarithms_with_a_control_of_another_model() {
    let hmm = |operators| {
        let gears = SwitchedTransition::new(vec![still(2); operators]).unwrap();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(2).unwrap());
        Hmm::new(prior, gears, LikelihoodVector::log(2)).unwrap()
    };
    let (three, one) = (hmm(3), hmm(1));
    let mut source = three.fixed_lag(2);
    source.step_with(&2, &[0.0, -2000.0]).unwrap();
    source.step_with(&2, &[0.0, -2000.0]).unwrap();
    says(
        one.fixed_lag(2).restore(&source.snapshot()),
        "step 2 has no valid control: operator 2, expected one of 1 (0 to 0)",
    );
}

fn place(id: u64) -> Place {
    let position = Position { latitude: -35.28, longitude: 149.13 + id as f64 * 1e-3 };
    Place { id, position, name: String::new() }
}

fn road(from: u64, to: u64) -> Road {
    Road { from, to, class: RoadClass::Street, metres: 100.0 }
}

#[test]
fn maps_by_code() {
    says(RoadMap::<Position>::new([], []), "a map needs at least one place, found none");
    says(RoadMap::new([place(7), place(7)], []), "place 7 is given twice");
    says(
        RoadMap::new([place(1), place(2)], [road(1, 2), road(2, 1), road(1, 2)]),
        "the road from place 1 to place 2 is given twice (`RoadMap::cleaned` keeps the shorter one)",
    );
    says(
        RoadMap::new([place(1)], [road(1, 9)]),
        "the road from place 1 to place 9 needs place 9, which does not exist",
    );
    says(
        RoadMap::new([place(1)], [road(1, 1)]),
        "the road from place 1 leads to itself; stays are up to the turning rule",
    );
    says(
        RoadMap::new([place(1), place(2)], [Road { metres: 0.0, ..road(1, 2) }]),
        "the road from place 1 to place 2 has length 0, expected metres above 0",
    );
    let position = Position { latitude: 91.0, longitude: 0.0 };
    says(
        RoadMap::new([Place { position, ..place(3) }], []),
        "place 3 has latitude 91, expected degrees from -90 to 90",
    );
    let position = Position { latitude: 0.0, longitude: f64::NAN };
    says(
        RoadMap::new([Place { position, ..place(3) }], []),
        "place 3 has longitude NaN, expected degrees from -180 to 180",
    );
}

#[cfg(feature = "csv")]
#[test]
fn maps_from_files() {
    let places = "id,latitude,longitude,name\n1,-35.28,149.13,Civic\n2,-35.29,149.13,\n";
    let roads = "from,to,class,length_m\n1,2,main,1113\n2,1,street,1113\n";
    let read = |places: &str, roads: &str| {
        RoadMap::<Position>::from_csv(places.as_bytes(), roads.as_bytes())
    };

    let map = read(places, roads).unwrap();
    assert_eq!(map.places()[0].name, "Civic");
    assert_eq!(map.roads().len(), 2);

    let empty =
        "places, line 1: the file is empty, expected the header \"id,latitude,longitude,name\"";
    says(read("", roads), empty);
    says(
        read(places, ""),
        "roads, line 1: the file is empty, expected the header \"from,to,class,length_m\"",
    );
    says(
        read("id,lat,lon,name\n", roads),
        "places, line 1: header \"id,lat,lon,name\", expected \"id,latitude,longitude,name\"",
    );
    says(
        read("id,latitude,longitude,name\n", "from,to,class,length_m\n"),
        "a map needs at least one place, found none",
    );
    // Errors are short, however long the line.
    let long = "x".repeat(1_000_000);
    let header = format!("id{}\n", ",y".repeat(1_000_000));
    says(
        read(&header, roads),
        "places, line 1: header \"id,y,y,y,y\" and 999996 more, expected \"id,latitude,longitude,name\"",
    );
    for (places, roads) in [
        (long.clone(), roads.to_owned()),
        (format!("{places}{long},1,1,\n"), roads.to_owned()),
        (format!("{places}3,{long},1,\n"), roads.to_owned()),
        (places.to_owned(), format!("{roads}1,2,{long},5\n")),
        (places.to_owned(), format!("{roads}1,2,main,{long}\n")),
    ] {
        let text = text(read(&places, &roads));
        assert!(text.len() < 250 && text.contains("xxxx…"), "{text}");
    }
    for (line, problem) in [
        ("3,-35.3,149.1", "3 columns, expected 4 (id,latitude,longitude,name)"),
        ("3,-35.3,149.1,a,b", "5 columns, expected 4 (id,latitude,longitude,name)"),
        ("three,-35.3,149.1,", "id is \"three\", expected a whole number from 0"),
        ("-1,-35.3,149.1,", "id is \"-1\", expected a whole number from 0"),
        ("3,south,149.1,", "latitude is \"south\", expected a number"),
        ("3,NaN,149.1,", "place 3 has latitude NaN, expected degrees from -90 to 90"),
        ("1,-35.3,149.1,", "place 1 is given twice"),
    ] {
        says(read(&format!("{places}{line}\n"), roads), &format!("places, line 4: {problem}"));
    }
    for (line, problem) in [
        ("1,3,main,5", "the road from place 1 to place 3 needs place 3, which does not exist"),
        (
            "1,2,main,5",
            "the road from place 1 to place 2 is given twice (`RoadMap::cleaned` keeps the shorter one)",
        ),
        ("1,2,motorway,5", "class \"motorway\", expected main, arterial, collector or street"),
        ("2,2,main,5", "the road from place 2 leads to itself; stays are up to the turning rule"),
        ("1,2,main", "3 columns, expected 4 (from,to,class,length_m)"),
        ("1,2,main,-5", "the road from place 1 to place 2 has length -5, expected metres above 0"),
        ("1,2,main,far", "length_m is \"far\", expected a number"),
    ] {
        says(read(places, &format!("{roads}{line}\n")), &format!("roads, line 4: {problem}"));
    }
    let missing =
        RoadMap::<Position>::from_csv_files("no/such/places.csv", "no/such/roads.csv").unwrap_err();
    assert!(missing.to_string().starts_with("cannot read no/such/places.csv: "), "{missing}");
}

#[test]
fn turning_and_sensors() {
    let map = RoadMap::new([place(1), place(2), place(3)], [road(1, 2), road(2, 1)]).unwrap();
    let turning =
        |entries: &[(usize, usize, f64)]| TurningProbabilities::new(&map, entries.iter().copied());
    says(
        turning(&[(0, 1, 0.5), (0, 0, 0.4), (1, 0, 1.0), (2, 2, 1.0)]),
        "the turning probabilities of place 1 sum to 0.9, expected 1",
    );
    says(
        turning(&[(0, 2, 1.0), (1, 0, 1.0), (2, 2, 1.0)]),
        "no road leads from place 1 to place 3, but its turning probability is 1",
    );
    says(
        turning(&[(0, 1, f64::NAN), (1, 0, 1.0), (2, 2, 1.0)]),
        "the transition from state 0 to state 1 has probability NaN, expected a finite value of at least 0",
    );
    says(
        turning(&[(0, 3, 1.0), (1, 0, 1.0), (2, 2, 1.0)]),
        "the transition from state 0 to state 3 is out of range, there are 3 states (0 to 2)",
    );
    let rule = TurningRule { straight_on: 0.0, ..TurningRule::default() };
    says(
        TurningProbabilities::by_rule(&map, &rule),
        "the straight-on factor is 0, expected a finite value above 0",
    );
    let stop = ByClass { main: 0.0, arterial: 0.0, collector: 0.0, street: 1.0 };
    says(
        TurningProbabilities::by_rule(&map, &TurningRule { stop, ..TurningRule::default() }),
        "the probability of stopping for class street is 1, expected at least 0 and below 1",
    );

    says(
        Confusion::new(&map, 1.5),
        "the mean probability of a correct observation is 1.5, expected above 0 and at most 1",
    );
    let alone = RoadMap::new([place(1)], []).unwrap();
    says(
        Confusion::new(&alone, 0.7),
        "the mean probability of a correct observation is 0.7, expected 1, as no place has a neighbour",
    );
    let star = RoadMap::new((1..=6).map(place), (2..=6).map(|to| road(1, to))).unwrap();
    says(
        Confusion::new(&star, 0.5),
        "the probability of a correct observation of place 1, which has 5 neighbours, is -0.5, expected a value above 0",
    );
    let entries = |entries: &[_]| Confusion::from_entries(2, entries.iter().copied());
    let weights = |weights: &[_]| Confusion::from_weights(2, weights.iter().copied());
    says(
        entries(&[(0, 0, 0.5), (0, 1, 0.4), (1, 1, 1.0)]),
        "the sum of the symbol probabilities of state 0 is 0.9, expected 1",
    );
    says(
        entries(&[(0, 1, 1.0)]),
        "the sum of the symbol probabilities of state 1 is 0, expected 1",
    );
    // Likelihoods need not sum to one, and a sum of one is not a hint.
    says(
        entries(&[(0, 0, 0.5), (1, 0, 0.5), (0, 1, 0.25), (1, 1, 0.75)]),
        "the sum of the symbol probabilities of state 0 is 0.75, expected 1",
    );
    for (bad, found) in [(-0.5, "-0.5"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        let expected = "expected a finite value of at least 0";
        says(
            entries(&[(0, 0, 1.0), (0, 1, bad), (1, 1, 1.0)]),
            &format!("the probability of symbol 1 in state 0 is {found}, {expected}"),
        );
        says(
            weights(&[(0, 0, 1.0), (0, 1, bad), (1, 1, 1.0)]),
            &format!("the weight of place 0 seen as 1 is {found}, {expected}"),
        );
    }
    let out = "a place that place 0 is seen as is 2, expected 0 to 1";
    says(entries(&[(0, 2, 1.0), (1, 1, 1.0)]), out);
    says(weights(&[(0, 2, 1.0), (1, 1, 1.0)]), out);
    says(
        entries(&[(0, 1, 0.5), (0, 1, 0.5), (1, 1, 1.0)]),
        "the number of entries of place 0 seen as 1 is 2, expected 1",
    );
    says(
        weights(&[(0, 0, 2.0), (1, 0, 0.0)]),
        "the sum of the weights of place 1 is 0, expected a value above 0",
    );
    let none = "the number of places is 0, expected at least 1";
    says(Confusion::from_entries(0, []), none);
    says(Confusion::from_weights(0, []), none);
    let confusion = Confusion::new(&map, 0.9).unwrap();
    says(
        confusion.with_gaussian(&map, Metric::Hops, -1.0),
        "sigma is -1, expected a finite value above 0",
    );
    says(
        confusion.with_gaussian(&star, Metric::Hops, 1.0),
        "the number of places of the map is 6, expected 3",
    );
}

#[test]
fn evaluation() {
    says(evaluate::accuracy(&[1, 2], &[1]), "the number of estimates or controls is 1, expected 2");
    says(evaluate::accuracy(&[], &[]), "the number of states is 0, expected at least 1");
    says(evaluate::illegal_moves(&still(2), &[0, 2]), "state 1 of the path is 2, expected 0 to 1");
}
