//! The thread that sends. Notices are delivered in their order: a notice waits until the one before is delivered or given up.
//!
//! ```text
//! next ─┬─ notice ──> deliver ─┬─ taken ────────────────────> next
//!       │               ▲      ├─ refused, or a day old ────> dropped, next
//!       │               │      └─ no answer, busy ─┐
//!       │               └──── pause, doubled ◄─────┘
//!       ├─ nothing waits ──> probe: does the receiver answer at all?
//!       └─ the daemon ends, nothing waits ──> end
//! ```

use super::Notice;
use super::queue::{Next, Queue};
use super::receiver::{Agent, Undelivered};
use std::sync::Arc;
use std::time::Duration;

/// First and longest pause between two attempts. The pause is doubled after each attempt.
pub(super) const PAUSES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(60)];
/// Age at which a notice is of no use any more.
const TOO_OLD: Duration = Duration::from_secs(24 * 3600);
/// Longest pause that a receiver may ask for.
const LONGEST_RETRY_AFTER: Duration = Duration::from_secs(600);
/// Time without a notice after which the connection to the receiver is tried, so that a dead one is known before it is needed.
const PROBE: Duration = Duration::from_secs(300);

/// The sender of notices.
pub(super) struct Sender {
    agent: Agent,
    queue: Arc<Queue>,
    pauses: [Duration; 2],
}

impl Sender {
    pub fn new(agent: Agent, queue: Arc<Queue>, pauses: [Duration; 2]) -> Self {
        Self { agent, queue, pauses }
    }

    /// Sends until the daemon ends.
    pub fn run(self) {
        let mut idle = Duration::ZERO;
        // Nothing has answered the last probe, and nothing was sent since.
        let mut is_away = false;
        loop {
            match self.queue.next(idle) {
                Next::Notice(notice) => {
                    self.send(&notice);
                    is_away = false;
                }
                Next::Idle => is_away = self.probe(is_away),
                Next::End => break,
            }
            idle = PROBE;
        }
        self.queue.ended();
    }

    fn send(&self, notice: &Notice) {
        let [mut pause, longest] = self.pauses;
        loop {
            let Err(error) = self.agent.deliver(notice, self.queue.time_left(self.agent.timeout())) else {
                return self.queue.delivered();
            };
            tracing::warn!(receiver = %self.agent.shown(), notice = %notice.id, %error, "a notice was not delivered");
            self.queue.failed(self.message_of(&error));
            let asked = error.retry_after().map_or(Duration::ZERO, |asked| asked.min(LONGEST_RETRY_AFTER));
            if error.is_final() || notice.age() > TOO_OLD || !self.queue.pause(jittered(pause).max(asked)) {
                tracing::error!(receiver = %self.agent.shown(), notice = %notice.id, "a notice is given up");
                return self.queue.dropped();
            }
            pause = (pause * 2).min(longest);
        }
    }

    /// Reports whether nothing answers at the address. What an earlier notice has met stays reported until a notice is delivered.
    fn probe(&self, was_away: bool) -> bool {
        let away = self.agent.probe().err();
        match &away {
            Some(error) => self.queue.set_trouble(Some(self.message_of(error))),
            None if was_away => self.queue.set_trouble(None),
            None => {}
        }
        away.is_some()
    }

    fn message_of(&self, error: &Undelivered) -> String {
        format!(
            "Notices do not reach {}: {error}. Check the receiver and the network, then run `carved notify test --config FILE`.",
            self.agent.shown()
        )
    }
}

/// Between half of the pause and all of it, so that several instruments do not call at the same time.
fn jittered(pause: Duration) -> Duration {
    let share = getrandom::u32().map_or(1.0, |random| 0.5 + 0.5 * f64::from(random) / f64::from(u32::MAX));
    pause.mul_f64(share)
}
