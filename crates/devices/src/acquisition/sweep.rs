//! A turn in one sweep: the axis turns at a constant speed while the camera runs freely.
//!
//! ```text
//! speed      ┌────────────────────────────────┐
//!           ╱│ rest │ views 0 .. ASD, closure │╲          `rest`: the liquid follows the glass
//! ─────────╱ └──────┴─────────────────────────┘ ╲────── time
//! frames  | | | | | | | | | | | | | | | | | | | | |
//! ```
//! A view has the angle of the axis at the time that the camera's clock gave its frame. The axis begins between the sending of its command
//! and the acknowledgement, so the start is known to half of that time; it is the same error for all views, and turns all of them alike.
//! Only the frames count that were certainly taken at the constant speed. A frame that did not come is a missing view: the next ones keep
//! their angles and numbers.

use super::worker::StopUnlessDone;
use super::{AcquisitionError, AcquisitionSettings, SinkClosed};
use crate::cancel::CancelToken;
use crate::{Begun, Camera, ClockReading, DeviceError, EvenMotion, Rig, RotationAxis, StreamPlan, StreamedFrame};
use carved_core::frame::RawFrame;
use carved_core::units::{Steps, StepsPerRevolution};
use carved_records::{Ledger, LedgerEntry, LedgerError, Light, Method, Swept, sha256_hex};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Frames before the axis begins to turn. The period of the camera is measured on them.
const FRAMES_BEFORE: u32 = 6;
/// Time by which the sweep is longer than needed, for an acknowledgement that comes late, s.
const RUN_OUT_S: f64 = 0.3;
/// Delay with which the arrival may be reported, s. A person needs longer to hold and release an axis.
const LATE_SLACK_S: f64 = 0.3;
/// Time by which the arrival may come early, s: a controller rounds its ramps.
const EARLY_SLACK_S: f64 = 0.05;
/// How long an axis may say why it stands, before it is stopped because nobody receives the views.
const LAST_WORD: Duration = Duration::from_millis(300);
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Largest difference between the closure view and a whole turn, deg. A frame beyond it is not compared with view 0.
const CLOSURE_OFF_DEG: f64 = 0.5;
/// Largest difference between the measured period and the one that was asked for, as a ratio.
const PERIOD_OFF: f64 = 0.03;
/// Shortest time without a frame after which the camera counts as silent.
const SILENCE_S: f64 = 2.0;
/// Uncertainty of the step rate against the camera's clock, as a ratio: two quartz clocks.
const RATE_SD: f64 = 1e-4;
/// Uncertainty of a frame's timestamp, s.
const STAMP_SD_S: f64 = 1e-4;

/// A sweep that cannot be planned, or whose frames do not make a turn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum SweepError {
    /// The camera cannot run freely at this rate.
    #[error(
        "the sweep needs {needed_hz:.1} frames/s, the camera reaches {fastest_hz:.1} at its present exposure and region. Lower \
         sweep.frame_rate_hz, or shorten the exposure"
    )]
    FrameRate { needed_hz: f64, fastest_hz: f64 },
    /// The camera waits for triggers only, or has no clock.
    #[error("this camera cannot run freely by its own clock, so it cannot take a sweep. Choose an order with stops")]
    NoFreeRun,
    /// The camera has no clock that can be read.
    #[error("this camera does not report its clock, so the angles of a sweep are not known. Choose an order with stops")]
    NoClock,
    /// The frames at the constant speed were not all taken before the axis braked.
    #[error(
        "the axis acknowledged the sweep {late_ms:.0} ms after it was sent, so that a turn does not fit into the part with constant speed. Look \
         what keeps this computer busy"
    )]
    Late { late_ms: f64 },
    /// The axis arrived too late or too early for its speed.
    #[error(
        "the axis arrived {late_ms:.0} ms after the time that its speed gives: somebody held it, its speed is not that of the configuration, or \
         this computer was busy"
    )]
    Pace { late_ms: f64 },
    /// Too many frames did not arrive.
    #[error(
        "{missing} of {planned} views of the sweep did not arrive, up to {longest} in a row; at most {allowed} and {allowed_in_a_row} in a row \
         may be missing. Check the network of the camera"
    )]
    Missing { missing: u32, planned: u32, longest: u32, allowed: u32, allowed_in_a_row: u32 },
    /// The period of the camera is not the one that it was asked for.
    #[error("the camera sends a frame every {found_ms:.2} ms; it was asked for one every {asked_ms:.2} ms. Check the exposure time")]
    Period { found_ms: f64, asked_ms: f64 },
}

