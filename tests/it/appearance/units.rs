//! Units of distance from rows.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::observation::{AppearanceLikelihood, ObservationError, Spread};

use super::definition::*;

use crate::kit::cases;

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn a_unit_is_the_median_range_of_rows(
        rows in (1..130_usize).prop_flat_map(|n| vec((row(n), prop_oneof![Just(n), Just(41), Just(81)]), 1..6)),
    ) {
        // Rows as they are, and of 41 or 81, where quantiles are values.
        let rows: Vec<Vec<f32>> = rows
            .into_iter()
            .map(|(row, n)| row.iter().copied().cycle().take(n).collect())
            .collect();
        let ranges = |outer: bool| {
            let range = |row: &Vec<f32>| {
                let mut finite: Vec<f64> = row.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d)).collect();
                finite.sort_by(f64::total_cmp);
                let last = (finite.len() - 1) as f64;
                let (low, high) = (0.025 * last, 0.975 * last);
                let whole = |x: f64| if (x - x.round()).abs() < 1e-9 { x.round() } else { x };
                let (low, high) = (whole(low), whole(high));
                if outer {
                    finite[high.ceil() as usize] - finite[low.floor() as usize]
                } else {
                    finite[high.floor() as usize] - finite[low.ceil() as usize]
                }
            };
            let mut ranges: Vec<f64> = rows.iter().map(range).collect();
            ranges.sort_by(f64::total_cmp);
            (ranges[(ranges.len() - 1) / 2], ranges[ranges.len() / 2])
        };
        let (least, most) = (ranges(false).0 / 5_f64.ln(), ranges(true).1 / 5_f64.ln());
        match Spread::of(&rows) {
            Ok(Spread::Fixed(unit)) => {
                prop_assert!(unit > 0.0 && unit.is_finite());
                prop_assert!((least * (1.0 - 1e-12)..=most * (1.0 + 1e-12)).contains(&unit), "{least} {unit} {most}");
            }
            Ok(other) => prop_assert!(false, "{other:?}"),
            Err(error) => {
                prop_assert_eq!(&error, &ObservationError::NoSpread);
                let flat = rows.iter().filter(|row| {
                    let finite: Vec<f32> = row.iter().copied().filter(|d| d.is_finite()).collect();
                    finite.iter().all(|d| *d == finite[0])
                });
                // Short rows and rows with few that stand out have no range either.
                prop_assert!(least <= 0.0, "{} of {} rows are flat", flat.count(), rows.len());
            }
        }
    }
}

#[test]
fn rows_without_a_range_are_counted_where_most_have_none() {
    let ramp: Vec<f32> = (0..41).map(|i| i as f32).collect();
    let unit = 38.0 / 5_f64.ln();
    let of = |rows: &[&[f32]]| match Spread::of(rows) {
        Ok(Spread::Fixed(unit)) => Some(unit),
        Ok(other) => panic!("{other:?}"),
        Err(error) => {
            let rows = "most of the rows have no finite range of distances above 0";
            assert_eq!(error.to_string(), format!("{rows} to take a scale from"));
            None
        }
    };
    let (flat, far, far_and_near) = ([0.5_f32; 41], [INF; 41], [&[INF; 4][..], &ramp].concat());
    let fixed = of(&[&ramp]).unwrap();
    assert!((fixed - unit).abs() < 1e-14);
    assert_eq!(of(&[&far_and_near]), Some(fixed));
    assert_eq!(of(&[]), None);
    assert_eq!(of(&[&[]]), None);
    assert_eq!(of(&[&flat]), None);
    assert_eq!(of(&[&far]), None);
    // Half of them, and more than half.
    assert!(of(&[&ramp, &flat]).is_some());
    assert_eq!(of(&[&flat, &ramp, &flat]), None);
    assert_eq!(of(&[&far, &ramp, &far]), None, "rows that are infinite have no range");
    assert_eq!(of(&[&[], &ramp, &[]]), None, "empty rows have no range");
    assert!(of(&[&ramp, &flat, &ramp]).is_some());
    // At temperature 1 the likelihood changes fivefold over the range.
    let sensor =
        AppearanceLikelihood::new(2).unwrap().with_spread(Spread::of(&[&ramp]).unwrap()).unwrap();
    let (_, p) = step(&[1.0, 1.0], sensor, &vec![0.0, 38.0]).unwrap();
    assert!((p[0] / p[1] - 5.0).abs() < 1e-12);
}
