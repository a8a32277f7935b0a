//! Curves with as few points as their picture needs.

/// A point in a picture, px.
type Point = [f64; 2];

/// The points of a curve that are enough to stay within `tolerance` px of all of them; a jump stays a jump.
///
/// From the last point that was kept, each further one opens the sector of directions that pass it within the tolerance. A
/// point outside of the sector of all, or nearer than one before it, ends the line: the point before it is kept.
pub(super) fn simplified(points: &[Point], tolerance: f64) -> Vec<Point> {
    let mut kept: Vec<Point> = points.first().copied().into_iter().collect();
    let mut sector: Option<Sector> = None;
    for pair in points.windows(2) {
        let [before, point] = [pair[0], pair[1]];
        let from = kept[kept.len() - 1];
        let Some(so_far) = sector else {
            sector = Sector::of(from, point, tolerance);
            continue;
        };
        sector = so_far.with(from, point, tolerance);
        if sector.is_none() {
            kept.push(before);
            sector = Sector::of(before, point, tolerance);
        }
    }
    if points.len() > 1 {
        kept.extend(points.last());
    }
    kept
}

/// Directions from a point, rad, and how far away the farthest point is that they pass.
#[derive(Debug, Clone, Copy)]
struct Sector {
    middle: f64,
    right: f64,
    left: f64,
    reach: f64,
}

impl Sector {
    /// None where the point is so near that every direction passes it.
    fn of(from: Point, point: Point, tolerance: f64) -> Option<Self> {
        let [x, y] = [point[0] - from[0], point[1] - from[1]];
        let reach = x.hypot(y);
        let half = (tolerance / reach).asin();
        (reach > tolerance).then(|| Self { middle: y.atan2(x), right: -half, left: half, reach })
    }

    /// None where no direction passes this point too, or it lies back.
    fn with(self, from: Point, point: Point, tolerance: f64) -> Option<Self> {
        let further = Self::of(from, point, tolerance)?;
        let turn = (further.middle - self.middle + 3.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        let is_passed = self.right <= turn && turn <= self.left && further.reach >= self.reach;
        let (right, left) = (self.right.max(turn + further.right), self.left.min(turn + further.left));
        is_passed.then_some(Self { right, left, reach: further.reach, ..self })
    }
}

/// Of a curve that runs to the right the first, lowest, highest and last point of each column of this width, px: what is
/// left of noise that no tolerance makes short.
pub(super) fn columns(points: &[Point], width: f64) -> Vec<Point> {
    let column = |point: &Point| (point[0] / width).floor();
    let mut kept = Vec::new();
    for points in points.chunk_by(|a, b| column(a) == column(b)) {
        let index_of = |better: fn(f64, f64) -> bool| {
            (1..points.len())
                .fold(0, |best, index| if better(points[index][1], points[best][1]) { index } else { best })
        };
        let mut indices = [0, index_of(|a, b| a < b), index_of(|a, b| a > b), points.len() - 1].to_vec();
        indices.sort_unstable();
        indices.dedup();
        kept.extend(indices.into_iter().map(|index| points[index]));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(point: Point, [a, b]: [Point; 2]) -> f64 {
        let along = [b[0] - a[0], b[1] - a[1]];
        let to = [point[0] - a[0], point[1] - a[1]];
        let length = along[0].powi(2) + along[1].powi(2);
        let share = if length == 0.0 { 0.0 } else { (to[0] * along[0] + to[1] * along[1]) / length };
        let share = share.clamp(0.0, 1.0);
        (to[0] - share * along[0]).hypot(to[1] - share * along[1])
    }

    fn largest_distance(points: &[Point], kept: &[Point]) -> f64 {
        let nearest = |point: &Point| {
            kept.windows(2).map(|pair| distance(*point, [pair[0], pair[1]])).fold(f64::INFINITY, f64::min)
        };
        points.iter().map(nearest).fold(0.0, f64::max)
    }

    fn curves() -> [Vec<Point>; 4] {
        let along = |of: fn(f64) -> Point| (0..2000).map(|index| of(f64::from(index) / 2000.0)).collect();
        [
            along(|t| [300.0 * t, 60.0 * (12.0 * t).sin()]),
            along(|t| [100.0 * (9.0 * t).cos(), 100.0 * (13.0 * t).sin()]),
            along(|t| [300.0 * t, if t < 0.4 { 10.0 } else { 90.0 }]),
            // There and back on one line.
            along(|t| [50.0 * (40.0 * t).sin(), 20.0]),
        ]
    }

    #[test]
    fn curves_stay_within_the_tolerance_with_few_points() {
        for points in curves() {
            let kept = simplified(&points, 0.18);
            assert!(largest_distance(&points, &kept) <= 0.18 + 1e-9, "{}", largest_distance(&points, &kept));
            assert!(kept.len() < 400, "{}", kept.len());
            assert_eq!((kept.first(), kept.last()), (points.first(), points.last()));
        }
    }

    #[test]
    fn jumps_and_single_spikes_are_kept() {
        let mut points: Vec<Point> = (0..1000).map(|index| [f64::from(index) * 0.3, 10.0]).collect();
        points[500][1] = 40.0;
        points.iter_mut().skip(700).for_each(|point| point[1] = -20.0);
        let kept = simplified(&points, 0.18);
        for corner in [points[499], points[500], points[501], points[699], points[700]] {
            assert!(kept.contains(&corner), "{corner:?} in {kept:?}");
        }
        assert!(kept.len() <= 8, "{kept:?}");
    }

    #[test]
    fn columns_keep_the_extremes_of_noise() {
        let points: Vec<Point> =
            (0..10_000).map(|index| [f64::from(index) * 0.03, f64::from(index * 7919 % 101)]).collect();
        let kept = columns(&points, 2.0);
        assert!(kept.len() <= 4 * 151, "{}", kept.len());
        assert!(kept.iter().any(|point| point[1] == 0.0) && kept.iter().any(|point| point[1] == 100.0));
    }

    #[test]
    fn short_curves_are_left_as_they_are() {
        assert!(simplified(&[], 0.2).is_empty());
        let two = [[0.0, 0.0], [0.0, 0.0]];
        assert_eq!(simplified(&two, 0.2), two);
    }
}