impl SweepError {
    /// Whether frames did not arrive.
    pub fn is_of_frames(&self) -> bool {
        matches!(self, Self::Missing { .. })
    }

    /// Whether another sweep may succeed: the cause was a busy computer or network.
    pub fn may_be_tried_again(&self) -> bool {
        matches!(self, Self::Late { .. } | Self::Pace { .. } | Self::Missing { .. })
    }
}

/// A turn in one sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepPlan {
    asd: u32,
    steps_per_revolution: StepsPerRevolution,
    frame_rate_hz: f64,
}

/// The way of the axis in a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    from: Steps,
    to: Steps,
}

impl SweepPlan {
    /// Plans `asd` views in one turn, at `frame_rate_hz`.
    ///
    /// # Errors
    /// Fewer than three views.
    pub fn new(asd: u32, steps_per_revolution: StepsPerRevolution, frame_rate_hz: f64) -> Result<Self, super::PlanError> {
        if asd < Method::LEAST_ASD {
            return Err(super::PlanError::TooFew { asd, least: Method::LEAST_ASD });
        }
        Ok(Self { asd, steps_per_revolution, frame_rate_hz })
    }

    /// Number of views, without the closure view.
    pub fn asd(&self) -> u32 {
        self.asd
    }

    /// Frames per second.
    pub fn frame_rate_hz(&self) -> f64 {
        self.frame_rate_hz
    }

    /// Steps of a turn.
    fn turn(&self) -> f64 {
        let [num, den] = <[u32; 2]>::from(self.steps_per_revolution);
        f64::from(num) / f64::from(den)
    }

    /// The constant speed, steps/s.
    pub fn steps_per_s(&self) -> f64 {
        self.turn() * self.frame_rate_hz / f64::from(self.asd)
    }

    /// Speed of a point at this distance from the axis, um/s.
    pub fn speed_um_per_s(&self, radius_um: f64) -> f64 {
        std::f64::consts::TAU * radius_um * self.frame_rate_hz / f64::from(self.asd)
    }

    /// Checks that axis and camera can do it.
    ///
    /// # Errors
    /// Both values, and what to change.
    pub fn check(&self, axis: &dyn RotationAxis, camera: &mut dyn Camera) -> Result<(), AcquisitionError> {
        let device = |source| AcquisitionError::Device { view: 0, source };
        self.even_motion(axis).map_err(device)?;
        let needed_hz = self.frame_rate_hz;
        match camera.highest_rate_hz().map_err(device)? {
            None => Err(SweepError::NoFreeRun.into()),
            // A camera rounds its rate.
            Some(fastest_hz) if fastest_hz < 0.99 * needed_hz => Err(SweepError::FrameRate { needed_hz, fastest_hz }.into()),
            Some(_) => Ok(()),
        }
    }

    fn even_motion(&self, axis: &dyn RotationAxis) -> Result<EvenMotion, DeviceError> {
        // The measured period may be shorter than the one that was asked for.
        let steps_per_s = self.steps_per_s() / (1.0 - PERIOD_OFF);
        match axis.even_motion() {
            Some(can) if can.fastest_steps_per_s >= steps_per_s => Ok(can),
            can => Err(DeviceError::Uneven { steps_per_s, fastest: can.map(|can| can.fastest_steps_per_s) }),
        }
    }

    /// The way for a camera with this period. `rest_s`: time at the constant speed before the first view.
    fn way(&self, can: EvenMotion, period_s: f64, rest_s: f64) -> Way {
        let steps_per_s = self.turn() / (f64::from(self.asd) * period_s);
        let ramp = steps_per_s.powi(2) / (2.0 * can.acceleration_steps_per_s2);
        let before = ramp + steps_per_s * rest_s;
        let after = ramp + steps_per_s * (RUN_OUT_S + 3.0 * period_s);
        Way { from: Steps(-before.ceil() as i64), to: Steps((self.turn() + after).ceil() as i64) }
    }

    /// Checks that few enough views are missing: at most a tenth of all, and gaps of at most a twentieth of the turn.
    fn check_complete(&self, ledger: &Ledger) -> Result<(), SweepError> {
        let mut taken: Vec<u32> = ledger.carved().map(|entry| entry.view).collect();
        taken.sort_unstable();
        let missing = self.asd - taken.len() as u32;
        // The turn goes on at its end with its first view.
        let ends = taken.first().map(|first| first + self.asd);
        let longest = taken.iter().zip(taken.iter().skip(1).copied().chain(ends)).map(|(a, b)| b - a - 1).max().unwrap_or(self.asd);
        let (allowed, allowed_in_a_row) = (self.asd / 10, self.asd / 20);
        if missing > allowed || longest > allowed_in_a_row {
            return Err(SweepError::Missing { missing, planned: self.asd, longest, allowed, allowed_in_a_row });
        }
        Ok(())
    }
}

