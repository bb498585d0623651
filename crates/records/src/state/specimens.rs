//! The specimens of a run: one state machine each ([`SpecimenState`]), and what is asked of them together.
//!
//! ```text
//! Event ──► the specimen of its well: one SpecimenEvent ──► another specimen came in, or is asked for: told to all others
//!
//!           requests        what the loader is asked to take out and to bring
//!           must_leave_first, continued_with, unknown     what a worker begins with
//!           report_in, report_out      whether a report about a specimen is news, known, or cannot be
//! ```
//! One specimen at most is in the capillary: when one comes in, the one before is out.

use super::specimen::{Specimen, SpecimenEvent, SpecimenState};
use crate::fault_table;
use crate::{EventBody, EventData, LoadedBy, Phase};
use std::collections::BTreeMap;

/// The specimens of the newest run, by well. One of them may be left from the run before it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Specimens(BTreeMap<String, Specimen>);

/// What the run does now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// A worker uses the instrument.
    InProgress,
    /// The run has no worker: it is held, waits for a specimen to be taken out, or ends.
    Paused,
    /// The run has ended.
    Over,
}

/// Who fills the capillary, and what the run does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Situation {
    /// Who fills the capillary.
    pub loaded_by: LoadedBy,
    /// Whether a specimen can be brought again after it was taken out.
    pub brings_again: bool,
    /// What the run does now.
    pub work: Work,
}

/// What the loader is asked for: first the specimen to take out, then the one to bring, by well.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Requests<'a> {
    /// The specimen to take out.
    pub take_out: Option<&'a str>,
    /// The specimen to bring.
    pub bring: Option<&'a str>,
}

/// An accepted report about a specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report<'a> {
    /// It is known already. Nothing changes.
    Known,
    /// It is new. `in_place_of`: the specimen that was inside until now, which is out.
    News {
        /// Its well.
        in_place_of: Option<&'a str>,
    },
}

/// Why a report cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotNow<'a> {
    /// The specimen of this well must be taken out first.
    Full(&'a str),
    /// Nobody asked for this specimen, it was never inside, or a worker uses it.
    Unexpected,
}

impl Specimens {
    /// No specimen of the run was asked for.
    pub const fn none() -> Self {
        Self(BTreeMap::new())
    }

    /// The specimens of a run that begins. `left`: the well of an earlier run whose specimen is still inside.
    pub(super) fn of_new_run(left: Option<&str>) -> Self {
        let mut specimens = Self::none();
        if let Some(left) = left {
            specimens.happens(left, SpecimenEvent::LeftBefore);
        }
        specimens
    }

    /// The specimen of a well.
    pub fn of(&self, well: &str) -> Specimen {
        self.0.get(well).copied().unwrap_or(Specimen::ABSENT)
    }

    /// The specimens to which something has happened, by well.
    pub fn iter(&self) -> impl Iterator<Item = (&str, Specimen)> {
        self.0.iter().map(|(well, specimen)| (well.as_str(), *specimen))
    }

    fn find(&self, is_it: impl Fn(SpecimenState) -> bool) -> Option<&str> {
        self.iter().find(|(_, specimen)| is_it(specimen.state())).map(|(well, _)| well)
    }

    /// The well whose specimen is inside, or may be inside or on its way after a restart or the end of the run. `None` if the capillary is empty as far as is known.
    pub fn inside(&self) -> Option<&str> {
        self.find(SpecimenState::is_inside).or_else(|| self.unknown())
    }

    /// The well whose specimen was requested from the loader and is not brought yet.
    pub fn asked_for(&self) -> Option<&str> {
        self.find(SpecimenState::is_asked_for)
    }

    /// The well of a specimen that is inside and that the run continues with: the loader has just brought it, or a fault of the instrument
    /// has left it inside.
    pub fn continued_with(&self) -> Option<&str> {
        self.find(SpecimenState::is_continued_with)
    }

    /// The well for which a driven sampler was asked before a restart or the end of the run. Its specimen is inside or still on its way.
    pub fn unknown(&self) -> Option<&str> {
        self.find(|state| state == SpecimenState::Unknown)
    }

