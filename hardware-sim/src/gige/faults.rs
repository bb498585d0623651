//! What can be made to go wrong between the host and the camera.

use crate::serial::take_one;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Knobs that act on the camera's answers and on its stream.
#[derive(Debug, Default)]
pub struct CameraFaults {
    lost_packets_ppm: AtomicU32,
    doubled_packets_ppm: AtomicU32,
    swapped_packets_ppm: AtomicU32,
    dropped_frames: AtomicU32,
    cut_frames: AtomicU32,
    misshapen_frames: AtomicU32,
    reformatted_frames: AtomicU32,
    repeated_frames: AtomicU32,
    ignored_triggers: AtomicU32,
    stale_packets: AtomicU32,
    keep_numbers: AtomicBool,
    mute: AtomicBool,
    stolen: AtomicBool,
    unplugged: AtomicBool,
    restart: AtomicBool,
    dice: AtomicU64,
}

impl CameraFaults {
    /// Of a million stream packets this many never leave; a resend may bring them.
    pub fn lose_packets_ppm(&self, ppm: u32) {
        self.lost_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// Of a million stream packets this many leave twice.
    pub fn double_packets_ppm(&self, ppm: u32) {
        self.doubled_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// Of a million stream packets this many leave after the one that follows them.
    pub fn swap_packets_ppm(&self, ppm: u32) {
        self.swapped_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// The second halves of the next `count` frames never leave, nor are they sent again; their trailers do.
    pub fn cut_frames(&self, count: u32) {
        self.cut_frames.store(count, Ordering::Relaxed);
    }

    /// The next `count` frames leave whole, but as if another region were configured: upside half of the rows only, half as high.
    pub fn misshape_frames(&self, count: u32) {
        self.misshapen_frames.store(count, Ordering::Relaxed);
    }

    /// The next `count` frames leave whole, but say that their pixels are of another format of as many bytes.
    pub fn reformat_frames(&self, count: u32) {
        self.reformatted_frames.store(count, Ordering::Relaxed);
    }

    /// The next `count` frames are sent once more at the next trigger, as frames of their own number, before what was then exposed.
    pub fn repeat_frames(&self, count: u32) {
        self.repeated_frames.store(count, Ordering::Relaxed);
    }

    /// The next acquisition's first frame comes after the last `packets` packets of the acquisition before, which the device still
    /// had; more than a frame has is the whole frame.
    pub fn leave_stale_packets(&self, packets: u32) {
        self.stale_packets.store(packets, Ordering::Relaxed);
    }

    /// Frames are numbered on over acquisitions instead of from 1 with each.
    pub fn keep_numbers(&self, keep: bool) {
        self.keep_numbers.store(keep, Ordering::Relaxed);
    }

    /// Nothing gets in or out, or does again; the camera itself goes on.
    pub fn pull_cable(&self, out: bool) {
        self.unplugged.store(out, Ordering::Relaxed);
    }

    /// The camera forgets everything, as after a loss of power, and is there again at once.
    pub fn restart(&self) {
        self.restart.store(true, Ordering::Relaxed);
    }

    /// The next `count` frames are exposed but never sent, nor sent again.
    pub fn drop_frames(&self, count: u32) {
        self.dropped_frames.store(count, Ordering::Relaxed);
    }

    /// The next `count` software triggers are acknowledged and expose nothing.
    pub fn ignore_triggers(&self, count: u32) {
        self.ignored_triggers.store(count, Ordering::Relaxed);
    }

    /// The control channel hears and answers nothing, or does again. Frames go on until the heartbeat has run out.
    pub fn mute_control(&self, mute: bool) {
        self.mute.store(mute, Ordering::Relaxed);
    }

    /// Another host takes the camera: the stream stops and every write is denied until it is given back.
    pub fn steal_control(&self, stolen: bool) {
        self.stolen.store(stolen, Ordering::Relaxed);
    }

    pub(super) fn loses_packet(&self) -> bool {
        self.unlucky(&self.lost_packets_ppm)
    }

    pub(super) fn doubles_packet(&self) -> bool {
        self.unlucky(&self.doubled_packets_ppm)
    }

    pub(super) fn swaps_packet(&self) -> bool {
        self.unlucky(&self.swapped_packets_ppm)
    }

    pub(super) fn cuts_frame(&self) -> bool {
        take_one(&self.cut_frames)
    }

    pub(super) fn misshapes_frame(&self) -> bool {
        take_one(&self.misshapen_frames)
    }

    pub(super) fn reformats_frame(&self) -> bool {
        take_one(&self.reformatted_frames)
    }

    pub(super) fn repeats_frame(&self) -> bool {
        take_one(&self.repeated_frames)
    }

    /// How many packets of the acquisition before come once more.
    pub(super) fn takes_stale_packets(&self) -> u32 {
        self.stale_packets.swap(0, Ordering::Relaxed)
    }

    pub(super) fn keeps_numbers(&self) -> bool {
        self.keep_numbers.load(Ordering::Relaxed)
    }

    pub(super) fn is_unplugged(&self) -> bool {
        self.unplugged.load(Ordering::Relaxed)
    }

    pub(super) fn takes_restart(&self) -> bool {
        self.restart.swap(false, Ordering::Relaxed)
    }

    pub(super) fn takes_frame(&self) -> bool {
        take_one(&self.dropped_frames)
    }

    pub(super) fn takes_trigger(&self) -> bool {
        take_one(&self.ignored_triggers)
    }

    pub(super) fn is_mute(&self) -> bool {
        self.mute.load(Ordering::Relaxed)
    }

    pub(super) fn is_stolen(&self) -> bool {
        self.stolen.load(Ordering::Relaxed)
    }

    /// A seeded throw, so that a run with losses can be repeated.
    fn unlucky(&self, ppm: &AtomicU32) -> bool {
        let ppm = ppm.load(Ordering::Relaxed);
        if ppm == 0 {
            return false;
        }
        // SplitMix64: a counter through a mixer.
        let mut z = self.dice.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % 1_000_000 < u64::from(ppm)
    }
}
