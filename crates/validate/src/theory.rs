//! The hull of a circle by its definition: the bias that is expected before any measurement.
//!
//! ```text
//!   directions n: the N views of an even N look along N/2 lines from both sides,  a slab lies between a view's two edges;
//!   an odd N sees edges in 2N directions                                          a point may miss `budget` of them
//! ```

use std::f64::consts::{PI, TAU};

/// Number of `views` that may miss a voxel.
pub fn budget(epsilon: f64, views: usize) -> usize {
    (epsilon * views as f64 + 1e-9).floor() as usize
}

/// Area of the hull of a circle over the circle's area, less 1. `None` for tolerances that are not derived here.
pub fn circle_bias(epsilon: f64, views: usize) -> Option<f64> {
    // Under weak perspective opposite views are mirror images, so that they miss a point together.
    let (directions, slabs) =
        if views.is_multiple_of(2) { (views, budget(epsilon, views) / 2) } else { (2 * views, budget(epsilon, views)) };
    let n = directions as f64;
    let d = TAU / n;
    let edges = match slabs {
        0 => (d / 2.0).tan(),
        1 => d.tan() - (d / 2.0).tan(),
        2 => (1.5 * d).tan() - d.tan(),
        _ => return None,
    };
    Some(n * edges / PI - 1.0)
}

/// Diameter of the sphere nearest to a ball's hull over the ball's diameter, less 1. The slices grow by half of their area's excess, only
/// across the axis. Over the surface of a sphere this is 2/3 of the mean over all directions.
pub fn sphere_diameter_bias(circle_bias: f64) -> f64 {
    circle_bias / 3.0
}

/// Surface of a ball's hull over the ball's surface, less 1. Each facet that touches the ball has a third of its height as volume, so sharp
/// edges give the same excess as for the volume. Rounded edges give that of a solid of revolution, two thirds of it.
pub fn sphere_area_bias(circle_bias: f64) -> [f64; 2] {
    [2.0 / 3.0 * circle_bias, circle_bias]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_circles_bias_is_that_of_polygons_with_no_one_or_two_sides_missed() {
        let found: Vec<f64> = [4, 7, 12, 14, 21, 28, 42, 84].map(|n| 100.0 * circle_bias(0.05, n).unwrap()).to_vec();
        // With an even number one miss removes no slab, because the mirror image still cuts. With 42 views both may be missed.
        for (found, expected) in found.iter().zip([27.32, 1.71, 2.35, 1.71, 1.32, 0.42, 1.32, 0.89]) {
            assert!((found - expected).abs() < 0.0051, "{found} {expected}");
        }
        assert_eq!(circle_bias(0.3, 84), None);
    }

    #[test]
    fn a_polygon_about_a_circle_is_the_limit_without_tolerance() {
        // A square around a circle: 4 / pi.
        assert!((circle_bias(0.0, 4).unwrap() - (4.0 / PI - 1.0)).abs() < 1e-12);
        assert!(circle_bias(0.0, 84).unwrap() < 5e-4);
    }

    #[test]
    fn the_budget_counts_whole_misses() {
        assert_eq!([4, 14, 20, 21, 28, 40, 42, 84].map(|n| budget(0.05, n)), [0, 0, 1, 1, 1, 2, 2, 4]);
    }
}
