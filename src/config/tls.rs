//! Certificate and key of the server.

use std::path::PathBuf;

use clap::Args;
use slipdrive::api::server::ServerSettings;

/// TLS on both ports, in builds with the feature `tls`.
#[derive(Debug, Default, Args)]
pub(crate) struct TlsArguments {
    /// File with the certificate chain in PEM, the server's own first. With it, both ports speak TLS only.
    #[arg(long, env = "SLIPDRIVE_TLS_CERTIFICATE", value_name = "FILE")]
    pub(crate) tls_certificate: Option<PathBuf>,
    /// File with the private key of the certificate in PEM.
    #[arg(long, env = "SLIPDRIVE_TLS_KEY", value_name = "FILE")]
    pub(crate) tls_key: Option<PathBuf>,
}

impl TlsArguments {
    /// The settings with the server's identity, where one is configured.
    ///
    /// # Errors
    /// When one of both files is missing or cannot be used, with all faults, or when this build has no TLS: a server
    /// must not answer in plain text where TLS is meant.
    pub(crate) fn applied_to(&self, settings: ServerSettings) -> anyhow::Result<ServerSettings> {
        match (&self.tls_certificate, &self.tls_key) {
            (None, None) => Ok(settings),
            (Some(_), None) => anyhow::bail!("`--tls-certificate` is set, `--tls-key` must be set too"),
            (None, Some(_)) => anyhow::bail!("`--tls-key` is set, `--tls-certificate` must be set too"),
            #[cfg(feature = "tls")]
            (Some(certificate), Some(key)) => {
                let identity = slipdrive::api::server::tls::Identity::from_files(certificate, key)?;
                Ok(ServerSettings { identity: Some(identity), ..settings })
            }
            #[cfg(not(feature = "tls"))]
            (Some(_), Some(_)) => {
                anyhow::bail!("`--tls-certificate` is set, but this program was built without TLS (feature `tls`)")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(certificate: Option<&str>, key: Option<&str>) -> String {
        let arguments = TlsArguments { tls_certificate: certificate.map(Into::into), tls_key: key.map(Into::into) };
        arguments.applied_to(ServerSettings::default()).unwrap_err().to_string()
    }

    #[test]
    fn half_an_identity_is_refused() {
        assert!(error_of(Some("a"), None).contains("`--tls-key` must be set"));
        assert!(error_of(None, Some("b")).contains("`--tls-certificate` must be set"));
    }

    #[test]
    fn unusable_identity_is_refused_and_never_ignored() {
        let error = error_of(Some("/nonexistent/a"), Some("/nonexistent/b"));
        if cfg!(feature = "tls") {
            assert!(
                error.contains("/nonexistent/a") && error.contains("/nonexistent/b"),
                "all faults at once: {error}"
            );
        } else {
            assert!(error.contains("built without TLS"), "{error}");
        }
    }
}
