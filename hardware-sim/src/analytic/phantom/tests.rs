//! Tests of outlines against meshes of the same solids and the formula of the sphere, and of true values against closed forms and meshes.

use super::super::slice::Slice;
use super::super::union::area_px2;
use super::*;
use crate::scene::outline::outlines;
use crate::scene::phantom::Mesh;

/// The solids as meshes of `rings` by `segments` points on them.
fn meshes(phantom: &Phantom, rings: u32, segments: u32) -> Vec<Mesh> {
    let mesh = |loft: &Loft| {
        let span = loft.solid.span();
        let ring = |s: f64| -> Vec<[f64; 3]> {
            let slice = loft.solid.slice(s);
            (0..segments).map(|k| phantom.pose.place(slice.point(&slice.support(TAU * f64::from(k) / f64::from(segments))))).collect()
        };
        let pole = |s: f64| {
            let slice = loft.solid.slice(s);
            phantom.pose.place([slice.x, slice.centre[0], slice.centre[1]])
        };
        let rows: Vec<_> = (1..rings).map(|i| ring(span * f64::from(i) / f64::from(rings))).collect();
        Mesh::lofted(pole(0.0), &rows, pole(span))
    };
    phantom.lofts.iter().map(mesh).collect()
}

fn distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (du, dv) = (b[0] - a[0], b[1] - a[1]);
    let share = (((p[0] - a[0]) * du + (p[1] - a[1]) * dv) / (du * du + dv * dv).max(1e-30)).clamp(0.0, 1.0);
    (p[0] - a[0] - share * du).hypot(p[1] - a[1] - share * dv)
}

/// The largest distance of a vertex of `from` from the outline `to`, px.
fn furthest(from: &[[f64; 2]], to: &[[f64; 2]]) -> f64 {
    let nearest = |p: &[f64; 2]| (0..to.len()).map(|i| distance(*p, to[i], to[(i + 1) % to.len()])).fold(f64::INFINITY, f64::min);
    from.iter().map(nearest).fold(0.0, f64::max)
}

fn cameras() -> [Camera; 3] {
    let tilted = Camera { alpha_rad: 0.0175, gamma_rad: -0.0175, uy_px: 495.0, ..Camera::default() };
    let air = Camera { ky_px_per_um: 1.333 / 5.5, alpha_rad: -0.008, gamma_rad: 0.01, skew: 0.02, ..Camera::default() };
    [Camera::default(), tilted, air]
}

fn phantoms() -> Vec<(&'static str, Phantom)> {
    let off = Pose { x_um: 350.0, y_um: -40.0, z_um: 60.0, roll_rad: 0.7 };
    vec![
        ("sphere", Phantom::sphere(512.0).unwrap().placed(off)),
        ("ellipsoid", Phantom::ellipsoid([1500.0, 250.0, 150.0]).unwrap().placed(off)),
        ("capsule", Phantom::capsule(2000.0, 300.0).unwrap().placed(off)),
        ("larva of 3 dpf", Phantom::larva(3, 1).unwrap().placed(Pose::seeded(1))),
        ("larva of 5 dpf", Phantom::larva(5, 2).unwrap().placed(Pose::seeded(2))),
        ("finned of 4 dpf", Phantom::finned(4, 3).unwrap().placed(Pose::seeded(3))),
    ]
}

