//! `slipdrive health`: queries the probes of a running server, for container images that hold no HTTP client.

#[cfg(feature = "tls")]
mod tls;

use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream};
use std::process::ExitCode;
use std::time::Duration;

use crate::tell;

/// How long each step may take, connecting, writing or reading: a healthy server needs milliseconds, and container
/// probes allow seconds.
const STEP_TIMEOUT: Duration = Duration::from_secs(2);
/// How much of the answer is read: enough for the status line.
const MAX_HEAD_BYTES: u64 = 64;

/// Where a server answers probes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Target {
    /// The address that it is bound to.
    pub(crate) bound: SocketAddr,
    pub(crate) protocol: Protocol,
}

/// What is spoken there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Protocol {
    Plain,
    Tls,
}

/// Queries `/readyz`, or `/livez`, of a server; prints the outcome and returns the exit code.
pub(crate) fn ask(target: Target, is_live_enough: bool) -> ExitCode {
    let path = if is_live_enough { "/livez" } else { "/readyz" };
    let address = reachable(target.bound);
    match status_of(address, target.protocol, path) {
        Ok(200) => {
            // Whoever probes asks for the exit code.
            let _ = writeln!(io::stdout(), "{path} of {address} answers 200");
            ExitCode::SUCCESS
        }
        Ok(status) => {
            tell(&format_args!("{path} of {address} answers {status}"));
            ExitCode::FAILURE
        }
        Err(error) => {
            tell(&format_args!("{path} of {address} does not answer: {error}"));
            ExitCode::FAILURE
        }
    }
}

/// The address to connect to: a server that is bound to all addresses is queried at the loopback one.
fn reachable(bound: SocketAddr) -> SocketAddr {
    let ip = match bound.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
        IpAddr::V6(ip) if ip.is_unspecified() => IpAddr::V6(Ipv6Addr::LOCALHOST),
        ip @ (IpAddr::V4(_) | IpAddr::V6(_)) => ip,
    };
    SocketAddr::new(ip, bound.port())
}

/// The status of `GET path`.
fn status_of(address: SocketAddr, protocol: Protocol, path: &str) -> io::Result<u16> {
    // The first is what a socket says when its timeout passes.
    let is_late = |error: &io::Error| matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut);
    let silence = || io::Error::other(format!("no answer within {} s", STEP_TIMEOUT.as_secs()));
    asked(address, protocol, path).map_err(|error| if is_late(&error) { silence() } else { error })
}

fn asked(address: SocketAddr, protocol: Protocol, path: &str) -> io::Result<u16> {
    let stream = TcpStream::connect_timeout(&address, STEP_TIMEOUT)?;
    stream.set_read_timeout(Some(STEP_TIMEOUT))?;
    stream.set_write_timeout(Some(STEP_TIMEOUT))?;
    match protocol {
        Protocol::Plain => status_over(stream, address, path),
        #[cfg(feature = "tls")]
        Protocol::Tls => status_over(tls::shake_hands(stream, address)?, address, path),
        #[cfg(not(feature = "tls"))]
        Protocol::Tls => Err(io::Error::new(io::ErrorKind::Unsupported, "this program has no TLS (feature `tls`)")),
    }
}

fn status_over(mut stream: impl Read + Write, address: SocketAddr, path: &str) -> io::Result<u16> {
    // In one write: after a partial request the server may answer and close before the rest is written.
    let request = format!("GET {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut head = Vec::new();
    stream.take(MAX_HEAD_BYTES).read_to_end(&mut head)?;
    let status = str::from_utf8(&head).ok().and_then(|head| head.split(' ').nth(1)).and_then(|code| code.parse().ok());
    status.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "the answer is not HTTP"))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::thread;

    use super::*;

    fn answering(answer: &'static str) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let _ = stream.read(&mut [0; 1024]);
            stream.write_all(answer.as_bytes()).unwrap();
        });
        address
    }

    fn status(address: SocketAddr) -> io::Result<u16> {
        status_of(address, Protocol::Plain, "/readyz")
    }

    #[test]
    fn status_is_read_from_the_first_line() {
        assert_eq!(status(answering("HTTP/1.1 503 Service Unavailable\r\n\r\n")).unwrap(), 503);
        assert!(status(answering("SSH-2.0")).is_err());
    }

    #[test]
    fn silence_is_told_as_such() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let error = status(listener.local_addr().unwrap()).unwrap_err();
        assert_eq!(error.to_string(), "no answer within 2 s");
    }

    #[test]
    fn server_on_all_addresses_is_asked_at_loopback() {
        assert_eq!(reachable("0.0.0.0:80".parse().unwrap()), "127.0.0.1:80".parse().unwrap());
        assert_eq!(reachable("[::]:80".parse().unwrap()), "[::1]:80".parse().unwrap());
    }
}
