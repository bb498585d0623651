//! Notices to people who are not at the instrument: a run is held, somebody is needed, or a run has ended.
//!
//! ```text
//! driver ── each revision of the status ──> Watch ── Notice ──> Queue (bounded, in memory) ──> sender's thread ── POST ──> receiver
//!                                                                  │                               └─ retries, oldest first
//!                                                     the oldest is dropped if it is full
//! ```
//! The driver only appends to the queue, so a slow or dead receiver costs it nothing. Notices follow the status and not the journal: a
//! failing disk delays events, and that is when somebody is needed. A notice is sent at least once while the process lives; its `id` tells
//! a repeated one. Notices that were not delivered are lost with the process. After a restart a fault that stands and a held run are
//! noticed again.

mod notice;
mod queue;
mod receiver;
mod sender;
mod watch;

pub use notice::{EventName, Notice};
pub use queue::Counts;
pub use receiver::{Agent, Undelivered};
pub use watch::needs_somebody;

use crate::api::{NoticesStatus, Status};
use crate::config::Receiver;
use queue::Queue;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use watch::Watch;

/// The notices of a daemon. It can be cloned freely.
#[derive(Clone)]
pub struct Notices {
    watch: Arc<Mutex<Watch>>,
    queue: Arc<Queue>,
    /// The receiver's address without its path.
    shown: Arc<str>,
}

impl Notices {
    /// Starts the thread that sends.
    ///
    /// # Errors
    /// The certificates of an https receiver cannot be used, or there is no thread.
    pub fn start(receiver: Receiver) -> anyhow::Result<Self> {
        let shown = receiver.shown();
        let agent = Agent::new(receiver)?;
        let queue = Arc::new(Queue::default());
        let sender = sender::Sender::new(agent, queue.clone(), sender::PAUSES);
        std::thread::Builder::new().name("notices".into()).spawn(move || sender.run())?;
        Ok(Self { watch: Arc::default(), queue, shown: shown.into() })
    }

    /// Takes a revision of the status. It never waits for the receiver.
    pub fn see(&self, status: &Status) {
        let found = self.watch.lock().unwrap_or_else(PoisonError::into_inner).see(status);
        for notice in found {
            self.queue.push(notice);
        }
    }

    /// What the status shows.
    pub fn status(&self) -> NoticesStatus {
        NoticesStatus { receiver: self.shown.to_string(), trouble: self.queue.trouble() }
    }

    /// The numbers of notices since the start.
    pub fn counts(&self) -> Counts {
        self.queue.counts()
    }

    /// Tries the waiting notices once more, for at most this time. Reports how many are lost.
    pub fn close(&self, within: Duration) {
        let lost = self.queue.close(Instant::now() + within);
        if lost > 0 {
            tracing::warn!(lost, receiver = %self.shown, "the daemon ends before all notices were delivered");
        }
    }
}
