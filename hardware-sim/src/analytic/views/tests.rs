//! Tests of each disturbance against its description.

use super::super::union::area_px2;
use super::super::{Disturbance, Fault, Phantom, Pose};
use super::*;

fn sphere() -> Phantom {
    Phantom::sphere(500.0).unwrap()
}

fn plan(n: u32) -> Vec<f64> {
    (0..n).map(|i| std::f64::consts::TAU * f64::from(i) / f64::from(n)).collect()
}

fn one(view: &View) -> &Outline {
    assert_eq!(view.outline.len(), 1);
    &view.outline[0]
}

/// The centroid of the enclosed area.
fn middle(outline: &Outline) -> [f64; 2] {
    let next = outline.iter().cycle().skip(1);
    let moment = |axis: usize| -> f64 {
        outline.iter().zip(next.clone()).map(|(a, b)| (a[axis] + b[axis]) * (a[0] * b[1] - b[0] * a[1])).sum::<f64>() / 6.0
    };
    [moment(0) / area_px2(outline), moment(1) / area_px2(outline)]
}

fn sd(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}

#[test]
fn without_disturbance_a_view_is_the_outline() {
    let (phantom, camera) = (Phantom::finned(5, 1).unwrap().placed(Pose::seeded(1)), Camera::default());
    for (view, omega) in phantom.views(&camera, &plan(7), &Disturbance::default()).iter().zip(plan(7)) {
        assert_eq!(one(view), &phantom.outline(&camera, omega));
        assert!((view.true_omega_rad - omega).abs() < f64::EPSILON && view.dy_px.abs() < f64::EPSILON);
    }
}

#[test]
fn the_same_seed_gives_the_same_views_and_another_seed_others() {
    let (phantom, camera) = (Phantom::larva(3, 5).unwrap(), Camera::default());
    let views = |seed| phantom.views(&camera, &plan(12), &Disturbance::drift(seed));
    assert_eq!(views(1), views(1));
    for (a, b) in views(1).iter().zip(views(2)).skip(1) {
        assert!((a.true_omega_rad - b.true_omega_rad).abs() > 1e-9 && (a.dy_px - b.dy_px).abs() > 1e-9);
    }
    // A view does not depend on the other views.
    assert_eq!(phantom.views(&camera, &plan(12)[..5], &Disturbance::drift(1)), views(1)[..5]);
}

#[test]
fn the_camera_and_the_angles_have_the_requested_errors() {
    let camera = Camera::default();
    let asked =
        Disturbance { uy_px: -11.0, gamma_rad: 0.01, rho: 1.02, dy_px: 0.4, omega_jitter_rad: 0.009, seed: 3, ..Disturbance::default() };
    let off = sphere().placed(Pose { x_um: 1100.0, ..Pose::default() });
    let views = off.views(&camera, &plan(84), &asked);
    for view in &views {
        let [u, v] = middle(one(view));
        // 1100 um along the axis, lowered by gamma: 200 px times sin 0.01. Perspective stretches the outline by r^2 x / d^3.
        assert!((u - 511.5 - 200.0 * 0.01f64.cos()).abs() < 0.01, "{u}");
        assert!((v - view.dy_px - 500.5 - 200.0 * 0.01f64.sin()).abs() < 0.01, "{v}");
    }
    assert!(views[0].true_omega_rad.abs() < f64::EPSILON);
    let jitter: Vec<f64> = views.iter().zip(plan(84)).skip(1).map(|(view, planned)| view.true_omega_rad - 1.02 * planned).collect();
    let shifts: Vec<f64> = views.iter().map(|view| view.dy_px).collect();
    // The standard error of a standard deviation of 84 is 8 %: three of them.
    assert!((sd(&jitter) / 0.009 - 1.0).abs() < 0.24, "{}", sd(&jitter));
    assert!((sd(&shifts) / 0.4 - 1.0).abs() < 0.24, "{}", sd(&shifts));
}

