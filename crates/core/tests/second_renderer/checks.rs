//! The renderer itself: light, edges, noise, dust and the sense of rotation.

use crate::cases::{Kind, Size, scene, scene_with};
use crate::dust::{Dirt, Place, Speck};
use crate::optics::{FINE, Optics, image};
use crate::random::Random;
use crate::scene::{Glass, Lamp, Scene, Sensor, View};
use crate::shape::{Bladder, Material, Section, Specimen, area, back, convex_hull, gas};
use crate::truth::{mask, outlines};
use carved_core::geometry::Camera;
use std::f64::consts::{PI, TAU};

const STEP_UM: f64 = 1.8;
const SHARP: Optics = Optics { defocus_um: 0.0, aperture_rad: 10.0, cone_rad: 1.0, disc_px: 0.5 };
const CLEAR: Material = Material { absorption_per_um: [0.0; 3], index: 0.004 };

fn ball(radius_um: f64, material: Material) -> Specimen {
    Specimen::ellipsoid([40.0, -30.0, 60.0], [radius_um; 3], [0.0; 2], material, STEP_UM)
}

/// A scene without specimen, dust and noise, in even light.
fn empty(width: usize, height: usize) -> Scene {
    let view =
        View { width, height, px_um: 3.0 * STEP_UM, origin_px: [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0], roll_rad: 0.0 };
    let glass = Glass {
        bore_um: 300.0,
        line: 0.6,
        line_px: 5.0,
        outer: 0.0,
        apart_px: 5.0,
        bright: 0.0,
        shade: 0.0,
        fade_px: 3.0,
        bore_level: 1.0,
    };
    let lamp = Lamp { grey: [222.0, 226.0, 213.0], slope: [0.0; 2], curvature: 0.0 };
    Scene { view, lamp, glass, optics: SHARP, sensor: Sensor { shot_grey: 2.4, read_grey: 0.7 }, specks: vec![], specimen: None, seed: 1 }
}

/// A clear ball bends light and takes none: what its rim lacks is in the picture elsewhere. The sums are of 32-bit numbers with an error of
/// 1e-7 each, and the steepest rays of this ball are flatter than the aperture.
#[test]
fn a_clear_specimen_keeps_the_light() {
    let optics = Optics { defocus_um: 60.0, disc_px: 1.8, ..SHARP };
    let seen = image(&ball(200.0, CLEAR), 0.3, &optics);
    let [_, green, _] = &seen.intensity;
    let moved: f64 = green.data.iter().map(|i| (f64::from(*i) - 1.0).abs()).sum();
    let lost: f64 = green.data.iter().map(|i| f64::from(*i) - 1.0).sum();
    let least = green.data.iter().copied().fold(1.0, f32::min);
    assert!(least < 0.93, "the rim lets {least} through: nothing to keep");
    assert!(lost.abs() < 1e-4 * moved, "{lost} of the light that moved, {moved}, is lost");
    let narrow = Optics { aperture_rad: 0.02, cone_rad: 0.005, ..optics };
    let darkest = image(&ball(200.0, CLEAR), 0.3, &narrow).intensity[1].data.iter().copied().fold(1.0, f32::min);
    assert!(darkest < least - 0.2, "the aperture stops no ray: {darkest}, without it {least}");
}

/// Absorption follows Beer and Lambert. The middle is known to half a cell of 1.8 um, where a ball of 200 um is thinner by 2e-5.
#[test]
fn a_ball_absorbs_by_its_thickness() {
    let material = Material { absorption_per_um: [0.001, 0.002, 0.004], index: 0.0 };
    let seen = image(&ball(200.0, material), 1.1, &SHARP);
    for (light, per_um) in seen.intensity.iter().zip(material.absorption_per_um) {
        let darkest = light.data.iter().copied().fold(1.0, f32::min);
        let expected = (-400.0 * per_um).exp();
        assert!((darkest / expected - 1.0).abs() < 1e-3, "{darkest}, expected {expected}");
    }
}

