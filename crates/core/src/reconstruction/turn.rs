//! A turn of one camera: profiles and angles in, calibrated and measured.

use super::calibrated::{Calibrated, Judged, NotCalibrated, given};
use super::finned::Finned;
use super::refined::Refined;
use super::{HullModel, LiveVolume, Model, ReconstructionError, ReconstructionSettings, Silhouette};
use crate::calibration::{Calibration, GivenView, Pose, PoseOffset, Psi, TurnView, hull_sd_share, pose_offset, reprojected_areas};
use crate::carver::{Leaves, Observed};
use crate::fins::Fin;
use crate::geometry::{Camera, Projection, VoxelGrid};
use crate::measure::support::{Sections, SensitivityError, SupportEstimate, calibration_sd, given_sd};
use crate::measure::{Estimator, Fallback, Measurement, SphereFit, Spread};
use crate::profile::{Columns, FinBorders, Mask, Polygon};
use crate::quality::OFF_BORE_PX;
use crate::surface::{self, Coarse, Mesh};
use std::borrow::Cow;

/// A view as it was observed. Its mask is in the carver.
#[derive(Debug, Clone)]
pub(super) struct ObservedView {
    pub columns: Columns,
    /// The edges without fins. `None` where they are not known apart.
    pub body: Option<Columns>,
    /// Where borders of fins may be. `None` where only outlines are known.
    pub borders: Option<FinBorders>,
    pub outlines: Vec<Polygon>,
    pub omega: f64,
    /// The mask, where it is not that of the carver.
    pub mask: Option<Mask>,
}

impl ObservedView {
    /// Its mask. `carved` is the view in the carver.
    pub fn mask(&self, carved: &Observed) -> Cow<'_, Mask> {
        self.mask.as_ref().map_or_else(|| Cow::Owned(carved.runs.mask()), Cow::Borrowed)
    }
}

/// A measured turn.
#[derive(Debug, Clone)]
pub struct TurnModel {
    /// The surfaces and their numbers.
    pub model: Model,
    /// Why the voxels are trusted. `None` where the support functions are.
    pub fallback: Option<Fallback>,
    /// The hull that is measured: carved again with the calibration.
    pub hull: HullModel,
    /// The turn's own pose of camera and views, or the reason why there is none.
    pub calibration: Result<Judged, NotCalibrated>,
    /// The projection of each observed view, in the order of observing.
    pub projections: Vec<Projection>,
    /// For each view in the order of observing: the projected area of the hull that no view misses and the area of the profile,
    /// um^2 at the axis. `None` for a view that does not count, and without a calibration.
    pub reprojected_areas: Vec<Option<[f64; 2]>>,
    /// Pose of the specimen in the closure view minus that in the view at 0 deg. `None` without a closure view or a
    /// calibration.
    pub closure: Option<PoseOffset>,
    /// The free edges of the fins that the views agree on, a point per eight slices.
    pub fins: Vec<Fin>,
    /// The ends of the specimen along the axis, um, by its silhouettes. `None` where no view shows it, where it moved,
    /// and of a bead.
    pub ends_um: Option<[f64; 2]>,
}

/// The view at 360 deg, which is never carved.
#[derive(Debug, Clone)]
struct ClosureView {
    columns: Columns,
    /// Index of the view at 0 deg in the order of observing.
    first: usize,
}

/// An end counts that one in so many views shows, and at least two of four or more: one may show dust beside it.
const VIEWS_OF_AN_END: usize = 21;

/// The ends of the specimen along the axis, um. The tail ends in a fin that only the views across it show to its tip, so the views that show most
/// count, and not what all agree on.
fn ends_um(pose: &Pose, views: &[TurnView]) -> Option<[f64; 2]> {
    let (mut lefts, mut rights): (Vec<usize>, Vec<usize>) = views.iter().filter_map(|view| view.columns.extent()).unzip();
    lefts.sort_unstable();
    rights.sort_unstable_by(|a, b| b.cmp(a));
    let at = if lefts.len() < 4 { 0 } else { (lefts.len() / VIEWS_OF_AN_END).max(1) };
    let (left, right) = (lefts.get(at)?, rights.get(at)?);
    // A column shows half a px to either side of its middle.
    Some([pose.slice(*left as f64 - 0.5), pose.slice(*right as f64 + 0.5)])
}

