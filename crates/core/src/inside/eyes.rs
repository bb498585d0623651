//! The eyes: two dark ellipsoids, fitted to their edges in all views at once.
//!
//! ```text
//!      view              edge: where the light along a ray from the centre has risen by two fifths of the way to the light outside
//!    ( * )( * )          an edge counts where the other eye does not lie behind it
//! ```
//! In views from the side the eyes lie behind each other. Where the outline of one lies within the other it shows no edge. docs/organs.md has
//! the definitions and the errors.

use super::Lit;
use super::dark::{LEVELS, thickest};
use super::ellipsoid::{Ellipse, Ellipsoid, Linear};
use super::fit::{Edge, Fit, root_of_squares, solve};
use crate::geometry::BoxUm;
use crate::parallel::prelude::*;
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A side of a larva, as the larva itself has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum BodySide {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// One eye: the ellipsoid that its dark outline in all views shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Eye {
    /// The side of the larva. `None` where the back is not determined.
    pub side: Option<BodySide>,
    /// Volume of the ellipsoid.
    pub volume_um3: f64,
    /// Standard deviation of the volume: by the views, the form and the place of the edges.
    pub volume_sd_um3: f64,
    /// Centre, in the frame of the mesh.
    pub centre_um: [f64; 3],
    /// Half axes, the longest first.
    pub half_axes_um: [f64; 3],
    /// The ellipsoid in the frame of the mesh, um^2: all x with (x - centre) S^-1 (x - centre) <= 1, as xx, yy, zz, xy, xz, yz of S.
    pub spread_um2: [f64; 6],
    /// Root mean square distance of the edges from its outlines, px.
    pub residual_px: f64,
}

/// The eyes of a larva.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Eyes {
    /// The eyes that were found: the left one first, or the larger one where the sides are not known.
    pub eyes: Vec<Eye>,
    /// Mean volume of both. `None` without two eyes.
    pub mean_volume_um3: Option<f64>,
    /// Its standard deviation.
    pub mean_volume_sd_um3: Option<f64>,
    /// Why there are not two. `None` where there are.
    pub reason: Option<EyesMissing>,
    /// Distance between the centres. `None` without two eyes.
    pub distance_um: Option<f64>,
    /// Its standard deviation.
    pub distance_sd_um: Option<f64>,
    /// Angle between the line from eye to eye and the body axis at the head, 0 to 90 deg. `None` without two eyes or without an axis.
    pub axis_angle_deg: Option<f64>,
}

/// Why fewer than two eyes were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum EyesMissing {
    /// Too few views.
    #[error("too few views show the specimen from different sides")]
    FewViews,
    /// No dark part is thick enough.
    #[error("no part near an end is as dark and as thick as an eye")]
    NotDark,
    /// One part alone.
    #[error("only one part is as dark and as thick as an eye, or both eyes touch")]
    OnlyOne,
    /// The edges do not fit ellipsoids.
    #[error("the edges of the dark parts do not fit the outlines of two ellipsoids")]
    NotEllipsoids,
}

/// Views that determine two ellipsoids.
const LEAST_VIEWS: usize = 6;
/// Rays per eye and view.
const RAYS: usize = 48;
/// Step along a ray, px.
const STEP_PX: f64 = 0.25;
/// An edge is where the light changes by this much at least.
const LEAST_CONTRAST: f64 = 0.12;
/// The light outside is the brightest this far behind the first rise, px.
const AHEAD_PX: f64 = 4.0;
/// Share of the way from the light inside to that outside at which the edge lies. Half the way is where blur alone leaves an edge; the skin
/// around an eye and the bending of light beside it darken a rim outside, so that less is nearer to the truth on the pictures of two renderers.
const LEVEL: f64 = 0.41;
/// How far around the outline edges are looked for, in distances from the centre, pass by pass.
const RANGES: [f64; 5] = [0.5, 0.4, 0.3, 0.25, 0.2];
/// Newton's steps per pass.
const STEPS: usize = 4;
/// Edges this near to the outline of the other eye are left out, px.
const CLEAR_PX: f64 = 3.0;
/// Largest accepted residual, px. Eyes of both renderers have up to 1.4.
const MOST_RESIDUAL_PX: f64 = 1.8;
/// Eyes of which the smaller has this share of the larger are taken without looking further. Those of a healthy larva have 0.9.
const ALIKE: f64 = 0.6;
/// Half axes of an eye, um.
const HALF_AXES_UM: [f64; 2] = [25.0, 260.0];

