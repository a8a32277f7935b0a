//! gRPC: `slipdrive.v1.ManeuverService` with health and reflection, over the same messages and rules as REST.

mod admission;
mod batch;
mod framed_body;
mod handlers;
mod health;
mod middleware;
pub mod pb;
mod status;
mod until_closing;

use std::sync::Arc;

use axum::Router;
use axum::middleware::from_fn_with_state;
pub use health::Health;
use tonic::service::Routes;

use self::pb::maneuver_service_server::ManeuverServiceServer;
use super::{ApiState, panic};

/// All gRPC services of a server, and the reporter of their health.
pub async fn router(state: &ApiState) -> (Router, Health) {
    let methods = Arc::new(admission::Methods::of(&state.jobs));
    let limit = methods.longest_message().bytes;
    let passage = middleware::Passage { methods, state: state.clone() };
    let maneuvers = ManeuverServiceServer::new(handlers::Handlers(state.clone())).max_decoding_message_size(limit);
    let (reporter, health_service) = tonic_health::server::health_reporter();
    let health = Health::begin(reporter, &state.service).await;
    let mut routes = Routes::builder();
    routes.add_service(maneuvers).add_service(health_service);
    add_reflection(&mut routes);
    let router = routes
        .routes()
        .prepare()
        .into_axum_router()
        .layer(panic::answered())
        .layer(from_fn_with_state(passage, middleware::pass));
    (router, health)
}

/// Longest question of reflection, bytes: the name of a symbol or a file.
const REFLECTION_MESSAGE_BYTES: usize = 1024;

/// Both versions: many tools still ask for the older one.
fn add_reflection(routes: &mut tonic::service::RoutesBuilder) {
    let builder = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(pb::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    match (builder().build_v1(), builder().build_v1alpha()) {
        (Ok(current), Ok(older)) => {
            let current = current.max_decoding_message_size(REFLECTION_MESSAGE_BYTES);
            routes.add_service(current).add_service(older.max_decoding_message_size(REFLECTION_MESSAGE_BYTES));
        }
        (Err(error), _) | (_, Err(error)) => tracing::error!(error = %error, "there is no reflection"),
    }
}
