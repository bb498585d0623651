//! The ideal visual hull: the best result that silhouettes from all directions around the capillary axis can give.
//!
//! All views are perpendicular to x, so each slice is independent. The hull of a connected section is its convex hull. A section of
//! several pieces is treated as one piece, whose convex hull contains the true hull.
//!
//! With the support function h(theta) of each slice, `l = h + h''` is the length of outline per direction, so that
//! volume = Int Int h l / 2 dtheta dx and area = Int Int l sqrt(1 + (dh/dx)^2) dtheta dx.

use std::f64::consts::TAU;

/// Directions per slice. The polygon around a circle is then too large by (pi / n)^2 / 3 = 6e-6.
const DIRECTIONS: usize = 720;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hull {
    pub volume_um3: f64,
    pub area_um2: f64,
}

/// The hull of sections at growing `x`, um. The first and the last may be single points.
pub fn ideal_hull(sections: &[(f64, Vec<[f64; 2]>)]) -> Hull {
    let directions: Vec<[f64; 2]> = (0..DIRECTIONS)
        .map(|k| {
            let (sin, cos) = (TAU * k as f64 / DIRECTIONS as f64).sin_cos();
            [cos, sin]
        })
        .collect();
    let slices: Vec<Slice> =
        sections.iter().filter(|(_, points)| !points.is_empty()).map(|(x, points)| Slice::new(*x, points, &directions)).collect();
    let mut hull = Hull { volume_um3: 0.0, area_um2: 0.0 };
    for pair in slices.windows(2) {
        let dx = pair[1].x - pair[0].x;
        hull.volume_um3 += f64::midpoint(pair[0].area, pair[1].area) * dx;
        for k in 0..DIRECTIONS {
            let rise = pair[1].support[k] - pair[0].support[k];
            hull.area_um2 += f64::midpoint(pair[0].outline[k], pair[1].outline[k]) * dx.hypot(rise);
        }
    }
    hull
}

struct Slice {
    x: f64,
    support: Vec<f64>,
    outline: Vec<f64>,
    area: f64,
}

impl Slice {
    fn new(x: f64, points: &[[f64; 2]], directions: &[[f64; 2]]) -> Self {
        let corners = convex_hull(points);
        let reach = |i: usize, d: &[f64; 2]| corners[i][0] * d[0] + corners[i][1] * d[1];
        // Corners and directions turn the same way, so the furthest corner only moves forward.
        let mut furthest =
            (0..corners.len()).fold(0, |best, i| if reach(i, &directions[0]) > reach(best, &directions[0]) { i } else { best });
        let support: Vec<f64> = directions
            .iter()
            .map(|d| {
                for _ in 0..corners.len() {
                    let next = (furthest + 1) % corners.len();
                    if reach(next, d) < reach(furthest, d) {
                        break;
                    }
                    furthest = next;
                }
                reach(furthest, d)
            })
            .collect();
        let n = support.len();
        let (sin, cos) = (TAU / n as f64).sin_cos();
        let outline: Vec<f64> =
            (0..n).map(|k| ((support[(k + 1) % n] + support[(k + n - 1) % n] - 2.0 * support[k] * cos) / sin).max(0.0)).collect();
        let area = support.iter().zip(&outline).map(|(h, l)| h * l / 2.0).sum();
        Self { x, support, outline, area }
    }
}

/// Corners of the convex hull in the order of growing angle, by the monotone chain.
pub fn convex_hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let chain = |ordered: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut half: Vec<[f64; 2]> = Vec::new();
        for p in ordered {
            while half.len() > 1 && turn(half[half.len() - 2], half[half.len() - 1], p) <= 0.0 {
                half.pop();
            }
            half.push(p);
        }
        half
    };
    let mut corners = chain(&mut sorted.iter().copied());
    // Each chain ends where the other begins.
    let mut back = chain(&mut sorted.iter().rev().copied());
    if corners.len() > 1 {
        corners.pop();
        back.pop();
        corners.extend(back);
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn stations(n: usize, half: f64) -> impl Iterator<Item = f64> {
        (0..=n).map(move |i| -half * (PI * i as f64 / n as f64).cos())
    }

    #[test]
    fn a_sphere_is_its_own_hull() {
        let r: f64 = 250.0;
        let sections: Vec<_> = stations(400, r)
            .map(|x| {
                let radius = (r * r - x * x).max(0.0).sqrt();
                let ring = (0..1440).map(|k| (TAU * f64::from(k) / 1440.0).sin_cos()).map(|(s, c)| [radius * c + 40.0, radius * s]);
                (x, ring.collect())
            })
            .collect();
        let hull = ideal_hull(&sections);
        assert!((hull.volume_um3 / (4.0 / 3.0 * PI * r.powi(3)) - 1.0).abs() < 1e-4, "{hull:?}");
        assert!((hull.area_um2 / (4.0 * PI * r * r) - 1.0).abs() < 1e-4, "{hull:?}");
    }

    #[test]
    fn a_star_prism_becomes_its_hexagon() {
        let star: Vec<[f64; 2]> = (0..12)
            .map(|k| {
                let (sin, cos) = (TAU * f64::from(k) / 12.0).sin_cos();
                let r = if k % 2 == 0 { 100.0 } else { 40.0 };
                [r * cos, r * sin]
            })
            .collect();
        let sections = vec![(0.0, vec![[0.0, 0.0]]), (0.0, star.clone()), (10.0, star), (10.0, vec![[0.0, 0.0]])];
        let hull = ideal_hull(&sections);
        let hexagon = 1.5 * 3f64.sqrt() * 1e4;
        assert!((hull.volume_um3 / (hexagon * 10.0) - 1.0).abs() < 1e-3, "{hull:?}");
        assert!((hull.area_um2 / (2.0 * hexagon + 6000.0) - 1.0).abs() < 1e-2, "{hull:?}");
    }
}
