//! The camera running free: frames by their numbers and by the camera's clock.
//!
//! ```text
//!   trigger off, rate ─► camera's clock ─► new stream ─► pop ─► number ─► time ─► sink ── break ─► camera's clock ─► arm
//!                          c0 in [a0, b0]                  16 bits  not beyond the          c1 in [a1, b1]
//!                                                          counted  host's clock
//!                                                          on
//! ```
//! The camera's clock is read on the control channel before and after the stream, each time between two looks at this computer's clock.
//! So c1 - c0 must lie between a1 - b0 and b1 - a0, however late an answer is. No frame can have been taken later than it was received.
//! A slow computer therefore never makes a good clock look wrong.

use super::accept::{Verdict, accept};
use super::stream::{Armed, BUFFERS};
use super::{AravisCamera, Open, configure, refused};
use crate::{Camera, DeviceError, FrameSink, StreamEnd, StreamPlan, StreamedFrame};
use aravis::prelude::*;
use std::time::{Duration, Instant, SystemTime};

/// Share by which the camera's clock may differ from this computer's. Crystals differ by 100 ppm.
const CLOCK_TOLERANCE: f64 = 0.02;
/// Longest wait for a frame before the loop looks whether the camera is lost.
const LOOK: Duration = Duration::from_millis(100);
/// GenICam's names of the highest rate at the present region and exposure. Where a camera has none, the bound of its rate says it.
const RATE_LIMITS: [&str; 3] = ["AcquisitionFrameRateLimit", "ResultingFrameRate", "ResultingFrameRateAbs"];
/// Frame numbers of 16 bits count from 1 to this one.
const LAST_NUMBER: u64 = 65_535;

/// The highest rate of a camera that can run free and has a clock.
pub(super) fn highest_rate_hz(open: &Open) -> Result<Option<f64>, DeviceError> {
    let camera = &open.camera;
    if open.clock.is_none() || !camera.is_frame_rate_available().map_err(|e| refused("its frame rate", &e))? {
        return Ok(None);
    }
    let (_, mut highest) = camera.frame_rate_bounds().map_err(|e| refused("its frame rate", &e))?;
    for name in RATE_LIMITS {
        if camera.is_feature_available(name).map_err(|e| refused(name, &e))? {
            highest = highest.min(camera.float(name).map_err(|e| refused(name, &e))?);
        }
    }
    Ok(Some(highest))
}

/// A reading of the camera's clock, between two looks at this computer's.
#[derive(Debug, Clone, Copy)]
struct Reading {
    before: Instant,
    camera_ns: u64,
    after: Instant,
}

impl Reading {
    /// `None` for a camera without a clock.
    fn of(open: &Open) -> Result<Option<Self>, DeviceError> {
        let before = Instant::now();
        let camera_ns = open.now_ns().map_err(|e| refused("a look at its clock", &e))?;
        Ok(camera_ns.map(|camera_ns| Self { before, camera_ns, after: Instant::now() }))
    }
}

/// The beginning of a stream by the camera's clock, ns, with room to count on.
pub(super) fn without_highest_bit(camera_ns: u64) -> u64 {
    camera_ns & (u64::MAX >> 1)
}

/// The camera's clock during a stream, counted on over a wrap and held against this computer's clock.
#[derive(Debug, Clone)]
struct CountedClock {
    ticks_per_s: u64,
    /// Seconds of the camera's clock per second of this computer's.
    scale: f64,
    start: Reading,
    last_ns: u64,
    /// Since the start.
    elapsed_ns: u64,
}

impl CountedClock {
    fn starting(start: Reading, ticks_per_s: u64, scale: f64) -> Self {
        Self { ticks_per_s, scale, start, last_ns: start.camera_ns, elapsed_ns: 0 }
    }

    /// Time since the last one, ns. 64 bits wrap after 2^64 ticks. Aravis converts them to ns of 64 bits, which wrap too.
    fn since_last(&self, camera_ns: u64) -> u64 {
        let ahead = camera_ns.wrapping_sub(self.last_ns);
        if camera_ns >= self.last_ns || self.ticks_per_s <= 1_000_000_000 {
            return ahead;
        }
        let period_ns = (1u128 << 64) * 1_000_000_000 / u128::from(self.ticks_per_s);
        (period_ns + u128::from(camera_ns)).saturating_sub(u128::from(self.last_ns)) as u64
    }