/// How well the pose of the turn is known.
enum Known {
    /// Standard deviations of volume (um^3) and area (um^2) by the covariance of the calibration.
    Calibrated(Result<[f64; 2], SensitivityError>),
    /// Those by the priors of the rig, and what these change of the hull that no view misses, as a share.
    AsGiven { sd: Result<[f64; 2], SensitivityError>, hull_share: f64 },
}

/// Standard deviation of the axis of the given camera, px: half the distance from the middle of the bore at which a turn is refused.
const AXIS_SD_PX: f64 = OFF_BORE_PX / 2.0;
/// Standard deviation of the free edge of a fin, px: two renderers' fins lie within this of where they are found.
const FINS_SD_PX: f64 = 0.5;
/// Length over the width of the thickest slice from which on a specimen may have fins. Larvae have 6 and more.
const FINNED: f64 = 5.0;
/// Largest share of the volume that the fins of an emulated larva add to its ideal hull. Without pectoral fins it is 2 %.
const UNSEEN: f64 = 0.05;
/// The fins of a larva, one above and one below, are together at least this share of its length.
const FINS_SHARE_LEAST: f64 = 0.5;
/// Fins are thin, so their errors change the area more than the volume. Standard deviation of the area of a specimen that may have fins, as a
/// share of it: where many views show all fins, ...
const FINNED_AREA_SD: f64 = 0.012;
/// ... what a single view would add, which falls with the number of views, ...
const FINNED_AREA_SD_OF_A_VIEW: f64 = 0.18;
/// ... and where the fins that were found are too short. It is half of what the fins of an emulated larva add.
const UNSEEN_AREA_SD: f64 = 0.045;

/// Largest share of the volume beyond a hole in the slices.
const CUT_MOST: f64 = 0.005;

/// A hull that allows misses contains its specimen. One that is smaller than this share has slices that are hollow, which no
/// single view shows.
pub(super) const HULL_LEAST: f64 = 0.95;

/// A model of the views of one camera at known angles.
///
/// ```
/// use carved_core::carver::Leaves;
/// use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
/// use carved_core::profile::Mask;
/// use carved_core::reconstruction::{Reconstruction, ReconstructionSettings};
///
/// // A ball of 200 um radius on the axis looks the same from everywhere: a disc of 20 px at 10 um per px.
/// let (f, k) = (60_000.0, 0.1);
/// let phi = std::f64::consts::FRAC_PI_2;
/// let camera = Camera { f, kx: k, ky: k, ux: 32.0, uy: 32.0, s: 0.0, alpha: 0.0, gamma: 0.0, phi, width: 65, height: 65, glass: None };
/// let mut disc = Mask::empty(65, 65);
/// for (u, v) in (0..65).flat_map(|u| (0..65).map(move |v| (u, v))) {
///     disc.set(u, v, (u as f64 - 32.0).hypot(v as f64 - 32.0) <= 20.0);
/// }
/// let grid = VoxelGrid::new(BoxUm { min: [-300.0; 3], max: [300.0; 3] }, 10.0)?;
/// let mut model = Reconstruction::new(&camera, grid, 12, ReconstructionSettings::default())?;
/// for view in 0..12 {
///     model.observe(&disc, &[], std::f64::consts::TAU * f64::from(view) / 12.0, Leaves::default())?;
/// }
/// let ball_um3 = 4.0 / 3.0 * std::f64::consts::PI * 200.0f64.powi(3);
/// let measured = model.finish(true)?.model.measurement;
/// // Whole pixels of a 40 px disc are some 2 % more or less; the paper's carver adds what 12 directions leave, 2.35 %.
/// assert!((measured.volume_um3 / ball_um3 - 1.0).abs() < 0.03, "{}", measured.volume_um3);
/// assert!((measured.estimators.voxel.volume_um3 / ball_um3 - 1.0).abs() < 0.06);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Reconstruction {
    pub(super) camera: Camera,
    pub(super) settings: ReconstructionSettings,
    /// Carved through the given camera while the views arrive.
    pub(super) hull: HullModel,
    pub(super) observed: Vec<ObservedView>,
    /// The refined model that is shown instead once the views have given a better camera, and the number of views at the last
    /// attempt.
    pub(super) refined: Option<Refined>,
    pub(super) refined_at: usize,
    closure: Option<ClosureView>,
}

