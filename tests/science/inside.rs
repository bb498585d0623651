//! Organs inside emulated larvae, which look like those of a VAST, against their true values.

use crate::closures;
use carved::cli::emulated;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::inside::{BladderState, BodySide, Eye, SwimBladder};
use carved_core::pipeline::{Pipeline, PipelineSettings, SpecimenRecord};
use hardware_sim::scene::phantom::OrganTruth;
use hardware_sim::scene::{Bladder, Condition, Exposure, Larva, Look, Placement, Scene, SceneSettings};
use rayon::prelude::*;
use std::f64::consts::TAU;

const VIEWS: u32 = 21;

/// A measured larva and the true values of its organs, in the frame of the capillary.
struct Measured {
    name: String,
    record: SpecimenRecord,
    eyes: [OrganTruth; 2],
    /// Of the gas in its swim bladder.
    gas: Option<OrganTruth>,
    roll_rad: f64,
}

/// `None` where the larva does not fit into the bore.
fn measured(dpf: u8, seed: u64, look: Look) -> Option<Measured> {
    let settings = PipelineSettings { planned_views: VIEWS, ..closures::settings() };
    let mut rig = SceneSettings::real_in(&emulated::scene_camera(&settings.camera), seed);
    rig.optics.noise_seed = seed;
    let larva = Larva::new(dpf, seed).unwrap().with_look(look);
    let (eyes, gas) = (larva.true_eyes(), larva.true_bladder());
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
    let placed = |organ: OrganTruth| OrganTruth { centre_um: placement.place(organ.centre_um), ..organ };
    let (eyes, gas) = (eyes.map(placed), gas.map(placed));
    Some(Measured { name: format!("{dpf} dpf, seed {seed}"), record, eyes, gas, roll_rad: placement.roll_rad })
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

impl Measured {
    fn bladder(&self) -> &SwimBladder {
        self.record.bladder.as_ref().unwrap()
    }

    /// Error of the gas in %, in stated standard deviations, and of its place in um.
    fn gas_off(&self) -> Option<[f64; 3]> {
        let (found, truth) = (self.bladder(), self.gas?);
        let off = found.volume_um3? - truth.volume_um3;
        let volume: f64 = found.lobes.iter().map(|lobe| lobe.volume_um3).sum();
        let middle = |i: usize| found.lobes.iter().map(|lobe| lobe.centre_um[i] * lobe.volume_um3).sum::<f64>() / volume;
        let apart = (0..3).map(|i| (middle(i) - truth.centre_um[i]).powi(2)).sum::<f64>().sqrt();
        Some([100.0 * off / truth.volume_um3, off / found.volume_sd_um3?, apart])
    }

    /// Whether gas was found where there is some, and only there. Undecided is not right.
    fn tells_gas(&self) -> bool {
        let expected = if self.gas.is_some() { BladderState::Inflated } else { BladderState::NotInflated };
        self.bladder().state == expected
    }
}

#[test]
fn the_swim_bladder_of_a_larva_has_its_volume_and_its_place() {
    for (dpf, seed, bladder, lobes) in [(5, 9200, Bladder::OneLobe, 1), (6, 9201, Bladder::TwoLobes, 2)] {
        let m = measured(dpf, seed, Look { bladder, ..Look::healthy(dpf, seed) }).unwrap();
        let [percent, sds, apart] = m.gas_off().unwrap_or_else(|| panic!("{}: {:?}", m.name, m.bladder()));
        assert!(m.tells_gas() && m.bladder().lobes.len() == lobes, "{}: {:?}", m.name, m.bladder());
        assert!(percent.abs() < 10.0 && sds.abs() < 2.0 && apart < 8.0, "{}: {percent} %, {sds} SD, {apart} um", m.name);
        // The true middle along the line from the eyes, which is nearly the axis.
        let of_eyes = middle(&m.eyes);
        let exact = (0..3).map(|i| (m.gas.unwrap().centre_um[i] - of_eyes[i]).powi(2)).sum::<f64>().sqrt();
        let behind = m.bladder().behind_eyes_um.unwrap();
        assert!((behind / exact - 1.0).abs() < 0.03, "{}: {behind} um behind the eyes, true {exact}", m.name);
    }
}

fn middle([a, b]: &[OrganTruth; 2]) -> [f64; 3] {
    std::array::from_fn(|i| f64::midpoint(a.centre_um[i], b.centre_um[i]))
}

#[test]
fn pigment_over_a_bladder_without_gas_is_not_taken_for_gas() {
    // Dark pigment on the back, at ages with and without a bladder.
    for (dpf, seed, bladder) in [(3, 9210, Bladder::OneLobe), (5, 9211, Bladder::NotInflated)] {
        let m = measured(dpf, seed, Look { bladder, stripes: 1.0, density: 1.5, ..Look::healthy(dpf, seed) }).unwrap();
        assert!(m.gas.is_none() && m.tells_gas(), "{}: {:?}", m.name, m.bladder());
        assert!(m.bladder().reason.is_some() && m.bladder().volume_um3.is_none(), "{}: {:?}", m.name, m.bladder());
    }
}

/// Prints what is found of many swim bladders, a third without gas and a fifth with two lobes, a quarter of the larvae sick:
/// `CARVED_LARVAE=24 cargo test --test science inside::survey_of_bladders -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints the errors"]
fn survey_of_bladders() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default);
    let first = number("CARVED_FROM", 9300);
    for seed in first..first + number("CARVED_LARVAE", 5) {
        let dpf = 3 + (seed % 4) as u8;
        let drawn = Look::drawn(dpf, seed);
        let look = match seed % 5 {
            0 => Look { bladder: Bladder::NotInflated, ..drawn },
            1 => Look { bladder: Bladder::TwoLobes, ..drawn },
            2 if seed % 2 == 0 => Look { condition: Condition::NoSwimBladder, ..drawn },
            _ => drawn,
        };
        // A curled larva may not fit the bore.
        let Some(m) = measured(dpf, seed, look) else { continue };
        println!(
            "{}, {:?}, {:?}: {}, {:?} (probability {:.4}), {} lobes, off by {:.1?} [%, SD, um]",
            m.name,
            look.condition,
            look.bladder,
            if m.tells_gas() { "right" } else { "not right" },
            m.bladder().state,
            m.bladder().probability.unwrap_or(f64::NAN),
            m.bladder().lobes.len(),
            m.gas_off()
        );
    }
}
