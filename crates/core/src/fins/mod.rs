//! Fins from all views at once: the free edge of a fin is one curve in space, which every view that shows it must pass through.
//!
//! ```text
//!   slice across the capillary:        body B(theta) by the edges without fins       h
//!        ___                           ( __p                                         |      found edges of a fin: h = p . n(theta)
//!       (___)--- p                     one point p per slice and fin                 |  __/\__   one cosine, wherever it stands out
//!   edges ── points per slice ── chained along the capillary ── smoothed ── Fin ── projected into every view ── amended edges
//! ```
//! A single view misses the border of a fin that only just emerges from behind the body, and invents one at a speck. The other
//! views show both errors: a fin has one free edge that all views share, and a speck has none.
//!
//! ```text
//!   responses of each view (FinBorders) ── pooled at each point of a slice ── followed along the capillary ── accepted ── Fin
//! ```
//! A fin that no single view shows is found in the same way, from the responses of all views at the points where its free edge may be.
//! `faint` leads that search. It keeps the fins of the edges, and needs the responses of every view.

mod amend;
mod body;
mod chain;
mod extend;
mod faint;
mod follow;
mod points;
mod pool;
mod taper;

use crate::calibration::{Pose, Side, Support, TurnView, directions};
use crate::geometry::Projection;
use crate::parallel::prelude::*;
use crate::profile::{Columns, FinBorders};
use body::{Known, bodies};
use points::Point;
use serde::{Deserialize, Serialize};

/// The free edge of a fin as it was found by the views together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Fin {
    /// Its points, um in the frame of the turn: x along the capillary, y and z across. One point per slice, from left to right.
    pub points_um: Vec<[f64; 3]>,
    /// Number of edges that a point rests on, in the median of the slices: those that stand out there in single views, or those that were
    /// pooled for a fin too faint for these.
    pub edges: usize,
}

/// Every so many slices a fin has a point in a record.
const RECORDED: usize = 8;

impl Fin {
    /// The same with every eighth point and the last one, as it is stored.
    pub(crate) fn recorded(&self) -> Self {
        let last = self.points_um.len().saturating_sub(1);
        let points = self.points_um.iter().enumerate().filter(|(i, _)| i % RECORDED == 0 || *i == last);
        Self { points_um: points.map(|(_, p)| *p).collect(), edges: self.edges }
    }

    /// Its points in a view, px to a tenth.
    pub(crate) fn seen(&self, projection: &Projection) -> Vec<[f64; 2]> {
        let tenth = |px: f64| (10.0 * px).round() / 10.0;
        self.points_um.iter().filter_map(|&p| projection.project(p)).map(|(u, v)| [tenth(u), tenth(v)]).collect()
    }
}

/// A view with what its frame shows of the body alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FinView<'a> {
    /// Edges with fins, and the pose.
    pub turn: TurnView<'a>,
    /// Edges without fins. `None` where only those with fins are known.
    pub body: Option<&'a Columns>,
    /// Where borders of fins may be. `None` where only outlines are known.
    pub borders: Option<&'a FinBorders>,
    /// The calibrated projection.
    pub projection: Projection,
}

/// One edge of one view in one slice, as a tangent. Distances are from the capillary's axis, um.
#[derive(Debug, Clone, Copy)]
struct Edge {
    theta: f64,
    found_um: f64,
    /// Of the body alone. `None` where the view shows none there.
    body_um: Option<f64>,
}

/// The edges of a slice.
#[derive(Debug, Clone)]
struct Slice {
    x_um: f64,
    edges: Vec<Edge>,
}

/// Fins with the body that they stand out of.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct SharedFins {
    pub fins: Vec<Fin>,
    /// The slices, from left to right.
    slices: Vec<FinSlice>,
}

/// A slice: its body and the points of its fins.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FinSlice {
    x_um: f64,
    known: Known,
    body: Support,
    /// y and z, um.
    points_um: Vec<[f64; 2]>,
}

