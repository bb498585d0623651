//! The blocking worker that executes a plan: move, settle, trigger, hand over.
//!
//! ```text
//! move_to ──► rest (settle) ──► grab ──► hash ──► ledger ──► sink
//!    ▲                                                        │
//!    └────────────────────── next stop ◄──────────────────────┘        any other way out: stop the motor
//! ```
//! To end a revolution, cancel the token *and* call the rig's stop handle: the token ends it at the next step of the loop, and the
//! handle ends a move that is under way. A change of epoch ends the revolution, and the next one begins at a new reference.

use super::{RevolutionPlan, Stop, grab};
use crate::cancel::CancelToken;
use crate::{DeviceError, Rig, StopHandle};
use carved_core::frame::RawFrame;
use carved_core::range::{Range, Ranged};
use carved_core::ranges;
use carved_core::units::Sense;
use carved_records::sha256_hex;
use carved_records::{Ledger, LedgerEntry, LedgerError, Light};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// How the stops of a plan are executed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct AcquisitionSettings {
    /// Rest between arrival and trigger, ms: time for the specimen to come to rest in its liquid.
    pub settle_ms: u32,
    /// Time for one complete frame with all its repeated triggers, ms.
    pub grab_deadline_ms: u32,
    /// Which way positive steps turn the capillary: 1 if they move the near wall to larger v (down in the picture), -1 if to smaller v.
    /// Measure it with a marked capillary (`carved calibrate marked`).
    #[serde(default)]
    pub sense: Sense,
}

impl Ranged for AcquisitionSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        settle_ms: 0.0, 10_000.0, "ms";
        grab_deadline_ms: 10.0, 60_000.0, "ms";
    ];
}

/// The receiver of the views has gone away.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SinkClosed;

/// The receiver's decision after a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Take the next view.
    View,
    /// Take only the closure view, and end.
    Closure,
}

/// Why a revolution has ended early.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum AcquisitionError {
    /// A device failed.
    #[error("view {view}: {source}")]
    Device { view: u32, source: DeviceError },
    /// A view does not fit the ledger.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A sweep cannot be done, or its frames do not make a turn.
    #[error(transparent)]
    Sweep(#[from] super::SweepError),
    /// The token was cancelled.
    #[error("the revolution was cancelled before view {view}")]
    Cancelled { view: u32 },
    /// The receiver has gone away.
    #[error("view {view} was taken, but nobody receives the views any more")]
    SinkClosed { view: u32 },
}

/// Takes the views of `plan` with an armed camera and a referenced axis, until `sink` has enough. The closure view is always taken.
/// `sink` receives each view before the next move begins. It must not wait for the science: use a bounded channel that can hold a
/// revolution.
///
/// # Errors
/// The first device error, change of epoch, cancellation or closed sink ends the revolution. The motor is stopped, and the axis needs
/// a new reference.
pub fn revolve(
    rig: &mut Rig,
    plan: &RevolutionPlan,
    settings: &AcquisitionSettings,
    cancel: &CancelToken,
    mut sink: impl FnMut(LedgerEntry, RawFrame) -> Result<Next, SinkClosed>,
) -> Result<Ledger, AcquisitionError> {
    let guard = StopUnlessDone::of(rig.rotation.stop_handle());
    let mut ledger = Ledger::default();
    rig.rotation.announce(&plan.targets()).map_err(|source| AcquisitionError::Device { view: 0, source })?;
    let mut next = Next::View;
    for stop in plan.stops() {
        if next == Next::Closure && !stop.closure {
            continue;
        }
        let (entry, frame) = take_view(rig, plan, settings, cancel, *stop, 0)?;
        ledger.push(entry.clone())?;
        next = sink(entry, frame).map_err(|SinkClosed| AcquisitionError::SinkClosed { view: stop.view })?;
    }
    guard.done();
    Ok(ledger)
}

/// Goes back to stops of a finished revolution and takes their views again, with the same reference.
///
/// # Errors
/// As [`revolve`].
pub fn retake(
    rig: &mut Rig,
    plan: &RevolutionPlan,
    settings: &AcquisitionSettings,
    cancel: &CancelToken,
    views: &[u32],
    mut sink: impl FnMut(LedgerEntry, RawFrame) -> Result<(), SinkClosed>,
) -> Result<(), AcquisitionError> {
    let guard = StopUnlessDone::of(rig.rotation.stop_handle());
    for stop in plan.stops().iter().filter(|stop| views.contains(&stop.view)) {
        let (entry, frame) = take_view(rig, plan, settings, cancel, *stop, 1)?;
        sink(entry, frame).map_err(|SinkClosed| AcquisitionError::SinkClosed { view: stop.view })?;
    }
    guard.done();
    Ok(())
}