/// The constant part of a sweep, in the camera's time.
#[derive(Debug, Clone, Copy)]
struct Constant {
    /// Times between which all frames count, ns.
    since_ns: f64,
    until_ns: f64,
    /// Times between which the axis arrives, ns.
    arrives_ns: [f64; 2],
    /// Position at `since_ns` if the axis began in the middle of its bracket, steps.
    at_since: f64,
    steps_per_s: f64,
    /// Uncertainty of the start, s.
    start_sd_s: f64,
    late_s: f64,
}

impl Constant {
    fn of(way: Way, begun: Begun, clock: ClockReading, rest_s: f64) -> Self {
        let (v, a) = (begun.steps_per_s, begun.acceleration_steps_per_s2);
        let ramp_s = v / a;
        let [sent, taken] = [begun.sent, begun.taken].map(|at| clock.camera_ns_at(at));
        let late_s = (taken - sent) * 1e-9;
        // From the beginning of the first ramp to the beginning of the last one.
        let constant_s = ((way.to.0 - way.from.0) as f64 / v).max(ramp_s);
        let since_ns = taken + (ramp_s + rest_s) * 1e9;
        let start_ns = f64::midpoint(sent, taken);
        Self {
            since_ns,
            until_ns: sent + constant_s * 1e9,
            arrives_ns: [sent, taken].map(|began| began + (constant_s + ramp_s) * 1e9),
            at_since: way.from.0 as f64 + v * (since_ns - start_ns) * 1e-9 - v * ramp_s / 2.0,
            steps_per_s: v,
            start_sd_s: late_s / 12.0_f64.sqrt(),
            late_s,
        }
    }

    /// Whether a turn fits between the two ramps.
    fn has_room(&self, turn: f64) -> bool {
        self.steps_per_s * (self.until_ns - self.since_ns) * 1e-9 >= turn
    }

    /// The position at a time of the camera, steps.
    fn at(&self, camera_ns: u64) -> f64 {
        self.at_since + self.steps_per_s * (camera_ns as f64 - self.since_ns) * 1e-9
    }
}

