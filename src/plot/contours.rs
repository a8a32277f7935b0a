//! Lines of equal value over a grid of points, by marching squares.

use std::collections::HashMap;

/// Values at the crossings of two sequences of coordinates, row by row upwards; what is no number has no lines around it.
pub(super) struct Field<'a> {
    pub(super) across: &'a [f64],
    pub(super) up: &'a [f64],
    pub(super) values: &'a [f64],
}

/// A point on an edge of the grid: which edge, and where it is.
type Crossing = (usize, [f64; 2]);

impl Field<'_> {
    /// The lines on which the value is `level`, linear along edges.
    pub(super) fn lines(&self, level: f64) -> Vec<Vec<[f64; 2]>> {
        let mut segments = Vec::new();
        for row in 1..self.up.len() {
            for column in 1..self.across.len() {
                self.add_segments(column, row, level, &mut segments);
            }
        }
        joined(&segments)
    }

    /// The lines through the square whose upper right corner is given.
    fn add_segments(&self, column: usize, row: usize, level: f64, segments: &mut Vec<[Crossing; 2]>) {
        let corners = [(column - 1, row - 1), (column, row - 1), (column, row), (column - 1, row)];
        let values = corners.map(|(column, row)| self.values[row * self.across.len() + column]);
        if !values.iter().all(|value| value.is_finite()) {
            return;
        }
        let crossing = |side: usize| {
            let next = (side + 1) % 4;
            let is_crossed = (values[side] >= level) != (values[next] >= level);
            is_crossed.then(|| self.crossing(corners[side], corners[next], (values[side], values[next]), level))
        };
        let crossings: Vec<_> = (0..4).filter_map(crossing).collect();
        match crossings[..] {
            [one, other] => segments.push([one, other]),
            // A saddle: the middle says which corners are together.
            [bottom, right, top, left] => {
                let middle = values.iter().sum::<f64>() / 4.0;
                if (middle >= level) == (values[0] >= level) {
                    segments.extend([[bottom, right], [top, left]]);
                } else {
                    segments.extend([[bottom, left], [top, right]]);
                }
            }
            _ => {}
        }
    }

    fn crossing(&self, from: (usize, usize), to: (usize, usize), values: (f64, f64), level: f64) -> Crossing {
        let (from, to, values) = if from <= to { (from, to, values) } else { (to, from, (values.1, values.0)) };
        let share = (level - values.0) / (values.1 - values.0);
        let at = |(column, row): (usize, usize)| [self.across[column], self.up[row]];
        let ([x, y], [to_x, to_y]) = (at(from), at(to));
        // Each point of the grid has one edge to the right and one upwards.
        let edge = 2 * (from.1 * self.across.len() + from.0) + usize::from(from.0 == to.0);
        (edge, [x + share * (to_x - x), y + share * (to_y - y)])
    }
}

/// Segments put together at the edges that they share.
fn joined(segments: &[[Crossing; 2]]) -> Vec<Vec<[f64; 2]>> {
    let mut at_edge: HashMap<usize, Vec<usize>> = HashMap::new();
    for (index, segment) in segments.iter().enumerate() {
        for (edge, _) in segment {
            at_edge.entry(*edge).or_default().push(index);
        }
    }
    let mut is_used = vec![false; segments.len()];
    let mut next = |edge: usize| {
        let index = *at_edge.get(&edge)?.iter().find(|index| !is_used[**index])?;
        is_used[index] = true;
        let [one, other] = segments[index];
        Some(if one.0 == edge { other } else { one })
    };
    let mut lines = Vec::new();
    // Open lines from their ends first, what is left are loops.
    let is_end = |edge: usize| at_edge.get(&edge).is_some_and(|segments| segments.len() == 1);
    let crossings = || segments.iter().flatten();
    for &(edge, point) in crossings().filter(|(edge, _)| is_end(*edge)).chain(crossings()) {
        let mut line = vec![point];
        let mut edge = edge;
        while let Some((next_edge, point)) = next(edge) {
            line.push(point);
            edge = next_edge;
        }
        if line.len() > 1 {
            lines.push(line);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_plane_are_straight_and_whole() {
        let coordinates = [0.0, 1.0, 2.0, 3.0];
        let values: Vec<_> = (0..16).map(|index| f64::from(index % 4)).collect();
        let field = Field { across: &coordinates, up: &coordinates, values: &values };
        let lines = field.lines(1.5);
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].len(), 4);
        assert!(lines[0].iter().all(|point| point[0] == 1.5));
        assert!(field.lines(9.0).is_empty());
    }

    #[test]
    fn a_hill_has_a_loop_and_a_hole_has_no_lines_around() {
        let coordinates = [0.0, 1.0, 2.0];
        let mut values = vec![0.0; 9];
        values[4] = 1.0;
        let lines = Field { across: &coordinates, up: &coordinates, values: &values }.lines(0.5);
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].first(), lines[0].last());
        values[4] = f64::NAN;
        assert!(Field { across: &coordinates, up: &coordinates, values: &values }.lines(0.5).is_empty());
    }
}
