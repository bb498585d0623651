//! Whole turns of a finned body with edges from formulas.

use super::*;
use crate::calibration::Pose;
use crate::geometry::{BoxUm, Camera};
use crate::measure::extents;
use crate::profile::Columns;
use std::f64::consts::{PI, TAU};

const WIDTH: usize = 320;
const HEIGHT: usize = 150;
const VIEWS: usize = 21;
/// Half the length of the body, and its radius, um.
const HALF_UM: f64 = 500.0;
const RADIUS_UM: f64 = 110.0;
/// Where the fin begins and ends: behind the end of the body.
const FIN_UM: [f64; 2] = [-100.0, 700.0];
/// Direction of the fin, rad.
const UPWARDS: f64 = 0.7;
/// A view that does not belong.
const BAD: usize = 8;

/// The scale along the capillary is not that across it.
fn camera() -> Camera {
    let camera = Camera::published(WIDTH as u32, HEIGHT as u32);
    Camera { kx: 0.8 * camera.ky, ..camera }
}

fn radius_um(x_um: f64) -> f64 {
    RADIUS_UM * (1.0 - (x_um / HALF_UM).powi(2)).max(0.0).sqrt()
}

/// Distance of the fin's free edge from the axis, um.
fn fin_um(x_um: f64) -> Option<f64> {
    let part = (x_um - FIN_UM[0]) / (FIN_UM[1] - FIN_UM[0]);
    (0.0..=1.0).contains(&part).then(|| 60.0 + 120.0 * (PI * part).sin())
}

/// What a view shows.
struct SyntheticView {
    omega: f64,
    mask: Mask,
    outline: Vec<Polygon>,
    body: Vec<Polygon>,
}

/// The outline of the body, with the fin where it stands out by `seen_px`, moved down by `down_px`.
fn outline(omega: f64, seen_px: Option<f64>, down_px: f64) -> Polygon {
    let (camera, pose) = (camera(), Pose::new(&camera()));
    let projection = camera.projection(omega);
    let (mut upper, mut lower) = (Vec::new(), Vec::new());
    for u in 0..WIDTH {
        let x_um = pose.slice(u as f64);
        let rows = [PI, 0.0].map(|side| {
            let (sin, cos) = (side - omega).sin_cos();
            let at = |h: f64| projection.project([x_um, h * cos, h * sin]).unwrap().1 + down_px;
            let body = radius_um(x_um);
            let fin = seen_px.zip(fin_um(x_um)).map(|(px, reach)| (px, reach * (side - omega - UPWARDS).cos()));
            // A sheet is some um thick.
            let least = if seen_px.is_some() && fin_um(x_um).is_some() { 6.0 } else { 0.0 };
            let h = fin.filter(|(px, fin)| (fin - body) * camera.ky >= *px).map_or(body, |(_, fin)| fin).max(body).max(least);
            (h > 0.0).then(|| at(h))
        });
        if let [Some(above), Some(below)] = rows {
            upper.push([u as f64, above]);
            lower.push([u as f64, below]);
        }
    }
    upper.extend(lower.into_iter().rev());
    Polygon { vertices: upper }
}

fn mask(outline: &Polygon) -> Mask {
    let columns = Columns::from_outlines(std::slice::from_ref(outline), WIDTH, HEIGHT);
    let mut mask = Mask::empty(WIDTH, HEIGHT);
    for (u, v) in (0..WIDTH).flat_map(|u| (0..HEIGHT).map(move |v| (u, v))) {
        mask.set(u, v, columns.get(u).is_some_and(|e| (e.upper..=e.lower).contains(&(v as f64))));
    }
    mask
}

/// The views, each with some drift. View [`BAD`] shows the specimen elsewhere.
fn views() -> Vec<SyntheticView> {
    let view = |i: usize| {
        let omega = TAU * i as f64 / VIEWS as f64;
        let down_px = if i == BAD { 14.0 } else { 0.3 * (7.0 * i as f64).sin() };
        let found = outline(omega, Some(4.0), down_px);
        SyntheticView { omega, mask: mask(&found), outline: vec![found], body: vec![outline(omega, None, down_px)] }
    };
    (0..VIEWS).map(view).collect()
}

