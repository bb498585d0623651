//! What can be made to go wrong between the host and the camera.

use crate::serial::take_one;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Knobs that act on the camera's answers and on its stream.
#[derive(Debug, Default)]
pub struct CameraFaults {
    lost_packets_ppm: AtomicU32,
    lost_resends_ppm: AtomicU32,
    dropped_frames: AtomicU32,
    ignored_triggers: AtomicU32,
    mute: AtomicBool,
    stolen: AtomicBool,
    dice: AtomicU64,
}

impl CameraFaults {
    /// Of a million stream packets this many never leave; a resend may bring them.
    pub fn lose_packets_ppm(&self, ppm: u32) {
        self.lost_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// The same for packets sent again on request.
    pub fn lose_resends_ppm(&self, ppm: u32) {
        self.lost_resends_ppm.store(ppm, Ordering::Relaxed);
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

    pub(super) fn loses_resend(&self) -> bool {
        self.unlucky(&self.lost_resends_ppm)
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
