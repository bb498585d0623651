//! The body along its axis: slices, bending and its own frame.
//!
//! ```text
//!         dorsal
//!    ___/-------\________           slice i of 100 at s = (i + 1/2) / 100 of the length:
//!   ( o  | | | | | | | | ===>       area, perimeter, centre, height (dorsal to ventral), width (across that)
//!    \___|_|_|/‾‾‾‾‾‾‾‾             head first
//!       ventral
//! ```

use super::axis::{Axis, STATIONS, upright};
use super::orientation::{Dorsal, Head};
use super::section::{Flat, Plane, Section, cut, ranks};
use super::{Refusal, Solid, Vector};
use crate::surface::Mesh;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// What is measured along the body axis.
///
/// Errors, on the facets of the mesh: the length has the error of the ends (a tip with radius of curvature r makes an oblique
/// end plane err by r/2 times the squared angle). Areas have the error of the facets, some `(facet / radius)^2 / 8`. The axis
/// is known to `axis_rms_um`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Body {
    /// Arc length of the body axis from end to end of the surface. Of a turn it goes on, straight, to where the silhouettes end: the surface
    /// loses the thin end of a tail fin. The stations are those of the surface alone.
    pub length_um: f64,
    /// Areas of the slices times their thickness over the solid's volume: 1 where the slices follow the body (Pappus).
    pub slices_volume_share: f64,
    /// Root mean square distance of the slices' centres from the axis.
    pub axis_rms_um: f64,
    /// Which end is the head.
    pub head: Head,
    /// Which side is the back.
    pub dorsal: Dorsal,
    /// The motion into the body's own frame.
    pub to_body: ToBody,
    /// How the axis bends.
    pub bending: Bending,
    /// The slices, at even places, head first.
    pub stations: Vec<Station>,
}

impl Body {
    /// The direction to the left of the larva. `None` where its head and back are not determined.
    pub fn left(&self) -> Option<[f64; 3]> {
        self.dorsal.direction?;
        // The body's own frame is that of a larva that looks to the left with its back up: its left side faces whoever looks at it.
        Some(self.to_body.rotation[2].map(|z| -z))
    }

    /// Extends the length by what the silhouettes show beyond the surface: `beyond_um` on the left and on the right, along x. It goes on straight
    /// from the end that lies outermost there. An end that leans by more than [`LEANS_MOST`] stays.
    pub fn reach(&mut self, beyond_um: [f64; 2]) {
        let xs_um: Vec<f64> = self.stations.iter().map(|station| station.centre_um[0]).collect();
        let [Some(first), Some(last)] = [xs_um.get(..2), xs_um.len().checked_sub(2).and_then(|at| xs_um.get(at..))] else { return };
        let step_um = self.length_um / xs_um.len() as f64;
        let (least, most) = xs_um.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
        for [end, next] in [[first[0], first[1]], [last[1], last[0]]] {
            let share = (end - next) / step_um;
            let (is_outermost, beyond_um) = if share < 0.0 { (end <= least, beyond_um[0]) } else { (end >= most, beyond_um[1]) };
            if is_outermost && share.abs() >= LEANS_MOST.cos() {
                self.length_um += beyond_um.max(0.0) / share.abs();
            }
        }
    }

    /// The direction of the axis at the head, tailwards: from the slice at 4 to that at 16 % of the length. `None` where the head is not determined.
    pub fn axis_at_head(&self) -> Option<[f64; 3]> {
        self.head.end?;
        let [from, to] = [3, 15].map(|i| self.stations.get(i).map(|station| Vector::from(station.centre_um)));
        Some((to? - from?).try_normalize(0.0)?.into())
    }
}

/// One slice across the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Station {
    /// Arc length from the first end of the axis within the surface.
    pub s_um: f64,
    /// Area of the slice.
    pub area_um2: f64,
    /// Extent from side to side, across the height.
    pub width_um: f64,
    /// Extent along the direction from dorsal to ventral.
    pub height_um: f64,
    /// Length of the slice's border, holes and pieces included.
    pub perimeter_um: f64,
    /// Centre of the slice's area, in the coordinates of the mesh.
    pub centre_um: [f64; 3],
}

/// How the axis bends, from the first station to the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Bending {
    /// Sum of the angles between the axis' directions at neighbouring stations; 0 for a straight body.
    pub total_deg: f64,
    /// Largest curvature between neighbouring stations in the middle nine tenths. The ends are too short for theirs.
    pub max_curvature_per_mm: f64,
    /// Straight distance of the axis' two ends over its length, within the surface; 1 for a straight body.
    pub end_to_end_share: f64,
}

/// A rigid motion into the body's own frame: `rotation (x - origin_um)`. There x runs from the first end to the other, y from
/// dorsal to ventral, and z completes a right-handed frame. It is the frame of a larva that looks to the left with its back up,
/// as pictures show it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ToBody {
    /// Rows are the body's axes in the coordinates of the mesh.
    pub rotation: [[f64; 3]; 3],
    /// The solid's centroid.
    pub origin_um: [f64; 3],
}