#[test]
fn outlines_are_those_of_the_meshes() {
    for (name, phantom) in phantoms() {
        // Facets of 480 sides lie up to 60 px (pi / 480)^2 / 2 = 0.0013 px inside, flat ones somewhat more.
        let meshes = meshes(&phantom, 800, 480);
        for (camera, angles) in cameras().into_iter().zip([[0.0, 2.2], [0.9, 4.0], [1.6, 5.5]]) {
            for angle in angles {
                let ours = phantom.outline(&camera, angle);
                let theirs = outlines(meshes.iter(), &camera.view(angle), (camera.width, camera.height));
                assert_eq!(theirs.len(), 1, "{name}");
                // A fin's end is a needle when seen from its edge: its last pixels are about as thin as the quarter of a pixel that meshes'
                // outlines resolve.
                let end = ours.iter().map(|p| p[0]).fold(0.0, f64::max);
                let resolved: Vec<_> = ours.iter().copied().filter(|p| phantom.lofts.len() == 1 || p[0] < end - 5.0).collect();
                let (out, back) = (furthest(&resolved, &theirs[0]), furthest(&theirs[0], &ours));
                let steps = ours.iter().zip(ours.iter().cycle().skip(1)).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
                let longest = steps.fold(0.0, f64::max);
                println!("{name} at {angle}: {} vertices, at most {longest:.2} px apart; off by {out:.4} and {back:.4} px", ours.len());
                // Marching squares cuts a tail's tip of 1 px radius off by the height of a chord of a quarter pixel, 0.008 px; and the
                // corners where a body's tip ends before its fin by more.
                assert!(out < if phantom.lofts.len() == 1 { 0.02 } else { 0.05 }, "{name} at {angle}: a vertex lies {out} px off");
                assert!(back < 0.005, "{name} at {angle}: {back} px are missing");
                assert!(longest < 1.0, "{name} at {angle}: {longest} px between two vertices");
                assert!(area_px2(&ours) > 0.0, "clockwise on the screen");
            }
        }
    }
}

/// A tangent ray of a sphere passes its centre at the distance of the radius. This test needs no mesh.
#[test]
fn the_outline_of_a_sphere_is_where_rays_graze_it() {
    let at = Pose { x_um: 1100.0, y_um: 60.0, z_um: -80.0, roll_rad: 0.4 };
    let phantom = Phantom::sphere(300.0).unwrap().placed(at);
    for camera in cameras() {
        for angle in [0.0, 1.0, 3.0] {
            let sight = camera.view(angle);
            let middle = sight.project([at.x_um, at.y_um, at.z_um]);
            let space = |u: f64, v: f64, depth: f64| {
                let y = (v - camera.uy_px) / (camera.f_um * camera.ky_px_per_um);
                [((u - camera.ux_px) - camera.skew * y) / (camera.f_um * camera.kx_px_per_um) * depth, y * depth, depth]
            };
            let centre = space(middle.u_px, middle.v_px, middle.depth_um);
            for [u, v] in phantom.outline(&camera, angle) {
                let ray = space(u, v, 1.0);
                let along = (0..3).map(|i| ray[i] * centre[i]).sum::<f64>() / (0..3).map(|i| ray[i] * ray[i]).sum::<f64>();
                let miss = (0..3).map(|i| (centre[i] - along * ray[i]).powi(2)).sum::<f64>().sqrt();
                assert!((miss - 150.0).abs() < 1e-5, "{miss} um from the middle");
            }
        }
    }
}

/// Closed forms of an ellipsoid with two equal half axes and of a capsule.
#[test]
fn true_values_agree_with_closed_forms() {
    let near = |found: f64, exact: f64| assert!((found / exact - 1.0).abs() < 1e-6, "{found} against {exact}");
    let sphere = Phantom::sphere(512.0).unwrap().truth();
    near(sphere.volume_um3, 4.0 / 3.0 * PI * 256f64.powi(3));
    near(sphere.area_um2, 4.0 * PI * 256f64.powi(2));
    assert_eq!(sphere.diameter_um, Some(512.0));
    // Prolate: 2 pi b^2 (1 + a / (b e) asin e). Oblate, flat along the capillary: 2 pi b^2 (1 + (1 - e^2) / e atanh e).
    let (long, round): (f64, f64) = (1500.0, 250.0);
    let e = (1.0 - (round / long).powi(2)).sqrt();
    let prolate = Phantom::ellipsoid([long, round, round]).unwrap().truth();
    near(prolate.volume_um3, 4.0 / 3.0 * PI * long * round * round);
    near(prolate.area_um2, 2.0 * PI * round * round * (1.0 + long / (round * e) * e.asin()));
    let (flat, wide): (f64, f64) = (100.0, 250.0);
    let e = (1.0 - (flat / wide).powi(2)).sqrt();
    near(Phantom::ellipsoid([flat, wide, wide]).unwrap().truth().area_um2, 2.0 * PI * wide * wide * (1.0 + (1.0 - e * e) / e * e.atanh()));
    // Lying across: the same solid, other slices.
    near(Phantom::ellipsoid([wide, flat, wide]).unwrap().truth().area_um2, 2.0 * PI * wide * wide * (1.0 + (1.0 - e * e) / e * e.atanh()));
    let capsule = Phantom::capsule(2000.0, 300.0).unwrap().truth();
    near(capsule.volume_um3, PI * 150f64.powi(2) * 1700.0 + 4.0 / 3.0 * PI * 150f64.powi(3));
    near(capsule.area_um2, PI * 300.0 * 2000.0);
    near(capsule.length_um, 2000.0);
}

