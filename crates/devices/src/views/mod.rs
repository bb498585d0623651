//! Views that another program takes: it turns the capillary and stores a picture per view, and the pictures are read from its folder.
//!
//! ```text
//!  vendor's program ── pictures ──► folder ◄── Inbox ── Turn ──┬── FolderSampler   which well comes next
//!                                                              ├── FolderAxis      a move is the wait for the next picture
//!                                                              └── FolderCamera    a grab is that picture
//! ```
//! The three doors let the run of an own rig work unchanged. Nothing can be stopped, turned back or ended early. What is on disk can be
//! read again: after a hold or a restart the run catches up.

mod error;
mod inbox;
mod settings;
#[cfg(test)]
mod tests;
mod turn;

pub use error::ViewsError;
pub use settings::FolderSettings;
pub use turn::{Decode, PictureKind};

use crate::cancel::CancelToken;
use crate::clock::Clock;
use crate::sampler::{Expected, Loaded, NextWell, Sampler, Upcoming};
use crate::{Achieved, Camera, Capabilities, DeviceError, Grabbed, Link, Position, Rig, RotationAxis, StopHandle, StreamCounters};
use carved_core::units::Steps;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Opens the folder as the devices of a rig. `decode` reads a picture file.
///
/// # Errors
/// Settings that cannot be used. The folder itself may be missing: it is looked for while nothing runs.
pub fn open(settings: FolderSettings, kind: PictureKind, decode: Decode) -> Result<(Rig, Box<dyn Sampler>), DeviceError> {
    let (axis, camera, sampler) = doors(settings, kind, decode, Clock::REAL)?;
    Ok((Rig { rotation: Box::new(axis), camera: Box::new(camera) }, Box::new(sampler)))
}

fn doors(
    settings: FolderSettings,
    kind: PictureKind,
    decode: Decode,
    clock: Clock,
) -> Result<(FolderAxis, FolderCamera, FolderSampler), DeviceError> {
    let identity = format!("another program, which stores pictures in {}", settings.folder);
    let turn = Turn::new(settings, kind, decode, clock)?;
    let stopped = Arc::clone(&turn.stopped);
    let shared = Shared(Arc::new(Mutex::new(turn)));
    let axis = FolderAxis { identity: identity.clone(), stopped, turn: shared.clone() };
    let camera = FolderCamera { identity, turn: shared.clone(), pictures: 0 };
    Ok((axis, camera, FolderSampler { turn: shared, is_new_run: false }))
}

use turn::Turn;

#[derive(Clone)]
struct Shared(Arc<Mutex<Turn>>);

impl Shared {
    fn get(&self) -> MutexGuard<'_, Turn> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The axis that the other program turns.
struct FolderAxis {
    identity: String,
    stopped: Arc<AtomicBool>,
    turn: Shared,
}

impl RotationAxis for FolderAxis {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            has_position: false,
            has_encoder: false,
            has_stall: false,
            can_stop: false,
            absolute: true,
            trigger_only: false,
            outside: true,
        }
    }

    fn announce(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        self.turn.get().announce(stops);
        Ok(())
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        // A stop cancels the work before it stops the axis. So a stop before this line has cancelled it, and one after it stays.
        self.stopped.store(false, Ordering::SeqCst);
        if cancel.is_cancelled() {
            return Err(DeviceError::NotReferenced);
        }
        Ok(Achieved { steps: Steps(0), epoch: self.turn.get().reference() })
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        Ok(Achieved { steps: target, epoch: self.turn.get().go_to(target)? })
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        Ok(self.turn.get().inbox.check()?)
    }

    fn position(&self) -> Position {
        self.turn.get().position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopped = Arc::clone(&self.stopped);
        StopHandle::new(move || stopped.store(true, Ordering::SeqCst))
    }
}

/// The camera of the other program.
struct FolderCamera {
    identity: String,
    turn: Shared,
    pictures: u64,
}

impl Camera for FolderCamera {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn arm(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    /// The wait for the picture has its own limit, `next_picture_s`.
    fn grab(&mut self, _deadline: Duration) -> Result<Grabbed, DeviceError> {
        let (view, frame) = self.turn.get().picture()?;
        self.pictures += 1;
        Ok(Grabbed { frame, frame_id: view.into(), attempts: 1, trigger_ms: 0.0 })
    }

    /// A folder that is lost is an error of the axis' check.
    fn link(&self) -> Link {
        Link::new(|| false)
    }

    fn reopen(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    fn counters(&self) -> StreamCounters {
        StreamCounters { completed: self.pictures, ..StreamCounters::default() }
    }

    fn disarm(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// The other program as the sampler: it decides which well comes next.
struct FolderSampler {
    turn: Shared,
    /// The folder of a new run must not have pictures yet.
    is_new_run: bool,
}

impl Sampler for FolderSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    /// Its pictures can be read again.
    fn brings_again(&self) -> bool {
        true
    }

    fn begin_run(&mut self) {
        self.is_new_run = true;
    }

    fn look(&mut self, _axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        Ok(())
    }

    fn sees_specimen(&self) -> Option<bool> {
        None
    }

    fn next_well(&mut self, upcoming: &Upcoming<'_>, is_ended: &dyn Fn() -> bool) -> Result<NextWell, DeviceError> {
        let mut turn = self.turn.get();
        let (clock, settings) = (turn.clock, turn.settings.clone());
        turn.inbox.enter(upcoming.run, upcoming.plate);
        let began = (clock.now)();
        loop {
            if is_ended() {
                return Ok(NextWell::Cancelled);
            }
            turn.inbox.scan()?;
            if std::mem::take(&mut self.is_new_run)
                && let Some(example) = turn.inbox.first()
            {
                let (folder, count) = (turn.inbox.folder().to_owned(), turn.inbox.count());
                return Err(ViewsError::Earlier { folder, count, example: example.to_owned() }.into());
            }
            if let Some(at) = turn.inbox.oldest(upcoming.wells.iter().map(|expected| expected.well)) {
                return Ok(NextWell::At(at));
            }
            let silent = turn.inbox.silent_since(began);
            if settings.end_after().zip(silent).is_some_and(|(most, silent)| silent >= most) {
                return Ok(NextWell::NoMore);
            }
            (clock.pause)(settings.poll());
        }
    }

    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        self.go_on(axis, expected, cancel)
    }

    fn go_on(
        &mut self,
        _axis: &mut dyn RotationAxis,
        expected: Expected<'_>,
        _cancel: &CancelToken,
    ) -> Result<Option<Loaded>, DeviceError> {
        self.turn.get().begin(Some(expected.well));
        Ok(Some(Loaded::default()))
    }

    fn eject(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        self.turn.get().begin(None);
        Ok(())
    }

    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}
