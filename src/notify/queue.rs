//! The notices that wait for their delivery, and the numbers of them.

use super::Notice;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of waiting notices. A plate makes a few.
const LIMIT: usize = 100;

/// Numbers of notices since the start of the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Notices that the receiver took.
    pub delivered: u64,
    /// Notices that are lost: refused, too old, or the queue was full.
    pub dropped: u64,
    /// Attempts that failed.
    pub failed_attempts: u64,
    /// Notices that are not delivered yet.
    pub waiting: usize,
    /// Whether the newest attempt failed.
    pub is_failing: bool,
}

/// What the sender does next.
pub(super) enum Next {
    Notice(Box<Notice>),
    /// Nothing waits for so long.
    Idle,
    /// The daemon ends, and nothing waits.
    End,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Notice>,
    /// The sender has a notice that is not delivered yet.
    under_way: bool,
    /// When the sender must have ended.
    deadline: Option<Instant>,
    has_ended: bool,
    counts: Counts,
    /// Why the newest attempt failed.
    trouble: Option<String>,
}

/// The bounded queue between the driver and the sender.
#[derive(Default)]
pub(super) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends a notice. If the queue is full, the oldest one is dropped.
    pub fn push(&self, notice: Notice) {
        let mut state = self.lock();
        if state.waiting.len() == LIMIT {
            state.waiting.pop_front();
            state.counts.dropped += 1;
        }
        state.waiting.push_back(notice);
        self.changed.notify_all();
    }

    /// Waits for the next notice, at most for `idle`.
    pub fn next(&self, idle: Duration) -> Next {
        let (mut state, _) = self
            .changed
            .wait_timeout_while(self.lock(), idle, |state| state.waiting.is_empty() && state.deadline.is_none())
            .unwrap_or_else(PoisonError::into_inner);
        match state.waiting.pop_front() {
            Some(notice) => {
                state.under_way = true;
                Next::Notice(Box::new(notice))
            }
            None if state.deadline.is_some() => Next::End,
            None => Next::Idle,
        }
    }

    /// Waits before the next attempt. Returns whether there will be one: not after an attempt at the end of the daemon.
    pub fn pause(&self, pause: Duration) -> bool {
        let was_closing = self.lock().deadline.is_some();
        if was_closing {
            return false;
        }
        drop(self.changed.wait_timeout_while(self.lock(), pause, |state| state.deadline.is_none()).unwrap_or_else(PoisonError::into_inner));
        true
    }

    /// The time that an attempt may take.
    pub fn time_left(&self, most: Duration) -> Duration {
        let deadline = self.lock().deadline;
        deadline.map_or(most, |deadline| deadline.saturating_duration_since(Instant::now()).min(most))
    }

    pub fn delivered(&self) {
        self.settled(|counts| counts.delivered += 1);
        self.set_trouble(None);
    }

    pub fn dropped(&self) {
        self.settled(|counts| counts.dropped += 1);
    }

    fn settled(&self, count: impl FnOnce(&mut Counts)) {
        let mut state = self.lock();
        state.under_way = false;
        count(&mut state.counts);
    }

    pub fn failed(&self, why: String) {
        self.lock().counts.failed_attempts += 1;
        self.set_trouble(Some(why));
    }

    pub fn set_trouble(&self, trouble: Option<String>) {
        self.lock().trouble = trouble;
    }

    pub fn trouble(&self) -> Option<String> {
        self.lock().trouble.clone()
    }

    pub fn counts(&self) -> Counts {
        let state = self.lock();
        let waiting = state.waiting.len() + usize::from(state.under_way);
        Counts { waiting, is_failing: state.trouble.is_some(), ..state.counts }
    }

    /// The sender has ended.
    pub fn ended(&self) {
        self.lock().has_ended = true;
        self.changed.notify_all();
    }

    /// Ends the sender, which tries each waiting notice once more. Returns the number of notices that are lost at the deadline.
    pub fn close(&self, deadline: Instant) -> usize {
        let mut state = self.lock();
        let before = state.counts.dropped;
        state.deadline = Some(deadline);
        self.changed.notify_all();
        let left = deadline.saturating_duration_since(Instant::now());
        let (state, _) = self.changed.wait_timeout_while(state, left, |state| !state.has_ended).unwrap_or_else(PoisonError::into_inner);
        (state.counts.dropped - before) as usize + state.waiting.len() + usize::from(state.under_way)
    }
}

#[cfg(test)]
mod tests {
    use super::super::EventName;
    use super::super::notice::tests::status;
    use super::*;

    fn notice(number: u64) -> Notice {
        Notice::new(EventName::RunHeld, &status(), false, number)
    }

    #[test]
    fn a_full_queue_drops_the_oldest_and_counts_it() {
        let queue = Queue::default();
        (0..LIMIT as u64 + 2).for_each(|number| queue.push(notice(number)));
        assert_eq!(queue.counts(), Counts { dropped: 2, waiting: LIMIT, ..Counts::default() });
        let Next::Notice(first) = queue.next(Duration::ZERO) else { panic!("a notice waits") };
        assert_eq!((first.id.as_str(), queue.counts().waiting), ("b-2", LIMIT), "what is under way counts");
        queue.delivered();
        assert_eq!(queue.counts(), Counts { dropped: 2, delivered: 1, waiting: LIMIT - 1, ..Counts::default() });
    }

    #[test]
    fn an_end_says_how_many_are_lost() {
        let queue = Queue::default();
        queue.push(notice(1));
        queue.push(notice(2));
        assert!(matches!(queue.next(Duration::ZERO), Next::Notice(_)));
        // Nobody delivers.
        assert_eq!(queue.close(Instant::now()), 2);
        assert!(!queue.pause(Duration::from_secs(3600)), "no attempt follows");
        queue.dropped();
        assert!(matches!(queue.next(Duration::ZERO), Next::Notice(_)));
        assert!(matches!(queue.next(Duration::ZERO), Next::End));
    }
}
