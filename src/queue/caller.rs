//! Whose jobs are queued, and how callers take turns.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// One of the callers whose jobs take turns; the default one is whoever is not told apart.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct CallerId(u64);

impl CallerId {
    /// One that nobody had before.
    pub fn unique() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// Where one more job of a caller comes among those of `waiting`: before all jobs whose own callers have more jobs before
/// them. The first job of each caller keeps its place, so that everyone gets on.
pub(super) fn turn(waiting: impl ExactSizeIterator<Item = CallerId> + Clone, caller: CallerId) -> usize {
    let (end, own) = (waiting.len(), waiting.clone().filter(|of| *of == caller).count());
    let mut passed: BTreeMap<CallerId, usize> = BTreeMap::new();
    let mut has_more_before = |of: CallerId| {
        let before = passed.entry(of).or_default();
        *before += 1;
        *before - 1 > own
    };
    waiting.enumerate().find(|(_, of)| has_more_before(*of)).map_or(end, |(place, _)| place)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The order in which jobs wait that come in the order of these letters, one for each caller.
    fn queued(coming: &str) -> String {
        let mut waiting: Vec<(CallerId, char)> = Vec::new();
        for letter in coming.chars() {
            let caller = CallerId(letter.into());
            let place = turn(waiting.iter().map(|(of, _)| *of), caller);
            waiting.insert(place, (caller, letter));
        }
        waiting.iter().map(|(_, letter)| letter).collect()
    }

    #[test]
    fn jobs_of_one_caller_stay_in_their_order() {
        assert_eq!(turn([CallerId(1); 3].into_iter(), CallerId(1)), 3);
        assert_eq!(turn([].into_iter(), CallerId(1)), 0);
    }

    #[test]
    fn callers_take_turns() {
        assert_eq!(queued("aaab"), "abaa");
        assert_eq!(queued("aaabbb"), "ababab");
        assert_eq!(queued("aaabcbc"), "abcabca");
        assert_eq!(queued("abab"), "abab");
    }

    #[test]
    fn first_job_of_each_caller_is_never_passed() {
        for others in ["b", "bc", "bcd"] {
            assert!(queued(&format!("aa{others}")).starts_with('a'));
        }
    }
}
