//! Measures the three kinds of sets of silhouettes: a turn of one camera, views of any cameras, or an empty capillary.

use super::{Cameras, Psi, SilhouettesError, Step, View};
use crate::Stopped;
use carved_core::calibration::{Bad, Calibration, Moved, VIEWS_LEAST, VrvCheck, VrvVerdict, directions, widest_gap};
use carved_core::carver::Leaves;
use carved_core::fins::Fin;
use carved_core::flag::Flag;
use carved_core::geometry::{Camera, Projection, VoxelGrid};
use carved_core::measure::Measurement;
use carved_core::quality::{QualitySettings, TurnFinding, Turning, tell_little};
use carved_core::reconstruction::{HullModel, Model, NotCalibrated, Reconstruction, ReconstructionSettings, TurnModel};
use carved_core::statistics::mean;
use carved_core::surface::{self, Mesh};
use rayon::prelude::*;

/// The use of a view.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// Whether the view counts.
    pub used: bool,
    /// Why it does not count.
    pub reason: Option<String>,
    /// Shift of the silhouette down the image against the turn's camera, px. `None` without a calibration.
    pub dy_px: Option<f64>,
    /// Root mean square distance of its edges from those that the other views make expected, px. `None` without a calibration.
    pub residual_px: Option<f64>,
    /// Overlap of its mask with the image of the hull. `None` for a blank view.
    pub overlap: Option<f64>,
}

/// The result for a set.
#[derive(Debug)]
pub struct Measured {
    /// `None` for an empty capillary.
    pub measurement: Option<Measurement>,
    /// The surface. `None` for an empty capillary.
    pub mesh: Option<Mesh>,
    /// The voxels that were counted. `None` for an empty capillary.
    pub hull: Option<HullModel>,
    /// The free edges of the fins that the views of a turn agree on.
    pub fins: Vec<Fin>,
    /// What became of each view.
    pub views: Vec<Judged>,
    /// The camera of a turn, with the angles of its views, rad.
    pub psi: Option<(Camera, Vec<f64>)>,
    /// The calibration of the turn. `None` where it is measured with the camera as given.
    pub calibration: Option<Calibration>,
    /// The residual volumes by which the calibration was judged. `None` without a calibration.
    pub vrv: Option<VrvCheck>,
    /// Number of views that may miss a voxel of the hull.
    pub budget: u32,
    /// Whether the hull reaches the end of the box.
    pub touches_box: bool,
    /// Why the views of a turn do not show one specimen that turns. The numbers are not those of a specimen then.
    pub turn_findings: Vec<TurnFinding>,
    /// What a reader must know of the numbers, as in `docs/files.md`.
    pub flags: Vec<Flag>,
    /// Reasons to doubt the numbers, in plain words.
    pub doubts: Vec<String>,
}

/// A set that gives no numbers, with its flag.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// Too few views show something.
    #[error(
        "{used} of {given} views show something; {needed} are needed: opposite views are mirror images, and fewer leave the specimen open on a side"
    )]
    FewViews {
        /// Views that show something.
        used: usize,
        /// Views given.
        given: usize,
        /// Views needed.
        needed: usize,
    },
    /// Too few directions.
    #[error(
        "the angles of {views} views see edges in {found} directions; {needed} are needed to close a body. Check the angles: is omega in rad, and one per view?"
    )]
    FewDirections {
        /// Directions found.
        found: usize,
        /// Views that show something.
        views: usize,
        /// Directions needed.
        needed: usize,
    },
}

/// A body that is seen from fewer directions is open on one side.
const DIRECTIONS_LEAST: usize = 4;

impl Refusal {
    /// Its flag.
    pub fn flag(&self) -> Flag {
        match self {
            Self::FewViews { .. } | Self::FewDirections { .. } => Flag::FewViews,
        }
    }
}

/// Mean overlap below which the views do not show the same body. Profiles of a good recording reach 0.94 to 0.97.
const OVERLAP_LEAST: f64 = 0.9;

