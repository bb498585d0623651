//! What a start restores from the journal and the runs of the previous daemon process. `restart::take_up` calls these functions in
//! order.

use super::super::{Publisher, State};
use carved_records::{EndRequest, Event, InstrumentState, Mode, RunOutcome, RunState};
use carved_store::{RunRecord, Store};

/// The run that can continue, and the open runs that cannot: older runs, or runs of another mode. `open`: oldest first.
pub(super) fn newest_of(mut open: Vec<RunRecord>, mode: Mode) -> (Option<RunRecord>, Vec<RunRecord>) {
    let newest = open.pop_if(|run| run.mode == mode);
    (newest, open)
}

/// Whether the previous process ended between the record of a run and its acceptance. No client has an answer, and nothing has happened in
/// the run.
pub(super) fn is_not_accepted(store: &Store, run: &str) -> bool {
    // An acceptance may be in the journal and not in the file of the run.
    let has_no_events = store.events_of(run).is_ok_and(|events| events.is_empty());
    has_no_events && store.reader().was_accepted(run).is_ok_and(|was| !was) && !has_wells(store, run)
}

/// Whether a run has a folder of a well.
pub(super) fn has_wells(store: &Store, run: &str) -> bool {
    store.long_work(|| std::fs::read_dir(store.run_folder(run)).is_ok_and(|mut folder| folder.any(|e| e.is_ok_and(|e| e.path().is_dir()))))
}

/// The events of a run, oldest first. If they cannot be read: the newest events of all.
pub(super) fn events_of(store: &Store, publisher: &Publisher, run: &str) -> Vec<Event> {
    store.events_of(run).unwrap_or_else(|error| {
        tracing::error!(%error, run, "what happened in the run cannot be read");
        publisher.tail().iter().map(|event| Event::clone(event)).collect()
    })
}

/// The newest run, if it has ended. Its last specimen may still be in the capillary.
pub(super) fn ended_run(store: &Store, mode: Mode) -> Option<RunRecord> {
    let newest = store.newest_run(mode).unwrap_or_else(|error| {
        tracing::warn!(%error, "the newest run is not shown");
        None
    });
    newest.filter(|run| run.outcome.is_some())
}

/// The state of a run after its events.
pub(super) fn run_after(id: &str, events: &[Event]) -> RunState {
    // If only the end of the file is readable, the event of the acceptance is missing.
    let mut state = InstrumentState { run: Some(RunState::new(id)), ..InstrumentState::default() };
    events.iter().filter(|event| event.body.run.as_deref() == Some(id)).for_each(|event| state.apply(&event.body));
    state.run.unwrap_or_default()
}

/// Which start of the computer this is. `None` where the kernel does not say.
pub(super) fn kernel_boot_id() -> Option<String> {
    let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
    Some(id.trim().to_owned()).filter(|id| !id.is_empty())
}

/// The state in which a run ended.
pub(super) fn rests_in(outcome: Option<RunOutcome>, asked: Option<EndRequest>) -> State {
    match (outcome, asked) {
        (Some(RunOutcome::Interrupted), _) | (_, Some(EndRequest::Stop)) => State::Stopped,
        (Some(RunOutcome::Aborted), _) => State::Aborted,
        _ => State::Complete,
    }
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;

    #[test]
    fn only_the_newest_run_of_this_kind_of_rig_goes_on() {
        let of = |mode| RunRecord { mode, ..run(&["A01"]).record().clone() };
        let found = |modes: &[Mode]| {
            let (newest, others) = newest_of(modes.iter().map(|mode| of(*mode)).collect(), Mode::Hardware);
            (newest.is_some(), others.len())
        };
        assert_eq!(found(&[]), (false, 0));
        assert_eq!(found(&[Mode::Hardware, Mode::Hardware]), (true, 1));
        assert_eq!(found(&[Mode::Hardware, Mode::Simulated]), (false, 2), "the rig has run something else since");
    }

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
