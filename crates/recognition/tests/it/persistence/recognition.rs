//! Fits of recognisers and states of tracks, stored and restored.

use crate::kit::{damage, json, refuses, stored};
use std::sync::LazyLock;

use proptest::prelude::*;
use wayfix::error::OutOfRange;
use wayfix_recognition::motion::{OdometryModel, OffMap, Speeds};
use wayfix_recognition::observation::{Distance, MatchOdds, Standardizer};
use wayfix_recognition::{
    Answer, LabelledPart, Mapper, Options, Parameters, RecognitionError, Recognizer, Track,
    TrackSnapshot,
};

use crate::kit::{cases_of, noise, text};

const PLACES: usize = 30;
const DIMENSION: usize = 12;

/// References, and queries along them with noise, a stop, and a detour.
fn made_up() -> (Vec<Vec<f32>>, Vec<Vec<f32>>) {
    let rows = |count: usize, seed| -> Vec<Vec<f32>> {
        noise(DIMENSION * count, seed).chunks(DIMENSION).map(<[f32]>::to_vec).collect()
    };
    let (references, elsewhere) = (rows(PLACES, 1), rows(10, 3));
    let places = (2..12).chain([12; 6]).chain(12..28).map(Some).chain([None; 8]);
    let queries = places.chain((20..29).map(Some)).zip(rows(60, 2)).enumerate();
    let queries = queries.map(|(k, (place, noise))| {
        let seen = place.map_or(&elsewhere[k % 10], |place| &references[place]);
        let still = place == Some(12);
        seen.iter().zip(noise).map(|(x, e)| x + if still { 0.0 } else { 0.6 * e }).collect()
    });
    (references.clone(), queries.collect())
}

fn options() -> Options {
    Options::default().with_off_map(Some(OffMap::default()))
}

fn fitted() -> &'static (Recognizer, Vec<Vec<f32>>) {
    static FITTED: LazyLock<(Recognizer, Vec<Vec<f32>>)> = LazyLock::new(fit);
    &FITTED
}

fn fit() -> (Recognizer, Vec<Vec<f32>>) {
    let (references, queries) = made_up();
    let recognizer = Recognizer::from_descriptors(&references, Distance::Cosine, options());
    let places: Vec<_> =
        (2..12).chain([12; 6]).chain(12..28).map(|place| Some(place..=place)).collect();
    let odometry: Vec<_> =
        (0..32).map(|k| Some(if (10..16).contains(&k) { 0.0 } else { 1.0 })).collect();
    let part = LabelledPart { queries: &queries[..32], places: &places, odometry: &odometry };
    (recognizer.unwrap().fit(&[part]).unwrap(), queries)
}

fn answers(track: &mut Track, queries: &[Vec<f32>]) -> Vec<Answer> {
    queries.iter().map(|query| track.step(query).unwrap()).collect()
}

#[test]
fn a_fit_comes_back_to_the_bit() {
    let (recognizer, queries) = fitted();
    let fit = recognizer.parameters();
    let back = stored(fit);
    assert_eq!(&back, fit);
    assert!(back.warnings().is_empty());
    let (references, _) = made_up();
    let fresh = Recognizer::from_descriptors(&references, Distance::Cosine, Options::default());
    let again = fresh.unwrap().with_parameters(back).unwrap();
    assert_eq!(answers(&mut again.track(), queries), answers(&mut recognizer.track(), queries));
    assert_eq!(stored(&Options::default()), Options::default());
    assert_eq!(stored(&MatchOdds::default()), MatchOdds::default());
}

#[test]
fn a_live_position_survives_a_restart() {
    let (recognizer, queries) = fitted();
    for stop in [0, 1, 2, 13, 33, queries.len()] {
        let mut track = recognizer.track();
        answers(&mut track, &queries[..stop]);
        let (fit, state) = (json(recognizer.parameters()), json(&track.snapshot()));
        let before = answers(&mut track, &queries[stop..]);

        let (references, _) = made_up();
        let fresh = Recognizer::from_descriptors(&references, Distance::Cosine, Options::default());
        let fit: Parameters = serde_json::from_str(&fit).unwrap();
        let again = fresh.unwrap().with_parameters(fit).unwrap();
        let mut next = again.track();
        let state: TrackSnapshot = serde_json::from_str(&state).unwrap();
        assert_eq!((state.steps(), state.references()), (stop, PLACES));
        assert_eq!(json(&state), json(&stored(&state)));
        next.restore(&state).unwrap();
        assert_eq!(next.snapshot(), state);
        assert_eq!(answers(&mut next, &queries[stop..]), before, "stopped after {stop}");
        assert_eq!(next.places().as_slice(), track.places().as_slice());
        assert_eq!(next.log_likelihood().to_bits(), track.log_likelihood().to_bits());
    }
}

