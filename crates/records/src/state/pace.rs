//! Estimates how long a run still takes, from earlier specimens on this instrument.
//!
//! ```text
//! events ──► seconds per phase of the newest finished specimens ─┬─ the specimen in progress: its remaining phases, less the
//!                                                                │  time already spent in the current phase
//!                                                                └─ waiting wells: whole specimens, including skipped ones
//! ```
//! The medians of the parts are added. Their spreads are added in squares, because long specimens are independent. The times are those of
//! the events, so a restart gets the same estimate as the live run.

use crate::{EventBody, EventData, Phase, SpecimenOutcome};
use carved_core::statistics::upper_quantile;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};

/// Estimated time until the end of the run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Eta {
    /// Median, s.
    pub p50: f64,
    /// In nine of ten runs the time is shorter, s.
    pub p90: f64,
}

/// Number of specimens that are remembered per method.
const KEPT: usize = 200;

/// The order of a specimen's phases.
const ORDER: [Phase; 8] =
    [Phase::Load, Phase::Position, Phase::Detect, Phase::Revolve, Phase::Reconstruct, Phase::Measure, Phase::Eject, Phase::Wash];

/// Durations of the specimens of one method, oldest first.
#[derive(Debug, Clone, Default, PartialEq)]
struct Pace {
    phases_s: [VecDeque<f64>; ORDER.len()],
    wells_s: VecDeque<f64>,
}

/// A specimen in progress. Times in s since 1970.
#[derive(Debug, Clone, Default, PartialEq)]
struct UnderWay {
    began_s: f64,
    phase: Option<(Phase, f64)>,
    phases: Vec<(Phase, f64)>,
}

/// Durations of the specimens of each method, and of the specimens in progress so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Paces {
    methods: BTreeMap<String, Pace>,
    /// The method of the newest run.
    method: String,
    /// By well.
    under_way: BTreeMap<String, UnderWay>,
}

fn keep(list: &mut VecDeque<f64>, value: f64) {
    if list.len() == KEPT {
        list.pop_front();
    }
    list.push_back(value);
}

fn quantile(values: &VecDeque<f64>, share: f64) -> Option<f64> {
    upper_quantile(values.iter().copied().collect(), share)
}

impl UnderWay {
    fn at(now_s: f64) -> Self {
        Self { began_s: now_s, ..Self::default() }
    }

    /// The specimen enters a phase.
    fn enter(&mut self, phase: Phase, now_s: f64) {
        // A wait for the loader is reported twice. The phase continues.
        if self.phase.is_some_and(|(now, _)| now == phase) {
            return;
        }
        self.leave(now_s);
        self.phase = Some((phase, now_s));
    }

    /// The specimen no longer uses the instrument.
    fn leave(&mut self, now_s: f64) {
        if let Some((phase, since_s)) = self.phase.take() {
            // The wall clock may be set back.
            self.phases.push((phase, (now_s - since_s).max(0.0)));
        }
    }
}

impl Pace {
    /// Adds a finished specimen. `had_s`: how long it used the instrument, which is how long the next one waits.
    fn learn(&mut self, mut specimen: UnderWay, now_s: f64, had_s: f64) {
        specimen.leave(now_s);
        for (phase, seconds) in specimen.phases {
            keep(&mut self.phases_s[place(phase)], seconds);
        }
        keep(&mut self.wells_s, had_s);
    }

