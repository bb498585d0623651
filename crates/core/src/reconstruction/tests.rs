use super::calibrated::given;
use super::*;
use crate::geometry::BoxUm;
use crate::geometry::Camera;
use crate::measure::Fallback;
use crate::surface::topology::Topology;
use std::f64::consts::{PI, TAU};

fn camera() -> Camera {
    Camera {
        f: 60_000.0,
        kx: 1.0 / 5.5,
        ky: 1.0 / 5.5,
        ux: 80.0,
        uy: 70.0,
        s: 0.0,
        alpha: 0.0,
        gamma: 0.0,
        phi: std::f64::consts::FRAC_PI_2,
        width: 160,
        height: 144,
        glass: None,
    }
}

/// Silhouette of a ball: a pixel is inside where its centre's ray passes the ball's centre within the radius.
fn bead(omega: f64, [x, y, z]: [f64; 3], radius: f64) -> Mask {
    let cam = camera();
    let (sin, cos) = omega.sin_cos();
    let at = [x, cos * y - sin * z, sin * y + cos * z + cam.f];
    let mut mask = Mask::empty(160, 144);
    for v in 0..144 {
        for u in 0..160 {
            let ray = [(u as f64 - cam.ux) / (cam.kx * cam.f), (v as f64 - cam.uy) / (cam.ky * cam.f), 1.0];
            let dot: f64 = (0..3).map(|a| ray[a] * at[a]).sum();
            let (ray2, at2): (f64, f64) = (ray.iter().map(|c| c * c).sum(), at.iter().map(|c| c * c).sum());
            mask.set(u, v, at2 - dot * dot / ray2 <= radius * radius);
        }
    }
    mask
}

const CENTRE: [f64; 3] = [40.0, 21.0, -13.0];

fn views(asd: u32) -> Vec<(Mask, f64)> {
    (0..asd).map(|i| TAU * f64::from(i) / f64::from(asd)).map(|omega| (bead(omega, CENTRE, 250.0), omega)).collect()
}

fn started(planned: usize) -> Reconstruction {
    let grid = VoxelGrid::new(BoxUm { min: [-350.0; 3], max: [350.0; 3] }, 6.93).unwrap();
    Reconstruction::new(&camera(), grid, planned, ReconstructionSettings::default()).unwrap()
}

fn made(views: &[(Mask, f64)]) -> Model {
    let mut model = started(views.len());
    for (mask, omega) in views {
        model.observe(mask, &[], *omega, Leaves::default()).unwrap();
    }
    model.finish(true).unwrap().model
}

/// The hull of 21 views with one miss exceeds a disc's area, and a ball's volume, by 1.31 %. The method promises that to
/// 0.6 %: here an outline errs by up to half a pixel, evenly, a tenth of one on average over 42 directions: 0.2 % of the
/// radius of 45 px, 0.6 % of volume. The diameter has a third of all that, less the third of fairing's loss: within 1 %.
#[test]
fn a_bead_has_its_size() {
    let Model { mesh, unfaired, measurement: m, touches_box } = made(&views(21));
    let sphere = m.sphere.unwrap();
    assert!((sphere.diameter_um / 500.0 - 1.0).abs() < 0.01, "{sphere:?}");
    assert!(sphere.rms_um < 0.02 * 250.0, "{sphere:?}");
    // Half a voxel is what a centre can be off by when every view errs alike.
    assert!((0..3).all(|a| (sphere.centre_um[a] - CENTRE[a]).abs() < 3.5 && (m.centroid_um[a] - CENTRE[a]).abs() < 3.5), "{m:?}");
    let truth = 4.0 / 3.0 * PI * 250f64.powi(3);
    let voxel = m.estimators.voxel;
    assert!((voxel.volume_um3 / truth - 1.0131).abs() < 0.006, "{}", voxel.volume_um3 / truth);
    assert!((voxel.area_um2 / (4.0 * PI * 250.0 * 250.0) - 1.0).abs() < 0.02, "{}", voxel.area_um2);
    assert!(m.unfaired_area_um2 > 1.06 * voxel.area_um2, "fairing takes the staircase off");
    // Slices by support functions know no tolerance and no voxels: what is left is the pixels' 0.6 %.
    assert_eq!((m.estimator, m.fallback.as_deref()), (Estimator::Support, None));
    assert!((m.volume_um3 / truth - 1.0).abs() < 0.006, "{}", m.volume_um3 / truth);
    assert!((m.area_um2 / (4.0 * PI * 250.0 * 250.0) - 1.0).abs() < 0.006, "{}", m.area_um2);
    assert!((m.diameter_um.unwrap() / 500.0 - 1.0).abs() < 0.002 && (m.aspect_ratio.unwrap() - 1.0).abs() < 0.01, "{m:?}");
    assert!((0.0..0.02).contains(&m.fairing_volume_loss), "{}", m.fairing_volume_loss);
    // The pixels' sides are the outline here: the same hull without the voxels' staircase.
    assert!((m.field_volume_um3 / voxel.volume_um3 - 1.0).abs() < 0.004, "{m:?}");
    assert!((m.field_area_um2 / (4.0 * PI * 250.0 * 250.0) - 1.0).abs() < 0.03, "{}", m.field_area_um2);
    assert!((measure::area(&mesh) - m.field_area_um2).abs() < 1e-9 * m.field_area_um2, "the mesh that is kept is the field's");
    assert_eq!(voxel.volume_um3, m.voxels as f64 * 6.93f64.powi(3));
    assert!(!touches_box && measure::area(&unfaired) == m.unfaired_area_um2);
    assert_eq!(Topology::of(&mesh).euler_characteristic(), 2);
    assert!(Topology::of(&mesh).is_closed());
}

