//! The volume that a set of views leaves when no view may miss it, slice by slice. The carver counts voxels for this; here the
//! slices are polygons.
//!
//! ```text
//!   slice x ── a strip per view, between its two edges ── cut: a polygon ─┬─ area: the volume left (VRV, eps = 0)
//!                                                                         └─ its width in each view, over the strip's: coherence
//! ```
//! The result is exact for profiles without gaps, up to the spread of the rays within a slice (they lean by less than a
//! hundredth). It has no voxel grain: a change of a thousandth of a px shows. Each edge is read in the column where it lies,
//! whatever the roll. How near to the camera the strip touches is not known; this is off by at most a px along the edge.

use super::psi::Psi;
use super::tangents::{Pose, Side};
use crate::geometry::Camera;
use crate::parallel::prelude::*;
use crate::profile::{ColumnEdges, Columns};

/// Number of slices.
const SLICES: usize = 160;
/// Slices per piece of parallel work: some 20 us. Smaller pieces are not worth a thread.
const SLICES_TOGETHER: usize = 20;
/// Half the side of the square that the strips are cut from, um. No capillary is wider.
const FAR_UM: f64 = 1e4;

/// A half plane of a slice: its outward normal, and the distance of its border from the axis.
#[derive(Debug, Clone, Copy)]
struct Edge {
    normal: [f64; 2],
    offset_um: f64,
}

impl Edge {
    fn beyond(&self, [y, z]: [f64; 2]) -> f64 {
        y * self.normal[0] + z * self.normal[1] - self.offset_um
    }
}

/// Slices at even steps over everything that any view shows.
#[derive(Debug, Clone)]
pub(super) struct HullSlices<'a> {
    columns: Vec<&'a Columns>,
    xs_um: Vec<f64>,
    thick_um: f64,
}

impl<'a> HullSlices<'a> {
    /// Slices over what `camera` sees of the profiles.
    pub fn new(columns: Vec<&'a Columns>, camera: &Camera) -> Self {
        let extents: Vec<(usize, usize)> = columns.iter().filter_map(|c| c.extent()).collect();
        let from = extents.iter().map(|e| e.0).min().unwrap_or(0);
        let to = extents.iter().map(|e| e.1).max().unwrap_or(from);
        let pose = Pose::new(camera);
        let step = (to - from) as f64 / SLICES as f64;
        let xs_um = (0..SLICES).map(|i| pose.slice(from as f64 + (i as f64 + 0.5) * step)).collect();
        let thick_um = (pose.slice(to as f64) - pose.slice(from as f64)).abs() / SLICES as f64;
        Self { columns, xs_um, thick_um }
    }

    /// Volume that all views leave.
    pub fn volume_um3(&self, psi: &Psi) -> f64 {
        self.of_each(psi, Cut::area_um2).iter().sum::<f64>() * self.thick_um
    }

    /// For each view the area of the hull projected back and the area of its profile, um^2 at the axis: widths summed over the
    /// slices. A view without a profile leaves nothing to the others.
    pub fn reprojected_areas(&self, psi: &Psi) -> Vec<[f64; 2]> {
        let slices = self.of_each(psi, Cut::widths);
        let of = |view: usize| slices.iter().fold([0.0; 2], |sum, slice| [sum[0] + slice[view][0], sum[1] + slice[view][1]]);
        (0..self.columns.len()).map(|view| of(view).map(|width_um| width_um * self.thick_um)).collect()
    }

    /// Mean over the views of the area of the hull over the area of the profile.
    pub fn coherence(&self, psi: &Psi) -> f64 {
        let overlap = |[hull, profile]: &[f64; 2]| if *profile > 0.0 { hull / profile } else { 0.0 };
        let seen = self.reprojected_areas(psi);
        seen.iter().map(overlap).sum::<f64>() / seen.len() as f64
    }

    /// The results are in the order of the slices, so that sums are the same on any number of threads.
    fn of_each<T: Send>(&self, psi: &Psi, read: impl Fn(&Cut) -> T + Sync) -> Vec<T> {
        let views = Views::new(&self.columns, psi);
        let of = |cut: &mut Cut, &x_um: &f64| {
            cut.make(&views, x_um);
            read(cut)
        };
        self.xs_um.par_iter().with_min_len(SLICES_TOGETHER).map_init(Cut::default, of).collect()
    }
}

/// The views of one psi.
struct Views<'a> {
    pose: Pose,
    /// Each with cosine and sine of its angle, and its shift in px.
    views: Vec<(&'a Columns, [f64; 2], f64)>,
}

