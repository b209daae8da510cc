//! Names that structs are stored under; some formats write them, and messages show them.

use serde::de::DeserializeOwned;
use wayfix::inference::{
    FilterSnapshot, FixedLagSnapshot, OnlineViterbiSnapshot, PrunedFilterSnapshot,
};
use wayfix::likelihood::{GroupedLikelihood, PooledLikelihood, SparseTableLikelihood};
use wayfix::motion::{DistanceTransition, OffMapTransition};
use wayfix::observation::Confusion;
use wayfix::transition::{
    ConstrainedTransition, DistractedTransition, DwellTransition, KroneckerTransition,
    RestartTransition, SwitchedTransition, WindowTransition,
};
use wayfix::{
    DenseTransition, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, SparseLikelihood,
    SparseTransition, TableLikelihood,
};

fn name<T: DeserializeOwned>() -> String {
    let error = serde_json::from_str::<T>("1").map(drop).unwrap_err().to_string();
    let name = error.strip_prefix("invalid type: integer `1`, expected struct ");
    name.unwrap_or(&error).strip_suffix(" at line 1 column 1").unwrap_or(&error).to_owned()
}

#[test]
fn names_of_structs_stay() {
    type A = SparseTransition;
    type B = TableLikelihood;
    let names = [
        (name::<Hmm<A, B>>(), "Hmm"),
        (name::<DenseTransition>(), "DenseTransition"),
        (name::<A>(), "SparseTransition"),
        (name::<ConstrainedTransition>(), "ConstrainedTransition"),
        (name::<SwitchedTransition<A>>(), "SwitchedTransition"),
        (name::<WindowTransition>(), "WindowTransition"),
        (name::<RestartTransition<A>>(), "RestartTransition"),
        (name::<KroneckerTransition<A, A>>(), "KroneckerTransition"),
        (name::<DistractedTransition<A>>(), "DistractedTransition"),
        (name::<DwellTransition<A>>(), "DwellTransition"),
        (name::<B>(), "TableLikelihood"),
        (name::<LikelihoodVector>(), "LikelihoodVector"),
        (name::<SparseLikelihood>(), "SparseLikelihood"),
        (name::<SparseTableLikelihood>(), "SparseTableLikelihood"),
        (name::<OptionalLikelihood<B>>(), "OptionalLikelihood"),
        (name::<FusedLikelihood<B, B>>(), "FusedLikelihood"),
        (name::<GroupedLikelihood<B>>(), "GroupedLikelihood"),
        (name::<PooledLikelihood<B>>(), "PooledLikelihood"),
        (name::<FilterSnapshot>(), "FilterSnapshot"),
        (name::<FixedLagSnapshot<()>>(), "FixedLagSnapshot"),
        (name::<PrunedFilterSnapshot>(), "PrunedFilterSnapshot"),
        (name::<OnlineViterbiSnapshot>(), "OnlineViterbiSnapshot"),
        (name::<OffMapTransition<A>>(), "OffMapTransition"),
        (name::<DistanceTransition>(), "DistanceTransition"),
        (name::<Confusion>(), "Confusion"),
    ];
    for (found, expected) in names {
        assert_eq!(found, expected);
    }
}
