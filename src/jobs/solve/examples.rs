//! Maneuvers to begin with, each of them complete.

use super::accept::accept;
use crate::contract::json;
use crate::contract::message::SolveRequest;
use crate::jobs::{Example, Limits};

/// All of them; the first is that of the documentation.
pub(super) const ALL: &[Example<SolveRequest>] = &[
    Example { name: "forward-drive", title: "5 m forward, the paper's case", request: forward_drive },
    Example { name: "half-turn", title: "Half a turn on the spot", request: half_turn },
    Example { name: "warehouse-aisle", title: "A loaded robot in an aisle", request: warehouse_aisle },
];

/// From rest to rest on the paper's grid, by the straight start alone: more starts find faster plans, which drift.
pub(super) fn forward_drive() -> SolveRequest {
    completed(br#"{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 200}, "solver": {"starts": 1}}"#)
}

fn half_turn() -> SolveRequest {
    completed(br#"{"maneuver": {"goal": {"heading_rad": 3.141592653589793}}}"#)
}

/// The worked example of `docs/limits.md`.
fn warehouse_aisle() -> SolveRequest {
    completed(include_bytes!("warehouse_aisle.json"))
}

fn completed(body: &[u8]) -> SolveRequest {
    let accepted = json::read_object(body).and_then(|request| accept(request, &Limits::default()));
    accepted.expect("the examples keep all rules").completed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_are_complete() {
        for Example { name, request, .. } in ALL {
            let body = json::write(&request());
            assert_eq!(json::write(&completed(&body)), body, "{name}");
        }
    }
}
