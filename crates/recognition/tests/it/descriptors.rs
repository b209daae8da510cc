//! Distances of descriptors: against brute force in doubles, at the limits of 32 bits, one query at
//! a time and many, and refused inputs.

use proptest::prelude::*;
use wayfix_recognition::observation::{Distance, ReferenceDescriptors, ViewError};

use crate::kit::{cases_of, noise};

/// Half a unit in the last place of a number near 1.
const U: f64 = 1.0 / (1 << 24) as f64;

fn euclidean(x: &[f32], r: &[f32]) -> f64 {
    let squares = x.iter().zip(r).map(|(&x, &r)| (f64::from(x) - f64::from(r)).powi(2));
    squares.sum::<f64>().sqrt()
}

fn cosine(x: &[f32], r: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
    };
    1.0 - dot(x, r) / (dot(x, x) * dot(r, r)).sqrt()
}

/// Checks that a distance is as near to the true one as documented.
#[track_caller]
fn check(distance: Distance, x: &[f32], r: &[f32], found: f32) {
    let d = x.len() as f64;
    let (expected, allowed) = match distance {
        // Numbers below the smallest normal one have fewer digits.
        Distance::Euclidean => {
            let expected = euclidean(x, r);
            (expected, (20.0 + d / 64.0) * U * expected + f64::from(f32::from_bits(1)))
        }
        Distance::Cosine => {
            let expected = cosine(x, r);
            // The reference is scaled, too, so the scale cancels.
            let reference = 1e-15 * (8.0 + d);
            let c = expected.max(0.0);
            let allowed = 2.0 * U * (2.0 * c).sqrt() + (36.0 + d / 32.0) * U * c + 4.0 * U * U;
            (expected, allowed + reference)
        }
    };
    assert!(found >= 0.0 && found.is_finite(), "{found}");
    let error = (f64::from(found) - expected).abs();
    assert!(error <= allowed, "{distance:?}: {found} for {expected}, off by {error} > {allowed}");
}

/// References and queries of one dimension, none of them 0 everywhere; some
/// elements are 0 and some are large.
fn instance() -> impl Strategy<Value = (Vec<Vec<f32>>, Vec<Vec<f32>>)> {
    let sizes = (1_usize..150, 2_usize..80, 0_usize..40);
    (sizes, any::<u32>()).prop_map(|((d, n, q), seed)| {
        let mut values = noise((n + q) * d, seed);
        for x in &mut values {
            *x *= [0.0, 1e3, 1.0, 1.0, 1.0][(x.to_bits() >> 5) as usize % 5];
        }
        for row in values.chunks_exact_mut(d) {
            row[0] = if row.iter().all(|x| *x == 0.0) { 1.0 } else { row[0] };
        }
        let mut rows: Vec<Vec<f32>> = values.chunks_exact(d).map(<[f32]>::to_vec).collect();
        let queries = rows.split_off(n);
        (rows, queries)
    })
}

/// `None` if all are equal, since one dimension has only two directions.
fn references(rows: &[Vec<f32>], distance: Distance) -> Option<ReferenceDescriptors> {
    match ReferenceDescriptors::from_rows(rows, distance) {
        Err(ViewError::AllEqual { .. }) => None,
        references => Some(references.unwrap()),
    }
}

fn either() -> impl Strategy<Value = Distance> {
    prop_oneof![Just(Distance::Cosine), Just(Distance::Euclidean)]
}

