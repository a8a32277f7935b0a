//! One job of a call, from its accepted input to its answer.

use std::sync::Arc;

use prost::Message as _;
use tokio::time::timeout_at;

use super::admission::Call;
use crate::api::ApiState;
use crate::api::receive::memory_full;
use crate::api::server::Lease;
use crate::contract::{ErrorCode, Problem};
use crate::jobs::Kind;
use crate::service::{Permit, Running, ServiceError};

/// Length of a number in an answer, bytes.
const NUMBER_BYTES: usize = size_of::<f64>();

/// What the answer to this input will probably hold; settled when it is written.
pub(super) fn answer_bytes<K: Kind>(input: &K::Input) -> usize {
    K::answer_numbers(input) * NUMBER_BYTES
}

/// Queues an accepted job; its answer is written on the worker, and holds the lease from then on.
pub(super) fn start<K: Kind>(
    kind: &Arc<K>,
    permit: Permit,
    input: K::Input,
    call: &Call,
    lease: &Arc<Lease>,
) -> Result<Running<K::Answer, K::Progress>, Problem> {
    let (notes, lease) = (call.notes.clone(), Arc::clone(lease));
    let running = permit.submit(Arc::clone(kind), input, call.deadline, move |input, done| {
        notes.job(done.queue_wait, done.duration);
        let answer = K::answer(input, done);
        lease.settle(answer.encoded_len());
        answer
    });
    Ok(running?)
}

/// The refusal of what comes after the end of the service.
pub(super) fn unavailable(state: &ApiState) -> Problem {
    let refused = state.service.check_open().err();
    refused.map_or_else(|| Problem::new(ErrorCode::Unavailable, "the server takes no more work"), Problem::from)
}

/// The answer to one item, and the memory that it holds. Waits for memory and a permit, where single callers would be
/// refused; the last quarter of the queue stays theirs.
pub(super) async fn answer_of<K: Kind>(
    kind: &Arc<K>,
    state: &ApiState,
    request: K::Request,
    call: &Call,
) -> Result<(K::Answer, Arc<Lease>), Problem> {
    let input = K::accept(request, state.jobs.limits())?;
    let bytes = answer_bytes::<K>(&input);
    let reserve = async {
        let lease = tokio::select! {
            lease = call.connection.lease_at_last(bytes) => lease.ok_or_else(memory_full)?,
            () = state.service.closed() => return Err(unavailable(state)),
        };
        Ok((lease, state.service.reserve_for_batch(K::CLASS).await?))
    };
    let (lease, permit) = match call.deadline {
        Some(deadline) => {
            timeout_at(deadline.into(), reserve).await.unwrap_or_else(|_| Err(ServiceError::DeadlineExceeded.into()))?
        }
        None => reserve.await?,
    };
    let lease = Arc::new(lease);
    Ok((start(kind, permit, input, call, &lease)?.outcome().await?, lease))
}
