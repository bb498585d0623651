//! The direct path of the emergency stop to the motors. It works from any thread, past the mailbox and the driver.
//!
//! ```text
//! stop ──► cancel the work ──► pressed ──► the driver takes it: fault, abort
//!               │                 │
//!               │                 └── aim at new work: cancelled at once
//!               └──► the thread "carved-halt" ──► the stop is on the wire ──► the caller's answer
//! ```
//! A controller can take a second to accept bytes. A thread that does nothing else writes the stop, so that no task of the server waits
//! for a serial port, and the stop waits for no other work of the daemon.

use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_records::Asked;
use std::sync::mpsc;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use tokio::sync::{Notify, oneshot};

/// The emergency stop. Clones share one instrument and its current work.
#[derive(Clone)]
pub struct Halt {
    shared: Arc<(Mutex<Aim>, Notify)>,
    /// To the thread that writes stops. It ends with the last clone. `None`: no thread could be started.
    wire: Option<mpsc::Sender<Press>>,
}

#[derive(Default)]
struct Aim {
    motors: Option<StopHandle>,
    work: CancelToken,
    /// Who pressed the stop, if the driver has not taken it yet.
    pressed: Option<Asked>,
}

/// A stop that is to be written, and who waits until it is on the wire.
struct Press {
    motors: StopHandle,
    is_on_wire: oneshot::Sender<()>,
}

impl Press {
    fn write(self) {
        self.motors.stop();
        // The client may have disconnected.
        let _gone = self.is_on_wire.send(());
    }
}

impl Default for Halt {
    fn default() -> Self {
        let (wire, presses) = mpsc::channel::<Press>();
        let writes = move || presses.into_iter().for_each(Press::write);
        let thread = thread::Builder::new().name("carved-halt".into()).spawn(writes);
        if let Err(error) = &thread {
            tracing::error!(%error, "no thread could be started for the emergency stop; the thread of its request writes it");
        }
        Self { shared: Arc::default(), wire: thread.is_ok().then_some(wire) }
    }
}

impl Halt {
    fn with<T>(&self, work: impl FnOnce(&mut Aim) -> T) -> T {
        work(&mut self.shared.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Sets the motors to stop, and the cancel token of the work that is about to move them. The token is cancelled at once if the stop was
    /// pressed while the work was prepared.
    pub fn aim(&self, motors: StopHandle, work: CancelToken) {
        self.with(|aim| {
            if aim.pressed.is_some() {
                work.cancel();
            }
            (aim.motors, aim.work) = (Some(motors), work);
        });
    }

    /// Cancels the work first, so that no move follows the stop, and has the stop written, whether or not the caller waits. What it returns
    /// resolves when the stop is on the wire.
    pub fn stop(&self, asked: Asked) -> impl Future<Output = ()> + use<> {
        let (is_on_wire, on_wire) = oneshot::channel();
        if let Some(motors) = self.cancel(Some(asked)) {
            let press = Press { motors, is_on_wire };
            match &self.wire {
                Some(wire) => {
                    if let Err(mpsc::SendError(press)) = wire.send(press) {
                        press.write();
                    }
                }
                None => press.write(),
            }
        }
        self.shared.1.notify_one();
        // Without motors the sender is dropped, and there is nothing to wait for.
        async { drop(on_wire.await) }
    }

    /// Stops the motors before the process ends at once. It is no emergency stop.
    pub fn stop_motors(&self) {
        if let Some(motors) = self.cancel(None) {
            motors.stop();
        }
    }

    /// Cancels the work. `pressed` is who pressed the emergency stop. Returns the motors that are to stop.
    fn cancel(&self, pressed: Option<Asked>) -> Option<StopHandle> {
        self.with(|aim| {
            // Of several presses the first one, or the first with a name.
            aim.pressed = match (aim.pressed.take(), pressed) {
                (Some(Asked { by: None, .. }), Some(named @ Asked { by: Some(_), .. })) => Some(named),
                (first, later) => first.or(later),
            };
            aim.work.cancel();
            aim.motors.clone()
        })
    }

    /// Resolves while the stop is pressed and not taken. The client that pressed it may have disconnected.
    pub async fn pressed(&self) {
        while !self.is_pressed() {
            self.shared.1.notified().await;
        }
    }

    /// Whether the stop is pressed and not taken.
    pub fn is_pressed(&self) -> bool {
        self.with(|aim| aim.pressed.is_some())
    }

    /// Who pressed the stop, if it was pressed since the last call. Clears it: new work is not cancelled any more.
    pub fn take(&self) -> Option<Asked> {
        self.with(|aim| aim.pressed.take())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::FutureExt;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    /// The only thread of the runtime must stay free: another task lets the controller go on.
    #[test]
    fn a_stop_that_waits_for_its_controller_keeps_no_task_from_running_and_is_answered_once_it_is_on_the_wire() {
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(async {
            let halt = Halt::default();
            let work = CancelToken::new();
            let (accepts, accepted) = mpsc::channel::<()>();
            let (accepted, is_on_wire) = (Mutex::new(accepted), Arc::new(AtomicBool::new(false)));
            let written = Arc::clone(&is_on_wire);
            let controller = StopHandle::new(move || {
                let in_time = accepted.lock().unwrap().recv_timeout(Duration::from_secs(60)).is_ok();
                written.store(in_time, Ordering::SeqCst);
            });
            halt.aim(controller, work.clone());
            let mut answer = Box::pin(halt.stop(Asked::default()));
            assert!(work.is_cancelled(), "no move may follow");
            halt.pressed().await;
            assert_eq!(answer.as_mut().now_or_never(), None, "answered before it was on the wire");
            accepts.send(()).unwrap();
            answer.await;
            assert!(is_on_wire.load(Ordering::SeqCst));
        });
    }

    #[test]
    fn work_that_was_made_ready_while_the_stop_was_pressed_is_cancelled() {
        let halt = Halt::default();
        let (before, during, after) = (CancelToken::new(), CancelToken::new(), CancelToken::new());
        halt.aim(StopHandle::new(|| ()), before.clone());
        let by = |name: &str| Asked { by: Some(name.into()), from: None };
        drop(halt.stop(Asked::default()));
        drop(halt.stop(by("first")));
        drop(halt.stop(by("second")));
        halt.aim(StopHandle::new(|| ()), during.clone());
        assert!(before.is_cancelled() && during.is_cancelled());
        assert_eq!([halt.take(), halt.take()], [Some(by("first")), None]);
        halt.aim(StopHandle::new(|| ()), after.clone());
        assert!(!after.is_cancelled());
        halt.stop_motors();
        assert!(after.is_cancelled() && halt.take().is_none(), "no emergency stop is left for the driver");
    }
}