proptest! {
    #![proptest_config(cases_of(500))]

    #[test]
    fn distances_are_those_of_brute_force(
        (rows, queries) in instance(),
        distance in either(),
        power in -30_i32..30,
    ) {
        let scale = 2.0_f32.powi(power);
        let scaled = |rows: &[Vec<f32>]| -> Vec<Vec<f32>> {
            rows.iter().map(|row| row.iter().map(|x| x * scale).collect()).collect()
        };
        let (rows, queries) = (scaled(&rows), scaled(&queries));
        let Some(references) = references(&rows, distance) else { return Ok(()) };
        prop_assert_eq!(references.count(), rows.len());
        prop_assert_eq!(references.dimension(), rows[0].len());
        prop_assert_eq!(references.distance(), distance);
        for query in &queries {
            let found = references.distances(query).unwrap();
            prop_assert_eq!(found.len(), rows.len());
            rows.iter().zip(found).for_each(|(row, found)| check(distance, query, row, found));
        }
    }

    #[test]
    fn many_queries_are_single_ones_to_the_bit(
        (rows, queries) in instance(),
        distance in either(),
    ) {
        let Some(references) = references(&rows, distance) else { return Ok(()) };
        let bits = |row: &[f32]| row.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let single: Vec<_> =
            queries.iter().map(|query| bits(&references.distances(query).unwrap())).collect();
        let together = queries.concat();
        let mut out = vec![f32::NAN; queries.len() * rows.len()];
        references.distances_all_into(&together, &mut out).unwrap();
        prop_assert_eq!(bits(&out), single.concat());
        let mut visited = vec![];
        references.distances_each(&together, |query, row| visited.push((query, bits(row)))).unwrap();
        prop_assert_eq!(visited, single.into_iter().enumerate().collect::<Vec<_>>());
    }

    #[test]
    fn a_distance_does_not_depend_on_the_other_references(
        (rows, queries) in instance(),
        distance in either(),
    ) {
        let mut turned = rows.clone();
        turned.rotate_left(1);
        let Some(references) = references(&rows, distance) else { return Ok(()) };
        let other = ReferenceDescriptors::from_rows(&turned, distance).unwrap();
        for query in &queries {
            let mut found = references.distances(query).unwrap();
            found.rotate_left(1);
            prop_assert_eq!(found, other.distances(query).unwrap());
        }
    }

    #[test]
    fn a_copy_has_distance_0_and_a_multiple_no_angle(
        (rows, _) in instance(),
        factor in 0.01_f32..100.0,
    ) {
        for distance in [Distance::Cosine, Distance::Euclidean] {
            let Some(references) = references(&rows, distance) else { continue };
            for (i, row) in rows.iter().enumerate() {
                prop_assert_eq!(references.distances(row).unwrap()[i], 0.0);
                if distance == Distance::Cosine {
                    let multiple: Vec<f32> = row.iter().map(|x| factor * x).collect();
                    let found = references.distances(&multiple).unwrap()[i];
                    prop_assert!(found < 3e-14, "{} times reference {}: {}", factor, i, found);
                }
            }
        }
    }

    #[test]
    fn an_element_that_is_not_finite_is_found(
        (mut rows, mut queries) in instance(),
        distance in either(),
        at in any::<prop::sample::Index>(),
        element in any::<prop::sample::Index>(),
        bad in prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY)],
    ) {
        let k = element.index(rows[0].len());
        if let (Some(references), false) = (references(&rows, distance), queries.is_empty()) {
            let i = at.index(queries.len());
            queries[i][k] = bad;
            let text = format!("element {k} of query {i} is {bad}, expected a finite value");
            let mut out = vec![0.0; queries.len() * rows.len()];
            let error = references.distances_all_into(&queries.concat(), &mut out).unwrap_err();
            prop_assert_eq!(error.to_string(), text.as_str());
            let mut visited = vec![];
            let visit = |query, _: &[f32]| visited.push(query);
            let error = references.distances_each(&queries.concat(), visit).unwrap_err();
            prop_assert_eq!(error.to_string(), text);
            prop_assert!(visited.iter().copied().eq(0..visited.len()) && visited.len() <= i);
            let error = references.distances(&queries[i]).unwrap_err();
            let text = format!("element {k} of query 0 is {bad}, expected a finite value");
            prop_assert_eq!(error.to_string(), text);
        }
        let i = at.index(rows.len());
        rows[i][k] = bad;
        let error = ReferenceDescriptors::from_rows(&rows, distance).unwrap_err();
        let text = format!("element {k} of reference {i} is {bad}, expected a finite value");
        prop_assert_eq!(error.to_string(), text);
    }
}

#[test]
fn long_descriptors_keep_their_digits() {
    let d = 4096;
    let rows: Vec<Vec<f32>> = (1..5).map(|seed| noise(d, seed)).collect();
    // The first row with every seventh element changed, down to what 32 bits barely tell.
    let near = |step: f32| {
        let mut near = rows[0].clone();
        near.iter_mut().step_by(7).for_each(|x| *x *= 1.0 + step);
        near
    };
    for distance in [Distance::Cosine, Distance::Euclidean] {
        let references = ReferenceDescriptors::from_rows(&rows, distance).unwrap();
        for query in [noise(d, 9), near(1e-6), near(1e-3), near(0.5), near(-1.5)] {
            let found = references.distances(&query).unwrap();
            rows.iter().zip(found).for_each(|(row, found)| check(distance, &query, row, found));
        }
    }
}

