//! The friction directions of each contact, as indices.

use super::pattern::{ContactMode, ContactPattern};

/// Left longitudinal direction.
pub(super) const LEFT: usize = 0;
/// Right longitudinal direction.
pub(super) const RIGHT: usize = 1;
/// Lateral direction that both wheels share.
pub(super) const AXLE: usize = 2;

/// (longitudinal, lateral) direction of left wheel, right wheel and front support.
pub(super) const ROWS: [[usize; 2]; 3] = [[LEFT, AXLE], [RIGHT, AXLE], [3, 4]];

/// Number of contacts with friction among `N` directions.
pub(super) const fn contact_count<const N: usize>() -> usize {
    if N == 5 { 3 } else { 2 }
}

/// Which of the `N` directions stick in a pattern.
pub(super) fn sticking<const N: usize>(pattern: ContactPattern) -> [bool; N] {
    let mut sticks = [false; N];
    for (rows, mode) in ROWS.into_iter().zip(pattern.modes()).take(contact_count::<N>()) {
        if mode == ContactMode::Stick {
            for row in rows {
                sticks[row] = true;
            }
        }
    }
    sticks
}
