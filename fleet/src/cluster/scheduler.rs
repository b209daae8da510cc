//! The scheduler process of a cluster.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

use ballista_scheduler::cluster::BallistaCluster;
use ballista_scheduler::config::SchedulerConfig;
use ballista_scheduler::scheduler_process::start_server;
use clap::Parser;

use super::{models, serve, state};
use crate::error::Outcome;

/// Schedules queries with the functions of wayfix on the executors of a cluster.
#[derive(Debug, Clone, Parser)]
#[command(name = "wayfix-fleet-scheduler", version)]
pub struct SchedulerCommand {
    /// Address that executors and clients connect to. It has no password, so use one that only
    /// they can reach.
    #[arg(long, default_value = "127.0.0.1")]
    host: IpAddr,
    /// Port.
    #[arg(long, default_value_t = 50050)]
    port: u16,
    /// Folder of the models: names in queries are relative to it, and no file outside can be named.
    /// Must be the same for all processes of the cluster. Without it, a query can open any file.
    #[arg(long, value_name = "FOLDER")]
    models: Option<PathBuf>,
    /// Seconds without a heartbeat after which an executor counts as lost.
    #[arg(long, default_value_t = 20)]
    timeout: u64,
}

impl SchedulerCommand {
    /// Serves until the process is told to stop.
    ///
    /// # Errors
    ///
    /// [`FleetError`](crate::FleetError) if the port cannot be opened, or the folder of models is
    /// not a folder.
    pub fn run(&self) -> Outcome<()> {
        let models = models(self.models.as_deref())?;
        let mut config = SchedulerConfig::default()
            .with_hostname(self.host.to_string())
            .with_port(self.port)
            .with_override_session_builder(Arc::new(move |config| state(config, &models)));
        config.bind_host = self.host.to_string();
        config.executor_timeout_seconds = self.timeout;
        // Checked four times within the timeout, so a loss is noticed at most a quarter late.
        config.expire_dead_executor_interval_seconds = self.timeout.div_ceil(4).max(1);
        let address = SocketAddr::new(self.host, self.port);
        serve(async move {
            let cluster = BallistaCluster::new_from_config(&config).await?;
            start_server(cluster, address, Arc::new(config)).await
        })
    }
}
