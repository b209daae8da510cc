//! The executor process of a cluster.

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;

use ballista_core::registry::BallistaFunctionRegistry;
use ballista_executor::executor_process::{ExecutorProcessConfig, start_executor_process};
use clap::Parser;
use datafusion::prelude::SessionConfig;

use super::{models, serve, state};
use crate::error::{FleetError, Outcome};

/// Executes tasks of queries with the functions of wayfix.
#[derive(Debug, Clone, Parser)]
#[command(name = "wayfix-fleet-executor", version)]
pub struct ExecutorCommand {
    /// Address of the scheduler.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:50050")]
    scheduler: String,
    /// Address that the scheduler, other executors and clients connect to. It has no password, so
    /// use one that only they can reach.
    #[arg(long, default_value = "127.0.0.1")]
    host: IpAddr,
    /// Port for rows.
    #[arg(long, default_value_t = 50051)]
    port: u16,
    /// Port for tasks.
    #[arg(long, default_value_t = 50052)]
    task_port: u16,
    /// Tasks at a time; one per core by default.
    #[arg(long)]
    cores: Option<usize>,
    /// Folder for rows between tasks.
    #[arg(long)]
    work_dir: PathBuf,
    /// Folder of the models: names in queries are relative to it, and no file outside can be named.
    /// Must be the same for all processes of the cluster. Without it, a query can open any file.
    #[arg(long, value_name = "FOLDER")]
    models: Option<PathBuf>,
    /// Seconds between heartbeats.
    #[arg(long, default_value_t = 5)]
    heartbeat: u64,
    /// Seconds to wait for the scheduler.
    #[arg(long, default_value_t = 30)]
    patience: u16,
}

impl ExecutorCommand {
    /// Executes tasks until the process is told to stop.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if the scheduler cannot be reached, or a port cannot be opened.
    pub fn run(&self) -> Outcome<()> {
        let address = self.scheduler.rsplit_once(':');
        let address = address.and_then(|(host, port)| Some((host, port.parse().ok()?)));
        let Some((scheduler_host, scheduler_port)) = address else {
            let message = format!("--scheduler {}: expected HOST:PORT", self.scheduler);
            return Err(FleetError::Settings(message));
        };
        let Some(work_dir) = self.work_dir.to_str() else {
            return Err(FleetError::format(&self.work_dir, "the path is not Unicode"));
        };
        std::fs::create_dir_all(&self.work_dir).map_err(FleetError::file(&self.work_dir))?;
        // Plans name functions; the registry resolves them to ours.
        let known = state(SessionConfig::new(), &models(self.models.as_deref())?)?;
        let config = ExecutorProcessConfig {
            bind_host: self.host.to_string(),
            external_host: Some(self.host.to_string()),
            port: self.port,
            grpc_port: self.task_port,
            scheduler_host: scheduler_host.to_owned(),
            scheduler_port,
            scheduler_connect_timeout_seconds: self.patience,
            vcores: self
                .cores
                .unwrap_or_else(|| thread::available_parallelism().map_or(1, Into::into)),
            work_dir: Some(work_dir.to_owned()),
            executor_heartbeat_interval_seconds: self.heartbeat,
            override_function_registry: Some(Arc::new(BallistaFunctionRegistry::from(&known))),
            ..ExecutorProcessConfig::default()
        };
        serve(start_executor_process(Arc::new(config)))
    }
}