impl Eyes {
    /// From the views that count and the box around the mesh. `left` is the direction to the left of the larva, and `along` that of its axis at the
    /// head, where they are known.
    pub(crate) fn find(views: &[Lit], extents: &BoxUm, left: Option<[f64; 3]>, along: Option<[f64; 3]>) -> Self {
        match fitted(views, extents) {
            Ok(fits) => Self::of(&fits, left.map(Vector3::from), along.map(Vector3::from)),
            Err(reason) => Self { reason: Some(reason), ..Self::default() },
        }
    }

    fn of(fits: &[Fit], left: Option<Vector3<f64>>, along: Option<Vector3<f64>>) -> Self {
        let middle = fits.iter().map(|fit| fit.body.centre).sum::<Vector3<f64>>() / fits.len() as f64;
        let mut eyes: Vec<Eye> = fits
            .iter()
            .map(|fit| {
                let side = left
                    .filter(|_| fits.len() == 2)
                    .map(|left| if (fit.body.centre - middle).dot(&left) > 0.0 { BodySide::Left } else { BodySide::Right });
                fit.eye(side)
            })
            .collect();
        eyes.sort_by(|a, b| {
            let key = |eye: &Eye| (eye.side != Some(BodySide::Left), -eye.volume_um3);
            key(a).0.cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1))
        });
        let apart = match fits {
            [a, b] => Some(b.body.centre - a.body.centre),
            _ => None,
        };
        let mean = |of: fn(&Eye) -> f64| (eyes.len() == 2).then(|| eyes.iter().map(of).sum::<f64>() / 2.0);
        Self {
            // The place of the edges is off by the same amount in both eyes, so that the mean is not known better than one.
            mean_volume_um3: mean(|eye| eye.volume_um3),
            mean_volume_sd_um3: mean(|eye| eye.volume_sd_um3),
            reason: (eyes.len() < 2).then_some(EyesMissing::OnlyOne),
            distance_um: apart.map(|d| d.norm()),
            distance_sd_um: apart.map(|_| root_of_squares(fits.iter().map(Fit::centre_sd_um))),
            axis_angle_deg: apart.zip(along).map(|(d, along)| (d.dot(&along).abs() / d.norm()).min(1.0).acos().to_degrees()),
            eyes,
        }
    }
}

/// The pair whose eyes are most alike, over the levels of darkness. A dense head can take the place of an eye at one level.
fn fitted(views: &[Lit], extents: &BoxUm) -> Result<Vec<Fit>, EyesMissing> {
    if views.len() < LEAST_VIEWS {
        return Err(EyesMissing::FewViews);
    }
    let mut best: Result<Vec<Fit>, EyesMissing> = Err(EyesMissing::NotDark);
    for level in LEVELS {
        let found = thickest(views, extents, level);
        if found.is_empty() {
            continue;
        }
        match fitted_to(views, found) {
            Some(fits) if alike(&fits) >= ALIKE => return Ok(fits),
            Some(fits) => {
                if best.as_ref().map_or(-1.0, |best| alike(best)) < alike(&fits) {
                    best = Ok(fits);
                }
            }
            None => best = best.or(Err(EyesMissing::NotEllipsoids)),
        }
    }
    best
}

