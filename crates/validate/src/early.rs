//! Turns that end before their last view: whether the promise of the rule holds.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::{Summary, share_within};
use super::turn::{CAPTURED, Turn, estimate, even_plan, off};
use carved_core::calibration::HARMONICS_MOST;
use carved_core::quality::{EarlyStopSettings, Estimate, should_stop};
use carved_core::units::StepsPerRevolution;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::ViewOrder;
use hardware_sim::analytic::{Disturbance, Phantom, Pose};
use hardware_sim::scene::Camera;

/// Rules that end the turns: one that may end earlier, and the method's own.
const RULES: [EarlyStopSettings; 2] = [
    EarlyStopSettings { enabled: true, min_views: 20, ..EarlyStopSettings::DEFAULT },
    EarlyStopSettings { enabled: true, ..EarlyStopSettings::DEFAULT },
];
/// Share of the turns whose error must be within the promise of the rule, %.
const PROMISED_SHARE: f64 = 95.0;

/// For each rule, the number of views when it ends the turn, and the error at that moment. `None` if it does not end the turn early enough.
fn stopped(turn: &Turn, order: &[usize]) -> [Option<(usize, f64)>; RULES.len()] {
    let mut estimates: Vec<Estimate> = Vec::new();
    let mut found = [None; RULES.len()];
    // After half of the stops there is little time left to save.
    for views in 1..=CAPTURED / 2 {
        let asked = RULES.iter().zip(&found).any(|(rule, end)| end.is_none() && rule.asks(views));
        let Some(estimate) = asked.then(|| estimate(turn, &order[..views])).flatten() else { continue };
        estimates.push(estimate);
        for (rule, end) in RULES.iter().zip(&mut found).filter(|(_, end)| end.is_none()) {
            *end = should_stop(&estimates, rule).then(|| (views, off(estimate.volume_um3, turn.truth.size.hull_volume_um3)));
        }
    }
    found
}

/// Every other larva has fins, which few views see edge-on.
fn finned(number: u64) -> bool {
    number % 2 == 1
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "9. Stopping early", ..Section::default() };
    let n = work.effort.early;
    let plan = RevolutionPlan::new(CAPTURED as u32, StepsPerRevolution::new(CAPTURED as u32, 1)?, ViewOrder::CoarseToFine)?;
    let order: Vec<usize> = plan.stops().iter().filter(|s| !s.closure).map(|s| s.view as usize).collect();
    let each = work.each("stopping early", n, |i| {
        let seed = work.seed + 60_000 + i;
        let dpf = 3 + (seed % 3) as u8;
        let phantom = if finned(i) { Phantom::finned(dpf, seed)? } else { Phantom::larva(dpf, seed)? };
        let turn = Turn::of(&phantom.placed(Pose::seeded(seed)), &Camera::default(), &even_plan(CAPTURED), &Disturbance::drift(seed));
        Ok((finned(i), stopped(&turn, &order)))
    })?;
    let mut rows = Vec::new();
    for (at, rule) in RULES.iter().enumerate() {
        let mut all: Vec<f64> = Vec::new();
        for fins in [false, true] {
            let of: Vec<&[Option<(usize, f64)>; RULES.len()]> = each.iter().filter(|e| e.0 == fins).map(|e| &e.1).collect();
            let found: Vec<(usize, f64)> = of.iter().filter_map(|ends| ends[at]).collect();
            let views: Vec<f64> = found.iter().map(|f| f.0 as f64).collect();
            let errors: Vec<f64> = found.iter().map(|f| f.1).collect();
            rows.push(vec![
                format!(
                    "from {} views, {} within {} %, promised {} %",
                    rule.min_views, rule.last, rule.spread_percent, rule.promised_error_percent
                ),
                if fins { "finned" } else { "finless" }.into(),
                format!("{} of {}", found.len(), of.len()),
                format!("{:.1}, {} at most", Summary::of(&views).mean, Summary::of(&views).worst),
                Summary::of(&errors).signed(2),
                format!("{:.1}", share_within(&errors, rule.promised_error_percent)),
            ]);
            all.extend(errors);
        }
        let held = share_within(&all, rule.promised_error_percent);
        section.goals.push(Goal::new(
            format!(
                "early stop: of {n} turns that end early on a promise of {} % (from {} views), the share within it: {PROMISED_SHARE} % or more",
                rule.promised_error_percent, rule.min_views
            ),
            format!("{held:.1} % of {}", all.len()),
            !all.is_empty() && held >= PROMISED_SHARE,
        ));
    }
    section.text = format!(
        "Simulation: {n} larvae with drift and noise, every other with fins, {CAPTURED} stops, coarse to fine. After each view the\n\
         volume by support functions is estimated from the views so far, calibrated on these views alone. The turn ends when\n\
         slices have {HARMONICS_MOST} harmonics, the newest estimates agree and the 95 % interval of the newest is as narrow as promised\n\
         (`early_stop`; the second rule is its default). The table has the number of views and the error against the ideal hull\n\
         at the end. The last column is the share of early ends within the promised error.\n\n{}",
        table(&["rule", "larvae", "ended early", "views", "error, %: mean ± SD, worst", "within the promise, %"], &rows)
    );
    Ok(section)
}
