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