#[test]
fn an_uneven_edge_has_the_requested_deviation_and_correlation_length() {
    let camera = Camera::default();
    let asked = Disturbance { edge_noise_px: 0.3, edge_correlation_px: 5.0, seed: 9, ..Disturbance::default() };
    let (mut all, mut near, mut apart, mut between) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (clean, views) = (sphere().views(&camera, &plan(60), &Disturbance::default()), sphere().views(&camera, &plan(60), &asked));
    let radius_px = (area_px2(one(&clean[0])) / std::f64::consts::PI).sqrt();
    let radial = |view: &View| -> Vec<f64> { one(view).iter().map(|[u, v]| (u - 511.5).hypot(v - 511.5) - radius_px).collect() };
    let mut before = radial(&views[59]);
    for (clean, view) in clean.iter().zip(&views) {
        let (noise, places) = (radial(view), one(clean));
        // Both ends of the outline have their vertices closer.
        for i in 0..places.len() - 40 {
            all.push(noise[i]);
            between.push(noise[i] * before[i]);
            let far = |j: usize| (places[j][0] - places[i][0]).hypot(places[j][1] - places[i][1]);
            let Some(j) = (i..i + 40).find(|&j| far(j) > 5.0) else { continue };
            near.push(noise[i] * noise[j]);
            if let Some(k) = (i..places.len()).find(|&k| far(k) > 25.0) {
                apart.push(noise[i] * noise[k]);
            }
        }
        before = noise;
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (sd, near, apart, between) = (sd(&all), mean(&near) / 0.09, mean(&apart) / 0.09, mean(&between) / 0.09);
    println!("sd {sd:.4} px; correlation {near:.3} over 5 px, {apart:.3} over 25 px, {between:.3} between views");
    // 60 outlines of 290 px are some 2000 independent lengths: 0.022 relative error of correlations, 0.016 of the deviation.
    assert!((sd / 0.3 - 1.0).abs() < 0.05, "{sd}");
    assert!((near - (-0.5f64).exp()).abs() < 0.07, "{near}");
    assert!(apart.abs() < 0.07 && between.abs() < 0.07, "{apart}, {between}");
}

#[test]
fn each_fault_changes_its_view_as_described() {
    let camera = Camera::default();
    let phantom = Phantom::larva(4, 2).unwrap();
    let by = Pose { x_um: 110.0, y_um: 30.0, roll_rad: 0.3, ..Pose::default() };
    let faults = vec![
        Fault::Blank { view: 1 },
        Fault::Leak { view: 2, at_u_px: 480.0, width_px: 60.0, bore_radius_um: 325.0 },
        Fault::Jump { view: 3, u_px: 2.0, v_px: -6.0 },
        Fault::Moved { from: 5, by },
    ];
    let views = phantom.views(&camera, &plan(7), &Disturbance { faults, ..Disturbance::default() });
    let clean = phantom.views(&camera, &plan(7), &Disturbance::default());
    assert_eq!(views[0], clean[0]);
    assert!(views[1].outline.is_empty());
    // The middle 30 px lie at the wall, and nothing lies beyond it.
    let wall = 511.5 - 325.0 / 5.5;
    let top = one(&views[2]).iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    assert!((top - wall).abs() < 1e-9, "{top} against {wall}");
    assert!(area_px2(one(&views[2])) > area_px2(one(&clean[2])) + 30.0 * 10.0);
    assert!(one(&views[2]).iter().all(|p| (p[0] - 480.0).abs() < 31.0 || one(&clean[2]).contains(p)));
    let ([u, v], [u0, v0]) = (middle(one(&views[3])), middle(one(&clean[3])));
    assert!((u - u0 - 2.0).abs() < 1e-6 && (v - v0 + 6.0).abs() < 1e-6);
    assert_eq!(views[4], clean[4]);
    for i in [5, 6] {
        assert_eq!(one(&views[i]), &phantom.clone().placed(by).outline(&camera, plan(7)[i]));
    }
}

#[test]
fn a_clipped_tail_is_closed_along_the_rim() {
    let camera = Camera::default();
    let phantom = Phantom::finned(4, 2).unwrap();
    let clipped = Disturbance { faults: vec![Fault::Clipped { beyond_um: 400.0 }], ..Disturbance::default() };
    for view in phantom.views(&camera, &plan(4), &clipped) {
        let outline = one(&view);
        assert!(outline.iter().all(|[u, _]| (-0.5..=1023.5).contains(u)));
        let rim: Vec<f64> = outline.iter().filter(|p| (p[0] - 1023.5).abs() < 1e-9).map(|p| p[1]).collect();
        assert!(rim.len() == 2 && (rim[0] - rim[1]).abs() > 2.0, "{rim:?}");
        assert!(area_px2(outline) > 0.0);
    }
}