/// Four columns in which no view shows the ball cut 9 % of it off. The voxels keep it.
#[test]
fn a_specimen_with_a_hole_in_its_slices_is_not_measured_by_one_side_of_it() {
    let mut views = views(12);
    let (uncut, u) = (made(&views), 60..64);
    for (mask, _) in &mut views {
        u.clone().for_each(|u| (0..144).for_each(|v| mask.set(u, v, false)));
    }
    let m = made(&views).measurement;
    let why = m.fallback.unwrap();
    assert!(m.estimator == Estimator::Voxel && why.contains("9 % of the volume lies beyond"), "{why}");
    let lost = 1.0 - m.volume_um3 / uncut.measurement.estimators.voxel.volume_um3;
    assert!((0.0..0.05).contains(&lost), "{lost}");
}

/// The ball reaches to 40 + 250 um along x.
#[test]
fn a_hull_that_reaches_the_end_of_its_box_is_named() {
    for (end, touches) in [(250.0, true), (320.0, false)] {
        let grid = VoxelGrid::new(BoxUm { min: [-350.0; 3], max: [end, 350.0, 350.0] }, 6.93).unwrap();
        let mut model = Reconstruction::new(&camera(), grid, 7, ReconstructionSettings::default()).unwrap();
        for (mask, omega) in views(7) {
            model.observe(&mask, &[], omega, Leaves::default()).unwrap();
        }
        assert_eq!(model.finish(false).unwrap().model.touches_box, touches, "to {end} um");
    }
}

#[test]
fn the_order_of_views_and_the_number_of_threads_do_not_matter() {
    let mut views = views(7);
    let model = made(&views);
    views.reverse();
    views.swap(1, 4);
    assert_eq!(made(&views), model);
    for threads in [1, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| made(&views)), model, "{threads} threads");
    }
}

#[test]
fn the_live_volume_falls_to_the_final_one_and_has_a_mesh_on_the_way() {
    let views = views(12);
    let calibration = CalibrationSettings { enabled: false, ..CalibrationSettings::default() };
    let settings = ReconstructionSettings { calibration, ..ReconstructionSettings::default() };
    let mut model = Reconstruction::new(&camera(), *started(12).hull().carver().grid(), 12, settings).unwrap();
    let mut last = f64::INFINITY;
    for (mask, omega) in &views {
        let live = model.observe(mask, &[], *omega, Leaves::default()).unwrap();
        assert!(live.volume_um3 <= last);
        last = live.volume_um3;
        let mesh = model.live_mesh();
        assert!(Topology::of(&mesh).is_closed());
        // The coarse surface cuts the hull's edges by a part of its 28 um.
        let share = measure::volume(&mesh) / last;
        assert!((0.85..1.05).contains(&share), "{share}");
    }
    let measured = model.finish(false).unwrap();
    assert_eq!(measured.model.measurement.estimators.voxel.volume_um3, last, "as long as the camera is the given one");
    assert_eq!(measured.calibration.unwrap_err(), NotCalibrated::NotAsked);
}

