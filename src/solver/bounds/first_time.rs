//! The first time at which an upper bound of what can be covered reaches what is required.

/// Times beyond this, s, count as infinite: far above the longest final time that is searched.
const INFINITE_TIME: f64 = 1e15;
/// Resolution of the search, s.
const SHORTEST: f64 = 1e-4;
/// Least growth of the time until it is long enough.
const GROWTH: f64 = 4.0;
/// Most looks: ten are usual.
const LOOKS: usize = 100;
/// Relative width at which the search ends.
pub(super) const WIDTH: f64 = 1e-5;
/// Every so many times the span is halved, whatever has been learnt about it.
const HALVING_PERIOD: usize = 3;

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

/// Upper bounds of what can be covered by the end of a span of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cover {
    /// In all of it.
    pub(super) at_end: f64,
    /// In any time within it, by what is known of its end.
    pub(super) within: f64,
}

impl Cover {
    /// More at the end than before.
    pub(super) fn growing(at_end: f64) -> Self {
        Self { at_end, within: at_end }
    }
}

/// A time before which, from `not_before` on, nothing covers as much as `required`; infinite when nothing ever
/// does.
///
/// `cover(a, b)` bounds what can be covered in any time from a to b, so a whole span is ruled out at once and nothing is assumed
/// about monotony. A cover that is not a number rules nothing out. Where to look next is a guess, as if covers grew with
/// powers of the time.
pub(super) fn first_time(not_before: f64, required: f64, floor: Floor, cover: impl Fn(f64, f64) -> Cover) -> f64 {
    let known = if floor.is_proven { floor.time.max(not_before) } else { not_before };
    if known >= INFINITE_TIME {
        return f64::INFINITY;
    }
    let mut ruled_out = Look { time: known, cover: cover(known, known) };
    if !ruled_out.rules_out(required) {
        return known;
    }
    // The earliest time that is known to do, and one before a look that could not say.
    let (mut open, mut nearer): (Option<Look>, Option<f64>) = (None, None);
    for count in 1..=LOOKS {
        let is_close = |time: f64| time - ruled_out.time <= WIDTH * time || time <= SHORTEST;
        if open.as_ref().is_some_and(|open| is_close(open.time)) || nearer.is_some_and(is_close) {
            break;
        }
        let time = nearer.take().unwrap_or_else(|| match &open {
            Some(open) if count.is_multiple_of(HALVING_PERIOD) => middle(ruled_out.time, open.time),
            Some(open) => ruled_out.crossing(open, required).unwrap_or_else(|| middle(ruled_out.time, open.time)),
            None => ruled_out.later(required),
        });
        let next = Look { time, cover: cover(ruled_out.time, time) };
        if next.rules_out(required) {
            if time >= INFINITE_TIME {
                return f64::INFINITY;
            }
            ruled_out = next;
        } else if next.cover.at_end < required {
            nearer = Some(middle(ruled_out.time, time));
        } else {
            open = Some(next);
        }
    }
    ruled_out.time
}

/// A time with what can be covered by then.
struct Look {
    time: f64,
    cover: Cover,
}

impl Look {
    fn rules_out(&self, required: f64) -> bool {
        self.cover.within < required
    }

    /// A later time that may do: accelerations cover squares of times.
    fn later(&self, required: f64) -> f64 {
        let growth = (required / self.cover.at_end).sqrt();
        self.time.max(SHORTEST) * if growth.is_finite() && growth > GROWTH { growth } else { GROWTH }
    }

    /// Near where the power of the time through two looks reaches what is required, on the side of it that has the further look;
    /// none where no power leads through them.
    fn crossing(&self, open: &Self, required: f64) -> Option<f64> {
        let power = (open.cover.at_end / self.cover.at_end).ln() / (open.time / self.time).ln();
        let crossing = self.time * ((required / self.cover.at_end).ln() / power).exp();
        let is_open_further = open.time - crossing > crossing - self.time;
        let near = crossing * (1.0 + if is_open_further { 0.25 * WIDTH } else { -0.25 * WIDTH });
        (self.time < near && near < open.time).then_some(near)
    }
}

/// The geometric mean, with the start no nearer to zero than the resolution.
fn middle(from: f64, to: f64) -> f64 {
    (from.max(SHORTEST) * to).sqrt()
}

/// As [`first_time`] from the beginning; zero where it is no later than the floor, as something covers as much by then.
pub(super) fn first_time_beyond(floor: Floor, required: f64, cover: impl Fn(f64, f64) -> Cover) -> f64 {
    let matters = cover(floor.time, floor.time).within < required;
    if matters { first_time(0.0, required, floor, cover) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_two_crossings_is_found() {
        // A bump of 1 between 3 and 4, and growth beyond 5.
        let at = |time: f64| if (3.0..=4.0).contains(&time) { 1.0 } else { time - 5.0 };
        let within = |from: f64, to: f64| if from <= 4.0 && to >= 3.0 { 1.0 } else { to - 5.0 };
        let cover = |from, to| Cover { at_end: at(to), within: within(from, to) };
        let first = first_time(0.0, 0.5, Floor::ZERO, cover);
        assert!(first <= 3.0 && first > 3.0 - 1e-4, "{first}");
    }

    #[test]
    fn times_that_are_excluded_are_not_looked_at() {
        let floor = Floor { time: 3.0, is_proven: true };
        let cover = |_: f64, to: f64| {
            assert!(to >= floor.time);
            Cover::growing(to)
        };
        assert_is_first(first_time(0.0, 5.0, floor, cover), 5.0);
    }

    #[test]
    fn few_looks_find_where_powers_cross() {
        for (power, most) in [(1, 10), (2, 6), (3, 8)] {
            let looks = std::cell::Cell::new(0);
            let cover = |_: f64, to: f64| {
                looks.set(looks.get() + 1);
                Cover::growing(0.3 * to.powi(power))
            };
            assert_is_first(first_time(0.0, 0.3 * 7.0_f64.powi(power), Floor::ZERO, cover), 7.0);
            assert!(looks.get() <= most, "{power}: {}", looks.get());
        }
    }

    #[test]
    fn spans_that_say_too_little_are_cut() {
        // Within a span a tenth more than at its end seems possible.
        let cover = |from: f64, to: f64| Cover { at_end: to, within: to + 0.1 * (to - from) };
        assert_is_first(first_time(0.0, 5.0, Floor::ZERO, cover), 5.0);
    }

    fn assert_is_first(first: f64, crossing: f64) {
        assert!(first <= crossing && first >= crossing * (1.0 - WIDTH), "{first}");
    }

    #[test]
    fn what_is_covered_at_once_needs_no_time() {
        assert_eq!(first_time(0.5, -1.0, Floor::ZERO, |_, _| Cover::growing(0.0)), 0.5);
    }

    #[test]
    fn what_is_never_covered_takes_infinitely_long() {
        assert_eq!(first_time(0.0, 1.0, Floor::ZERO, |_, _| Cover::growing(0.5)), f64::INFINITY);
        assert_eq!(first_time(f64::INFINITY, 1.0, Floor::ZERO, |_, _| Cover::growing(2.0)), f64::INFINITY);
        assert_eq!(first_time(0.0, 1.0, Floor::ZERO, |_, _| Cover::growing(f64::NAN)), 0.0);
    }
}
