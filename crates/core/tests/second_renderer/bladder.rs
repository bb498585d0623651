//! The swim bladder that whole turns show, against the true gas.

use crate::cases::{Kind, Size, scene_with};
use crate::dust::Dirt;
use crate::shape::{Bladder, Point, gas};
use crate::volume::Turn;
use carved_core::inside::{BladderState, SwimBladder};
use std::f64::consts::PI;

const FORMS: [Bladder; 5] = [Bladder::Usual, Bladder::Absent, Bladder::Large, Bladder::NotInflated, Bladder::TwoLobes];

/// What was found, and the true lobes: centres and half axes, um.
fn measured(seed: u64, bladder: Bladder) -> (SwimBladder, Vec<(Point, [f64; 3])>) {
    let scene = scene_with(Kind::Finned, bladder, Size::Crop, Dirt::MEASURED, seed);
    let truth = gas(seed, bladder, scene.glass.bore_um);
    let turn = Turn::of_scene(&scene, Kind::Finned, seed).unwrap();
    (turn.record.bladder.unwrap(), truth)
}

fn volume(half: [f64; 3]) -> f64 {
    4.0 / 3.0 * PI * half.iter().product::<f64>()
}

/// Error of the volume in % and in stated standard deviations.
fn off(found: &SwimBladder, truth: &[(Point, [f64; 3])]) -> Option<[f64; 2]> {
    let exact: f64 = truth.iter().map(|(_, half)| volume(*half)).sum();
    let off = found.volume_um3? - exact;
    Some([100.0 * off / exact, off / found.volume_sd_um3?])
}

#[test]
fn gas_has_its_volume_and_its_place() {
    let (found, truth) = measured(905, Bladder::Usual);
    assert_eq!((found.state, found.lobes.len()), (BladderState::Inflated, 1), "{found:?}");
    let [percent, sds] = off(&found, &truth).unwrap();
    assert!(percent.abs() < 12.0 && sds.abs() < 2.0, "{percent} %, {sds} SD");
    let apart = (0..3).map(|i| (found.lobes[0].centre_um[i] - truth[0].0[i]).powi(2)).sum::<f64>().sqrt();
    assert!(apart < 8.0, "{apart} um");
    assert!((found.length_um.unwrap() - 260.0).abs() < 15.0, "{found:?}");
}

#[test]
fn a_larva_without_gas_has_no_volume_and_no_zero() {
    let (found, _) = measured(906, Bladder::Absent);
    assert_eq!(found.state, BladderState::NotInflated, "{found:?}");
    assert!(found.reason.is_some() && found.volume_um3.is_none() && found.length_um.is_none() && found.lobes.is_empty(), "{found:?}");
}

/// Prints the errors of many larvae: `CARVED_LARVAE=24 cargo test -p carved-core --test second_renderer bladder::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints the errors"]
fn survey() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default);
    let first = number("CARVED_FROM", 900);
    for seed in first..first + number("CARVED_LARVAE", 5) {
        let form = FORMS[seed as usize % FORMS.len()];
        let (found, truth) = measured(seed, form);
        let is_right = match found.state {
            BladderState::Inflated => !truth.is_empty(),
            BladderState::NotInflated => truth.is_empty(),
            BladderState::Undecided => false,
        };
        println!(
            "seed {seed}, {form:?}: {}, {:?} (probability {:.4}), {} lobes, volume off by {:.1?} [%, SD], length {:.0?} um",
            if is_right { "right" } else { "not right" },
            found.state,
            found.probability.unwrap_or(f64::NAN),
            found.lobes.len(),
            off(&found, &truth),
            found.length_um
        );
    }
}