    /// The camera time of a frame that was received at `received`, counted on, ns. `None` if the frame was taken before the start.
    fn advance(&mut self, camera_ns: u64, received: Instant) -> Result<Option<u64>, DeviceError> {
        let step_ns = self.since_last(camera_ns);
        // A step back is more than half of what 64 bits can count.
        let is_back = step_ns > u64::MAX / 2 || step_ns == 0;
        if is_back && self.elapsed_ns == 0 {
            return Ok(None);
        }
        if is_back {
            return Err(self.restarted(camera_ns));
        }
        let elapsed_ns = self.elapsed_ns.saturating_add(step_ns);
        let passed_s = received.saturating_duration_since(self.start.before).as_secs_f64();
        if elapsed_ns as f64 * 1e-9 > passed_s * self.scale * (1.0 + CLOCK_TOLERANCE) {
            return Err(if camera_ns < self.last_ns { self.restarted(camera_ns) } else { self.wrong(elapsed_ns, passed_s) });
        }
        (self.elapsed_ns, self.last_ns) = (elapsed_ns, camera_ns);
        Ok(Some(without_highest_bit(self.start.camera_ns) + elapsed_ns))
    }

    /// Compares both clocks after the last frame.
    fn finish(&mut self, end: Reading) -> Result<(), DeviceError> {
        let step_ns = self.since_last(end.camera_ns);
        if step_ns > u64::MAX / 2 {
            return Err(self.restarted(end.camera_ns));
        }
        let elapsed_ns = self.elapsed_ns.saturating_add(step_ns);
        let least_s = end.before.saturating_duration_since(self.start.after).as_secs_f64();
        let most_s = end.after.saturating_duration_since(self.start.before).as_secs_f64();
        let camera_s = elapsed_ns as f64 * 1e-9 / self.scale;
        if (least_s * (1.0 - CLOCK_TOLERANCE)..=most_s * (1.0 + CLOCK_TOLERANCE)).contains(&camera_s) {
            return Ok(());
        }
        Err(self.wrong(elapsed_ns, 0.5 * (least_s + most_s)))
    }

    fn restarted(&self, camera_ns: u64) -> DeviceError {
        let seconds = |ns: u64| format!("{:.6} s", ns as f64 * 1e-9);
        DeviceError::StreamRestarted { counter: "clock", before: seconds(self.last_ns), after: seconds(camera_ns) }
    }

    fn wrong(&self, elapsed_ns: u64, host_s: f64) -> DeviceError {
        DeviceError::CameraClock { camera_s: elapsed_ns as f64 * 1e-9, host_s: host_s * self.scale, ticks_per_s: self.ticks_per_s }
    }
}

/// The numbers of a stream's frames, counted on where 16 bits wrap. Numbers of 64 bits do not wrap.
#[derive(Debug, Clone, Default)]
struct CountedNumbers {
    /// As the camera counts, and counted on.
    last: Option<(u64, u64)>,
}

impl CountedNumbers {
    /// The number of a frame that comes after the last one, counted on. `None` for the last one again.
    fn advance(&mut self, number: u64) -> Result<Option<u64>, DeviceError> {
        let Some((last, _)) = self.last.filter(|(last, _)| *last != number) else {
            let is_first = self.last.is_none();
            self.last = self.last.or(Some((number, number)));
            return Ok(is_first.then_some(number));
        };
        let Some(counted) = self.following(number) else {
            return Err(DeviceError::StreamRestarted { counter: "frame number", before: last.to_string(), after: number.to_string() });
        };
        self.last = Some((number, counted));
        Ok(Some(counted))
    }

    /// `number` counted on, if it comes after the last one. A step back is more than half of what 16 bits can count.
    fn following(&self, number: u64) -> Option<u64> {
        let (last, counted) = self.last?;
        match number.checked_sub(last) {
            Some(step) => (step > 0).then_some(counted + step),
            // Number 0 is left out.
            None if (1..=LAST_NUMBER).contains(&number) && last <= LAST_NUMBER => {
                Some(number + LAST_NUMBER - last).filter(|step| *step <= LAST_NUMBER / 2).map(|step| counted + step)
            }
            None => None,
        }
    }
}

impl AravisCamera {
    /// [`Camera::stream`].
    pub(super) fn run_free(&mut self, plan: &StreamPlan, sink: FrameSink<'_>) -> Result<StreamEnd, DeviceError> {
        if self.armed.is_some() && !self.is_lost() {
            self.disarm()?;
        }
        self.reopen()?;
        self.settle()?;
        let ran = self.frames(plan, sink);
        // Afterwards the camera waits for triggers again, whatever the stream came to.
        let waits = self.wait_for_triggers();
        match (ran, waits) {
            (Err(e), Err(lost)) if !e.is_loss_of_camera() && lost.is_loss_of_camera() => Err(lost),
            (Err(e), _) | (Ok(_), Err(e)) => Err(e),
            (Ok(end), Ok(())) => Ok(end),
        }
    }

