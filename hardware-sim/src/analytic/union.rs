//! The outline of two overlapping shapes that meet each image column in one piece.
//!
//! ```text
//!      ____                upper line: the higher of both where both exist, otherwise the one that exists;
//!    /      \___           crossings become vertices. The lower line is made in the same way.
//!   (    ____)__\____
//!    \__(___/________)     Each shape is cut at its ends in u into an upper and a lower line.
//! ```

use crate::scene::Outline;

/// Upper and lower line from left to right, v growing downwards.
#[derive(Debug, Clone)]
pub struct Lines {
    pub upper: Vec<[f64; 2]>,
    pub lower: Vec<[f64; 2]>,
}

/// Enclosed area, px^2. It is positive if the outline runs clockwise on the screen.
pub fn area_px2(outline: &[[f64; 2]]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>() / 2.0
}

impl Lines {
    /// Cuts a closed outline of either direction.
    pub fn of(outline: &[[f64; 2]]) -> Self {
        let end = |order: fn(&f64, &f64) -> std::cmp::Ordering| {
            (0..outline.len()).min_by(|&a, &b| order(&outline[a][0], &outline[b][0])).unwrap_or_default()
        };
        let (left, right) = (end(f64::total_cmp), end(|a, b| b.total_cmp(a)));
        let n = outline.len();
        let run = |from: usize, to: usize| (0..=(to + n - from) % n).map(|i| outline[(from + i) % n]).collect::<Vec<_>>();
        let (there, mut back) = (run(left, right), run(right, left));
        back.reverse();
        // In a clockwise outline the part that runs to the right is the upper one.
        if area_px2(outline) > 0.0 { Self { upper: there, lower: back } } else { Self { upper: back, lower: there } }
    }

    /// Clockwise on the screen.
    pub fn outline(mut self) -> Outline {
        let inner = self.lower.len().saturating_sub(1);
        self.upper.extend(self.lower[..inner].iter().skip(1).rev());
        self.upper
    }

    pub fn with(&self, other: &Self) -> Self {
        let mirrored = |line: &[[f64; 2]]| line.iter().map(|[u, v]| [*u, -v]).collect::<Vec<_>>();
        let lower = higher(&mirrored(&self.lower), &mirrored(&other.lower));
        Self { upper: higher(&self.upper, &other.upper), lower: mirrored(&lower) }
    }
}

/// The higher one of two lines (at smaller v), over all columns of either line.
fn higher(a: &[[f64; 2]], b: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut columns: Vec<f64> = a.iter().chain(b).map(|p| p[0]).collect();
    columns.sort_by(f64::total_cmp);
    columns.dedup();
    let (mut in_a, mut in_b) = (Walk::new(a), Walk::new(b));
    let mut line: Vec<[f64; 2]> = Vec::with_capacity(columns.len() + 8);
    let mut before: Option<(f64, f64, f64)> = None;
    for u in columns {
        let (va, vb) = (in_a.at(u).unwrap_or(f64::INFINITY), in_b.at(u).unwrap_or(f64::INFINITY));
        if let Some((u0, a0, b0)) = before {
            let (gap, gap0) = (va - vb, a0 - b0);
            if gap.is_finite() && gap0.is_finite() && (gap > 0.0) != (gap0 > 0.0) {
                let share = gap0 / (gap0 - gap);
                line.push([u0 + share * (u - u0), a0 + share * (va - a0)]);
            }
        }
        before = Some((u, va, vb));
        line.push([u, va.min(vb)]);
    }
    line
}

/// Heights of a line at growing columns.
struct Walk<'a> {
    line: &'a [[f64; 2]],
    at: usize,
}

impl<'a> Walk<'a> {
    fn new(line: &'a [[f64; 2]]) -> Self {
        Self { line, at: 0 }
    }

    fn at(&mut self, u: f64) -> Option<f64> {
        if u < self.line.first()?[0] || u > self.line.last()?[0] {
            return None;
        }
        while self.at + 2 < self.line.len() && self.line[self.at + 1][0] < u {
            self.at += 1;
        }
        let ([u0, v0], [u1, v1]) = (self.line[self.at], *self.line.get(self.at + 1)?);
        // An end may rise steeply: a column that it fills alone has its first height.
        Some(if u1 > u0 { v0 + ((u - u0) / (u1 - u0)).clamp(0.0, 1.0) * (v1 - v0) } else { v0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn disc(u: f64, v: f64, radius: f64) -> Vec<[f64; 2]> {
        (0..4000).map(|k| (TAU * f64::from(k) / 4000.0).sin_cos()).map(|(s, c)| [u + radius * c, v + radius * s]).collect()
    }

    #[test]
    fn the_union_of_two_discs_has_the_area_of_both_less_their_lens() {
        // The middle of the second lies in the first by 5: the lens of two circles of radius 20 whose middles are 15 apart.
        let (a, b) = (disc(50.0, 30.0, 20.0), disc(65.0, 30.0, 20.0));
        let mut turned = b.clone();
        turned.reverse();
        let d: f64 = 15.0;
        let lens = 2.0 * 400.0 * (d / 40.0).acos() - d / 2.0 * (1600.0 - d * d).sqrt();
        let expected = 2.0 * TAU / 2.0 * 400.0 - lens;
        for other in [&b, &turned] {
            let both = Lines::of(&a).with(&Lines::of(other)).outline();
            // Polygons of 4000 sides lose 4e-7 of each disc.
            assert!((area_px2(&both) / expected - 1.0).abs() < 1e-5, "{} against {expected}", area_px2(&both));
            assert!(area_px2(&both) > 0.0, "clockwise on the screen");
        }
    }

    /// Squares on their corners, 20 wide and 8 apart: they cross where neither has a corner, and have a third square in common,
    /// 12 wide.
    #[test]
    fn crossings_become_corners() {
        let square = |u: f64| vec![[u - 10.0, 0.0], [u, -10.0], [u + 10.0, 0.0], [u, 10.0]];
        let both = Lines::of(&square(0.0)).with(&Lines::of(&square(8.0))).outline();
        assert!((area_px2(&both) - (200.0 + 200.0 - 72.0)).abs() < 1e-9, "{both:?}");
    }

    #[test]
    fn the_union_of_nested_shapes_is_the_outer_shape() {
        let (large, small) = (disc(50.0, 30.0, 20.0), disc(55.0, 33.0, 5.0));
        let both = Lines::of(&small).with(&Lines::of(&large)).outline();
        assert!((area_px2(&both) / area_px2(&large) - 1.0).abs() < 1e-6);
    }
}