impl SharedFins {
    /// The fins in the slice at `x_um`. `None` where there are none.
    pub fn in_slice(&self, x_um: f64) -> Option<&FinSlice> {
        Some(self.slice(x_um)?).filter(|slice| !slice.points_um.is_empty())
    }

    /// Whether fins were looked for: some slice shows a body.
    pub fn is_searched(&self) -> bool {
        !self.slices.is_empty()
    }

    /// The slice nearest to `x_um`.
    fn slice(&self, x_um: f64) -> Option<&FinSlice> {
        let after = self.slices.partition_point(|slice| slice.x_um < x_um);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.slices.get(at));
        near.min_by(|a, b| (a.x_um - x_um).abs().total_cmp(&(b.x_um - x_um).abs()))
    }
}

impl FinSlice {
    /// Number of fins.
    pub fn fins(&self) -> usize {
        self.points_um.len()
    }

    /// How far the fins stand out of the body in direction `theta`, um: what they add to its support function.
    pub fn at(&self, theta: f64) -> f64 {
        let (sin, cos) = theta.sin_cos();
        let reach = self.points_um.iter().map(|[y, z]| y * cos + z * sin).fold(f64::NEG_INFINITY, f64::max);
        (reach - self.body.at(theta)[0]).max(0.0)
    }

    /// The same with the points of the fins further from the body's centre.
    pub fn further_out(&self, by_um: f64) -> Self {
        let [y, z] = centre(&self.body);
        let moved = |p: &[f64; 2]| {
            let (dy, dz) = (p[0] - y, p[1] - z);
            let part = by_um / dy.hypot(dz).max(by_um);
            [p[0] + part * dy, p[1] + part * dz]
        };
        Self { points_um: self.points_um.iter().map(moved).collect(), ..self.clone() }
    }
}

/// Centre of an outline: y and z, um.
fn centre(outline: &Support) -> [f64; 2] {
    [outline.coefficients[1], outline.coefficients[2]]
}

/// An edge within this distance of a fin is that fin's, px.
const SAME_PX: f64 = 2.5;
/// Least share of the edges of a slice that must show a body, where bodies are known apart.
const SHARE_LEAST: f64 = 0.6;
/// How far beyond the ends that single views show fins are searched, px. The fin around the tail is the faintest, and its tip is further
/// from the body than that of any other: 10 to 30 px in emulated larvae.
const BEYOND_PX: usize = 48;
/// Where the edges of the body are not known apart, those of fins are taken out of them this many times.
const ROUNDS: usize = 4;

/// Finds the fins that these views agree on.
pub(crate) fn find(pose: &Pose, views: &[FinView]) -> SharedFins {
    let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.turn.columns.extent()).collect();
    let Some((first, last)) = extents.iter().map(|e| e.0).min().zip(extents.iter().map(|e| e.1).max()) else {
        return SharedFins::default();
    };
    let width = views.iter().map(|v| v.turn.columns.width()).max().unwrap_or(0);
    let (first, last) = (first.saturating_sub(BEYOND_PX), (last + BEYOND_PX).min(width.saturating_sub(1)));
    let px_um = 1.0 / pose.camera().ky;
    let widest = points::widest_gap(directions(&views.iter().map(|v| v.turn.omega).collect::<Vec<_>>()));
    let mut slices: Vec<Slice> = (first..=last).into_par_iter().map(|u| Slice::of(pose.slice(u as f64), pose, views)).collect();
    let knows_bodies = views.iter().all(|view| view.body.is_some());
    let needed = if knows_bodies { (SHARE_LEAST * 2.0 * views.len() as f64).ceil() as usize } else { 0 };
    let (mut round, rounds) = (0, if knows_bodies { 0 } else { ROUNDS });
    let (bodies, points) = loop {
        let Some(bodies) = bodies(&slices, needed, px_um) else { return SharedFins::default() };
        let of = |(slice, (known, body)): (&Slice, &(Known, Support))| match known {
            Known::Nothing => Vec::new(),
            Known::Body | Known::NoBody => points::of(slice, body, widest, px_um),
        };
        let points: Vec<_> = slices.par_iter().zip(&bodies).map(of).collect();
        round += 1;
        if round > rounds {
            break (bodies, points);
        }
        slices.par_iter_mut().zip(&points).for_each(|(slice, points)| slice.without(points, px_um));
    };
    let fins = chain::chained(&slices, &points, px_um);
    let mut slices: Vec<FinSlice> = slices
        .iter()
        .zip(bodies)
        .map(|(&Slice { x_um, .. }, (known, body))| FinSlice { x_um, known, body, points_um: Vec::new() })
        .collect();
    let fins = faint::find(views, &slices, fins, px_um);
    for slice in &mut slices {
        let near = |fin: &Fin| fin.points_um.iter().find(|p| (p[0] - slice.x_um).abs() < 1e-6).map(|p| [p[1], p[2]]);
        slice.points_um = fins.iter().filter_map(near).collect();
    }
    SharedFins { fins, slices }
}

