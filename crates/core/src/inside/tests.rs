//! Eyes painted into pictures as exact ellipses.

use super::ellipsoid::{Ellipsoid, Linear};
use super::*;
use crate::frame::{PixelFormat, RawFrame};
use crate::geometry::{BoxUm, Camera};
use crate::profile::{Mask, Picture};
use nalgebra::{Matrix3, Vector2, Vector3};
use std::f64::consts::TAU;

const VIEWS: u32 = 21;
const BODY: [f64; 3] = [1700.0, 230.0, 230.0];

fn ball(centre: [f64; 3], half: [f64; 3]) -> Ellipsoid {
    Ellipsoid { centre: centre.into(), spread: Matrix3::from_diagonal(&Vector3::from(half.map(|a| a * a))) }
}

/// The eyes that views of a grey body with these black ellipsoids show.
fn found(black: &[Ellipsoid], views: u32) -> Eyes {
    let camera = Camera { f: 1e7, ..Camera::published(700, 120) };
    let projections: Vec<_> = (0..views).map(|view| camera.projection(TAU * f64::from(view) / f64::from(views))).collect();
    let shade = |projection: &Projection| {
        let images: Vec<_> = black.iter().map(|eye| eye.seen(&Linear::of(projection, eye.centre).unwrap())).collect();
        let body = ball([0.0; 3], BODY);
        let body = body.seen(&Linear::of(projection, body.centre).unwrap());
        // The share of a pixel that is covered, by its sub-pixels.
        let share = |u: u32, v: u32, inside: &dyn Fn(Vector2<f64>) -> bool| {
            let at = |i: u32| (f64::from(i) + 0.5) / 4.0 - 0.5;
            let subs = (0..16).filter(|k| inside(Vector2::new(f64::from(u) + at(k % 4), f64::from(v) + at(k / 4)))).count();
            subs as f64 / 16.0
        };
        let (mut grey, mut mask) = (Vec::new(), Vec::new());
        for (v, u) in (0..120).flat_map(|v| (0..700).map(move |u| (v, u))) {
            let covered = share(u, v, &|at| body.beyond(at) < 0.0);
            let dark = share(u, v, &|at| images.iter().any(|eye| eye.beyond(at) < 0.0));
            grey.push(((1.0 - dark) * (220.0 - 80.0 * covered) + 4.0 * dark) as u8);
            mask.push(if covered.max(dark) >= 0.5 { 255 } else { 0 });
        }
        let frame = RawFrame::new(700, 120, PixelFormat::Mono8, grey).unwrap();
        Shade::of(&Picture::from_frame(&frame), &Mask::from_coverage(700, 120, mask).unwrap()).unwrap()
    };
    let shades: Vec<_> = projections.iter().map(shade).collect();
    let views: Vec<Lit> = projections.iter().zip(&shades).map(|(projection, shade)| Lit { projection, shade }).collect();
    Eyes::find(&views, &BoxUm { min: BODY.map(|a| -a), max: BODY }, None, None)
}

const LEFT: [f64; 3] = [-1400.0, 20.0, -120.0];
const RIGHT: [f64; 3] = [-1390.0, 15.0, 125.0];
const HALF: [f64; 3] = [150.0, 130.0, 70.0];

#[test]
fn both_eyes_have_their_volume_place_and_distance() {
    let true_eyes = [ball(LEFT, HALF), ball(RIGHT, [140.0, 110.0, 60.0])];
    let eyes = found(&true_eyes, VIEWS);
    assert_eq!((eyes.eyes.len(), eyes.reason), (2, None));
    for (eye, truth) in eyes.eyes.iter().zip(&true_eyes) {
        // The level of the edge lies below half the way, which moves a sharp edge by a tenth of a pixel.
        assert!((eye.volume_um3 / truth.volume_um3() - 1.0).abs() < 0.03, "{eye:?}, true {:e}", truth.volume_um3());
        assert!((Vector3::from(eye.centre_um) - truth.centre).norm() < 2.0, "{eye:?}");
        assert!((eye.half_axes_um[2] / truth.half_axes_um()[2] - 1.0).abs() < 0.03, "{eye:?}");
        assert!(eye.residual_px < 0.4 && eye.volume_sd_um3 > 0.02 * eye.volume_um3 && eye.volume_sd_um3 < 0.12 * eye.volume_um3, "{eye:?}");
        assert_eq!(eye.side, None, "no body gives the sides");
    }
    let distance = (true_eyes[1].centre - true_eyes[0].centre).norm();
    assert!((eyes.distance_um.unwrap() / distance - 1.0).abs() < 0.01, "{eyes:?}");
    let mean = true_eyes.iter().map(Ellipsoid::volume_um3).sum::<f64>() / 2.0;
    assert!((eyes.mean_volume_um3.unwrap() / mean - 1.0).abs() < 0.03);
}

