//! A request to stop working.
//!
//! ```text
//! requester ── cancel ──► CancelToken ──► child ──► child         a child may also be cancelled alone
//!                            │ is_cancelled, between pieces of work
//!                            └ rest, instead of a sleep: a cancellation ends it at once
//! ```

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// A flag that all clones share. A cancelled token stays cancelled.
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    cancelled: AtomicBool,
    /// Tokens that are cancelled with this one. The lock also orders the flag with threads that are about to rest.
    children: Mutex<Vec<Weak<Shared>>>,
    woken: Condvar,
}

impl CancelToken {
    /// A token that is not cancelled.
    pub fn new() -> Self {
        Self::default()
    }

    /// A token for a part of the work. It is cancelled with this one, and may be cancelled alone.
    #[must_use]
    pub fn child(&self) -> Self {
        let child = Self::new();
        let mut children = self.0.children.lock().unwrap_or_else(PoisonError::into_inner);
        if self.is_cancelled() {
            child.cancel();
        } else {
            children.retain(|c| c.strong_count() > 0);
            children.push(Arc::downgrade(&child.0));
        }
        child
    }

    /// Cancels this token and its children, and ends every rest.
    pub fn cancel(&self) {
        let mut children = self.0.children.lock().unwrap_or_else(PoisonError::into_inner);
        self.0.cancelled.store(true, Ordering::Release);
        self.0.woken.notify_all();
        for child in children.drain(..).filter_map(|c| c.upgrade()) {
            Self(child).cancel();
        }
    }

    /// Whether the token was cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.0.cancelled.load(Ordering::Acquire)
    }

    /// Blocks for `duration`. Returns true, and at once, if the token is cancelled.
    pub fn rest(&self, duration: Duration) -> bool {
        let until = Instant::now() + duration;
        let mut children = self.0.children.lock().unwrap_or_else(PoisonError::into_inner);
        while !self.is_cancelled() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            children = self.0.woken.wait_timeout(children, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_share_the_flag_and_a_rest_that_nobody_ends_says_so() {
        let token = CancelToken::new();
        assert!(!token.rest(Duration::from_millis(1)));
        token.clone().cancel();
        assert!(token.is_cancelled() && token.rest(Duration::from_secs(3600)));
    }

    #[test]
    fn a_part_is_cancelled_with_the_whole_and_the_whole_not_with_a_part() {
        let whole = CancelToken::new();
        let (alone, part) = (whole.child(), whole.child());
        alone.cancel();
        assert!(alone.is_cancelled() && !part.is_cancelled() && !whole.is_cancelled());
        let resting = std::thread::spawn({
            let part = part.child();
            move || part.rest(Duration::from_secs(3600))
        });
        whole.cancel();
        assert!(resting.join().unwrap() && part.is_cancelled() && whole.child().is_cancelled());
    }

    #[test]
    fn a_cancellation_ends_a_rest() {
        let token = CancelToken::new();
        let resting = std::thread::spawn({
            let token = token.clone();
            move || token.rest(Duration::from_secs(3600))
        });
        token.cancel();
        assert!(resting.join().unwrap());
    }
}