impl Slice {
    /// Takes edges that are those of fins out of the body's.
    fn without(&mut self, fins: &[Point], px_um: f64) {
        for edge in &mut self.edges {
            let (sin, cos) = edge.theta.sin_cos();
            let is_of = |fin: &Point| (fin.at_um[0] * cos + fin.at_um[1] * sin - edge.found_um).abs() < SAME_PX * px_um;
            edge.body_um = Some(edge.found_um).filter(|_| !fins.iter().any(is_of));
        }
    }

    fn of(x_um: f64, pose: &Pose, views: &[FinView]) -> Self {
        let mut edges = Vec::with_capacity(2 * views.len());
        for view in views {
            for side in Side::BOTH {
                if let Some(tangent) = pose.tangent(x_um, &view.turn, side, None) {
                    let body_um = view.body.map_or(Some(tangent.offset_um), |columns| {
                        let alone = TurnView { columns, ..view.turn };
                        pose.tangent(x_um, &alone, side, None).map(|t| t.offset_um)
                    });
                    edges.push(Edge { theta: tangent.theta, found_um: tangent.offset_um, body_um });
                }
            }
        }
        Self { x_um, edges }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;
    use crate::measure::support::{Sections, SupportEstimate};
    use crate::profile::{ColumnEdges, Polygon};
    use std::f64::consts::{PI, TAU};

    const WIDTH: usize = 200;
    const HEIGHT: usize = 160;
    const BODY_UM: f64 = 130.0;

    fn camera() -> Camera {
        Camera::published(WIDTH as u32, HEIGHT as u32)
    }

    /// The free edge of a fin between columns 40 and 160: it rises to 60 um above the body, in direction 0.4 rad.
    fn fin_um(x_um: f64) -> Option<[f64; 2]> {
        let part = (x_um * camera().kx + 60.0) / 120.0;
        let reach = BODY_UM + 60.0 * (PI * part).sin();
        (0.0..=1.0).contains(&part).then(|| [reach * 0.4f64.cos(), reach * 0.4f64.sin()])
    }

    /// Exact edges of a cylinder in the view at `omega` (rad), with what of its fin stands out by at least `seen_px`.
    fn edges(omega: f64, seen_px: Option<f64>) -> Columns {
        let camera = camera();
        let pose = Pose::new(&camera);
        let projection = camera.projection(omega);
        let body = Columns::from_coverage(WIDTH, HEIGHT, &vec![255; WIDTH * HEIGHT]);
        body.mapped(
            |_| None,
            |u, _| {
                let x_um = pose.slice(u as f64);
                let row = |side: Side| {
                    let theta = if side == Side::Upper { PI } else { 0.0 } - omega;
                    let (sin, cos) = theta.sin_cos();
                    let at = |h: f64| projection.project([x_um, h * cos, h * sin]).unwrap().1;
                    let body = at(BODY_UM);
                    let fin = seen_px.zip(fin_um(x_um)).map(|(px, [y, z])| (px, at(y * cos + z * sin)));
                    fin.filter(|(px, fin)| side.sign() * (fin - body) >= *px).map_or(body, |(_, fin)| fin)
                };
                ColumnEdges { upper: row(Side::Upper), lower: row(Side::Lower), gap: 0.0 }
            },
        )
    }

    /// The columns of all views: as found, without fins, and true.
    struct Turn {
        omegas: Vec<f64>,
        found: Vec<Columns>,
        body: Vec<Columns>,
        truth: Vec<Columns>,
    }

    impl Turn {
        fn new(views: u32) -> Self {
            let omegas: Vec<f64> = (0..views).map(|i| TAU * f64::from(i) / f64::from(views)).collect();
            let all = |seen_px: Option<f64>| omegas.iter().map(|&omega| edges(omega, seen_px)).collect();
            Self { found: all(Some(4.0)), body: all(None), truth: all(Some(0.0)), omegas }
        }

        fn view(&self, i: usize, knows_body: bool) -> FinView<'_> {
            let turn = TurnView { columns: &self.found[i], omega: self.omegas[i], dy_px: 0.0 };
            FinView { turn, body: knows_body.then_some(&self.body[i]), borders: None, projection: camera().projection(self.omegas[i]) }
        }

        fn find(&self, knows_body: bool) -> SharedFins {
            let views: Vec<FinView> = (0..self.omegas.len()).map(|i| self.view(i, knows_body)).collect();
            find(&Pose::new(&camera()), &views)
        }

        /// Largest distance of the amended edges from the true ones between two columns, px.
        fn worst_px(&self, found: &SharedFins, knows_body: bool, columns: std::ops::Range<usize>) -> f64 {
            let off = |i: usize| {
                let amended = found.amended(&self.view(i, knows_body));
                let truth = &self.truth[i];
                let (amended, columns) = (&amended, columns.clone());
                columns
                    .map(|u| {
                        let (a, b) = (amended.get(u).unwrap(), truth.get(u).unwrap());
                        (a.upper - b.upper).abs().max((a.lower - b.lower).abs())
                    })
                    .fold(0.0, f64::max)
            };
            (0..self.omegas.len()).map(off).fold(0.0, f64::max)
        }
    }

