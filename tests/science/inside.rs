//! Organs inside emulated larvae, which look like those of a VAST, against their true values.

use crate::closures;
use carved::cli::emulated;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::inside::{BodySide, Eye};
use carved_core::pipeline::{Pipeline, PipelineSettings, SpecimenRecord};
use hardware_sim::scene::phantom::OrganTruth;
use hardware_sim::scene::{Exposure, Larva, Look, Placement, Scene, SceneSettings};
use rayon::prelude::*;
use std::f64::consts::TAU;

const VIEWS: u32 = 21;

/// A measured larva and the true values of its eyes, in the frame of the capillary.
struct Measured {
    name: String,
    record: SpecimenRecord,
    eyes: [OrganTruth; 2],
    roll_rad: f64,
}

/// `None` where the larva does not fit into the bore.
fn measured(dpf: u8, seed: u64, look: Look) -> Option<Measured> {
    let settings = PipelineSettings { planned_views: VIEWS, ..closures::settings() };
    let mut rig = SceneSettings::real_in(&emulated::scene_camera(&settings.camera), seed);
    rig.optics.noise_seed = seed;
    let larva = Larva::new(dpf, seed).unwrap().with_look(look);
    let eyes = larva.true_eyes();
    let placement = Placement { roll_rad: seed as f64, faces_right: seed % 2 == 1, ..Placement::default() };
    let specimen = larva.specimen().placed(placement).centred();
    let placement = specimen.placement();
    let scene = Scene::new(rig);
    scene.load(specimen).ok()?;
    let mut pipeline = Pipeline::new(settings).unwrap();
    let omega = |view: u32| TAU * f64::from(view) / f64::from(VIEWS);
    let look = |view: u32| {
        let rgb = scene.render(&Exposure { angle_rad: omega(view), number: u64::from(view) });
        pipeline.look(&RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8()).unwrap()).unwrap()
    };
    let seen: Vec<_> = (0..=VIEWS).into_par_iter().map(look).collect();
    for (view, frame) in (0..VIEWS).zip(&seen) {
        pipeline.observe(view, omega(view), frame).unwrap();
    }
    pipeline.observe_closure(&seen[VIEWS as usize]);
    let (_, record) = pipeline.finish().unwrap();
    let eyes = eyes.map(|eye| OrganTruth { centre_um: placement.place(eye.centre_um), ..eye });
    Some(Measured { name: format!("{dpf} dpf, seed {seed}"), record, eyes, roll_rad: placement.roll_rad })
}

/// Errors of the two eyes of a larva.
struct Errors {
    /// Of the volumes, %.
    volume: [f64; 2],
    /// Of the volumes, in stated standard deviations.
    sds: [f64; 2],
    /// Of the distance, %.
    distance: f64,
    /// Angle between the back that was found and the true one, deg. `None` where none was found.
    back_deg: Option<f64>,
    /// Whether each eye is named as the side it is on. The emulated larva's first eye is the right one.
    has_sides: bool,
}

impl Measured {
    fn errors(&self) -> Option<Errors> {
        let found = self.record.eyes.as_ref()?;
        let [a, b] = found.eyes[..] else { return None };
        let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        let is_first = apart(a.centre_um, self.eyes[0].centre_um) < apart(b.centre_um, self.eyes[0].centre_um);
        let [of_a, of_b] = if is_first { self.eyes } else { [self.eyes[1], self.eyes[0]] };
        let off = |eye: &Eye, truth: &OrganTruth| eye.volume_um3 - truth.volume_um3;
        let sides = if is_first { [BodySide::Right, BodySide::Left] } else { [BodySide::Left, BodySide::Right] };
        // The back lies at -y of the larva's own frame. It faces the camera, which is at -z, when it has no part along y.
        let (sin, cos) = self.roll_rad.sin_cos();
        let back_deg = self.record.facing.as_ref().map(|facing| {
            let off = facing.roll_deg.to_radians() - cos.atan2(sin);
            (off - TAU * (off / TAU).round()).to_degrees()
        });
        Some(Errors {
            volume: [(&a, &of_a), (&b, &of_b)].map(|(eye, truth)| 100.0 * off(eye, truth) / truth.volume_um3),
            sds: [(&a, &of_a), (&b, &of_b)].map(|(eye, truth)| off(eye, truth) / eye.volume_sd_um3),
            distance: 100.0 * (found.distance_um? / apart(self.eyes[0].centre_um, self.eyes[1].centre_um) - 1.0),
            back_deg,
            has_sides: [a.side, b.side] == sides.map(Some),
        })
    }
}

#[test]
fn the_eyes_of_a_larva_have_their_volume_distance_and_side() {
    // One looks to the left and one to the right; their rolls differ by a radian.
    for seed in [9100, 9101] {
        let m = measured(4, seed, Look::healthy(4, seed)).unwrap();
        let errors = m.errors().unwrap_or_else(|| panic!("{}: {:?}", m.name, m.record.eyes));
        let Errors { volume, sds, distance, back_deg, has_sides } = errors;
        assert!(volume.iter().all(|e| e.abs() < 9.0) && sds.iter().all(|s| s.abs() < 2.0), "{}: {volume:?} %, {sds:?} SD", m.name);
        assert!(distance.abs() < 2.0, "{}: {distance} %", m.name);
        assert!(back_deg.is_some_and(|off| off.abs() < 3.0) && has_sides, "{}: back off by {back_deg:?} deg", m.name);
        let confidence = m.record.facing.as_ref().map_or(0.0, |facing| facing.confidence);
        assert!(confidence > 0.9, "{}: {confidence}", m.name);
    }
}

/// Prints the errors of many larvae, a quarter of them sick: `CARVED_LARVAE=40 cargo test --test science inside::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints the errors"]
fn survey() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default);
    let first = number("CARVED_FROM", 9000);
    for seed in first..first + number("CARVED_LARVAE", 4) {
        let dpf = 3 + (seed % 4) as u8;
        let look = Look::drawn(dpf, seed);
        // A curled larva may not fit the bore.
        let Some(m) = measured(dpf, seed, look) else { continue };
        match m.errors() {
            Some(Errors { volume: [a, b], sds, distance, back_deg, has_sides }) => println!(
                "{}, {:?}: volumes {a:+.1} and {b:+.1} % ({:+.1} and {:+.1} SD), distance {distance:+.2} %, back off {back_deg:?} deg, sides {has_sides}",
                m.name, look.condition, sds[0], sds[1]
            ),
            None => println!("{}, {:?}: {:?}", m.name, look.condition, m.record.eyes),
        }
    }
}