impl<'a> Views<'a> {
    fn new(columns: &[&'a Columns], psi: &Psi) -> Self {
        let of = |((&columns, omega), &dy_px): ((&&'a Columns, &f64), &f64)| (columns, [omega.cos(), omega.sin()], dy_px);
        Self { pose: Pose::new(&psi.camera), views: columns.iter().zip(&psi.omega).zip(&psi.dy_px).map(of).collect() }
    }

    /// The strip of each view in a slice, where the view shows one.
    fn strips(&self, x_um: f64) -> impl Iterator<Item = Option<[Edge; 2]>> {
        let middle = self.pose.column(x_um, [0.0; 2]);
        self.views.iter().map(move |&(columns, [cos, sin], dy_px)| {
            let near = columns.at(middle)?;
            let edge = |side: Side| {
                let line = |edges: ColumnEdges| self.pose.line(x_um, side.of(edges) - dy_px);
                let own = self.pose.column(x_um, [line(near).offset, 0.0]);
                let (normal, offset_um) = self.pose.in_bore(&line(columns.at(own)?));
                let [y, z] = normal.map(|n| side.sign() * n);
                Some(Edge { normal: [y * cos + z * sin, z * cos - y * sin], offset_um: side.sign() * offset_um })
            };
            Some([edge(Side::Upper)?, edge(Side::Lower)?])
        })
    }
}

/// The strips of a slice and the convex polygon that they leave. Its memory is kept from slice to slice.
#[derive(Default)]
struct Cut {
    strips: Vec<Option<[Edge; 2]>>,
    polygon: Vec<[f64; 2]>,
    kept: Vec<[f64; 2]>,
}

impl Cut {
    fn make(&mut self, views: &Views, x_um: f64) {
        self.strips.clear();
        self.strips.extend(views.strips(x_um));
        self.polygon.clear();
        if self.strips.iter().any(Option::is_none) {
            return;
        }
        self.polygon.extend([[-FAR_UM, -FAR_UM], [FAR_UM, -FAR_UM], [FAR_UM, FAR_UM], [-FAR_UM, FAR_UM]]);
        for edge in self.strips.iter().flatten().flatten() {
            // Most edges of many views touch nothing that the others left.
            let farthest =
                self.polygon.iter().fold(f64::NEG_INFINITY, |most, &p| if edge.beyond(p) > most { edge.beyond(p) } else { most });
            if farthest > 0.0 {
                keep_inside(&self.polygon, edge, &mut self.kept);
                std::mem::swap(&mut self.polygon, &mut self.kept);
            }
        }
    }

    fn area_um2(&self) -> f64 {
        let next = self.polygon.iter().cycle().skip(1);
        self.polygon.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
    }

    /// Width of the polygon and of the strip in each view.
    fn widths(&self) -> Vec<[f64; 2]> {
        let reach = |edge: &Edge| self.polygon.iter().map(|&p| edge.beyond(p) + edge.offset_um).fold(f64::NEG_INFINITY, f64::max);
        let width = |strip: &Option<[Edge; 2]>| match strip {
            Some([a, b]) if !self.polygon.is_empty() => [reach(a) + reach(b), a.offset_um + b.offset_um],
            Some([a, b]) => [0.0, a.offset_um + b.offset_um],
            None => [0.0; 2],
        };
        self.strips.iter().map(width).collect()
    }
}

/// The part of a convex polygon that lies inside an edge.
fn keep_inside(polygon: &[[f64; 2]], edge: &Edge, kept: &mut Vec<[f64; 2]>) {
    kept.clear();
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        let (a, b) = (edge.beyond(*p), edge.beyond(*q));
        if a <= 0.0 {
            kept.push(*p);
        }
        if (a <= 0.0) != (b <= 0.0) {
            let share = a / (a - b);
            kept.push([p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// A cylinder of 300 um radius seen from far away, over columns 100 to 400.
    fn cylinder(views: u32) -> (Psi, Vec<Columns>) {
        let k = 0.2;
        let camera = Camera {
            f: 1e9,
            kx: k,
            ky: k,
            ux: 250.0,
            uy: 250.0,
            s: 0.0,
            alpha: 0.0,
            gamma: 0.0,
            phi: FRAC_PI_2,
            width: 500,
            height: 500,
            glass: None,
        };
        let corners = [[100.0, 190.0], [400.0, 190.0], [400.0, 310.0], [100.0, 310.0]];
        let outline = crate::profile::Polygon { vertices: corners.to_vec() };
        let columns = (0..views).map(|_| Columns::from_outlines(std::slice::from_ref(&outline), 500, 500)).collect();
        (Psi::new(camera, (0..views).map(|i| TAU * f64::from(i) / f64::from(views)).collect()), columns)
    }

    #[test]
    fn a_cylinder_leaves_the_polygon_around_it() {
        for views in [4u32, 21, 84] {
            let (psi, columns) = cylinder(views);
            let slices = HullSlices::new(columns.iter().collect(), &psi.camera);
            // Opposite views of an even number are one direction.
            let sides = f64::from(if views % 2 == 0 { views } else { 2 * views });
            let shown = columns[0].extent().map_or(0.0, |(from, to)| (to - from) as f64) / psi.camera.kx;
            let around = |sides: f64, radius_um: f64| sides * (PI / sides).tan() * radius_um * radius_um * shown;
            let (expected, found) = (around(sides, 300.0), slices.volume_um3(&psi));
            assert!((found / expected - 1.0).abs() < 1e-6, "{views} views: {found} for {expected}");
            assert!((slices.coherence(&psi) - 1.0).abs() < 1e-6);
            // 10 um beside the axis one edge of each strip is too far in; the other touches nothing any more.
            let mut off = psi.clone();
            off.camera.uy += 2.0;
            let (expected, left) = (around(f64::from(views), 290.0), slices.volume_um3(&off));
            assert!((left / expected - 1.0).abs() < 1e-6 && slices.coherence(&off) < 0.99, "{views} views: {left} for {expected}");
        }
    }

    #[test]
    fn a_view_that_shows_nothing_leaves_nothing() {
        let (psi, mut columns) = cylinder(7);
        columns[3] = Columns::from_outlines(&[], 500, 500);
        let slices = HullSlices::new(columns.iter().collect(), &psi.camera);
        assert!(slices.volume_um3(&psi) == 0.0 && slices.coherence(&psi) == 0.0);
    }
}
