//! How long a run still takes, from what this instrument took before.
//!
//! ```text
//! journal ──► seconds per phase of finished specimens (the newest) ─┬─ the rest of the specimen under way: its phases, less what
//!                                                                  │  the one under way has taken
//!                                                                  └─ wells that wait: whole specimens, skipped ones among them
//! ```
//! Medians add up. What lies above them does not: long specimens are not all long at once, so the spreads add in squares.

use super::{Eta, Event, Phase, kind};
use std::collections::BTreeMap;
use std::collections::VecDeque;

/// Specimens that are remembered per method.
const KEPT: usize = 200;

/// In which order a specimen goes through its phases.
const ORDER: [Phase; 8] =
    [Phase::Load, Phase::Position, Phase::Detect, Phase::Revolve, Phase::Reconstruct, Phase::Measure, Phase::Eject, Phase::Wash];

/// What the specimens of one method took, oldest first.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pace {
    phases_s: [VecDeque<f64>; ORDER.len()],
    wells_s: VecDeque<f64>,
}

/// A specimen on its way, on a clock of the caller's in seconds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct UnderWay {
    began_s: f64,
    phase: Option<(Phase, f64)>,
    phases: Vec<(Phase, f64)>,
}

fn keep(list: &mut VecDeque<f64>, value: f64) {
    if list.len() == KEPT {
        list.pop_front();
    }
    list.push_back(value);
}

/// Quantile of a list, by its nearest rank.
fn quantile(values: &VecDeque<f64>, q: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1))).copied()
}

impl UnderWay {
    pub fn at(now_s: f64) -> Self {
        Self { began_s: now_s, ..Self::default() }
    }

    /// The specimen is in this phase from now on.
    pub fn enter(&mut self, phase: Phase, now_s: f64) {
        // A wait for the loader is told twice; the phase goes on.
        if self.phase.is_some_and(|(now, _)| now == phase) {
            return;
        }
        self.leave(now_s);
        self.phase = Some((phase, now_s));
    }

    /// It has the rig no more.
    pub fn leave(&mut self, now_s: f64) {
        if let Some((phase, since_s)) = self.phase.take() {
            self.phases.push((phase, now_s - since_s));
        }
    }
}

impl Pace {
    /// `rig_s`: how long the specimen had the rig, which is what the next one waits for.
    pub fn learn(&mut self, mut specimen: UnderWay, now_s: f64, rig_s: f64) {
        specimen.leave(now_s);
        for (phase, seconds) in specimen.phases {
            keep(&mut self.phases_s[place(phase)], seconds);
        }
        keep(&mut self.wells_s, rig_s);
    }

    /// Seconds until the specimen under way and `waiting` further wells are done; nothing before this instrument's first specimen.
    pub fn remaining(&self, specimen: Option<&UnderWay>, waiting: u32, now_s: f64) -> Option<Eta> {
        let well = (quantile(&self.wells_s, 0.5)?, quantile(&self.wells_s, 0.9)?);
        let (mut p50, mut squares) = (well.0 * f64::from(waiting), (well.1 - well.0).powi(2) * f64::from(waiting));
        if let Some(specimen) = specimen {
            let (at, spent_s) = specimen.phase.map_or((0, 0.0), |(phase, since_s)| (place(phase), now_s - since_s));
            for (phase, seconds) in self.phases_s.iter().enumerate().skip(at) {
                let (Some(middle), Some(long)) = (quantile(seconds, 0.5), quantile(seconds, 0.9)) else { continue };
                p50 += if phase == at { (middle - spent_s).max(0.0) } else { middle };
                squares += (long - middle).powi(2);
            }
        }
        Some(Eta { p50, p90: p50 + squares.sqrt() })
    }
}

fn place(phase: Phase) -> usize {
    ORDER.iter().position(|p| *p == phase).unwrap_or_default()
}

