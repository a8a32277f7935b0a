//! The first time at which an upper bound of what can be covered reaches what is required.

/// Times beyond this, s, count as infinite: far above the longest final time that is searched.
const INFINITE_TIME: f64 = 1e15;
/// Resolution of the search, s.
const SHORTEST: f64 = 1e-4;
const GROWTH: f64 = 4.0;
const REFINEMENT_LIMIT: usize = 60;
/// Relative width at which the refinement ends.
const WIDTH: f64 = 1e-5;

/// What is known before a bound is worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Floor {
    /// Bounds up to this time, s, do not matter.
    pub(super) time: f64,
    /// Whether no plan is faster, so that earlier times need no look.
    pub(super) is_proven: bool,
}

impl Floor {
    /// Every bound matters.
    pub(super) const ZERO: Self = Self { time: 0.0, is_proven: true };
}

/// A time before which, from `not_before` on, nothing covers as much as `required`; infinite when nothing ever
/// does.
///
/// `cover(a, b)` bounds from above what can be covered in any time from a to b, so a whole span is ruled out at once and
/// nothing is assumed about monotony. A cover that is not a number rules nothing out.
pub(super) fn first_time(not_before: f64, required: f64, floor: Floor, cover: impl Fn(f64, f64) -> f64) -> f64 {
    let is_proven = |time: f64| floor.is_proven && 0.0 < time && time <= floor.time;
    let rules_out = |from: f64, to: f64| is_proven(to) || cover(from, to) < required;
    if not_before >= INFINITE_TIME {
        return f64::INFINITY;
    }
    if !rules_out(not_before, not_before) {
        return not_before;
    }
    let mut ruled_out = not_before;
    let mut open = GROWTH * not_before.max(SHORTEST);
    while rules_out(ruled_out, open) {
        if open >= INFINITE_TIME {
            return f64::INFINITY;
        }
        ruled_out = open;
        open *= GROWTH;
    }
    for _ in 0..REFINEMENT_LIMIT {
        if open - ruled_out <= WIDTH * open || open <= SHORTEST {
            break;
        }
        let middle = 0.5 * (ruled_out + open);
        if rules_out(ruled_out, middle) {
            ruled_out = middle;
        } else {
            open = middle;
        }
    }
    ruled_out
}

/// Whether nothing covers as much as `required` at a time; if something does, the first time that does is no later.
pub(super) fn rules_out(time: f64, required: f64, cover: &impl Fn(f64, f64) -> f64) -> bool {
    cover(time, time) < required
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_two_crossings_is_found() {
        // A bump of 1 between 3 and 4, and growth beyond 5.
        let cover = |from: f64, to: f64| {
            let meets_bump = from <= 4.0 && to >= 3.0;
            if meets_bump { 1.0 } else { to - 5.0 }
        };
        let first = first_time(0.0, 0.5, Floor::ZERO, cover);
        assert!(first <= 3.0 && first > 3.0 - 1e-4, "{first}");
    }

    #[test]
    fn times_that_are_excluded_are_not_looked_at() {
        let floor = Floor { time: 3.0, is_proven: true };
        let cover = |_: f64, to: f64| {
            assert!(to == 0.0 || to > floor.time);
            to
        };
        assert_eq!(first_time(0.0, 5.0, floor, cover), first_time(0.0, 5.0, Floor::ZERO, |_, to| to));
    }

    #[test]
    fn what_is_covered_at_once_needs_no_time() {
        assert_eq!(first_time(0.5, -1.0, Floor::ZERO, |_, _| 0.0), 0.5);
    }

    #[test]
    fn what_is_never_covered_takes_infinitely_long() {
        assert_eq!(first_time(0.0, 1.0, Floor::ZERO, |_, _| 0.5), f64::INFINITY);
        assert_eq!(first_time(f64::INFINITY, 1.0, Floor::ZERO, |_, _| 2.0), f64::INFINITY);
        assert_eq!(first_time(0.0, 1.0, Floor::ZERO, |_, _| f64::NAN), 0.0);
    }
}
