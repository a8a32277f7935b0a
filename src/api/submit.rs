//! One job of a request, from its accepted input to its answer, the same for every transport.

use std::sync::Arc;
use std::time::Instant;

use tokio::time::timeout_at;

use super::ApiState;
use super::access::Notes;
use super::auth::Credential;
use super::receive::memory_full;
use super::server::{Connection, Lease};
use crate::contract::{ErrorCode, Problem};
use crate::jobs::Kind;
use crate::service::{Permit, Running, ServiceError};

/// Whose job it is.
#[derive(Clone)]
pub(super) struct Caller {
    /// What the line in the log says of the jobs.
    pub(super) notes: Notes,
    /// When the answer is needed.
    pub(super) deadline: Option<Instant>,
    /// How the request came.
    pub(super) connection: Arc<Connection>,
    /// What it was admitted by.
    pub(super) credential: Credential,
}

/// An answer as a transport sends it.
pub(super) struct Written<T> {
    pub(super) answer: T,
    /// What it holds.
    pub(super) bytes: usize,
}

/// Queues an accepted job; its answer is written on the worker, and holds the lease from then on.
pub(super) fn start<K: Kind, T: Send + 'static>(
    kind: &Arc<K>,
    permit: Permit,
    input: K::Input,
    (caller, lease): (&Caller, &Arc<Lease>),
    write: impl FnOnce(K::Answer) -> Written<T> + Send + 'static,
) -> Result<Running<T, K::Progress>, Problem> {
    let (notes, lease) = (caller.notes.clone(), Arc::clone(lease));
    let running = permit.submit(Arc::clone(kind), input, caller.deadline, move |input, done| {
        notes.job(done.queue_wait, done.duration);
        let Written { answer, bytes } = write(K::answer(input, done));
        lease.settle(bytes);
        answer
    });
    Ok(running?)
}

/// The refusal of what comes after the end of the service.
pub(super) fn unavailable(state: &ApiState) -> Problem {
    let refused = state.service.check_open().err();
    refused.map_or_else(|| Problem::new(ErrorCode::Unavailable, "the server takes no more work"), Problem::from)
}

/// The answer to one item of a batch, and the memory that it holds. Waits for memory (`number_bytes` for each number of
/// the answer) and a permit, where single callers would be refused; the last quarter of the queue stays theirs.
pub(super) async fn answer_of_item<K: Kind, T: Send + 'static>(
    kind: &Arc<K>,
    state: &ApiState,
    input: K::Input,
    (caller, number_bytes): (&Caller, usize),
    write: impl FnOnce(K::Answer) -> Written<T> + Send + 'static,
) -> Result<(T, Arc<Lease>), Problem> {
    let bytes = K::answer_bytes(&input, number_bytes);
    let reserve = async {
        let lease = tokio::select! {
            lease = caller.connection.lease_at_last(bytes) => lease.ok_or_else(memory_full)?,
            () = state.service.closed() => return Err(unavailable(state)),
        };
        Ok((lease, state.service.reserve_for_batch(caller.credential.share(), K::CLASS).await?))
    };
    let (lease, permit) = match caller.deadline {
        Some(deadline) => {
            timeout_at(deadline.into(), reserve).await.unwrap_or_else(|_| Err(ServiceError::DeadlineExceeded.into()))?
        }
        None => reserve.await?,
    };
    let lease = Arc::new(lease);
    Ok((start(kind, permit, input, (caller, &lease), write)?.outcome().await?, lease))
}
