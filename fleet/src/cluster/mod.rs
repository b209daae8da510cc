//! Queries on a cluster, by [Ballista](ballista): a scheduler and executors that know the
//! [functions](crate::sql), and a client.
//!
//! All of them must find tables and models under the same paths. Executors keep the rows of a task
//! in files until the client has them; tasks of a lost executor are repeated by others.

mod executor;
mod log;
mod scheduler;

use std::future::Future;
use std::path::Path;

use ballista::prelude::SessionContextExt;
use ballista_core::error::BallistaError;
use datafusion::execution::{FunctionRegistry, SessionState, SessionStateBuilder};
use datafusion::prelude::{SessionConfig, SessionContext};

use crate::error::{FleetError, Outcome};
use crate::sql::{self, Models};
pub use executor::ExecutorCommand;
pub use scheduler::SchedulerCommand;

/// Stack size of a thread: plans are trees, decoded by recursion.
const STACK: usize = 32 << 20;

/// Models that queries by others may name: all files, or those of a folder.
fn models(folder: Option<&Path>) -> Outcome<Models> {
    folder.map_or_else(|| Ok(Models::default()), Models::in_folder)
}

/// Context whose queries run on the cluster of the scheduler at `host:port`.
///
/// Queries are cut into `tasks` tasks; each reads part of a file.
///
/// # Errors
///
/// [`FleetError::Query`] if this is not an address.
pub async fn context(scheduler: &str, tasks: usize, batch: usize) -> Outcome<SessionContext> {
    let config = SessionConfig::new()
        .with_target_partitions(tasks.max(1))
        .with_batch_size(batch.max(1))
        // Split files among executors however small they are: a step of a model costs far more than
        // a byte.
        .with_repartition_file_min_size(0);
    let state = state(config, &Models::default())?;
    let context = SessionContext::remote_with_state(&format!("df://{scheduler}"), state).await?;
    // Ballista has replaced all functions by its own.
    sql::register(&context);
    Ok(context)
}

/// State of a session that knows our functions.
fn state(config: SessionConfig, models: &Models) -> datafusion::common::Result<SessionState> {
    let mut state = SessionStateBuilder::new().with_default_features().with_config(config).build();
    for function in sql::functions(models) {
        state.register_udf(function)?;
    }
    for aggregate in sql::aggregates(models) {
        state.register_udaf(aggregate)?;
    }
    Ok(state)
}

/// Runs a process of the cluster until it is told to stop.
fn serve(process: impl Future<Output = Result<(), BallistaError>>) -> Outcome<()> {
    log::to_standard_error();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .thread_stack_size(STACK)
        .build()
        .map_err(|error| FleetError::Settings(format!("no threads: {error}")))?;
    runtime.block_on(process).map_err(|error| FleetError::Cluster(error.to_string()))
}
