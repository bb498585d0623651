//! What the status says while the driver waits for the disk, and cannot say it itself.
//!
//! ```text
//! driver ── publish ──────────────► status ──► clients
//!    │ waits for the disk              ▲
//! heartbeat, halt ──► SlowDisk ────────┘   not ready, and why; withdrawn once the driver goes on
//! ```

use super::handle::SharedStatus;
use super::heartbeat::Heartbeat;
use super::{Halt, Status};
use std::sync::{Arc, Weak};
use std::time::Duration;

/// Time between two looks. An emergency stop that the driver does not take is in the status before its request is answered.
const LOOK: Duration = Duration::from_millis(250);

/// What clients are told.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wait {
    Disk,
    EmergencyStop,
}

impl Wait {
    fn reason(self) -> &'static str {
        match self {
            Self::Disk => "an operation on the data folder has not ended after 2 s; milliseconds are usual",
            Self::EmergencyStop => "the emergency stop was pressed, and is not in the record yet",
        }
    }

    fn doing(self) -> &'static str {
        match self {
            Self::Disk => "Waiting for the disk of the data folder, which is slow. Commands are taken once it answers.",
            Self::EmergencyStop => "The emergency stop was pressed. It is not in the record yet; look at the disk of the data folder.",
        }
    }
}

/// The part of the status that says whether a run can start.
struct Words {
    ready: bool,
    reason: Option<String>,
    doing: String,
}

impl Words {
    fn exchange(&mut self, status: &mut Status) {
        std::mem::swap(&mut self.ready, &mut status.ready);
        std::mem::swap(&mut self.reason, &mut status.not_ready_reason);
        std::mem::swap(&mut self.doing, &mut status.doing);
    }
}

/// Shows that the driver waits for the disk, or has not taken an emergency stop.
pub struct SlowDisk {
    status: Weak<SharedStatus>,
    halt: Halt,
    heartbeat: Heartbeat,
    /// What is shown since which revision, and the driver's words in its place.
    shown: Option<(Wait, u64, Words)>,
    was_pressed: bool,
}

impl SlowDisk {
    pub fn new(status: Weak<SharedStatus>, halt: Halt, heartbeat: Heartbeat) -> Self {
        Self { status, halt, heartbeat, shown: None, was_pressed: false }
    }

    /// Looks until the driver has ended.
    pub async fn watch(mut self) {
        let mut look = tokio::time::interval(LOOK);
        look.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        while self.status.strong_count() > 0 {
            look.tick().await;
            let is_pressed = self.halt.is_pressed();
            // The driver takes a stop within milliseconds unless it waits.
            let waits_for_stop = std::mem::replace(&mut self.was_pressed, is_pressed) && is_pressed;
            let waits_for_disk = self.heartbeat.waits_for_disk().map(|_| Wait::Disk);
            self.show(waits_for_stop.then_some(Wait::EmergencyStop).or(waits_for_disk));
        }
    }

    /// Shows a wait, or that there is none. A status that the driver has published since then stays as it is.
    fn show(&mut self, wait: Option<Wait>) {
        let Some(status) = self.status.upgrade() else { return };
        status.send_if_modified(|current| {
            let earlier = self.shown.take_if(|(shown, revision, _)| *revision != current.revision || wait != Some(*shown));
            let own = earlier.filter(|(_, revision, _)| *revision == current.revision);
            let wanted = wait.filter(|_| self.shown.is_none() && !current.is_starting() && !current.is_ending());
            if own.is_none() && wanted.is_none() {
                return false;
            }
            let mut next = Status::clone(current);
            next.revision += 1;
            if let Some((_, _, mut driver)) = own {
                driver.exchange(&mut next);
            }
            if let Some(wait) = wanted {
                let mut words = Words { ready: false, reason: Some(wait.reason().into()), doing: wait.doing().into() };
                words.exchange(&mut next);
                self.shown = Some((wait, next.revision, words));
            }
            *current = Arc::new(next);
            true
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::Mode;
    use crate::session::driver::Driver;
    use tokio::sync::watch;

    fn ready() -> Status {
        let first = Driver::first_status(Mode::Simulated, "boot".into());
        Status { ready: true, not_ready_reason: None, doing: "Idle.".into(), ..first }
    }

    #[test]
    fn a_wait_is_shown_once_and_withdrawn_unless_the_driver_has_said_something_else() {
        let status = Arc::new(watch::channel(Arc::new(ready())).0);
        let mut disk = SlowDisk::new(Arc::downgrade(&status), Halt::default(), Heartbeat::default());
        let now = || Status::clone(&status.borrow());

        disk.show(None);
        assert_eq!(now(), ready());
        disk.show(Some(Wait::Disk));
        let slow = now();
        assert!(!slow.ready && slow.revision == 2 && slow.not_ready_reason.as_deref() == Some(Wait::Disk.reason()), "{slow:?}");
        disk.show(Some(Wait::Disk));
        assert_eq!(now(), slow);
        disk.show(Some(Wait::EmergencyStop));
        assert!(now().revision == 3 && !now().ready && now().doing.starts_with("The emergency stop was pressed"), "{:?}", now());
        disk.show(None);
        assert_eq!(now(), Status { revision: 4, ..ready() });

        disk.show(Some(Wait::Disk));
        status.send_modify(|s| *s = Arc::new(Status { revision: 6, doing: "Starting the run.".into(), ..ready() }));
        disk.show(None);
        assert_eq!(now(), Status { revision: 6, doing: "Starting the run.".into(), ..ready() }, "the driver's words stay");
        disk.show(Some(Wait::EmergencyStop));
        assert!(now().revision == 7 && !now().ready);
        disk.show(Some(Wait::EmergencyStop));
        assert_eq!(now().revision, 7);
    }

    #[test]
    fn a_status_that_says_starting_or_ending_keeps_its_words() {
        for words in [Status::STARTING, Status::ENDING] {
            let status = Arc::new(watch::channel(Arc::new(Status { not_ready_reason: Some(words.into()), ..ready() })).0);
            SlowDisk::new(Arc::downgrade(&status), Halt::default(), Heartbeat::default()).show(Some(Wait::Disk));
            assert_eq!((status.borrow().revision, status.borrow().not_ready_reason.as_deref()), (1, Some(words)));
        }
    }
}