/// An empty capillary is a valid answer with volume 0.
pub(super) fn empty(views: &[View], cameras: &Cameras) -> Measured {
    Measured {
        measurement: None,
        mesh: None,
        hull: None,
        fins: Vec::new(),
        views: vec![Judged { reason: Some(Bad::Blank.to_string()), ..Judged::default() }; views.len()],
        psi: match cameras {
            Cameras::Psi(psi) => Some((psi.camera.clone(), psi.omega.clone())),
            Cameras::Matrices { .. } => None,
        },
        calibration: None,
        vrv: None,
        budget: 0,
        touches_box: false,
        turn_findings: Vec::new(),
        flags: vec![Flag::Empty],
        doubts: Vec::new(),
    }
}

/// Measures views of one camera in front of a capillary that turns.
pub(super) fn turn(
    psi: &Psi,
    grid: VoxelGrid,
    views: &[View],
    settings: ReconstructionSettings,
    sphere: bool,
    step: &mut dyn FnMut(Step) -> Result<(), Stopped>,
) -> Result<Measured, SilhouettesError> {
    let seen: Vec<usize> = (0..views.len()).filter(|&i| !views[i].is_blank()).collect();
    if seen.len() < VIEWS_LEAST {
        return Err(Refusal::FewViews { used: seen.len(), given: views.len(), needed: VIEWS_LEAST }.into());
    }
    let angles: Vec<f64> = seen.iter().map(|&i| psi.omega[i]).collect();
    let found = directions(&angles);
    if found < DIRECTIONS_LEAST {
        return Err(Refusal::FewDirections { found, views: seen.len(), needed: DIRECTIONS_LEAST }.into());
    }
    let mut reconstruction = Reconstruction::new(&psi.camera, grid, seen.len(), settings)?;
    let mut turning = Turning::default();
    for &i in &seen {
        let view = &views[i];
        reconstruction.observe_edges(&view.mask, &[], view.columns.clone(), psi.omega[i], view.leaves())?;
        turning.observe_outline(i as u32, psi.omega[i], view.columns.clone());
        step(Step::View)?;
    }
    step(Step::Carved)?;
    let calibrated = reconstruction.calibrate();
    step(Step::Calibrated)?;
    let finned = reconstruction.finned(calibrated, sphere);
    let mut turn_findings = turning.findings();
    if !sphere {
        let numbers: Vec<u32> = seen.iter().map(|&i| i as u32).collect();
        turn_findings.extend(reconstruction.turn_findings(&finned, &numbers, None));
    }
    let TurnModel { model, fallback, hull, calibration, projections, fins, .. } = reconstruction.measure(&finned, None, sphere)?;
    let vrv = calibration.as_ref().ok().map(|judged| judged.vrv);
    let calibration = calibration.map(|judged| judged.calibration);
    let shown: Vec<&View> = seen.iter().map(|&i| &views[i]).collect();
    let overlaps = overlaps(&model.unfaired, &shown, &projections);
    let mut judged = vec![Judged { reason: Some(Bad::Blank.to_string()), ..Judged::default() }; views.len()];
    for (at, &i) in seen.iter().enumerate() {
        let state = calibration.as_ref().ok().map(|c| c.views[at]);
        let bad = state.and_then(|s| s.bad);
        judged[i] = Judged {
            used: bad.is_none(),
            reason: bad.map(|b| b.to_string()),
            dy_px: state.filter(|s| s.bad.is_none()).map(|s| s.dy_px),
            residual_px: state.and_then(|s| s.residual_px),
            overlap: Some(overlaps[at]),
        };
    }
    let used = judged.iter().filter(|j| j.used).count();
    let angles: Vec<f64> = judged.iter().zip(&psi.omega).filter(|(j, _)| j.used).map(|(_, &omega)| omega).collect();
    let (camera, omega) = match &calibration {
        Ok(c) => (c.camera.clone(), psi.omega.iter().map(|&w| c.angle(w)).collect()),
        Err(_) => (psi.camera.clone(), psi.omega.clone()),
    };
    let counted: Vec<&View> = shown.iter().zip(&seen).filter(|(_, at)| judged[**at].used).map(|(view, _)| *view).collect();
    // A silhouette at a wrong angle makes the angles of the turn look wrong.
    let is_repeated = turn_findings.iter().any(|finding| matches!(finding, TurnFinding::Repeated { .. }));
    let mut raised = raised_by(&counted, &model);
    raised.extend(fallback.as_ref().map(|why| (if why.is_nonconvex() { Flag::Nonconvex } else { Flag::Uncertain }, None)));
    raised.extend(tell_little(&angles, &QualitySettings::default()).then(|| {
        let gap_deg = widest_gap(&angles).to_degrees();
        let why = format!(
            "warning: {used} views that leave {gap_deg:.0} deg without an edge tell little of each slice's shape; the numbers are rough"
        );
        (Flag::FewViews, Some(why))
    }));
    raised.extend((used < views.len()).then_some((Flag::BadView, None)));
    raised.extend(vrv.filter(|vrv| vrv.verdict == VrvVerdict::NotLargest).map(|_| (Flag::CalibrationGate, Some(GATE.into()))));
    match &calibration {
        Ok(c) => raised.extend(raised_by_calibration(c, &seen).into_iter().filter(|(flag, _)| !is_repeated || *flag != Flag::WrongSteps)),
        Err(NotCalibrated::NotAsked) => raised.push((Flag::Uncalibrated, None)),
        Err(e) => raised.push((Flag::Uncalibrated, Some(format!("warning: measured with the camera as given: {e}")))),
    }
    raised.extend(turn_findings.iter().map(|finding| (finding.flag(), Some(doubt_of(finding, views)))));
    raised.extend(low_overlap(&overlaps).map(|why| (Flag::Overlap, Some(why))));
    let (flags, doubts): (Vec<_>, Vec<_>) = raised.into_iter().unzip();
    let mut doubts: Vec<String> = doubts.into_iter().flatten().collect();
    doubts.extend(fallback.map(|why| format!("warning: the voxels' numbers are given: {why}")));
    Ok(Measured {
        measurement: Some(model.measurement),
        mesh: Some(model.mesh),
        fins,
        views: judged,
        psi: Some((camera, omega)),
        calibration: calibration.ok(),
        vrv,
        budget: hull.carver().budget(),
        hull: Some(hull),
        touches_box: model.touches_box,
        turn_findings,
        flags,
        doubts,
    })
}

