//! Messages of the plate-loader: a specimen is in the capillary, or was taken out.
//!
//! ```text
//! A02 requested ──► {A02, loaded} ──┬─ the run waits ───────────────► the run continues with A02
//!     │ (the request survives a     ├─ held, or about to continue ──► brought: it stays and is used when the run continues
//!     │  hold, a fault, a crash     └─ the run has ended ───────────► inside until {A02, not loaded}: no new run, plate not removable
//!     │  and the end of the run)
//!     └─ A01 is still inside: the loader exchanges both, so A01 is out
//! ```
//! A message takes effect once it is in the journal, whatever happened to the run since the request: the loader knows where the larva is.
//! "Taken out" while a driven sampler works takes effect when the work pauses.

use super::super::Refusal;
use carved_devices::sampler::{LoaderInterlock, Sampler};
use carved_records::{LoadedBy, NotNow, Report, RunOutcome, Situation, Specimens, Work, plate_map};

/// Who fills the capillary, and the channel to a worker that waits for the loader.
pub(super) struct Loader {
    interlock: LoaderInterlock,
    loaded_by: LoadedBy,
    brings_again: bool,
}

impl Loader {
    pub fn new(interlock: LoaderInterlock, sampler: &dyn Sampler) -> Self {
        let loaded_by = if sampler.waits_for_loader() { LoadedBy::Loader } else { LoadedBy::Sampler };
        Self { interlock, loaded_by, brings_again: sampler.brings_again() }
    }

    /// Whether a plate-loader fills the capillary. Otherwise a driven sampler does.
    pub fn fills_capillary(&self) -> bool {
        self.loaded_by == LoadedBy::Loader
    }

    /// Who fills the capillary.
    pub fn loaded_by(&self) -> LoadedBy {
        self.loaded_by
    }

    /// Whether a specimen can be brought again after it was taken out.
    pub fn brings_again(&self) -> bool {
        self.brings_again
    }

    /// Who fills the capillary, and what the run does.
    pub fn situation(&self, work: Work) -> Situation {
        Situation { loaded_by: self.loaded_by, brings_again: self.brings_again, work }
    }

    /// The channel on which a worker receives the loader's messages. Drops an earlier message.
    pub fn cleared_interlock(&self) -> LoaderInterlock {
        self.interlock.clear();
        self.interlock.clone()
    }

    /// Tells the worker that a specimen is in the capillary.
    pub fn say_loaded(&self, well: &str) {
        self.interlock.say_loaded(well);
    }

    /// The specimen that keeps a new run from starting. With a driven sampler the new run ejects first what is known to be inside. One that
    /// may still come would be taken for the first of the new run.
    pub fn keeps_run_out<'a>(&self, specimens: &'a Specimens) -> Option<Left<'a>> {
        let may_come = specimens.unknown().map(Left::MayCome);
        may_come.or_else(|| specimens.inside().filter(|_| self.fills_capillary()).map(Left::Inside))
    }

    #[cfg(test)]
    pub fn interlock(&self) -> &LoaderInterlock {
        &self.interlock
    }
}

/// A specimen of an ended run, by its well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Left<'a> {
    /// It is in the capillary.
    Inside(&'a str),
    /// A driven sampler was asked for it. It is in the capillary or may still come.
    MayCome(&'a str),
}

impl Left<'_> {
    /// What is the matter, and what a person does.
    pub fn words(self) -> (String, &'static str) {
        match self {
            Self::Inside(well) => (format!("the specimen of well {well} is still in the capillary"), "take it out and say so"),
            Self::MayCome(well) => (
                format!("the sampler was asked for the specimen of well {well} and may still bring it"),
                "take it out once it has come, then say that it is out. Say so too if it does not come",
            ),
        }
    }

    /// The refusal of a run.
    pub fn refusal(self, run: Option<&str>) -> Refusal {
        match self {
            Self::Inside(well) => capillary_full(run, well),
            Self::MayCome(well) => Refusal::MayStillCome { run: run.unwrap_or("RUN").to_owned(), well: well.to_owned() },
        }
    }
}

/// The refusal while another specimen is in the capillary.
pub(super) fn capillary_full(run: Option<&str>, inside: &str) -> Refusal {
    Refusal::CapillaryFull { run: run.unwrap_or("RUN").to_owned(), well: inside.to_owned() }
}

