//! The standard pictures of a larva: its left side and its back, head to the left.
//!
//! ```text
//!   head at low x                    head at high x                        the picture
//!   lateral view: back up            lateral view: back down                 back
//!    ____________                        ____________                     ____________
//!   ( o_______---===>                <===---_______o )   half a turn ─>  ( o_______---===>
//!                                                        about the line of sight
//! ```
//! A picture may be turned by half a turn, and is never mirrored: a mirror image has left and right exchanged. A larva whose head is at
//! the left and whose back is up shows its left side, so exactly one of the two lateral views can be shown so. The tilt of the capillary in
//! the frame is taken out, and both directions get one scale. The bend of the larva stays.

use super::SpecimenRecord;
use crate::geometry::{Camera, Lookup};
use crate::measure::facing::Facing;
use crate::measure::shape::{Body, End};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Least confidence of head and back. Below it a picture would too often show another side than it says.
pub const LEAST_CONFIDENCE: f64 = 0.1;

/// What a standard picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Aspect {
    /// The left side: head to the left, back up.
    Lateral,
    /// The back: head to the left.
    Dorsal,
}

impl Aspect {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Lateral, Self::Dorsal];

    /// The name of its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lateral => "lateral",
            Self::Dorsal => "dorsal",
        }
    }
}

/// Why a larva has no standard pictures.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoStandardView {
    /// Without the body axis nothing shows where head and back are.
    #[error("the shape has no body axis: {reason}")]
    NoBody {
        /// Why it has none.
        reason: String,
    },
    /// Both ends are alike.
    #[error("the head is not decided (confidence {found:.2}, at least {LEAST_CONFIDENCE} is needed): look at the views")]
    Head {
        /// Its confidence.
        found: f64,
    },
    /// The shape does not show which side is the back.
    #[error("the back is not decided (confidence {found:.2}, at least {LEAST_CONFIDENCE} is needed): look at the views")]
    Back {
        /// Its confidence.
        found: f64,
    },
    /// No view counts.
    #[error("no view was used")]
    NoView,
}

/// The view of a standard picture, and how the picture lies in its frame.
#[derive(Debug, Clone)]
pub struct StandardView {
    /// What it shows.
    pub aspect: Aspect,
    /// Number of the view.
    pub view: u32,
    /// Angle about the capillary between this view and the one that would show the aspect straight, deg.
    pub off_deg: f64,
    /// Confidence that head and back are what they are taken for, 0 to 1: the lesser of both.
    pub confidence: f64,
    /// Whether the frame stands on its head in the picture.
    pub is_turned: bool,
    /// Middle of the larva in the plane through the axis of the capillary: along it, and down in the frame, um.
    middle_um: [f64; 2],
    /// Sine and cosine of the angle of the view.
    turned: [f64; 2],
    projection: Lookup,
}

impl StandardView {
    /// Where a point of the picture is in the frame: `(u, v)`, px, pixel centres at integers. The point is given in um to the right of the
    /// middle of the larva and below it. `None` for a point behind the camera.
    pub fn in_frame(&self, [right_um, down_um]: [f64; 2]) -> Option<(f64, f64)> {
        let sign = if self.is_turned { -1.0 } else { 1.0 };
        let [x, y] = [self.middle_um[0] + sign * right_um, self.middle_um[1] + sign * down_um];
        // Of the plane that the view sees from straight ahead, in the coordinates of the capillary.
        let [sin, cos] = self.turned;
        self.projection.project([x, y * cos, -y * sin])
    }
}

impl SpecimenRecord {
    /// The views of the standard pictures. `rig` is the camera of the rig, as for [`Self::projections`].
    ///
    /// # Errors
    /// Says why there is none.
    pub fn standard_views(&self, rig: &Camera) -> Result<[StandardView; 2], NoStandardView> {
        let no_body = |reason: Option<&String>| {
            let reason = reason.map_or("its numbers have no shape; `carved measure` computes it", String::as_str);
            NoStandardView::NoBody { reason: reason.to_owned() }
        };
        let shape = self.shape.as_ref().ok_or_else(|| no_body(None))?;
        let body = shape.body.as_ref().ok_or_else(|| no_body(shape.body_reason.as_ref().or(shape.solid_reason.as_ref())))?;
        let projections = self.projections(rig);
        let used = |view: u32| projections.iter().find(|(number, _)| *number == view);
        let views: Vec<(u32, f64)> = self.views.iter().filter(|v| used(v.index).is_some()).map(|v| (v.index, v.omega)).collect();
        let camera = self.calibration.as_ref().map_or(rig, |found| &found.psi);
        // Numbers of older versions have a shape and no sides.
        let facing = self.facing.clone().or_else(|| Facing::of(shape, self.eyes.as_ref(), camera, &views));
        let facing = facing.ok_or(NoStandardView::Back { found: body.dorsal.confidence })?;
        let head = facing.head.filter(|_| facing.head_confidence >= LEAST_CONFIDENCE);
        let head = head.ok_or(NoStandardView::Head { found: facing.head_confidence })?;
        if facing.confidence < LEAST_CONFIDENCE {
            return Err(NoStandardView::Back { found: facing.confidence });
        }
        let is_turned = head == End::Right;
        let roll = facing.roll_deg.to_radians();
        let of = |aspect: Aspect| {
            let wanted = match aspect {
                Aspect::Dorsal => roll,
                // Positive angles move what faces the camera down in the frame: a quarter turn before the back faces it, the back is up.
                Aspect::Lateral if is_turned => roll + FRAC_PI_2,
                Aspect::Lateral => roll - FRAC_PI_2,
            };
            let off = |omega: f64| (omega - wanted - TAU * ((omega - wanted) / TAU).round()).abs();
            let nearest = views.iter().min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
            let &(view, omega) = nearest.ok_or(NoStandardView::NoView)?;
            let (_, projection) = used(view).ok_or(NoStandardView::NoView)?;
            let (sin, cos) = omega.sin_cos();
            Ok(StandardView {
                aspect,
                view,
                off_deg: off(omega).to_degrees(),
                confidence: facing.confidence.min(facing.head_confidence),
                is_turned,
                middle_um: middle_um(body, [sin, cos]),
                turned: [sin, cos],
                projection: projection.lookup(),
            })
        };
        let [lateral, dorsal] = Aspect::ALL.map(of);
        Ok([lateral?, dorsal?])
    }
}

