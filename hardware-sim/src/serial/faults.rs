//! What can be made to go wrong between the host and a controller.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Knobs of one serial line. Those that count are used up.
#[derive(Debug, Default)]
pub struct SerialFaults {
    dropped_oks: AtomicU32,
    dropped_answers: AtomicU32,
    line: Mutex<Line>,
}

/// What the line does to bytes on their way.
#[derive(Debug, Default, Clone)]
pub(super) struct Line {
    delay: Duration,
    split: bool,
    stray_to_host: Vec<u8>,
    stray_to_controller: Vec<u8>,
    rewrite: Option<(Vec<u8>, Vec<u8>)>,
    unplug_after: Option<usize>,
}

/// What becomes of a piece of output.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Sent {
    /// What leaves, and how much later than the piece before.
    pub pieces: Vec<Vec<u8>>,
    /// The cable is pulled once these have left.
    pub unplug: bool,
}

impl SerialFaults {
    /// The next `count` lines are carried out, but their `ok` is lost (Grbl).
    pub fn drop_oks(&self, count: u32) {
        self.dropped_oks.store(count, Ordering::Relaxed);
    }

    /// The next `count` pieces of output are lost whole.
    pub fn drop_answers(&self, count: u32) {
        self.dropped_answers.store(count, Ordering::Relaxed);
    }

    /// Every answer from now on leaves this much later (real time).
    pub fn delay_answers(&self, by: Duration) {
        self.line().delay = by;
    }

    /// Every byte from now on leaves by itself.
    pub fn split_answers(&self, on: bool) {
        self.line().split = on;
    }

    /// Noise before the next answer.
    pub fn stray_to_host(&self, bytes: &[u8]) {
        self.line().stray_to_host = bytes.to_vec();
    }

    /// Noise before the host's next bytes.
    pub fn stray_to_controller(&self, bytes: &[u8]) {
        self.line().stray_to_controller = bytes.to_vec();
    }

    /// In the next output that holds `from`, it reads `to`: flipped bits of one's own choice.
    pub fn rewrite_next(&self, from: &[u8], to: &[u8]) {
        self.line().rewrite = Some((from.to_vec(), to.to_vec()));
    }

    /// The cable is pulled once `bytes` more bytes have left the controller.
    pub fn unplug_after(&self, bytes: usize) {
        self.line().unplug_after = Some(bytes);
    }

    pub(super) fn delay(&self) -> Duration {
        self.line().delay
    }

    pub(crate) fn take_dropped_ok(&self) -> bool {
        take_one(&self.dropped_oks)
    }

    /// What the host's `bytes` are when they arrive.
    pub(super) fn received(&self, bytes: Vec<u8>) -> Vec<u8> {
        if bytes.is_empty() {
            return bytes;
        }
        let mut all = std::mem::take(&mut self.line().stray_to_controller);
        all.extend(bytes);
        all
    }

    /// What leaves of a controller's `output`.
    pub(super) fn sent(&self, mut output: Vec<u8>) -> Sent {
        if output.is_empty() || take_one(&self.dropped_answers) {
            return Sent::default();
        }
        let mut line = self.line();
        if let Some((from, to)) = &line.rewrite
            && let Some(at) = output.windows(from.len()).position(|w| w == from)
        {
            output.splice(at..at + from.len(), to.iter().copied());
            line.rewrite = None;
        }
        let mut all = std::mem::take(&mut line.stray_to_host);
        all.extend(output);
        let mut unplug = false;
        if let Some(left) = &mut line.unplug_after {
            unplug = all.len() >= *left;
            all.truncate(*left);
            *left -= all.len();
        }
        if unplug {
            line.unplug_after = None;
        }
        let pieces = if line.split { all.into_iter().map(|b| vec![b]).collect() } else { vec![all] };
        Sent { pieces, unplug }
    }

    fn line(&self) -> std::sync::MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Uses up one of a counted fault; false when none is left.
pub(crate) fn take_one(counter: &AtomicU32) -> bool {
    counter.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(faults: &SerialFaults, output: &[u8]) -> Vec<u8> {
        faults.sent(output.to_vec()).pieces.concat()
    }

    #[test]
    fn each_knob_does_what_it_says_and_is_used_up() {
        let faults = SerialFaults::default();
        faults.rewrite_next(b"4.0", b"4.4");
        assert_eq!(whole(&faults, b"MPos:1.0"), b"MPos:1.0");
        assert_eq!(whole(&faults, b"MPos:4.0"), b"MPos:4.4");
        assert_eq!(whole(&faults, b"MPos:4.0"), b"MPos:4.0");
        faults.stray_to_host(b"\xff");
        assert_eq!(whole(&faults, b"ok"), b"\xffok");
        faults.stray_to_controller(b"\0");
        assert_eq!(faults.received(Vec::new()), b"", "noise waits for the host's next bytes");
        assert_eq!(faults.received(b"?".to_vec()), b"\0?");
        assert_eq!(faults.received(b"?".to_vec()), b"?");
        faults.drop_answers(1);
        assert_eq!(whole(&faults, b"ok"), b"");
        faults.split_answers(true);
        assert_eq!(faults.sent(b"ok".to_vec()).pieces, [b"o".to_vec(), b"k".to_vec()]);
    }

    #[test]
    fn the_cable_is_pulled_at_the_byte_that_was_named() {
        let faults = SerialFaults::default();
        faults.unplug_after(3);
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"ok".to_vec()], unplug: false });
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"o".to_vec()], unplug: true });
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"ok".to_vec()], unplug: false });
    }
}
