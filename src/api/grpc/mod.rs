//! gRPC: `slipdrive.v1.ManeuverService` with health and reflection, over the same messages and rules as REST.

mod admission;
mod batch;
mod border;
mod convert_request;
mod convert_response;
mod handlers;
mod health;
pub mod pb;
mod status;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::middleware::from_fn_with_state;
use axum::response::Response;
pub use health::Health;
use tonic::service::Routes;
use tower_http::catch_panic::CatchPanicLayer;

use self::pb::maneuver_service_server::ManeuverServiceServer;
use super::error_table::ErrorCode;
use super::problem::Problem;
use super::{ApiSettings, Door};
use crate::service::Service;

/// All gRPC services over one service, and the reporter of their health.
pub async fn router(service: Arc<Service>, settings: ApiSettings) -> (Router, Health) {
    let door = Door { service, settings: Arc::new(settings) };
    let limit = door.service.limits().max_body_bytes;
    let maneuvers = ManeuverServiceServer::new(handlers::Handlers(door.clone())).max_decoding_message_size(limit);
    let (reporter, health_service) = tonic_health::server::health_reporter();
    let health = Health::begin(reporter, &door.service).await;
    let mut routes = Routes::builder();
    routes.add_service(maneuvers).add_service(health_service);
    add_reflection(&mut routes);
    let router = routes
        .routes()
        .prepare()
        .into_axum_router()
        .layer(CatchPanicLayer::custom(|panic: Box<dyn Any + Send>| status_of_panic(panic.as_ref())))
        .layer(from_fn_with_state(door, border::pass));
    (router, health)
}

/// Both versions: many tools still ask for the older one.
fn add_reflection(routes: &mut tonic::service::RoutesBuilder) {
    let builder = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(pb::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    match (builder().build_v1(), builder().build_v1alpha()) {
        (Ok(current), Ok(older)) => {
            routes.add_service(current).add_service(older);
        }
        (Err(error), _) | (_, Err(error)) => tracing::error!(error = %error, "there is no reflection"),
    }
}

fn status_of_panic(panic: &(dyn Any + Send)) -> Response {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    tracing::error!(panic.message = text.unwrap_or("none"), "a handler panicked");
    let mut response = Response::default();
    response.extensions_mut().insert(Problem::new(ErrorCode::Internal, "the log holds the cause"));
    response
}