/// The silhouette of a ball of 200 um: its area, its middle and its edge. A polygon of 128 corners is smaller than the circle by 4e-4 in
/// area, and each slice stands for itself and half the way to the next, which changes the ends by less than a cell.
#[test]
fn a_ball_has_its_silhouette() {
    let specimen = ball(200.0, CLEAR);
    for omega in [0.0, 0.9, 2.5] {
        let seen = image(&specimen, omega, &SHARP);
        let covered = &seen.covered;
        let um2 = covered.data.iter().map(|c| f64::from(*c)).sum::<f64>() * STEP_UM * STEP_UM;
        assert!((um2 / (PI * 200.0 * 200.0) - 1.0).abs() < 1e-3, "area {um2}");
        let middle_um = -30.0 * omega.cos() - 60.0 * omega.sin();
        let column = ((40.0 / STEP_UM).round() as isize - covered.first_column) as usize * covered.rows;
        let cells = &covered.data[column..column + covered.rows];
        let [length, moment] = cells.iter().enumerate().fold([0.0, 0.0], |[n, m], (row, c)| {
            let at = (row as isize + covered.first_row) as f64 * STEP_UM;
            [n + f64::from(*c), m + f64::from(*c) * at]
        });
        assert!((length * STEP_UM - 400.0).abs() < 0.3, "{} um across", length * STEP_UM);
        assert!((moment / length - middle_um).abs() < 0.2, "middle at {} um, expected {middle_um}", moment / length);
    }
}

/// An opaque ball's edge, blurred by a disc, passes half of the light where its silhouette ends: a disc is symmetric. Over its radius of
/// 2 px the edge of a ball of 37 px bends by 0.05 px. 80 % pass at 0.49 radii: the share of a disc beyond a chord at `t` radii is
/// `(acos t - t sqrt(1 - t^2)) / pi`, which is 0.2 at 0.492.
#[test]
fn a_disc_blurs_an_edge_evenly() {
    let opaque = Material { absorption_per_um: [10.0; 3], index: 0.0 };
    let specimen = ball(200.0, opaque);
    let seen = image(&specimen, 0.0, &Optics { disc_px: 2.0, ..SHARP });
    let light = &seen.intensity[1];
    let column = ((40.0 / STEP_UM).round() as isize - light.first_column) as usize * light.rows;
    let cells = &light.data[column..column + light.rows];
    let crossing = |level: f32| {
        let row = cells.iter().position(|i| *i < level).unwrap();
        let part = (cells[row - 1] - level) / (cells[row - 1] - cells[row]);
        (row as f64 - 1.0 + f64::from(part) + light.first_row as f64) / FINE as f64
    };
    let edge_px = (-30.0 - 200.0) / STEP_UM / FINE as f64;
    assert!((crossing(0.5) - edge_px).abs() < 0.1, "half at {}, edge at {edge_px}", crossing(0.5));
    let outside = crossing(0.5) - crossing(0.8);
    assert!((outside - 0.984).abs() < 0.1, "80 % at {outside} px beside the edge");
}

/// A surface of even light: noise of a pixel as asked, and after demosaicking the correlations of bilinear interpolation. With `s` of a raw
/// pixel, green has a variance of `(1 + 1/4) / 2` and a covariance at 1 px of `1/4`; red `(1 + 1/2 + 1/2 + 1/4) / 4` and
/// `(1/2 + 1/4) / 2`. Rounding adds 1/12 to each variance. Of 180 000 pixels the deviation is known to 0.5 %, the correlation to 0.01.
#[test]
fn noise_and_its_correlation_are_as_asked() {
    let scene = Scene { glass: Glass { bore_um: 3000.0, ..empty(1, 1).glass }, ..empty(600, 300) };
    let frame = scene.render(0.0, 4);
    let rgb = frame.rgb();
    for (channel, variance, covariance) in [(0, 0.5625, 0.375), (1, 0.625, 0.25), (2, 0.5625, 0.375)] {
        let raw = 2.4f64.powi(2) * scene.lamp.grey[channel] / 220.0 + 0.7f64.powi(2) + 1.0 / 12.0;
        let value = |u: usize, v: usize| f64::from(rgb[3 * (v * 600 + u) + channel]) - scene.lamp.grey[channel];
        let inner = || (2..298).flat_map(|v| (2..597).map(move |u| (u, v)));
        let n = inner().count() as f64;
        let mean = inner().map(|(u, v)| value(u, v)).sum::<f64>() / n;
        let found = inner().map(|(u, v)| (value(u, v) - mean).powi(2)).sum::<f64>() / n;
        let beside = inner().map(|(u, v)| (value(u, v) - mean) * (value(u + 1, v) - mean)).sum::<f64>() / n;
        assert!(mean.abs() < 0.3, "channel {channel}: mean {mean:+.3} beside the light");
        let sd = (raw * variance + 1.0 / 12.0).sqrt();
        assert!((found.sqrt() / sd - 1.0).abs() < 0.03, "channel {channel}: sd {}, expected {sd}", found.sqrt());
        let correlation = raw * covariance / (raw * variance + 1.0 / 12.0);
        assert!((beside / found - correlation).abs() < 0.02, "channel {channel}: {}, expected {correlation}", beside / found);
    }
}