/// The middle of the body's extent along the capillary, and across it as seen at this angle.
fn middle_um(body: &Body, [sin, cos]: [f64; 2]) -> [f64; 2] {
    let seen = body.stations.iter().map(|station| {
        let [x, y, z] = station.centre_um;
        let reach = station.height_um.max(station.width_um) / 2.0;
        [x, y * cos - z * sin, reach]
    });
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for [x, y, reach] in seen {
        for (bound, [least, most]) in bounds.iter_mut().zip([[x, x], [y - reach, y + reach]]) {
            *bound = [bound[0].min(least), bound[1].max(most)];
        }
    }
    bounds.map(|[least, most]| if least <= most { f64::midpoint(least, most) } else { 0.0 })
}

/// The size and scale of standard pictures, the same for every larva of a method on a rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Format {
    /// Edge of a pixel, um.
    pub um_per_px: f64,
    /// Width and height, px.
    pub size: [u32; 2],
}

impl Format {
    /// The scale is that of the frame, along or across the capillary, whichever is coarser, to three digits: then pictures of one rig have
    /// one scale though its calibration is refreshed. The size is that of the method's box (`box_um`), into which the longest larva must
    /// fit, or of the frame where the frame shows less.
    pub fn of(rig: &Camera, box_um: [f64; 2]) -> Self {
        let coarser = (1.0 / rig.kx).max(1.0 / rig.ky);
        let digit = 10f64.powf(coarser.log10().floor() - 2.0);
        let um_per_px = (coarser / digit).round() * digit;
        let shown = [f64::from(rig.width) / rig.kx, f64::from(rig.height) / rig.ky];
        let size = std::array::from_fn(|a| (box_um[a].min(shown[a]) / um_per_px).round().max(1.0) as u32);
        Self { um_per_px, size }
    }

    /// Where a pixel of the picture is, um right of its middle and below it.
    pub fn at_um(&self, [column, row]: [u32; 2]) -> [f64; 2] {
        [(column, self.size[0]), (row, self.size[1])].map(|(at, of)| (f64::from(at) - f64::from(of - 1) / 2.0) * self.um_per_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Projection;

    fn view(camera: &Camera, omega: f64, is_turned: bool) -> StandardView {
        let (sin, cos) = omega.sin_cos();
        let projection: Projection = camera.projection(omega);
        StandardView {
            aspect: Aspect::Lateral,
            view: 0,
            off_deg: 0.0,
            confidence: 1.0,
            is_turned,
            middle_um: [100.0, -50.0],
            turned: [sin, cos],
            projection: projection.lookup(),
        }
    }

    /// Right and down in the picture are one scale each way, whatever the frame's scales, tilt and angle are, and keep their sense.
    #[test]
    fn a_picture_has_one_scale_and_no_tilt_and_is_never_mirrored() {
        let camera = Camera { kx: 0.2, ky: 0.16, gamma: 0.05, f: 1e9, ..Camera::published(1024, 400) };
        for (omega, is_turned) in [(0.0, false), (1.9, false), (-2.5, true)] {
            let standard = view(&camera, omega, is_turned);
            let at = |right: f64, down: f64| standard.in_frame([right, down]).unwrap();
            let (middle, right, down) = (at(0.0, 0.0), at(100.0, 0.0), at(0.0, 100.0));
            let step = |to: (f64, f64)| [(to.0 - middle.0) / camera.kx, (to.1 - middle.1) / camera.ky];
            let (right, down) = (step(right), step(down));
            let sign = if is_turned { -1.0 } else { 1.0 };
            let (sin, cos) = 0.05f64.sin_cos();
            for (found, expected) in right.iter().chain(&down).zip([cos, sin, -sin, cos]) {
                assert!((found - sign * 100.0 * expected).abs() < 0.01, "{omega} {is_turned}: {right:?} {down:?}");
            }
            assert!(right[0] * down[1] - right[1] * down[0] > 0.0, "a mirror image");
        }
    }

    #[test]
    fn the_format_is_that_of_the_method_and_the_rig() {
        let rig = Camera::published(1024, 200);
        assert_eq!(Format::of(&rig, [5000.0, 1000.0]), Format { um_per_px: 5.5, size: [909, 182] });
        let finer = Camera { kx: 0.200_01, ky: 0.183_3, ..Camera::published(1024, 200) };
        let format = Format::of(&finer, [9000.0, 9000.0]);
        assert!((format.um_per_px - 5.46).abs() < 1e-12, "{format:?}");
        assert_eq!(format.size, [938, 200], "no more than the frame shows");
        let [right, down] = Format { um_per_px: 5.0, size: [3, 2] }.at_um([0, 1]);
        assert!((right + 5.0).abs() < 1e-12 && (down - 2.5).abs() < 1e-12, "{right} {down}");
    }
}
