//! Turns with a fault: each is solved or refused by name, and never silently wrong.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::Summary;
use super::turn::{Turn, even_plan, grid, off};
use carved_core::calibration::VrvVerdict;
use carved_core::carver::Leaves;
use carved_core::profile::Mask;
use carved_core::quality::QualitySettings;
use carved_core::reconstruction::{Judged, Reconstruction, ReconstructionSettings, TurnModel};
use hardware_sim::analytic::{Disturbance, Fault, Phantom, Pose};
use hardware_sim::scene::Camera;
use rayon::prelude::*;
use std::collections::BTreeMap;

const ASD: usize = 21;
const VOXEL_UM: f64 = 10.0;
/// A volume with a larger error counts as wrong, unless its own standard deviation covers the error, %.
const WRONG_PERCENT: f64 = 2.0;
/// Inner radius of the capillary, the largest extent of a profile that leaks, um.
const BORE_RADIUS_UM: f64 = 325.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Case {
    Blank,
    Leak,
    Descending,
    Uneven,
    Refracted,
    Empty,
    Clipped,
    FourViews,
}

impl Case {
    const ALL: [(Self, &'static str); 8] = [
        (Self::Blank, "a blank view"),
        (Self::Leak, "a leaking view"),
        (Self::Descending, "descending angles"),
        (Self::Uneven, "uneven steps, up to a fifth of a step off"),
        (Self::Refracted, "ky = 1.333 kx"),
        (Self::Empty, "empty capillary"),
        (Self::Clipped, "tail 300 um out of the frame"),
        (Self::FourViews, "ASD 4"),
    ];

    fn plan(self) -> Vec<f64> {
        match self {
            Self::Descending => even_plan(ASD).into_iter().map(|omega| -omega).collect(),
            Self::Uneven => {
                let step = std::f64::consts::TAU / ASD as f64;
                (0..ASD).map(|i| step * (i as f64 + 0.2 * (2.4 * i as f64).sin())).collect()
            }
            Self::FourViews => even_plan(4),
            _ => even_plan(ASD),
        }
    }

    fn fault(self, camera: &Camera) -> Option<Fault> {
        match self {
            Self::Blank => Some(Fault::Blank { view: ASD / 3 }),
            Self::Leak => Some(Fault::Leak { view: ASD / 4, at_u_px: camera.ux_px - 20.0, width_px: 70.0, bore_radius_um: BORE_RADIUS_UM }),
            Self::Clipped => Some(Fault::Clipped { beyond_um: 300.0 }),
            _ => None,
        }
    }
}

/// The result of a turn.
struct Outcome {
    /// The names of everything that was reported.
    named: Vec<&'static str>,
    /// Why the turn was refused. `None` if it was not.
    refused: Option<String>,
    volume: Option<f64>,
    wrong: bool,
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let n = work.effort.faults;
    work.begin("faults", n * Case::ALL.len());
    let mut section = Section { title: "5. Faults", ..Section::default() };
    let mut rows = Vec::new();
    for (case, name) in Case::ALL {
        let outcomes = (0..n as u64)
            .into_par_iter()
            .map(|i| {
                let outcome = outcome(case, work.seed + 30_000 + i);
                work.step();
                outcome
            })
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<anyhow::Result<Vec<Outcome>>>()?;
        let mut said: BTreeMap<String, usize> = BTreeMap::new();
        for outcome in &outcomes {
            for word in outcome.named.iter().map(ToString::to_string).chain(outcome.refused.clone()) {
                *said.entry(word).or_default() += 1;
            }
        }
        let volumes: Vec<f64> = outcomes.iter().filter_map(|o| o.volume).collect();
        let volume = if volumes.is_empty() { "none".into() } else { format!("{} %", Summary::of(&volumes).signed(2)) };
        let said = said.iter().map(|(word, times)| format!("{word} ({times})")).collect::<Vec<_>>().join("; ");
        let wrong = outcomes.iter().filter(|o| o.wrong).count();
        let found = format!(
            "{} of {n} silently wrong; volume {volume}{}",
            wrong,
            if said.is_empty() { String::new() } else { format!("; {said}") }
        );
        section.goals.push(Goal::new(format!("7: {name}"), found, wrong == 0));
        rows.push(vec![name.into(), n.to_string(), wrong.to_string(), volume, said]);
    }
    section.text = format!(
        "Simulation: finned and finless larvae in turn, drift and noise, ASD {ASD}, through the daemon's own reconstruction (SD {VOXEL_UM}\n\
         um). A volume is silently wrong if it differs from the ideal hull by more than {WRONG_PERCENT} % and by more than three of its own\n\
         standard deviations, and no flag or error reports it. The numbers in brackets count the turns.\n\n{}",
        table(&["fault", "turns", "silently wrong", "volume against the ideal hull", "reported"], &rows)
    );
    Ok(section)
}

fn outcome(case: Case, seed: u64) -> anyhow::Result<Outcome> {
    let dpf = 3 + (seed % 3) as u8;
    let phantom = if seed.is_multiple_of(2) { Phantom::larva(dpf, seed)? } else { Phantom::finned(dpf, seed)? }.placed(Pose::seeded(seed));
    let nominal = Camera::default();
    let nominal = if case == Case::Refracted { Camera { ky_px_per_um: 1.333 * nominal.kx_px_per_um, ..nominal } } else { nominal };
    let disturbance = Disturbance { faults: case.fault(&nominal).into_iter().collect(), ..Disturbance::drift(seed) };
    let mut turn = Turn::of(&phantom, &nominal, &case.plan(), &disturbance);
    if case == Case::Empty {
        let blank = vec![Vec::new(); turn.ledger.len()];
        turn = Turn::new(turn.nominal, turn.ledger, blank, None, turn.truth);
    }
    let mut model = Reconstruction::new(&turn.nominal, grid(VOXEL_UM)?, turn.ledger.len(), ReconstructionSettings::default())?;
    let mut named = Vec::new();
    for ((mask, outlines), &omega) in turn.masks().iter().zip(&turn.outlines).zip(&turn.ledger) {
        let leaves = leaves(mask);
        if leaves.left || leaves.right {
            named.push("clipped");
        }
        model.observe(mask, outlines, omega, leaves)?;
    }
    let finished = match model.finish(false) {
        Ok(finished) => finished,
        Err(error) => return Ok(Outcome { named: Vec::new(), refused: Some(format!("refused: {error}")), volume: None, wrong: false }),
    };
    let TurnModel { model, calibration, .. } = finished;
    let m = model.measurement;
    match calibration {
        Ok(Judged { calibration: found, vrv }) => {
            named.extend((vrv.verdict == VrvVerdict::NotLargest).then_some("calibration gate"));
            named.extend(found.views.iter().any(|v| v.bad.is_some()).then_some("view left out"));
            named.extend(found.moved.is_some().then_some("moved"));
            named.extend(found.has_wrong_steps().then_some("wrong steps"));
        }
        Err(_) => named.push("uncalibrated"),
    }
    named.extend((m.views < QualitySettings::default().views_least).then_some("few views"));
    named.extend(m.fallback.is_some().then_some("not convex: voxels"));
    named.extend(model.touches_box.then_some("outside the box"));
    named.sort_unstable();
    named.dedup();
    let volume = off(m.volume_um3, turn.truth.size.hull_volume_um3);
    let sd = m.volume_sd_um3.map_or(0.0, |sd| 100.0 * sd / m.volume_um3);
    let wrong = named.is_empty() && volume.abs() > WRONG_PERCENT && volume.abs() > 3.0 * sd;
    Ok(Outcome { named, refused: None, volume: Some(volume), wrong })
}

/// A profile that reaches the first or last column of the image continues there.
fn leaves(mask: &Mask) -> Leaves {
    let any = |u: usize| (0..mask.height()).any(|v| mask.get(u, v));
    Leaves { left: any(0), right: any(mask.width() - 1) }
}
