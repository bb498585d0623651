//! Tests of the scene against formulas that it does not use.

mod contents;
mod larvae;
#[path = "../../../tests/common/shared.rs"]
mod shared;
#[path = "../../../tests/common/strict.rs"]
mod strict;

use super::*;
use std::f64::consts::PI;

fn exact() -> SceneSettings {
    SceneSettings { optics: Optics::exact(), ..SceneSettings::default() }
}

fn loaded(settings: SceneSettings, specimen: Specimen) -> Scene {
    let scene = Scene::new(settings);
    scene.load(Some(specimen)).unwrap();
    scene
}

fn at(x_um: f64, y_um: f64, z_um: f64) -> Placement {
    Placement { x_um, y_um, z_um, ..Placement::default() }
}

/// Area of a mask, px^2, and its centroid, px.
fn moments(mask: &Coverage) -> (f64, f64, f64) {
    let (mut m, mut u_sum, mut v_sum) = (0.0, 0.0, 0.0);
    for (i, &value) in mask.data.iter().enumerate() {
        let weight = f64::from(value) / 255.0;
        m += weight;
        u_sum += weight * (i % mask.width as usize) as f64;
        v_sum += weight * (i / mask.width as usize) as f64;
    }
    (m, u_sum / m, v_sum / m)
}

/// Top and bottom edge of one column of a mask with one covered piece, from the length and the middle of the piece.
fn edges(mask: &Coverage, u: usize) -> (f64, f64) {
    let column = (0..mask.height as usize).map(|v| f64::from(mask.data[v * mask.width as usize + u]) / 255.0);
    let (length, moment) = column.enumerate().fold((0.0, 0.0), |(l, m), (v, c)| (l + c, m + c * v as f64));
    (moment / length - length / 2.0, moment / length + length / 2.0)
}

#[test]
fn a_sphere_casts_the_ellipse_of_perspective() {
    // A sphere of radius r whose middle is at depth d on the axis of sight is seen as a circle of radius f k r / sqrt(d^2 - r^2).
    for (z, angle) in [(0.0, 0.0), (-70.0, 0.0), (60.0, 0.0), (0.0, 1.3)] {
        let scene = loaded(exact(), Specimen::bead(500.0).unwrap().placed(at(0.0, 0.0, z)));
        let mask = scene.truth_mask(angle);
        let depth: f64 = 60_000.0 + z;
        let radius_px = 60_000.0 / 5.5 * 250.0 / (depth * depth - 250.0f64.powi(2)).sqrt();
        let (area, u, v) = moments(&mask);
        assert!((u - 511.5).abs() < 0.02 && (v - 511.5).abs() < 0.02, "middle at ({u}, {v})");
        // Facets of 256 and 200 sides lose up to 0.007 px, coverage in 64 levels averages out.
        assert!(((area / PI).sqrt() - radius_px).abs() < 0.02, "{} against {radius_px}", (area / PI).sqrt());
        for u in [480usize, 500, 511, 530, 545] {
            // Mean height of the circle over the pixel's width.
            let half = (0..100)
                .map(|i| (u as f64 - 0.5 + (f64::from(i) + 0.5) / 100.0) - 511.5)
                .map(|d| (radius_px * radius_px - d * d).sqrt())
                .sum::<f64>()
                / 100.0;
            let (top, bottom) = edges(&mask, u);
            // One of 8 samples across a pixel, half of it either way, and facets.
            assert!((top - (511.5 - half)).abs() < 0.1, "column {u}: top {top} against {}", 511.5 - half);
            assert!((bottom - (511.5 + half)).abs() < 0.1, "column {u}: bottom {bottom} against {}", 511.5 + half);
        }
    }
}

#[test]
fn a_sphere_off_the_axis_is_where_the_pinhole_puts_it() {
    let scene = loaded(exact(), Specimen::bead(300.0).unwrap().placed(at(1100.0, 60.0, -80.0)));
    for angle in [0.0, 0.7, 2.0, 4.4] {
        let (sin, cos) = f64::sin_cos(angle);
        let (y, z) = (60.0 * cos + 80.0 * sin, 60.0 * sin - 80.0 * cos);
        let scale = 60_000.0 / 5.5 / (60_000.0 + z);
        let (_, u, v) = moments(&scene.truth_mask(angle));
        // The outline of a sphere off the axis of sight is stretched away from it by r^2 x / d^3: below 0.001 px here.
        assert!((u - (511.5 + 1100.0 * scale)).abs() < 0.03, "{u}");
        assert!((v - (511.5 + y * scale)).abs() < 0.03, "{v} at {angle}");
    }
}

