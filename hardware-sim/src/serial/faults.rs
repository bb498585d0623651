//! Faults that tests can cause between the host and a controller.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

/// Faults of one serial line. A fault with a count ends after that many times. An "answer" is one piece of output of the controller.
#[derive(Debug, Default)]
pub struct SerialFaults {
    dropped_oks: AtomicU32,
    dropped_answers: AtomicU32,
    erase_memory: AtomicBool,
    lost_bytes: AtomicU64,
    line: Mutex<Line>,
}

/// Changes that the line makes to bytes.
#[derive(Debug, Default, Clone)]
pub(super) struct Line {
    delay: Duration,
    /// Number of answers in time before the late ones, number of late ones, and their delay.
    delay_some: Option<(u32, u32, Duration)>,
    /// Number of answers that are sent once before the one that is sent twice.
    double: Option<u32>,
    split: bool,
    stray_to_host: Vec<u8>,
    stray_to_controller: Vec<u8>,
    rewrite: Option<(Vec<u8>, Vec<u8>)>,
    rewrite_received: Option<(Vec<u8>, Vec<u8>)>,
    to_host: Direction,
    to_controller: Direction,
}

/// Faults of one direction. Bytes are counted from the request of the fault.
#[derive(Debug, Default, Clone)]
struct Direction {
    /// Bytes until the cable is unplugged.
    unplug_after: Option<usize>,
    /// Bytes until the one that is changed, and the bits of it that change.
    flip_at: Option<(usize, u8)>,
}

impl Direction {
    /// Changes `bytes`. Returns `true` if the cable is unplugged after what is left of them.
    fn pass(&mut self, bytes: &mut Vec<u8>) -> bool {
        if let Some((at, bits)) = &mut self.flip_at {
            if let Some(byte) = bytes.get_mut(*at) {
                *byte ^= *bits;
                self.flip_at = None;
            } else {
                *at -= bytes.len();
            }
        }
        let Some(left) = &mut self.unplug_after else { return false };
        let unplug = bytes.len() >= *left;
        bytes.truncate(*left);
        *left -= bytes.len();
        if unplug {
            self.unplug_after = None;
        }
        unplug
    }
}

/// A piece of output after the faults of the line.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Sent {
    /// The pieces that are sent.
    pub pieces: Vec<Vec<u8>>,
    /// The cable is unplugged after them.
    pub unplug: bool,
}

impl SerialFaults {
    /// The next `count` lines are executed, but their `ok` is lost (Grbl only).
    pub fn drop_oks(&self, count: u32) {
        self.dropped_oks.store(count, Ordering::Relaxed);
    }

    /// The next `count` answers are lost.
    pub fn drop_answers(&self, count: u32) {
        self.dropped_answers.store(count, Ordering::Relaxed);
    }

    /// All answers from now on are delayed by this real time.
    pub fn delay_answers(&self, by: Duration) {
        self.line().delay = by;
    }

    /// The next `answers` answers are in time, and the one after them is delayed by this real time. The later ones queue behind it.
    pub fn delay_answer_after(&self, answers: u32, by: Duration) {
        self.delay_some_answers_after(answers, 1, by);
    }

    /// The next `answers` answers are in time, and the `count` answers after them are delayed by this real time. The later ones queue
    /// behind them.
    pub fn delay_some_answers_after(&self, answers: u32, count: u32, by: Duration) {
        self.line().delay_some = Some((answers, count, by));
    }

    /// The answer after the next `answers` ones is sent twice.
    pub fn double_answer_after(&self, answers: u32) {
        self.line().double = Some(answers);
    }

    /// From now on each byte of the output is sent separately.
    pub fn split_answers(&self, on: bool) {
        self.line().split = on;
    }

    /// The host receives these bytes before the next answer.
    pub fn stray_to_host(&self, bytes: &[u8]) {
        self.line().stray_to_host = bytes.to_vec();
    }

    /// The controller receives these bytes before the next bytes of the host.
    pub fn stray_to_controller(&self, bytes: &[u8]) {
        self.line().stray_to_controller = bytes.to_vec();
    }

    /// Replaces `from` by `to` in the next answer that contains it, as flipped bits would.
    pub fn rewrite_next(&self, from: &[u8], to: &[u8]) {
        self.line().rewrite = Some((from.to_vec(), to.to_vec()));
    }

    /// Replaces `from` by `to` in the next bytes of the host that contain it.
    pub fn rewrite_next_received(&self, from: &[u8], to: &[u8]) {
        self.line().rewrite_received = Some((from.to_vec(), to.to_vec()));
    }

    /// Unplugs the cable after the controller has sent `bytes` more bytes.
    pub fn unplug_after(&self, bytes: usize) {
        self.line().to_host.unplug_after = Some(bytes);
    }

    /// Unplugs the cable after the host has sent `bytes` more bytes.
    pub fn unplug_after_received(&self, bytes: usize) {
        self.line().to_controller.unplug_after = Some(bytes);
    }

    /// Flips these bits of the byte that the controller sends after `offset` others.
    pub fn flip_sent(&self, offset: usize, bits: u8) {
        self.line().to_host.flip_at = Some((offset, bits));
    }

    /// Flips these bits of the byte that the host sends after `offset` others.
    pub fn flip_received(&self, offset: usize, bits: u8) {
        self.line().to_controller.flip_at = Some((offset, bits));
    }

