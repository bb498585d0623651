//! The eyes that whole turns show, against the true ellipsoids.

use crate::cases::{Kind, Size, scene};
use crate::dust::Dirt;
use crate::shape::{back, eyes};
use crate::volume::Turn;
use carved_core::inside::Eye;
use std::f64::consts::PI;

/// Errors of the eyes of a larva: of the volumes, in % and in stated standard deviations; of their distance, %; of the back, deg.
struct Errors {
    volume: [f64; 2],
    sds: [f64; 2],
    distance: f64,
    back_deg: Option<f64>,
}

/// `None` where not both eyes were found.
fn errors(seed: u64) -> Option<Errors> {
    let bore_um = scene(Kind::Finned, Size::Crop, Dirt::MEASURED, seed).glass.bore_um;
    let truth = eyes(seed, bore_um);
    let turn = Turn::of(Kind::Finned, Dirt::MEASURED, seed).unwrap();
    let found = turn.record.eyes.unwrap();
    let [a, b] = found.eyes[..] else { return None };
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    let is_first = apart(a.centre_um, truth[0].0) < apart(b.centre_um, truth[0].0);
    let [of_a, of_b] = if is_first { truth } else { [truth[1], truth[0]] };
    let volume = |half: [f64; 3]| 4.0 / 3.0 * PI * half.iter().product::<f64>();
    let off = |eye: &Eye, half: [f64; 3]| eye.volume_um3 - volume(half);
    // At the angle at which the back faces the camera, it has no part down the picture (y cos - z sin) and is nearest (-y sin - z cos).
    let [y, z] = back(seed, bore_um);
    let back_deg = turn.record.facing.map(|facing| {
        let (sin, cos) = facing.roll_deg.to_radians().sin_cos();
        (y * cos - z * sin).atan2(-(y * sin + z * cos)).to_degrees()
    });
    Some(Errors {
        volume: [(&a, of_a.1), (&b, of_b.1)].map(|(eye, half)| 100.0 * off(eye, half) / volume(half)),
        sds: [(&a, of_a.1), (&b, of_b.1)].map(|(eye, half)| off(eye, half) / eye.volume_sd_um3),
        distance: 100.0 * (found.distance_um? / apart(truth[0].0, truth[1].0) - 1.0),
        back_deg,
    })
}

#[test]
fn eyes_have_their_volume_and_distance() {
    let Errors { volume, sds, distance, back_deg } = errors(904).unwrap();
    assert!(volume.iter().all(|e| e.abs() < 9.0) && sds.iter().all(|s| s.abs() < 2.0), "{volume:?} %, {sds:?} SD");
    assert!(distance.abs() < 2.5, "{distance} %");
    assert!(back_deg.is_some_and(|off| off.abs() < 3.0), "{back_deg:?}");
}

/// Prints the errors of many larvae: `CARVED_LARVAE=24 cargo test -p carved-core --test second_renderer eyes::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints the errors"]
fn survey() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default);
    let first = number("CARVED_FROM", 900);
    for seed in first..first + number("CARVED_LARVAE", 4) {
        match errors(seed) {
            Some(Errors { volume: [a, b], sds, distance, back_deg }) => println!(
                "seed {seed}: volumes {a:+.1} and {b:+.1} % ({:+.1} and {:+.1} SD), distance {distance:+.2} %, back off {back_deg:?} deg",
                sds[0], sds[1]
            ),
            None => println!("seed {seed}: not both eyes were found"),
        }
    }
}
