//! Both transports under TLS, with a certificate of the test's own.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use rcgen::{CertifiedKey, generate_simple_self_signed};
use slipdrive::api::ApiSettings;
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use slipdrive::api::server::ServerSettings;
use slipdrive::api::server::tls::Identity;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tonic::transport::Endpoint;

use crate::support::folder::Folder;
use crate::support::{HANG_BOUND, TestServer, instant_solver};

#[cfg(unix)]
mod rotation;

const NAME: &str = "robots.test";

fn certificate() -> CertifiedKey<rcgen::KeyPair> {
    generate_simple_self_signed([NAME.to_owned()]).unwrap()
}

async fn server(test: &str, settings: ServerSettings) -> (TestServer, CertifiedKey<rcgen::KeyPair>) {
    let (files, certified) = (Folder::new(test), certificate());
    let certificate = files.write("certificate.pem", &certified.cert.pem());
    let key = files.write("key.pem", &certified.signing_key.serialize_pem());
    let identity = Some(Identity::from_files(&certificate, &key).unwrap());
    let settings = ServerSettings { identity, ..settings };
    (TestServer::start_with(4, instant_solver(), ApiSettings::default(), settings).await, certified)
}

/// A connection of a caller who trusts the certificate and offers these protocols.
async fn connect(
    address: SocketAddr,
    certified: &CertifiedKey<rcgen::KeyPair>,
    protocols: &[&[u8]],
) -> TlsStream<TcpStream> {
    connect_trusting(address, &[certified], protocols).await
}

/// A connection of a caller who trusts these certificates.
async fn connect_trusting(
    address: SocketAddr,
    trusted: &[&CertifiedKey<rcgen::KeyPair>],
    protocols: &[&[u8]],
) -> TlsStream<TcpStream> {
    let mut roots = RootCertStore::empty();
    for certified in trusted {
        roots.add(certified.cert.der().clone()).unwrap();
    }
    let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let mut config =
        builder.with_safe_default_protocol_versions().unwrap().with_root_certificates(roots).with_no_client_auth();
    config.alpn_protocols = protocols.iter().map(|protocol| protocol.to_vec()).collect();
    let stream = TcpStream::connect(address).await.unwrap();
    let name = ServerName::try_from(NAME).unwrap();
    TlsConnector::from(Arc::new(config)).connect(name, stream).await.unwrap()
}

#[tokio::test]
async fn rest_is_spoken_over_http_1_and_2() {
    let (server, certified) = server("rest", ServerSettings::default()).await;
    let mut stream = connect(server.address, &certified, &[b"http/1.1"]).await;
    assert_eq!(stream.get_ref().1.alpn_protocol(), Some(b"http/1.1".as_slice()));
    let request = "POST /solve HTTP/1.1\r\nhost: h\r\nconnection: close\r\ncontent-type: application/json\r\n\
                   content-length: 2\r\n\r\n{}";
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    timeout(HANG_BOUND, stream.read_to_string(&mut answer)).await.unwrap().unwrap();
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("final_time_s"), "{answer}");

    let stream = connect(server.address, &certified, &[b"h2", b"http/1.1"]).await;
    assert_eq!(stream.get_ref().1.alpn_protocol(), Some(b"h2".as_slice()), "HTTP/2 is preferred");
}

#[tokio::test]
async fn grpc_is_spoken_over_the_negotiated_protocol() {
    let (server, certified) = server("grpc", ServerSettings::default()).await;
    let (address, certified) = (server.grpc_address, Arc::new(certified));
    let connector = tower::service_fn(move |_: tonic::transport::Uri| {
        let certified = Arc::clone(&certified);
        async move {
            let stream = connect(address, &certified, &[b"h2"]).await;
            Ok::<_, std::io::Error>(hyper_util::rt::TokioIo::new(stream))
        }
    });
    let endpoint = Endpoint::from_shared(format!("http://{address}")).unwrap();
    let mut client = ManeuverServiceClient::new(endpoint.connect_with_connector(connector).await.unwrap());
    let solution = client.solve(pb::SolveRequest::default()).await.unwrap().into_inner().solution.unwrap();
    assert_eq!(solution.final_time_s, 1.5);
}

#[tokio::test]
async fn handshakes_that_do_not_end_are_closed_like_slow_heads() {
    let settings = ServerSettings { head_timeout: Duration::from_millis(100), ..ServerSettings::default() };
    let (server, certified) = server("slow", settings).await;
    // Nothing, a record head, a hello that never ends, and no TLS at all.
    let half_open: [&[u8]; 4] =
        [b"", b"\x16\x03\x01", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"GET / HTTP/1.1\r\n\r\n"];
    for bytes in half_open {
        for address in [server.address, server.grpc_address] {
            let mut stream = TcpStream::connect(address).await.unwrap();
            stream.write_all(bytes).await.unwrap();
            let mut answer = Vec::new();
            // A reset closes as well.
            let _ = timeout(HANG_BOUND, stream.read_to_end(&mut answer)).await.expect("the server closes");
            assert!(!answer.windows(5).any(|part| part == b"HTTP/"), "nothing is answered in plain text");
        }
    }
    // After a handshake the head is waited for no longer than without TLS.
    for protocol in [b"h2".as_slice(), b"http/1.1"] {
        let mut stream = connect(server.address, &certified, &[protocol]).await;
        let mut answer = Vec::new();
        let _ = timeout(HANG_BOUND, stream.read_to_end(&mut answer)).await.expect("the server closes");
    }
}

#[test]
fn faults_of_both_files_are_told_at_once() {
    let (files, certified) = (Folder::new("faults"), certificate());
    let certificate = files.write("certificate.pem", &certified.cert.pem());
    let key = files.write("key.pem", &certified.signing_key.serialize_pem());
    assert!(Identity::from_files(&certificate, &key).is_ok());

    let empty = files.write("empty.pem", "");
    let missing = files.path("missing.pem");
    let faults = Identity::from_files(&empty, &missing).unwrap_err().faults;
    assert_eq!(faults.len(), 2, "{faults:?}");
    assert!(faults[0].contains("empty.pem holds no certificate") && faults[1].contains("missing.pem cannot be read"));

    let swapped = Identity::from_files(&key, &certificate).unwrap_err().to_string();
    assert!(swapped.contains("no certificate") && swapped.contains("no private key"), "{swapped}");

    let other = files.write("other.pem", &self::certificate().signing_key.serialize_pem());
    let unlike = Identity::from_files(&certificate, &other).unwrap_err().to_string();
    assert!(unlike.contains("do not fit"), "{unlike}");
    let encrypted = "-----BEGIN ENCRYPTED PRIVATE KEY-----\nAAAA\n-----END ENCRYPTED PRIVATE KEY-----\n";
    let locked = Identity::from_files(&certificate, &files.write("locked.pem", encrypted)).unwrap_err().to_string();
    assert!(locked.contains("locked.pem is encrypted; a key without a passphrase is needed"), "{locked}");
    let cut = files.write("cut.pem", &certified.cert.pem()[..200]);
    assert_eq!(Identity::from_files(&cut, &key).unwrap_err().faults.len(), 1);
}