/// Takes the views of a sweep with an armed camera and an axis that has its reference. `sink` receives each view as its frame comes, the
/// closure view last. It must not wait for the science: use a bounded channel that can hold a revolution.
///
/// # Errors
/// The first device error, change of epoch, cancellation or closed sink ends the sweep, as do frames that do not make a turn. The motor is
/// stopped, and the axis needs a new reference.
pub fn sweep(
    rig: &mut Rig,
    plan: &SweepPlan,
    settings: &AcquisitionSettings,
    cancel: &CancelToken,
    sink: impl FnMut(LedgerEntry, RawFrame) -> Result<(), SinkClosed>,
) -> Result<Ledger, AcquisitionError> {
    let stop = rig.rotation.stop_handle();
    let guard = StopUnlessDone::of(stop.clone());
    let failed =
        |source| if cancel.is_cancelled() { AcquisitionError::Cancelled { view: 0 } } else { AcquisitionError::Device { view: 0, source } };
    let can = plan.even_motion(rig.rotation.as_ref()).map_err(failed)?;
    let rest_s = f64::from(settings.settle_ms) * 1e-3;
    // The period is measured before the axis turns. Until then the longest way counts.
    let way = plan.way(can, (1.0 - PERIOD_OFF) / plan.frame_rate_hz, rest_s);
    let stands = rig.rotation.move_to(way.from).map_err(failed)?;
    if cancel.rest(Duration::from_millis(settings.settle_ms.into())) {
        return Err(AcquisitionError::Cancelled { view: 0 });
    }
    let clock = rig.camera.clock().map_err(failed)?.ok_or(SweepError::NoClock)?;
    let Rig { rotation, camera } = rig;
    let has_failed = &AtomicBool::new(false);
    let (moved, mut taker) = std::thread::scope(|scope| -> Result<_, AcquisitionError> {
        // The scope waits for the axis, so a motion that is not wanted any more ends within it, also in a panic.
        let moving = StopUnlessDone::of(stop.clone());
        let (go, may_go) = mpsc::channel::<f64>();
        let (tell, begun) = mpsc::channel::<Begun>();
        let turns = std::thread::Builder::new().name("carved-sweep".into()).spawn_scoped(scope, move || {
            // Without frames nothing turns.
            let Ok(steps_per_s) = may_go.recv() else { return Ok(None) };
            let moved = rotation.move_evenly(way.to, steps_per_s, &mut |at| {
                let _gone = tell.send(at);
            });
            has_failed.store(moved.is_err(), Ordering::Release);
            moved.map(|arrived| Some((arrived, Instant::now())))
        });
        let axis = turns.map_err(|why| failed(DeviceError::Unwatched { phase: "revolve", why: why.to_string() }))?;
        let frames = Frames::Before { first: None, go, begun };
        let mut taker = Taker {
            plan,
            settings,
            cancel,
            clock,
            rest_s,
            way,
            epoch: stands.epoch,
            frames,
            arrives_ns: None,
            ledger: Ledger::default(),
            sink,
            ended: None,
        };
        let stream = StreamPlan {
            rate_hz: plan.frame_rate_hz,
            buffers: plan.asd + 4 * FRAMES_BEFORE,
            silence: Duration::from_secs_f64(SILENCE_S.max(4.0 / plan.frame_rate_hz)),
        };
        let streamed = camera
            .stream(&stream, &mut |frame| if has_failed.load(Ordering::Acquire) { ControlFlow::Break(()) } else { taker.take(frame) });
        // The stream ends with checks of the camera, which come after the last view.
        if let Err(source) = streamed
            && !matches!(taker.ended, Some(Err(_)))
        {
            taker.ended = Some(Err(failed(source)));
        }
        // A person at the controller is the cause to report, and a held controller gets no stop.
        if matches!(taker.ended, Some(Err(AcquisitionError::SinkClosed { .. }))) {
            let until = Instant::now() + LAST_WORD;
            while Instant::now() < until && !axis.is_finished() && !cancel.rest(LOOK_AGAIN) {}
        }
        if matches!(taker.ended, Some(Ok(()))) {
            moving.done();
        } else {
            drop(moving);
        }
        // An axis that waits for its speed ends here.
        taker.frames = Frames::Over;
        Ok((axis.join(), taker))
    })?;
    let moved = moved.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    match (taker.ended.take(), moved) {
        (Some(Ok(())), Ok(None)) => {}
        (Some(Ok(())), Ok(Some((arrived, at)))) => {
            if arrived.epoch != stands.epoch {
                return Err(LedgerError::EpochChanged { view: plan.asd, expected: stands.epoch, found: arrived.epoch }.into());
            }
            taker.check_arrival(at)?;
        }
        // An axis that fails ends the stream too.
        (_, Err(source)) if !matches!(source, DeviceError::Stopped) => return Err(failed(source)),
        (Some(Err(error)), _) => return Err(error),
        (_, Err(source)) => return Err(failed(source)),
        (None, Ok(_)) => return Err(AcquisitionError::Cancelled { view: 0 }),
    }
    plan.check_complete(&taker.ledger)?;
    guard.done();
    Ok(taker.ledger)
}

/// The frames so far.
enum Frames {
    /// The axis stands, and the period is measured.
    Before {
        first: Option<(u64, u64)>,
        go: mpsc::Sender<f64>,
        begun: mpsc::Receiver<Begun>,
    },
    /// The axis turns. `zero`: the position of view 0, steps.
    Turning {
        constant: Constant,
        zero: Option<f64>,
        period_ms: f64,
    },
    Over,
}

/// Gives each frame of a sweep its view and angle.
struct Taker<'a, S> {
    plan: &'a SweepPlan,
    settings: &'a AcquisitionSettings,
    cancel: &'a CancelToken,
    clock: ClockReading,
    rest_s: f64,
    way: Way,
    epoch: u32,
    frames: Frames,
    /// The camera's times between which the axis arrives at its speed, ns.
    arrives_ns: Option<[f64; 2]>,
    ledger: Ledger,
    sink: S,
    /// The closure view was taken, or the sweep has failed.
    ended: Option<Result<(), AcquisitionError>>,
}

