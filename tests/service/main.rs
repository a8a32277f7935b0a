//! The service as its callers and operators meet it: both transports, the command line, the process and what is deployed.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod architecture;
mod assess;
mod batch;
mod budgets;
mod command_line;
#[cfg(unix)]
mod container;
mod corpus;
mod departures;
mod deployment;
mod error_table;
mod export;
mod fields;
mod frames;
mod grpc_contract;
mod helped_service;
mod hostile;
mod http_batch;
mod http_batch_floods;
mod http_coding;
mod http_contract;
mod http_deadlines;
mod http_events;
mod http_forward_drive;
mod http_refusals;
mod job_promises;
#[cfg(unix)]
mod keys;
#[cfg(unix)]
mod life_cycle;
mod limits;
mod metrics;
mod monitoring;
mod mutations;
mod openapi;
#[cfg(feature = "otel")]
mod otel_export;
mod outputs;
mod overload;
mod pace;
mod page;
mod present;
mod real_robots;
mod release;
#[cfg(unix)]
mod replicas;
mod request_log;
mod sensitivity;
mod shares;
mod stopping;
mod support;
mod sweep;
mod sweep_deployment;
mod sweep_files;
#[cfg(all(feature = "nats", unix))]
mod sweep_nats;
mod sweep_rows;
mod time_limits;
#[cfg(feature = "tls")]
mod tls;
mod transport_parity;
mod units;
mod values;
