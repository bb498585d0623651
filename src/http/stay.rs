//! Slots for answers that stay open: event streams and long polls.
//!
//! Each of them keeps a connection for as long as its client likes. They get half of the connections, so that a status or an emergency stop
//! is answered however many clients listen.

use super::problem::Problem;
use axum::http::StatusCode;
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

pub(super) struct Stay {
    slots: Arc<Semaphore>,
    /// Number of slots, free and taken.
    most: usize,
}

impl Stay {
    /// Half of `max_connections`, and at least one.
    pub(super) fn new(max_connections: usize) -> Self {
        let most = max_connections.div_ceil(2);
        Self { slots: Arc::new(Semaphore::new(most)), most }
    }

    /// A slot, to be kept until the answer has ended.
    ///
    /// # Errors
    /// All slots are taken: 503 with `Retry-After`.
    pub(super) fn take(&self) -> Result<OwnedSemaphorePermit, Problem> {
        self.slots.clone().try_acquire_owned().map_err(|_| {
            let detail = format!(
                "{} clients wait for events or for a change of the status, and the other connections are kept for short requests. Repeat \
                 the request later, or ask for the status without wait",
                self.most
            );
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail).come_back()
        })
    }
}
