//! What tests can do to the emulated VAST, and faults between it and its bridge.

use crate::serial::take_one;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Actions and faults. Clones share them. A fault with a count ends after that many times.
#[derive(Debug, Clone, Default)]
pub struct Knobs(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    loadings: AtomicU32,
    loads_by_itself: AtomicBool,
    taken_up: AtomicU32,
    finished: AtomicU32,
    lost_requests: AtomicU32,
    missed_triggers: AtomicU32,
    doubled_arrivals: AtomicU32,
    stray_arrivals: AtomicU32,
    lost_line_ends: AtomicU32,
    late: Mutex<(u32, Duration)>,
    error: Mutex<Option<u8>>,
}

impl PartialEq for Knobs {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Knobs {
    /// A person loads the list into the machine's program.
    pub fn load_list(&self) {
        self.0.loadings.fetch_add(1, Ordering::Relaxed);
    }

    /// From now on an emulated person loads the list before every specimen.
    pub fn load_list_for_every_specimen(&self) {
        self.0.loads_by_itself.store(true, Ordering::Relaxed);
    }

    /// Loads a specimen. The machine goes to the first line of the list that was loaded last.
    pub fn take_up_specimen(&self) {
        self.0.taken_up.fetch_add(1, Ordering::Relaxed);
    }

    /// Number of lists that the machine has finished.
    pub fn finished_lists(&self) -> u32 {
        self.0.finished.load(Ordering::Relaxed)
    }

    /// The next `count` requests never reach the bridge.
    pub fn lose_requests(&self, count: u32) {
        self.0.lost_requests.store(count, Ordering::Relaxed);
    }

    /// The bridge answers `OK` to the next `count` triggers, but the machine does not receive them.
    pub fn miss_triggers(&self, count: u32) {
        self.0.missed_triggers.store(count, Ordering::Relaxed);
    }

    /// The next `count` arrivals are reported twice.
    pub fn double_arrivals(&self, count: u32) {
        self.0.doubled_arrivals.store(count, Ordering::Relaxed);
    }

    /// At each of the next `count` triggers the bridge reports an arrival at once, long before the machine arrives.
    pub fn stray_arrivals(&self, count: u32) {
        self.0.stray_arrivals.store(count, Ordering::Relaxed);
    }

    /// The next `count` arrivals are reported this much later, in rig time.
    pub fn delay_arrivals(&self, count: u32, by: Duration) {
        *self.0.late.lock().unwrap_or_else(PoisonError::into_inner) = (count, by);
    }

    /// The next `count` lines are sent without their line ends.
    pub fn lose_line_ends(&self, count: u32) {
        self.0.lost_line_ends.store(count, Ordering::Relaxed);
    }

    /// The next trigger is refused with `E` and this number.
    pub fn answer_with_error(&self, number: u8) {
        *self.0.error.lock().unwrap_or_else(PoisonError::into_inner) = Some(number);
    }

    pub(super) fn list_is_to_be_loaded(&self) -> bool {
        take_one(&self.0.loadings)
    }

    pub(super) fn loads_list_for_every_specimen(&self) -> bool {
        self.0.loads_by_itself.load(Ordering::Relaxed)
    }

    pub(super) fn taken_up(&self) -> bool {
        take_one(&self.0.taken_up)
    }

    pub(super) fn list_finished(&self) {
        self.0.finished.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn request_lost(&self) -> bool {
        take_one(&self.0.lost_requests)
    }

    pub(super) fn trigger_missed(&self) -> bool {
        take_one(&self.0.missed_triggers)
    }

    pub(super) fn arrival_doubled(&self) -> bool {
        take_one(&self.0.doubled_arrivals)
    }

    pub(super) fn arrival_stray(&self) -> bool {
        take_one(&self.0.stray_arrivals)
    }

    pub(super) fn line_end_lost(&self) -> bool {
        take_one(&self.0.lost_line_ends)
    }

    pub(super) fn arrival_delay_s(&self) -> f64 {
        let mut late = self.0.late.lock().unwrap_or_else(PoisonError::into_inner);
        if late.0 == 0 {
            return 0.0;
        }
        late.0 -= 1;
        late.1.as_secs_f64()
    }

    pub(super) fn error(&self) -> Option<u8> {
        self.0.error.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
