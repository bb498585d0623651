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

use super::super::Refusal;
use super::handling::Handling;
use crate::api::RunOutcome;
use carved_devices::sampler::{LoaderInterlock, Sampler};
use carved_records::{Capillary, WellLoaded, plate_map};

/// Who fills the capillary, and the channel to a worker that waits for the loader.
pub(super) struct Loader {
    interlock: LoaderInterlock,
    fills_capillary: bool,
    brings_again: bool,
    /// The sampler's sensor shows a specimen that no run requested.
    unexpected: bool,
}

/// The reading of the sampler's sensor between runs, while the capillary should be empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WireReading {
    /// A specimen that no run requested is in the capillary.
    pub unexpected: bool,
    /// The reading differs from the previous one.
    pub is_news: bool,
}

impl Loader {
    pub fn new(interlock: LoaderInterlock, sampler: &dyn Sampler) -> Self {
        Self { interlock, fills_capillary: sampler.waits_for_loader(), brings_again: sampler.brings_again(), unexpected: false }
    }

    /// Whether a plate-loader fills the capillary. Otherwise a driven sampler does.
    pub fn fills_capillary(&self) -> bool {
        self.fills_capillary
    }

    /// Whether a specimen can be brought again after it was taken out.
    pub fn brings_again(&self) -> bool {
        self.brings_again
    }

    /// Whether a specimen that no run requested is in the capillary.
    pub fn has_unexpected(&self) -> bool {
        self.unexpected
    }

    /// A run begins. From now on a specimen in the capillary belongs to the run.
    pub fn begin_run(&mut self) {
        self.unexpected = false;
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

    /// The well whose specimen keeps a new run from starting. `None` with a driven sampler: the new run ejects the specimen first.
    pub fn keeps_run_out<'a>(&self, capillary: &'a Capillary) -> Option<&'a str> {
        capillary.inside().filter(|_| self.fills_capillary)
    }

    /// The requests to the loader: the specimen to take out, then the specimen to bring. After the end of a run nobody ejects a specimen
    /// that is still inside, also with a driven sampler.
    pub fn requests(capillary: &Capillary, run: Option<&Handling>) -> (Option<String>, Option<String>) {
        let left = capillary.inside().map(str::to_owned);
        match run {
            Some(run) => match run.awaited() {
                Some(next) => (left, Some(next.to_owned())),
                None => (run.take_out().map(str::to_owned), None),
            },
            None => (left, None),
        }
    }

    /// Notes a reading of the sampler's sensor.
    pub fn read_wire(&mut self, unexpected: bool) -> WireReading {
        let before = std::mem::replace(&mut self.unexpected, unexpected);
        WireReading { unexpected, is_news: before != unexpected }
    }

    #[cfg(test)]
    pub fn interlock(&self) -> &LoaderInterlock {
        &self.interlock
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
    pub capillary: &'a Capillary,
    /// Whether the run has this well.
    pub is_planned: bool,
    /// What the run wants moved. `None` after the end of the run.
    pub wanted: Option<&'a Handling>,
    pub bringer: Bringer,
}

/// Who brings the specimens of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bringer {
    Loader,
    /// A driven sampler. `is_asked`: a worker uses it now.
    Sampler {
        is_asked: bool,
    },
}

