//! Disk space for a run: free space, and the budget of the data folder. How fast the disk takes writes.

use super::super::{Refusal, preflight};
use crate::config::Config;
use crate::session::heartbeat::SLOW;
use carved_store::{Budget, DiskWatch, Store};
use std::time::{Duration, Instant};

/// Minimum free space, in bytes, before a full disk is tried again: room for a few frames and their record.
const RETRY_BYTES: u64 = 64 << 20;

/// Whether the smallest run would fit, as of the last check.
#[derive(Debug, Default)]
pub(super) struct DiskRoom {
    lacking: Option<String>,
}

impl DiskRoom {
    /// Why the smallest run would not fit. `None` if it would.
    pub fn lacking(&self) -> Option<&str> {
        self.lacking.as_deref()
    }

    /// Stores the result of a check. Returns whether there is room now and was not before, or the reverse. The numbers in the text change
    /// all the time, and such a change is not reported.
    pub fn note(&mut self, lacking: Option<String>) -> bool {
        let changes = lacking.is_some() != self.lacking.is_some();
        if changes {
            self.lacking = lacking;
        }
        changes
    }
}

/// How long a disk must have been fast before it counts as fast again, and how long until it is tried.
const FAST_FOR: Duration = Duration::from_secs(60);

/// How fast the disk took the driver's writes.
#[derive(Debug)]
pub(super) struct DiskSpeed {
    watch: DiskWatch,
    /// When the newest slow write was seen.
    slow: Instant,
}

/// What the newest writes say about the disk.
#[derive(Debug, PartialEq)]
pub(super) enum Speed {
    /// A write took this long.
    Slow(Duration),
    /// No write was slow for a while. Another one shows whether that is so.
    Untried,
    /// Nothing new.
    Same,
}

impl DiskSpeed {
    pub fn of(watch: DiskWatch) -> Self {
        Self { watch, slow: Instant::now() }
    }

    /// Judges the writes since the last call.
    pub fn look(&mut self) -> Speed {
        let slowest = self.watch.take_slowest();
        if slowest >= SLOW {
            self.slow = Instant::now();
            return Speed::Slow(slowest);
        }
        if self.slow.elapsed() >= FAST_FOR { Speed::Untried } else { Speed::Same }
    }
}

/// The space that runs use and may use. `None` without a budget, or if it cannot be counted. Then it refuses nothing.
pub(super) fn budget(config: &Config, store: &Store) -> Option<Budget> {
    let counted = store.budget(Some(config.store.budget_gb?));
    counted.inspect_err(|error| tracing::warn!(%error, "the disk's budget is not counted")).ok()
}

/// Refuses a run that would not fit on the disk or into the budget.
///
/// # Errors
/// Names the space that is needed and the space that is free.
pub(super) fn fits(config: &Config, store: &Store, needed_bytes: u64) -> Result<(), Refusal> {
    if let Some(free_bytes) = store.free_bytes().filter(|free| *free < needed_bytes) {
        return Err(Refusal::WillNotFit { needed_bytes, free_bytes });
    }
    budget(config, store).and_then(|budget| budget.refuses(needed_bytes)).map_or(Ok(()), |why| Err(Refusal::OverBudget { why }))
}

/// Why even the smallest run would be refused: one well of the method that needs the least space. `None` if it would fit.
pub(super) fn look(config: &Config, store: &Store) -> Option<String> {
    let least_bytes = config.methods.values().map(|method| preflight::needed_bytes(config, method, 1)).min();
    fits(config, store, least_bytes?).err().map(|refusal| format!("one well: {refusal}"))
}

/// Whether there is enough free space to try a full disk again.
pub(super) fn is_worth_a_retry(store: &Store) -> bool {
    store.free_bytes().is_none_or(|free| free >= RETRY_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_is_slow_at_its_first_slow_write_and_fast_only_after_a_while() {
        let watch = DiskWatch::default();
        let mut speed = DiskSpeed::of(watch.clone());
        watch.end(SLOW / 2);
        assert_eq!(speed.look(), Speed::Same);
        watch.end(SLOW);
        watch.end(Duration::ZERO);
        assert_eq!((speed.look(), speed.look()), (Speed::Slow(SLOW), Speed::Same));
        if let Some(earlier) = Instant::now().checked_sub(FAST_FOR) {
            speed.slow = earlier;
            assert_eq!(speed.look(), Speed::Untried);
        }
    }

    #[test]
    fn only_a_change_from_room_to_none_or_back_is_news() {
        let mut room = DiskRoom::default();
        assert!(!room.note(None) && room.lacking().is_none());
        assert!(room.note(Some("1 GB is free".into())));
        assert!(!room.note(Some("0.9 GB is free".into())) && room.lacking() == Some("1 GB is free"));
        assert!(room.note(None) && room.lacking().is_none());
    }
}
