//! A start: the devices' first word, and what an earlier life of the daemon left.

use super::super::State;
use super::super::status::{CameraStatus, TranslationStatus};
use super::Running;
use carved_records::{DaemonStarted, EndRequest, Event, EventData, InstrumentState, RunInterrupted, RunOutcome, RunState};
use carved_store::RunRecord;

impl Running {
    /// Puts the first word into the status. A disk that takes nothing is a fault, not the end of the daemon.
    pub(super) fn first_report(&mut self) {
        let second = self.instrument.as_ref().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
        let identities = self.instrument.as_ref().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
        let has_translation = self.config.translation.is_some();
        let disk_free_bytes = self.store.free_bytes();
        let calibration = self.calibration();
        let inside = self.state().plate.inside().map(str::to_owned);
        let open = self.open_runs();
        self.event(None, EventData::DaemonStarted(DaemonStarted { version: env!("CARGO_PKG_VERSION").into(), mode: self.mode }));
        self.publish(|s| {
            s.calibration = calibration;
            if let Some((rotation, camera)) = identities {
                s.hardware.translation = has_translation.then(TranslationStatus::default);
                s.hardware.find_axes(&rotation);
                s.hardware.camera.identity = Some(camera);
                s.hardware.camera.connected = true;
            }
            s.hardware.camera_second =
                second.map(|identity| CameraStatus { identity: Some(identity), connected: true, ..CameraStatus::default() });
            s.hardware.disk_free_bytes = disk_free_bytes;
            s.plate.present = inside.is_some();
            s.plate.barcode = inside;
        });
        self.starting = false;
        if let Some(record) = open {
            let run = run_after(&record.id, &self.events_of(&record.id));
            self.take_up(record, run);
        } else if let Some(record) = self.ended_run() {
            self.show_again(&record);
        } else {
            self.publish(|_| ());
        }
    }

    fn events_of(&self, run: &str) -> Vec<Event> {
        self.store.events_of(run).unwrap_or_else(|error| {
            tracing::error!(%error, run, "what happened in the run cannot be read");
            self.publisher.tail().iter().map(|event| Event::clone(event)).collect()
        })
    }

    /// The newest run, where it is over: what it has left in the capillary is there still.
    fn ended_run(&self) -> Option<RunRecord> {
        let newest = self.store.newest_run(self.mode).unwrap_or_else(|error| {
            tracing::warn!(%error, "the newest run is not shown");
            None
        });
        newest.filter(|run| run.outcome.is_some())
    }

    /// An ended run as it was shown before the daemon ended: until the next one starts.
    fn show_again(&mut self, record: &RunRecord) {
        let events = self.events_of(&record.id);
        let run = run_after(&record.id, &events);
        // No plate is taken away while a run goes on; the loader's word may come after both.
        let accepted = events.first().map_or(0, |event| event.id);
        let tail = self.publisher.tail();
        let plate_is_away = tail.iter().any(|event| matches!(event.body.data, EventData::PlateUnloaded(_)) && event.id > accepted);
        let state = rests_in(record.outcome, run.end_request());
        self.outbox.recall(run);
        let barcode = record.plan.plate_barcode.clone();
        let change = self.over(record);
        self.publish(|s| {
            change(s);
            s.state = state;
            if !s.plate.present && !plate_is_away {
                s.plate.present = true;
                s.plate.barcode = Some(barcode);
            }
        });
    }

    /// The newest run that was left open; an older one, or one of another kind of rig, is ended: it cannot go on here.
    fn open_runs(&mut self) -> Option<RunRecord> {
        let mut open = match self.store.open_runs() {
            Ok(open) => open,
            Err(error) => {
                self.keep(Err(error));
                return None;
            }
        };
        let newest = open.pop_if(|run| run.mode == self.mode);
        for mut run in open {
            self.seal_run(&run.id);
            run.end_interrupted();
            let id = run.id.clone();
            self.save(run);
            self.event_of(Some(&id), None, EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by: None }));
        }
        newest
    }
}

/// What a run's events say of it.
fn run_after(id: &str, events: &[Event]) -> RunState {
    // A file of which only the end could be read lacks the run's acceptance.
    let mut state = InstrumentState { run: Some(RunState::new(id)), ..InstrumentState::default() };
    events.iter().filter(|event| event.body.run.as_deref() == Some(id)).for_each(|event| state.apply(&event.body));
    state.run.unwrap_or_default()
}

/// The state in which a run ended.
fn rests_in(outcome: Option<RunOutcome>, asked: Option<EndRequest>) -> State {
    match (outcome, asked) {
        (Some(RunOutcome::Interrupted), _) | (_, Some(EndRequest::Stop)) => State::Stopped,
        (Some(RunOutcome::Aborted), _) => State::Aborted,
        _ => State::Complete,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ended_run_is_shown_in_the_state_in_which_it_ended() {
        let rests = |asked, outcome| rests_in(Some(outcome), asked);
        assert_eq!(rests(None, RunOutcome::Partial), State::Complete);
        assert_eq!(rests(Some(EndRequest::Stop), RunOutcome::Partial), State::Stopped);
        assert_eq!(rests(Some(EndRequest::Stop), RunOutcome::Aborted), State::Stopped, "stopped before its first number");
        assert_eq!(rests(Some(EndRequest::Abort), RunOutcome::Aborted), State::Aborted);
        assert_eq!(rests(Some(EndRequest::Abort), RunOutcome::Interrupted), State::Stopped, "a signal came before");
        assert_eq!(rests(None, RunOutcome::Interrupted), State::Stopped);
    }
}