/// The specks of ten frames that take 2 % or more and lie in the bore, whatever they lie on, and their statistics. The number of one frame
/// varies by 9 at most; of 840 specks a median is known to `0.62 * 1.25 / sqrt(840) = 2.7 %` (depth) and 0.05 px (width).
#[test]
fn specks_are_as_many_and_as_deep_as_asked() {
    let empty = empty(1024, 200);
    let (mut depths, mut widths) = (Vec::new(), Vec::new());
    for seed in 0..10 {
        for speck in Dirt::MEASURED.specks(seed, [1024, 200], empty.glass.bore_um, empty.view.px_um, None) {
            let [u, v] = match speck.place {
                Place::Window { u, v } => [u, v],
                Place::Turning(point) => empty.view.project(point, 0.7),
            };
            let in_bore = (v - empty.view.origin_px[1]).abs() * empty.view.px_um <= empty.glass.bore_um;
            if speck.depth >= 0.02 && in_bore && (0.0..1024.0).contains(&u) {
                depths.push(100.0 * speck.depth);
                widths.push((speck.fwhm_px[0] * speck.fwhm_px[1]).sqrt());
            }
        }
    }
    let per_1000_px = depths.len() as f64 / 10.24;
    assert!((per_1000_px - 80.0).abs() < 3.0, "{per_1000_px} per 1000 px");
    let quantile = |of: &mut Vec<f64>, share: f64| {
        of.sort_by(f64::total_cmp);
        of[(share * of.len() as f64) as usize]
    };
    // The truncation at 2 % takes the lower 9.5 % of the distribution: the median lies at its quantile 0.548.
    let median = 4.5 * (0.62f64 * 0.1194).exp();
    assert!((quantile(&mut depths, 0.5) / median - 1.0).abs() < 0.08, "median depth {} %", quantile(&mut depths, 0.5));
    // Its upper tenth begins at the normal distribution's 0.9095.
    let high = 4.5 * (0.62f64 * 1.338).exp();
    assert!((quantile(&mut depths, 0.9) / high - 1.0).abs() < 0.12, "depth at 90 %: {} %, expected {high}", quantile(&mut depths, 0.9));
    for (share, px) in [(0.1, 2.1), (0.5, 3.6), (0.9, 5.1)] {
        assert!((quantile(&mut widths, share) - px).abs() < 0.2, "width {} px at {share}, expected {px}", quantile(&mut widths, share));
    }
}

/// No speck lies in a specimen: a ball of 200 um that does not reach the bore of 300 um. Where there is no ball, some do. Its polygons lie up to 0.1 um inside
/// the ball, and a slice stands for 0.9 um to either side.
#[test]
fn no_speck_lies_in_a_specimen() {
    let specimen = ball(200.0, CLEAR);
    let inside = |specimen: Option<&Specimen>| {
        let specks = (0..10).flat_map(|seed| Dirt::MEASURED.specks(seed, [1024, 200], 300.0, 5.4, specimen));
        specks.filter(|s| matches!(s.place, Place::Turning([x, y, z]) if (x - 40.0).hypot(y + 30.0).hypot(z - 60.0) < 195.0)).count()
    };
    assert_eq!(inside(Some(&specimen)), 0);
    assert!(inside(None) > 10, "{} specks where the ball would be", inside(None));
}

