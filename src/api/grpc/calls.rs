//! One job of a call, from its accepted input to its answer.

use std::sync::Arc;

use tokio::time::timeout_at;

use super::admission::Call;
use crate::api::ApiState;
use crate::contract::Problem;
use crate::jobs::Kind;
use crate::service::{Permit, Running, ServiceError};

/// Queues an accepted job; its answer is written on the worker.
pub(super) fn start<K: Kind>(
    kind: &Arc<K>,
    permit: Permit,
    input: K::Input,
    call: &Call,
) -> Result<Running<K::Answer, K::Progress>, Problem> {
    let notes = call.notes.clone();
    let running = permit.submit(Arc::clone(kind), input, call.deadline, move |input, done| {
        notes.job(done.queue_wait, done.duration);
        K::answer(input, done)
    });
    Ok(running?)
}

/// The answer to one item. Waits for a permit, where single callers would be refused; the last quarter of the queue stays
/// theirs.
pub(super) async fn answer_of<K: Kind>(
    kind: &Arc<K>,
    state: &ApiState,
    request: K::Request,
    call: &Call,
) -> Result<K::Answer, Problem> {
    let input = K::accept(request, state.jobs.limits())?;
    let permit = match call.deadline {
        Some(deadline) => timeout_at(deadline.into(), state.service.reserve_for_batch())
            .await
            .unwrap_or(Err(ServiceError::DeadlineExceeded))?,
        None => state.service.reserve_for_batch().await?,
    };
    Ok(start(kind, permit, input, call)?.outcome().await?)
}
