//! Rendered and segmented closure views of specimens that were disturbed in a known way. Used by `tests/science/quality.rs` and by
//! `benches/closure_rates.rs`.
#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it

use carved::config::Config;
use carved_core::calibration::PoseOffset;
use carved_core::flag::Flag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::{Pipeline, PipelineSettings, SegmentedFrame, SpecimenRecord};
use hardware_sim::analytic;
use hardware_sim::scene::{Contents, Exposure, Placement, Scene, SceneSettings, Specimen};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::path::Path;

pub const ASD: u32 = 21;

pub fn even() -> Vec<f64> {
    (0..ASD).map(|i| TAU * f64::from(i) / f64::from(ASD)).collect()
}

pub fn settings() -> PipelineSettings {
    let mut config = Config::parse(include_str!("../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
    let mut method = config.methods.remove("standard").unwrap();
    (method.asd, method.voxel_um) = (ASD, 17.1);
    method.pipeline(&config.optics, false).unwrap()
}

pub fn rendered(contents: Contents, omegas: &[f64]) -> Vec<SegmentedFrame> {
    shown(contents, omegas, 0)
}

/// The pictures of a specimen at these angles. The exposures are numbered from `first` on, and each number has its own noise.
pub fn shown(contents: Contents, omegas: &[f64], first: u64) -> Vec<SegmentedFrame> {
    let looker = Pipeline::new(settings()).unwrap();
    let scene = Scene::new(SceneSettings::default());
    scene.load(contents).unwrap();
    let render = |(number, &angle_rad): (usize, &f64)| {
        let frame = scene.render(&Exposure { angle_rad, number: first + number as u64 });
        let frame = RawFrame::new(frame.width, frame.height, PixelFormat::BayerRG8, frame.to_bayer_rg8()).unwrap();
        looker.look(&frame).unwrap()
    };
    omegas.par_iter().enumerate().map(render).collect()
}

pub fn finished(mut pipeline: Pipeline, closure: &SegmentedFrame) -> SpecimenRecord {
    pipeline.observe_closure(closure);
    pipeline.finish().unwrap().1
}

/// The disturbance of a larva between its last view and its closure view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Done {
    /// No disturbance: two frames of a specimen at rest differ by their noise alone.
    Nothing,
    /// Turned in the capillary by +10 deg, twice the limit.
    Turned,
    /// Turned by -10 deg.
    TurnedBack,
    /// Shifted by 22 um = 4 px along the capillary.
    Along,
    /// Shifted by 22 um = 4 px across it.
    Across,
}

/// The result of one closure view.
pub struct Reading {
    pub done: Done,
    pub lie: PoseOffset,
    pub record: SpecimenRecord,
}

impl Reading {
    pub fn has_flag(&self, flag: Flag) -> bool {
        self.record.flags.iter().any(|raised| *raised == flag)
    }
}

/// Larvae of 3 to 5 dpf with any position and roll, on a shaft without errors. Returns one reading for each of `cases`; a case that is
/// listed again is taken again with new noise. A larva that would reach into the glass is left out.
pub fn readings(seeds: std::ops::Range<u64>, cases: &[Done]) -> Vec<Reading> {
    // This must not run on rayon's threads, because the pictures of one turn already use all of them.
    seeds.flat_map(|seed| of_seed(seed, cases)).collect()
}

fn of_seed(seed: u64, cases: &[Done]) -> Vec<Reading> {
    let omegas = even();
    // The fins reach up to 35 um from the glass: a start at -11 um leaves room for 22 um across.
    let seeded = analytic::Pose::seeded(seed);
    // Every other larva has a roll at which its left and right sides look alike in the first view. Its edges then hardly show a turn.
    let roll_rad = if seed.is_multiple_of(2) { 0.0 } else { seeded.roll_rad };
    let place = analytic::Pose { y_um: -11.0, z_um: seeded.z_um / 4.0, roll_rad, ..seeded };
    let larva = Specimen::larva(3 + (seed % 3) as u8, seed).unwrap();
    let at = |turn_deg: f64, x_um: f64, y_um: f64| -> Contents {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let place = Placement {
            x_um: place.x_um + x_um,
            y_um: place.y_um * cos - place.z_um * sin + y_um,
            z_um: place.y_um * sin + place.z_um * cos,
            roll_rad: place.roll_rad + turn_deg.to_radians(),
            ..Placement::default()
        };
        larva.clone().placed(place).into()
    };
    let moved = |done: Done| match done {
        Done::Nothing => at(0.0, 0.0, 0.0),
        Done::Turned => at(10.0, 0.0, 0.0),
        Done::TurnedBack => at(-10.0, 0.0, 0.0),
        Done::Along => at(0.0, 22.0, 0.0),
        Done::Across => at(0.0, 0.0, 22.0),
    };
    let scene = Scene::new(SceneSettings::default());
    if cases.iter().any(|done| scene.load(moved(*done)).is_err()) {
        return Vec::new();
    }
    let seen = rendered(moved(Done::Nothing), &omegas);
    let read = |(number, &done): (usize, &Done)| {
        let closure = shown(moved(done), &[TAU], 1000 + 10 * seed + number as u64).remove(0);
        let mut pipeline = Pipeline::new(settings()).unwrap();
        for (index, (omega, seen)) in (0..).zip(omegas.iter().zip(&seen)) {
            pipeline.observe(index, *omega, seen).unwrap();
        }
        let record = finished(pipeline, &closure);
        Reading { done, lie: record.closure.clone().unwrap().pose_offset.unwrap(), record }
    };
    cases.iter().enumerate().map(read).collect()
}
