//! One job of a request, from its accepted input to its answer, the same for every transport.

use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{MutexGuard, OwnedSemaphorePermit};
use tokio::time::timeout_at;

use super::ApiState;
use super::access::Notes;
use super::auth::Credential;
use super::receive::memory_full;
use super::server::{Connection, Lease, REQUEST_BYTES};
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

/// The right to be read and to wait for memory, which one item of a batch, and one of a connection, has at a time: what waits
/// holds memory that nothing counts yet.
pub(super) struct Entry<'a> {
    _of_batch: OwnedSemaphorePermit,
    _of_connection: MutexGuard<'a, ()>,
}

impl<'a> Entry<'a> {
    /// After the items of the connection that came before.
    pub(super) async fn of(caller: &'a Caller, of_batch: OwnedSemaphorePermit) -> Result<Self, Problem> {
        let turn = caller.connection.turn.lock();
        Ok(Self { _of_batch: of_batch, _of_connection: in_time(caller, async { Ok(turn.await) }).await? })
    }
}

/// What an item holds once it is read, bytes, for each byte that was sent: of a number in JSON, two, there are several copies of eight.
const READ_BYTES: usize = 8;

/// The answer to one item of a batch, which came as so many bytes, and the memory that it holds. Waits for memory (`number_bytes` for
/// each number of the answer) and a permit, where single callers would be refused; the last quarter of the queue stays theirs.
pub(super) async fn answer_of_item<K: Kind, T: Send + 'static>(
    kind: &Arc<K>,
    state: &ApiState,
    (input, item_bytes): (K::Input, usize),
    (caller, entry, number_bytes): (&Caller, Entry<'_>, usize),
    write: impl FnOnce(K::Answer) -> Written<T> + Send + 'static,
) -> Result<(T, Arc<Lease>), Problem> {
    let item_bytes = REQUEST_BYTES + READ_BYTES * item_bytes;
    let answer_bytes = K::answer_bytes(&input, number_bytes);
    let reserve = async {
        let lease = tokio::select! {
            lease = caller.connection.lease_at_last(answer_bytes, item_bytes) => lease.ok_or_else(memory_full)?,
            () = state.service.closed() => return Err(unavailable(state)),
        };
        drop(entry);
        Ok((lease, state.service.reserve_for_batch(caller.credential.share(), K::CLASS).await?))
    };
    let (lease, permit) = in_time(caller, reserve).await?;
    let lease = Arc::new(lease);
    Ok((start(kind, permit, input, (caller, &lease), write)?.outcome().await?, lease))
}

/// Before the caller's deadline.
async fn in_time<T>(caller: &Caller, work: impl Future<Output = Result<T, Problem>>) -> Result<T, Problem> {
    match caller.deadline {
        Some(deadline) => {
            timeout_at(deadline.into(), work).await.unwrap_or_else(|_| Err(ServiceError::DeadlineExceeded.into()))
        }
        None => work.await,
    }
}
