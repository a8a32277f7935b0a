//! A certificate that is rotated while the server works, and probes of a server that speaks TLS only.

use std::net::SocketAddr;
use std::process::Output;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rcgen::CertifiedKey;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};
use tokio_rustls::client::TlsStream;

use super::{certificate, connect_trusting};
use crate::support::HANG_BOUND;
use crate::support::mounted::Mounted;
use crate::support::process::{ServerProcess, sample_in, slipdrive};

/// What was promised: a new certificate is shown after so long at most.
const ROTATION_BOUND: Duration = Duration::from_secs(10);

type Certified = CertifiedKey<rcgen::KeyPair>;
type Stream = BufReader<TlsStream<TcpStream>>;

/// The files of a certificate and its key.
fn files_of(certified: &Certified) -> [(&'static str, String); 2] {
    [("tls.crt", certified.cert.pem()), ("tls.key", certified.signing_key.serialize_pem())]
}

fn as_texts<'a>(files: &'a [(&'a str, String)]) -> Vec<(&'a str, &'a str)> {
    files.iter().map(|(name, text)| (*name, text.as_str())).collect()
}

fn server_with(mounted: &Mounted) -> ServerProcess {
    let (certificate, key) = (mounted.path("tls.crt"), mounted.path("tls.key"));
    let flags = ["--tls-certificate", certificate.to_str().unwrap(), "--tls-key", key.to_str().unwrap()];
    ServerProcess::start_without_admin(&flags)
}

async fn open(address: SocketAddr, trusted: &[Certified; 2]) -> Stream {
    BufReader::new(connect_trusting(address, &[&trusted[0], &trusted[1]], &[b"http/1.1"]).await)
}

/// Whether the server has shown this certificate on a connection.
fn shows(stream: &Stream, certified: &Certified) -> bool {
    stream.get_ref().get_ref().1.peer_certificates().unwrap()[0] == *certified.cert.der()
}

/// Asks over a connection that stays open; gives the body of the answer.
async fn get(stream: &mut Stream, path: &str) -> String {
    let asked = async {
        stream.write_all(format!("GET {path} HTTP/1.1\r\nhost: h\r\n\r\n").as_bytes()).await.unwrap();
        let (mut head, mut length) = (String::new(), 0);
        while !head.ends_with("\r\n\r\n") {
            let begin = head.len();
            assert!(stream.read_line(&mut head).await.unwrap() > 0, "the connection stays open: {head}");
            if let Some(given) = head[begin..].to_ascii_lowercase().strip_prefix("content-length:") {
                length = given.trim().parse().unwrap();
            }
        }
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        let mut body = vec![0; length];
        stream.read_exact(&mut body).await.unwrap();
        String::from_utf8(body).unwrap()
    };
    timeout(HANG_BOUND, asked).await.expect("the server answers")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn certificate_is_rotated_under_load_and_no_request_fails() {
    let trusted = Arc::new([certificate(), certificate()]);
    let mounted = Mounted::new("rotated-certificate", &as_texts(&files_of(&trusted[0])));
    let server = server_with(&mounted);
    let (is_over, answered) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
    let newcomers = {
        let (address, trusted) = (server.http, Arc::clone(&trusted));
        let (is_over, answered) = (Arc::clone(&is_over), Arc::clone(&answered));
        tokio::spawn(async move {
            while !is_over.load(Ordering::Relaxed) {
                get(&mut open(address, &trusted).await, "/limits").await;
                answered.fetch_add(1, Ordering::Relaxed);
            }
        })
    };
    let mut stayed = open(server.http, &trusted).await;
    assert!(shows(&stayed, &trusted[0]));
    mounted.swap(&as_texts(&files_of(&trusted[1])));
    let begin = Instant::now();
    while !shows(&open(server.http, &trusted).await, &trusted[1]) {
        assert!(begin.elapsed() < HANG_BOUND, "the new certificate is shown at last");
        get(&mut stayed, "/limits").await;
        sleep(Duration::from_millis(50)).await;
    }
    let shown_after = begin.elapsed();
    assert!(shown_after < ROTATION_BOUND, "the new certificate was shown after {shown_after:?}");
    get(&mut stayed, "/limits").await;
    is_over.store(true, Ordering::Relaxed);
    newcomers.await.expect("no request failed");
    let answered = answered.load(Ordering::Relaxed);
    println!("shown after {shown_after:?}, {answered} requests on connections of their own answered");
    server.log_line(&["read again", "certificate"]);
}

#[tokio::test]
async fn half_a_rotation_leaves_the_old_certificate_until_it_is_whole() {
    let trusted = [certificate(), certificate()];
    let (old, new) = (files_of(&trusted[0]), files_of(&trusted[1]));
    let mounted = Mounted::new("half-certificate", &as_texts(&old));
    let server = server_with(&mounted);
    mounted.swap(&[("tls.crt", &new[0].1), ("tls.key", &old[1].1)]);
    server.signal("HUP");
    server.log_line(&["what was read before stays in force", "certificate", "do not fit"]);
    let mut stream = open(server.http, &trusted).await;
    assert!(shows(&stream, &trusted[0]));
    assert_eq!(health(&server).status.code(), Some(0), "with its old certificate it is healthy");
    let stale = "slipdrive_file_stale{file=\"certificate\"}";
    assert_eq!(sample_in(&get(&mut stream, "/metrics").await, stale), 1.0);
    mounted.swap(&as_texts(&new));
    server.signal("HUP");
    server.log_line(&["read again"]);
    assert!(shows(&open(server.http, &trusted).await, &trusted[1]));
    assert_eq!(sample_in(&get(&mut stream, "/metrics").await, stale), 0.0);
}

/// `slipdrive health` with the settings of the server.
fn health(server: &ServerProcess) -> Output {
    let settings = [("SLIPDRIVE_TLS_CERTIFICATE", "a"), ("SLIPDRIVE_TLS_KEY", "b")];
    slipdrive().arg("health").env("SLIPDRIVE_HTTP", server.http.to_string()).envs(settings).output().unwrap()
}

#[test]
fn health_command_asks_over_tls_where_there_is_no_admin_port() {
    let mounted = Mounted::new("health", &as_texts(&files_of(&certificate())));
    let server = server_with(&mounted);
    let healthy = health(&server);
    let said = [healthy.stdout, healthy.stderr].concat();
    assert_eq!(healthy.status.code(), Some(0), "{}", String::from_utf8_lossy(&said));
    assert!(String::from_utf8_lossy(&said).contains("/readyz"));
    let plain = slipdrive().arg("health").env("SLIPDRIVE_HTTP", server.http.to_string()).output().unwrap();
    assert_eq!(plain.status.code(), Some(1), "nothing is answered in plain text");
    // With an admin port, which speaks plain text, that one is asked.
    let other = ServerProcess::start(&[], &[]);
    let settings = [("SLIPDRIVE_ADMIN", other.admin.to_string()), ("SLIPDRIVE_TLS_CERTIFICATE", "a".to_owned())];
    assert_eq!(slipdrive().arg("health").envs(settings).output().unwrap().status.code(), Some(0));
    drop(server);
}
