//! TLS: the server's certificate and key, and handshakes.

use std::io;
use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock};

use tokio::net::TcpStream;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::server::TlsStream;

/// The ALPN names of both protocols, the preferred one first.
const PROTOCOLS: [&[u8]; 2] = [b"h2", b"http/1.1"];

/// A certificate chain with its key, ready for handshakes; clones are the same one, also when another takes its place.
#[derive(Clone)]
pub struct Identity {
    config: Arc<RwLock<Arc<ServerConfig>>>,
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
        let config = config_of((certificate, std::fs::read(certificate)), (key, std::fs::read(key)))?;
        Ok(Self { config: Arc::new(RwLock::new(config)) })
    }

    /// Puts what was read of the two files in the place of the present certificate and key, for the handshakes to come;
    /// connections that are open keep theirs.
    ///
    /// # Errors
    /// As [`Identity::from_files`]; certificate and key are then the same as before.
    pub fn replace(&self, certificate: ReadFile<'_>, key: ReadFile<'_>) -> Result<(), IdentityFaults> {
        let config = config_of(certificate, key)?;
        *self.config.write().unwrap_or_else(PoisonError::into_inner) = config;
        Ok(())
    }

    fn config(&self) -> Arc<ServerConfig> {
        Arc::clone(&self.config.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// The connection after its handshake; none when that fails.
    pub(super) async fn shake_hands(&self, stream: TcpStream) -> Option<TlsStream<TcpStream>> {
        let shaken = TlsAcceptor::from(self.config()).accept(stream).await;
        shaken.inspect_err(|error| tracing::debug!(error = %error, "a handshake failed")).ok()
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

/// A file and what was read of it.
pub type ReadFile<'a> = (&'a Path, io::Result<Vec<u8>>);

/// The configuration of a server with the certificate chain and the key in these files.
fn config_of(certificate: ReadFile<'_>, key: ReadFile<'_>) -> Result<Arc<ServerConfig>, IdentityFaults> {
    let paths = format!("{} and {}", certificate.0.display(), key.0.display());
    match (certificates_in(certificate), key_in(key)) {
        (Ok(chain), Ok(key)) => {
            let of_both = |error| IdentityFaults { faults: vec![format!("{paths} do not fit: {error}")] };
            config(chain, key).map_err(of_both)
        }
        (chain, key) => Err(IdentityFaults { faults: chain.err().into_iter().chain(key.err()).collect() }),
    }
}

fn config(
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
) -> Result<Arc<ServerConfig>, tokio_rustls::rustls::Error> {
    // Given explicitly: other crates of the build may install another provider as the process's default.
    let builder = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let mut config =
        builder.with_safe_default_protocol_versions()?.with_no_client_auth().with_single_cert(chain, key)?;
    config.alpn_protocols = PROTOCOLS.map(<[u8]>::to_vec).into();
    Ok(Arc::new(config))
}

fn certificates_in((path, content): ReadFile<'_>) -> Result<Vec<CertificateDer<'static>>, String> {
    let content = content.map_err(|error| unreadable(path, "certificate", &pem::Error::Io(error)))?;
    match CertificateDer::pem_slice_iter(&content).collect::<Result<Vec<_>, _>>() {
        Ok(chain) if chain.is_empty() => Err(format!("{} holds no certificate in PEM", path.display())),
        Ok(chain) => Ok(chain),
        Err(error) => Err(unreadable(path, "certificate", &error)),
    }
}

fn key_in((path, content): ReadFile<'_>) -> Result<PrivateKeyDer<'static>, String> {
    let content = content.map_err(|error| unreadable(path, "private key", &pem::Error::Io(error)))?;
    PrivateKeyDer::from_pem_slice(&content).map_err(|error| {
        let has = |words: &[u8]| content.windows(words.len()).any(|part| part == words);
        // The form of PKCS 8, and the older one of OpenSSL.
        if has(b"-----BEGIN ENCRYPTED PRIVATE KEY-----") || has(b"Proc-Type: 4,ENCRYPTED") {
            return format!("{} is encrypted; a key without a passphrase is needed", path.display());
        }
        unreadable(path, "private key", &error)
    })
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
