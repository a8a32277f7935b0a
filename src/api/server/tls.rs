//! TLS: the server's certificate and key, and handshakes with a timeout.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::server::TlsStream;

/// The ALPN names of both protocols, the preferred one first.
const PROTOCOLS: [&[u8]; 2] = [b"h2", b"http/1.1"];

/// A certificate chain with its key, ready for handshakes.
#[derive(Clone)]
pub struct Identity {
    config: Arc<ServerConfig>,
}

/// Every fault of the two files that prevents an identity.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("TLS cannot be set up: {}", .faults.join("; "))]
pub struct IdentityFaults {
    /// One sentence for each fault.
    pub faults: Vec<String>,
}

impl Identity {
    /// Reads a certificate chain, the server's own first, and its private key, both PEM. One file may hold both.
    ///
    /// # Errors
    /// All faults of both files, or that the two do not belong together.
    pub fn from_files(certificate: &Path, key: &Path) -> Result<Self, IdentityFaults> {
        match (certificates_in(certificate), key_in(key)) {
            (Ok(chain), Ok(key_der)) => Self::new(chain, key_der).map_err(|error| {
                let (certificate, key) = (certificate.display(), key.display());
                IdentityFaults { faults: vec![format!("{certificate} and {key} do not fit: {error}")] }
            }),
            (chain, key) => Err(IdentityFaults { faults: chain.err().into_iter().chain(key.err()).collect() }),
        }
    }

    fn new(
        chain: Vec<CertificateDer<'static>>,
        key: PrivateKeyDer<'static>,
    ) -> Result<Self, tokio_rustls::rustls::Error> {
        // Given explicitly: other crates of the build may install another provider as the process's default.
        let builder = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()));
        let mut config =
            builder.with_safe_default_protocol_versions()?.with_no_client_auth().with_single_cert(chain, key)?;
        config.alpn_protocols = PROTOCOLS.map(<[u8]>::to_vec).into();
        Ok(Self { config: Arc::new(config) })
    }

    /// The connection after its handshake; none when that fails or takes longer than `handshake_timeout`.
    pub(super) async fn shake_hands(
        &self,
        stream: TcpStream,
        handshake_timeout: Duration,
    ) -> Option<TlsStream<TcpStream>> {
        let handshake = TlsAcceptor::from(Arc::clone(&self.config)).accept(stream);
        match timeout(handshake_timeout, handshake).await {
            Ok(Ok(stream)) => Some(stream),
            Ok(Err(error)) => {
                tracing::debug!(error = %error, "a handshake failed");
                None
            }
            Err(_) => None,
        }
    }
}

impl std::fmt::Debug for Identity {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Identity").finish_non_exhaustive()
    }
}

impl PartialEq for Identity {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.config, &other.config)
    }
}

impl Eq for Identity {}

fn certificates_in(path: &Path) -> Result<Vec<CertificateDer<'static>>, String> {
    let chain = CertificateDer::pem_file_iter(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    match chain {
        Ok(chain) if chain.is_empty() => Err(format!("{} holds no certificate in PEM", path.display())),
        Ok(chain) => Ok(chain),
        Err(error) => Err(unreadable(path, "certificate", &error)),
    }
}

fn key_in(path: &Path) -> Result<PrivateKeyDer<'static>, String> {
    PrivateKeyDer::from_pem_file(path).map_err(|error| unreadable(path, "private key", &error))
}

fn unreadable(path: &Path, content: &str, error: &pem::Error) -> String {
    let path = path.display();
    if let pem::Error::Io(error) = error {
        format!("{path} cannot be read: {error}")
    } else if matches!(error, pem::Error::NoItemsFound) {
        format!("{path} holds no {content} in PEM")
    } else {
        format!("{path} holds no sound {content}: {error}")
    }
}
