//! Defines the settings, one entry each, so that flag, variable, key of the file, default, help and type cannot differ.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use super::sources::{Reader, Setting, Settings};
use super::value::{LogFormat, Origins, Threads, Value};

/// A struct of settings with its table. The default is written as an operator would write it; empty: none.
macro_rules! settings {
    ($(#[$about:meta])* $visibility:vis struct $name:ident {
        $($(#[doc = $help:literal])+ $key:ident: $kind:ty = $default:literal,)+
    }) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq)]
        $visibility struct $name {
            $($(#[doc = $help])+ pub(crate) $key: $kind,)+
        }

        impl $name {
            /// One entry per setting.
            pub(crate) const TABLE: &'static [Setting] = &[
                $(Setting {
                    key: stringify!($key),
                    default: $default,
                    help: concat!($($help),+),
                    is_switch: <$kind as Value>::IS_SWITCH,
                },)+
            ];
        }

        impl Settings for $name {
            const TABLE: &'static [Setting] = Self::TABLE;

            fn read(reader: &mut Reader<'_>) -> Option<Self> {
                // All are read before the first `?` returns, so that each invalid one adds its fault.
                $(let $key = reader.read::<$kind>(stringify!($key));)+
                Some(Self { $($key: $key?,)+ })
            }
        }
    };
}

settings! {
    /// What is logged to standard error, and how.
    pub(crate) struct LogSettings {
        /// Log filter, such as `info` or `slipdrive=debug`.
        log: String = "info",
        /// Form of the log lines: `text` or `json`.
        log_format: LogFormat = "text",
    }
}

settings! {
    /// Size, addresses, limits and timeouts of a server.
    pub(crate) struct ServeSettings {
        /// Address of the REST server; port 0 takes a free one, which is logged.
        http: SocketAddr = "127.0.0.1:8080",
        /// Address of the gRPC server.
        grpc: SocketAddr = "127.0.0.1:50051",
        /// Serves gRPC on the address of REST too, in place of its own.
        one_port: bool = "false",
        /// Address of `/livez`, `/readyz` and `/metrics`, in place of the REST server's.
        admin: Option<SocketAddr> = "",
        /// Threads that solve, one request each; idle ones help the others; empty: cores - 1, at least 1.
        workers: Option<Threads> = "",
        /// Requests that may wait for a worker; more are refused with 429.
        queue_length: usize = "64",
        /// Seconds of expected work per worker that may be in flight; more is refused with 429.
        queue_work_s: Duration = "60",
        /// Items of one batch that may be unanswered at once; what is sent meanwhile waits, up to 4 MiB per connection.
        batch_window: NonZeroUsize = "16",
        /// Seconds that work is still taken after a stop signal, while probes already say that the server is not ready.
        drain_delay_s: Duration = "0",
        /// Seconds that jobs in flight may take after that before they are cut off: the wait for a worker and the longest time limit.
        drain_timeout_s: Duration = "120",
        /// File with API keys, read again when it changes, such as a line `NAME:KEY` for each; or the variable `SLIPDRIVE_API_KEYS`, separated by commas.
        api_keys_file: Option<PathBuf> = "",
        /// Lets a server without keys listen where others can reach it.
        allow_unauthenticated: bool = "false",
        /// Origins whose pages may call REST from a browser, such as `https://fleet.example`, separated by commas.
        cors_origins: Origins = "",
        /// File with the certificate chain in PEM, the server's own first, read again when it changes; with it, REST and gRPC speak TLS only.
        tls_certificate: Option<PathBuf> = "",
        /// File with the private key of the certificate in PEM, read again when it changes.
        tls_key: Option<PathBuf> = "",
        /// Connections that may be open at once, on both ports together; a newcomer replaces the least used one of whoever has most.
        max_connections: NonZeroUsize = "512",
        /// Connections of one address that may be open at once, where no proxy stands before the server; empty: no limit.
        max_connections_per_address: Option<NonZeroUsize> = "",
        /// MiB that bodies being received and answers not yet taken may hold, one connection a quarter at most; more is refused with 429.
        memory_budget_mib: NonZeroUsize = "64",
        /// Requests of one HTTP/2 connection that may be open at once.
        max_streams: u32 = "128",
        /// Seconds that a caller may take to send the head of a request.
        head_timeout_s: Duration = "10",
        /// Seconds that an HTTP/2 connection may stay without a request.
        idle_timeout_s: Duration = "300",
        /// Seconds after which a connection takes no new requests.
        max_connection_age_s: Duration = "1800",
    }
}