/// A flag, and what it makes doubtful, in plain words.
type Raised = (Flag, Option<String>);

/// Flags from the views and the model.
fn raised_by(shown: &[&View], model: &Model) -> Vec<Raised> {
    let leaves = |side: fn(&Leaves) -> bool| shown.iter().any(|v| side(&v.leaves()));
    let mut raised: Vec<Raised> = Vec::new();
    for (flag, side, leaves) in [(Flag::ClippedLeft, "left", leaves(|l| l.left)), (Flag::ClippedRight, "right", leaves(|l| l.right))] {
        if leaves {
            raised.push((flag, Some(format!("warning: the silhouettes reach the image's {side} side: what lies beyond is not measured"))));
        }
    }
    raised.extend(model.touches_box.then(|| (Flag::OutsideBox, Some(BOX.into()))));
    raised
}

/// Flags from the calibration. `seen` has the indices of the views among all given ones.
fn raised_by_calibration(found: &Calibration, seen: &[usize]) -> Vec<Raised> {
    let moved = found.moved.map(|m| (Flag::Moved, Some(say_moved(m, seen))));
    let wrong_steps = found.has_wrong_steps().then(|| {
        let rho = found.rho;
        let said =
            format!("warning: the specimen turned by {rho:.4} times the angles in omega: check the steps per revolution, or the coupling");
        (Flag::WrongSteps, Some(said))
    });
    moved.into_iter().chain(wrong_steps).collect()
}

