//! Faults that tests can cause between the host and the camera.

use crate::clock::RigClock;
use crate::serial::take_one;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Frames in free run that may wait: some minutes. A frame that waits takes no memory, because it is made when it is sent.
const WAITING_FRAMES: u32 = 20_000;
/// Bytes of the headers before the data of a datagram.
const IP_AND_UDP: usize = 28;

/// The camera's clock from an instant of rig time on.
#[derive(Debug, Clone, Copy)]
struct Course {
    from_s: f64,
    ns: u64,
    /// Seconds that it counts per second of rig time.
    speed: f64,
}

impl Course {
    fn ns_at(&self, rig_s: f64) -> u64 {
        self.ns.wrapping_add(((rig_s - self.from_s) * self.speed * 1e9) as i64 as u64)
    }
}

/// Faults of the camera's answers and of its stream. A fault with a count ends after that many times.
#[derive(Debug)]
pub struct CameraFaults {
    rig: RigClock,
    /// The last one applies now. Frames that are still to be sent may be of an earlier one.
    clock: Mutex<Vec<Course>>,
    held_frames_ms: AtomicU32,
    jitter_us: AtomicU32,
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
    first_number: AtomicU32,
    waiting_frames: AtomicU32,
    mute: AtomicBool,
    stolen: AtomicBool,
    unplugged: AtomicBool,
    restart: AtomicBool,
    unheard_requests: AtomicU32,
    dice: AtomicU64,
    longest_packet: AtomicU32,
}

impl CameraFaults {
    pub(super) fn new(rig: RigClock) -> Self {
        Self {
            rig,
            clock: Mutex::new(vec![Course { from_s: 0.0, ns: 0, speed: 1.0 }]),
            held_frames_ms: AtomicU32::default(),
            jitter_us: AtomicU32::default(),
            lost_packets_ppm: AtomicU32::default(),
            doubled_packets_ppm: AtomicU32::default(),
            swapped_packets_ppm: AtomicU32::default(),
            dropped_frames: AtomicU32::default(),
            cut_frames: AtomicU32::default(),
            misshapen_frames: AtomicU32::default(),
            reformatted_frames: AtomicU32::default(),
            repeated_frames: AtomicU32::default(),
            ignored_triggers: AtomicU32::default(),
            stale_packets: AtomicU32::default(),
            keep_numbers: AtomicBool::default(),
            first_number: AtomicU32::new(1),
            waiting_frames: AtomicU32::new(WAITING_FRAMES),
            mute: AtomicBool::default(),
            stolen: AtomicBool::default(),
            unplugged: AtomicBool::default(),
            restart: AtomicBool::default(),
            unheard_requests: AtomicU32::default(),
            dice: AtomicU64::default(),
            longest_packet: AtomicU32::default(),
        }
    }

    /// The camera's clock from now on counts this many seconds per second of rig time: 1.0001 is a drift of 100 ppm, 1.25 a tick
    /// frequency that is not the one that the camera reports.
    pub fn run_clock_at(&self, speed: f64) {
        self.set_clock(|now| Course { speed, ..now });
    }

    /// The camera's clock begins at 0 again.
    pub fn restart_clock(&self) {
        self.set_clock(|now| Course { ns: 0, ..now });
    }

    /// The 64 bits of the camera's clock wrap after this much rig time, s.
    pub fn wrap_clock_in(&self, rig_s: f64) {
        self.set_clock(|now| Course { ns: 0u64.wrapping_sub((rig_s * now.speed * 1e9) as u64), ..now });
    }

    /// The camera's clock at an instant of rig time, ns.
    pub fn clock_ns(&self, rig_s: f64) -> u64 {
        let clock = self.clock.lock().unwrap_or_else(PoisonError::into_inner);
        clock.iter().rev().find(|course| course.from_s <= rig_s).or(clock.first()).map_or(0, |course| course.ns_at(rig_s))
    }

    fn set_clock(&self, change: impl FnOnce(Course) -> Course) {
        let now_s = self.rig.now_s();
        let now_ns = self.clock_ns(now_s);
        let mut clock = self.clock.lock().unwrap_or_else(PoisonError::into_inner);
        let speed = clock.last().map_or(1.0, |course| course.speed);
        clock.push(change(Course { from_s: now_s, ns: now_ns, speed }));
    }

    /// Sends each frame late, by a random time up to this many ms.
    pub fn hold_frames_ms(&self, most: u32) {
        self.held_frames_ms.store(most, Ordering::Relaxed);
    }

    /// Begins each exposure in free run late, by a random time up to this many us of rig time. The frame's time is the true one.
    pub fn jitter_exposures_us(&self, most: u32) {
        self.jitter_us.store(most, Ordering::Relaxed);
    }

