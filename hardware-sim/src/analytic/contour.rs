//! The contour generator of a solid: the points where rays from the projection centre are tangent to it. Their image is the outline.
//!
//! ```text
//!        t+ pi                     F(t) = n(t) . (X(t) - C) = x_s (h - C_y cos t - C_z sin t) - h_s (x - C_x)
//!     ____---____   X1             is below 0 on the side of the camera and above 0 behind:
//!    /   slice    \ .              two zeros per slice, near tc +- pi/2 as C is far away
//!   |      +       | . ---> C
//!    \____________/ .    tc        near a tip that is seen obliquely F has one sign only: the two zeros
//!           ---     X2             meet, and the contour turns back
//! ```

use super::loft::Loft;
use super::slice::{Slice, Support};
use std::f64::consts::{FRAC_PI_2, PI};

/// Accuracy of a zero of F, rad.
const EXACT_RAD: f64 = 1e-9;

/// The projection centre of a camera, in the frame of the solid, um.
#[derive(Debug, Clone, Copy)]
struct Eye {
    at: [f64; 3],
    /// Direction across the solid towards it, and its distance.
    towards: f64,
    away: f64,
}

impl Eye {
    fn new(at: [f64; 3]) -> Self {
        Self { at, towards: at[2].atan2(at[1]), away: at[1].hypot(at[2]) }
    }

    /// F, and its derivative by t.
    fn facing(&self, slice: &Slice, at: &Support) -> (f64, f64) {
        let [cx, cy, cz] = self.at;
        let dx = slice.x - cx;
        let f = slice.x_s * (at.h - cy * at.cos - cz * at.sin) - at.h_s * dx;
        let f_t = slice.x_s * (at.h_t + cy * at.sin - cz * at.cos) - at.h_st * dx;
        (f, f_t)
    }

    /// Whether both zeros are simple: the second term of F moves them by less than 30 degrees.
    fn is_plain(&self, slice: &Slice) -> bool {
        slice.steepest() * (slice.x - self.at[0]).abs() < 0.5 * slice.x_s * self.away
    }

    /// A simple zero, by Newton's method from a nearby start.
    fn zero_near(&self, slice: &Slice, mut t: f64) -> f64 {
        for _ in 0..20 {
            let (f, f_t) = self.facing(slice, &slice.support(t));
            let step = f / f_t;
            t -= step;
            if step.abs() < EXACT_RAD {
                break;
            }
        }
        t
    }

    /// The zero between two directions in which F has opposite signs: Newton's method, with bisection where a step leaves the interval.
    fn zero_between(&self, slice: &Slice, mut below: f64, mut above: f64) -> f64 {
        let mut t = f64::midpoint(below, above);
        for _ in 0..60 {
            let (f, f_t) = self.facing(slice, &slice.support(t));
            if f < 0.0 {
                below = t;
            } else {
                above = t;
            }
            let newton = t - f / f_t;
            let (low, high) = (below.min(above), below.max(above));
            let next = if (low..=high).contains(&newton) { newton } else { f64::midpoint(low, high) };
            let step = next - t;
            t = next;
            if step.abs() < EXACT_RAD {
                break;
            }
        }
        t
    }

    /// The direction near `t` in which F is least (`sign` -1) or greatest (1): one such lies within a quarter turn.
    fn extreme(&self, slice: &Slice, t: f64, sign: f64) -> f64 {
        let (mut rising, mut falling) = (t - FRAC_PI_2, t + FRAC_PI_2);
        for _ in 0..34 {
            let middle = f64::midpoint(rising, falling);
            let (_, f_t) = self.facing(slice, &slice.support(middle));
            if sign * f_t > 0.0 { rising = middle } else { falling = middle }
        }
        f64::midpoint(rising, falling)
    }
}

