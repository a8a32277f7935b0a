//! The lowest of three straight lines over a span of time, and integrals of it.

/// A line over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    /// Value at time 0.
    pub(super) start: f64,
    /// Change per second.
    pub(super) slope: f64,
}

impl Line {
    /// A line far above all others; finite, so that areas stay numbers.
    pub(super) const ABOVE_ALL: Self = Self { start: 1e150, slope: 0.0 };

    fn at(&self, time: f64) -> f64 {
        self.start + self.slope * time
    }
}

/// A span on which one line is the lowest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Piece {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) value_from: f64,
    pub(super) value_to: f64,
    /// Index of the line.
    pub(super) line: usize,
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

    /// Integral of the `power`-th power: the length times the mean of a^j b^(power - j).
    fn power_area(&self, power: u32) -> f64 {
        let (mut sum, mut from_power) = (1.0, 1.0);
        for _ in 0..power {
            from_power *= self.value_from;
            sum = sum * self.value_to + from_power;
        }
        (self.to - self.from) * sum / f64::from(power + 1)
    }
}

/// The lowest of three lines, piece by piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct Envelope {
    pieces: [Piece; 3],
    count: usize,
}

impl Envelope {
    /// From time 0 to `duration` > 0.
    pub(super) fn new(lines: &[Line; 3], duration: f64) -> Self {
        let mut envelope = Self { pieces: [Piece::default(); 3], count: 0 };
        let lower_then_flatter = |a: usize, b: usize| {
            let order = lines[b].start.total_cmp(&lines[a].start).then(lines[b].slope.total_cmp(&lines[a].slope));
            if order.is_lt() { b } else { a }
        };
        let mut line = lower_then_flatter(lower_then_flatter(0, 1), 2);
        let mut from = 0.0;
        // Slopes fall from piece to piece, so three pieces are the most.
        while envelope.count < envelope.pieces.len() {
            let (to, next) = next_crossing(lines, line, from, duration);
            let (value_from, value_to) = (lines[line].at(from), lines[line].at(to));
            envelope.pieces[envelope.count] = Piece { from, to, value_from, value_to, line };
            envelope.count += 1;
            let Some(next) = next else { break };
            (from, line) = (to, next);
        }
        envelope
    }

    pub(super) fn pieces(&self) -> &[Piece] {
        &self.pieces[..self.count]
    }

    /// Integral of the `power`-th power from 0 to `time`.
    pub(super) fn power_integral(&self, power: u32, time: f64) -> f64 {
        let pieces = self.pieces().iter().take_while(|piece| piece.from < time);
        pieces.map(|piece| piece.until(time).power_area(power)).sum()
    }

    /// The highest value.
    pub(super) fn peak(&self) -> f64 {
        self.pieces().iter().fold(0.0, |peak, piece| piece.value_from.max(piece.value_to).max(peak))
    }
}

/// Where a flatter line undercuts `line`, and which; the end of the span where none does.
fn next_crossing(lines: &[Line; 3], line: usize, from: f64, duration: f64) -> (f64, Option<usize>) {
    let mut crossing = (duration, None);
    for (index, other) in lines.iter().enumerate() {
        let closing = lines[line].slope - other.slope;
        if closing > 0.0 {
            let time = (from + (other.at(from) - lines[line].at(from)) / closing).max(from);
            let is_flatter = crossing.1.is_some_and(|best: usize| other.slope < lines[best].slope);
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

    #[test]
    fn triangle_has_its_area_and_moments() {
        let envelope =
            Envelope::new(&[Line { start: 0.0, slope: 2.0 }, Line { start: 4.0, slope: -2.0 }, Line::ABOVE_ALL], 2.0);
        assert_eq!(envelope.pieces().len(), 2);
        assert_eq!(envelope.pieces().iter().map(Piece::area).sum::<f64>(), 2.0);
        // Twice the integral of (2 t)^3 from 0 to 1.
        assert_eq!(envelope.power_integral(3, 2.0), 4.0);
        assert_eq!(envelope.power_integral(1, 0.5), 0.25);
        assert_eq!(envelope.peak(), 2.0);
    }

    #[test]
    fn three_lines_cut_a_trapezoid() {
        let lines =
            [Line { start: 0.0, slope: 1.0 }, Line { start: 1.0, slope: 0.0 }, Line { start: 4.0, slope: -1.0 }];
        let envelope = Envelope::new(&lines, 4.0);
        let order: Vec<_> = envelope.pieces().iter().map(|piece| (piece.line, piece.to)).collect();
        assert_eq!(order, [(0, 1.0), (1, 3.0), (2, 4.0)]);
    }
}
