//! Where the robot must stay: a convex aisle in the world, and the convex outline of the robot.
//!
//! Half planes are all that the search asks of either: a point `p` lies inside where `normal . p <= offset` on every edge.

use nalgebra::Vector2;

use super::maneuver::POSITION_LIMIT;
use crate::rules::{Checks, Rule, RuleSet};

/// Least angle by which the outline turns at a corner, rad: far above rounding, far below what an outline needs.
const LEAST_TURN: f64 = 1e-6;
/// Least length of an edge, m.
const SHORTEST_EDGE: f64 = 1e-6;
const CONVEX_RULE: &str = "the corners go once round a convex polygon, either way; each turns by more than 1e-6 rad and lies \
                           more than 1e-6 m from the next";
const FOOTPRINT: &str = "robot.footprint";

/// Names of the coordinates of a corner in the contract, how many corners there may be, and how far away.
struct PolygonRules {
    coordinates: [&'static str; 2],
    corner_count: Rule,
    coordinate: Rule,
}

const KEEP_IN_RULES: PolygonRules = PolygonRules {
    coordinates: ["x_m", "y_m"],
    corner_count: Rule::between(3.0, 64.0, Rule::ITEMS),
    coordinate: Rule::within_magnitude(POSITION_LIMIT, "m"),
};

const FOOTPRINT_RULES: PolygonRules = PolygonRules {
    coordinates: ["right_m", "forward_m"],
    corner_count: Rule::between(3.0, 16.0, Rule::ITEMS),
    coordinate: Rule::within_magnitude(100.0, "m"),
};

impl PolygonRules {
    fn of_field(self, field: &str) -> RuleSet {
        let coordinates = self.coordinates.map(|name| (format!("{field}[].{name}"), self.coordinate));
        let fields = std::iter::once((field.to_owned(), self.corner_count)).chain(coordinates);
        RuleSet { fields: fields.collect(), ..RuleSet::default() }.across(&[field], CONVEX_RULE)
    }
}

/// A half plane: the points with `normal . p <= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Outward unit normal.
    pub normal: Vector2<f64>,
    /// Its scalar product with the points of the edge, m.
    pub offset: f64,
}

/// A strictly convex polygon, counter-clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexPolygon(Vec<Vector2<f64>>);

impl ConvexPolygon {
    /// The corners, counter-clockwise, m.
    pub fn corners(&self) -> &[Vector2<f64>] {
        &self.0
    }

    /// The edges: each from the corner of the same index to the next.
    pub fn edges(&self) -> impl Iterator<Item = Edge> + '_ {
        let next = self.0.iter().cycle().skip(1);
        self.0.iter().zip(next).map(|(corner, next)| {
            let along = (next - corner).normalize();
            let normal = Vector2::new(along.y, -along.x);
            Edge { normal, offset: normal.dot(corner) }
        })
    }

    /// The polygon of these corners in either order; what they violate goes to `checks`.
    ///
    /// Too many corners go no further than their number.
    fn checked(corners: &[Vector2<f64>], field: &str, rules: &PolygonRules, checks: &mut Checks) -> Option<Self> {
        let before = checks.count();
        checks.length(field, corners.len(), &rules.corner_count);
        if checks.count() > before {
            return None;
        }
        for (index, corner) in corners.iter().enumerate() {
            for (coordinate, value) in rules.coordinates.into_iter().zip([corner.x, corner.y]) {
                checks.bounds(&format!("{field}[{index}].{coordinate}"), value, &rules.coordinate);
            }
        }
        if checks.count() > before {
            return None;
        }
        let is_clockwise = twice_signed_area(corners) < 0.0;
        check_convexity(corners, field, if is_clockwise { -1.0 } else { 1.0 }, checks);
        let corners = corners.iter().copied();
        let counter_clockwise = if is_clockwise { corners.rev().collect() } else { corners.collect() };
        (checks.count() == before).then_some(Self(counter_clockwise))
    }
}

fn twice_signed_area(corners: &[Vector2<f64>]) -> f64 {
    // About the first corner: far from the origin the products of coordinates would cancel.
    let first = corners[0];
    corners.windows(2).map(|pair| (pair[0] - first).perp(&(pair[1] - first))).sum()
}