    /// Ends all faults of the line.
    pub fn clear_line(&self) {
        *self.line() = Line::default();
    }

    /// Erases the settings memory. The controller notices it at its next start.
    pub fn erase_memory(&self) {
        self.erase_memory.store(true, Ordering::Relaxed);
    }

    /// Number of bytes from the host that were lost because the receive buffer was full. The host is not informed.
    pub fn lost_bytes(&self) -> u64 {
        self.lost_bytes.load(Ordering::Relaxed)
    }

    pub(crate) fn take_erased_memory(&self) -> bool {
        self.erase_memory.swap(false, Ordering::Relaxed)
    }

    pub(crate) fn count_lost_byte(&self) {
        self.lost_bytes.fetch_add(1, Ordering::Relaxed);
    }

    /// The delay of the next answer.
    pub(super) fn take_delay(&self) -> Duration {
        let mut line = self.line();
        let some = match &mut line.delay_some {
            Some((0, 0, _)) | None => Duration::ZERO,
            Some((0, late, by)) => {
                *late -= 1;
                *by
            }
            Some((answers, ..)) => {
                *answers -= 1;
                Duration::ZERO
            }
        };
        line.delay + some
    }

    pub(crate) fn take_dropped_ok(&self) -> bool {
        take_one(&self.dropped_oks)
    }

    /// The bytes that arrive at the controller if the host sends `bytes`, and whether the cable is unplugged after them.
    pub(super) fn received(&self, mut bytes: Vec<u8>) -> (Vec<u8>, bool) {
        if bytes.is_empty() {
            return (bytes, false);
        }
        let mut line = self.line();
        replace(&mut bytes, &mut line.rewrite_received);
        let mut all = std::mem::take(&mut line.stray_to_controller);
        all.extend(bytes);
        let unplug = line.to_controller.pass(&mut all);
        (all, unplug)
    }

    /// The pieces that arrive at the host if the controller sends `output`.
    pub(super) fn sent(&self, mut output: Vec<u8>) -> Sent {
        if output.is_empty() || take_one(&self.dropped_answers) {
            return Sent::default();
        }
        let mut line = self.line();
        replace(&mut output, &mut line.rewrite);
        match &mut line.double {
            Some(0) => {
                output.extend_from_within(..);
                line.double = None;
            }
            Some(answers) => *answers -= 1,
            None => {}
        }
        let mut all = std::mem::take(&mut line.stray_to_host);
        all.extend(output);
        let unplug = line.to_host.pass(&mut all);
        let pieces = if line.split { all.into_iter().map(|b| vec![b]).collect() } else { vec![all] };
        Sent { pieces, unplug }
    }

    fn line(&self) -> std::sync::MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Replaces the first `from` by `to`, if there is one.
fn replace(bytes: &mut Vec<u8>, what: &mut Option<(Vec<u8>, Vec<u8>)>) {
    if let Some((from, to)) = what
        && let Some(at) = bytes.windows(from.len()).position(|w| w == from)
    {
        bytes.splice(at..at + from.len(), to.iter().copied());
        *what = None;
    }
}

/// Uses one of a counted fault. Returns `false` if none is left.
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
    fn each_fault_acts_once() {
        let faults = SerialFaults::default();
        faults.rewrite_next(b"4.0", b"4.4");
        assert_eq!(whole(&faults, b"MPos:1.0"), b"MPos:1.0");
        assert_eq!(whole(&faults, b"MPos:4.0"), b"MPos:4.4");
        assert_eq!(whole(&faults, b"MPos:4.0"), b"MPos:4.0");
        faults.stray_to_host(b"\xff");
        assert_eq!(whole(&faults, b"ok"), b"\xffok");
        faults.stray_to_controller(b"\0");
        assert_eq!(faults.received(Vec::new()).0, b"", "stray bytes wait for the next bytes of the host");
        assert_eq!(faults.received(b"?".to_vec()).0, b"\0?");
        assert_eq!(faults.received(b"?".to_vec()).0, b"?");
        faults.rewrite_next_received(b"$H", b"$X");
        assert_eq!(faults.received(b"$$\n$H\n".to_vec()).0, b"$$\n$X\n");
        faults.flip_sent(3, 1);
        assert_eq!((whole(&faults, b"ok"), whole(&faults, b"ok")), (b"ok".to_vec(), b"oj".to_vec()));
        faults.double_answer_after(1);
        assert_eq!([(); 3].map(|()| whole(&faults, b"ok")), [b"ok".to_vec(), b"okok".to_vec(), b"ok".to_vec()]);
        faults.drop_answers(1);
        assert_eq!(whole(&faults, b"ok"), b"");
        faults.split_answers(true);
        assert_eq!(faults.sent(b"ok".to_vec()).pieces, [b"o".to_vec(), b"k".to_vec()]);
    }

    #[test]
    fn the_cable_is_unplugged_after_the_given_byte() {
        let faults = SerialFaults::default();
        faults.unplug_after(3);
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"ok".to_vec()], unplug: false });
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"o".to_vec()], unplug: true });
        assert_eq!(faults.sent(b"ok".to_vec()), Sent { pieces: vec![b"ok".to_vec()], unplug: false });
        faults.unplug_after_received(1);
        assert_eq!(faults.received(b"$H".to_vec()), (b"$".to_vec(), true));
        assert_eq!(faults.received(b"$H".to_vec()), (b"$H".to_vec(), false));
    }
}