/// A speck in the picture has its depth, its width and its place.
#[test]
fn a_speck_darkens_the_picture_as_it_should() {
    let speck = Speck { place: Place::Window { u: 60.0, v: 40.0 }, depth: 0.1, fwhm_px: [6.0, 6.0], along_rad: 0.4 };
    let clean = empty(120, 80);
    let dirty = Scene { specks: vec![speck], ..clean.clone() };
    let share = |u: usize, v: usize| 1.0 - dirty.light(0.0).0[1][v * 120 + u] / clean.light(0.0).0[1][v * 120 + u];
    assert!((share(60, 40) - 0.1).abs() < 1e-4, "{}", share(60, 40));
    assert!((share(63, 40) - 0.05).abs() < 1e-4 && (share(60, 37) - 0.05).abs() < 1e-4, "{} {}", share(63, 40), share(60, 37));
    assert!(share(67, 40) < 1e-6, "{}", share(67, 40));
}

/// A speck on the glass is seen where carved's camera projects it, at angles all around, with a roll of the axis. What is near the camera
/// moves down. A quarter turn brings the nearest point (z = -r) to the lower wall and the lowest (y = r) to the far side.
#[test]
fn a_speck_turns_with_the_glass_as_carved_expects() {
    let mut scene = empty(300, 200);
    scene.view.roll_rad = 0.02;
    let camera = Camera {
        f: 1e8,
        kx: 1.0 / scene.view.px_um,
        ky: 1.0 / scene.view.px_um,
        gamma: scene.view.roll_rad,
        ..Camera::published(scene.view.width as u32, scene.view.height as u32)
    };
    let clean = scene.light(0.0).0;
    for (point, deg, lower) in
        [([300.0, 20.0, -250.0], 0.0, 20.0), ([300.0, 20.0, -250.0], 90.0, 250.0), ([-200.0, 240.0, 10.0], 90.0, -10.0)]
    {
        let omega = f64::to_radians(deg);
        scene.specks = vec![Speck { place: Place::Turning(point), depth: 0.3, fwhm_px: [5.0, 5.0], along_rad: 0.0 }];
        let light = scene.light(omega).0;
        let taken: Vec<f64> = light[1].iter().zip(&clean[1]).map(|(a, b)| 1.0 - f64::from(a / b)).collect();
        let sum: f64 = taken.iter().sum();
        let mean = |of: fn(usize) -> usize| taken.iter().enumerate().map(|(i, t)| t * of(i) as f64).sum::<f64>() / sum;
        let (u, v) = camera.projection(omega).project(point).unwrap();
        let found = [mean(|i| i % 300), mean(|i| i / 300)];
        assert!((found[0] - u).abs() < 0.02 && (found[1] - v).abs() < 0.02, "{deg} deg: at {found:?}, expected {u}, {v}");
        let across = (v - 99.5 - (u - 149.5) * scene.view.roll_rad) * scene.view.px_um;
        assert!((across - lower).abs() < 1.0, "{deg} deg: {across} um below the axis, expected {lower}");
    }
}

/// The specimen turns in the same sense as the specks: an ellipsoid's middle is where carved's camera projects it.
#[test]
fn a_specimen_turns_as_carved_expects() {
    let mut scene = empty(400, 200);
    scene.view.roll_rad = -0.015;
    let at = [120.0, 60.0, -90.0];
    scene.specimen = Some(Specimen::ellipsoid(at, [300.0, 120.0, 90.0], [0.2, -0.1], CLEAR, scene.view.step_um()));
    let scale = 1.0 / scene.view.px_um;
    let camera = Camera { f: 1e8, kx: scale, ky: scale, gamma: scene.view.roll_rad, ..Camera::published(400, 200) };
    for deg in [0.0, 65.0, 200.0] {
        let omega = f64::to_radians(deg);
        let (_, [covered, _]) = scene.light(omega);
        let sum: f64 = covered.iter().map(|c| f64::from(*c)).sum();
        let mean = |of: fn(usize) -> usize| covered.iter().enumerate().map(|(i, c)| f64::from(*c) * of(i) as f64).sum::<f64>() / sum;
        let (u, v) = camera.projection(omega).project(at).unwrap();
        let found = [mean(|i| i % 400), mean(|i| i / 400)];
        assert!((found[0] - u).abs() < 0.1 && (found[1] - v).abs() < 0.05, "{deg} deg: at {found:?}, expected {u}, {v}");
    }
}