/// The ball is where the camera has it: an axis 3 px beside that makes its hull smaller all around.
#[test]
fn a_calibration_that_leaves_less_than_the_camera_as_given_is_not_used() {
    let mut model = started(21);
    for (mask, omega) in views(21) {
        model.observe(&mask, &[], omega, Leaves::default()).unwrap();
    }
    let mut calibrated = model.calibrate();
    let given = given(&model.observed, &calibrated.order);
    let Judged { calibration, vrv } = calibrated.found.clone().unwrap();
    assert!(vrv.solution_um3 > 0.99 * vrv.given_um3 && model.judge(calibration.clone(), &given).is_ok());
    let mut wrong = calibration;
    wrong.camera.uy += 3.0;
    let why = model.judge(wrong, &given).unwrap_err();
    let NotCalibrated::Worse { given_um3, solution_um3 } = why else { panic!("{why}") };
    assert!(solution_um3 < 0.95 * given_um3 && why.to_string().contains(&format!("{given_um3:.4e}")), "{why}");
    // Measured as if calibration had not been asked for.
    calibrated.found = Err(why.clone());
    let measured = model.measure(&model.finned(calibrated, false), None, false).unwrap();
    let as_given = CalibrationSettings { enabled: false, ..CalibrationSettings::default() };
    let settings = ReconstructionSettings { calibration: as_given, ..ReconstructionSettings::default() };
    let mut plain = Reconstruction::new(&camera(), *model.hull().carver().grid(), 21, settings).unwrap();
    for (mask, omega) in views(21) {
        plain.observe(&mask, &[], omega, Leaves::default()).unwrap();
    }
    assert_eq!(measured.model, plain.finish(false).unwrap().model);
    assert_eq!(measured.calibration, Err(why));
}

#[test]
fn what_few_views_do_not_show_is_in_the_uncertainty_of_the_end_as_in_mid_turn() {
    for (n, shown) in [(12, false), (21, true)] {
        let mut model = started(n);
        for (mask, omega) in views(n as u32) {
            model.observe(&mask, &[], omega, Leaves::default()).unwrap();
        }
        let measured = model.finish(false).unwrap().model.measurement;
        assert_eq!(measured.spread.unwrap().volume_corners_um3 == 0.0, shown, "{n} views: {:?}", measured.spread);
        assert_eq!(measured.volume_sd_um3, model.estimate(false).map(|e| e.stated_sd_um3));
    }
}

/// Silhouette of an ellipsoid of 300, 220 and 150 um half axes that lies askew, in a camera far away.
fn ellipsoid(omega: f64) -> Mask {
    let cam = camera();
    let across = omega + 0.4;
    // Half the extent across of an ellipse of 220 and 150 um.
    let half_um = (220.0 * across.cos()).hypot(150.0 * across.sin());
    let middle_um = CENTRE[1] * omega.cos() - CENTRE[2] * omega.sin();
    let mut mask = Mask::empty(160, 144);
    for (u, v) in (0..160).flat_map(|u| (0..144).map(move |v| (u, v))) {
        let at = [(u as f64 - cam.ux) / cam.kx / 300.0, ((v as f64 - cam.uy) / cam.ky - middle_um) / half_um];
        mask.set(u, v, at[0].hypot(at[1]) <= 1.0);
    }
    mask
}

