//! Deadline of a phase, and the connection of the axis meanwhile. A phase that exceeds its deadline is cancelled and the motors stop. A
//! phase whose controller hangs up is cancelled.
//!
//! ```text
//! rig thread   ├──── work(token) ────────────┤ result, or Overrun, or Gone
//! watch        ├── waits for the deadline ──X    cancels the token, stops the motors
//! ```

use crate::session::search::LOOK;
use carved_devices::cancel::CancelToken;
use carved_devices::{DeviceError, StopHandle};
use carved_records::Phase;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
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
/// [`Overrun`], whatever `work` returns. If the controller hangs up, the token is cancelled too, and the result is [`DeviceError::Gone`]:
/// the phase may wait for a loader or a camera, and would not notice it before its next exchange with the controller.
pub fn within<T, E: From<Overrun> + From<DeviceError>>(
    phase: Phase,
    allowed: Duration,
    cancel: &CancelToken,
    stop: &StopHandle,
    work: impl FnOnce(&CancelToken) -> Result<T, E>,
) -> Result<T, E> {
    let token = cancel.child();
    let began = Instant::now();
    let (done, is_done) = channel::<()>();
    let (result, watched) = std::thread::scope(|scope| {
        let token = &token;
        let watching = move || {
            let watched = watch(&is_done, began + allowed, stop);
            if !matches!(watched, Watched::Done) {
                token.cancel();
            }
            if matches!(watched, Watched::Overran) {
                stop.end_motion();
            }
            watched
        };
        // Without a watch the motors would not stop at the deadline.
        let watch = match std::thread::Builder::new().name("watch".into()).spawn_scoped(scope, watching) {
            Ok(watch) => watch,
            Err(why) => return (Err(DeviceError::Unwatched { phase: phase.name(), why: why.to_string() }.into()), Watched::Done),
        };
        // Dropped at the end of the work, also after a panic. The watch then ends.
        let done = done;
        let result = work(token);
        drop(done);
        (result, watch.join().unwrap_or(Watched::Done))
    });
    match watched {
        Watched::Overran if !cancel.is_cancelled() => Err(Overrun::new(phase, began.elapsed(), allowed).into()),
        Watched::HungUp if !cancel.is_cancelled() => {
            Err(DeviceError::Gone { device: "rotation axis", why: "it has hung up".into() }.into())
        }
        _ => result,
    }
}

/// How the watch over a phase ended.
enum Watched {
    Done,
    Overran,
    HungUp,
}

fn watch(is_done: &Receiver<()>, until: Instant, stop: &StopHandle) -> Watched {
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if is_done.recv_timeout(left.min(LOOK)) != Err(RecvTimeoutError::Timeout) {
            return Watched::Done;
        }
        if stop.link().is_lost() {
            return Watched::HungUp;
        }
        if left <= LOOK {
            return Watched::Overran;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::worker::RunError;
    use carved_devices::Link;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

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
        let ended: Result<(), RunError> = within(Phase::Position, allowed, &run, &stop, |token| {
            assert!(token.rest(Duration::from_secs(3600)), "nobody ended it");
            Ok(())
        });
        let Err(RunError::Overrun(overrun)) = ended else { panic!("{ended:?}") };
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
        assert_eq!(within::<_, RunError>(Phase::Detect, day, &run, &stop, |_| Ok(7)).unwrap(), 7);
        run.cancel();
        assert!(within::<_, RunError>(Phase::Detect, day, &run, &stop, |token| Ok(token.is_cancelled())).unwrap());
        assert_eq!(stops.load(Ordering::SeqCst), 0);
    }

    #[test]
    fn what_waits_while_the_controller_hangs_up_is_cancelled_and_nothing_is_written_to_it() {
        let (stop, stops) = counted();
        let pulled = Arc::new(AtomicBool::new(false));
        let cable = Arc::clone(&pulled);
        let stop = stop.with_link(Link::new(move || cable.load(Ordering::SeqCst)));
        let run = CancelToken::new();
        // As a load that is cancelled: no error, and no specimen.
        let ended: Result<Option<u32>, RunError> = within(Phase::Load, Duration::from_secs(86_400), &run, &stop, |token| {
            assert!(!token.rest(2 * LOOK), "nothing was pulled");
            pulled.store(true, Ordering::SeqCst);
            assert!(token.rest(Duration::from_secs(3600)), "nobody noticed it");
            Ok(None)
        });
        assert!(matches!(ended, Err(RunError::Device(DeviceError::Gone { .. }))), "{ended:?}");
        assert_eq!((stops.load(Ordering::SeqCst), run.is_cancelled()), (0, false));
    }
}
