//! Tests of outlines against formulas and against coverage.

use super::*;
use crate::scene::{Camera, Optics, Placement, Scene, SceneSettings, Specimen};
use std::f64::consts::TAU;

fn scene(specimen: Specimen, camera: Camera) -> Scene {
    let scene = Scene::new(SceneSettings { camera, optics: Optics::exact(), ..SceneSettings::default() });
    scene.load(specimen).unwrap();
    scene
}

/// Area of a polygon, px^2. It is positive if the polygon runs clockwise on the screen.
fn area(outline: &Outline) -> f64 {
    let n = outline.len();
    (0..n).map(|i| outline[i][0] * outline[(i + 1) % n][1] - outline[(i + 1) % n][0] * outline[i][1]).sum::<f64>() / 2.0
}

fn covered_pixels(scene: &Scene, angle: f64) -> f64 {
    scene.truth_mask(angle).data.iter().map(|&c| f64::from(c) / 255.0).sum()
}

#[test]
fn the_outline_of_a_sphere_is_made_by_its_tangent_rays() {
    let camera = Camera { gamma_rad: 0.03, ky_px_per_um: 1.333 / 5.5, ..Camera::default() };
    for (radius, [x, y, z], angle) in [
        (250.0, [0.0, 0.0, 0.0], 0.0),
        (250.0, [0.0, 0.0, -70.0], 0.0),
        (150.0, [1100.0, 60.0, -80.0], 0.7),
        (30.0, [-900.0, 200.0, 150.0], 4.0),
    ] {
        let bead = Specimen::bead(2.0 * radius).unwrap().placed(Placement { x_um: x, y_um: y, z_um: z, ..Placement::default() });
        let outlines = scene(bead, camera.clone()).truth_edge(angle);
        assert_eq!(outlines.len(), 1);
        // Middle of the sphere as the camera sees it: turned by omega, then lowered by gamma at +x; the pinhole is 60 mm before it.
        let (so, co) = angle.sin_cos();
        let (y, z) = (y * co - z * so, y * so + z * co);
        let (sg, cg) = camera.gamma_rad.sin_cos();
        let middle = [x * cg - y * sg, x * sg + y * cg, z + camera.f_um];
        let mut worst = 0.0f64;
        for [u, v] in &outlines[0] {
            let ray = [(u - 511.5) / (camera.f_um * camera.kx_px_per_um), (v - 511.5) / (camera.f_um * camera.ky_px_per_um), 1.0];
            let along: f64 = (0..3).map(|i| ray[i] * middle[i]).sum::<f64>() / (0..3).map(|i| ray[i] * ray[i]).sum::<f64>();
            let miss = (0..3).map(|i| (middle[i] - along * ray[i]).powi(2)).sum::<f64>().sqrt();
            worst = worst.max((miss - radius).abs() * camera.ky_px_per_um);
        }
        println!("sphere of {radius} um: {} corners, off by {worst:.4} px at most", outlines[0].len());
        // Facets of 256 sides lie up to r (1 - cos(pi / 256)) = 7.5e-5 r inside: 0.005 px for the largest.
        assert!(worst < 0.006, "{worst} px");
        assert!(outlines[0].len() > 100);
    }
}

#[test]
fn a_larva_has_the_area_of_its_coverage() {
    for angle in [0.0, 0.8, 1.6] {
        let scene = scene(Specimen::larva(5, 4).unwrap(), Camera { gamma_rad: -0.02, ..Camera::default() });
        let outlined: f64 = scene.truth_edge(angle).iter().map(area).sum();
        let covered = covered_pixels(&scene, angle);
        // 64 samples per pixel along some 1600 px of outline: their errors average to well below a pixel.
        assert!((outlined - covered).abs() < 2.0, "{outlined} against {covered} px^2 at {angle}");
    }
}

#[test]
fn a_clipped_outline_is_closed_along_the_border_of_the_sensor() {
    let larva = Specimen::larva(4, 2).unwrap().placed(Placement { x_um: -2000.0, ..Placement::default() });
    let scene = scene(larva, Camera::default());
    let outlines = scene.truth_edge(0.0);
    assert!(outlines.iter().flatten().all(|[u, v]| (-0.5..=1023.5).contains(u) && (-0.5..=1023.5).contains(v)));
    assert!(outlines.iter().flatten().filter(|[u, _]| (u + 0.5).abs() < 1e-9).count() > 100, "it runs along the left border");
    let outlined: f64 = outlines.iter().map(area).sum();
    assert!((outlined - covered_pixels(&scene, 0.0)).abs() < 2.0, "{outlined}");
}

#[test]
fn a_ring_has_a_hole_that_runs_the_other_way() {
    // A torus of 150 and 50 um around the line of sight.
    let n = 96u32;
    let mut ring = Mesh::default();
    for i in 0..n {
        for k in 0..n {
            let ((sin_a, cos_a), (sin_b, cos_b)) =
                ((TAU * f64::from(i) / f64::from(n)).sin_cos(), (TAU * f64::from(k) / f64::from(n)).sin_cos());
            let r = 150.0 + 50.0 * cos_b;
            ring.vertices.push([r * cos_a, r * sin_a, 50.0 * sin_b]);
            let at = |i: u32, k: u32| i % n * n + k % n;
            ring.triangles.push([at(i, k), at(i + 1, k), at(i + 1, k + 1)]);
            ring.triangles.push([at(i, k), at(i + 1, k + 1), at(i, k + 1)]);
        }
    }
    let scene = scene(Specimen::mesh(ring.closed().unwrap()), Camera { f_um: 6e7, ..Camera::default() });
    let mut areas: Vec<f64> = scene.truth_edge(0.0).iter().map(area).collect();
    areas.sort_by(f64::total_cmp);
    let circle = |r: f64| TAU / 2.0 * (r / 5.5).powi(2);
    assert_eq!(areas.len(), 2, "{areas:?}");
    // 96 sides lose (2 pi / 96)^2 / 6 = 7e-4.
    assert!((areas[0] / -circle(100.0) - 1.0).abs() < 2e-3 && (areas[1] / circle(200.0) - 1.0).abs() < 2e-3, "{areas:?}");
}

#[test]
fn the_body_of_a_finned_larva_has_the_outline_of_a_bare_one() {
    let larva = crate::scene::Larva::new(4, 6).unwrap();
    let finned = scene(larva.specimen(), Camera::default());
    let bare = scene(larva.without_fins().specimen(), Camera::default());
    assert_eq!(finned.body_edge(0.2), bare.truth_edge(0.2));
    let [with, without] = [finned.truth_edge(0.2), bare.truth_edge(0.2)].map(|edge| edge.iter().map(area).sum::<f64>());
    assert!(with > 1.05 * without, "{with} against {without} px^2");
}

#[test]
fn clutter_and_an_empty_capillary_have_no_outline() {
    let scene = scene(Specimen::bead(300.0).unwrap(), Camera::default());
    let alone = scene.truth_edge(0.0);
    let bubble = Specimen::bubble(300.0).unwrap().placed(Placement { x_um: 200.0, ..Placement::default() });
    scene.load(crate::scene::Contents::from(Specimen::bead(300.0).unwrap()).beside(bubble)).unwrap();
    assert_eq!(scene.truth_edge(0.0), alone);
    scene.load(None).unwrap();
    assert!(scene.truth_edge(0.0).is_empty());
}