#[test]
fn positive_angles_move_the_near_wall_down_the_picture() {
    let scene = loaded(exact(), Specimen::bead(200.0).unwrap().placed(at(0.0, 0.0, -200.0)));
    let v = |angle: f64| moments(&scene.truth_mask(angle)).2;
    assert!(v(0.3) > v(0.0) + 5.0);
    assert!(v(-0.3) < v(0.0) - 5.0);
}

#[test]
fn half_a_turn_mirrors_the_profile_where_perspective_is_weak() {
    let mut settings = exact();
    settings.camera.f_um = 6e7;
    let scene = loaded(settings, Specimen::larva(5, 2).unwrap().placed(at(0.0, 20.0, 10.0)));
    for angle in [0.0, 1.1] {
        let (one, other) = (scene.truth_mask(angle), scene.truth_mask(angle + PI));
        let width = one.width as usize;
        let mut unlike = 0;
        for v in 0..one.height as usize {
            for u in 0..width {
                // 511.5 is the middle: row v mirrors to 1023 - v.
                let mirrored = other.data[(1023 - v) * width + u];
                unlike += usize::from(one.data[v * width + u].abs_diff(mirrored) > 16);
            }
        }
        // A sample on an edge may be inside or outside. A missing flip would change thousands of pixels.
        assert!(unlike < 20, "{unlike} pixels differ");
    }
}

/// Int thickness dA at a far camera, where a pixel is 5.5 x 5.5 um at every depth.
fn volume_from_thickness(specimen: Specimen, angle: f64) -> f64 {
    let mut settings = exact();
    settings.camera.f_um = 6e7;
    let scene = loaded(settings, specimen);
    let contents = scene.contents();
    let specimen = &contents.specimens[0];
    let camera = &scene.settings().camera;
    let window = scene.window(contents.specimens.iter(), angle, 1, (4, 4)).unwrap();
    let plane = thickness(&specimen.parts[0].mesh, &camera.view(angle), camera.f_um, &window);
    plane.iter().map(|&t| f64::from(t)).sum::<f64>() * (5.5f64 / 4.0).powi(2)
}

#[test]
fn thickness_adds_up_to_the_true_volume() {
    for (what, specimen) in [
        ("bead", Specimen::bead(500.0).unwrap()),
        ("ellipsoid", Specimen::ellipsoid([900.0, 200.0, 120.0]).unwrap()),
        ("larva", Specimen::larva(4, 5).unwrap()),
    ] {
        let truth = specimen.truth().volume_um3;
        for angle in [0.0, 0.9, 2.4] {
            let off = volume_from_thickness(specimen.clone(), angle) / truth - 1.0;
            // The drawn mesh is inscribed: 4e-4 for the coarsest (144 segments). Sampling adds 1e-4.
            assert!(off.abs() < 1e-3, "{what} at {angle}: {off:.2e}");
        }
    }
}

#[test]
fn frames_repeat_by_number_and_differ_between_numbers() {
    let scene = loaded(SceneSettings::default(), Specimen::larva(3, 1).unwrap());
    let frame = |number| scene.render(&Exposure { angle_rad: 0.4, number });
    let first = frame(7);
    assert_eq!(first, frame(7));
    let other = frame(8);
    let changed = first.data.iter().zip(&other.data).filter(|(a, b)| a != b).count();
    assert!(changed > first.data.len() / 2, "only {changed} values differ");
    let again = loaded(SceneSettings::default(), Specimen::larva(3, 1).unwrap());
    assert_eq!(first, again.render(&Exposure { angle_rad: 0.4, number: 7 }), "another scene of the same settings shows the same");
}

#[test]
fn noise_has_the_variance_of_photons_and_readout() {
    let optics = Optics { vignetting: 0.0, unevenness: 0.0, ..Optics::default() };
    let capillary = Capillary { wall_contrast: 0.0, glass_shade: 0.0, bore_shade: 0.0, ..Capillary::default() };
    let scene = Scene::new(SceneSettings { optics: optics.clone(), capillary, ..SceneSettings::default() });
    let frame = scene.render(&Exposure { angle_rad: 0.0, number: 3 });
    let green: Vec<f64> = frame.data.iter().skip(1).step_by(3).map(|&g| f64::from(g)).collect();
    let n = green.len() as f64;
    let mean = green.iter().sum::<f64>() / n;
    let variance = green.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / n;
    // Rounding to whole numbers adds 1/12.
    let expected = optics.light_rgb[1] * 255.0 / optics.full_well_electrons + optics.read_noise.powi(2) + 1.0 / 12.0;
    assert!((mean - optics.light_rgb[1]).abs() < 0.02, "{mean}");
    // Relative standard error of a variance: sqrt(2 / n) = 0.0014.
    assert!((variance / expected - 1.0).abs() < 0.02, "{variance} against {expected}");
}

