//! Functions for [DataFusion](datafusion): the routines in SQL.
//!
//! ```
//! # use std::error::Error;
//! # use datafusion::prelude::SessionContext;
//! # fn main() -> Result<(), Box<dyn Error>> {
//! let context = SessionContext::new();
//! wayfix_fleet::sql::register(&context);
//! let query = "SELECT trace_id, wayfix_smooth('model.json', observation) FROM drives";
//! # let _ = query;
//! # Ok(())
//! # }
//! ```
//!
//! | function | result per drive |
//! |---|---|
//! | `wayfix_score` | a struct of `log_likelihood`, `error_kind`, `error_step`, `error` |
//! | `wayfix_smooth` | a list of structs of `step`, `state`, `probability`, `entropy` |
//! | `wayfix_filter` | the same, and `log_likelihood` |
//! | `wayfix_decode` | a list of structs of `step`, `state`: the most probable path |
//!
//! The aggregate `wayfix_expect` adds up the expected statistics of drives, for [`learn`].
//!
//! All take the model and the columns of a nested table of drives (one row per drive): `(model,
//! observations)`; for a sensor of sparse lists also `(model, observations, elsewhere)`; for
//! positions `(model, latitudes, longitudes, deviations)`. Steps are 1, 2, … in each drive. A drive
//! that the model rules out has a null in place of the list; its error is in `wayfix_score`.
//!
//! The model is a literal text: the path of its file, or `path#hash` with its hash
//! ([`Model::hash`](crate::model::Model::hash)), which is then verified. It is read once per
//! process, when the first batch of drives arrives, and plans contain only its path. A process that
//! keeps running while a file changes only notices if the hash is given. A query can open any file
//! this way, unless models are confined to a folder ([`register_with`]).

mod by_range;
mod expect;
mod files;
mod function;
mod key;
mod learn;
mod models;
mod parts;
mod query;
mod ranges;
mod rows;
mod source;
mod starts;
mod unordered;

use std::sync::Arc;

use datafusion::logical_expr::{AggregateUDF, ScalarUDF};
use datafusion::prelude::SessionContext;

use crate::output::Verb;
use expect::Expect;
use function::Function;
pub use function::FunctionError;
pub use learn::learn;
pub use models::Models;
pub use query::{Query, QueryState, QuerySummary, context, query};
pub use source::Source;
use unordered::Unordered;

/// The functions, for registration wherever DataFusion takes functions.
#[must_use]
pub fn functions(models: &Models) -> Vec<Arc<ScalarUDF>> {
    let verbs = [Verb::Score, Verb::Smooth, Verb::Filter, Verb::Decode];
    let function = |verb| Arc::new(ScalarUDF::from(Function::new(verb, models.clone())));
    verbs.into_iter().map(function).collect()
}

/// The aggregates, for registration beside the functions.
#[must_use]
pub fn aggregates(models: &Models) -> Vec<Arc<AggregateUDF>> {
    vec![Arc::new(AggregateUDF::from(Expect::new(models.clone())))]
}

/// Registers the functions and aggregates, which can then open models anywhere: for queries you
/// wrote yourself. Also registers a rule for plans, which refuses a function over lists that
/// `array_agg` gathered without `ORDER BY`. It cannot see through ready-made tables of such lists,
/// or other aggregates.
pub fn register(context: &SessionContext) {
    register_with(context, &Models::default());
}

/// As [`register`], with models from a folder: for queries by others.
pub fn register_with(context: &SessionContext, models: &Models) {
    for aggregate in aggregates(models) {
        context.register_udaf(Arc::unwrap_or_clone(aggregate));
    }
    for function in functions(models) {
        context.register_udf(Arc::unwrap_or_clone(function));
    }
    context.add_analyzer_rule(Arc::new(Unordered));
}
