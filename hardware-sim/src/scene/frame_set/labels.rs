//! Labels of a frame, measured on the drawn geometry.

use crate::scene::capillary::Capillary;
use crate::scene::{Contents, SceneSettings, Specimen};
use serde::Serialize;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    Left,
    Right,
}

/// Labels of the specimens in a frame. Clutter does not count.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Labels {
    /// The side of the head, if there is exactly one larva.
    pub head: Option<Side>,
    /// The outline is closer than [`TOUCHING_PX`] to the inner line of a wall.
    pub touches_wall: bool,
    /// Smallest distance between the outline and the inner line of the upper and of the lower wall.
    pub gap_px: Option<[f64; 2]>,
    /// Sides at which the border of the image clips the specimens.
    pub clipped: Vec<Side>,
    /// Height of the visible specimens over the height of the bore.
    pub fill: f64,
}

/// At this distance the blurred images of outline and wall merge.
pub const TOUCHING_PX: f64 = 2.0;

impl Labels {
    /// Measures the labels. `contents` are in the frame of the capillary.
    pub(super) fn measured(contents: &Contents, settings: &SceneSettings, angle_rad: f64) -> Self {
        let SceneSettings { camera, capillary, .. } = settings;
        let (view, upright) = (camera.view(angle_rad), camera.view(0.0));
        let grazing = grazing_um(capillary, camera.f_um);
        // The inner lines of the walls at a column of the image. They are straight.
        let line = |side: f64| {
            let [a, b] = [-1000.0, 1000.0].map(|x| upright.project([x, side * grazing, 0.0]));
            move |u: f64| a.v_px + (u - a.u_px) / (b.u_px - a.u_px) * (b.v_px - a.v_px)
        };
        let (upper, lower) = (line(-1.0), line(1.0));
        let last_px = f64::from(camera.width) - 0.5;
        let mut labels = Self { head: head(&contents.specimens), ..Self::default() };
        let (mut left, mut right) = (false, false);
        let mut gap = [f64::INFINITY; 2];
        for point in contents.specimens.iter().flat_map(Specimen::points) {
            let p = view.project(*point);
            left |= p.u_px < -0.5;
            right |= p.u_px > last_px;
            if (-0.5..=last_px).contains(&p.u_px) {
                gap = [gap[0].min(p.v_px - upper(p.u_px)), gap[1].min(lower(p.u_px) - p.v_px)];
            }
        }
        labels.clipped = [(left, Side::Left), (right, Side::Right)].into_iter().filter_map(|(is, side)| is.then_some(side)).collect();
        if gap[0].is_finite() {
            let bore_px = lower(camera.ux_px) - upper(camera.ux_px);
            labels.gap_px = Some(gap);
            labels.touches_wall = gap[0].min(gap[1]) < TOUCHING_PX;
            labels.fill = 1.0 - (gap[0] + gap[1]) / bore_px;
        }
        labels
    }
}

/// Distance from the axis of what the ray that grazes the bore meets beside the axis.
fn grazing_um(capillary: &Capillary, f_um: f64) -> f64 {
    let radius = capillary.bore_radius_um();
    radius / (1.0 - (radius / f_um).powi(2)).sqrt()
}

fn head(specimens: &[Specimen]) -> Option<Side> {
    match specimens {
        [one] if one.name().contains("larva") => Some(if one.placement().faces_right { Side::Right } else { Side::Left }),
        _ => None,
    }
}