fn take_view(
    rig: &mut Rig,
    plan: &RevolutionPlan,
    settings: &AcquisitionSettings,
    cancel: &CancelToken,
    stop: Stop,
    retake: u32,
) -> Result<(LedgerEntry, RawFrame), AcquisitionError> {
    let view = stop.view;
    let unless_cancelled = |cancelled: bool| if cancelled { Err(AcquisitionError::Cancelled { view }) } else { Ok(()) };
    // A device also fails because of a cancellation. Then the cancellation is the cause to report.
    let failed =
        |source| if cancel.is_cancelled() { AcquisitionError::Cancelled { view } } else { AcquisitionError::Device { view, source } };

    unless_cancelled(cancel.is_cancelled())?;
    let began = Instant::now();
    let achieved = rig.rotation.move_to(stop.target).map_err(failed)?;
    let arrived = Instant::now();
    unless_cancelled(cancel.rest(Duration::from_millis(settings.settle_ms.into())))?;
    let settled = Instant::now();
    let deadline = Duration::from_millis(settings.grab_deadline_ms.into());
    let grabbed = grab(rig.camera.as_mut(), deadline, cancel).map_err(failed)?;
    let grabbed_at = Instant::now();

    let entry = LedgerEntry {
        view,
        retake,
        commanded_steps: stop.target,
        achieved_steps: achieved.steps,
        epoch: achieved.epoch,
        omega: settings.sense.omega(achieved.steps, plan.steps_per_revolution()),
        swept: None,
        moved_ms: milliseconds(arrived - began),
        settle_ms: milliseconds(settled - arrived),
        grab_ms: milliseconds(grabbed_at - settled),
        trigger_ms: grabbed.trigger_ms,
        light: Some(Light::of(&grabbed.frame)),
        frame_id: grabbed.frame_id,
        attempts: grabbed.attempts,
        sha256: sha256_hex(grabbed.frame.bytes()),
        second: None,
        closure: stop.closure,
    };
    tracing::debug!(view, steps = achieved.steps.0, moved_ms = entry.moved_ms, grab_ms = entry.grab_ms, attempts = entry.attempts, "view");
    Ok((entry, grabbed.frame))
}

