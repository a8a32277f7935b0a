//! Values of settings: how they are read and what they must be.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use axum::http::HeaderValue;
use clap::builder::{PathBufValueParser, TypedValueParser};
use tracing_subscriber::EnvFilter;

/// A type that settings may have.
pub(crate) trait Value: Sized {
    /// What the text must be, for faults: "must be ...".
    const RULE: &'static str;
    /// Whether the flag alone, without a value, means `true`.
    const IS_SWITCH: bool = false;

    /// The value of a text.
    fn parse(text: &str) -> Option<Self>;
}

/// Form of the log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LogFormat {
    /// For people.
    Text,
    /// One JSON object per line.
    Json,
}

impl Value for LogFormat {
    const RULE: &'static str = "`text` or `json`";

    fn parse(text: &str) -> Option<Self> {
        match text {
            "text" => Some(Self::Text),
            "json" => Some(Self::Json),
            _ => None,
        }
    }
}

/// Origins of web pages: scheme and host, and a port where it is not the usual one; browsers send nothing else.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Origins(pub(crate) Vec<HeaderValue>);

impl Value for Origins {
    const RULE: &'static str = "like https://host or http://host:port, without a path, separated by commas";

    fn parse(text: &str) -> Option<Self> {
        // As browsers write them: in small letters, without the port that the scheme has anyway.
        let origin = |text: &str| {
            let text = text.to_ascii_lowercase();
            let (scheme, host) = text.split_once("://")?;
            let host = match scheme {
                "https" => host.strip_suffix(":443").unwrap_or(host),
                "http" => host.strip_suffix(":80").unwrap_or(host),
                _ => return None,
            };
            let is_host = !host.is_empty() && !host.contains(['/', '*', ' ']);
            HeaderValue::try_from(format!("{scheme}://{host}")).ok().filter(|_| is_host)
        };
        let origins = text.split(',').map(str::trim).filter(|origin| !origin.is_empty());
        origins.map(origin).collect::<Option<_>>().map(Self)
    }
}

/// A log filter.
impl Value for String {
    const RULE: &'static str = "a log filter, such as `info` or `slipdrive=debug`";

    fn parse(text: &str) -> Option<Self> {
        EnvFilter::try_new(text).is_ok().then(|| text.to_owned())
    }
}

impl Value for SocketAddr {
    const RULE: &'static str = "an IP address with a port, such as 127.0.0.1:8080";

    fn parse(text: &str) -> Option<Self> {
        text.parse().ok()
    }
}

impl Value for bool {
    const RULE: &'static str = "`true` or `false`";
    const IS_SWITCH: bool = true;

    fn parse(text: &str) -> Option<Self> {
        match text {
            "true" => Some(true),
            "false" => Some(false),
            _ => None,
        }
    }
}

impl Value for NonZeroUsize {
    const RULE: &'static str = "a whole number, at least 1";

    fn parse(text: &str) -> Option<Self> {
        text.parse().ok()
    }
}

/// Threads that work. A process cannot have many thousands: the system ends it where no memory is left for the next one's stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Threads(pub(crate) NonZeroUsize);

/// More than any machine has cores.
const MAX_THREADS: usize = 4096;

impl Value for Threads {
    const RULE: &'static str = "a whole number, at least 1, at most 4096";

    fn parse(text: &str) -> Option<Self> {
        text.parse().ok().filter(|threads: &NonZeroUsize| threads.get() <= MAX_THREADS).map(Self)
    }
}

/// For flags that are no settings.
impl FromStr for Threads {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::parse(text).ok_or_else(|| format!("must be {}", Self::RULE))
    }
}

impl Value for usize {
    const RULE: &'static str = "a whole number, at least 0";

    fn parse(text: &str) -> Option<Self> {
        text.parse().ok()
    }
}

impl Value for u32 {
    const RULE: &'static str = "a whole number, at least 1, below 4294967296";

    fn parse(text: &str) -> Option<Self> {
        text.parse().ok().filter(|&number| number > 0)
    }
}

/// Longest duration of a setting, s: beyond, timers overflow.
const MAX_DURATION_S: f64 = 1e9;

impl Value for Duration {
    const RULE: &'static str = "a number of seconds, from 0 to 1000000000";

    fn parse(text: &str) -> Option<Self> {
        let seconds = text.parse::<f64>().ok().filter(|seconds| (0.0..=MAX_DURATION_S).contains(seconds))?;
        Some(Self::from_secs_f64(seconds))
    }
}

impl Value for PathBuf {
    const RULE: &'static str = "a path";

    fn parse(text: &str) -> Option<Self> {
        Some(Self::from(text))
    }
}

/// For flags that are no settings. A file may be `-`, standard output, a folder may not.
pub(crate) fn folder() -> impl TypedValueParser<Value = PathBuf> {
    let is_folder = |path: PathBuf| if path == Path::new("-") { Err("must be a folder") } else { Ok(path) };
    PathBufValueParser::new().try_map(is_folder)
}

/// Absent where the text is empty.
impl<T: Value> Value for Option<T> {
    const RULE: &'static str = T::RULE;

    fn parse(text: &str) -> Option<Self> {
        if text.is_empty() { Some(None) } else { T::parse(text).map(Some) }
    }
}