impl Reconstruction {
    /// An empty model of one camera.
    ///
    /// # Errors
    ///
    /// A camera, a plan or settings from which no model can be made.
    pub fn new(
        camera: &Camera,
        grid: VoxelGrid,
        planned_views: usize,
        settings: ReconstructionSettings,
    ) -> Result<Self, ReconstructionError> {
        camera.check()?;
        let hull = HullModel::new(grid, planned_views, settings)?;
        Ok(Self { camera: camera.clone(), settings, hull, observed: Vec::new(), refined: None, refined_at: 0, closure: None })
    }

    /// Observes the view at angle `omega` (rad). `outlines` are those that the mask was filled from, if there are any.
    ///
    /// # Errors
    ///
    /// A mask that does not have the size of the sensor, and whatever the carver refuses. The model is then unchanged.
    pub fn observe(&mut self, mask: &Mask, outlines: &[Polygon], omega: f64, leaves: Leaves) -> Result<LiveVolume, ReconstructionError> {
        self.observe_edges(mask, outlines, columns_of(mask, outlines), omega, leaves)
    }

    /// The same with the outlines of the body alone, so that fins can be separated from it, and with what the frame shows of borders
    /// that may be those of fins.
    ///
    /// # Errors
    ///
    /// As [`Self::observe`].
    pub fn observe_outlines(
        &mut self,
        mask: &Mask,
        outlines: &[Polygon],
        body: &[Polygon],
        borders: Option<&FinBorders>,
        omega: f64,
        leaves: Leaves,
    ) -> Result<LiveVolume, ReconstructionError> {
        let columns = columns_of(mask, outlines);
        let body = Some(if body == outlines { columns.clone() } else { Columns::from_outlines(body, mask.width(), mask.height()) });
        let outlines = outlines.to_vec();
        self.observe_view(mask, ObservedView { columns, body, borders: borders.cloned(), outlines, omega, mask: None }, leaves)
    }

    /// Observes the view at 360 deg, which is compared with the view that was observed as number `first`.
    pub fn observe_closure(&mut self, mask: &Mask, outlines: &[Polygon], first: usize) {
        self.closure = Some(ClosureView { columns: columns_of(mask, outlines), first });
    }

    /// Removes the view that was observed as number `at`; the numbers of later ones decrease by one.
    ///
    /// # Errors
    ///
    /// As [`Self::observe`]. The model is then unchanged.
    pub fn take_back(&mut self, at: usize) -> Result<(), ReconstructionError> {
        let carver = self.hull.carver();
        let mut hull = HullModel::new(*carver.grid(), carver.planned_views(), self.settings)?;
        for (_, (seen, view)) in self.observed.iter().zip(carver.views()).enumerate().filter(|(i, _)| *i != at) {
            hull.observe(&view.runs.mask(), &seen.outlines, &self.camera.projection(seen.omega), view.leaves)?;
        }
        self.hull = hull;
        if at < self.observed.len() {
            self.observed.remove(at);
        }
        // Both contained the view.
        (self.refined, self.refined_at, self.closure) = (None, 0, None);
        Ok(())
    }

    /// Whether the specimen continues beyond the image on the left and on the right in any of these views.
    pub(super) fn open(&self, views: &(impl Iterator<Item = usize> + Clone)) -> [bool; 2] {
        let leaves = |side: fn(&Leaves) -> bool| views.clone().any(|i| side(&self.hull.carver().views()[i].leaves));
        [leaves(|l| l.left), leaves(|l| l.right)]
    }

    /// The same with edges that do not come from mask and outlines.
    ///
    /// # Errors
    ///
    /// As [`Self::observe`].
    pub fn observe_edges(
        &mut self,
        mask: &Mask,
        outlines: &[Polygon],
        columns: Columns,
        omega: f64,
        leaves: Leaves,
    ) -> Result<LiveVolume, ReconstructionError> {
        self.observe_view(mask, ObservedView { columns, body: None, borders: None, outlines: outlines.to_vec(), omega, mask: None }, leaves)
    }