/// A message of the loader about the specimen of a well, together with the known state.
pub(super) struct LoaderMessage<'a> {
    /// The run that the message names.
    pub run: &'a str,
    pub well: &'a str,
    /// The newest run and its outcome.
    pub newest: Option<(&'a str, Option<RunOutcome>)>,
    pub specimens: &'a Specimens,
    /// Whether the run has this well.
    pub is_planned: bool,
    pub situation: Situation,
}

impl<'a> LoaderMessage<'a> {
    /// What the message says about a specimen that was brought.
    ///
    /// # Errors
    /// The message names another run, another specimen is inside, or this specimen was not requested.
    pub fn loaded(&self) -> Result<Report<'a>, Refusal> {
        let outcome = self.outcome_of_run()?;
        self.specimens.report_in(self.well, self.situation).map_err(|not_now| match not_now {
            NotNow::Unexpected if self.situation.work == Work::Over => Refusal::RunEnded { id: self.run.to_owned(), outcome },
            not_now => self.refusal(not_now),
        })
    }

    /// Whether the message says that a specimen is out while a driven sampler is at work. It takes effect when no work is in progress: until
    /// then the next specimen that the sampler brings would be taken for this one.
    pub fn is_taken_out_at_work(&self) -> bool {
        let is_at_work = self.situation.loaded_by == LoadedBy::Sampler && self.situation.work == Work::InProgress;
        is_at_work && self.is_planned && self.outcome_of_run().is_ok() && self.unloaded().is_err()
    }

    /// What the message says about a specimen that was taken out.
    ///
    /// # Errors
    /// The message names another run, this specimen cannot have been inside, or a worker uses it.
    pub fn unloaded(&self) -> Result<Report<'a>, Refusal> {
        self.outcome_of_run()?;
        self.specimens.report_out(self.well, self.is_planned, self.situation).map_err(|not_now| self.refusal(not_now))
    }

    /// The outcome of the run that the message names. It must be the newest run.
    fn outcome_of_run(&self) -> Result<Option<RunOutcome>, Refusal> {
        match self.newest {
            Some((newest, outcome)) if newest == self.run => Ok(outcome),
            newest => Err(Refusal::UnknownRun { id: self.run.to_owned(), newest: newest.map(|(id, _)| id.to_owned()) }),
        }
    }

    /// The refusal of a message. It names the expected message.
    fn refusal(&self, not_now: NotNow) -> Refusal {
        let run = self.run;
        if let NotNow::Full(inside) = not_now {
            return capillary_full(Some(run), inside);
        }
        let say = |well: &str, loaded: bool| format!("PUT /v1/runs/{run}/wells/{well} {{\"loaded\": {loaded}}}");
        let requests = self.specimens.requests(self.situation);
        let instead = match (requests.bring, requests.take_out, self.specimens.inside()) {
            _ if self.situation.loaded_by == LoadedBy::Sampler && self.situation.work == Work::InProgress => {
                "the instrument uses the sampler; hold the run, and say it again once the state is Held".to_owned()
            }
            (Some(next), ..) => format!("that of well {next} is waited for; once it is in the capillary, say {}", say(next, true)),
            (None, Some(inside), _) => format!("that of well {inside} is to be taken out; once it is, say {}", say(inside, false)),
            (None, None, Some(inside)) => format!("that of well {inside} is in the capillary; wait until plate.needs asks for one"),
            (None, None, None) => "none is in the capillary, as far as is known; wait until plate.needs asks for one".to_owned(),
        };
        let well = self.well;
        let instead = match plate_map::well_of(well) {
            Some(name) if name != well => format!("{well} is not a well, write {name}; {instead}"),
            Some(_) if !self.is_planned => format!("{well} is not in this run; {instead}"),
            Some(_) => instead,
            None => format!("{well} is not a well; {instead}"),
        };
        Refusal::UnexpectedWell { run: run.to_owned(), well: well.to_owned(), instead }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{EventBody, EventData, Phase, PhaseEntered, RunState, WellLoaded};

    fn after(events: &[(&str, EventData)]) -> RunState {
        let mut run = RunState::new("r");
        for (well, data) in events {
            run.apply(&EventBody { time: String::new(), run: Some("r".into()), well: Some((*well).into()), data: data.clone() });
        }
        run
    }

    fn inside(well: &str) -> (&str, EventData) {
        (well, EventData::SpecimenPhase(PhaseEntered { phase: Phase::Eject, in_capillary: true }))
    }

    fn message<'a>(well: &'a str, state: &'a RunState, work: Work) -> LoaderMessage<'a> {
        LoaderMessage {
            run: "r",
            well,
            newest: Some(("r", None)),
            specimens: state.specimens(),
            is_planned: true,
            situation: Situation { loaded_by: LoadedBy::Loader, brings_again: true, work },
        }
    }

    fn is_full(answer: &Result<Report, Refusal>, by: &str) -> bool {
        matches!(answer, Err(Refusal::CapillaryFull { well, .. }) if well == by)
    }

    #[test]
    fn specimens_are_exchanged_in_one_go_while_the_run_is_there_and_one_by_one_after_its_end() {
        let state = after(&[inside("A01"), ("A02", EventData::WellAwaited)]);
        let exchanged = message("A02", &state, Work::InProgress).loaded();
        assert_eq!(exchanged, Ok(Report::News { in_place_of: Some("A01") }));
        assert!(is_full(&message("A02", &state, Work::Over).loaded(), "A01"), "after the end of the run");
        assert!(is_full(&message("A01", &state, Work::InProgress).loaded(), "A01"), "it is to be taken out");
    }

    #[test]
    fn a_specimen_that_nobody_asked_for_is_refused_with_the_message_that_is_missing() {
        let state = after(&[("A02", EventData::WellAwaited)]);
        let waits = Work::InProgress;
        let Err(Refusal::UnexpectedWell { instead, .. }) = message("A07", &state, waits).loaded() else { panic!("it is accepted") };
        assert!(instead.contains("wells/A02 {\"loaded\": true}"), "{instead}");
        assert!(matches!(message("A07", &state, Work::Over).loaded(), Err(Refusal::RunEnded { .. })));
        let other = LoaderMessage { newest: Some(("q", None)), ..message("A02", &state, waits) };
        assert_eq!(other.loaded(), Err(Refusal::UnknownRun { id: "r".into(), newest: Some("q".into()) }));
    }

    #[test]
    fn a_message_that_is_repeated_changes_nothing() {
        let brought = after(&[("A01", EventData::WellAwaited), ("A01", EventData::WellLoaded(WellLoaded { in_place_of: None }))]);
        let none = Work::Paused;
        assert_eq!(message("A01", &brought, none).loaded(), Ok(Report::Known));
        assert_eq!(message("A01", &brought, none).unloaded(), Ok(Report::News { in_place_of: None }));
        let out = after(&[inside("A01"), ("A01", EventData::WellUnloaded)]);
        assert_eq!(message("A01", &out, none).unloaded(), Ok(Report::Known));
        assert!(message("A02", &out, none).unloaded().is_err(), "it was never inside");
    }

    /// The run does not know of it: it came after its time, unasked, or after the end of the run.
    #[test]
    fn a_specimen_can_be_out_that_the_sampler_may_have_brought() {
        let state = after(&[("A01", EventData::SpecimenPhase(PhaseEntered { phase: Phase::Load, in_capillary: false }))]);
        let driven = |work| Situation { loaded_by: LoadedBy::Sampler, brings_again: false, work };
        let of = |well, work| LoaderMessage { situation: driven(work), ..message(well, &state, work) };
        for work in [Work::Paused, Work::Over] {
            assert_eq!(of("A01", work).unloaded(), Ok(Report::News { in_place_of: None }), "late");
            assert_eq!(of("A02", work).unloaded(), Ok(Report::News { in_place_of: None }), "unasked");
            assert!(LoaderMessage { is_planned: false, ..of("H12", work) }.unloaded().is_err());
        }
        let asked = of("A01", Work::InProgress);
        assert!(asked.unloaded().is_err() && asked.is_taken_out_at_work(), "the next one would be A01");
        assert!(!LoaderMessage { is_planned: false, ..of("H12", Work::InProgress) }.is_taken_out_at_work());
        assert!(!message("A01", &state, Work::InProgress).is_taken_out_at_work(), "a loader says what it brings");
    }

    #[test]
    fn a_specimen_that_a_worker_is_at_cannot_be_out() {
        let turning = ("A01", EventData::SpecimenPhase(PhaseEntered { phase: Phase::Revolve, in_capillary: true }));
        let state = after(&[turning]);
        assert!(message("A01", &state, Work::InProgress).unloaded().is_err());
        assert_eq!(message("A01", &state, Work::Paused).unloaded(), Ok(Report::News { in_place_of: None }));
        let leaves = after(&[inside("A01")]);
        assert_eq!(message("A01", &leaves, Work::InProgress).unloaded(), Ok(Report::News { in_place_of: None }));
    }
}