impl LoaderMessage<'_> {
    /// The event of a specimen that was brought. `None` if this is known already.
    ///
    /// # Errors
    /// The message names another run, another specimen is inside, or this specimen was not requested.
    pub fn loaded(&self) -> Result<Option<WellLoaded>, Refusal> {
        let outcome = self.outcome_of_run()?;
        // A repeated message.
        if self.capillary.brought() == Some(self.well) {
            return Ok(None);
        }
        let asked_for = self.capillary.asked_for() == Some(self.well);
        let waits_for_another = self.wanted.is_some_and(|wanted| wanted.awaited().is_some());
        if let Some(inside) = self.to_be_taken_out()
            // During a run the loader may exchange both specimens at once. After its end each specimen needs its own message.
            && (inside == self.well || if self.wanted.is_none() { asked_for } else { !asked_for && !waits_for_another })
        {
            return Err(capillary_full(Some(self.run), inside));
        }
        if self.capillary.inside() == Some(self.well) {
            return Ok(None);
        }
        if !asked_for {
            let ended = Refusal::RunEnded { id: self.run.to_owned(), outcome };
            return Err(if self.wanted.is_none() { ended } else { self.unexpected() });
        }
        // A loader that exchanges specimens reports only the new one. The previous one is out.
        Ok(Some(WellLoaded { in_place_of: self.capillary.inside().map(str::to_owned) }))
    }

    /// Whether the specimen was taken out just now. `false` if that is known already. `worked_on`: the well whose specimen a worker uses
    /// and does not eject.
    ///
    /// # Errors
    /// The message names another run, this specimen cannot have been inside, or the worker uses it.
    pub fn unloaded(&self, worked_on: Option<&str>) -> Result<bool, Refusal> {
        self.outcome_of_run()?;
        if self.capillary.inside() == Some(self.well) {
            return if worked_on == Some(self.well) { Err(self.unexpected()) } else { Ok(true) };
        }
        // A repeated message, or a specimen that another one has replaced.
        if self.capillary.has_held(self.well) {
            return Ok(false);
        }
        // It came late or unasked. While the sampler is asked for one, the next that comes would be taken for this one. A loader reports
        // what it brings.
        if self.bringer == (Bringer::Sampler { is_asked: false }) && self.is_planned { Ok(true) } else { Err(self.unexpected()) }
    }

    /// The outcome of the run that the message names. It must be the newest run.
    fn outcome_of_run(&self) -> Result<Option<RunOutcome>, Refusal> {
        match self.newest {
            Some((newest, outcome)) if newest == self.run => Ok(outcome),
            newest => Err(Refusal::UnknownRun { id: self.run.to_owned(), newest: newest.map(|(id, _)| id.to_owned()) }),
        }
    }

    /// The well whose specimen must be taken out now.
    fn to_be_taken_out(&self) -> Option<&str> {
        let inside = self.capillary.inside();
        match self.wanted {
            Some(wanted) => wanted.take_out().or_else(|| inside.filter(|_| wanted.awaited().is_some())),
            None => inside,
        }
    }

    /// Refuses a message about the wrong well. The refusal names the expected message.
    fn unexpected(&self) -> Refusal {
        let run = self.run;
        let say = |well: &str, loaded: bool| format!("PUT /v1/runs/{run}/wells/{well} {{\"loaded\": {loaded}}}");
        let awaited = self.wanted.and_then(Handling::awaited);
        let instead = match (awaited, self.to_be_taken_out(), self.capillary.inside()) {
            _ if self.bringer == (Bringer::Sampler { is_asked: true }) => {
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
    use carved_records::{EventBody, EventData, Phase, PhaseEntered, RunState};

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

    fn message<'a>(well: &'a str, state: &'a RunState, wanted: Option<&'a Handling>) -> LoaderMessage<'a> {
        LoaderMessage {
            run: "r",
            well,
            newest: Some(("r", None)),
            capillary: state.capillary(),
            is_planned: true,
            wanted,
            bringer: Bringer::Loader,
        }
    }

    fn is_full(answer: Result<Option<WellLoaded>, Refusal>, by: &str) -> bool {
        matches!(answer, Err(Refusal::CapillaryFull { well, .. }) if well == by)
    }

    #[test]
    fn specimens_are_exchanged_in_one_go_while_the_run_is_there_and_one_by_one_after_its_end() {
        let state = after(&[inside("A01"), ("A02", EventData::WellAwaited)]);
        let mut waits = Handling::default();
        waits.await_specimen("A02");
        let exchanged = message("A02", &state, Some(&waits)).loaded();
        assert_eq!(exchanged, Ok(Some(WellLoaded { in_place_of: Some("A01".into()) })));
        assert!(is_full(message("A02", &state, None).loaded(), "A01"), "after the end of the run");
        assert!(is_full(message("A01", &state, Some(&waits)).loaded(), "A01"), "it is to be taken out");
    }

    #[test]
    fn a_specimen_that_nobody_asked_for_is_refused_with_the_message_that_is_missing() {
        let state = after(&[("A02", EventData::WellAwaited)]);
        let mut waits = Handling::default();
        waits.await_specimen("A02");
        let Err(Refusal::UnexpectedWell { instead, .. }) = message("A07", &state, Some(&waits)).loaded() else { panic!("it is accepted") };
        assert!(instead.contains("wells/A02 {\"loaded\": true}"), "{instead}");
        assert!(matches!(message("A07", &state, None).loaded(), Err(Refusal::RunEnded { .. })));
        let other = LoaderMessage { newest: Some(("q", None)), ..message("A02", &state, Some(&waits)) };
        assert_eq!(other.loaded(), Err(Refusal::UnknownRun { id: "r".into(), newest: Some("q".into()) }));
    }

    #[test]
    fn a_message_that_is_repeated_changes_nothing() {
        let brought = after(&[("A01", EventData::WellAwaited), ("A01", EventData::WellLoaded(WellLoaded { in_place_of: None }))]);
        let none = Handling::default();
        assert_eq!(message("A01", &brought, Some(&none)).loaded(), Ok(None));
        assert_eq!(message("A01", &brought, Some(&none)).unloaded(None), Ok(true));
        let out = after(&[inside("A01"), ("A01", EventData::WellUnloaded)]);
        assert_eq!(message("A01", &out, Some(&none)).unloaded(None), Ok(false));
        assert!(message("A02", &out, Some(&none)).unloaded(None).is_err(), "it was never inside");
    }

    /// The run does not know of it: it came after its time, unasked, or after the end of the run.
    #[test]
    fn a_specimen_can_be_out_that_the_sampler_may_have_brought() {
        let state = after(&[("A01", EventData::SpecimenPhase(PhaseEntered { phase: Phase::Load, in_capillary: false }))]);
        let none = Handling::default();
        for wanted in [Some(&none), None] {
            let of = |well, is_asked| LoaderMessage { bringer: Bringer::Sampler { is_asked }, ..message(well, &state, wanted) };
            assert_eq!(of("A01", false).unloaded(None), Ok(true), "late");
            assert_eq!(of("A02", false).unloaded(None), Ok(true), "unasked");
            let Err(Refusal::UnexpectedWell { instead, .. }) = of("A01", true).unloaded(None) else { panic!("the next one would be A01") };
            assert!(instead.contains("hold the run"), "{instead}");
            assert!(LoaderMessage { is_planned: false, ..of("H12", false) }.unloaded(None).is_err());
        }
    }

    #[test]
    fn a_specimen_that_a_worker_is_at_cannot_be_out() {
        let state = after(&[inside("A01")]);
        let none = Handling::default();
        assert!(message("A01", &state, Some(&none)).unloaded(Some("A01")).is_err());
        assert_eq!(message("A01", &state, Some(&none)).unloaded(Some("A02")), Ok(true));
    }
}