    #[test]
    fn views_that_miss_a_fin_get_it_from_the_others() {
        let turn = Turn::new(21);
        for knows_body in [true, false] {
            let found = turn.find(knows_body);
            assert_eq!(found.fins.len(), 1, "body known: {knows_body}");
            let unseen = turn.worst_px(&SharedFins::default(), knows_body, 70..130);
            let worst = turn.worst_px(&found, knows_body, 70..130);
            assert!(unseen > 3.0 && worst < 0.5, "body known: {knows_body}: {unseen} px before, {worst} px after");
        }
    }

    #[test]
    fn the_free_edge_is_where_it_is() {
        let found = Turn::new(12).find(true);
        let px_um = 1.0 / camera().ky;
        for &[x, y, z] in &found.fins[0].points_um {
            let [true_y, true_z] = fin_um(x).unwrap();
            assert!((y - true_y).hypot(z - true_z) < 0.5 * px_um, "at x = {x} um: {y}, {z} um for {true_y}, {true_z} um");
        }
    }

    /// A view of which the tail's fin shows nothing beyond column 100 gets it from the fins that all views share. One fin alone is no sheet.
    #[test]
    fn beyond_its_end_a_specimen_is_what_lies_between_its_fins() {
        let (camera, pose) = (camera(), Pose::new(&camera()));
        let body = Polygon { vertices: vec![[-0.5, 70.0], [99.5, 70.0], [99.5, 90.0], [-0.5, 90.0]] };
        let columns = Columns::from_outlines(&[body], WIDTH, HEIGHT);
        let fin = |y_um: f64| Fin { points_um: (80..140).map(|u| [pose.slice(f64::from(u)), y_um, 0.0]).collect(), edges: 20 };
        let slice = |u: usize| FinSlice {
            x_um: pose.slice(u as f64),
            known: if u < 100 { Known::Body } else { Known::NoBody },
            body: Support { coefficients: vec![30.0, 0.0, 0.0] },
            points_um: Vec::new(),
        };
        let with = |fins: Vec<Fin>| SharedFins { fins, slices: (0..WIDTH).map(slice).collect() };
        for omega in [0.0, 0.6, PI / 2.0] {
            let turn = TurnView { columns: &columns, omega, dy_px: 0.0 };
            let view = FinView { turn, body: Some(&columns), borders: None, projection: camera.projection(omega) };
            let seen = with(vec![fin(40.0), fin(-40.0)]).amended(&view);
            let between = seen.get(120).map(|e| e.lower - e.upper).unwrap();
            assert!((between - 80.0 * camera.ky * omega.cos()).abs() < 0.05, "{omega} rad: {between} px");
            assert_eq!((seen.get(160), with(vec![fin(40.0)]).amended(&view).get(120)), (None, None), "{omega} rad");
        }
    }