/// The contour generator of a solid for the projection centre `eye`: a closed line. Both are in the frame of the solid, um.
pub fn contour(loft: &Loft, eye: [f64; 3]) -> Vec<[f64; 3]> {
    let eye = Eye::new(eye);
    let plain = |slice: &Slice| eye.is_plain(slice);
    let (Some(first), Some(last)) = (loft.slices.iter().position(plain), loft.slices.iter().rposition(plain)) else { return Vec::new() };
    let along = &loft.slices[first..=last];
    let first_tip = tip(loft, &eye, 0.0, &along[0]);
    let last_tip = tip(loft, &eye, loft.solid.span(), &along[along.len() - 1]);
    // Both sides from the first tip to the last. They share the point where they meet.
    let mut there: Vec<[f64; 3]> = first_tip.iter().map(|pair| pair[0]).collect();
    let mut back: Vec<[f64; 3]> = first_tip.iter().skip(1).map(|pair| pair[1]).collect();
    let (mut t1, mut t2) = (eye.towards + FRAC_PI_2, eye.towards - FRAC_PI_2);
    for slice in along {
        t1 = eye.zero_near(slice, t1);
        t2 = eye.zero_near(slice, t2);
        there.push(slice.point(&slice.support(t1)));
        back.push(slice.point(&slice.support(t2)));
    }
    there.extend(last_tip.iter().rev().map(|pair| pair[0]));
    back.extend(last_tip.iter().skip(1).rev().map(|pair| pair[1]));
    there.extend(back.into_iter().rev());
    there
}

/// Both points of each slice from where the zeros meet, near the pole, up to but without the slice `from`. The first pair is
/// the meeting itself.
fn tip(loft: &Loft, eye: &Eye, pole: f64, from: &Slice) -> Vec<[[f64; 3]; 2]> {
    // Towards the pole F takes one sign all around: that of -h_s (x - C_x). What is lost is its other extreme.
    let inwards = (from.s - pole).signum();
    let x = loft.solid.slice(pole).x;
    let (lost, sign) = if inwards * (x - eye.at[0]) < 0.0 { (eye.towards, -1.0) } else { (eye.towards + PI, 1.0) };
    let at = |share: f64| loft.solid.slice(pole + (from.s - pole) * share);
    let meets = |slice: &Slice| {
        let t = eye.extreme(slice, lost, sign);
        let (f, _) = eye.facing(slice, &slice.support(t));
        (t, sign * f > 0.0)
    };
    // The pole itself has no section. This is near enough.
    let (mut none, mut both) = (1e-7, 1.0);
    if meets(&at(none)).1 {
        both = none;
    }
    while both - none > 1e-6 * both {
        let middle = f64::midpoint(none, both);
        if meets(&at(middle)).1 { both = middle } else { none = middle }
    }
    let turning = at(both);
    let turn = turning.point(&turning.support(meets(&turning).0));
    let edge = |slice: &Slice| {
        let (t, _) = meets(slice);
        let opposite = if sign > 0.0 { t - PI } else { t + PI };
        // From the side of the camera to the other side, in both directions.
        let (seen, hidden) = if sign > 0.0 { (opposite, t) } else { (t, opposite) };
        let around = |t: f64| slice.point(&slice.support(t));
        let way = if sign > 0.0 { [(seen, hidden), (seen + 2.0 * PI, hidden)] } else { [(seen, hidden), (seen, hidden - 2.0 * PI)] };
        way.map(|(seen, hidden)| around(eye.zero_between(slice, seen, hidden)))
    };
    let [a, b] = edge(&at(1.0));
    let across_um = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    // The line turns by half a turn: 24 points a side keep within the 0.06 rad and 4 um of other slices up to 200 um across.
    let points = ((across_um / 3.0).ceil() as u32).clamp(4, 24);
    let shares = (1..points).map(|i| both + (1.0 - both) * (f64::from(i) / f64::from(points)).powi(2));
    std::iter::once([turn; 2]).chain(shares.map(|share| edge(&at(share)))).collect()
}
