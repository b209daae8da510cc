//! Names under which structs are stored, which some formats write and messages show.

use serde::de::DeserializeOwned;
use wayfix_recognition::motion::{
    OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChangeRates,
};
use wayfix_recognition::observation::{MatchOdds, Standardizer};
use wayfix_recognition::{Mapper, Options, Parameters, TrackSnapshot};

fn name<T: DeserializeOwned>() -> String {
    let error = serde_json::from_str::<T>("1").map(drop).unwrap_err().to_string();
    let name = error.strip_prefix("invalid type: integer `1`, expected struct ");
    name.unwrap_or(&error).strip_suffix(" at line 1 column 1").unwrap_or(&error).to_owned()
}

#[test]
fn names_of_structs_stay() {
    let names = [
        (name::<Speeds>(), "Speeds"),
        (name::<RouteTransition>(), "RouteTransition"),
        (name::<RouteControl>(), "RouteControl"),
        (name::<OdometryModel>(), "OdometryModel"),
        (name::<ViewChangeRates>(), "ViewChangeRates"),
        (name::<OffMap>(), "OffMap"),
        (name::<MatchOdds>(), "MatchOdds"),
        (name::<Standardizer>(), "Standardizer"),
        (name::<Options>(), "Options"),
        (name::<Parameters>(), "Fit"),
        (name::<TrackSnapshot>(), "TrackSnapshot"),
        (name::<Mapper>(), "Mapper"),
    ];
    for (found, expected) in names {
        assert_eq!(found, expected);
    }
}