/// The ideal hull as a mesh: in each slice the points that reach furthest in 7200 directions, in their order, a polygon that is
/// then cut into equal lengths.
fn hull_mesh(phantom: &Phantom, rings: u32, segments: usize) -> Mesh {
    let body = &phantom.lofts[0].solid;
    let Solid::Plate(plate) = &phantom.lofts[1].solid else { panic!("a finned larva has a plate") };
    let ring = |slices: &[Slice]| -> Vec<[f64; 3]> {
        let furthest = |k: u32| {
            // From the flank on: there it is always the body that reaches furthest, so that rings begin alike.
            let t = TAU * (f64::from(k) / 7200.0 + 0.25);
            let points = slices.iter().map(|slice| (slice.support(t), slice)).map(|(at, slice)| (at.h, slice.point(&at)));
            points.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1
        };
        let corners: Vec<_> = (0..=7200).map(furthest).collect();
        let side = |i: usize| (corners[i + 1][1] - corners[i][1]).hypot(corners[i + 1][2] - corners[i][2]);
        let whole: f64 = (0..7200).map(side).sum();
        let (mut corner, mut passed) = (0, 0.0);
        (0..segments)
            .map(|k| {
                let at = whole * k as f64 / segments as f64;
                while passed + side(corner) < at {
                    passed += side(corner);
                    corner += 1;
                }
                let share = (at - passed) / side(corner).max(1e-12);
                std::array::from_fn(|i| corners[corner][i] + share * (corners[corner + 1][i] - corners[corner][i]))
            })
            .collect()
    };
    let step = PI / f64::from(rings);
    let within = (1..rings).map(|i| body.slice(step * f64::from(i)));
    let mut rows: Vec<_> = within.map(|slice| ring(&std::iter::once(slice).chain(plate.slice_at(slice.x)).collect::<Vec<_>>())).collect();
    let from = plate.angle_at(body.slice(PI).x);
    let behind = rings / 5;
    rows.extend((0..behind).map(|i| ring(&[plate.slice(from + (PI - from) * f64::from(i) / f64::from(behind))])));
    let pole = |slice: Slice| [slice.x, slice.centre[0], slice.centre[1]];
    Mesh::lofted(pole(body.slice(0.0)), &rows, pole(plate.slice(PI)))
}

