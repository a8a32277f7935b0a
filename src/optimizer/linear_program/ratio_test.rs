//! The bound flipping ratio test: how far the multipliers move along an edge of the dual, and what stops them.

use super::pricing::Leaving;
use super::{ElasticSolver, GRADIENT_MARGIN, Rest, SUM_ROUNDING, TOLERANCE, range};
use crate::optimizer::elastic_program::ElasticProgram;

/// A kink of D along the edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kink {
    pub(super) step: f64,
    /// By how much the slope of D falls; infinite where the edge ends.
    fall: f64,
    pivot: f64,
    pub(super) at: KinkAt,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KinkAt {
    /// The gradient of a variable passes zero.
    Variable(usize),
    /// The multiplier of a row, a tight one or that which leaves its place, reaches a bound.
    Row(usize),
}

impl ElasticSolver {
    /// The kink at which D, with this slope at first, stops to rise; none where no pivot is large enough.
    pub(super) fn first_kink_without_rise(&mut self, rise: f64) -> Option<Kink> {
        let stop = self.place_where_rise_ends(rise)?;
        for kink in &self.kinks[..stop] {
            if let KinkAt::Variable(column) = kink.at {
                self.rest[column] = Rest::by(self.slope[column]);
            }
        }
        let last = self.kinks[stop];
        let same = |kink: &&Kink| (kink.step - last.step).abs() <= TOLERANCE * last.step;
        let near = self.kinks.iter().filter(same);
        near.max_by(|a, b| a.pivot.total_cmp(&b.pivot)).copied()
    }

    /// The place of the kink at which D, with this slope at first, stops to rise; those before it along the edge come before it. By
    /// quickselect, in which falls are added up: few kinks are passed, and the others need no order.
    fn place_where_rise_ends(&mut self, mut rise: f64) -> Option<usize> {
        let (mut start, mut end) = (0, self.kinks.len());
        while start < end {
            let (middle, fall) = split(&mut self.kinks[start..end]);
            let middle = start + middle;
            if rise <= fall {
                end = middle;
                continue;
            }
            rise -= fall + self.kinks[middle].fall;
            if rise <= 0.0 {
                return Some(middle);
            }
            start = middle + 1;
        }
        // The rise ends before this one, but for the rounding of sums.
        (end < self.kinks.len()).then_some(end)
    }

    /// Gradients closer to zero are rounding.
    pub(super) fn gradient_tolerance(&self) -> f64 {
        self.small_gradient.max(GRADIENT_MARGIN * self.gradient_error)
    }

    /// Finds the kinks along the edge, in any order.
    pub(super) fn list_kinks(&mut self, program: &ElasticProgram, leaving: Leaving) {
        let mut kinks = std::mem::take(&mut self.kinks);
        kinks.clear();
        // Slices: nalgebra's iterators look for the end of a column at every element.
        let smallest = SUM_ROUNDING * range(self.direction.as_slice(), self.range.as_slice());
        let gradient_tolerance = self.gradient_tolerance();
        let bounds = program.lower.as_slice().iter().zip(program.upper.as_slice());
        let edges = self.gradient.as_slice().iter().zip(self.slope.as_slice()).zip(bounds);
        for (column, (((&gradient, &slope), (&lower, &upper)), (&rest, &is_basic))) in
            edges.zip(self.rest.iter().zip(&self.is_basic)).enumerate()
        {
            let (next, pivot) = (Rest::by(slope), slope.abs());
            if is_basic || rest == next || pivot * (upper - lower) <= smallest {
                continue;
            }
            let width = match rest {
                Rest::Lower | Rest::Upper => upper - lower,
                Rest::Zero if next == Rest::Lower => -lower,
                Rest::Zero => upper,
            };
            let step = if gradient.abs() <= gradient_tolerance { 0.0 } else { -gradient / slope };
            kinks.push(Kink { step, fall: pivot * width, pivot, at: KinkAt::Variable(column) });
        }
        let end_at_bound = |row: usize| {
            let (low, high) = self.multiplier_bounds(program, row);
            let (at, change) = (self.multiplier[row], self.direction[row]);
            let step = (if change > 0.0 { high - at } else { at - low }).max(0.0) / change.abs();
            Kink { step, fall: f64::INFINITY, pivot: change.abs(), at: KinkAt::Row(row) }
        };
        let moves = |row: &usize| self.direction[*row].abs() * self.range[*row] > smallest;
        kinks.extend(self.basis.tight.iter().copied().filter(moves).map(end_at_bound));
        if let Leaving::Row { row, .. } = leaving {
            kinks.push(end_at_bound(row));
        }
        self.kinks = kinks;
    }
}

/// Puts the kinks before that in the middle first and that one next; its place, and by how much the slope falls before it.
fn split(kinks: &mut [Kink]) -> (usize, f64) {
    let last = kinks.len() - 1;
    kinks.swap(last / 2, last);
    let pivot = kinks[last];
    let (mut middle, mut fall) = (0, 0.0);
    for place in 0..last {
        let kink = kinks[place];
        // By steps, and of equal steps the larger fall first.
        if kink.step.total_cmp(&pivot.step).then_with(|| pivot.fall.total_cmp(&kink.fall)).is_lt() {
            fall += kink.fall;
            kinks.swap(middle, place);
            middle += 1;
        }
    }
    kinks.swap(middle, last);
    (middle, fall)
}
