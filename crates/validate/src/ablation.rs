//! The effect of each step of the calibration on either estimator.

use super::document::{Section, table};
use super::effort::Work;
use super::statistics::Summary;
use super::turn::{Turn, grid, off, sections, voxels};
use carved_core::calibration::{Ask, Free, Objective, Pose, Priors, Psi, Stop, Vrv, calibrate, optimise};
use carved_core::carver::Runs;
use carved_core::geometry::Camera;
use carved_core::measure::support::SupportEstimate;
use carved_core::profile::Mask;
use hardware_sim::analytic::Disturbance;

const ASD: usize = 21;
const VOXEL_UM: f64 = 10.0;
/// Coarse, because a search needs some hundred evaluations; it still resolves a tenth of a px.
const VRV_VOXEL_UM: f64 = 17.1;
const STOP: Stop = Stop { evaluations: 200, share: 0.01 };
const WAYS: [&str; 4] = ["none: the rig's camera", "VRV alone: Nelder-Mead in uy and gamma", "closed form alone", "least squares"];

/// Error of uy (px) and gamma (deg); then errors in per cent: volume by support before and after the correction of its bias, area by
/// support, volume and area by voxels.
type Found = [f64; 7];

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let n = work.effort.ablation;
    let each = work.each("ablation", n, |i| ablated(work.seed + 40_000 + i))?;
    let rows: Vec<Vec<String>> = WAYS
        .iter()
        .enumerate()
        .map(|(way, name)| {
            let of = |number: usize, digits: usize| {
                let values: Vec<f64> = each.iter().filter_map(|e| e[way].map(|f| f[number])).collect();
                if values.is_empty() { "none measured".into() } else { Summary::of(&values).signed(digits) }
            };
            let solved = each.iter().filter(|e| e[way].is_some()).count();
            vec![(*name).into(), solved.to_string(), of(0, 3), of(1, 3), of(2, 2), of(3, 2), of(4, 2), of(5, 2), of(6, 2)]
        })
        .collect();
    let text = format!(
        "Simulation: {n} finless larvae, drift and noise, ASD {ASD}; voxels of {VOXEL_UM} um with epsilon 0.05, VRV with epsilon 0 at {VRV_VOXEL_UM} um\n\
         from the rig's camera. Errors against the true values, mean ± SD, worst; volumes and areas in per cent.\n\n{}\
         The volume as fitted and the area by support functions hardly depend on uy. The paper's hull loses half its volume per\n\
         10 px. The bias of a volume by support functions is estimated from the shifts and residuals of the views, and\n\
         subtracted. Without a calibration these contain the error of the axis, and the corrected volume is worthless. Only the\n\
         least squares know the shift of each view.\n\n",
        table(
            &[
                "calibration",
                "measured",
                "uy, px",
                "gamma, deg",
                "volume, support, as fitted",
                "after bias correction",
                "area, support",
                "volume, voxels",
                "area, voxels"
            ],
            &rows
        )
    );
    Ok(Section { title: "6. What each step is worth", text, ..Section::default() })
}

/// The results in the order of [`WAYS`].
fn ablated(seed: u64) -> anyhow::Result<[Option<Found>; 4]> {
    let turn = Turn::of_larva(seed, ASD, &Disturbance::drift(seed))?;
    let masks = turn.masks();
    let stops = turn.all();
    let fixed = |camera: &Camera| -> anyhow::Result<Option<Found>> {
        let views: Vec<_> = stops.iter().map(|&i| (&masks[i], camera.projection(turn.ledger[i]))).collect();
        let ours = sections(&Pose::new(camera), &turn.as_planned(&stops), 1.0 / camera.ky);
        numbers(&turn, &stops, camera, ours.as_ref(), &views)
    };
    let start =
        carved_core::calibration::axis(&turn.nominal, &turn.given(&stops).iter().map(|v| (v.columns, v.omega)).collect::<Vec<_>>()).ok();
    let solved = match calibrate(&turn.nominal, &turn.given(&stops), Priors::default()) {
        Ok(found) => {
            let given = turn.given(&stops);
            let ours = sections(&Pose::new(&found.camera), &found.turn_views(&given), found.residual_sd_um);
            let views = super::turn::calibrated_views(&turn, &masks, &stops, &found);
            numbers(&turn, &stops, &found.camera, ours.as_ref(), &views)?
        }
        Err(_) => None,
    };
    let searched = searched(&turn, &masks)?;
    Ok([fixed(&turn.nominal)?, fixed(&searched)?, start.as_ref().map(fixed).transpose()?.flatten(), solved])
}

fn numbers(
    turn: &Turn,
    stops: &[usize],
    camera: &Camera,
    ours: Option<&SupportEstimate>,
    views: &[(&Mask, carved_core::geometry::Projection)],
) -> anyhow::Result<Option<Found>> {
    let Some(ours) = ours else { return Ok(None) };
    let size = turn.truth.size;
    let v = voxels(grid(VOXEL_UM)?, views, false)?;
    Ok(Some([
        turn.uy_error_px(stops, camera),
        turn.gamma_error_deg(camera),
        off(ours.volume_um3 + ours.volume_bias_um3, size.volume_um3),
        off(ours.volume_um3, size.volume_um3),
        off(ours.area_um2, size.area_um2),
        off(v.volume_um3, size.volume_um3),
        off(v.area_um2, size.area_um2),
    ]))
}

/// The paper's method: the camera for which most voxels remain.
fn searched(turn: &Turn, masks: &[Mask]) -> anyhow::Result<Camera> {
    let runs = masks.iter().map(Runs::new).collect::<Result<Vec<_>, _>>()?;
    let vrv = Vrv::new(runs.iter().collect(), grid(VRV_VOXEL_UM)?, 0.0)?;
    let asked = ["uy", "gamma"].map(str::parse::<Ask>).into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = Psi::new(turn.nominal.clone(), turn.ledger.clone());
    Ok(optimise(&start, &Free::new(&asked).0, &mut Objective::Vrv(Box::new(vrv)), STOP)?.psi.camera)
}