impl ToBody {
    /// A point (um, in the coordinates of the mesh) in the body's frame, um.
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        let from: [f64; 3] = std::array::from_fn(|a| point[a] - self.origin_um[a]);
        self.rotation.map(|row| (0..3).map(|a| row[a] * from[a]).sum())
    }
}

/// The slices at the stations.
pub struct Slices {
    pub axis: Axis,
    pub s_um: Vec<f64>,
    pub planes: Vec<Plane>,
    pub ranks: Vec<u32>,
    pub sections: Vec<Section>,
    pub flats: Vec<Flat>,
}

/// Slices that hold another volume than the solid by more than this do not follow it. A larva's differ by 0.3 %.
const VOLUME_OFF: f64 = 0.02;
/// An end of the axis that leans by more against x is not extended along it, rad.
const LEANS_MOST: f64 = PI / 3.0;
/// Slices at either end that the largest curvature leaves out.
const END_STATIONS: usize = STATIONS / 20;

impl Slices {
    fn of(mesh: &Mesh, axis: Axis, across: Vector) -> Result<Self, Refusal> {
        let s_um = axis.stations();
        let planes = axis.planes(&s_um, across);
        let ranks = ranks(mesh, &planes);
        let (sections, corners) = cut(mesh, &planes, &ranks);
        let flats: Vec<Flat> = sections.iter().filter_map(Section::flat).collect();
        if flats.len() < STATIONS {
            return Err(Refusal::Slices { empty: STATIONS - flats.len() });
        }
        if corners > 0 {
            return Err(Refusal::Folded { corners });
        }
        Ok(Self { axis, s_um, planes, ranks, sections, flats })
    }

    pub fn centres(&self) -> impl Iterator<Item = Vector> {
        self.planes.iter().zip(&self.flats).map(|(plane, flat)| plane.point(flat.centre))
    }

    /// Mean direction of the axis, weighted with the slices' areas: that along which the volume lies.
    pub fn direction(&self) -> Vector {
        self.planes.iter().zip(&self.flats).map(|(plane, flat)| plane.along * flat.area_um2).sum::<Vector>().normalize()
    }
}

pub fn measure(mesh: &Mesh, solid: &Solid) -> Result<(Body, Slices), Refusal> {
    let rough = Slices::of(mesh, Axis::of(mesh, solid)?, Vector::y())?;
    let slice_um = rough.axis.length_um() / STATIONS as f64;
    let share = rough.flats.iter().map(|f| f.area_um2).sum::<f64>() * slice_um / solid.volume_um3;
    if (share - 1.0).abs() > VOLUME_OFF {
        return Err(Refusal::Volume { share });
    }
    let head = Head::of(&rough);
    let (dorsal, ventral) = Dorsal::of(&rough, &head);
    let axis = if head.is_last() { rough.axis.reversed() } else { rough.axis };
    let slices = Slices::of(mesh, axis, ventral)?;

    let along = slices.direction();
    let down = upright(ventral, along);
    let to_body = ToBody { rotation: [along, down, along.cross(&down)].map(Into::into), origin_um: solid.centroid_um };
    let stations = (0..STATIONS)
        .map(|i| {
            let ([height_um, width_um], flat) = (slices.sections[i].extent(), slices.flats[i]);
            let Flat { area_um2, perimeter_um, .. } = flat;
            let centre_um = slices.planes[i].point(flat.centre).into();
            Station { s_um: slices.s_um[i], area_um2, width_um, height_um, perimeter_um, centre_um }
        })
        .collect();
    let off = slices.flats.iter().map(|f| f.centre[0] * f.centre[0] + f.centre[1] * f.centre[1]).sum::<f64>();
    let body = Body {
        length_um: slices.axis.length_um(),
        slices_volume_share: share,
        axis_rms_um: (off / STATIONS as f64).sqrt(),
        head: head.first(),
        dorsal,
        to_body,
        bending: Bending::of(&slices),
        stations,
    };
    Ok((body, slices))
}

impl Bending {
    fn of(slices: &Slices) -> Self {
        let length_um = slices.axis.length_um();
        // Of small angles the sine keeps its digits, where the cosine loses them.
        let angle = |pair: &[Plane]| pair[0].along.cross(&pair[1].along).norm().atan2(pair[0].along.dot(&pair[1].along));
        let angles: Vec<f64> = slices.planes.windows(2).map(angle).collect();
        let sharpest = angles[END_STATIONS..angles.len() - END_STATIONS].iter().copied().fold(0.0, f64::max);
        let ends = slices.axis.at(length_um).0 - slices.axis.at(0.0).0;
        Self {
            total_deg: angles.iter().sum::<f64>().to_degrees(),
            max_curvature_per_mm: 1e3 * sharpest / (length_um / STATIONS as f64),
            end_to_end_share: ends.norm() / length_um,
        }
    }
}
