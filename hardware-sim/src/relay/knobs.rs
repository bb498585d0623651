//! Faults that tests can cause at an emulated relay.

use crate::serial::take_one;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Faults. Clones share them. A fault with a count ends after that many times.
#[derive(Debug, Clone, Default)]
pub struct Knobs(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    never_idle: AtomicBool,
    closed: AtomicU32,
    connect_presses: AtomicU32,
    split: AtomicBool,
    only_turns: AtomicBool,
    hang_ups: AtomicU32,
    lost_answers: AtomicU32,
    doubled_answers: AtomicU32,
    wrong_lengths: AtomicU32,
    late: Mutex<(u32, Duration)>,
    idle_for: Mutex<Duration>,
    rewrite: Mutex<Option<String>>,
}

impl PartialEq for Knobs {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Knobs {
    /// Somebody closes VAST's program and starts the server anew. VAST is then not started.
    pub fn restart_server(&self) {
        self.0.closed.store(1, Ordering::Relaxed);
    }

    /// Somebody presses the server's connect button. It then waits for one client.
    pub fn press_connect(&self) {
        self.0.connect_presses.fetch_add(1, Ordering::Relaxed);
    }

    /// `busy` never answers 0 after the first turn.
    pub fn never_idle_after_turns(&self, on: bool) {
        self.0.never_idle.store(on, Ordering::Relaxed);
    }

    /// `busy` answers 0 for this rig time after a turn has begun.
    pub fn say_idle_for(&self, time: Duration) {
        *self.0.idle_for.lock().unwrap_or_else(PoisonError::into_inner) = time;
    }

    /// From now on each byte is sent separately.
    pub fn split_answers(&self, on: bool) {
        self.0.split.store(on, Ordering::Relaxed);
    }

    /// Whether the faults act on the answers to turns only.
    pub fn only_turns(&self, on: bool) {
        self.0.only_turns.store(on, Ordering::Relaxed);
    }

    /// The connection ends after each of the next `count` turns has begun.
    pub fn hang_up_in_turns(&self, count: u32) {
        self.0.hang_ups.store(count, Ordering::Relaxed);
    }

    /// The next `count` requests are executed, but not answered.
    pub fn lose_answers(&self, count: u32) {
        self.0.lost_answers.store(count, Ordering::Relaxed);
    }

    /// The next `count` answers are sent twice, in one piece.
    pub fn double_answers(&self, count: u32) {
        self.0.doubled_answers.store(count, Ordering::Relaxed);
    }

    /// The next `count` frames have a length field of 4 GB.
    pub fn send_wrong_lengths(&self, count: u32) {
        self.0.wrong_lengths.store(count, Ordering::Relaxed);
    }

    /// The next `count` answers are delayed by this real time.
    pub fn delay_answers(&self, count: u32, by: Duration) {
        *self.0.late.lock().unwrap_or_else(PoisonError::into_inner) = (count, by);
    }

    /// The next answer has this text.
    pub fn answer_next(&self, text: &str) {
        *self.0.rewrite.lock().unwrap_or_else(PoisonError::into_inner) = Some(text.to_owned());
    }

    pub(super) fn is_closed_by_user(&self) -> bool {
        take_one(&self.0.closed)
    }

    pub(super) fn connect_is_pressed(&self) -> bool {
        take_one(&self.0.connect_presses)
    }

    pub(super) fn is_never_idle(&self) -> bool {
        self.0.never_idle.load(Ordering::Relaxed)
    }

    pub(super) fn idle_for_s(&self) -> f64 {
        self.0.idle_for.lock().unwrap_or_else(PoisonError::into_inner).as_secs_f64()
    }

    pub(super) fn splits(&self) -> bool {
        self.0.split.load(Ordering::Relaxed)
    }

    pub(super) fn hangs_up(&self, request: &str) -> bool {
        request.starts_with("rot,") && take_one(&self.0.hang_ups)
    }

    pub(super) fn spares(&self, request: &str) -> bool {
        self.0.only_turns.load(Ordering::Relaxed) && !request.starts_with("rot,")
    }

    pub(super) fn delay(&self) -> Duration {
        let mut late = self.0.late.lock().unwrap_or_else(PoisonError::into_inner);
        if late.0 == 0 {
            return Duration::ZERO;
        }
        late.0 -= 1;
        late.1
    }

    /// The bytes that are sent for an answer. `None` if it is lost.
    pub(super) fn sent(&self, answer: &str) -> Option<Vec<u8>> {
        if take_one(&self.0.lost_answers) {
            return None;
        }
        let rewritten = self.0.rewrite.lock().unwrap_or_else(PoisonError::into_inner).take();
        let answer = rewritten.as_deref().unwrap_or(answer);
        let mut frame = super::frame(answer);
        if take_one(&self.0.wrong_lengths) {
            frame[..4].fill(0xff);
        }
        Some(if take_one(&self.0.doubled_answers) { frame.repeat(2) } else { frame })
    }
}