/// A turn that is measured with the camera as given knows less than a calibrated one, wherever this camera is off, and says so.
#[test]
fn a_turn_without_a_calibration_states_more_uncertainty_and_covers_the_truth() {
    let far = Camera { f: 1e8, ..camera() };
    let truth = 4.0 / 3.0 * PI * 300.0 * 220.0 * 150.0;
    let measured = |camera: &Camera, enabled: bool, middle_v: Option<f64>| {
        let settings = ReconstructionSettings {
            calibration: CalibrationSettings { enabled, ..CalibrationSettings::default() },
            ..ReconstructionSettings::default()
        };
        let grid = VoxelGrid::new(BoxUm { min: [-400.0; 3], max: [400.0; 3] }, 8.0).unwrap();
        let mut model = Reconstruction::new(camera, grid, 21, settings).unwrap();
        for omega in (0..21).map(|i| TAU * f64::from(i) / 21.0) {
            model.observe(&ellipsoid(omega), &[], omega, Leaves::default()).unwrap();
        }
        model.measure(&model.finned(model.calibrate(), false), middle_v, false).unwrap().model.measurement
    };
    let calibrated = measured(&far, true, None).spread.unwrap();
    for off_px in [0.0, -3.0, 6.0, 10.0] {
        let camera = Camera { uy: far.uy + off_px, ..far.clone() };
        let m = measured(&camera, false, Some(far.uy));
        let spread = m.spread.unwrap();
        assert!(spread.volume_calibration_um3 > calibrated.volume_calibration_um3, "{off_px} px: {spread:?} {calibrated:?}");
        assert!(spread.area_calibration_um2 > calibrated.area_calibration_um2, "{off_px} px: {spread:?} {calibrated:?}");
        assert!((m.volume_um3 - truth).abs() < 2.0 * m.volume_sd_um3.unwrap(), "{off_px} px: {} of {truth}, {spread:?}", m.volume_um3);
        // An axis beside the middle moves upper and lower edges in opposite ways, which changes no slice and is no noise. It takes so much
        // off the voxels that the bore shows more uncertainty.
        let off = 100.0 * (m.volume_um3 / truth - 1.0);
        let bias = 100.0 * m.estimators.support.as_ref().unwrap().volume_bias_um3 / truth;
        assert!(off.abs() < 0.5 && bias.abs() < 0.2, "{off_px} px: {off:+.2} %, bias {bias:+.2} %");
    }
}

/// The numbers themselves do not show that a part of their standard deviation is missing.
#[test]
fn numbers_have_no_standard_deviation_where_that_of_the_calibration_is_not_known() {
    let mut model = started(12);
    for (mask, omega) in views(12) {
        model.observe(&mask, &[], omega, Leaves::default()).unwrap();
    }
    for (at, variance) in [((0, 0), 0.0), ((2, 2), f64::NAN), ((3, 3), f64::INFINITY), ((0, 1), f64::NAN)] {
        // A bead is not searched for fins, after which it would be calibrated again.
        let mut calibrated = model.calibrate();
        calibrated.found.as_mut().unwrap().calibration.covariance[at] = variance;
        assert!(model.estimated(&model.finned(calibrated.clone(), true)).is_none(), "{at:?} = {variance}");
        let TurnModel { model: Model { measurement: m, .. }, fallback, .. } =
            model.measure(&model.finned(calibrated, true), None, true).unwrap();
        assert!(matches!(fallback, Some(Fallback::NoCalibrationSd(_))), "{at:?} = {variance}: {fallback:?}");
        assert_eq!((m.volume_sd_um3, m.area_sd_um2, m.spread, m.estimator), (None, None, None, Estimator::Voxel));
        assert_eq!(m.volume_um3, m.estimators.voxel.volume_um3);
        assert!(m.fallback.unwrap().ends_with("finite numbers above 0 are needed"));
    }
}

#[test]
fn a_live_model_is_refined_from_enough_sides_only_and_not_after_each_view() {
    let (mut model, views) = (started(12), views(12));
    let mut refined_at = Vec::new();
    for (n, (mask, omega)) in (1..).zip(&views) {
        model.observe(mask, &[], *omega, Leaves::default()).unwrap();
        if model.is_refinable() {
            model.refine(false);
            refined_at.push(n);
            assert!(!model.is_refinable(), "nothing is new");
        }
        assert_eq!(model.live().views, n);
        assert_eq!(model.refined.is_some(), !refined_at.is_empty());
    }
    // Eight views of 12 leave a gap of 150 deg.
    assert_eq!(refined_at, [8, 9, 10, 11, 12]);
    let settings = ReconstructionSettings {
        calibration: CalibrationSettings { enabled: false, ..CalibrationSettings::default() },
        ..ReconstructionSettings::default()
    };
    let mut as_given = Reconstruction::new(&camera(), *model.hull().carver().grid(), 12, settings).unwrap();
    for (mask, omega) in &views {
        as_given.observe(mask, &[], *omega, Leaves::default()).unwrap();
        assert!(!as_given.is_refinable(), "calibration is not asked for");
    }
    model.replan(24).unwrap();
    assert!(model.refined.is_none(), "carved by the old plan");
}

