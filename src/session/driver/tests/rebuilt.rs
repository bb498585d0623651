//! What a start computes from the state of a run, and no event holds: the request. It must be what the live run had. Which specimens are
//! moved follows from the state.

use super::super::run::Request;
use super::super::*;
use super::bench::{Bench, RUN};
use carved_records::{EndRequest, RunOutcome, SpecimenOutcome};

/// What the live run has before the process dies.
#[derive(Debug)]
pub struct Before {
    request: Request,
}

impl Before {
    /// `None` without a run.
    pub fn of(b: &Bench) -> Option<Self> {
        let run = b.d.run.as_ref()?;
        Some(Self { request: run.request() })
    }

    /// Compares the live run with the one that a start has taken up. Everything was on disk.
    pub fn compare(&self, b: &Bench, when: &str) {
        let asked = match self.request {
            Request::Stop => Some(EndRequest::Stop),
            Request::Abort => Some(EndRequest::Abort),
            Request::ShutDown => Some(EndRequest::Interrupt),
            _ => None,
        };
        let Some(run) = &b.d.run else {
            let record = b.d.outbox.store().run(RUN).unwrap().unwrap();
            assert_eq!(record.outcome, Some(outcome(asked, &record)), "it ended in another way, {when}");
            return;
        };
        assert_eq!(run.request(), request(asked), "{when}");
    }
}

fn request(asked: Option<EndRequest>) -> Request {
    match asked {
        Some(EndRequest::Stop) => Request::Stop,
        Some(EndRequest::Abort) => Request::Abort,
        Some(EndRequest::Interrupt) => Request::ShutDown,
        None => Request::Nothing,
    }
}

/// How a start ends a run that is over, or that was asked to end.
fn outcome(asked: Option<EndRequest>, record: &carved_store::RunRecord) -> RunOutcome {
    let is_cut_short = record.wells.iter().any(|well| matches!(well.outcome, None | Some(SpecimenOutcome::Aborted)));
    match asked {
        Some(EndRequest::Abort) => RunOutcome::Aborted,
        Some(EndRequest::Stop) => RunOutcome::of_stopped(&record.wells),
        Some(EndRequest::Interrupt) => RunOutcome::Interrupted,
        None => {
            assert!(!is_cut_short, "nobody asked for an end: {:?}", record.wells);
            RunOutcome::of_wells(&record.wells)
        }
    }
}

/// Compares a run that a start has taken up with the state that follows from its events.
pub fn follows_from_the_state(b: &Bench, when: &str) {
    let Some(run) = &b.d.run else { return };
    let known = b.d.state().run.as_ref().unwrap();
    assert_eq!(run.request(), request(known.end_request()), "{when}");

    // A worker begins only once the loader has taken out what must leave. A driven sampler ejects it first.
    let must_leave = b.d.must_leave_first().is_some();
    let take_out = b.status().plate.take_out;
    assert!(!must_leave || !b.d.loader.fills_capillary() || !run.works(), "it works over a specimen that is to be taken out, {when}");
    assert_eq!(take_out.is_some(), must_leave && b.d.loader.fills_capillary(), "{take_out:?}, {when}");
    assert_eq!(b.status().plate.bring, None, "the worker has not asked for a specimen yet, {when}");

    // It waits for a person, or because its cause has come back too often.
    let needs_a_person = known.is_held_by_operator() || known.waits_for_operator() || b.d.check_faults().is_err();
    let status = b.status();
    if status.state == State::Held {
        assert!(needs_a_person || !resume::is_automatic(run, Some(known)), "nothing holds it, {when}");
        assert!(!status.run.unwrap().goes_on_by_itself, "{when}");
    } else {
        assert!(!needs_a_person || known.end_request().is_some(), "it goes on without a person, {when}");
    }
    assert!(!run.may_go_on() || known.is_held_by_operator(), "it may go on and has not, {when}");
}