/// The smaller volume over the larger one. 0 for one eye.
fn alike(fits: &[Fit]) -> f64 {
    match fits {
        [a, b] => {
            let ratio = a.body.volume_um3() / b.body.volume_um3();
            ratio.min(1.0 / ratio)
        }
        _ => 0.0,
    }
}

fn fitted_to(views: &[Lit], mut found: Vec<Ellipsoid>) -> Option<Vec<Fit>> {
    let mut fits = Vec::new();
    for range in RANGES {
        fits = (0..found.len()).into_par_iter().map(|k| Fit::of_eye(views, &found, k, range)).collect::<Option<Vec<_>>>()?;
        found = fits.iter().map(|fit| fit.body).collect();
    }
    fits.iter().all(Fit::is_like_an_eye).then_some(fits)
}

impl Fit {
    /// Fits ellipsoid `k` of `all` to its edges.
    fn of_eye(views: &[Lit], all: &[Ellipsoid], k: usize, range: f64) -> Option<Self> {
        let linear: Vec<Linear> = views.iter().map(|view| Linear::of(view.projection, all[k].centre)).collect::<Option<_>>()?;
        let mut edges = Vec::new();
        for (view, (lit, linear)) in views.iter().zip(&linear).enumerate() {
            let own = all[k].seen(linear);
            let others: Vec<Ellipse> = all.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, other)| other.seen(linear)).collect();
            for ray in 0..RAYS {
                let (sin, cos) = (TAU * ray as f64 / RAYS as f64).sin_cos();
                let direction = Vector2::new(cos, sin);
                let reach = own.reach(direction);
                let Some(at) = edge(lit, own.centre, direction, reach, range) else { continue };
                let outside = own.centre + (reach + AHEAD_PX) * direction;
                if others.iter().all(|other| other.beyond(at) > CLEAR_PX && other.beyond(outside) > CLEAR_PX) {
                    edges.push(Edge { view, at });
                }
            }
        }
        let (body, residual_px) = solve(&linear, &edges, all[k], None, STEPS)?;
        Some(Self { body, linear, edges, residual_px })
    }

    fn is_like_an_eye(&self) -> bool {
        let [least, most] = HALF_AXES_UM;
        self.residual_px < MOST_RESIDUAL_PX && self.body.half_axes_um().iter().all(|a| (least..most).contains(a))
    }

    fn eye(&self, side: Option<BodySide>) -> Eye {
        Eye {
            side,
            volume_um3: self.body.volume_um3(),
            volume_sd_um3: self.volume_sd_um3(),
            centre_um: self.body.centre.into(),
            half_axes_um: self.body.half_axes_um(),
            spread_um2: self.body.spread_um2(),
            residual_px: self.residual_px,
        }
    }
}

/// The edge along a ray from the centre of an eye.
fn edge(view: &Lit, centre: Vector2<f64>, direction: Vector2<f64>, reach: f64, range: f64) -> Option<Vector2<f64>> {
    let light = |r: f64| {
        let at = centre + r * direction;
        view.shade.at((at.x, at.y))
    };
    let (from, to) = ((1.0 - range) * reach, (1.0 + range) * reach + AHEAD_PX);
    let samples: Vec<f64> = (0..=((to - from) / STEP_PX) as usize).map_while(|i| light(from + i as f64 * STEP_PX)).collect();
    let inside = light(0.5 * reach)?.min(*samples.first()?);
    let rise = samples.iter().position(|&l| l > inside + LEAST_CONTRAST / 2.0)?;
    let outside = samples[rise..].iter().take((AHEAD_PX / STEP_PX) as usize).copied().fold(0.0, f64::max);
    if outside - inside < LEAST_CONTRAST {
        return None;
    }
    let level = inside + LEVEL * (outside - inside);
    let i = samples.iter().position(|&l| l > level).filter(|&i| i > 0)?;
    let part = (level - samples[i - 1]) / (samples[i] - samples[i - 1]);
    Some(centre + (from + (i as f64 - 1.0 + part) * STEP_PX) * direction)
}
