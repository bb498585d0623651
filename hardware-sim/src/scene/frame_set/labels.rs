//! What can be said of a frame, measured on the geometry that is drawn.

use crate::scene::capillary::Capillary;
use crate::scene::{Contents, SceneSettings, Specimen};
use serde::Serialize;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    Left,
    Right,
}

/// Of the specimens as this frame shows them; clutter does not count.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Labels {
    /// Where the one larva's head is.
    pub head: Option<Side>,
    /// The outline comes within [`TOUCHING_PX`] of a wall's inner line.
    pub touches_wall: bool,
    /// Between the outline and the inner line of the upper and the lower wall, where they are nearest.
    pub gap_px: Option<[f64; 2]>,
    /// Sides at which the picture ends before the specimens do.
    pub clipped: Vec<Side>,
    /// Height of what is seen, as a part of the bore's.
    pub fill: f64,
}

/// As near as this, blurred pictures of outline and wall are one.
pub const TOUCHING_PX: f64 = 2.0;

impl Labels {
    /// `contents` are settled in the bore.
    pub(super) fn measured(contents: &Contents, settings: &SceneSettings, angle_rad: f64) -> Self {
        let SceneSettings { camera, capillary, .. } = settings;
        let (view, upright) = (camera.view(angle_rad), camera.view(0.0));
        let grazing = grazing_um(capillary, camera.f_um);
        // Height of the walls' inner lines over a place in the picture: they are straight.
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
