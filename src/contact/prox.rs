//! Proximal maps, (24) of the paper: nearest points of convex sets.

/// Nearest point of the half line of non-negative numbers, (6).
#[inline]
pub fn project_onto_half_line(value: f64) -> f64 {
    value.max(0.0)
}

/// Nearest point of the disc of `radius` >= 0 about the origin, (7).
#[inline]
pub fn project_onto_disc(point: [f64; 2], radius: f64) -> [f64; 2] {
    let squared = point[0] * point[0] + point[1] * point[1];
    if squared <= radius * radius {
        point
    } else {
        let scale = radius / squared.sqrt();
        [point[0] * scale, point[1] * scale]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_inside_stay_and_points_outside_land_on_the_rim() {
        assert_eq!(project_onto_disc([0.3, -0.4], 0.5), [0.3, -0.4]);
        let [x, y] = project_onto_disc([3.0, -4.0], 0.5);
        // One division and one multiplication round to an ulp each.
        assert!((x - 0.3).abs() < 1e-16 && (y + 0.4).abs() < 1e-16);
    }

    #[test]
    fn disc_of_radius_zero_is_the_origin() {
        assert_eq!(project_onto_disc([3.0, -4.0], 0.0), [0.0, -0.0]);
        assert_eq!(project_onto_disc([0.0, 0.0], 0.0), [0.0, 0.0]);
    }

    #[test]
    fn half_line_cuts_negative_numbers() {
        assert_eq!((project_onto_half_line(-2.0), project_onto_half_line(3.0)), (0.0, 3.0));
    }
}