#[test]
fn a_small_eye_is_found_beside_a_large_one() {
    let small = ball(RIGHT, [80.0, 75.0, 50.0]);
    let eyes = found(&[ball(LEFT, HALF), small], VIEWS);
    assert_eq!(eyes.eyes.len(), 2, "{eyes:?}");
    assert!((eyes.eyes[1].volume_um3 / small.volume_um3() - 1.0).abs() < 0.06, "{eyes:?}");
}

#[test]
fn eyes_that_are_not_there_are_not_found_and_are_not_zero() {
    let one = found(&[ball(LEFT, HALF)], VIEWS);
    assert_eq!((one.eyes.len(), one.reason), (1, Some(EyesMissing::OnlyOne)), "{one:?}");
    assert_eq!((one.mean_volume_um3, one.distance_um), (None, None));
    let none = found(&[], VIEWS);
    assert_eq!((none.eyes.len(), none.reason), (0, Some(EyesMissing::NotDark)));
    // A cord of pigment along the back is dark and thin.
    let cord = found(&[ball([-900.0, -180.0, 0.0], [500.0, 24.0, 24.0])], VIEWS);
    assert_eq!((cord.eyes.len(), cord.reason.is_some()), (0, true), "{cord:?}");
    let few = found(&[ball(LEFT, HALF), ball(RIGHT, HALF)], 4);
    assert_eq!((few.eyes.len(), few.reason), (0, Some(EyesMissing::FewViews)));
}

/// Half the width of the bright middle over that of the gas.
const CORE: f64 = 0.45;

/// The bladder that views of a grey body show, with these parts: ellipsoids with their transmission, and whether their middle is bright.
fn bladder(parts: &[(Ellipsoid, f64, bool)], views: u32, has_head: bool) -> SwimBladder {
    bladder_of(parts, views, has_head, false)
}

/// The same of a larva of which a part was not measured, if it `is_bound`.
fn bladder_of(parts: &[(Ellipsoid, f64, bool)], views: u32, has_head: bool, is_bound: bool) -> SwimBladder {
    let camera = Camera { f: 1e7, ..Camera::published(700, 120) };
    let projections: Vec<_> = (0..views).map(|view| camera.projection(TAU * f64::from(view) / f64::from(views))).collect();
    let seen = |body: &Ellipsoid, projection: &Projection| body.seen(&Linear::of(projection, body.centre).unwrap());
    let shade = |projection: &Projection| {
        let body = seen(&ball([0.0; 3], BODY), projection);
        let parts: Vec<_> = parts.iter().map(|(part, light, is_gas)| (seen(part, projection), *light, *is_gas)).collect();
        let (mut grey, mut mask) = (Vec::new(), Vec::new());
        for (v, u) in (0..120).flat_map(|v| (0..700).map(move |u| (v, u))) {
            let sub = |k: u32| {
                let at = |i: u32| (f64::from(i) + 0.5) / 4.0 - 0.5;
                let at = Vector2::new(f64::from(u) + at(k % 4), f64::from(v) + at(k / 4));
                let inside = body.beyond(at) < 0.0;
                let passes = parts.iter().filter(|(part, ..)| part.beyond(at) < 0.0).map(|(part, light, is_gas)| {
                    let is_core = *is_gas && (at - part.centre).norm() < CORE * part.reach((at - part.centre).normalize());
                    if is_core { 1.1 } else { *light }
                });
                (inside, if inside { 0.5 } else { 1.0 } * passes.product::<f64>())
            };
            let subs: Vec<(bool, f64)> = (0..16).map(sub).collect();
            grey.push((220.0 * subs.iter().map(|(_, light)| light).sum::<f64>() / 16.0) as u8);
            mask.push(if subs.iter().filter(|(inside, _)| *inside).count() >= 8 { 255 } else { 0 });
        }
        let frame = RawFrame::new(700, 120, PixelFormat::Mono8, grey).unwrap();
        Shade::of(&Picture::from_frame(&frame), &Mask::from_coverage(700, 120, mask).unwrap()).unwrap()
    };
    let shades: Vec<_> = projections.iter().map(shade).collect();
    let views: Vec<Lit> = projections.iter().zip(&shades).map(|(projection, shade)| Lit { projection, shade }).collect();
    let share = |i: u32| (f64::from(i) + 0.5) / 50.0 - 1.0;
    let trunk = Trunk {
        centres: (0..100).map(|i| [BODY[0] * share(i), 0.0, 0.0]).collect(),
        radii_um: (0..100).map(|i| BODY[1] * (1.0 - share(i).powi(2)).sqrt()).collect(),
        has_head,
        back: Some([0.0, -1.0, 0.0]),
        is_bound,
    };
    SwimBladder::find(&views, Some(&trunk), &Eyes::default())
}

const GAS: ([f64; 3], [f64; 3]) = ([-800.0, -50.0, 10.0], [180.0, 90.0, 80.0]);
/// Light that passes the rim of gas.
const RIM: f64 = 0.08;