/// Volumes of solids with a formula. The polygons of 128 corners lack 4e-4.
#[test]
fn volumes_of_solids_are_those_of_their_formulas() {
    let specimen = Specimen::ellipsoid([50.0, 20.0, -30.0], [620.0, 210.0, 150.0], [0.08, -0.06], CLEAR, STEP_UM);
    let um3 = 4.0 / 3.0 * PI * 620.0 * 210.0 * 150.0;
    assert!((specimen.body_um3() / um3 - 1.0).abs() < 1e-3, "{} of {um3}", specimen.body_um3());
    assert!((specimen.hull_um3() / um3 - 1.0).abs() < 1e-3, "{} of {um3}", specimen.hull_um3());
}

/// The hull of a slice by its support function `h`: `1/2 int (h^2 - h'^2)`, against the convex hull of its corners. With 3600 directions
/// the differences of `h` lack 1e-6 of its size.
#[test]
fn the_hull_of_a_slice_is_that_of_its_support_function() {
    let mut r = Random::new(5);
    let points: Section = (0..40).map(|_| [100.0 * r.normal(), 60.0 * r.normal()]).collect();
    let n = 3600;
    let h: Vec<f64> = (0..n)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
            points.iter().map(|[y, z]| y * cos + z * sin).fold(f64::NEG_INFINITY, f64::max)
        })
        .collect();
    let step = TAU / f64::from(n);
    let next = |i: usize| h[(i + 1) % h.len()];
    let found: f64 = (0..h.len()).map(|i| (h[i] * next(i) - ((next(i) - h[i]) / step).powi(2)) * step / 2.0).sum();
    let hull = area(&convex_hull(points));
    assert!((hull / found - 1.0).abs() < 1e-3, "{hull}, by the support function {found}");
}

/// The mean width of a convex slice is its perimeter over pi (Cauchy). So the mean area of a finless larva's silhouettes over a turn is the
/// surface of its hull's slices over pi, as far as its slices are in one piece. 36 angles of smooth slices are enough for 1e-3.
#[test]
fn silhouettes_over_a_turn_have_the_perimeter_of_the_hull() {
    let scene = scene(Kind::Finless, Size::Crop, Dirt::NONE, 3);
    let specimen = scene.specimen.as_ref().unwrap();
    let perimeter = |section: Section| {
        let n = section.len();
        (0..n).map(|i| (section[(i + 1) % n][0] - section[i][0]).hypot(section[(i + 1) % n][1] - section[i][1])).sum::<f64>()
    };
    let expected = specimen.hulls().map(perimeter).sum::<f64>() * specimen.step_um / PI;
    let view = (0..36).map(|i| {
        let seen = image(specimen, PI * f64::from(i) / 36.0, &scene.optics);
        seen.covered.data.iter().map(|c| f64::from(*c)).sum::<f64>() * specimen.step_um.powi(2)
    });
    let found = view.sum::<f64>() / 36.0;
    assert!((found / expected - 1.0).abs() < 2e-3, "{found} um2, expected {expected}");
}

/// The true outline of a ball lies on its circle. Along the axis a silhouette ends with a slice, which is 1/3 px wide: there the outline is
/// known to 1/6 px. The mean radius lacks 0.008 px by the polygon of 128 corners and 1/(24 R) = 0.001 px by the bend within a pixel.
#[test]
fn the_true_outline_lies_on_the_edge() {
    let mut scene = empty(200, 160);
    scene.specimen = Some(ball(200.0, CLEAR));
    let frame = scene.render(0.9, 0);
    let outlines = outlines(&frame);
    assert_eq!(outlines.len(), 1);
    let [u, v] = scene.view.project([40.0, -30.0, 60.0], 0.9);
    let radii: Vec<f64> = outlines[0].vertices.iter().map(|p| (p[0] - u).hypot(p[1] - v) - 200.0 / scene.view.px_um).collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    let farthest = radii.iter().fold(0.0, |far: f64, r| far.max(r.abs()));
    assert!(mean.abs() < 0.015 && farthest < 0.18, "{mean:+.3} px beside the circle in the mean, {farthest:.3} at most");
}