/// Requires edges of some length, turns to one side at all corners, and one turn in all; `side` is 1 where that is the left.
fn check_convexity(corners: &[Vector2<f64>], field: &str, side: f64, checks: &mut Checks) {
    let before = checks.count();
    let count = corners.len();
    let mut whole_turn = 0.0;
    for (index, corner) in corners.iter().enumerate() {
        let arrives = corner - corners[(index + count - 1) % count];
        let leaves = corners[(index + 1) % count] - corner;
        let turn = side * arrives.perp(&leaves).atan2(arrives.dot(&leaves));
        whole_turn += turn;
        let field = format!("{field}[{index}]");
        let place = format!("({}, {})", corner.x, corner.y);
        let apart = format!("more than {SHORTEST_EDGE} m from the corner before");
        checks.require(&field, &place, arrives.norm() > SHORTEST_EDGE, &apart, None);
        let convex = format!("a corner that turns by more than {LEAST_TURN} rad, as in a convex polygon");
        checks.require(&field, &place, turn > LEAST_TURN, &convex, None);
    }
    // A pentagram turns to one side everywhere, and twice in all.
    if checks.count() == before {
        let once = whole_turn < 1.5 * std::f64::consts::TAU;
        checks.require(field, "an outline that crosses itself", once, "corners in their order around a polygon", None);
    }
}

/// The corners of aisle and robot as a caller gives them, in either order; an empty list is an absent one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AisleCorners {
    /// The aisle, in the world, m.
    pub keep_in: Vec<Vector2<f64>>,
    /// The outline of the robot (right, forward) from the axle midpoint, m.
    pub footprint: Vec<Vector2<f64>>,
}

impl AisleCorners {
    /// The rules of all fields, the aisle being in the field `keep_in`.
    pub(crate) fn rules(keep_in: &str) -> RuleSet {
        let rules = KEEP_IN_RULES.of_field(keep_in).and(Self::footprint_rules());
        rules.across(&[keep_in, FOOTPRINT], "an aisle needs a footprint")
    }

    /// Those of the footprint alone.
    pub(crate) fn footprint_rules() -> RuleSet {
        FOOTPRINT_RULES.of_field(FOOTPRINT)
    }

    /// The aisle, if there is one; violated rules go to `checks`. A footprint alone is checked, and bounds nothing.
    pub(crate) fn check(&self, keep_in: &str, checks: &mut Checks) -> Option<Aisle> {
        let mut polygon = |corners: &[Vector2<f64>], field, rules| {
            let is_given = !corners.is_empty();
            is_given.then(|| ConvexPolygon::checked(corners, field, rules, checks)).flatten()
        };
        let aisle = polygon(&self.keep_in, keep_in, &KEEP_IN_RULES);
        let footprint = polygon(&self.footprint, FOOTPRINT, &FOOTPRINT_RULES);
        let is_whole = self.keep_in.is_empty() || !self.footprint.is_empty();
        checks.require(FOOTPRINT, "absent", is_whole, format!("given where `{keep_in}` is"), None);
        Some(Aisle { keep_in: aisle?, footprint: footprint? })
    }
}