    /// What only one view shows is no fin: the edge there becomes that of the body.
    #[test]
    fn a_spur_of_one_view_is_dropped() {
        let mut turn = Turn::new(21);
        let spur = |columns: &Columns| {
            columns.mapped(|_| None, |u, own| if (10..30).contains(&u) { ColumnEdges { upper: own.upper - 9.0, ..own } } else { own })
        };
        turn.found[5] = spur(&turn.found[5]);
        for knows_body in [true, false] {
            let found = turn.find(knows_body);
            let worst = turn.worst_px(&found, knows_body, 5..35);
            assert!(worst < 0.5, "body known: {knows_body}: {worst} px");
        }
        // The body's own search may show the spur as well.
        turn.body[5] = spur(&turn.body[5]);
        let worst = turn.worst_px(&turn.find(true), true, 5..35);
        assert!(worst < 0.5, "spur in the body: {worst} px");
    }

    #[test]
    fn a_body_without_fins_has_none_and_keeps_its_edges() {
        let mut turn = Turn::new(21);
        turn.found.clone_from(&turn.body);
        let found = turn.find(true);
        assert_eq!(found.fins, []);
        assert_eq!(found.amended(&turn.view(3, true)), turn.body[3]);
    }
    /// Slices of 12 views have four harmonics, which cannot describe a fin. With the fins in closed form their area is exact.
    #[test]
    fn few_views_have_the_area_of_fins() {
        let turn = Turn::new(12);
        let found = turn.find(true);
        let pose = Pose::new(&camera());
        let amended: Vec<Columns> = (0..12).map(|i| found.amended(&turn.view(i, true))).collect();
        let views: Vec<TurnView> =
            amended.iter().zip(&turn.omegas).map(|(columns, &omega)| TurnView { columns, omega, dy_px: 0.0 }).collect();
        let estimate = |fins: &SharedFins| SupportEstimate::of(&Sections::with_fins(&pose, &views, 0.5, [true; 2], fins).unwrap());
        // Few views do not show the low ends of the fin.
        let (first_um, last_um) = (found.fins[0].points_um[0][0], found.fins[0].points_um.last().unwrap()[0]);
        let flank = |x_um: f64| {
            fin_um(x_um).filter(|_| (first_um..=last_um).contains(&x_um)).map_or(0.0, |[y, z]| {
                let reach = y.hypot(z);
                BODY_UM * ((reach * reach - BODY_UM * BODY_UM).max(0.0).sqrt() - BODY_UM * (BODY_UM / reach).min(1.0).acos())
            })
        };
        let step_um = 1.0 / camera().kx;
        let truth: f64 = (0..WIDTH).map(|u| PI * BODY_UM * BODY_UM + flank(pose.slice(u as f64))).sum::<f64>() * step_um;
        let cylinder = PI * BODY_UM * BODY_UM * step_um * WIDTH as f64;
        let off = |volume_um3: f64| 100.0 * (volume_um3 / truth * WIDTH as f64 / (WIDTH - 1) as f64 - 1.0);
        let (with, without) = (off(estimate(&found).volume_um3), off(estimate(&SharedFins::default()).volume_um3));
        assert!(
            with.abs() < 0.1 && without > 0.3,
            "{with} % with fins, {without} % without; the fin is {} %",
            100.0 * (truth / cylinder - 1.0)
        );
    }
}