#[test]
fn euclidean_distances_are_right_wherever_32_bits_hold_them() {
    let (x, r) = (noise(70, 1), noise(70, 2));
    let mut seen = [0, 0];
    for power in -160..=127 {
        // In two steps: 2^-160 is 0 in 32 bits.
        let scale = 2.0_f64.powi(power);
        let scaled = |x: &[f32]| x.iter().map(|&x| (f64::from(x) * scale) as f32).collect();
        let (x, r): (Vec<f32>, Vec<f32>) = (scaled(&x), scaled(&r));
        let far = vec![1.0; 70];
        let rows = [far.as_slice(), &r, &x];
        let references = ReferenceDescriptors::from_rows(&rows, Distance::Euclidean).unwrap();
        let true_distance = euclidean(&x, &r);
        match references.distances(&x) {
            Ok(found) => {
                rows.iter().zip(&found).for_each(|(r, &found)| {
                    check(Distance::Euclidean, &x, r, found);
                });
                assert_eq!(found[2], 0.0);
                seen[0] += 1;
            }
            Err(ViewError::TooFar { query, reference, distance }) => {
                assert!((query, reference) == (0, 0) || (query, reference) == (0, 1));
                let expected = if reference == 0 { euclidean(&x, &far) } else { true_distance };
                assert!((distance / expected - 1.0).abs() < 1e-12 && distance > 3.4e38);
                seen[1] += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(seen[0] > 250 && seen[1] > 0, "{seen:?}");
}

#[test]
fn cosines_do_not_depend_on_the_size_of_descriptors() {
    let (x, r) = (noise(70, 1), noise(70, 2));
    let plain = ReferenceDescriptors::from_rows(&[&r, &x], Distance::Cosine).unwrap();
    let expected = plain.distances(&x).unwrap();
    assert!(expected[0] > 0.5 && expected[1] == 0.0);
    // As long as every element is normal, to the bit.
    for power in (-100..=126).step_by(2) {
        let scaled =
            |x: &[f32]| -> Vec<f32> { x.iter().map(|x| x * 2.0_f32.powi(power)).collect() };
        let rows = [scaled(&r), scaled(&x)];
        let references = ReferenceDescriptors::from_rows(&rows, Distance::Cosine).unwrap();
        assert_eq!(references.distances(&x).unwrap(), expected, "2^{power}");
        assert_eq!(plain.distances(&scaled(&x)).unwrap(), expected, "2^{power}");
    }
    // The smallest numbers of 32 bits.
    let least = f32::from_bits(1);
    let rows = [[least, 0.0], [0.0, f32::MAX], [-least, -least]];
    let references = ReferenceDescriptors::from_rows(&rows, Distance::Cosine).unwrap();
    let found = references.distances(&[f32::MAX, 0.0]).unwrap();
    assert_eq!(found[..2], [0.0, 1.0]);
    check(Distance::Cosine, &[1.0, 0.0], &[-1.0, -1.0], found[2]);
}

#[test]
fn distances_are_the_same_to_the_bit_with_all_features_on_all_machines() {
    for (distance, expected) in
        [(Distance::Cosine, 0x0a0f_d2ea), (Distance::Euclidean, 0xd1d2_154e)]
    {
        let references = ReferenceDescriptors::new(77, noise(77 * 50, 1), distance).unwrap();
        let found = references.distances(&noise(77, 2)).unwrap();
        let mixed = found.iter().fold(0_u32, |mixed, x| mixed.rotate_left(5) ^ x.to_bits());
        assert_eq!(mixed, expected, "{distance:?}");
    }
}

#[test]
fn one_reference_is_enough_and_ties_are_equal() {
    let one = ReferenceDescriptors::new(2, vec![3.0, 4.0], Distance::Euclidean).unwrap();
    assert_eq!((one.count(), one.dimension()), (1, 2));
    assert_eq!(one.distances(&[0.0, 0.0]).unwrap(), [5.0]);
    assert_eq!(one.distances(&[3.0, 4.0]).unwrap(), [0.0]);
    let ties: Vec<[f32; 1]> = (0..70_u8).map(|i| [f32::from(i % 2)]).collect();
    let references = ReferenceDescriptors::from_rows(&ties, Distance::Euclidean).unwrap();
    let found = references.distances(&[3.0]).unwrap();
    assert!(found.iter().enumerate().all(|(i, &found)| found == [3.0, 2.0][i % 2]));
    references.distances_all_into(&[], &mut []).unwrap();
    references.distances_each(&[], |_, _| panic!("there is no query")).unwrap();
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let text = |rows: &[&[f32]], distance| {
        ReferenceDescriptors::from_rows(rows, distance).unwrap_err().to_string()
    };
    let (cosine, euclidean) = (Distance::Cosine, Distance::Euclidean);
    assert_eq!(text(&[], cosine), "there are no references, expected at least one");
    assert_eq!(text(&[&[]], cosine), "descriptors have dimension 0, expected at least 1");
    assert_eq!(text(&[&[], &[1.0]], cosine), "descriptors have dimension 0, expected at least 1");
    assert_eq!(text(&[&[1.0, 2.0], &[1.0]], euclidean), "reference 1 has 1 elements, expected 2");
    assert_eq!(
        text(&[&[1.0, 2.0], &[0.0, -0.0]], cosine),
        "reference 1 is 0 in every element, so it has no cosine with another"
    );
    assert_eq!(
        text(&[&[1.0, 2.0], &[2.0, 4.0], &[3.0, 6.0]], cosine),
        "all 3 references are equal, so they cannot tell places apart"
    );
    assert_eq!(
        text(&[&[0.0, 2.0], &[-0.0, 2.0]], euclidean),
        "all 2 references are equal, so they cannot tell places apart"
    );
    let new = |dimension, values: &[f32]| {
        ReferenceDescriptors::new(dimension, values.to_vec(), euclidean).unwrap_err().to_string()
    };
    assert_eq!(new(0, &[1.0]), "descriptors have dimension 0, expected at least 1");
    assert_eq!(new(2, &[]), "there are no references, expected at least one");
    assert_eq!(
        new(2, &[1.0, 2.0, 3.0]),
        "3 values do not make a whole number of descriptors of dimension 2"
    );

    let rows = [[1.0, 0.0], [f32::MAX, 0.0]];
    let references = ReferenceDescriptors::from_rows(&rows, euclidean).unwrap();
    let text = |result: Result<(), ViewError>| result.unwrap_err().to_string();
    let mut out = [0.0; 4];
    assert_eq!(
        text(references.distances_into(&[1.0], &mut out[..2])),
        "query 0 has 1 elements, expected 2"
    );
    assert_eq!(
        text(references.distances_into(&[1.0; 4], &mut out)),
        "query 0 has 4 elements, expected 2"
    );
    assert_eq!(
        text(references.distances_into(&[1.0, 2.0], &mut out)),
        "there is room for 4 distances, expected 2"
    );
    assert_eq!(
        text(references.distances_all_into(&[1.0; 3], &mut out)),
        "3 values do not make a whole number of descriptors of dimension 2"
    );
    assert_eq!(
        text(references.distances_each(&[1.0; 3], |_, _| {})),
        "3 values do not make a whole number of descriptors of dimension 2"
    );
    assert_eq!(references.distances(&[0.0, 0.0]).unwrap(), [1.0, f32::MAX]);
    // Beyond the first block of queries and of references.
    let mut rows = vec![[1.0, 0.0]; 50];
    rows[40] = [f32::MAX, 0.0];
    let references = ReferenceDescriptors::from_rows(&rows, euclidean).unwrap();
    let mut queries = vec![0.0; 2 * 20];
    queries[2 * 18] = f32::MIN;
    assert_eq!(
        text(references.distances_all_into(&queries, &mut [0.0; 20 * 50])),
        "the distance of query 18 to reference 40 is 6.805646932770577e38, \
         expected at most 3.4028235e38"
    );
    let rows = [[1.0, 0.0], [0.0, 1.0]];
    let references = ReferenceDescriptors::from_rows(&rows, cosine).unwrap();
    assert_eq!(
        text(references.distances_all_into(&[1.0, 1.0, 0.0, 0.0], &mut out)),
        "query 1 is 0 in every element, so it has no cosine with another"
    );
}
