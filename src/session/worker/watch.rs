//! Deadline of a phase. A phase that exceeds it is cancelled and the motors stop.
//!
//! ```text
//! rig thread   ├──── work(token) ────────────┤ result, or Overrun
//! watch        ├── waits for the deadline ──X    cancels the token, stops the motors
//! ```

use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_records::Phase;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// A phase that took longer than its method allows.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the phase {} was ended after {took_s:.1} s; the method's policy allows it {allowed_s} s. Look what held it up, or allow more: deadlines_s.{0}",
    phase.name()
)]
pub struct Overrun {
    pub phase: Phase,
    pub took_s: f64,
    pub allowed_s: f64,
}

impl Overrun {
    pub fn new(phase: Phase, took: Duration, allowed: Duration) -> Self {
        Self { phase, took_s: took.as_secs_f64(), allowed_s: allowed.as_secs_f64() }
    }
}

/// Runs a phase with its own cancel token. After the deadline the token is cancelled and the motors stop. The result is then an
/// [`Overrun`], whatever `work` returns.
pub fn within<T, E: From<Overrun>>(
    phase: Phase,
    allowed: Duration,
    cancel: &CancelToken,
    stop: &StopHandle,
    work: impl FnOnce(&CancelToken) -> Result<T, E>,
) -> Result<T, E> {
    let token = cancel.child();
    let began = Instant::now();
    let (done, is_done) = channel::<()>();
    let (result, overran) = std::thread::scope(|scope| {
        let token = &token;
        let watch = scope.spawn(move || {
            let overran = is_done.recv_timeout(allowed) == Err(RecvTimeoutError::Timeout);
            if overran {
                token.cancel();
                stop.end_motion();
            }
            overran
        });
        // Dropped at the end of the work, also after a panic. The watch then ends.
        let done = done;
        let result = work(token);
        drop(done);
        (result, watch.join().unwrap_or(false))
    });
    if overran && !cancel.is_cancelled() { Err(Overrun::new(phase, began.elapsed(), allowed).into()) } else { result }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    fn counted() -> (StopHandle, Arc<AtomicU32>) {
        let stops = Arc::new(AtomicU32::new(0));
        let handle = StopHandle::new({
            let stops = Arc::clone(&stops);
            move || {
                stops.fetch_add(1, Ordering::SeqCst);
            }
        });
        (handle, stops)
    }

    #[test]
    fn what_overruns_is_cancelled_its_motors_stand_and_the_error_says_so() {
        let (stop, stops) = counted();
        let run = CancelToken::new();
        let allowed = Duration::from_millis(20);
        let ended: Result<(), Overrun> = within(Phase::Position, allowed, &run, &stop, |token| {
            assert!(token.rest(Duration::from_secs(3600)), "nobody ended it");
            Ok(())
        });
        let overrun = ended.unwrap_err();
        assert_eq!((overrun.phase, stops.load(Ordering::SeqCst), run.is_cancelled()), (Phase::Position, 1, false));
        assert!(overrun.took_s >= 0.02, "{overrun}");
        let said = overrun.to_string();
        assert!(said.contains("position") && said.contains("0.02 s"), "{said}");
    }

    #[test]
    fn what_is_in_time_is_let_alone_and_a_cancelled_run_is_no_overrun() {
        let (stop, stops) = counted();
        let run = CancelToken::new();
        let day = Duration::from_secs(86_400);
        assert_eq!(within::<_, Overrun>(Phase::Detect, day, &run, &stop, |_| Ok(7)), Ok(7));
        run.cancel();
        assert_eq!(within::<_, Overrun>(Phase::Detect, day, &run, &stop, |token| Ok(token.is_cancelled())), Ok(true));
        assert_eq!(stops.load(Ordering::SeqCst), 0);
    }
}
