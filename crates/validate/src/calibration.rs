//! Calibration of a turn under many drifts, with a slipping axis, and the parameters that VRV must not free.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::Summary;
use super::turn::{CAPTURED, Turn, off, support};
use carved_core::calibration::{Ask, Free, PASSES_MOST, Refusal};
use hardware_sim::analytic::Disturbance;

/// The result for one drift.
#[derive(Debug, Clone, Copy)]
struct DriftResult {
    uy_px: f64,
    gamma_deg: f64,
    /// Error in per cent.
    volume: f64,
    rho: f64,
    passes: usize,
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "4. Calibration", ..Section::default() };
    let n = work.effort.calibrated;
    let at_21 = many(work, "calibration, ASD 21", 21, 1.0)?;
    let at_84 = many(work, "calibration, ASD 84", CAPTURED, 1.0)?;
    let slipped = many(work, "calibration, slip", 21, 1.02)?;
    let rows: Vec<Vec<String>> = [("ASD 21", &at_21, 1.0), ("ASD 84", &at_84, 1.0), ("ASD 21, slip 2 %", &slipped, 1.02)]
        .iter()
        .map(|(name, found, rho)| {
            let of = |number: &dyn Fn(&DriftResult) -> f64| Summary::of(&found.iter().map(number).collect::<Vec<_>>());
            vec![
                (*name).into(),
                format!("{} of {n}", found.len()),
                of(&|f| f.uy_px).signed(3),
                of(&|f| f.gamma_deg).signed(4),
                of(&|f| 100.0 * (f.rho / rho - 1.0)).signed(3),
                of(&|f| f.volume).signed(2),
                of(&|f| f.passes as f64).worst.to_string(),
            ]
        })
        .collect();
    section.text = format!(
        "Simulation: {n} finless larvae, each with another drift (uy to 20 px, gamma to 1 deg, alpha to 0.3 deg; angles 0.5 deg,\n\
         shifts 0.4 px, edges 0.3 px, SD). The mean of the true shifts is added to the true uy. Error, mean ± SD, worst.\n\n{}",
        table(&["", "solved", "uy, px", "gamma, deg", "scale of angles, %", "volume, %", "most passes"], &rows)
    );
    let worst =
        |found: &[DriftResult], number: &dyn Fn(&DriftResult) -> f64| Summary::of(&found.iter().map(number).collect::<Vec<_>>()).worst;
    let mut goal = |what: &str, found: &[DriftResult], number: &dyn Fn(&DriftResult) -> f64, most: f64, unit: &str| {
        let value = worst(found, number);
        section.goals.push(Goal::new(
            format!("4: {what} ({n} seeds)"),
            if unit.is_empty() {
                format!("{} solved, worst {value}", found.len())
            } else {
                format!("{} solved, worst {value:+.3}{unit}", found.len())
            },
            found.len() == n && value.abs() <= most,
        ));
    };
    goal("calibration at ASD 21, uy within 0.05 px", &at_21, &|f| f.uy_px, 0.05, " px");
    goal("gamma within 0.02 deg", &at_21, &|f| f.gamma_deg, 0.02, " deg");
    goal("at most 8 passes", &at_21, &|f| f.passes as f64, PASSES_MOST as f64, "");
    goal("volume within 1 %", &at_21, &|f| f.volume, 1.0, " %");
    goal("at ASD 84 volume within 0.2 %", &at_84, &|f| f.volume, 0.2, " %");
    goal("2 % slip, scale of angles within 0.2 %, ASD 21", &slipped, &|f| 100.0 * (f.rho / 1.02 - 1.0), 0.2, " %");
    refusals(&mut section);
    Ok(section)
}

fn many(work: &Work, what: &'static str, asd: usize, rho: f64) -> anyhow::Result<Vec<DriftResult>> {
    let each = work.each(what, work.effort.calibrated, |i| {
        let seed = work.seed + 20_000 + i;
        let turn = Turn::of_larva(seed, asd, &Disturbance { rho, ..Disturbance::drift(seed) })?;
        let stops = turn.all();
        Ok(turn.calibrated(&stops).ok().and_then(|c| {
            let volume = off(support(&turn, &stops, &c)?.estimate.volume_um3, turn.truth.size.volume_um3);
            Some(DriftResult {
                uy_px: turn.uy_error_px(&stops, &c.camera),
                gamma_deg: turn.gamma_error_deg(&c.camera),
                volume,
                rho: c.rho,
                passes: c.passes,
            })
        }))
    })?;
    Ok(each.into_iter().flatten().collect())
}

/// Requests to VRV, and whether it refuses or bounds them.
fn refusals(section: &mut Section) {
    let mut rows = Vec::new();
    let mut held = true;
    for asked in ["kx", "ky", "f", "ux", "s", "phi", "alpha=45", "omega=180"] {
        let said: Vec<Refusal> = match asked.parse::<Ask>() {
            Ok(ask) => Free::new(&[ask]).1,
            Err(refusal) => vec![refusal],
        };
        held &= !said.is_empty();
        rows.push(vec![asked.to_owned(), said.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")]);
    }
    section.text += &format!("### What VRV may not free\n\n{}", table(&["requested", "answer"], &rows));
    let found = format!("{} of {} are", rows.iter().filter(|r| !r[1].is_empty()).count(), rows.len());
    section.goals.push(Goal::new(
        "6: freeing k, f or unbounded alpha or omega under VRV is refused or bounded, with the reason",
        found,
        held,
    ));
}