    fn observe_view(&mut self, mask: &Mask, view: ObservedView, leaves: Leaves) -> Result<LiveVolume, ReconstructionError> {
        let omega = view.omega;
        let Camera { width, height, .. } = self.camera;
        if (mask.width(), mask.height()) != (width as usize, height as usize) {
            return Err(ReconstructionError::MaskSize {
                width: mask.width(),
                height: mask.height(),
                sensor_width: width,
                sensor_height: height,
            });
        }
        if !omega.is_finite() {
            return Err(ReconstructionError::Omega { found: omega });
        }
        self.hull.observe(mask, &view.outlines, &self.camera.projection(omega), leaves)?;
        self.observed.push(view);
        if let Some(refined) = &mut self.refined {
            refined.observe(mask, omega, leaves)?;
        }
        Ok(self.live())
    }

    /// Carves all views so far again with the tolerance of another plan.
    ///
    /// # Errors
    ///
    /// As [`HullModel::replan`].
    pub fn replan(&mut self, planned_views: usize) -> Result<(), ReconstructionError> {
        self.hull.replan(planned_views)?;
        // It was carved by the old plan. The next refinement uses the new one.
        self.refined = None;
        Ok(())
    }

    /// The hull through the given camera.
    pub fn hull(&self) -> &HullModel {
        &self.hull
    }

    /// The surface of the hull on a lattice four times as coarse as the grid: small and quick, for display.
    pub fn live_mesh(&self) -> Mesh {
        surface::extract(&Coarse::new(self.live_carver()))
    }

    /// Calibrates, carves again with the result, and measures. `sphere` fits a sphere, for beads.
    ///
    /// # Errors
    ///
    /// As [`HullModel::finish`].
    pub fn finish(&self, sphere: bool) -> Result<TurnModel, ReconstructionError> {
        self.measure(&self.finned(self.calibrate(), sphere), None, sphere)
    }

    /// Carves again with a calibration on all views, and measures. `middle_v` is the row of the middle of the bore, px, where the walls
    /// are known: without a calibration it shows how far the axis of the given camera may be off.
    ///
    /// # Errors
    ///
    /// As [`HullModel::finish`].
    pub fn measure(&self, finned: &Finned, middle_v: Option<f64>, sphere: bool) -> Result<TurnModel, ReconstructionError> {
        let Finned { views: observed, fins, calibrated } = finned;
        let used = calibrated.used(self);
        let Calibrated { order, found } = calibrated;
        let given = given(observed, order);
        let mut projections: Vec<Projection> = observed.iter().map(|s| self.camera.projection(s.omega)).collect();
        if let Ok(Judged { calibration: c, .. }) = found {
            for (at, &i) in order.iter().enumerate() {
                projections[i] = c.projection(at, observed[i].omega);
            }
        }
        let hull = self.carved_again(observed, &used)?;
        let mut model = hull.finish(sphere)?;
        let open = self.open(&used.iter().map(|&(i, _)| i));
        let (pose, views, sd_um) = match found {
            Ok(Judged { calibration: c, .. }) => (Pose::new(&c.camera), c.turn_views(&given), c.residual_sd_um),
            Err(_) => (
                Pose::new(&self.camera),
                given.iter().map(|v| TurnView { columns: v.columns, omega: v.omega, dy_px: 0.0 }).collect(),
                // The scatter of the edges is not known: one px is assumed.
                1.0 / self.camera.ky,
            ),
        };
        let mut closure = None;
        let fallback = match Sections::with_fins(&pose, &views, sd_um, open, fins) {
            Ok(sections) => {
                closure = self.closure.as_ref().and_then(|closure| {
                    let at = used.iter().position(|(i, _)| *i == closure.first)?;
                    // The closure view is compared with view 0 as it was found: only one of them would have the fins of all views.
                    let first = TurnView { columns: &self.observed[closure.first].columns, ..views[at] };
                    closed(&pose, &sections, &first, &closure.columns)
                });
                let known = match found {
                    Ok(judged) => Known::Calibrated(calibration_sd(&judged.calibration, &given)),
                    Err(_) => self.known_as_given(&pose, &views, sd_um, middle_v),
                };
                let fitted = sphere.then(|| sections.sphere()).flatten();
                self.trust(&mut model.measurement, &sections, known, fitted)
            }
            Err(why) => Some(why.into()),
        };
        model.measurement.fallback = fallback.as_ref().map(Fallback::to_string);
        // The ends of a specimen that moved along the capillary are those of two places. The surface of a bead has its ends between columns.
        let has_moved = found.as_ref().is_ok_and(|judged| judged.calibration.moved.is_some());
        let ends_um = ends_um(&pose, &views).filter(|_| !has_moved && !sphere);
        if let Some([left, right]) = ends_um {
            model.measurement.length_um = right - left;
        }
        let mut again = vec![None; observed.len()];
        if let Ok(Judged { calibration: c, .. }) = found {
            for (&(i, _), areas) in used.iter().zip(again_of(c, &given)) {
                again[i] = Some(areas);
            }
        }
        // Back to the order of observing.
        let calibration = found.clone().map(|mut judged| {
            let by_angle = judged.calibration.views.clone();
            order.iter().zip(by_angle).for_each(|(&i, state)| judged.calibration.views[i] = state);
            judged
        });
        Ok(TurnModel {
            model,
            fallback,
            hull,
            calibration,
            projections,
            reprojected_areas: again,
            closure,
            fins: fins.fins.iter().map(Fin::recorded).collect(),
            ends_um,
        })
    }