#[test]
fn absorption_through_the_middle_of_a_bead_is_beer_lambert() {
    let scene = loaded(exact(), Specimen::bead(500.0).unwrap());
    let frame = scene.render(&Exposure { angle_rad: 0.0, number: 0 });
    let middle = (511 * 1024 + 511) * 3;
    for k in 0..3 {
        let material = phantom::Material::POLYSTYRENE;
        let expected = Optics::default().light_rgb[k] * (-0.5 * material.absorption_per_mm[k]).exp();
        assert!((f64::from(frame.data[middle + k]) - expected).abs() < 1.0, "{} against {expected}", frame.data[middle + k]);
    }
}

#[test]
fn a_dark_edge_lies_at_the_true_edge() {
    // Half of the contrast between field and rim is crossed at the edge, to the fraction of a pixel that blur and the rim's
    // own slope leave.
    let mut settings = exact();
    settings.optics.blur_px = 0.7;
    let scene = loaded(settings, Specimen::bead(500.0).unwrap());
    let frame = scene.render(&Exposure { angle_rad: 0.0, number: 0 }).to_mono8();
    let column: Vec<f64> = (460..500).map(|v| f64::from(frame[v * 1024 + 511])).collect();
    let rim = column.iter().copied().fold(f64::INFINITY, f64::min);
    let half = f64::midpoint(column[0], rim);
    let i = column.iter().position(|&c| c < half).unwrap();
    let edge = 460.0 + i as f64 - (half - column[i]) / (column[i - 1] - column[i]);
    assert!((edge - (511.5 - 250.0 / 5.5)).abs() < 0.1, "edge at {edge}");
}

#[test]
fn an_empty_capillary_and_an_emptied_one_give_the_same_image() {
    let scene = Scene::new(SceneSettings::default());
    let exposure = Exposure { angle_rad: 0.0, number: 1 };
    let empty = scene.render(&exposure);
    assert!(scene.truth_mask(0.0).data.iter().all(|&c| c == 0));
    scene.load(Some(Specimen::bead(400.0).unwrap())).unwrap();
    assert_ne!(scene.render(&exposure), empty);
    assert_eq!(scene.truth().unwrap().diameter_um, Some(400.0));
    scene.load(None).unwrap();
    assert_eq!(scene.render(&exposure), empty);
}

#[test]
fn a_specimen_changes_no_pixel_away_from_itself() {
    let scene = Scene::new(SceneSettings {
        optics: Optics { full_well_electrons: 0.0, read_noise: 0.0, ..Optics::default() },
        ..SceneSettings::default()
    });
    let exposure = Exposure { angle_rad: 0.2, number: 0 };
    let empty = scene.render(&exposure);
    scene.load(Some(Specimen::bead(500.0).unwrap())).unwrap();
    let frame = scene.render(&exposure);
    for (i, (a, b)) in empty.data.chunks_exact(3).zip(frame.data.chunks_exact(3)).enumerate() {
        let (du, dv) = ((i % 1024) as f64 - 511.5, (i / 1024) as f64 - 511.5);
        // The blur reaches 3 px in each direction.
        if du.hypot(dv) > 250.0 / 5.5 + 5.0 {
            assert_eq!(a, b, "pixel {i}");
        }
    }
}

#[test]
fn a_larger_scale_across_stretches_only_across() {
    let mut settings = exact();
    settings.camera.ky_px_per_um *= 1.333;
    let scene = loaded(settings, Specimen::bead(400.0).unwrap());
    let mask = scene.truth_mask(0.0);
    let (top, bottom) = edges(&mask, 511);
    assert!((bottom - top - 400.0 / 5.5 * 1.333).abs() < 0.2);
    let (area, ..) = moments(&mask);
    assert!((area / (PI * 200.0f64.powi(2) / 5.5f64.powi(2) * 1.333) - 1.0).abs() < 2e-3);
}