    /// Time until the specimen in progress and `waiting` further wells are done. `None` before the first specimen on this instrument.
    fn remaining(&self, specimen: Option<&UnderWay>, waiting: u32, now_s: f64) -> Option<Eta> {
        let well = (quantile(&self.wells_s, 0.5)?, quantile(&self.wells_s, 0.9)?);
        let (mut p50, mut squares) = (well.0 * f64::from(waiting), (well.1 - well.0).powi(2) * f64::from(waiting));
        if let Some(specimen) = specimen {
            let (at, spent_s) = specimen.phase.map_or((0, 0.0), |(phase, since_s)| (place(phase), (now_s - since_s).max(0.0)));
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

impl Paces {
    /// Time until `waiting` wells are done, and the specimen of `well` if it is in progress. `None` before the first specimen of this
    /// method.
    pub fn remaining(&self, method: &str, well: Option<&str>, waiting: u32, now: Timestamp) -> Option<Eta> {
        let specimen = well.and_then(|well| self.under_way.get(well));
        self.methods.get(method)?.remaining(specimen, waiting, seconds(now))
    }

    pub(super) fn apply(&mut self, event: &EventBody) {
        let Ok(now) = event.time.parse::<Timestamp>() else { return };
        let now_s = seconds(now);
        match (&event.data, event.well.as_deref()) {
            (EventData::RunAccepted(accepted), _) => {
                self.method.clone_from(&accepted.method);
                self.under_way.clear();
            }
            // Specimens that were interrupted or held do not count: they begin again, or their time contains the hold.
            (EventData::RunInterrupted(_) | EventData::RunHeld(_), _) => self.under_way.clear(),
            (EventData::SpecimenPhase(entered), Some(well)) => {
                // One specimen uses the instrument. The numbers of the others are computed meanwhile.
                self.under_way.iter_mut().filter(|(other, _)| *other != well).for_each(|(_, specimen)| specimen.leave(now_s));
                if entered.phase == Phase::Load {
                    self.under_way.entry(well.to_owned()).or_insert_with(|| UnderWay::at(now_s));
                }
                if let Some(specimen) = self.under_way.get_mut(well) {
                    specimen.enter(entered.phase, now_s);
                }
            }
            // Its numbers were computed from stored frames at another time.
            (EventData::SpecimenRecovered | EventData::SpecimenInterrupted(_), Some(well)) => drop(self.under_way.remove(well)),
            (EventData::SpecimenDone(done), Some(well)) => {
                let specimen = self.under_way.remove(well);
                if let Some(specimen) = specimen.filter(|_| done.result.outcome != Some(SpecimenOutcome::Failed)) {
                    let had_s = done.seconds.unwrap_or((now_s - specimen.began_s).max(0.0));
                    self.methods.entry(self.method.clone()).or_default().learn(specimen, now_s, had_s);
                }
            }
            _ => {}
        }
    }
}

fn seconds(time: Timestamp) -> f64 {
    time.as_millisecond() as f64 / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PhaseEntered, PlannedWell, RunAccepted, SpecimenDone, SpecimenKind, WellStatus};

    /// A specimen that loads for 2 s and then turns for `revolve_s`.
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

    fn event(second: u32, well: Option<&str>, data: EventData) -> EventBody {
        let time = format!("2026-01-01T00:00:{second:02}.500Z");
        EventBody { time, run: Some("r".into()), well: well.map(Into::into), data }
    }

    fn phase(second: u32, well: &str, phase: Phase) -> EventBody {
        event(second, Some(well), EventData::SpecimenPhase(PhaseEntered { phase, in_capillary: false }))
    }

    fn done(second: u32, well: &str, outcome: SpecimenOutcome) -> EventBody {
        let mut result = WellStatus::pending(&PlannedWell::new(well, SpecimenKind::Larva, None));
        result.end(outcome, None);
        event(second, Some(well), EventData::SpecimenDone(Box::new(SpecimenDone { result, times: None, seconds: None })))
    }

    fn after(events: &[EventBody]) -> Paces {
        let mut paces = Paces::default();
        for event in events {
            paces.apply(event);
        }
        paces
    }

    #[test]
    fn each_method_is_learned_from_specimens_that_were_loaded_and_ended() {
        let accepted = RunAccepted { plate_barcode: "P".into(), method: "fast".into(), ..RunAccepted::default() };
        let events = [
            event(0, None, EventData::RunAccepted(accepted)),
            phase(1, "A01", Phase::Load),
            phase(3, "A01", Phase::Revolve),
            event(
                4,
                Some("A01"),
                EventData::SpecimenInterrupted(crate::SpecimenInterrupted {
                    reason: String::new(),
                    policy: crate::Interrupted::Redo,
                    kept: false,
                }),
            ),
            phase(20, "A01", Phase::Load),
            phase(22, "A01", Phase::Revolve),
            done(30, "A01", SpecimenOutcome::Succeeded),
            phase(40, "A02", Phase::Revolve),
            done(50, "A02", SpecimenOutcome::Succeeded),
            phase(51, "A03", Phase::Load),
            event(58, Some("A03"), EventData::SpecimenRecovered),
            done(58, "A03", SpecimenOutcome::Succeeded),
            phase(59, "A04", Phase::Load),
            done(59, "A04", SpecimenOutcome::Failed),
        ];
        let paces = after(&events);
        assert_eq!(paces.methods.keys().collect::<Vec<_>>(), ["fast"]);
        assert_eq!(paces.methods["fast"], of(&[8.0]));
        let now = "2026-01-01T00:01:00Z".parse().unwrap();
        assert_eq!(paces.remaining("fast", None, 2, now), Some(Eta { p50: 20.0, p90: 20.0 }));
        assert_eq!(paces.remaining("slow", None, 2, now), None);
    }

    #[test]
    fn the_time_of_a_hold_is_not_learned() {
        let held = crate::RunHeld { by: crate::HeldBy::Operator, code: None, cause: None };
        let events = [
            phase(1, "A01", Phase::Load),
            event(2, None, EventData::RunHeld(held)),
            phase(40, "A01", Phase::Load),
            phase(42, "A01", Phase::Revolve),
            done(50, "A01", SpecimenOutcome::Succeeded),
        ];
        assert_eq!(after(&events).methods[""], of(&[8.0]));
        assert!(after(&events[..2]).under_way.is_empty(), "a held specimen would be counted twice");
    }

    #[test]
    fn a_clock_that_is_set_back_takes_no_time_away() {
        let back = [phase(10, "A01", Phase::Load), phase(2, "A01", Phase::Revolve), done(5, "A01", SpecimenOutcome::Succeeded)];
        let paces = after(&back);
        assert_eq!(paces.methods[""].wells_s, [0.0]);
        assert!(paces.methods[""].phases_s.iter().flatten().all(|s| *s >= 0.0));
    }
}
