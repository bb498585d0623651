//! What takes the instrument for a moment while no run has it: a look at the devices, or a whole preflight.

use super::super::handle::Refusal;
use super::super::preflight::{self, Check, DeviceReport};
use super::super::search::{DevicesFound, Search};
use super::super::state::STARTABLE;
use super::super::worker::Instrument;
use super::Running;
use carved_records::RunPlan;
use tokio::sync::oneshot;
use tokio::task::{JoinError, JoinHandle};

pub(super) enum BackgroundTask {
    Search(Search),
    Preflight { look: JoinHandle<(Instrument, DeviceReport)>, plan: Box<RunPlan>, answer: oneshot::Sender<Result<Vec<Check>, Refusal>> },
}

/// What a background task has brought back.
pub(super) enum Done {
    Searched(Instrument, DevicesFound),
    Preflight(Instrument, DeviceReport, Box<RunPlan>, oneshot::Sender<Result<Vec<Check>, Refusal>>),
}

/// The end of a background task; never, where none is under way.
pub(super) async fn ended(task: &mut Option<BackgroundTask>) -> Result<Done, JoinError> {
    // Waited for in place: what is given up half way is still there the next time.
    enum Brought {
        Search((Instrument, DevicesFound)),
        Preflight((Instrument, DeviceReport)),
    }
    let brought = match task {
        None => return std::future::pending().await,
        Some(BackgroundTask::Search(search)) => Brought::Search(search.await?),
        Some(BackgroundTask::Preflight { look, .. }) => Brought::Preflight(look.await?),
    };
    match (brought, task.take()) {
        (Brought::Search((instrument, found)), _) => Ok(Done::Searched(instrument, found)),
        (Brought::Preflight((instrument, seen)), Some(BackgroundTask::Preflight { plan, answer, .. })) => {
            Ok(Done::Preflight(instrument, seen, plan, answer))
        }
        (Brought::Preflight(_), _) => std::future::pending().await,
    }
}

impl Running {
    /// Whether commands wait: a look takes milliseconds, unless a device is away.
    pub(super) fn is_looking(&self) -> bool {
        matches!(self.task, Some(BackgroundTask::Search(_))) && self.lost.is_empty()
    }

    pub(super) fn task_done(&mut self, done: Done) {
        match done {
            Done::Searched(instrument, found) => self.searched(instrument, found),
            Done::Preflight(instrument, seen, plan, answer) => {
                self.instrument = Some(instrument);
                self.axis_is_taken(seen.intervention());
                let status = self.publisher.status();
                let inside = self.state().plate.inside();
                let checks = preflight::checks(&self.config, &plan, &seen, &status, inside, self.store.free_bytes(), self.disk_budget());
                // A run would be taken again, before the client can ask for one.
                self.publish(|_| ());
                // A client that hung up does not want to know any more.
                let _hung_up = answer.send(Ok(checks));
            }
        }
        self.go_on_if_it_may();
    }

    /// Looks at everything that a run of this plan would need. It needs the instrument, so there can be no run.
    pub(super) fn preflight(&mut self, plan: RunPlan, answer: oneshot::Sender<Result<Vec<Check>, Refusal>>) {
        let state = self.publisher.status().state;
        let refusal = if let Err(mistakes) = plan.check(&self.config.methods) {
            Refusal::InvalidPlan(mistakes)
        } else if self.active.is_some() || !STARTABLE.contains(&state) {
            Refusal::WrongState { state, accepted_in: STARTABLE.to_vec() }
        } else if let Some(instrument) = self.instrument.take() {
            let deadline = std::time::Duration::from_millis(self.config.acquisition.grab_deadline_ms.into());
            let look = tokio::task::spawn_blocking(move || preflight::look(instrument, deadline));
            self.task = Some(BackgroundTask::Preflight { look, plan: Box::new(plan), answer });
            // No run would be taken meanwhile.
            self.publish(|_| ());
            return;
        } else {
            Refusal::Busy
        };
        let _hung_up = answer.send(Err(refusal));
    }
}