    fn wait_for_triggers(&mut self) -> Result<(), DeviceError> {
        self.disarm()?;
        let trigger = &self.settings.trigger;
        configure::set_trigger(&self.device()?.camera, trigger).map_err(|e| self.noted(e))?;
        self.armed = Some(Armed::start(&self.device()?.camera, &self.settings, BUFFERS).map_err(|e| self.noted(e))?);
        Ok(())
    }

    fn frames(&mut self, plan: &StreamPlan, sink: FrameSink<'_>) -> Result<StreamEnd, DeviceError> {
        let open = self.device()?;
        let Some(ticks_per_s) = open.clock.map(|clock| clock.ticks_per_s) else {
            let why = "the camera's clock cannot be read, and without it the angle of a frame is not known";
            return Err(DeviceError::Camera { what: "a stream".into(), why: why.into() });
        };
        let rate_hz = configure::set_free_run(&open.camera, plan.rate_hz).map_err(|e| self.noted(e))?;
        let start = self.reading()?;
        let mut clock = CountedClock::starting(start, ticks_per_s, self.settings.time_scale);
        self.armed = Some(Armed::start(&self.device()?.camera, &self.settings, plan.buffers).map_err(|e| self.noted(e))?);
        let incomplete = self.pass_on(plan, &mut clock, sink)?;
        clock.finish(self.reading()?)?;
        Ok(StreamEnd { rate_hz, incomplete })
    }

    fn reading(&self) -> Result<Reading, DeviceError> {
        let reading = Reading::of(self.device()?).map_err(|e| self.noted(e))?;
        reading.ok_or_else(|| DeviceError::Camera { what: "a look at its clock".into(), why: "it has none".into() })
    }

    /// Gives the sink each complete frame. Returns the numbers of the frames that came incomplete.
    fn pass_on(&self, plan: &StreamPlan, clock: &mut CountedClock, sink: FrameSink<'_>) -> Result<Vec<u64>, DeviceError> {
        let (mut numbers, mut incomplete, mut frames) = (CountedNumbers::default(), Vec::new(), 0);
        let (mut heard, mut last) = (Instant::now(), "nothing came".to_owned());
        loop {
            let quiet = heard.elapsed();
            if quiet >= plan.silence {
                return Err(self.silent(quiet, frames, last));
            }
            let armed = self.armed.as_ref().ok_or(DeviceError::NotArmed)?;
            let Some(buffer) = armed.pop(LOOK.min(plan.silence.saturating_sub(quiet))) else {
                self.device()?;
                continue;
            };
            let received = received(&buffer, clock.start.before);
            let verdict = accept(&buffer, &self.settings, None, None);
            let (number, camera_ns) = (buffer.frame_id(), buffer.timestamp());
            armed.give_back(buffer);
            let frame = match verdict {
                Verdict::Taken { frame, .. } => frame,
                Verdict::Stale(why) | Verdict::Lost(why) => {
                    tracing::warn!(number, why, "a frame of a stream is lost");
                    // Aravis does not set the number of a frame whose leader is lost: it is 0, or that of an earlier frame.
                    incomplete.extend(numbers.following(number));
                    last = why;
                    continue;
                }
            };
            let Some(camera_ns) = clock.advance(camera_ns, received)? else {
                last = format!("frame {number} was exposed before the stream began");
                continue;
            };
            let Some(frame_id) = numbers.advance(number)? else {
                last = format!("frame {number} came again");
                continue;
            };
            frames += 1;
            if sink(StreamedFrame { frame, frame_id, camera_ns, received }).is_break() {
                return Ok(incomplete);
            }
            heard = Instant::now();
        }
    }

    fn silent(&self, quiet: Duration, frames: u64, last: String) -> DeviceError {
        let waited_ms = quiet.as_millis();
        self.link_state().asked = Some(Instant::now());
        let answers = self.open.as_ref().is_some_and(Open::answers);
        self.link_state().asked = None;
        if answers {
            return DeviceError::StreamSilent { waited_ms, frames, last };
        }
        self.note_loss();
        DeviceError::CameraSilent { request: "its heartbeat".into(), why: format!("and no frame came for {waited_ms} ms") }
    }
}

