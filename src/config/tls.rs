//! Loads certificate and key of the server, in builds with the feature `tls`.

use slipdrive::api::server::ServerSettings;

use super::faults::Faults;
use super::settings::ServeSettings;

/// The settings with the server's identity, where one is configured.
///
/// Adds a fault when certificate or key is missing, or when this build has no TLS: a server must not answer in plain
/// text where TLS is configured.
pub(super) fn with_identity(settings: &ServeSettings, server: ServerSettings, faults: &mut Faults) -> ServerSettings {
    match (&settings.tls_certificate, &settings.tls_key) {
        (None, None) => {}
        (Some(_), None) => faults.add("`tls_certificate` is set, `tls_key` must be set too".to_owned()),
        (None, Some(_)) => faults.add("`tls_key` is set, `tls_certificate` must be set too".to_owned()),
        #[cfg(feature = "tls")]
        (Some(certificate), Some(key)) => match slipdrive::api::server::tls::Identity::from_files(certificate, key) {
            Ok(identity) => return ServerSettings { identity: Some(identity), ..server },
            Err(identity) => identity.faults.into_iter().for_each(|fault| faults.add(fault)),
        },
        #[cfg(not(feature = "tls"))]
        (Some(_), Some(_)) => {
            faults.add("`tls_certificate` is set, but this program was built without TLS (feature `tls`)".to_owned());
        }
    }
    server
}

/// Connections that the admin port takes: probes and scrapers are few.
const ADMIN_CONNECTIONS: usize = 64;

/// The same timeouts without TLS: probes and scrapers speak plain text.
pub(crate) fn for_probes(server: &ServerSettings) -> ServerSettings {
    ServerSettings {
        max_connections: ADMIN_CONNECTIONS,
        #[cfg(feature = "tls")]
        identity: None,
        ..server.clone()
    }
}
