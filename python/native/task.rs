//! Work without the GIL, with progress and Ctrl-C.
//!
//! ```text
//!  caller's thread ── waits for a step ── takes the GIL ── progress(done, total), signals ──┐ an exception
//!  worker ─────────── step ── step ── ended? ───────────────────────────────────────────────┴── ends at the next step
//! ```

use carved_offline::Stopped;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// How often signals are looked for between two steps.
const SIGNALS: Duration = Duration::from_millis(50);

/// What the work tells of its steps. Several threads may use it.
pub struct Steps<'a> {
    done: Sender<()>,
    ended: &'a AtomicBool,
}

impl Steps<'_> {
    /// A step is done.
    ///
    /// # Errors
    /// The caller has ended the work.
    pub fn step(&self) -> Result<(), Stopped> {
        if self.ended.load(Ordering::Relaxed) {
            return Err(Stopped);
        }
        // Nobody listens any more only if the caller's thread is gone, and it waits for this one.
        self.done.send(()).map_err(|_| Stopped)
    }
}

/// Runs `work` in a thread of its own without the GIL. `progress(done, total)` is called in the caller's thread after each step. `Err`
/// outside: an exception of `progress` or of a signal, which ended the work.
pub fn run<T: Send, E: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    total: usize,
    work: impl FnOnce(&Steps) -> Result<T, E> + Send,
) -> PyResult<Result<T, E>> {
    let ended = &AtomicBool::new(false);
    let (done, steps) = channel();
    py.detach(move || {
        std::thread::scope(|scope| {
            let worker = scope.spawn(move || work(&Steps { done, ended }));
            let mut exception = None;
            let mut count = 0;
            loop {
                let step = steps.recv_timeout(SIGNALS);
                if step == Err(RecvTimeoutError::Disconnected) {
                    break;
                }
                count += usize::from(step.is_ok());
                if exception.is_none()
                    && let Err(error) = Python::attach(|py| tell(py, progress.filter(|_| step.is_ok()), count, total))
                {
                    exception = Some(error);
                    ended.store(true, Ordering::Relaxed);
                }
            }
            let result = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            exception.map_or(Ok(result), Err)
        })
    })
}

fn tell(py: Python<'_>, progress: Option<&Py<PyAny>>, done: usize, total: usize) -> PyResult<()> {
    py.check_signals()?;
    progress.map_or(Ok(()), |progress| progress.call1(py, (done, total)).map(|_| ()))
}