#[test]
fn gas_has_its_volume_length_and_place() {
    let truth = ball(GAS.0, GAS.1);
    let found = bladder(&[(truth, RIM, true)], VIEWS, true);
    assert_eq!((found.state, found.reason, found.lobes.len()), (BladderState::Inflated, None, 1), "{found:?}");
    let off = found.volume_um3.unwrap() / truth.volume_um3() - 1.0;
    assert!(off.abs() < 0.05 && (off * truth.volume_um3()).abs() < 2.0 * found.volume_sd_um3.unwrap(), "{off}, {found:?}");
    assert!((found.length_um.unwrap() - 360.0).abs() < 8.0, "{found:?}");
    assert!((Vector3::from(found.lobes[0].centre_um) - truth.centre).norm() < 3.0, "{found:?}");
    assert!((found.along_um.unwrap() - 900.0).abs() < 20.0 && (found.above_axis_um.unwrap() - 50.0).abs() < 3.0, "{found:?}");
    assert_eq!(found.behind_eyes_um, None, "there are no eyes");
}

#[test]
fn two_lobes_are_told_apart_and_summed() {
    let lobes = [ball([-1000.0, -40.0, 0.0], [90.0, 70.0, 65.0]), ball([-760.0, -50.0, 0.0], [145.0, 90.0, 85.0])];
    let found = bladder(&lobes.map(|lobe| (lobe, RIM, true)), VIEWS, true);
    assert_eq!((found.state, found.lobes.len()), (BladderState::Inflated, 2), "{found:?}");
    assert!(found.lobes[0].centre_um[0] < found.lobes[1].centre_um[0], "{found:?}");
    let truth: f64 = lobes.iter().map(Ellipsoid::volume_um3).sum();
    assert!((found.volume_um3.unwrap() / truth - 1.0).abs() < 0.06, "{found:?}, true {truth:e}");
}

/// What is dark, clear or long without being gas: an eye's or a yolk's dark ellipsoid, a clear room, a cord of pigment, and nothing.
#[test]
fn what_is_no_gas_is_no_bladder_and_has_no_volume() {
    let dark = ball(GAS.0, GAS.1);
    let yolk = ball([-800.0, 80.0, 0.0], [400.0, 130.0, 130.0]);
    let cord = ball([-700.0, -190.0, 0.0], [600.0, 24.0, 24.0]);
    for (name, parts) in [
        ("dark", vec![(dark, RIM, false)]),
        ("clear", vec![(dark, 1.6, false)]),
        ("yolk and cord", vec![(yolk, 0.5, false), (cord, 0.1, false)]),
        ("nothing", vec![]),
    ] {
        let found = bladder(&parts, VIEWS, true);
        assert_eq!((found.state, found.reason), (BladderState::NotInflated, Some(BladderMissing::NoGas)), "{name}: {found:?}");
        assert!(found.probability.is_some_and(|p| p < 0.05) && found.volume_um3.is_none() && found.lobes.is_empty(), "{name}: {found:?}");
    }
}

#[test]
fn a_bladder_that_cannot_be_looked_for_is_undecided_with_a_reason() {
    let gas = [(ball(GAS.0, GAS.1), RIM, true)];
    let few = bladder(&gas, 4, true);
    assert_eq!((few.state, few.reason, few.probability), (BladderState::Undecided, Some(BladderMissing::FewViews), None));
    let headless = bladder(&gas, VIEWS, false);
    assert_eq!((headless.state, headless.reason), (BladderState::Undecided, Some(BladderMissing::NoHead)));
    let opaque = bladder(&[(ball([0.0; 3], BODY), 0.04, false)], VIEWS, true);
    assert_eq!((opaque.state, opaque.reason, opaque.probability), (BladderState::Undecided, Some(BladderMissing::Opaque), None));
}

/// What no view shows may have the gas. Gas that the views show has its volume, but no distance from a snout that they may not show.
#[test]
fn a_larva_of_which_a_part_was_not_measured_is_never_without_gas() {
    let none = bladder_of(&[], VIEWS, true, true);
    assert_eq!((none.state, none.reason, none.probability), (BladderState::Undecided, Some(BladderMissing::PartUnseen), None));
    let gas = bladder_of(&[(ball(GAS.0, GAS.1), RIM, true)], VIEWS, true, true);
    assert_eq!((gas.state, gas.lobes.len()), (BladderState::Inflated, 1), "{gas:?}");
    assert!(gas.volume_um3.is_some() && gas.length_um.is_some() && gas.along_um.is_none() && gas.along_sd_um.is_none(), "{gas:?}");
    let few = bladder_of(&[], 4, true, true);
    assert_eq!(few.reason, Some(BladderMissing::FewViews));
}

#[test]
fn a_bubble_in_the_water_beside_the_larva_is_no_bladder() {
    let bubble = ball([-800.0, -310.0, 0.0], [90.0, 90.0, 90.0]);
    let found = bladder(&[(bubble, RIM, true)], VIEWS, true);
    assert!(found.state != BladderState::Inflated && found.volume_um3.is_none(), "{found:?}");
}