#[test]
fn what_makes_no_model_is_refused_by_name() {
    let mut model = started(2);
    assert_eq!(model.finish(false).unwrap_err(), ReconstructionError::NoViews { observed: 0, planned: 2 });
    let small = ReconstructionError::MaskSize { width: 9, height: 9, sensor_width: 160, sensor_height: 144 };
    assert_eq!(model.observe(&Mask::empty(9, 9), &[], 0.0, Leaves::default()), Err(small));
    assert!(matches!(model.observe(&bead(0.0, CENTRE, 250.0), &[], f64::NAN, Leaves::default()), Err(ReconstructionError::Omega { .. })));
    assert_eq!(model.hull().live().views, 0, "refused views don't count");
    model.observe(&Mask::empty(160, 144), &[], 0.0, Leaves::default()).unwrap();
    assert_eq!(model.finish(false).unwrap_err(), ReconstructionError::EmptyHull { observed: 1 });

    let grid = *model.hull().carver().grid();
    let mut hull = HullModel::new(grid, 4, ReconstructionSettings::default()).unwrap();
    let middle: [f64; 3] = std::array::from_fn(|a| f64::midpoint(grid.centre(a, 0), grid.centre(a, grid.counts()[a] - 1)));
    let half = middle[2] - grid.centre(2, 0);
    for depth in [-5.0, 0.0, 1e-3, half - 1.0, half + 2.0 * grid.size()] {
        let [x, y, z] = middle.map(|c| -c);
        let near =
            Projection::from_matrix([[100.0, 0.0, 80.0, 100.0 * x], [0.0, 100.0, 72.0, 100.0 * y], [0.0, 0.0, 1.0, z + depth]]).unwrap();
        let observed = hull.clone().observe(&bead(0.0, CENTRE, 250.0), &[], &near, Leaves::default());
        match observed {
            Err(ReconstructionError::CameraInBox { .. }) => assert!(depth < half, "{depth}"),
            other => assert!(depth > half && other.is_ok(), "{depth}: {other:?}"),
        }
    }
    let close = Projection::from_matrix([[1e6, 0.0, 80.0, 0.0], [0.0, 1e6, 72.0, 0.0], [0.0, 0.0, 1.0, 2000.0]]).unwrap();
    let refused = hull.observe(&bead(0.0, CENTRE, 250.0), &[], &close, Leaves::default());
    assert!(matches!(refused, Err(ReconstructionError::Contour(_))), "{refused:?}");
    assert_eq!(hull.live().views, 0);

    for (surface, said) in [
        (SurfaceSettings { fairing_lambda: -0.1, ..SurfaceSettings::default() }, "fairing_lambda = -0.1; expected 0 to 100 (weight)"),
        (SurfaceSettings { fairing_lambda: f64::NAN, ..SurfaceSettings::default() }, "fairing_lambda = NaN; expected 0 to 100 (weight)"),
        (
            SurfaceSettings { fairing_iterations: 1001, ..SurfaceSettings::default() },
            "fairing_iterations = 1001; expected 0 to 1000 iterations",
        ),
    ] {
        let settings = ReconstructionSettings { surface, ..ReconstructionSettings::default() };
        assert_eq!(Reconstruction::new(&camera(), grid, 4, settings).unwrap_err().to_string(), said);
    }
    let camera = Camera { kx: 0.0, ..camera() };
    assert!(matches!(Reconstruction::new(&camera, grid, 4, ReconstructionSettings::default()), Err(ReconstructionError::Camera(_))));
}