/// A finding in words, with the names of silhouettes that are one.
fn doubt_of(finding: &TurnFinding, views: &[View]) -> String {
    let name = |index: u32| views.get(index as usize).map_or("", |view| view.name.as_str());
    match finding {
        TurnFinding::Repeated { view, other, .. } => format!("warning: {} and {} are one silhouette: {finding}", name(*view), name(*other)),
        _ => format!("warning: {finding}"),
    }
}

const GATE: &str =
    "warning: another axis than the calibrated one leaves a larger hull: the views do not quite agree on one turn of one body";
const BOX: &str = "warning: the hull reaches the end of the box, and may go on outside: widen it";

fn say_moved(moved: Moved, seen: &[usize]) -> String {
    format!(
        "warning: from view {} on the specimen lies elsewhere: {:.1} px along the capillary, {:.1} px across, {:.1} deg turned",
        seen[moved.view],
        moved.along_px,
        moved.across_px,
        moved.turn_rad.to_degrees()
    )
}

/// Measures views of any cameras without calibration.
pub(super) fn hull(
    projections: &[Projection],
    grid: VoxelGrid,
    views: &[View],
    settings: ReconstructionSettings,
    sphere: bool,
    step: &mut dyn FnMut(Step) -> Result<(), Stopped>,
) -> Result<Measured, SilhouettesError> {
    let seen: Vec<usize> = (0..views.len()).filter(|&i| !views[i].is_blank()).collect();
    let mut hull = HullModel::new(grid, seen.len(), settings)?;
    for &i in &seen {
        hull.observe(&views[i].mask, &[], &projections[i], Leaves::default())
            .map_err(|source| SilhouettesError::View { name: views[i].name.clone(), source })?;
        step(Step::View)?;
    }
    let model = hull.finish(sphere)?;
    let shown: Vec<&View> = seen.iter().map(|&i| &views[i]).collect();
    let through: Vec<Projection> = seen.iter().map(|&i| projections[i]).collect();
    let overlaps = overlaps(&model.unfaired, &shown, &through);
    let mut judged = vec![Judged { reason: Some(Bad::Blank.to_string()), ..Judged::default() }; views.len()];
    for (&i, &overlap) in seen.iter().zip(&overlaps) {
        judged[i] = Judged { used: true, overlap: Some(overlap), ..Judged::default() };
    }
    let touches_box = model.touches_box;
    let raised = [
        (touches_box, Flag::OutsideBox),
        (seen.len() < VIEWS_LEAST, Flag::FewViews),
        (seen.len() < views.len(), Flag::BadView),
        (true, Flag::Uncalibrated),
        (low_overlap(&overlaps).is_some(), Flag::Overlap),
    ];
    Ok(Measured {
        measurement: Some(model.measurement),
        mesh: Some(model.mesh),
        fins: Vec::new(),
        views: judged,
        psi: None,
        calibration: None,
        vrv: None,
        budget: hull.carver().budget(),
        hull: Some(hull),
        touches_box,
        turn_findings: Vec::new(),
        flags: raised.iter().filter(|(raised, _)| *raised).map(|(_, flag)| *flag).collect(),
        doubts: low_overlap(&overlaps).into_iter().chain(touches_box.then(|| BOX.to_owned())).collect(),
    })
}

/// Overlap of each view's mask with the image of the hull in that view.
fn overlaps(mesh: &Mesh, views: &[&View], projections: &[Projection]) -> Vec<f64> {
    views
        .par_iter()
        .zip(projections)
        .map(|(view, projection)| view.mask.iou(&surface::silhouette(mesh, projection, view.mask.width(), view.mask.height())))
        .collect()
}

fn low_overlap(overlaps: &[f64]) -> Option<String> {
    let mean = mean(overlaps);
    (mean < OVERLAP_LEAST).then(|| {
        format!(
            "warning: the hull's images overlap the masks by {mean:.2} in the mean, {OVERLAP_LEAST} and more is usual. Masks (inside = 255), angles (rad), \
             cameras or the order of the files do not fit each other"
        )
    })
}