    /// The well whose specimen is inside, or is being loaded by a driven sampler.
    pub fn inside_or_loading(&self) -> Option<&str> {
        self.inside().or_else(|| self.find(|state| state == SpecimenState::Loading))
    }

    /// The well for which a driven sampler was asked before: its load was cut short, by a restart or by a fault. A sampler that was opened
    /// again meanwhile does not remember it.
    pub fn asked_before(&self) -> Option<&str> {
        self.unknown().or_else(|| self.find(|state| state == SpecimenState::Coming))
    }

    /// The well whose specimen must leave before a worker begins. A loader exchanges a measured specimen for the next one, a driven sampler
    /// ejects it first.
    pub fn must_leave_first(&self, loaded_by: LoadedBy) -> Option<&str> {
        self.find(|state| match state {
            SpecimenState::WorkedOn | SpecimenState::Leaving | SpecimenState::OfEarlierRun | SpecimenState::Left => true,
            SpecimenState::Measured => loaded_by == LoadedBy::Sampler,
            _ => false,
        })
    }

    /// The wells with an attempt in progress, sorted.
    pub fn begun(&self) -> Vec<&str> {
        self.iter().filter(|(_, specimen)| specimen.state().is_begun()).map(|(well, _)| well).collect()
    }

    /// The wells whose specimens have come in this attempt, and which an interruption concerns, sorted.
    pub fn worked_on(&self) -> impl Iterator<Item = (&str, Specimen)> {
        self.iter().filter(|(_, specimen)| specimen.state().is_worked_on())
    }

    /// Whether the specimen of a well was inside at any time of this run.
    pub fn has_held(&self, well: &str) -> bool {
        self.of(well).has_come()
    }

