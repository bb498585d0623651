//! In which order to take the views, and when to stop: by the rule that a method's `early_stop` is.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::{Summary, share_within};
use super::turn::{CAPTURED, Turn, off, support};
use crate::acquisition::{RevolutionPlan, ViewOrder};
use crate::quality::{EarlyStopSettings, Estimate, should_stop};
use crate::units::StepsPerRevolution;
use hardware_sim::analytic::Disturbance;

const COUNTS: [usize; 7] = [7, 10, 14, 21, 28, 42, 63];
/// The stop of the i-th view.
type Order = fn(usize) -> usize;
const ORDERS: [(&str, Order); 3] =
    [("sequential", |i| i), ("golden ratio", golden), ("every fifth stop, five turns", |i| 5 * i % CAPTURED)];
/// Rules that turns are ended by: the tried one of few views, the method's own, and a stricter one.
const RULES: [EarlyStopSettings; 3] = [
    EarlyStopSettings { enabled: true, min_views: 9, ..EarlyStopSettings::DEFAULT },
    EarlyStopSettings { enabled: true, ..EarlyStopSettings::DEFAULT },
    EarlyStopSettings { enabled: true, spread_percent: 0.3, promised_error_percent: 0.5, ..EarlyStopSettings::DEFAULT },
];
/// Share of the turns whose error is to be within what the rule promises, %.
const PROMISED_SHARE: f64 = 95.0;

/// The number coprime to 84 that is nearest to 84 over the golden ratio: every stop is met once.
const GOLDEN_STEP: usize = 53;

/// The i-th stop by the golden ratio.
fn golden(i: usize) -> usize {
    i * GOLDEN_STEP % CAPTURED
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "7. Order of views, and stopping early", ..Section::default() };
    let n = work.effort.orders;
    let each = work.each("orders of views", n, |i| {
        let turn = captured(work.seed + 50_000 + i)?;
        let of_order = |order: Order| COUNTS.iter().map(|&views| error(&turn, order, views)).collect();
        Ok(ORDERS.iter().map(|(_, order)| of_order(*order)).collect::<Vec<Vec<Option<f64>>>>())
    })?;
    let mut rows = Vec::new();
    for (at, (name, _)) in ORDERS.iter().enumerate() {
        let mut row = vec![(*name).to_owned()];
        for count in 0..COUNTS.len() {
            let sizes: Vec<f64> = each.iter().filter_map(|e| e[at][count]).map(f64::abs).collect();
            let s = Summary::of(&sizes);
            let missing = if s.n < n { format!(" ({} of {n} measured)", s.n) } else { String::new() };
            row.push(if s.n == 0 { "not measured".into() } else { format!("{:.2} / {:.2}{missing}", s.mean, s.worst) });
        }
        rows.push(row);
    }
    let head: Vec<String> = std::iter::once("order".into()).chain(COUNTS.iter().map(|c| format!("{c} views"))).collect();
    section.text = format!(
        "Simulation: {n} finless larvae, drift and noise, {CAPTURED} stops. Volume by support functions after so many views, calibrated on just these: per cent off, mean / worst size.\n\n{}",
        table(&head, &rows)
    );
    early(work, &mut section)?;
    Ok(section)
}

fn captured(seed: u64) -> anyhow::Result<Turn> {
    Turn::of_larva(seed, CAPTURED, &Disturbance::drift(seed))
}

/// Per cent off after so many views.
fn error(turn: &Turn, order: Order, views: usize) -> Option<f64> {
    let mut stops: Vec<usize> = (0..views).map(order).collect();
    stops.sort_unstable();
    let found = turn.calibrated(&stops).ok()?;
    Some(off(support(turn, &stops, &found)?.estimate.volume_um3, turn.truth.size.volume_um3))
}

/// Views taken when a turn in a method's order is ended by each rule, and the error then.
fn stopped(turn: &Turn, order: &[usize]) -> [Option<(usize, f64)>; RULES.len()] {
    let mut estimates: Vec<Estimate> = Vec::new();
    let mut found = [None; RULES.len()];
    for views in 1..=CAPTURED {
        let open = RULES.iter().zip(&found).any(|(rule, end)| end.is_none() && rule.asks(views));
        if found.iter().all(Option::is_some) {
            break;
        }
        let Some(estimate) = open.then(|| estimate(turn, &order[..views])).flatten() else { continue };
        estimates.push(estimate);
        for (rule, end) in RULES.iter().zip(&mut found).filter(|(_, end)| end.is_none()) {
            *end = should_stop(&estimates, rule).then(|| (views, off(estimate.volume_um3, turn.truth.size.volume_um3)));
        }
    }
    found
}

/// As the pipeline has it in mid-turn.
fn estimate(turn: &Turn, stops: &[usize]) -> Option<Estimate> {
    let mut stops = stops.to_vec();
    stops.sort_unstable();
    let found = support(turn, &stops, &turn.calibrated(&stops).ok()?)?;
    Some(Estimate { views: stops.len(), volume_um3: found.estimate.volume_um3, volume_sd_um3: found.volume_sd_um3 })
}

fn early(work: &Work, section: &mut Section) -> anyhow::Result<()> {
    let n = work.effort.early;
    let plan = RevolutionPlan::new(CAPTURED as u32, StepsPerRevolution::new(CAPTURED as u32, 1)?, ViewOrder::CoarseToFine)?;
    let order: Vec<usize> = plan.stops().iter().filter(|s| !s.closure).map(|s| s.view as usize).collect();
    let each = work.each("stopping early", n, |i| Ok(stopped(&captured(work.seed + 60_000 + i)?, &order)))?;
    let mut rows = Vec::new();
    for (at, rule) in RULES.iter().enumerate() {
        let found: Vec<(usize, f64)> = each.iter().filter_map(|ends| ends[at]).collect();
        let views: Vec<f64> = found.iter().map(|f| f.0 as f64).collect();
        let errors: Vec<f64> = found.iter().map(|f| f.1).collect();
        let kept = share_within(&errors, rule.promised_error_percent);
        rows.push(vec![
            format!(
                "{} views, last {} within {} %, promised {} %",
                rule.min_views, rule.last, rule.spread_percent, rule.promised_error_percent
            ),
            format!("{} of {n}", found.len()),
            format!("{:.1}, {} at most", Summary::of(&views).mean, Summary::of(&views).worst),
            Summary::of(&errors).signed(2),
            format!("{kept:.1}"),
        ]);
        section.goals.push(Goal::new(
            format!("early stop: of {n} turns, those that end by {} % hold it: {PROMISED_SHARE} % or more", rule.promised_error_percent),
            format!("{kept:.1} % of {}", found.len()),
            !found.is_empty() && kept >= PROMISED_SHARE,
        ));
    }
    section.text += &format!(
        "### Stopping early\n\nSimulation: {n} such larvae, {CAPTURED} stops, coarse to fine. After each view the volume by support functions is estimated from the views so far, \
         calibrated on just these; the turn ends when the newest estimates agree and the 95 % interval of the newest is as narrow as promised (`early_stop`, the second rule is its default). Views and \
         per cent off the truth at the end; held is the share within what was promised, of those that ended early.\n\n{}",
        table(&["rule", "ended early", "views", "off the truth, %: mean ± SD, worst", "held, %"], &rows)
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_meets_every_stop_once() {
        for (name, order) in ORDERS {
            let mut stops: Vec<usize> = (0..CAPTURED).map(order).collect();
            stops.sort_unstable();
            assert!(stops.into_iter().eq(0..CAPTURED), "{name}");
        }
    }
}