impl<S: FnMut(LedgerEntry, RawFrame) -> Result<(), SinkClosed>> Taker<'_, S> {
    fn take(&mut self, frame: StreamedFrame) -> ControlFlow<()> {
        if self.cancel.is_cancelled() {
            self.ended = Some(Err(AcquisitionError::Cancelled { view: self.next_view() }));
            return ControlFlow::Break(());
        }
        let taken = match &self.frames {
            Frames::Before { .. } => self.take_before(&frame),
            Frames::Turning { .. } => self.take_turning(frame),
            Frames::Over => ControlFlow::Break(Ok(())),
        };
        taken.map_break(|ended| self.ended = Some(ended))
    }

    fn next_view(&self) -> u32 {
        self.ledger.entries().last().map_or(0, |last| last.view + 1)
    }

    /// Measures the period, and lets the axis turn once it is known.
    fn take_before(&mut self, frame: &StreamedFrame) -> ControlFlow<Result<(), AcquisitionError>> {
        let Frames::Before { first, go, begun } = &mut self.frames else { return ControlFlow::Continue(()) };
        let (first_id, first_ns) = *first.get_or_insert((frame.frame_id, frame.camera_ns));
        let periods = frame.frame_id.saturating_sub(first_id);
        if periods < u64::from(FRAMES_BEFORE) {
            return ControlFlow::Continue(());
        }
        let period_s = frame.camera_ns.saturating_sub(first_ns) as f64 * 1e-9 / periods as f64;
        let asked_s = 1.0 / self.plan.frame_rate_hz;
        if (period_s / asked_s - 1.0).abs() > PERIOD_OFF {
            let error = SweepError::Period { found_ms: period_s * 1e3, asked_ms: asked_s * 1e3 };
            return ControlFlow::Break(Err(error.into()));
        }
        let steps_per_s = self.plan.turn() / (f64::from(self.plan.asd) * period_s);
        // Without an answer the axis has ended, and says why. The camera has buffers for the time of the acknowledgement.
        let Some(begun) = go.send(steps_per_s).ok().and_then(|()| begun.recv().ok()) else { return ControlFlow::Continue(()) };
        let constant = Constant::of(self.way, begun, self.clock, self.rest_s);
        if !constant.has_room(self.plan.turn()) {
            return ControlFlow::Break(Err(SweepError::Late { late_ms: constant.late_s * 1e3 }.into()));
        }
        self.arrives_ns = Some(constant.arrives_ns);
        self.frames = Frames::Turning { constant, zero: None, period_ms: period_s * 1e3 };
        ControlFlow::Continue(())
    }

    /// An axis that was held and went on has arrived late, and one that was told another speed than it has, late or early. The views then
    /// have other angles.
    fn check_arrival(&self, at: Instant) -> Result<(), SweepError> {
        let Some([earliest_ns, latest_ns]) = self.arrives_ns else { return Ok(()) };
        let seconds = |ns: f64| ns * 1e-9 / self.clock.scale;
        let at_ns = self.clock.camera_ns_at(at);
        let (early_s, late_s) = (seconds(earliest_ns - at_ns), seconds(at_ns - latest_ns));
        if early_s > EARLY_SLACK_S || late_s > LATE_SLACK_S { Err(SweepError::Pace { late_ms: late_s * 1e3 }) } else { Ok(()) }
    }

    /// Hands on a frame of the part with constant speed.
    fn take_turning(&mut self, frame: StreamedFrame) -> ControlFlow<Result<(), AcquisitionError>> {
        let Frames::Turning { constant, zero, period_ms } = &mut self.frames else { return ControlFlow::Continue(()) };
        let (camera_ns, turn, asd) = (frame.camera_ns, self.plan.turn(), self.plan.asd);
        if (camera_ns as f64) < constant.since_ns {
            return ControlFlow::Continue(());
        }
        if camera_ns as f64 > constant.until_ns {
            // The frames of the turn did not arrive.
            return ControlFlow::Break(Ok(()));
        }
        let at = constant.at(camera_ns);
        let since_zero = at - *zero.get_or_insert(at);
        let view = (since_zero / turn * f64::from(asd)).round() as u32;
        let (start_sd_s, period_ms, steps_per_s) = (constant.start_sd_s, *period_ms, constant.steps_per_s);
        if view < self.next_view() {
            return ControlFlow::Continue(());
        }
        let rad = std::f64::consts::TAU / turn;
        // The closure view did not arrive, or lies beside the whole turn, because the controller has rounded its speed.
        if view > asd || (view == asd && ((since_zero - turn) * rad).to_degrees().abs() > CLOSURE_OFF_DEG) {
            return ControlFlow::Break(Ok(()));
        }
        let sd_steps = (steps_per_s * start_sd_s).hypot(steps_per_s * STAMP_SD_S).hypot(RATE_SD * since_zero);
        let entry = LedgerEntry {
            view,
            retake: 0,
            commanded_steps: Steps((at - since_zero + turn * f64::from(view) / f64::from(asd)).round() as i64),
            achieved_steps: Steps(at.round() as i64),
            epoch: self.epoch,
            omega: self.settings.sense.sign() * at * rad,
            swept: Some(Swept { camera_ns, omega_sd: sd_steps * rad }),
            moved_ms: period_ms,
            settle_ms: 0.0,
            grab_ms: 0.0,
            trigger_ms: 0.0,
            light: Some(Light::of(&frame.frame)),
            frame_id: frame.frame_id,
            attempts: 1,
            sha256: sha256_hex(frame.frame.bytes()),
            second: None,
            closure: view == asd,
        };
        if let Err(error) = self.ledger.push(entry.clone()) {
            return ControlFlow::Break(Err(error.into()));
        }
        match (self.sink)(entry, frame.frame) {
            Err(SinkClosed) => ControlFlow::Break(Err(AcquisitionError::SinkClosed { view })),
            Ok(()) if view == asd => ControlFlow::Break(Ok(())),
            Ok(()) => ControlFlow::Continue(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{AxisLog, FakeAxis, FakeCamera, Scripted};
    use carved_core::frame::PixelFormat;
    use carved_core::units::Sense;
    use std::sync::{Arc, Mutex};

    const CAN: EvenMotion = EvenMotion { fastest_steps_per_s: 1000.0, acceleration_steps_per_s2: 2000.0 };
    const ASD: u32 = 84;
    const HZ: f64 = 30.0;

    fn plan() -> SweepPlan {
        SweepPlan::new(ASD, StepsPerRevolution::new(500, 1).unwrap(), HZ).unwrap()
    }

    fn settings() -> AcquisitionSettings {
        AcquisitionSettings { settle_ms: 50, grab_deadline_ms: 100, sense: Sense::Negative }
    }

    /// Time before the reading of the camera's clock at which the frames begin, s: longer than the move of the fake axis.
    const BEFORE_S: f64 = 5.0;

    /// Frames of a camera with this period, long enough for any delay of the test. Those that `lost` names do not arrive.
    fn frames(period_ms: f64, lost: impl Fn(u64) -> bool) -> Vec<Scripted> {
        let frame = |id: u64| RawFrame::new(2, 1, PixelFormat::Mono8, vec![(id % 251) as u8; 2]).unwrap();
        let scripted = |id: u64| Scripted {
            frame_id: id,
            camera_ns: FakeCamera::CLOCK_NS - (BEFORE_S * 1e9) as u64 + (id as f64 * period_ms * 1e6) as u64,
            frame: (!lost(id)).then(|| frame(id)),
        };
        (1..4000).map(scripted).collect()
    }

    fn rig(axis: FakeAxis, script: impl Fn() -> Vec<Scripted> + Send + 'static) -> (Rig, AxisLog) {
        let log = axis.log();
        let camera = FakeCamera::default().streaming(59.0, move |_, _| Ok(script()));
        (Rig { rotation: Box::new(axis.referenced()), camera: Box::new(camera) }, log)
    }

    type Taken = Result<(Ledger, Vec<LedgerEntry>), AcquisitionError>;

    fn taken(rig: &mut Rig) -> Taken {
        let mut seen = Vec::new();
        let ledger = sweep(rig, &plan(), &settings(), &CancelToken::new(), |entry, frame| {
            assert_eq!(u64::from(frame.bytes()[0]), entry.frame_id % 251, "each view has its own frame");
            seen.push(entry);
            Ok(())
        })?;
        Ok((ledger, seen))
    }

    /// The position of a trapezoid of speed at a time after its start, steps.
    fn travelled(since_s: f64, speed: f64, acceleration: f64) -> f64 {
        let ramp_s = speed / acceleration;
        if since_s < ramp_s { acceleration * since_s.powi(2) / 2.0 } else { speed * (since_s - ramp_s / 2.0) }
    }

    #[test]
    fn each_view_has_the_angle_of_the_axis_at_the_time_of_its_frame() {
        // The camera's clock and its rate are not quite those that were asked for.
        for period_ms in [1e3 / HZ, 1.01e3 / HZ] {
            let (mut rig, log) = rig(FakeAxis::new().even(CAN), move || frames(period_ms, |_| false));
            // The clock is read when the axis stands at the beginning of its way.
            let began = Instant::now();
            let (ledger, seen) = taken(&mut rig).unwrap();
            let begun = log.begun().unwrap();
            assert!((begun.steps_per_s - 500.0 / (f64::from(ASD) * period_ms * 1e-3)).abs() < 1e-3, "{begun:?}");
            assert!(ledger.entries().iter().eq(&seen));
            assert_eq!(ledger.carved().count(), ASD as usize);
            let [from, to] = log.targets()[..] else { panic!("{:?}", log.targets()) };
            assert!(from.0 < 0 && to.0 > 500);
            // Nobody knows here when the clock was read, except that it was between the two instants.
            let took_s = (to.0 - from.0) as f64 / begun.steps_per_s + begun.steps_per_s / CAN.acceleration_steps_per_s2;
            let ended = began.elapsed().as_secs_f64();
            let uncertain = ended * begun.steps_per_s;
            for entry in &seen {
                let camera_s = (entry.swept.unwrap().camera_ns as f64 - FakeCamera::CLOCK_NS as f64) * 1e-9;
                // The move began this long before the earliest reading.
                let since_s = camera_s + took_s;
                let latest = from.0 as f64 + travelled(since_s, begun.steps_per_s, CAN.acceleration_steps_per_s2);
                let steps = -entry.omega / std::f64::consts::TAU * 500.0;
                assert!(steps <= latest + 0.01 && steps >= latest - uncertain - 0.01, "view {}: {steps} of {latest}", entry.view);
                assert_eq!(entry.achieved_steps, Steps(steps.round() as i64));
            }
            for pair in seen.windows(2) {
                let spacing = (pair[0].omega - pair[1].omega).to_degrees();
                assert!((spacing - 360.0 / f64::from(ASD)).abs() < 1e-3, "{spacing} deg");
                assert_eq!(pair[1].view, pair[0].view + 1);
            }
            let closure = ledger.closure().unwrap();
            assert!((closure.omega - seen[0].omega + std::f64::consts::TAU).abs() < 1e-4 && closure.view == ASD);
            assert_eq!(log.stops(), 0, "a finished sweep keeps its reference");
        }
    }

    #[test]
    fn a_frame_that_does_not_arrive_is_a_missing_view_and_shifts_no_other() {
        let (mut whole, _) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |_| false));
        let (_, whole) = taken(&mut whole).unwrap();
        // Every 17th frame of the camera, wherever the turn begins.
        let (mut lossy, _) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |id| id % 17 == 9));
        let (ledger, seen) = taken(&mut lossy).unwrap();
        let missing = ASD + 1 - seen.len() as u32;
        assert!((4..=5).contains(&missing), "{missing}");
        for entry in &seen {
            assert!((entry.frame_id - seen[0].frame_id) == u64::from(entry.view - seen[0].view));
            let expected = f64::from(entry.view) * std::f64::consts::TAU / f64::from(ASD);
            assert!((seen[0].omega - entry.omega - expected).abs() < 1e-3, "view {}", entry.view);
        }
        assert_eq!(whole.len(), ASD as usize + 1);
        assert!(ledger.carved().count() < ASD as usize);
    }

    fn refusal(taken: Taken) -> SweepError {
        match taken {
            Err(AcquisitionError::Sweep(error)) => error,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_turn_with_a_gap_or_a_camera_with_another_period_is_refused_and_the_motor_is_stopped() {
        // Ten frames in a row, wherever the turn begins.
        let (mut gap, log) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |id| id > 20 && id % 40 < 10));
        assert!(matches!(refusal(taken(&mut gap)), SweepError::Missing { longest: 10, allowed_in_a_row: 4, planned: ASD, .. }));
        assert_eq!(log.stops(), 1);
        let (mut slow, log) = rig(FakeAxis::new().even(CAN), || frames(1.1e3 / HZ, |_| false));
        assert!(matches!(refusal(taken(&mut slow)), SweepError::Period { .. }));
        assert_eq!((log.targets().len(), log.begun()), (1, None), "nothing was swept");
    }

    #[test]
    fn an_axis_that_arrives_at_another_time_than_its_speed_says_has_not_swept() {
        for (late_s, is_one) in [(0.0, true), (0.1, true), (1.0, false), (-0.3, false)] {
            let (mut rig, _) = rig(FakeAxis::new().even(CAN).late_by(late_s), || frames(1e3 / HZ, |_| false));
            match taken(&mut rig) {
                Ok(_) => assert!(is_one, "{late_s}"),
                Err(AcquisitionError::Sweep(SweepError::Pace { late_ms })) => {
                    assert!(!is_one && (late_ms * 1e-3 - late_s).abs() < 0.3, "{late_s}: {late_ms} ms");
                }
                other => panic!("{other:?}"),
            }
        }
    }

    /// The camera finds its fault after the last view.
    #[test]
    fn an_error_at_the_end_of_the_stream_is_an_error_of_the_sweep() {
        let (mut rig, log) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |_| false));
        rig.camera = Box::new(
            FakeCamera::default().streaming(59.0, |_, _| Ok(frames(1e3 / HZ, |_| false))).ending_with(|| DeviceError::ControlLost),
        );
        assert!(matches!(taken(&mut rig), Err(AcquisitionError::Device { source: DeviceError::ControlLost, .. })));
        assert!(log.stops() > 0);
    }

    /// The frames of the last second do not arrive, and then one after the turn.
    #[test]
    fn frames_that_are_lost_to_the_end_of_the_turn_are_missing_views() {
        let lost = |id: u64| (60..95).contains(&id);
        let (mut rig, _) = rig(FakeAxis::new().even(CAN), move || frames(1e3 / HZ, lost));
        assert!(matches!(refusal(taken(&mut rig)), SweepError::Missing { .. }));
        let (mut rig, _) = self::rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |id| id > 60 && id < 3000));
        assert!(matches!(refusal(taken(&mut rig)), SweepError::Missing { .. }), "the next frame comes long after the turn");
    }

    #[test]
    fn an_acknowledgement_that_comes_too_late_ends_the_sweep() {
        let way = plan().way(CAN, 1.0 / HZ, 0.05);
        let host = Instant::now();
        let clock = ClockReading { camera_ns: FakeCamera::CLOCK_NS, host, scale: 1.0 };
        let after = |late_ms: u64| {
            let taken = host + Duration::from_millis(late_ms);
            let begun = Begun { sent: host, taken, steps_per_s: plan().steps_per_s(), acceleration_steps_per_s2: 2000.0 };
            Constant::of(way, begun, clock, 0.05).has_room(500.0)
        };
        assert!(after(5) && after(250));
        assert!(!after(600));
    }

    #[test]
    fn what_cannot_sweep_is_refused_before_anything_turns() {
        let camera = || FakeCamera::default().streaming(59.0, |_, _| Ok(Vec::new()));
        let device = |checked| match checked {
            Err(AcquisitionError::Device { source, .. }) => source,
            other => panic!("{other:?}"),
        };
        let uneven = device(plan().check(&FakeAxis::new(), &mut camera()));
        assert!(matches!(uneven, DeviceError::Uneven { fastest: None, .. }));
        let slow = FakeAxis::new().even(EvenMotion { fastest_steps_per_s: 100.0, ..CAN });
        let said = device(plan().check(&slow, &mut camera())).to_string();
        assert!(said.contains("184.1 steps/s") && said.contains("at most 100.0"), "{said}");
        let axis = FakeAxis::new().even(CAN);
        assert!(matches!(plan().check(&axis, &mut FakeCamera::default()), Err(AcquisitionError::Sweep(SweepError::NoFreeRun))));
        let fast = SweepPlan::new(ASD, StepsPerRevolution::new(500, 1).unwrap(), 70.0).unwrap();
        let refused = refusal(fast.check(&axis, &mut camera()).map(|()| (Ledger::default(), Vec::new())));
        assert_eq!(refused, SweepError::FrameRate { needed_hz: 70.0, fastest_hz: 59.0 });
        plan().check(&axis, &mut camera()).unwrap();
    }

    #[test]
    fn a_failing_axis_a_silent_camera_and_a_cancellation_end_the_sweep() {
        let failing = || DeviceError::Gone { device: "axis", why: "pulled".into() };
        let calls = Arc::new(Mutex::new(0));
        let axis = FakeAxis::new().even(CAN).answering(move || {
            *calls.lock().unwrap() += 1;
            // The way to the beginning succeeds.
            if *calls.lock().unwrap() > 1 { Err(failing()) } else { Ok(()) }
        });
        let (mut pulled, _) = rig(axis, || frames(1e3 / HZ, |_| false));
        assert!(matches!(taken(&mut pulled), Err(AcquisitionError::Device { source: DeviceError::Gone { .. }, .. })));

        let (mut silent, log) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |id| id > 30));
        assert!(matches!(taken(&mut silent), Err(AcquisitionError::Device { source: DeviceError::StreamSilent { .. }, .. })));
        assert!(log.stops() > 0);

        let cancel = CancelToken::new();
        let (mut cancelled, log) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |_| false));
        let ended = sweep(&mut cancelled, &plan(), &settings(), &cancel, |entry, _| {
            if entry.view == 7 {
                cancel.cancel();
            }
            Ok(())
        });
        assert!(matches!(ended, Err(AcquisitionError::Cancelled { view: 8 })), "{ended:?}");
        assert!(log.stops() > 0);
        let (mut unheard, _) = rig(FakeAxis::new().even(CAN), || frames(1e3 / HZ, |_| false));
        let ended = sweep(&mut unheard, &plan(), &settings(), &CancelToken::new(), |_, _| Err(SinkClosed));
        assert!(matches!(ended, Err(AcquisitionError::SinkClosed { view: 0 })));
    }
}