fn milliseconds(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

/// Stops the motor when it is dropped, also in a panic, unless `done` was called.
pub(super) struct StopUnlessDone(Option<StopHandle>);

impl StopUnlessDone {
    pub(super) fn of(stop: StopHandle) -> Self {
        Self(Some(stop))
    }

    pub(super) fn done(mut self) {
        self.0 = None;
    }
}

impl Drop for StopUnlessDone {
    fn drop(&mut self) {
        if let Some(stop) = self.0.take() {
            stop.end_motion();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Achieved;
    use crate::testing::{AxisLog, FakeAxis, FakeCamera};
    use carved_core::frame::PixelFormat;
    use carved_core::units::{Steps, StepsPerRevolution};
    use carved_records::ViewOrder;

    fn rig() -> (Rig, AxisLog) {
        rig_with(FakeAxis::new(), None)
    }

    /// A rig whose camera sees where the axis stands. The frame of trigger `lost_frame` does not come.
    fn rig_with(axis: FakeAxis, lost_frame: Option<u32>) -> (Rig, AxisLog) {
        let log = axis.log();
        let seen = log.clone();
        let camera = FakeCamera::new(move |trigger| {
            if Some(trigger) == lost_frame {
                return Err(DeviceError::NoFrame { waited_ms: 100, attempts: 3, last: "nothing".into() });
            }
            let pixel = (seen.steps().0 % 251) as u8;
            Ok(RawFrame::new(2, 1, PixelFormat::Mono8, vec![pixel; 2]).unwrap())
        });
        (Rig { rotation: Box::new(axis.referenced()), camera: Box::new(camera) }, log)
    }

    fn plan(order: ViewOrder) -> RevolutionPlan {
        RevolutionPlan::new(21, StepsPerRevolution::new(500, 1).unwrap(), order).unwrap()
    }

    fn settings() -> AcquisitionSettings {
        AcquisitionSettings { settle_ms: 0, grab_deadline_ms: 100, sense: Sense::Negative }
    }

    #[test]
    fn each_view_carries_the_frame_of_its_own_angle_in_either_order() {
        for order in [ViewOrder::Sequential, ViewOrder::CoarseToFine] {
            let (mut rig, log) = rig();
            let mut seen = Vec::new();
            let ledger = revolve(&mut rig, &plan(order), &settings(), &CancelToken::new(), |entry, frame| {
                seen.push((entry, frame));
                Ok(Next::View)
            })
            .unwrap();
            assert_eq!(ledger.carved().count(), 21);
            assert_eq!(ledger.closure().unwrap().achieved_steps, Steps(500));
            assert!(ledger.entries().iter().eq(seen.iter().map(|(entry, _)| entry)));
            for (entry, frame) in &seen {
                assert_eq!(i64::from(frame.bytes()[0]), entry.achieved_steps.0 % 251);
                assert!((entry.omega + std::f64::consts::TAU * entry.achieved_steps.0 as f64 / 500.0).abs() < 1e-12);
                assert_eq!(entry.sha256, sha256_hex(frame.bytes()));
            }
            assert_eq!(log.stops(), 0, "a finished revolution keeps its reference");
        }
    }

    #[test]
    fn who_has_enough_gets_the_closure_view_and_a_view_again_comes_from_its_own_stop() {
        let (mut rig, log) = rig();
        let plan = plan(ViewOrder::CoarseToFine);
        let cancel = CancelToken::new();
        let ledger = revolve(&mut rig, &plan, &settings(), &cancel, |entry, _| {
            Ok(if entry.view == plan.stops()[8].view { Next::Closure } else { Next::View })
        })
        .unwrap();
        assert_eq!((ledger.entries().len(), ledger.closure().unwrap().achieved_steps), (10, Steps(500)));
        let mut again = Vec::new();
        let views = [plan.stops()[3].view, plan.stops()[5].view];
        retake(&mut rig, &plan, &settings(), &cancel, &views, |entry, frame| {
            again.push((entry, frame));
            Ok(())
        })
        .unwrap();
        for ((entry, frame), stop) in again.iter().zip([plan.stops()[3], plan.stops()[5]]) {
            assert_eq!((entry.view, entry.retake, entry.achieved_steps, entry.closure), (stop.view, 1, stop.target, false));
            assert_eq!(i64::from(frame.bytes()[0]), stop.target.0 % 251);
        }
        assert_eq!((again.len(), log.stops()), (2, 0));
    }

    #[test]
    fn the_angle_is_of_the_step_that_was_achieved_not_of_the_one_that_was_asked_for() {
        let beside = FakeAxis::new().arriving(|at| Achieved { steps: Steps(at.steps.0 + 1), ..at });
        let (mut rig, _) = rig_with(beside, None);
        let plan = plan(ViewOrder::Sequential);
        let ledger = revolve(&mut rig, &plan, &settings(), &CancelToken::new(), |_, _| Ok(Next::View)).unwrap();
        for (entry, stop) in ledger.entries().iter().zip(plan.stops()) {
            assert_eq!((entry.commanded_steps, entry.achieved_steps), (stop.target, Steps(stop.target.0 + 1)));
            let omega = -std::f64::consts::TAU * (stop.target.0 + 1) as f64 / 500.0;
            assert!((entry.omega - omega).abs() < 1e-12, "view {}: {} rad, {omega} rad achieved", entry.view, entry.omega);
        }
    }

    #[test]
    fn the_hash_is_sha_256_in_hexadecimal() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn a_change_of_epoch_ends_the_revolution_and_stops_the_motor() {
        let mut moves = 0;
        let axis = FakeAxis::new().arriving(move |at| {
            moves += 1;
            Achieved { epoch: 1 + u32::from(moves >= 8), ..at }
        });
        let (mut rig, log) = rig_with(axis, None);
        let mut views = 0;
        let refusal = revolve(&mut rig, &plan(ViewOrder::Sequential), &settings(), &CancelToken::new(), |_, _| {
            views += 1;
            Ok(Next::View)
        });
        assert!(matches!(refusal, Err(AcquisitionError::Ledger(LedgerError::EpochChanged { view: 7, expected: 1, found: 2 }))));
        assert_eq!((views, log.targets().len(), log.stops()), (7, 8, 1));
    }

    #[test]
    fn a_lost_frame_ends_the_revolution_at_its_view_and_stops_the_motor() {
        let (mut rig, log) = rig_with(FakeAxis::new(), Some(3));
        let refusal = revolve(&mut rig, &plan(ViewOrder::Sequential), &settings(), &CancelToken::new(), |_, _| Ok(Next::View));
        assert!(matches!(refusal, Err(AcquisitionError::Device { view: 2, source: DeviceError::NoFrame { .. } })));
        assert_eq!((log.targets().len(), log.stops()), (3, 1));
    }

    #[test]
    fn a_cancellation_or_a_closed_sink_ends_it_before_the_next_move() {
        let cancel = CancelToken::new();
        let (mut cancelled, log) = rig();
        let refusal = revolve(&mut cancelled, &plan(ViewOrder::Sequential), &settings(), &cancel, |entry, _| {
            if entry.view == 4 {
                cancel.cancel();
            }
            Ok(Next::View)
        });
        assert!(matches!(refusal, Err(AcquisitionError::Cancelled { view: 5 })));
        assert_eq!((log.targets().len(), log.stops()), (5, 1));

        let (mut unheard, log) = rig();
        let refusal = revolve(&mut unheard, &plan(ViewOrder::Sequential), &settings(), &CancelToken::new(), |_, _| Err(SinkClosed));
        assert!(matches!(refusal, Err(AcquisitionError::SinkClosed { view: 0 })));
        assert_eq!(log.stops(), 1);
    }

    #[test]
    fn a_cancellation_during_a_long_settle_is_not_waited_out() {
        let (mut rig, log) = rig();
        let cancel = CancelToken::new();
        let settings = AcquisitionSettings { settle_ms: 3_600_000, ..settings() };
        std::thread::scope(|scope| {
            let running = scope.spawn(|| revolve(&mut rig, &plan(ViewOrder::Sequential), &settings, &cancel, |_, _| Ok(Next::View)));
            while log.targets().is_empty() {
                std::thread::yield_now();
            }
            cancel.cancel();
            assert!(matches!(running.join().unwrap(), Err(AcquisitionError::Cancelled { view: 0 })));
        });
    }
}