    /// The hull of some of the views through these projections. The tolerance is a share of the views that count.
    fn carved_again(&self, observed: &[ObservedView], used: &[(usize, Projection)]) -> Result<HullModel, ReconstructionError> {
        let carver = self.hull.carver();
        if used.is_empty() {
            return Err(ReconstructionError::NoViews { observed: 0, planned: carver.planned_views() });
        }
        let mut hull = HullModel::new(*carver.grid(), used.len(), self.settings)?;
        let views = used.iter().map(|(i, projection)| {
            let (view, seen) = (&carver.views()[*i], &observed[*i]);
            Silhouette { mask: seen.mask(view), outlines: &seen.outlines, projection: *projection, leaves: view.leaves }
        });
        hull.observe_all(&views.collect::<Vec<_>>())?;
        Ok(hull)
    }

    /// What the priors of the rig make of the numbers of a turn without a calibration. The axis of the given camera is known to the room
    /// that an accepted turn leaves it, and is off by as much as the bore shows.
    fn known_as_given(&self, pose: &Pose, views: &[TurnView], sd_um: f64, middle_v: Option<f64>) -> Known {
        let priors = self.settings.calibration.priors();
        let uy_px = AXIS_SD_PX.hypot(middle_v.map_or(0.0, |middle_v| self.camera.uy - middle_v));
        let sd = [uy_px, priors.gamma_rad, priors.alpha_rad, priors.rho];
        Known::AsGiven { sd: given_sd(pose.camera(), views, sd_um, sd), hull_share: hull_sd_share(pose.camera(), views, sd) }
    }

    /// Adds the numbers of the support functions to those of the voxels and selects the ones to be trusted. Returns why the voxels are
    /// trusted.
    fn trust(&self, m: &mut Measurement, sections: &Sections, known: Known, sphere: Option<SphereFit>) -> Option<Fallback> {
        let support = SupportEstimate::of(sections);
        let voxel = m.estimators.voxel.volume_um3;
        let (is_calibrated, mut calibration, hull_share) = match known {
            Known::Calibrated(sd) => (true, sd, 0.0),
            Known::AsGiven { sd, hull_share } => (false, sd, hull_share),
        };
        // Where a view shows a slice hollow, filling it makes the volume too large, and so does the tolerance of the voxels: the
        // smaller one is nearer. The free tips of pectoral fins are hollow slices that add little.
        let fallback = if support.is_hollow() && voxel < support.volume_um3 {
            Some(Fallback::Hollow { percent: 100.0 * support.hollow_share })
        } else if sections.cut_share > CUT_MOST {
            Some(Fallback::Cut { percent: 100.0 * sections.cut_share })
        } else if support.is_all_error() {
            Some(Fallback::AllError { percent: 100.0 * support.volume_bias_um3 / support.volume_um3 })
        } else if is_calibrated && voxel < HULL_LEAST * support.volume_um3 {
            Some(Fallback::SmallHull { percent: 100.0 * (1.0 - voxel / support.volume_um3) })
        } else {
            calibration.as_ref().err().cloned().map(Fallback::from)
        };
        m.estimator = if fallback.is_some() { Estimator::Voxel } else { Estimator::Support };
        if m.estimator == Estimator::Support {
            (m.volume_um3, m.area_um2) = (support.volume_um3, support.area_um2);
            if let Some(sphere) = sphere {
                (m.diameter_um, m.sphere_rms_um) = (Some(sphere.diameter_um), Some(sphere.rms_um));
                m.aspect_ratio = Some(support.length_um / (2.0 * (support.mean_radius_um)));
            }
        }
        // A wrong axis takes more off voxels than off the slices' outlines. Area grows with the power 2/3 of volume.
        if let (Ok(part), Estimator::Voxel) = (&mut calibration, m.estimator) {
            part[0] = part[0].max(hull_share * m.volume_um3);
            part[1] = part[1].max(2.0 / 3.0 * hull_share * m.area_um2);
        }
        m.spread = calibration.ok().map(|part| self.spread(sections, &support, [m.volume_um3, m.area_um2], part));
        (m.volume_sd_um3, m.area_sd_um2) = m.spread.map(|spread| (spread.volume_um3(), spread.area_um2())).unzip();
        m.estimators.support = Some(support);
        fallback
    }