/// What a journal tells of each method's pace.
pub fn learned<'a>(events: impl IntoIterator<Item = &'a Event>) -> BTreeMap<String, Pace> {
    let mut paces: BTreeMap<String, Pace> = BTreeMap::new();
    let mut methods: BTreeMap<&str, &str> = BTreeMap::new();
    // One that was interrupted teaches nothing.
    let mut under_way: BTreeMap<&str, UnderWay> = BTreeMap::new();
    for event in events {
        let (Some(run), Ok(time)) = (event.run.as_deref(), event.time.parse::<jiff::Timestamp>()) else { continue };
        let now_s = time.as_millisecond() as f64 / 1e3;
        match (event.kind.as_str(), event.well.as_deref()) {
            (kind::RUN_ACCEPTED, _) => {
                methods.extend(event.data["method"].as_str().map(|method| (run, method)));
                under_way.clear();
            }
            (kind::SPECIMEN_PHASE, Some(well)) => {
                let Ok(phase) = serde_json::from_value::<Phase>(event.data["phase"].clone()) else { continue };
                under_way.iter_mut().filter(|(other, _)| **other != well).for_each(|(_, specimen)| specimen.leave(now_s));
                if phase == Phase::Load {
                    under_way.insert(well, UnderWay::at(now_s));
                }
                if let Some(specimen) = under_way.get_mut(well) {
                    specimen.enter(phase, now_s);
                }
            }
            // Its numbers were made from its frames, whenever that was.
            (kind::SPECIMEN_RECOVERED, Some(well)) => drop(under_way.remove(well)),
            (kind::SPECIMEN_DONE, Some(well)) => {
                if let (Some(specimen), Some(method)) = (under_way.remove(well), methods.get(run)) {
                    let rig_s = event.data["seconds"].as_f64().unwrap_or(now_s - specimen.began_s);
                    paces.entry((*method).to_owned()).or_default().learn(specimen, now_s, rig_s);
                }
            }
            _ => {}
        }
    }
    paces
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A specimen that loads for 2 s and turns for `revolve_s`.
    fn specimen(began_s: f64, revolve_s: f64) -> (UnderWay, f64) {
        let mut s = UnderWay::at(began_s);
        s.enter(Phase::Load, began_s);
        s.enter(Phase::Load, began_s + 1.0);
        s.enter(Phase::Revolve, began_s + 2.0);
        (s, began_s + 2.0 + revolve_s)
    }

    fn of(revolve_s: &[f64]) -> Pace {
        let mut pace = Pace::default();
        for seconds in revolve_s {
            let (s, ended_s) = specimen(0.0, *seconds);
            pace.learn(s, ended_s, ended_s);
        }
        pace
    }

    #[test]
    fn nothing_is_promised_before_the_first_specimen() {
        assert_eq!(Pace::default().remaining(None, 5, 0.0), None);
    }

    #[test]
    fn wells_that_wait_cost_the_median_and_their_spreads_add_in_squares() {
        let pace = of(&[8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 18.0]);
        assert_eq!(pace.remaining(None, 1, 0.0), Some(Eta { p50: 10.0, p90: 20.0 }));
        assert_eq!(pace.remaining(None, 4, 0.0), Some(Eta { p50: 40.0, p90: 60.0 }));
        assert_eq!(pace.remaining(None, 0, 0.0), Some(Eta { p50: 0.0, p90: 0.0 }));
    }

    #[test]
    fn of_the_specimen_under_way_only_what_is_left_counts() {
        let pace = of(&[8.0, 8.0]);
        let (turning, _) = specimen(100.0, 0.0);
        let left = |now_s: f64| pace.remaining(Some(&turning), 0, now_s).unwrap().p50;
        assert!((left(102.0) - 8.0).abs() < 1e-9, "it has just begun to turn");
        assert!((left(105.0) - 5.0).abs() < 1e-9);
        assert!(left(1000.0).abs() < f64::EPSILON, "late, but never less than nothing");
    }

    #[test]
    fn a_journal_teaches_each_method_and_an_interrupted_specimen_teaches_nothing() {
        let mut id = 0;
        let mut event = |kind: &str, second: u32, well: Option<&str>, data: serde_json::Value| {
            id += 1;
            let time = format!("2026-01-01T00:00:{second:02}.500Z");
            Event { id, time, kind: kind.into(), run: Some("r".into()), well: well.map(Into::into), data }
        };
        let phase = |phase: &str| serde_json::json!({ "phase": phase });
        let events = [
            event("run.accepted", 0, None, serde_json::json!({"method": "fast"})),
            event("specimen.phase", 1, Some("A01"), phase("load")),
            event("specimen.phase", 3, Some("A01"), phase("revolve")),
            event("specimen.phase", 20, Some("A01"), phase("load")),
            event("specimen.phase", 22, Some("A01"), phase("revolve")),
            event("specimen.done", 30, Some("A01"), serde_json::Value::Null),
            event("specimen.phase", 40, Some("A02"), phase("revolve")),
            event("specimen.done", 50, Some("A02"), serde_json::Value::Null),
            event("specimen.phase", 51, Some("A03"), phase("load")),
            event("specimen.recovered", 58, Some("A03"), serde_json::Value::Null),
            event("specimen.done", 58, Some("A03"), serde_json::Value::Null),
        ];
        let paces = learned(&events);
        assert_eq!(paces.keys().collect::<Vec<_>>(), ["fast"]);
        assert_eq!(paces["fast"], of(&[8.0]));
    }
}
