//! The bound flipping ratio test: how far the multipliers move along an edge of the dual, and what stops them.

use std::cmp::Ordering;

use super::pricing::Leaving;
use super::{ElasticSolver, GRADIENT_MARGIN, Rest, SUM_ROUNDING, TOLERANCE};
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
    /// The multiplier of the tight row at this position reaches a bound.
    Tight(usize),
    /// The multiplier of the leaving row reaches its other bound.
    OtherBound,
}

impl Kink {
    /// By steps, and of equal steps the larger fall first.
    fn order(&self, other: &Self) -> Ordering {
        self.step.total_cmp(&other.step).then_with(|| other.fall.total_cmp(&self.fall))
    }
}

impl ElasticSolver {
    /// The kink at which D stops to rise; none where no pivot is large enough.
    pub(super) fn first_kink_without_rise(&mut self, program: &ElasticProgram, leaving: Leaving) -> Option<Kink> {
        self.list_kinks(program, leaving);
        let stop = self.place_where_rise_ends(self.rise(program, leaving))?;
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

    /// The slope of D along the edge, at first.
    pub(super) fn rise(&self, program: &ElasticProgram, leaving: Leaving) -> f64 {
        match leaving {
            Leaving::Basic { position, sign } => {
                let column = self.basis.basic[position];
                if sign > 0.0 { program.lower[column] - self.x[column] } else { self.x[column] - program.upper[column] }
            }
            Leaving::Row { row, sign } => sign * self.value[row],
        }
    }

    fn list_kinks(&mut self, program: &ElasticProgram, leaving: Leaving) {
        let mut kinks = std::mem::take(&mut self.kinks);
        kinks.clear();
        // Slices: nalgebra's iterators look for the end of a column at every element.
        let ranges = self.direction.as_slice().iter().zip(self.range.as_slice());
        let total: f64 = ranges.map(|(change, range)| change.abs() * range).sum();
        let smallest = SUM_ROUNDING * total;
        let gradient_tolerance = self.gradient_tolerance();
        let bounds = program.lower.as_slice().iter().zip(program.upper.as_slice());
        let edges = self.gradient.as_slice().iter().zip(self.slope.as_slice()).zip(bounds);
        for (column, (((&gradient, &slope), (&lower, &upper)), (&rest, &is_basic))) in
            edges.zip(self.rest.iter().zip(&self.is_basic)).enumerate()
        {
            let next = Rest::by(slope);
            if is_basic || rest == next || slope.abs() * (upper - lower) <= smallest {
                continue;
            }
            let width = match rest {
                Rest::Lower | Rest::Upper => upper - lower,
                Rest::Zero if next == Rest::Lower => -lower,
                Rest::Zero => upper,
            };
            let is_zero = gradient.abs() <= gradient_tolerance;
            let step = if is_zero { 0.0 } else { -gradient / slope };
            let (fall, pivot) = (slope.abs() * width, slope.abs());
            kinks.push(Kink { step, fall, pivot, at: KinkAt::Variable(column) });
        }
        let until = |row: usize| {
            let (low, high) = self.multiplier_bounds(program, row);
            let (at, change) = (self.multiplier[row], self.direction[row]);
            (if change > 0.0 { high - at } else { at - low }).max(0.0) / change.abs()
        };
        let ends = |step: f64, pivot: f64, at: KinkAt| Kink { step, fall: f64::INFINITY, pivot, at };
        for (position, &row) in self.basis.tight.iter().enumerate() {
            let pivot = self.direction[row].abs();
            if pivot * self.range[row] > smallest {
                kinks.push(ends(until(row), pivot, KinkAt::Tight(position)));
            }
        }
        if let Leaving::Row { row, .. } = leaving {
            kinks.push(ends(until(row), 1.0, KinkAt::OtherBound));
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
        if kink.order(&pivot).is_lt() {
            fall += kink.fall;
            kinks.swap(middle, place);
            middle += 1;
        }
    }
    kinks.swap(middle, last);
    (middle, fall)
}
