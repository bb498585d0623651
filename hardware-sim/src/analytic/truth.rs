//! Exact volume and area from support functions.
//!
//! ```text
//!   volume = Int x_s Int h (h + h_tt) / 2 dt ds           area = Int Int (h + h_tt) sqrt(x_s^2 + h_s^2) dt ds
//!
//!   hull of two:   body ( O )===|  plate     arcs of either, and flats between them where the larger support changes hands:
//!                      flat ---              a flat of length l at t* adds h l / 2, and l sqrt(1 + h_x^2) along it
//! ```
//! All integrands are smooth in s and periodic in t, so that equal steps in t and Gauss points in s converge fast.

use super::larva::{Body, Plate};
use super::loft::Solid;
use super::slice::{Slice, Support};
use std::f64::consts::TAU;

/// Panels along s with three Gauss points each, and directions of a slice.
const PANELS: u32 = 400;
const DIRECTIONS: u32 = 96;
/// Gauss points within a panel of -1 to 1, and their weights.
const GAUSS: [(f64, f64); 3] = [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// `Int f` over `panels` equal parts of an interval.
fn integral(from: f64, to: f64, panels: u32, mut f: impl FnMut(f64) -> [f64; 2]) -> [f64; 2] {
    let half = (to - from) / f64::from(panels) / 2.0;
    let mut sum = [0.0; 2];
    for panel in 0..panels {
        let middle = from + half * f64::from(2 * panel + 1);
        for (place, weight) in GAUSS {
            let value = f(middle + half * place);
            for i in 0..2 {
                sum[i] += weight * half * value[i];
            }
        }
    }
    sum
}

/// Panels where the ends of a capsule's cylinder fall between two: its second derivative jumps there.
fn over(solid: &Solid, f: impl Fn(&Slice) -> [f64; 2]) -> [f64; 2] {
    let span = solid.span();
    let cuts = match solid {
        Solid::Capsule { .. } => vec![0.0, std::f64::consts::FRAC_PI_2, span - std::f64::consts::FRAC_PI_2, span],
        _ => vec![0.0, span],
    };
    cuts.windows(2).map(|part| integral(part[0], part[1], PANELS, |s| f(&solid.slice(s)))).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
}

fn directions() -> impl Iterator<Item = f64> {
    (0..DIRECTIONS).map(|k| TAU * f64::from(k) / f64::from(DIRECTIONS))
}

pub fn volume_um3(solid: &Solid) -> f64 {
    volume_and_area(solid)[0]
}

/// Volume, um^3, and area, um^2, of a solid with convex slices, which is its own ideal hull.
pub fn volume_and_area(solid: &Solid) -> [f64; 2] {
    let step = TAU / f64::from(DIRECTIONS);
    over(solid, |slice| {
        let mut sum = [0.0; 2];
        for at in directions().map(|t| slice.support(t)) {
            sum[0] += slice.x_s * at.h * at.bow / 2.0 * step;
            sum[1] += at.bow * slice.x_s.hypot(at.h_s) * step;
        }
        sum
    })
}

/// Volume, um^3, and area, um^2, of the ideal hull of a body with its fin fold: the convex hull of each slice.
pub fn hull_volume_and_area(body: &Body, plate: &Plate) -> [f64; 2] {
    let within = over(&Solid::Body(body.clone()), |slice| match plate.slice_at(slice.x) {
        Some(other) => hull_of_two(slice, &other),
        None => arc(slice, slice.x_s, 0.0, TAU, SLICE_PANELS),
    });
    // Behind the tail there is only the plate, a thin ellipse. Its sharp ends need many panels.
    let from = plate.angle_at(body.length_um / 2.0);
    let behind = integral(from, std::f64::consts::PI, PANELS / 4, |s| {
        let slice = plate.slice(s);
        arc(&slice, slice.x_s, 0.0, TAU, 4 * SLICE_PANELS)
    });
    [within[0] + behind[0], within[1] + behind[1]]
}

const SLICE_PANELS: u32 = 60;

/// What the directions from `t0` to `t1` add to volume and area per s; `x_s` is that of the s which is integrated over.
fn arc(slice: &Slice, x_s: f64, t0: f64, t1: f64, panels: u32) -> [f64; 2] {
    integral(t0, t1, panels, |t| {
        let at = slice.support(t);
        [x_s * at.h * at.bow / 2.0, at.bow * x_s.hypot(at.h_s / slice.x_s * x_s)]
    })
}

fn hull_of_two(a: &Slice, b: &Slice) -> [f64; 2] {
    let further = |t: f64| b.support(t).h - a.support(t).h;
    let mut sum = [0.0; 2];
    let mut add = |part: [f64; 2]| (0..2).for_each(|i| sum[i] += part[i]);
    let step = TAU / f64::from(SLICE_PANELS);
    for k in 0..SLICE_PANELS {
        let (from, to) = (step * f64::from(k), step * f64::from(k + 1));
        let (first, second) = if further(from) > 0.0 { (b, a) } else { (a, b) };
        if (further(from) > 0.0) == (further(to) > 0.0) {
            add(arc(first, a.x_s, from, to, 1));
            continue;
        }
        let (mut before, mut after) = (from, to);
        for _ in 0..40 {
            let middle = f64::midpoint(before, after);
            if (further(middle) > 0.0) == (further(from) > 0.0) { before = middle } else { after = middle }
        }
        add(arc(first, a.x_s, from, before, 1));
        add(arc(second, a.x_s, after, to, 1));
        add(flat(first, second, &first.support(before), &second.support(after), a.x_s));
    }
    sum
}

/// The flat part between two sections with equal support.
fn flat(first: &Slice, second: &Slice, p: &Support, q: &Support, x_s: f64) -> [f64; 2] {
    let ([_, py, pz], [_, qy, qz]) = (first.point(p), second.point(q));
    let length = (py - qy).hypot(pz - qz);
    let (rise, other) = (p.h_s / first.x_s, q.h_s / second.x_s);
    let slant: f64 = GAUSS
        .iter()
        .map(|(place, weight)| {
            let share = f64::midpoint(1.0, *place);
            weight / 2.0 * 1f64.hypot(rise + share * (other - rise))
        })
        .sum();
    [x_s * p.h * length / 2.0, x_s * length * slant]
}