    /// Loses this many of a million stream packets. A resend may deliver them.
    pub fn lose_packets_ppm(&self, ppm: u32) {
        self.lost_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// Sends this many of a million stream packets twice.
    pub fn double_packets_ppm(&self, ppm: u32) {
        self.doubled_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// Sends this many of a million stream packets after the packet that follows them.
    pub fn swap_packets_ppm(&self, ppm: u32) {
        self.swapped_packets_ppm.store(ppm, Ordering::Relaxed);
    }

    /// Loses stream packets of more than this many bytes, also on a resend, as a device between with such an MTU does. 0: none is lost.
    pub fn lose_packets_longer_than(&self, bytes: u32) {
        self.longest_packet.store(bytes, Ordering::Relaxed);
    }

    /// Loses the second halves of the next `count` frames, also on a resend. Their trailers are sent.
    pub fn cut_frames(&self, count: u32) {
        self.cut_frames.store(count, Ordering::Relaxed);
    }

    /// Sends the next `count` frames complete, but with the upper half of the rows only, as if another region were configured.
    pub fn misshape_frames(&self, count: u32) {
        self.misshapen_frames.store(count, Ordering::Relaxed);
    }

    /// Sends the next `count` frames complete, but declares another pixel format with the same number of bytes.
    pub fn reformat_frames(&self, count: u32) {
        self.reformatted_frames.store(count, Ordering::Relaxed);
    }

    /// Sends the next `count` frames again at the next trigger, with a new frame number, before the frame of that trigger.
    pub fn repeat_frames(&self, count: u32) {
        self.repeated_frames.store(count, Ordering::Relaxed);
    }

    /// Sends the last `packets` packets of the acquisition before again, before the first frame of the next acquisition. At most the
    /// whole last frame is sent.
    pub fn leave_stale_packets(&self, packets: u32) {
        self.stale_packets.store(packets, Ordering::Relaxed);
    }

    /// Continues the frame numbers of the acquisition before. Normally each acquisition starts at 1.
    pub fn keep_numbers(&self, keep: bool) {
        self.keep_numbers.store(keep, Ordering::Relaxed);
    }

    /// Number of the first frame of each acquisition, from 1.
    pub fn begin_numbers_at(&self, number: u16) {
        self.first_number.store(number.max(1).into(), Ordering::Relaxed);
    }

    /// Lets at most this many frames in free run wait to be sent. The camera loses the others.
    pub fn let_frames_wait(&self, most: u32) {
        self.waiting_frames.store(most, Ordering::Relaxed);
    }

    /// Unplugs the network cable (`true`) or plugs it in again. The camera itself continues.
    pub fn pull_cable(&self, out: bool) {
        self.unplugged.store(out, Ordering::Relaxed);
    }

    /// Number of requests that did not arrive because the cable was unplugged.
    pub fn unheard_requests(&self) -> u32 {
        self.unheard_requests.load(Ordering::Relaxed)
    }

    /// Restarts the camera, as a short loss of power does. It is ready again at once.
    pub fn restart(&self) {
        self.restart.store(true, Ordering::Relaxed);
    }

    /// Exposes the next `count` frames, but never sends them, also on a resend.
    pub fn drop_frames(&self, count: u32) {
        self.dropped_frames.store(count, Ordering::Relaxed);
    }

    /// Acknowledges the next `count` software triggers, but exposes nothing.
    pub fn ignore_triggers(&self, count: u32) {
        self.ignored_triggers.store(count, Ordering::Relaxed);
    }

    /// The control channel ignores all requests (`true`), or answers again. Frames are sent until the heartbeat has run out.
    pub fn mute_control(&self, mute: bool) {
        self.mute.store(mute, Ordering::Relaxed);
    }

    /// Another host takes control (`true`) or gives it back. Meanwhile the stream is stopped and all writes are refused.
    pub fn steal_control(&self, stolen: bool) {
        self.stolen.store(stolen, Ordering::Relaxed);
    }

    pub(super) fn takes_hold(&self) -> Duration {
        Duration::from_millis(1).mul_f64(self.up_to(&self.held_frames_ms))
    }

    pub(super) fn takes_jitter_s(&self) -> f64 {
        self.up_to(&self.jitter_us) * 1e-6
    }

    pub(super) fn loses_packet(&self) -> bool {
        self.unlucky(&self.lost_packets_ppm)
    }

    pub(super) fn is_too_long(&self, packet: &[u8]) -> bool {
        let longest = self.longest_packet.load(Ordering::Relaxed) as usize;
        longest > 0 && packet.len() + IP_AND_UDP > longest
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

    /// Number of packets of the acquisition before that are sent again.
    pub(super) fn takes_stale_packets(&self) -> u32 {
        self.stale_packets.swap(0, Ordering::Relaxed)
    }

    pub(super) fn keeps_numbers(&self) -> bool {
        self.keep_numbers.load(Ordering::Relaxed)
    }

    pub(super) fn first_number(&self) -> u16 {
        self.first_number.load(Ordering::Relaxed) as u16
    }

    pub(super) fn most_waiting(&self) -> f64 {
        self.waiting_frames.load(Ordering::Relaxed).into()
    }

    pub(super) fn is_unplugged(&self) -> bool {
        self.unplugged.load(Ordering::Relaxed)
    }

    pub(super) fn count_unheard_request(&self) {
        self.unheard_requests.fetch_add(1, Ordering::Relaxed);
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

    /// A seeded random decision, so that a run with losses can be repeated.
    fn unlucky(&self, ppm: &AtomicU32) -> bool {
        let ppm = ppm.load(Ordering::Relaxed);
        if ppm == 0 {
            return false;
        }
        self.roll() % 1_000_000 < u64::from(ppm)
    }

    /// A random part of `most`.
    fn up_to(&self, most: &AtomicU32) -> f64 {
        match most.load(Ordering::Relaxed) {
            // Without this fault the dice of the others fall as before.
            0 => 0.0,
            most => f64::from(most) * (self.roll() >> 11) as f64 / (1u64 << 53) as f64,
        }
    }

    fn roll(&self) -> u64 {
        // SplitMix64 (Steele, Lea and Flood 2014).
        let mut z = self.dice.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}