#[test]
fn a_specimen_rests_on_the_lower_wall_and_stays_in_the_bore() {
    let rests = Placement { rests_on_wall: true, ..Placement::default() };
    let scene = loaded(exact(), Specimen::bead(500.0).unwrap().placed(rests));
    let (_, bottom) = edges(&scene.truth_mask(0.0), 511);
    assert!((bottom - (511.5 + 325.0 / 5.5)).abs() < 0.1, "{bottom}");
    let refused = scene.load(Some(Specimen::bead(500.0).unwrap().placed(at(0.0, 100.0, 0.0)))).unwrap_err();
    assert!(matches!(refused, PlacementError::OutsideBore { reach_um, .. } if (reach_um - 350.0).abs() < 0.1), "{refused}");
    assert_eq!(scene.truth().unwrap().diameter_um, Some(500.0), "what was loaded stays");
}

#[test]
fn every_larva_fits_the_bore_at_rest() {
    for dpf in [3, 4, 5] {
        for seed in 0..6 {
            let rests = Placement { rests_on_wall: true, ..Placement::default() };
            Scene::new(exact()).load(Some(Specimen::larva(dpf, seed).unwrap().placed(rests))).unwrap();
        }
    }
}

#[test]
fn a_strict_run_skips_no_test() {
    strict::holds(&[(
        cfg!(has_shared) || std::env::var_os("CARVED_SHARED").is_none(),
        "CARVED_SHARED does not name a folder of shared data",
    )]);
}

#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn the_mask_of_a_scanned_fish_agrees_with_its_mesh() {
    let path = shared::shared("data/blub/fish_low_resolution.obj");
    let mesh = Mesh::from_obj_file(&path).unwrap().laid_along_x(800.0);
    let fish = Specimen::mesh(mesh);
    let truth = fish.truth();
    assert!((truth.length_um - 800.0).abs() < 1e-6);
    assert!(truth.hull_volume_um3 >= truth.volume_um3, "{truth:?}");
    let off = volume_from_thickness(fish, 0.5) / truth.volume_um3 - 1.0;
    assert!(off.abs() < 1e-3, "{off:.2e}");
}

/// Vertical variance of what dims the middle of the image, px^2, from the ratio to the empty image.
fn variance_of_shade(frame: &Rgb, empty: &Rgb) -> f64 {
    let (mut m, mut sum, mut squares) = (0.0, 0.0, 0.0);
    let width = frame.width as usize;
    for (u, v) in (width / 2 - 3..width / 2 + 3).flat_map(|u| (40..88).map(move |v| (u, v))) {
        let levels = |image: &Rgb| (0..3).map(|k| f64::from(image.data[(v * width + u) * 3 + k])).sum::<f64>();
        let shade = 1.0 - levels(frame) / levels(empty);
        let v = v as f64;
        (m, sum, squares) = (m + shade, sum + shade * v, squares + shade * v * v);
    }
    squares / m - (sum / m) * (sum / m)
}

/// A bead on the near side moves down at the speed of the capillary. Uniform motion over a way w adds w^2/12 to the variance.
#[test]
fn an_exposure_of_a_turning_shaft_is_blurred_by_the_way_meanwhile() {
    let camera = Camera { width: 96, height: 128, ux_px: 47.5, uy_px: 63.5, ..Camera::default() };
    let still = Scene::new(SceneSettings { camera: camera.clone(), ..exact() });
    let empty = still.render(&Exposure { angle_rad: 0.0, number: 7 });
    let near_um = 180.0;
    // Without a rim of bent light the shade is that of the thickness.
    let grey = Material { absorption_per_mm: [20.0; 3], index_step: 0.0 };
    still.load(Some(Specimen::bead(150.0).unwrap().of_material(grey).placed(at(0.0, 0.0, -near_um)))).unwrap();
    let sharp = variance_of_shade(&still.render(&Exposure { angle_rad: 0.0, number: 7 }), &empty);
    for turned_rad in [0.04, 0.08, 0.16] {
        let frame = still.render_along(&|part| turned_rad * (part - 0.5), 7);
        let way_px = turned_rad * near_um * camera.ky_px_per_um * camera.f_um / (camera.f_um - near_um);
        let added = variance_of_shade(&frame, &empty) - sharp;
        // Levels of 8 bits, and an arc that is not straight.
        assert!((added - way_px * way_px / 12.0).abs() < 0.02 + 0.02 * way_px, "{way_px} px: {added} added");
    }
}

#[test]
fn a_shaft_that_stands_during_the_exposure_gives_the_same_frame_as_one_instant() {
    let scene = loaded(SceneSettings::default(), Specimen::bead(300.0).unwrap().placed(at(0.0, 100.0, 0.0)));
    let exposure = Exposure { angle_rad: 0.7, number: 3 };
    assert_eq!(scene.render_along(&|_| 0.7, 3), scene.render(&exposure));
    assert_ne!(scene.render_along(&|_| 0.7, 4), scene.render(&exposure), "other noise");
}
