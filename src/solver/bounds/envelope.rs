//! The lowest of some curves of straight pieces over a span of time, and integrals of it.

use super::curve::{Curve, Segment};

/// A span on which one line is the lowest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Piece {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) value_from: f64,
    pub(super) value_to: f64,
    /// Index of the curve.
    pub(super) curve: usize,
}

impl Piece {
    pub(super) fn area(&self) -> f64 {
        0.5 * (self.to - self.from) * (self.value_from + self.value_to)
    }

    /// The part of the piece up to `time`.
    pub(super) fn until(&self, time: f64) -> Self {
        let length = self.to - self.from;
        let share = if length > 0.0 { ((time - self.from) / length).clamp(0.0, 1.0) } else { 1.0 };
        let value_to = self.value_from + share * (self.value_to - self.value_from);
        Self { to: self.from + share * length, value_to, ..*self }
    }

    /// Integral of the third power: the length times the mean of a^j b^(3 - j).
    fn cubic_area(&self) -> f64 {
        let (a, b) = (self.value_from, self.value_to);
        0.5 * (self.to - self.from) * (a + b) * (0.5 * (a * a + b * b))
    }
}

/// The lowest one, piece by piece.
#[derive(Debug, Clone)]
pub(super) struct Envelope {
    pieces: Vec<Piece>,
    /// The area before each piece.
    areas_before: Vec<f64>,
}

impl Envelope {
    /// Over the span of the curves, which are equally long.
    pub(super) fn new(curves: &[&Curve]) -> Self {
        let segment_count = curves.iter().map(|curve| curve.segments().len()).sum();
        let mut envelope =
            Self { pieces: Vec::with_capacity(segment_count), areas_before: Vec::with_capacity(segment_count) };
        let mut rest: Vec<_> = curves.iter().map(|curve| curve.segments().iter()).collect();
        let firsts: Option<Vec<Segment>> = rest.iter_mut().map(|segments| segments.next().copied()).collect();
        let mut segments = firsts.unwrap_or_default();
        let (mut from, mut is_over) = (0.0, segments.is_empty());
        while !is_over {
            let to = segments.iter().fold(f64::INFINITY, |least, segment| segment.to.min(least));
            envelope.extend(&segments, from, to);
            for (segment, rest) in segments.iter_mut().zip(&mut rest).filter(|(segment, _)| segment.to <= to) {
                match rest.next() {
                    Some(next) => *segment = *next,
                    None => is_over = true,
                }
            }
            from = to;
        }
        let mut area = 0.0;
        for piece in &envelope.pieces {
            envelope.areas_before.push(area);
            area += piece.area();
        }
        envelope
    }

    /// Adds the lowest lines of some segments over a span.
    fn extend(&mut self, segments: &[Segment], mut from: f64, end: f64) {
        let lower_then_flatter = |a: usize, b: usize| {
            let (one, other) = (segments[a].line, segments[b].line);
            let order = other.at(from).total_cmp(&one.at(from)).then(other.slope.total_cmp(&one.slope));
            if order.is_lt() { b } else { a }
        };
        let mut line = (1..segments.len()).fold(0, lower_then_flatter);
        // Slopes fall from piece to piece, so there are no more pieces than lines.
        for _ in 0..segments.len() {
            let (to, next) = next_crossing(segments, line, from, end);
            let (value_from, value_to) = (segments[line].line.at(from), segments[line].line.at(to));
            self.pieces.push(Piece { from, to, value_from, value_to, curve: line });
            let Some(next) = next else { break };
            (from, line) = (to, next);
        }
    }

    pub(super) fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Area from 0 to `time`.
    pub(super) fn area(&self, time: f64) -> f64 {
        let begun = self.pieces.partition_point(|piece| piece.from < time);
        begun.checked_sub(1).map_or(0.0, |last| self.areas_before[last] + self.pieces[last].until(time).area())
    }

    /// Integral of the third power.
    pub(super) fn cubic_area(&self) -> f64 {
        self.pieces.iter().map(Piece::cubic_area).sum()
    }

    /// The highest value.
    pub(super) fn peak(&self) -> f64 {
        self.pieces().iter().fold(0.0, |peak, piece| piece.value_from.max(piece.value_to).max(peak))
    }
}

/// Where a flatter line undercuts that of a segment, and which; the end of the span where none does.
fn next_crossing(segments: &[Segment], lowest: usize, from: f64, end: f64) -> (f64, Option<usize>) {
    let line = segments[lowest].line;
    let mut crossing = (end, None);
    for (index, Segment { line: other, .. }) in segments.iter().enumerate() {
        let closing = line.slope - other.slope;
        if closing > 0.0 {
            let time = (from + (other.at(from) - line.at(from)) / closing).max(from);
            let is_flatter = crossing.1.is_some_and(|best: usize| other.slope < segments[best].line.slope);
            if time < crossing.0 || (time == crossing.0 && is_flatter) {
                crossing = (time, Some(index));
            }
        }
    }
    crossing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::bounds::curve::Level;

    #[test]
    fn triangle_has_its_area_and_moments() {
        let [rising, falling] = triangle(2.0, 2.0);
        let envelope = Envelope::new(&[&rising, &falling, &Curve::above_all(2.0)]);
        assert_eq!(envelope.pieces().len(), 2);
        assert_eq!(envelope.pieces().iter().map(Piece::area).sum::<f64>(), 2.0);
        // Twice the integral of (2 t)^3 from 0 to 1.
        assert_eq!(envelope.cubic_area(), 4.0);
        assert_eq!(envelope.area(0.5), 0.25);
        assert_eq!(envelope.peak(), 2.0);
    }

    #[test]
    fn a_level_cuts_a_trapezoid() {
        let [rising, falling] = triangle(1.0, 4.0);
        let envelope = Envelope::new(&[&rising, &falling, &Curve::straight(1.0, 0.0, 4.0)]);
        assert_eq!(order(&envelope), [(0, 1.0), (2, 3.0), (1, 4.0)]);
    }

    #[test]
    fn a_curve_that_steepens_is_cut_piece_by_piece() {
        let rising = Curve::straight(0.0, 2.0, 4.0);
        let falling = Curve::straight(0.0, 1.0, 4.0).reversed();
        let levels = [Level { until: 1.0, rate: 1.0 }, Level { until: f64::INFINITY, rate: 3.0 }];
        let envelope = Envelope::new(&[&rising, &falling, &Curve::by_value(&levels, 0.0, 4.0)]);
        assert_eq!(order(&envelope), [(2, 1.0), (2, 1.5), (1, 4.0)]);
    }

    /// From rest to rest.
    fn triangle(slope: f64, duration: f64) -> [Curve; 2] {
        let rising = Curve::straight(0.0, slope, duration);
        let falling = rising.reversed();
        [rising, falling]
    }

    fn order(envelope: &Envelope) -> Vec<(usize, f64)> {
        envelope.pieces().iter().map(|piece| (piece.curve, piece.to)).collect()
    }
}