/// Meshes of 1000 by 600 and half as many: their error falls with the square, so that a third of their difference on top is
/// what both tend to.
#[test]
fn true_values_are_the_limit_of_finer_meshes() {
    for (dpf, seed) in [(3, 1), (4, 3), (5, 2)] {
        let phantom = Phantom::finned(dpf, seed).unwrap();
        let (truth, bare) = (phantom.truth(), Phantom::larva(dpf, seed).unwrap().truth());
        let (fine, coarse) = (meshes(&phantom, 1000, 600), meshes(&phantom, 500, 300));
        let limit = |of: fn(&Mesh) -> f64| of(&fine[0]) + (of(&fine[0]) - of(&coarse[0])) / 3.0;
        let (hull, coarse_hull) = (hull_mesh(&phantom, 600, 800), hull_mesh(&phantom, 300, 400));
        let hull_limit = |of: fn(&Mesh) -> f64| of(&hull) + (of(&hull) - of(&coarse_hull)) / 3.0;
        let off = |a: f64, b: f64| a / b - 1.0;
        let off = [
            off(truth.volume_um3, limit(Mesh::volume)),
            off(truth.area_um2, limit(Mesh::area)),
            off(truth.hull_volume_um3, hull_limit(Mesh::volume)),
            off(truth.hull_area_um2, hull_limit(Mesh::area)),
        ];
        println!("{dpf} dpf: {truth:?}: off by {off:.7?}");
        assert!(off[0].abs() < 1e-5 && off[1].abs() < 1e-5, "{off:?}");
        // From 300 by 400 to 600 by 800 the hull's mesh grows by 3e-4 in area and 6e-5 in volume: flats make its limit less sure.
        assert!(off[2].abs() < 1e-5 && off[3].abs() < 1e-4, "{off:?}");
        assert!((bare.hull_volume_um3 - bare.volume_um3).abs() < 1e-6 && (bare.volume_um3 - truth.volume_um3).abs() < 1e-6);
        assert!(truth.hull_volume_um3 > 1.01 * truth.volume_um3);
    }
}

/// Sizes of the paper's larvae: fixed ones of table 5, whose areas are of 84 views.
#[test]
fn larvae_have_their_sizes_and_differ() {
    for (dpf, area_um2) in [(3, 3.13e6), (4, 3.26e6), (5, 3.55e6)] {
        let truths: Vec<Truth> = (0..40).map(|seed| Phantom::larva(dpf, seed).unwrap().truth()).collect();
        let mean = truths.iter().map(|t| t.area_um2).sum::<f64>() / 40.0;
        let [least, most] = truths.iter().fold([f64::INFINITY, 0.0f64], |[l, m], t| [l.min(t.volume_um3), m.max(t.volume_um3)]);
        println!("{dpf} dpf: volume {least:.3e} to {most:.3e} um^3, mean area {mean:.3e} um^2");
        assert!(truths.iter().all(|t| (2.19e8..3.21e8).contains(&t.volume_um3) && (3599.0..4201.0).contains(&t.length_um)));
        assert!((mean / area_um2 - 1.0).abs() < 0.15, "{mean}");
        assert!(most / least > 1.1);
    }
    assert!(Phantom::larva(6, 0).is_err() && Phantom::capsule(100.0, 200.0).is_err() && Phantom::sphere(f64::NAN).is_err());
}

#[test]
fn bounds_agree_with_the_mesh() {
    for (name, phantom) in phantoms() {
        let bounds = phantom.bounds_um();
        let whole = meshes(&phantom, 800, 480).into_iter().reduce(|all, mesh| all.with(&mesh)).unwrap().bounds();
        for axis in 0..3 {
            // Between two directions or slices a surface of 300 um rises by 0.01 um.
            assert!((bounds[0][axis] - whole[axis][0]).abs() < 0.05, "{name}: {bounds:?} against {whole:?}");
            assert!((bounds[1][axis] - whole[axis][1]).abs() < 0.05, "{name}: {bounds:?} against {whole:?}");
        }
    }
}

/// From every direction the two sides of a tip are joined without a gap: consecutive vertices are less than a pixel apart.
#[test]
fn every_individual_has_a_closed_outline() {
    for seed in 0..100 {
        let phantom = Phantom::finned(3 + (seed % 3) as u8, seed).unwrap().placed(Pose::seeded(seed));
        let alpha_rad = 0.0175 * (seed as f64 / 50.0 - 1.0);
        let camera = Camera { alpha_rad, gamma_rad: -alpha_rad, ..Camera::default() };
        for angle in [0.0, 1.1, 2.9, 4.6] {
            let outline = phantom.outline(&camera, angle);
            let steps = outline.iter().zip(outline.iter().cycle().skip(1)).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
            let longest = steps.fold(0.0, |longest: f64, step| if step > longest || step.is_nan() { step } else { longest });
            assert!(longest < 1.0, "seed {seed} at {angle}: {longest} px between two vertices");
        }
    }
}