/// When the first packet of a frame was received. Aravis notes it by the clock of the day, which may be set meanwhile.
fn received(buffer: &aravis::Buffer, earliest: Instant) -> Instant {
    let now = Instant::now();
    let age = SystemTime::UNIX_EPOCH
        .checked_add(Duration::from_nanos(buffer.system_timestamp()))
        .and_then(|at| SystemTime::now().duration_since(at).ok())
        .unwrap_or_default();
    now.checked_sub(age).unwrap_or(now).max(earliest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_16_bits_are_counted_on_and_a_missing_one_shifts_no_other() {
        let mut numbers = CountedNumbers::default();
        let counted: Vec<_> = [65_533, 65_534, 2, 2, 3, 65_535, 1].map(|n| numbers.advance(n).ok()).into();
        let expected = [Some(65_533), Some(65_534), Some(65_537), None, Some(65_538)].map(Some);
        assert_eq!(counted[..5], expected);
        // From 3 to 65535 nearly a whole round is missing, and then the round is over.
        assert_eq!(counted[5..], [Some(Some(65_535 + 65_535)), Some(Some(65_535 + 65_536))]);
        let mut wide = CountedNumbers { last: Some((65_535, 65_535)) };
        assert_eq!(wide.advance(65_536).unwrap(), Some(65_536), "numbers of 64 bits");
        assert_eq!([0, 3, 65_535].map(|n| CountedNumbers { last: Some((65_535, 65_535)) }.following(n)), [None, Some(65_538), None]);
        let mut anew = CountedNumbers { last: Some((5000, 5000)) };
        let said = anew.advance(1).unwrap_err().to_string();
        assert!(said.contains("from 5000 to 1"), "{said}");
    }

    /// A clock that was read at 100 s, and the host's time after it.
    fn clock(camera_ns: u64, ticks_per_s: u64) -> (CountedClock, impl Fn(f64) -> Instant) {
        let before = Instant::now();
        let after = before + Duration::from_millis(4);
        (CountedClock::starting(Reading { before, camera_ns, after }, ticks_per_s, 1.0), move |s| before + Duration::from_secs_f64(s))
    }

    const GHZ: u64 = 1_000_000_000;

    #[test]
    fn a_clock_of_64_bits_is_counted_on_where_it_wraps() {
        let (mut clock, at) = clock(u64::MAX - 500_000_000, GHZ);
        let first = clock.advance(u64::MAX - 400_000_000, at(0.2)).unwrap().unwrap();
        let second = clock.advance(99_999_999, at(0.7)).unwrap().unwrap();
        assert_eq!(second - first, 500_000_000);
        // A faster clock wraps earlier when it is converted to nanoseconds.
        let period_ns = ((1u128 << 64) / 4) as u64;
        let (mut clock, at) = self::clock(period_ns - 1000, 4 * GHZ);
        let first = clock.advance(period_ns - 500, at(0.2)).unwrap().unwrap();
        assert_eq!(clock.advance(500, at(0.2)).unwrap().unwrap() - first, 1000);
    }

    #[test]
    fn a_clock_that_restarts_or_jumps_is_said_with_both_numbers() {
        let (mut clock, at) = clock(100 * GHZ, GHZ);
        assert_eq!(clock.advance(99 * GHZ, at(0.1)).unwrap(), None, "a frame of an earlier stream");
        assert_eq!(clock.advance(101 * GHZ, at(1.1)).unwrap(), Some(101 * GHZ));
        let said = clock.clone().advance(GHZ / 2, at(1.5)).unwrap_err().to_string();
        assert!(said.contains("101.000000 s") && said.contains("0.500000 s"), "{said}");
        assert!(clock.clone().advance(101 * GHZ, at(1.2)).is_err(), "two frames at one time");
        let ahead = clock.advance(150 * GHZ, at(1.2)).unwrap_err();
        assert!(matches!(ahead, DeviceError::CameraClock { .. }), "{ahead}");
    }

    #[test]
    fn a_wrong_frequency_is_found_and_a_slow_computer_is_not_taken_for_one() {
        let finished = |camera_s: f64, [before_s, after_s]: [f64; 2]| {
            let (mut clock, at) = clock(100 * GHZ, GHZ);
            let camera_ns = 100 * GHZ + (camera_s * 1e9) as u64;
            clock.finish(Reading { before: at(before_s), camera_ns, after: at(after_s) })
        };
        assert!(finished(3.0, [2.999, 3.001]).is_ok());
        for wrong_s in [2.9, 3.1] {
            let said = finished(wrong_s, [2.999, 3.001]).unwrap_err().to_string();
            assert!(said.contains(&format!("{wrong_s:.3} s")) && said.contains("2.998 s"), "{said}");
        }
        assert!(finished(3.0, [2.5, 9.0]).is_ok(), "an answer that came late");
        assert!(finished(0.0, [0.0, 0.01]).is_ok(), "a stream that ended at once");
    }

    #[test]
    fn a_rig_whose_time_runs_faster_is_held_against_its_own_time() {
        let (mut clock, at) = clock(0, GHZ);
        clock.scale = 10.0;
        assert_eq!(clock.advance(9 * GHZ, at(1.0)).unwrap(), Some(9 * GHZ));
        clock.finish(Reading { before: at(0.99), camera_ns: 10 * GHZ, after: at(1.01) }).unwrap();
        let reading = crate::ClockReading { camera_ns: 9, host: at(0.0), scale: 10.0 };
        assert!((reading.camera_ns_at(at(1.0)) - 10e9 - 9.0).abs() < 1.0);
    }
}