fn observed<'a>(views: impl Iterator<Item = &'a SyntheticView>) -> Reconstruction {
    let grid = VoxelGrid::new(BoxUm { min: [-800.0, -230.0, -230.0], max: [800.0, 230.0, 230.0] }, 12.0).unwrap();
    let mut model = Reconstruction::new(&camera(), grid, VIEWS, ReconstructionSettings::default()).unwrap();
    for SyntheticView { omega, mask, outline, body } in views {
        model.observe_outlines(mask, outline, body, None, *omega, Leaves::default()).unwrap();
    }
    model
}

/// Volume of the hull of body and fin in each slice, um^3.
fn truth_um3() -> f64 {
    let slices = 4000;
    let step_um = (FIN_UM[1] + HALF_UM) / f64::from(slices);
    let area = |i: i32| {
        let x_um = -HALF_UM + (f64::from(i) + 0.5) * step_um;
        let (radius, reach) = (radius_um(x_um), fin_um(x_um).unwrap_or(0.0));
        let flank = if reach > radius && radius > 0.0 {
            radius * ((reach * reach - radius * radius).sqrt() - radius * (radius / reach).acos())
        } else {
            0.0
        };
        PI * radius * radius + flank
    };
    (0..slices).map(area).sum::<f64>() * step_um
}

#[test]
fn a_fin_that_goes_on_behind_the_body_is_in_the_volume_and_in_the_mesh() {
    let measured = observed(views().iter()).finish(false).unwrap();
    let [fin] = &measured.fins[..] else { panic!("{} fins", measured.fins.len()) };
    assert!(fin.points_um.last().unwrap()[0] > HALF_UM, "it ends at {:?}", fin.points_um.last());
    let m = &measured.model.measurement;
    let off = 100.0 * (m.volume_um3 / truth_um3() - 1.0);
    assert!(off.abs() < 1.0, "{off} %");
    let reach_um = extents(&measured.model.mesh).map(|e| e.max[1].hypot(e.max[2])).unwrap();
    assert!(reach_um > 150.0, "the mesh reaches {reach_um} um");
    let spread = m.spread.unwrap();
    assert!(spread.volume_fins_um3 > 0.0 && spread.area_fins_um2 > 0.0 && spread.volume_fins_unseen_um3 == 0.0, "{spread:?}");
}

#[test]
fn a_view_that_does_not_belong_is_not_made_to_fit() {
    let measured = observed(views().iter()).finish(false).unwrap();
    let states = measured.calibration.unwrap().calibration.views;
    let left_out: Vec<usize> = (0..VIEWS).filter(|&i| states[i].bad.is_some()).collect();
    assert_eq!(left_out, [BAD]);
}

#[test]
fn fins_do_not_depend_on_the_order_of_views_nor_on_when_the_model_was_refined() {
    let views = views();
    let measured = observed(views.iter()).finish(false).unwrap();
    let mut turned = observed(views[10..].iter().chain(views[..10].iter().rev()));
    turned.refine(false);
    let again = turned.finish(false).unwrap();
    assert_eq!((&again.model, &again.fins), (&measured.model, &measured.fins));
    let estimate = turned.estimate(false).unwrap();
    assert_eq!(estimate.volume_um3, measured.model.measurement.volume_um3, "the estimate of all views is the measurement");
}

/// A fin of which the views show only what stands far out. One view in three finds none of it, and does not know the area better than all do.
#[test]
fn the_interval_of_the_area_grows_where_fewer_views_miss_fins() {
    let hide = |view: SyntheticView| {
        let sheet = outline(view.omega, Some(40.0), 0.0);
        SyntheticView { mask: mask(&sheet), outline: vec![sheet], ..view }
    };
    let hidden: Vec<SyntheticView> = views().into_iter().map(hide).collect();
    let of = |views: &[SyntheticView], every: usize| observed(views.iter().step_by(every)).finish(false).unwrap();
    for views in [&views(), &hidden] {
        let [all, third] = [1, 3].map(|every| of(views, every).model.measurement);
        assert!(third.area_sd_um2 > all.area_sd_um2, "{third:?} from a third of {all:?}");
    }
    let missed = of(&hidden, 3);
    let (m, fins) = (&missed.model.measurement, &missed.fins);
    assert!(fins.is_empty() && m.spread.unwrap().area_fins_um2 > 0.045 * m.area_um2, "{fins:?} {m:?}");
}
