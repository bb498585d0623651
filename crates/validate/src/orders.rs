//! The order in which views are taken.

use super::document::{Section, table};
use super::effort::Work;
use super::statistics::Summary;
use super::turn::{CAPTURED, Turn, off, support};
use hardware_sim::analytic::Disturbance;

const COUNTS: [usize; 7] = [7, 10, 14, 21, 28, 42, 63];
/// The stop of the i-th view.
type Order = fn(usize) -> usize;
const ORDERS: [(&str, Order); 3] =
    [("sequential", |i| i), ("golden ratio", golden), ("every fifth stop, five turns", |i| 5 * i % CAPTURED)];
/// The number coprime to 84 that is nearest to 84 over the golden ratio: every stop is visited once.
const GOLDEN_STEP: usize = 53;

/// The i-th stop by the golden ratio.
fn golden(i: usize) -> usize {
    i * GOLDEN_STEP % CAPTURED
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "7. Order of views", ..Section::default() };
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
        "Simulation: {n} finless larvae, drift and noise, {CAPTURED} stops. Volume by support functions after this number of views,\n\
         calibrated on these views alone: size of the error in per cent, mean / worst.\n\n{}",
        table(&head, &rows)
    );
    Ok(section)
}

fn captured(seed: u64) -> anyhow::Result<Turn> {
    Turn::of_larva(seed, CAPTURED, &Disturbance::drift(seed))
}

/// Error after this number of views, per cent. `None` without an estimate.
fn error(turn: &Turn, order: Order, views: usize) -> Option<f64> {
    let mut stops: Vec<usize> = (0..views).map(order).collect();
    stops.sort_unstable();
    let found = turn.calibrated(&stops).ok()?;
    Some(off(support(turn, &stops, &found)?.estimate.volume_um3, turn.truth.size.volume_um3))
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
