//! The live volume in the status while the capillary turns: whether the truth is within its standard deviation.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::{Summary, share_within};
use super::turn::{Turn, estimate, even_plan, off};
use carved_core::quality::{EarlyStopSettings, Estimate, has_converged};
use carved_core::units::StepsPerRevolution;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::ViewOrder;
use hardware_sim::analytic::{Disturbance, Phantom, Pose};
use hardware_sim::scene::Camera;

const ASDS: [usize; 2] = [21, 84];
const ORDERS: [(&str, ViewOrder); 2] = [("sequential", ViewOrder::Sequential), ("coarse to fine", ViewOrder::CoarseToFine)];
/// Quarters of the turn after which the estimate is tested. The last one is the end of the turn.
const QUARTERS: [usize; 4] = [1, 2, 3, 4];
/// Share of the estimates that must have the truth within two standard deviations, %.
const HELD_LEAST: f64 = 90.0;

/// The estimate after some views of a turn.
struct Told {
    off_percent: f64,
    sd_percent: f64,
    converged: bool,
}

impl Told {
    fn deviations(&self) -> f64 {
        self.off_percent / self.sd_percent
    }
}

/// The estimates after each quarter of a turn in this order. `None` if there is no estimate.
fn estimates(turn: &Turn, order: &[usize]) -> [Option<Told>; QUARTERS.len()] {
    let rule = EarlyStopSettings::DEFAULT;
    let truth_um3 = turn.truth.size.hull_volume_um3;
    QUARTERS.map(|quarter| {
        let views = quarter * order.len() / QUARTERS.len();
        // The earlier ones are needed only to decide whether the volume has converged.
        let first = if rule.asks(views) { views + 1 - rule.last } else { views };
        let estimates: Vec<Estimate> = (first..=views).filter_map(|n| estimate(turn, &order[..n])).collect();
        let newest = estimates.last().filter(|e| e.views == views)?;
        Some(Told {
            off_percent: off(newest.volume_um3, truth_um3),
            sd_percent: 100.0 * newest.volume_sd_um3 / truth_um3,
            converged: has_converged(&estimates, &rule),
        })
    })
}

/// Every other larva has fins, which few views see edge-on.
fn finned(number: u64) -> bool {
    number % 2 == 1
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "10. While the capillary turns", ..Section::default() };
    let n = work.effort.live;
    let kinds: Vec<(usize, &str, Vec<usize>)> = ASDS
        .iter()
        .flat_map(|asd| ORDERS.iter().map(|(name, order)| (*asd, *name, *order)))
        .map(|(asd, name, order)| Ok((asd, name, stops(asd, order)?)))
        .collect::<anyhow::Result<_>>()?;
    let each = work.each("while it turns", n, |i| {
        let seed = work.seed + 80_000 + i;
        let dpf = 3 + (seed % 3) as u8;
        let phantom = if finned(i) { Phantom::finned(dpf, seed)? } else { Phantom::larva(dpf, seed)? }.placed(Pose::seeded(seed));
        let turns = ASDS.map(|asd| Turn::of(&phantom, &Camera::default(), &even_plan(asd), &Disturbance::drift(seed)));
        let of = |asd: usize| turns.iter().find(|turn| turn.ledger.len() == asd);
        Ok(kinds.iter().map(|(asd, _, order)| of(*asd).map(|turn| estimates(turn, order))).collect::<Vec<_>>())
    })?;
    let mut rows = Vec::new();
    for (at, (asd, name, _)) in kinds.iter().enumerate() {
        for (quarter, number) in QUARTERS.iter().enumerate() {
            let of: Vec<&Told> = each.iter().filter_map(|kinds| kinds[at].as_ref()?[quarter].as_ref()).collect();
            let views = number * asd / QUARTERS.len();
            rows.push(row(&format!("{asd}, {name}"), views, &of, n));
            if !of.is_empty() {
                let deviations: Vec<f64> = of.iter().map(|t| t.deviations()).collect();
                let held = share_within(&deviations, 2.0);
                section.goals.push(Goal::new(
                    format!("live estimate: truth within 2 SD after {views} of {asd} views, {name}: {HELD_LEAST} % or more"),
                    format!("{held:.1} % of {} estimates", of.len()),
                    held >= HELD_LEAST,
                ));
            }
        }
    }
    section.text = format!(
        "Simulation: {n} larvae with drift and noise, every other with fins. The table compares `specimen.volume_um3` after each\n\
         quarter of a turn with the ideal hull. Its standard deviation contains views, calibration, and corners of fins that few\n\
         views do not show. The errors of scale and edges that an instrument adds are left out, because the simulation has no\n\
         such errors. There is no estimate before the views cover all directions. The last column has the number of turns that\n\
         converged by the default rule of `early_stop`, and the share of these within the error that the rule promises.\n\n{}",
        table(
            &[
                "ASD, order",
                "views",
                "estimates",
                "error, %: mean ± SD, worst",
                "stated SD, %",
                "error in SDs: mean ± SD",
                "within 2 SD, %",
                "converged; within the promise, %"
            ],
            &rows
        )
    );
    Ok(section)
}

/// The stops of a turn in the order in which they are taken.
fn stops(asd: usize, order: ViewOrder) -> anyhow::Result<Vec<usize>> {
    let plan = RevolutionPlan::new(asd as u32, StepsPerRevolution::new(asd as u32, 1)?, order)?;
    Ok(plan.stops().iter().filter(|s| !s.closure).map(|s| s.view as usize).collect())
}

fn row(what: &str, views: usize, of: &[&Told], n: usize) -> Vec<String> {
    let observed = format!("{} of {n}", of.len());
    let mut row = vec![what.to_owned(), views.to_string(), observed];
    if of.is_empty() {
        row.extend((0..5).map(|_| String::new()));
        return row;
    }
    let all = |f: fn(&Told) -> f64| of.iter().map(|t| f(t)).collect::<Vec<f64>>();
    let (deviations, sd) = (all(Told::deviations), Summary::of(&all(|t| t.sd_percent)));
    let z = Summary::of(&deviations);
    let converged: Vec<f64> = of.iter().filter(|t| t.converged).map(|t| t.off_percent).collect();
    let held = share_within(&converged, EarlyStopSettings::DEFAULT.promised_error_percent);
    row.extend([
        Summary::of(&all(|t| t.off_percent)).signed(2),
        format!("{:.2} ± {:.2}", sd.mean, sd.sd),
        format!("{:+.2} ± {:.2}", z.mean, z.sd),
        format!("{:.1}", share_within(&deviations, 2.0)),
        if converged.is_empty() { "0".into() } else { format!("{}; {held:.1}", converged.len()) },
    ]);
    row
}
