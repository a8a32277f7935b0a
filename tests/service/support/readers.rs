//! Any bytes to all readers of requests: none panics, and what is accepted means the same when it is written again.
//!
//! Shared by the tests and by the fuzz target in `fuzz/`.

use std::fmt::Debug;

use prost::Message;
use slipdrive::contract::json;
use slipdrive::jobs::assess::Assess;
use slipdrive::jobs::export::Export;
use slipdrive::jobs::present::Present;
use slipdrive::jobs::simulate::Simulate;
use slipdrive::jobs::solve::Solve;
use slipdrive::jobs::{Kind, Limits};
use slipdrive::service::Job as _;

/// The names of the kinds of jobs whose readers are tried.
pub(crate) const KINDS: [&str; 5] = [Solve::NAME, Simulate::NAME, Present::NAME, Export::NAME, Assess::NAME];

/// Gives the bytes to every reader; whether any of them accepts the bytes.
///
/// # Panics
/// When a reader panics, or when an accepted request means something else once it is written again.
pub(crate) fn is_accepted(bytes: &[u8]) -> bool {
    let is_solve = is_accepted_by::<Solve>(bytes);
    let is_simulate = is_accepted_by::<Simulate>(bytes);
    let is_present = is_accepted_by::<Present>(bytes);
    let is_export = is_accepted_by::<Export>(bytes);
    let is_assess = is_accepted_by::<Assess>(bytes);
    if let Ok(accepted) = Solve::read(bytes, &Limits::default()) {
        let again = Solve::read(&json::write(&accepted.completed), &Limits::default());
        let again = again.expect("the completed body is accepted");
        assert_eq!(again.input_hash, accepted.input_hash, "the completed body means the same");
    }
    is_solve || is_simulate || is_present || is_export || is_assess
}

fn is_accepted_by<K: Kind>(bytes: &[u8]) -> bool
where
    K::Request: Message + Default + Debug + Clone,
    K::Input: Debug,
{
    let limits = Limits::default();
    let from_json = K::read(bytes, &limits);
    if let Ok(input) = &from_json {
        let request = serde_json::from_slice::<K::Request>(bytes).expect("what is accepted is of its form");
        means_the_same::<K>(input, &request);
    }
    let Ok(request) = K::Request::decode(bytes) else { return from_json.is_ok() };
    let from_protobuf = K::accept(request.clone(), &limits);
    if let Ok(input) = &from_protobuf {
        means_the_same::<K>(input, &request);
    }
    from_json.is_ok() || from_protobuf.is_ok()
}

/// Requires a request to be accepted as this input, its hash included, after it was written as protobuf.
fn means_the_same<K: Kind>(input: &K::Input, request: &K::Request)
where
    K::Request: Message + Default + Debug,
    K::Input: Debug,
{
    let written = request.encode_to_vec();
    let again = K::Request::decode(written.as_slice()).expect("own messages are read");
    // Its fields are numbers and names; text shows the sign of zeros too.
    let is_same = format!("{again:?}") == format!("{request:?}");
    let again = K::accept(again, &Limits::default()).expect("what was accepted is accepted again");
    // The encoder of protobuf leaves out zeros, negative ones included, and the hash tells the two apart.
    assert!(
        !is_same || format!("{again:?}") == format!("{input:?}"),
        "a request of {} means something else once it is written again",
        K::NAME
    );
}