/// Larvae fit in their bore, have fins where asked, and their hull holds their body.
#[test]
fn larvae_are_what_was_asked_for() {
    for seed in 0..4 {
        let [finned, finless] = [Kind::Finned, Kind::Finless].map(|kind| scene(kind, Size::Crop, Dirt::NONE, seed));
        let of = |scene: &Scene| {
            let specimen = scene.specimen.as_ref().unwrap();
            let frames: Vec<_> = [0.3, 0.3 + PI / 2.0].into_iter().map(|omega| scene.render(omega, 0)).collect();
            let fins = frames.iter().map(|f| mask(f, &f.covered).area_px() - mask(f, &f.body).area_px()).max().unwrap();
            let border = frames.iter().flat_map(|f| (0..f.height).flat_map(|v| [f.covered[v * f.width], f.covered[(v + 1) * f.width - 1]]));
            assert!(border.fold(0.0, f32::max) < 0.5, "seed {seed}: the larva leaves the frame");
            (specimen.radius_um() / scene.glass.bore_um, specimen.hull_um3() / specimen.body_um3(), fins)
        };
        let ((fill, hull, fins), (bare_fill, bare_hull, none)) = (of(&finned), of(&finless));
        assert!(
            (0.7..0.99).contains(&fill) && (0.7..0.99).contains(&bare_fill),
            "seed {seed}: fills {fill:.3}, {bare_fill:.3} of the bore"
        );
        assert!(fins > 1000 && none == 0, "seed {seed}: {fins} and {none} px of fins");
        assert!(hull > bare_hull + 0.02 && bare_hull > 1.0 && bare_hull < 1.05, "seed {seed}: hull over body {hull:.3}, {bare_hull:.3}");
    }
}

/// Seen from the side, gas is a dark ellipse with a bright middle: its border bends all light past the lens. A collapsed bladder lets light
/// through everywhere.
#[test]
fn gas_has_a_bright_middle_and_a_dark_rim() {
    let seed = 11;
    let light = |bladder: Bladder, lobe: usize, like: Bladder| {
        let scene = scene_with(Kind::Finless, bladder, Size::Crop, Dirt::NONE, seed);
        let [y, z] = back(seed, scene.glass.bore_um);
        // The view in which the back is up.
        let omega = z.atan2(-y);
        let ([_, green, _], _) = scene.light(omega);
        let (at, half) = gas(seed, like, scene.glass.bore_um)[lobe];
        let [u, v] = scene.view.project(at, omega);
        let row =
            |offset_um: f64| green[(v + offset_um / scene.view.px_um).round() as usize * scene.view.width + u.round() as usize] / 226.0;
        // The middle, and six tenths of the way to the upper and the lower border.
        [row(0.0), row(-0.6 * half[1]), row(0.6 * half[1])]
    };
    for (bladder, lobes) in [(Bladder::Usual, 1), (Bladder::Large, 1), (Bladder::TwoLobes, 2)] {
        for lobe in 0..lobes {
            let [middle, above, below] = light(bladder, lobe, bladder);
            assert!(
                above < 0.05 && below < 0.05 && middle > 1.5 * above.max(below),
                "{bladder:?}, lobe {lobe}: {middle}, {above}, {below}"
            );
        }
    }
    for bladder in [Bladder::NotInflated, Bladder::Absent] {
        assert!(gas(seed, bladder, 300.0).is_empty());
        let seen = light(bladder, 0, Bladder::Large);
        assert!(seen.iter().all(|light| *light > 0.08), "{bladder:?}: {seen:?}");
    }
}

/// The volume of the polygons of each form is that of its ellipsoids, and the body around them is the same.
#[test]
fn a_bladder_has_its_volume_and_leaves_the_body_as_it_is() {
    let body = |bladder| scene_with(Kind::Finless, bladder, Size::Crop, Dirt::NONE, 11).specimen.unwrap().body_um3();
    for bladder in [Bladder::Large, Bladder::TwoLobes, Bladder::NotInflated, Bladder::Absent] {
        assert!((body(bladder) - body(Bladder::Usual)).abs() < 1.0, "{bladder:?}");
    }
    let scene = scene_with(Kind::Finless, Bladder::TwoLobes, Size::Crop, Dirt::NONE, 11);
    let specimen = scene.specimen.unwrap();
    // The lobes are the first parts after skin, eyes and yolk.
    for (part, (_, half)) in specimen.parts[4..6].iter().zip(gas(11, Bladder::TwoLobes, scene.glass.bore_um)) {
        let of_polygons = part.sections.iter().map(|section| area(section)).sum::<f64>() * specimen.step_um;
        let exact = 4.0 / 3.0 * PI * half.iter().product::<f64>();
        assert!((of_polygons / exact - 1.0).abs() < 0.01, "{of_polygons:e}, {exact:e}");
    }
}