    /// Standard deviations of volume and area: views, calibration, corners and fins, which differ between turns, and the rig's scale
    /// and edges, which do not.
    pub(super) fn spread(
        &self,
        sections: &Sections,
        support: &SupportEstimate,
        [volume_um3, area_um2]: [f64; 2],
        calibration: [f64; 2],
    ) -> Spread {
        let settings = &self.settings.calibration;
        let scale = settings.scale_sd_percent / 100.0;
        let edge_um = settings.edge_sd_px / self.camera.ky;
        let [volume_calibration_um3, area_calibration_um2] = calibration;
        let [volume_fins_um3, area_fins_um2] = sections.with_fins_further_out(FINS_SD_PX / self.camera.ky);
        // Silhouettes that are given show what there is.
        let is_segmented = self.observed.iter().any(|view| view.body.is_some());
        let may_have_fins = is_segmented && support.length_um > FINNED * 2.0 * support.mean_radius_um;
        let are_missed = sections.fins_share() < FINS_SHARE_LEAST;
        // It must not shrink where views are too few for fins to be found, or even to be looked for.
        let area_finned_um2 = if may_have_fins {
            let missed = if are_missed { UNSEEN_AREA_SD } else { 0.0 };
            FINNED_AREA_SD.hypot(FINNED_AREA_SD_OF_A_VIEW / sections.views() as f64).hypot(missed) * area_um2
        } else {
            0.0
        };
        Spread {
            volume_views_um3: support.volume_sd_um3,
            area_views_um2: support.area_sd_um2,
            volume_calibration_um3,
            area_calibration_um2,
            volume_corners_um3: sections.left_out_um3(),
            area_corners_um2: sections.left_out_um2(),
            volume_fins_um3,
            area_fins_um2: area_fins_um2.hypot(area_finned_um2),
            volume_fins_unseen_um3: if may_have_fins && sections.are_searched && are_missed { UNSEEN * volume_um3 } else { 0.0 },
            volume_scale_um3: 3.0 * scale * volume_um3,
            area_scale_um2: 2.0 * scale * area_um2,
            volume_edge_um3: edge_um * area_um2,
            // The perimeter of each slice grows by 2 pi times the shift.
            area_edge_um2: edge_um * std::f64::consts::TAU * support.length_um,
        }
    }
}

fn columns_of(mask: &Mask, outlines: &[Polygon]) -> Columns {
    if outlines.is_empty() { Columns::from_mask(mask) } else { Columns::from_outlines(outlines, mask.width(), mask.height()) }
}

/// For each view that counts, the projected area of the hull that no view misses and that of its profile, um^2.
fn again_of(found: &Calibration, given: &[GivenView]) -> Vec<[f64; 2]> {
    let ledger: Vec<f64> = given.iter().map(|v| v.omega).collect();
    let columns: Vec<&Columns> = found.turn_views(given).iter().map(|v| v.columns).collect();
    reprojected_areas(&columns, &Psi::of(found, &ledger))
}

/// Pose of the specimen in the closure view minus that in view 0.
fn closed(pose: &Pose, sections: &Sections, first: &TurnView, columns: &Columns) -> Option<PoseOffset> {
    pose_offset(pose, first, &TurnView { columns, ..*first }, sections.slices.iter().map(|s| (s.x_um, s.outline())))
}