/// An aisle and the outline of the robot that must stay in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Aisle {
    /// The aisle, in the world, m; at most 64 corners.
    pub keep_in: ConvexPolygon,
    /// The outline of the robot (right, forward) from the axle midpoint, m; at most 16 corners.
    pub footprint: ConvexPolygon,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::Violations;

    fn points(corners: &[(f64, f64)]) -> Vec<Vector2<f64>> {
        corners.iter().map(|&(x, y)| Vector2::new(x, y)).collect()
    }

    fn regular(count: usize, radius: f64) -> Vec<Vector2<f64>> {
        let angle = |index: usize| std::f64::consts::TAU * index as f64 / count as f64;
        (0..count).map(|index| radius * Vector2::new(angle(index).cos(), angle(index).sin())).collect()
    }

    fn square() -> Vec<Vector2<f64>> {
        points(&[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    }

    fn aisle(keep_in: Vec<Vector2<f64>>, footprint: Vec<Vector2<f64>>) -> Result<Option<Aisle>, Vec<String>> {
        let fields = |found: Violations| found.list().iter().map(|violation| violation.field.clone()).collect();
        let mut checks = Checks::new();
        let aisle = AisleCorners { keep_in, footprint }.check("maneuver.keep_in", &mut checks);
        checks.finish().map(|()| aisle).map_err(fields)
    }

    fn faults(keep_in: Vec<Vector2<f64>>) -> Vec<String> {
        aisle(keep_in, square()).err().unwrap_or_default()
    }

    #[test]
    fn either_order_gives_the_same_half_planes() {
        let of = |keep_in| aisle(keep_in, square()).unwrap().unwrap().keep_in;
        let mut clockwise = square();
        clockwise.reverse();
        assert_eq!(of(clockwise).edges().count(), 4);
        let mut clockwise = square();
        clockwise.reverse();
        for polygon in [of(square()), of(clockwise)] {
            let edges: Vec<_> = polygon.edges().collect();
            assert!(edges.iter().all(|edge| edge.offset == 1.0 && edge.normal.norm() == 1.0), "{edges:?}");
            let sum: Vector2<f64> = edges.iter().map(|edge| edge.normal).sum();
            assert_eq!(sum, Vector2::zeros());
        }
        let edge = of(square()).edges().next().unwrap();
        assert_eq!(edge, Edge { normal: Vector2::new(0.0, -1.0), offset: 1.0 });
    }

    #[test]
    fn most_corners_of_either_polygon_are_accepted() {
        assert!(aisle(regular(64, 1e4 * 0.99), regular(16, 0.3)).unwrap().is_some());
        assert_eq!(faults(regular(65, 5.0)), ["maneuver.keep_in"]);
        assert_eq!(aisle(square(), regular(17, 0.3)), Err(vec!["robot.footprint".to_owned()]));
        assert_eq!(faults(points(&[(0.0, 0.0), (f64::NAN, 1.0)])), ["maneuver.keep_in"]);
        assert_eq!(faults(vec![Vector2::repeat(f64::NAN); 100_000]), ["maneuver.keep_in"]);
    }

    #[test]
    fn each_bad_corner_is_named() {
        let with = |index: usize, corner: (f64, f64)| {
            let mut corners = square();
            corners[index] = Vector2::new(corner.0, corner.1);
            faults(corners)
        };
        assert_eq!(with(1, (f64::NAN, 0.0)), ["maneuver.keep_in[1].x_m"]);
        assert_eq!(with(1, (1e300, f64::INFINITY)), ["maneuver.keep_in[1].x_m", "maneuver.keep_in[1].y_m"]);
        assert_eq!(with(2, (-0.5, -0.5)), ["maneuver.keep_in[2]"]);
        // On the line between its neighbours, and on its neighbour.
        assert_eq!(with(2, (0.0, 0.0)), ["maneuver.keep_in[2]"]);
        assert!(with(2, (1.0, -1.0)).contains(&"maneuver.keep_in[2]".to_owned()));
    }

    #[test]
    fn outline_that_crosses_itself_is_refused() {
        let pentagon = regular(5, 1.0);
        let pentagram = [0, 2, 4, 1, 3].map(|index| pentagon[index]).to_vec();
        assert_eq!(faults(pentagram), ["maneuver.keep_in"]);
        let square = square();
        assert!(!faults([0, 1, 3, 2].map(|index| square[index]).to_vec()).is_empty());
        assert!(!faults(points(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])).is_empty());
    }

    #[test]
    fn aisle_needs_a_footprint() {
        assert_eq!(aisle(square(), Vec::new()), Err(vec!["robot.footprint".to_owned()]));
        assert_eq!(aisle(Vec::new(), square()), Ok(None));
        assert_eq!(aisle(Vec::new(), Vec::new()), Ok(None));
        assert_eq!(aisle(Vec::new(), square()[..2].to_vec()), Err(vec!["robot.footprint".to_owned()]));
    }
}
