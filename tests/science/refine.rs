//! The live model of a capillary that is not where the rig's camera has it. The model is refined while the views come in, so that it does
//! not shrink wrongly, and the final result has the same bytes with and without refinement.

use carved::config::Config;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::{Pipeline, PipelineSettings, SegmentedFrame};
use carved_core::quality::Estimate;
use carved_core::surface::Mesh;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::ViewOrder;
use hardware_sim::scene::{Exposure, Placement, Scene, SceneSettings, Specimen};
use rayon::prelude::*;
use std::path::Path;

const ASD: u32 = 21;

/// The settings of the emulated rig, with voxels that are fast to compute.
fn settings() -> (PipelineSettings, Config) {
    let mut config = Config::parse(include_str!("../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
    let mut method = config.methods.remove("standard").unwrap();
    (method.asd, method.voxel_um) = (ASD, 14.0);
    (method.pipeline(&config.optics, false).unwrap(), config)
}

/// The frames of a larva from a camera that is 4 px and half a degree off.
fn frames(omegas: &[f64]) -> Vec<RawFrame> {
    let mut settings = SceneSettings::default();
    settings.camera.uy_px += 4.0;
    settings.camera.gamma_rad += 0.5f64.to_radians();
    let scene = Scene::new(settings);
    scene.load(Some(Specimen::larva(4, 5).unwrap().placed(Placement::default()))).unwrap();
    let render = |(number, &angle_rad): (usize, &f64)| {
        let frame = scene.render(&Exposure { angle_rad, number: number as u64 });
        RawFrame::new(frame.width, frame.height, PixelFormat::BayerRG8, frame.to_bayer_rg8()).unwrap()
    };
    omegas.iter().enumerate().map(render).collect()
}

/// The result of a turn: the live volume after each view, the numbers of views at which the model was refined, and the final numbers.
struct Taken {
    live_um3: Vec<f64>,
    refined_at: Vec<usize>,
    /// The volume estimate of each refinement.
    estimates: Vec<Estimate>,
    mesh: Mesh,
    record: String,
    end_um3: f64,
    measured_um3: f64,
}

fn take(order: &[u32], omegas: &[f64], seen: &[SegmentedFrame], refining: bool) -> Taken {
    let mut pipeline = Pipeline::new(settings().0).unwrap();
    let (mut live_um3, mut refined_at, mut estimates) = (Vec::new(), Vec::new(), Vec::new());
    for (views, &index) in (1..).zip(order) {
        let at = index as usize;
        pipeline.observe(index, omegas[at], &seen[at]).unwrap();
        if refining && pipeline.is_refinable() {
            estimates.extend(pipeline.refine());
            refined_at.push(views);
        } else if refining && refined_at.is_empty() {
            assert_eq!(pipeline.estimate(), None, "{views} views tell no axis");
        }
        live_um3.push(pipeline.live().volume_um3);
        assert_eq!(pipeline.live().views, views);
    }
    pipeline.observe_closure(&seen[0]);
    let (mesh, record) = pipeline.finish().unwrap();
    let (end_um3, measured_um3) = (record.measurement.estimators.voxel.volume_um3, record.measurement.volume_um3);
    Taken { live_um3, refined_at, estimates, mesh, record: serde_json::to_string(&record).unwrap(), end_um3, measured_um3 }
}

#[test]
fn the_live_model_comes_to_the_end_while_the_capillary_turns_and_the_end_knows_nothing_of_it() {
    let (settings, config) = settings();
    let omegas: Vec<f64> = (0..ASD).map(|i| std::f64::consts::TAU * f64::from(i) / f64::from(ASD)).collect();
    let looker = Pipeline::new(settings).unwrap();
    let seen: Vec<SegmentedFrame> = frames(&omegas).par_iter().map(|frame| looker.look(frame).unwrap()).collect();
    let mut ends = Vec::new();
    for view_order in [ViewOrder::Sequential, ViewOrder::CoarseToFine] {
        let plan = RevolutionPlan::new(ASD, config.steps_per_revolution, view_order).unwrap();
        let order: Vec<u32> = plan.stops().iter().filter(|stop| !stop.closure).map(|stop| stop.view).collect();
        let [refined, plain] = [true, false].map(|refining| take(&order, &omegas, &seen, refining));
        let share = |of: &[f64], views: usize| of[views - 1] / refined.end_um3;
        let told: Vec<String> =
            (1..=order.len()).map(|n| format!("{n}: {:.3} ({:.3})", share(&refined.live_um3, n), share(&plain.live_um3, n))).collect();
        println!("{view_order:?}: refined at {:?}; live over end, refined (and not): {}", refined.refined_at, told.join(", "));
        // Sequential views see the body from both sides after half a turn and 30 deg: view 13 of 21.
        let first = if view_order == ViewOrder::Sequential { 14 } else { 7 };
        assert_eq!(refined.refined_at, (first..=order.len()).step_by(2).collect::<Vec<_>>());
        // Few views leave a hull that is too large, in theory by 3 % at 14 views with one tolerated miss each. No hull is too small.
        assert!((first..=order.len()).all(|n| share(&refined.live_um3, n) > 0.97), "{told:?}");
        assert!((order.len() - 1..=order.len()).all(|n| share(&refined.live_um3, n) < 1.03), "{told:?}");
        assert!(share(&plain.live_um3, order.len()) < 0.9, "the camera as given eats the body away: {told:?}");
        assert_eq!(refined.record, plain.record, "the same numbers, whether or not the live model was refined");
        assert_eq!(refined.mesh, plain.mesh);
        the_estimates_are_honest(&refined);
        ends.push(refined.record);
    }
    assert_eq!(ends[0], ends[1], "and whatever the order");
}

/// Each estimate is within three standard deviations of the final volume, and the last one is the most precise.
fn the_estimates_are_honest(Taken { refined_at, estimates, measured_um3, .. }: &Taken) {
    assert_eq!(&estimates.iter().map(|e| e.views).collect::<Vec<_>>(), refined_at, "{estimates:?}");
    for e in estimates {
        assert!((e.volume_um3 - measured_um3).abs() < 3.0 * e.volume_sd_um3, "{e:?}, in the end {measured_um3}");
        assert!(e.stated_sd_um3 > e.volume_sd_um3, "the rig's edges are in it: {e:?}");
    }
    let [first, last] = [&estimates[0], &estimates[estimates.len() - 1]];
    assert!(last.volume_sd_um3 < first.volume_sd_um3, "{first:?} and {last:?}");
    if last.views == ASD as usize {
        assert_eq!(last.volume_um3.to_bits(), measured_um3.to_bits(), "of all views it is what is measured");
    }
}