    /// What the loader is asked for. After the end of a run nobody ejects what is still inside, also with a driven sampler.
    pub fn requests(&self, Situation { loaded_by, work, .. }: Situation) -> Requests<'_> {
        match work {
            Work::InProgress => {
                let bring = self.find(|state| state == SpecimenState::Awaited);
                Requests { take_out: self.inside().filter(|_| bring.is_some()), bring }
            }
            Work::Paused => {
                let take_out = self.must_leave_first(loaded_by).filter(|_| loaded_by == LoadedBy::Loader);
                Requests { take_out, bring: None }
            }
            Work::Over => Requests { take_out: self.inside(), bring: None },
        }
    }

    /// A report that the specimen of this well is inside. It is one of those that were asked for.
    ///
    /// # Errors
    /// Another specimen must be taken out first, or nobody asked for this one.
    pub fn report_in(&self, well: &str, situation: Situation) -> Result<Report<'_>, NotNow<'_>> {
        let specimen = self.of(well).state();
        if specimen.is_continued_with() {
            return Ok(Report::Known);
        }
        let asked_for = specimen.is_asked_for();
        let Requests { take_out, bring } = self.requests(situation);
        if let Some(inside) = take_out
            // During a run the loader may exchange both specimens at once. After its end each specimen needs its own report.
            && (inside == well || if situation.work == Work::Over { asked_for } else { !asked_for && bring.is_none() })
        {
            return Err(NotNow::Full(inside));
        }
        if self.inside() == Some(well) {
            return Ok(Report::Known);
        }
        if asked_for { Ok(Report::News { in_place_of: self.inside() }) } else { Err(NotNow::Unexpected) }
    }

    /// A report that the specimen of this well is out. `is_planned`: the run has this well.
    ///
    /// # Errors
    /// It cannot have been inside, or a worker uses it.
    pub fn report_out(&self, well: &str, is_planned: bool, situation: Situation) -> Result<Report<'_>, NotNow<'_>> {
        let Situation { loaded_by, brings_again, work } = situation;
        let specimen = self.of(well);
        // The sampler is asked for it. If it brings the next one of its plate, that one would be taken for it.
        let is_mistaken = specimen.state() == SpecimenState::Unknown && !brings_again;
        let is_used = work == Work::InProgress && (specimen.state().may_be_worked_on() || is_mistaken);
        if self.inside() == Some(well) {
            return if is_used { Err(NotNow::Unexpected) } else { Ok(Report::News { in_place_of: None }) };
        }
        // It came late or unasked. While the sampler is asked for one, the next that comes would be taken for this one. A loader reports
        // what it brings.
        let may_have_come = loaded_by == LoadedBy::Sampler && work != Work::InProgress && is_planned;
        // A repeated report, or a specimen that another one has replaced. A sampler may have brought it once more meanwhile.
        if specimen.has_come() && !(may_have_come && specimen.state().may_come()) {
            return Ok(Report::Known);
        }
        if may_have_come { Ok(Report::News { in_place_of: None }) } else { Err(NotNow::Unexpected) }
    }

    /// Applies an event of the run.
    pub(super) fn apply(&mut self, event: &EventBody) {
        let of_well = match &event.data {
            EventData::RunHeld(_) => return self.happens_to_all(SpecimenEvent::Held),
            EventData::RunEnded(ended) => {
                self.happens_to_all(SpecimenEvent::Ended);
                if ended.loaded_by == Some(LoadedBy::Sampler) {
                    self.happens_to_all(SpecimenEvent::EndedWhileAsked);
                }
                return;
            }
            EventData::FaultRaised(fault) if fault.code == fault_table::SAMPLER_FAILED.code => {
                return self.happens_to_all(SpecimenEvent::SamplerFailed);
            }
            EventData::RunInterrupted(interrupted) => {
                let Some(loaded_by) = interrupted.loaded_by else { return };
                return self.happens_to_all(match loaded_by {
                    LoadedBy::Loader => SpecimenEvent::RestartedWithLoader,
                    LoadedBy::Sampler => SpecimenEvent::RestartedWithSampler,
                });
            }
            EventData::WellAwaited => SpecimenEvent::AskedFor,
            EventData::WellLoaded(_) => SpecimenEvent::ReportedIn,
            EventData::WellUnloaded => SpecimenEvent::ReportedOut,
            EventData::SpecimenPhase(entered) => match (entered.phase, entered.in_capillary) {
                (Phase::Load, _) => SpecimenEvent::LoadBegun,
                (_, false) => SpecimenEvent::Out,
                (Phase::Eject | Phase::Wash, true) => SpecimenEvent::EjectBegun,
                (_, true) => SpecimenEvent::WorkBegun,
            },
            EventData::SpecimenRecovering(_) | EventData::SpecimenRecovered => SpecimenEvent::NumbersFollow,
            EventData::SpecimenDone(_) => SpecimenEvent::Done,
            EventData::SpecimenInterrupted(interrupted) if interrupted.kept => SpecimenEvent::StaysInside,
            EventData::SpecimenInterrupted(_) | EventData::WellSkipped(_) => SpecimenEvent::Interrupted,
            _ => return,
        };
        if let Some(well) = &event.well {
            self.happens(well, of_well);
        }
    }

    /// Something happens to the specimen of a well, and with it to the others.
    fn happens(&mut self, well: &str, event: SpecimenEvent) {
        let before = self.of(well);
        let after = before.after(event);
        self.0.insert(well.to_owned(), after);
        if after.state().is_inside() && !before.state().is_inside() {
            self.happens_to_others(well, SpecimenEvent::AnotherCameIn);
        }
        if matches!(event, SpecimenEvent::LoadBegun | SpecimenEvent::AskedFor) {
            self.happens_to_others(well, SpecimenEvent::AnotherAskedFor);
        }
        self.forget_absent();
    }

    fn happens_to_others(&mut self, well: &str, event: SpecimenEvent) {
        self.0.iter_mut().filter(|(other, _)| *other != well).for_each(|(_, specimen)| *specimen = specimen.after(event));
    }

    fn happens_to_all(&mut self, event: SpecimenEvent) {
        self.0.values_mut().for_each(|specimen| *specimen = specimen.after(event));
        self.forget_absent();
    }

    fn forget_absent(&mut self) {
        self.0.retain(|_, specimen| *specimen != Specimen::ABSENT);
    }
}

#[cfg(test)]
mod tests;