#[test]
fn infinite_distances_are_stored() {
    let recognizer = Recognizer::from_distances(3, options()).unwrap();
    let mut track = recognizer.track();
    for row in [[0.1, 0.5, f32::INFINITY], [f32::INFINITY; 3]] {
        track.step(&row).unwrap();
        let state = track.snapshot();
        assert_eq!(stored(&state), state);
        assert!(json(&state).contains("null"));
    }
}

#[test]
fn a_state_of_another_recogniser_is_refused() {
    let track = |references: usize, speeds: &[f64]| {
        let options = options().with_speeds(Speeds::new(speeds).unwrap());
        Recognizer::from_distances(references, options).unwrap().track()
    };
    let mut own = track(3, &[0.0, 1.0]);
    own.step(&[0.1, 0.5, 0.7]).unwrap();
    let before = own.snapshot();
    let error = own.restore(&track(4, &[0.0, 1.0]).snapshot()).unwrap_err();
    assert!(matches!(error, RecognitionError::Parameter(OutOfRange { value: 4.0, .. })), "{error}");
    let error = own.restore(&track(3, &[0.0, 1.0, 2.0]).snapshot()).unwrap_err();
    assert!(matches!(error, RecognitionError::Inference(_)), "{error}");
    let text = json(&before);
    let row = &text[text.find(r#""last_view":["#).unwrap()..];
    let row = &row[..=row.find(']').unwrap()];
    let short = text.replace(row, r#""last_view":[0.1,0.5]"#);
    let shorter: TrackSnapshot = serde_json::from_str(&short).unwrap();
    assert!(matches!(
        own.restore(&shorter),
        Err(RecognitionError::Parameter(OutOfRange { value: 2.0, .. }))
    ));
    assert_eq!(own.snapshot(), before);
}

#[test]
fn a_state_that_no_step_can_follow_is_refused() {
    for map_is_left in [false, true] {
        let off_map = map_is_left.then(OffMap::default);
        let options = options().with_off_map(off_map);
        let mut track = Recognizer::from_distances(3, options).unwrap().track();
        track.step(&[0.1, 0.5, 0.7]).unwrap();
        let before = track.snapshot();
        let changed = |change: &dyn Fn(&mut serde_json::Value)| -> TrackSnapshot {
            let mut value = serde_json::to_value(&before).unwrap();
            change(&mut value["filter"]);
            serde_json::from_value(value).unwrap()
        };
        let most = changed(&|filter| filter["steps"] = (1_u64 << 53).into());
        let error = track.restore(&most).unwrap_err();
        assert!(error.to_string().contains("the most that can be counted"), "{error}");
        let nowhere = changed(&|filter| {
            let belief = filter["belief"].as_array().map(Vec::len).unwrap();
            let off = |state: usize| if state < belief - 3 { 0.0 } else { 1.0 / 3.0 };
            filter["belief"] = (0..belief).map(off).collect::<Vec<f64>>().into();
        });
        let mut off = track.clone();
        off.restore(&nowhere).unwrap();
        // A vehicle that is surely lost may be anywhere.
        let each = if map_is_left { 0.0 } else { 1.0 / 3.0 };
        assert!(off.places().as_slice()[..3].iter().all(|p| (p - each).abs() < 1e-12));
        assert_eq!(off.step(&[0.5, 0.1, 0.7]).unwrap().place.is_none(), map_is_left);
        let mut last = track.clone();
        last.restore(&changed(&|filter| filter["steps"] = ((1_u64 << 53) - 1).into())).unwrap();
        last.step(&[0.1, 0.5, 0.7]).unwrap();
        let end = last.snapshot();
        assert!(last.step(&[0.9, 0.5, 0.7]).is_err() && last.predict().is_err());
        assert_eq!(last.snapshot(), end);
    }
}

/// Odds that rule out every place.
#[test]
fn answers_are_honest_where_doubles_end() {
    let fit = json(Recognizer::from_distances(PLACES, Options::default()).unwrap().parameters());
    let odds = &fit[fit.find(r#""odds":"#).unwrap()..];
    let odds = &odds[..=odds.find('}').unwrap()];
    let extreme = r#""odds":{"version":1,"shares":[1e-12,0.0,1.0]}"#;
    let mut fit = fit.replace(odds, extreme);
    let lost = &fit[fit.find(r#""lost":"#).unwrap()..];
    let lost = lost[..=lost.find('}').unwrap()].to_string();
    fit = fit.replace(&lost, r#""lost":{"leave":1e-7,"back":1e-7,"near":0.0,"within":0}"#);
    let fit: Parameters = serde_json::from_str(&fit).unwrap();
    let recognizer = Recognizer::from_distances(PLACES, Options::default()).unwrap();
    let recognizer = recognizer.with_parameters(fit).unwrap();
    let row =
        |k: usize| -> Vec<f32> { (0..PLACES).map(|i| 0.5 + 0.01 * ((i * k) % 7) as f32).collect() };
    let mut track = recognizer.track();
    for k in 1..20 {
        let answer = track.step(&row(k)).unwrap();
        assert!(answer.probability <= 0.5, "{answer:?}");
        let sum: f64 = track.places().as_slice().iter().sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    }
    let mut other = recognizer.track();
    other.restore(&track.snapshot()).unwrap();
    assert_eq!(other.step(&row(3)).unwrap(), track.step(&row(3)).unwrap());
}

#[test]
fn what_was_not_learned_is_refused() {
    let known =
        r#"{"version":1,"count":2.0,"sums":[0.5,-0.5],"squares":[1.0,2.0],"steps":[1.5,0.0]}"#;
    assert_eq!(json(&serde_json::from_str::<Standardizer>(known).unwrap()), known);
    let refused = |from: &str, to: &str, expected: &str| {
        refuses::<Standardizer>(&known.replace(from, to), expected);
    };
    refused("2.0,\"", "-1,\"", "the number of queries is -1, expected from 0 to 1e15");
    refused(
        "[0.5,-0.5]",
        "[0.5]",
        "the number of sums of squares is 2, expected as many as sums of scores",
    );
    refused(
        "[0.5,-0.5]",
        "[0.5,1e18]",
        &format!("a sum of scores is {}, expected from -1e17 to 1e17", 1e18),
    );
    refused("[1.0,2.0]", "[1.0,-2.0]", "a sum of squared scores is -2, expected from 0 to 1e35");
    let steps = "the number of sums of steps is 1, expected as many as sums of scores";
    refused("[1.5,0.0]", "[1.5]", steps);
    refused("[1.5,0.0]", "[-1.5,0.0]", "a sum of squared steps is -1.5, expected from 0 to 1e35");
    refused("[1.0,2.0]", "[1.0,null]", "invalid type: null, expected f64");
    let none = r#"{"version":1,"count":0,"sums":[],"squares":[],"steps":[]}"#;
    refuses::<Standardizer>(none, "the number of references is 0, expected at least 1");

    let odds = json(&MatchOdds::default());
    let refused = |to: &str, expected: &str| {
        refuses::<MatchOdds>(&odds.replace("[0.1,0.45,0.45]", to), expected);
    };
    refused("[0.1,0.45,0.5]", "the sum of the shares of views is 1.05, expected 1");
    refused("[0.1,0.9]", "invalid length 2, expected an array of length 3");

    let fit = json(fitted().0.parameters());
    let refused = |from: &str, to: &str, expected: &str| {
        assert!(fit.contains(from));
        refuses::<Parameters>(&fit.replacen(from, to, 1), expected);
    };
    refused(r#""version":1"#, r#""version":2"#, "version 2, expected 1");
    refused(
        r#""view_fades":0.1"#,
        r#""view_fades":-1"#,
        "view_fades is -1, expected from 0 to 1e6",
    );

    let mut track = fitted().0.track();
    answers(&mut track, &fitted().1[..3]);
    let state = json(&track.snapshot());
    let run = &state[state.find(r#""run":"#).unwrap()..];
    let run = &run[..=run.find(']').unwrap()];
    refuses::<TrackSnapshot>(
        &state.replace(run, r#""run":["changed",0]"#),
        "a run of 0 views, expected at least 1",
    );

    let part = |name: &str, end: char| {
        let part = &state[state.find(&format!(r#""{name}":"#)).unwrap()..];
        &part[..part.find(end).unwrap()]
    };
    let refused = |from: &str, to: &str, expected: &str| {
        refuses::<TrackSnapshot>(&state.replacen(from, to, 1), expected);
    };
    let range = "an unchanged view by up to -1, expected from 0 to 2";
    refused(part("still", ','), r#""still":-1"#, range);
    refused(
        part("kinds", ']'),
        r#""kinds":[[0,1,1"#,
        "[0.0, 1.0, 1.0] views of each kind, expected counts, the first above 0",
    );

    // Rates are checked when a recogniser is made.
    let fit: Parameters =
        serde_json::from_str(&fit.replacen(r#""leave":0.0001"#, r#""leave":0"#, 1).replacen(
            r#""leave":0.001"#,
            r#""leave":0"#,
            1,
        ))
        .unwrap();
    let message =
        text(Recognizer::from_distances(PLACES, Options::default()).unwrap().with_parameters(fit));
    assert_eq!(
        message,
        "the model of motion is not valid: the probability of leaving the map is 0, expected from 1e-30 to 1"
    );
    let wrong = OdometryModel { scale: 0.0, ..OdometryModel::default() };
    assert_eq!(stored(&wrong), wrong);
}

proptest! {
    #![proptest_config(cases_of(400))]

    /// Any change to a file gives an error or a track that continues.
    #[test]
    fn damaged_fits_and_states_are_refused_or_valid(damage in damage(), stop in 0..40_usize) {
        let (recognizer, queries) = fitted();
        let mut track = recognizer.track();
        answers(&mut track, &queries[..stop]);
        if let Ok(state) = serde_json::from_str::<TrackSnapshot>(&damage.of(&json(&track.snapshot()))) {
            let mut other = recognizer.track();
            if other.restore(&state).is_ok() {
                for query in &queries[stop..] {
                    if let Ok(answer) = other.step_with(1.0, query) {
                        prop_assert!((0.0..=1.0).contains(&answer.probability));
                        prop_assert!((0.0..=1.0).contains(&answer.off_map));
                    }
                }
            }
        }
        if let Ok(fit) = serde_json::from_str::<Parameters>(&damage.of(&json(recognizer.parameters())))
            && let Ok(other) = recognizer.with_parameters(fit)
        {
            let mut track = other.track();
            for query in queries {
                if let Ok(answer) = track.step_with(1.0, query) {
                    prop_assert!((0.0..=1.0).contains(&answer.probability));
                }
            }
        }
    }
}

/// A loop of 70 places, driven one time and a half with a stop, and the mapper at each step.
fn mapped(steps: usize) -> (Mapper, Vec<Vec<f32>>) {
    let images: Vec<Vec<f32>> =
        noise(DIMENSION * 70, 5).chunks(DIMENSION).map(<[f32]>::to_vec).collect();
    let views: Vec<Vec<f32>> =
        (0..70).chain([69; 3]).chain(0..40).map(|place| images[place % 70].clone()).collect();
    let mut mapper = Mapper::new(Distance::Cosine, Options::default()).unwrap().with_gap(20);
    views[..steps].iter().for_each(|view| _ = mapper.step_with(1.0, view).unwrap());
    (mapper, views)
}

#[test]
fn a_stored_mapper_goes_on_as_it_would_have() {
    let mut closed = 0;
    for at in [0, 1, 30, 69, 75, 95] {
        let (mut mapper, views) = mapped(at);
        let mut back = stored(&mapper);
        for view in &views[at..] {
            let answer = mapper.step(view).unwrap();
            assert_eq!(back.step(view).unwrap(), answer, "{at}");
            closed += u32::from(answer.is_some());
        }
        assert_eq!(back.references(), mapper.references());
        assert_eq!(json(&back), json(&mapper));
    }
    assert!(closed > 60, "{closed}");
}

#[test]
fn a_damaged_mapper_is_refused() {
    let text = json(&mapped(69).0);
    let refused = |from: &str, to: &str, expected: &str| {
        assert!(text.contains(from), "{from}");
        refuses::<Mapper>(&text.replacen(from, to, 1), expected);
    };
    let fields = "`version`, `distance`, `options`, `gap`, `references`, `added`, `steps`, \
        `usual_change`, `driven`, `track`, `recent`, `run`";
    let unknown = format!("unknown field `x`, expected one of {fields}");
    refused(r#""gap":20"#, r#""gap":20,"x":0"#, &unknown);
    let list =
        |until: usize| (2..=until).fold(String::new(), |list, k| list + ", " + &k.to_string());
    let twice = format!("references added at [2{}] of 69 steps, of 69", list(69));
    refused(r#""added":[1,"#, r#""added":[2,"#, &twice);
    let rest = list(68);
    let late = format!("references added at [1{rest}, 70] of 69 steps, of 69");
    refused(r#",69],"steps":69"#, r#",70],"steps":69"#, &late);
    let most = "18446744073709551615 steps and 32 recent views, expected at most 32";
    refused(r#"],"steps":69"#, r#"],"steps":18446744073709551615"#, most);
    let run = &text[text.rfind(r#""run":"#).unwrap()..];
    refused(
        run,
        r#""run":{"first":0,"last":1000,"now":5}}"#,
        "a place beyond 69 references, 48 of them tracked",
    );
    refused(
        run,
        r#""run":{"first":6,"last":9,"now":5}}"#,
        "Run { first: 6, last: 9, now: 5 }, expected `now` from `first` to `last`",
    );
}

proptest! {
    #![proptest_config(cases_of(200))]

    /// What is read goes on without a panic, whatever was damaged.
    #[test]
    fn a_damaged_mapper_never_panics(damage in damage()) {
        static STORED: LazyLock<(String, Vec<Vec<f32>>)> = LazyLock::new(|| {
            let (mapper, views) = mapped(90);
            (json(&mapper), views)
        });
        let (text, views) = &*STORED;
        if let Ok(mut mapper) = serde_json::from_str::<Mapper>(&damage.of(text)) {
            for view in &views[90..] {
                _ = mapper.step(view);
            }
        }
    }
}
