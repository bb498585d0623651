//! The camera runs free: every frame is compared with its exposure, its number and its time.

use super::bench::{Bench, DEADLINE, rig, settings, until};
use carved_devices::camera::{self, AravisSettings};
use carved_devices::{DeviceError, StreamEnd, StreamPlan, StreamedFrame};
use sha2::{Digest, Sha256};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Rig time, so ten times as many in real time.
const RATE_HZ: f64 = 20.0;

fn plan(silence: Duration) -> StreamPlan {
    StreamPlan { rate_hz: RATE_HZ, buffers: 64, silence }
}

impl Bench {
    fn stream(&mut self, sink: &mut dyn FnMut(&StreamedFrame) -> ControlFlow<()>) -> Result<(Vec<StreamedFrame>, StreamEnd), DeviceError> {
        let mut frames = Vec::new();
        let end = self.camera.stream(&plan(DEADLINE), &mut |frame| {
            let flow = sink(&frame);
            frames.push(frame);
            flow
        })?;
        Ok((frames, end))
    }

    /// Streams this many frames, and calls `fault` at the fifth.
    fn stream_frames(&mut self, count: usize, fault: impl Fn(&hardware_sim::gige::CameraFaults)) -> (Vec<StreamedFrame>, StreamEnd) {
        let (mut seen, faults) = (0, self.rig.faults().camera());
        let mut frames = Vec::new();
        let end = self.camera.stream(&plan(DEADLINE), &mut |frame| {
            frames.push(frame);
            seen += 1;
            if seen == 5 {
                fault(faults);
            }
            if seen == count { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        (frames, end.unwrap())
    }

    /// Each frame has the bytes and the time of the exposure with its number, and the numbers rise.
    fn hold_stream(&self, frames: &[StreamedFrame], first: usize) {
        let exposures = self.rig.exposures();
        let of_stream = &exposures[first..];
        for frame in frames {
            let number = u64::from_be_bytes(*frame.frame.bytes().first_chunk().unwrap());
            let exposed = of_stream.iter().find(|e| e.number == number).unwrap_or_else(|| panic!("exposure {number} never was"));
            assert_eq!(Sha256::digest(frame.frame.bytes())[..], exposed.sha256, "frame {}", frame.frame_id);
            // The camera counts its exposures from the start of the stream, whatever became of their frames.
            assert_eq!((frame.frame_id - 1) % 65_535 + 1, exposed.frame_id, "exposure {number}");
            assert_eq!(frame.camera_ns, exposed.camera_ns & (u64::MAX >> 1), "frame {}", frame.frame_id);
        }
        assert!(frames.windows(2).all(|pair| pair[0].frame_id < pair[1].frame_id && pair[0].camera_ns < pair[1].camera_ns));
    }
}

/// The numbers between the first and the last frame that did not come.
fn missing(frames: &[StreamedFrame]) -> Vec<u64> {
    frames.windows(2).flat_map(|pair| pair[0].frame_id + 1..pair[1].frame_id).collect()
}

/// The number of each frame says when it was taken.
fn fits_the_rate(frames: &[StreamedFrame], rate_hz: f64, off_by_s: f64) {
    let first = &frames[0];
    for frame in frames {
        let expected_s = (frame.frame_id - first.frame_id) as f64 / rate_hz;
        let found_s = (frame.camera_ns - first.camera_ns) as f64 * 1e-9;
        assert!((found_s - expected_s).abs() <= off_by_s, "frame {}: {found_s} s instead of {expected_s} s", frame.frame_id);
    }
}

#[test]
fn frames_come_by_themselves_with_numbers_and_times_that_fit_the_rate() {
    let mut bench = Bench::armed();
    let before = bench.camera.clock().unwrap().unwrap();
    let (frames, end) = bench.stream_frames(100, |_| ());
    bench.hold_stream(&frames, 0);
    assert!(frames.iter().all(|f| before.camera_ns < f.camera_ns), "a reading of the clock counts as the frames do");
    assert!((end.rate_hz - RATE_HZ).abs() < 1e-6, "{end:?}");
    // The camera's clock has nanoseconds, and its rate is a number of 32 bits.
    fits_the_rate(&frames, RATE_HZ, 1e-5);
    assert!(frames.windows(2).all(|pair| pair[0].received <= pair[1].received));
    println!("100 frames, missing {:?}, {:?}", missing(&frames), bench.camera.counters());

    // Late frames and exposures that begin late: the times are those of the exposures.
    bench.faults().hold_frames_ms(20);
    bench.faults().jitter_exposures_us(2000);
    let before = bench.rig.exposures().len();
    let (frames, _) = bench.stream_frames(40, |_| ());
    bench.hold_stream(&frames, before);
    fits_the_rate(&frames, RATE_HZ, 2e-3 + 1e-5);
    bench.faults().hold_frames_ms(0);
    waits_for_triggers(&mut bench);
}

/// After a stream the camera takes a picture for each trigger and none without.
fn waits_for_triggers(bench: &mut Bench) {
    // On, and by software.
    assert_eq!(["TriggerMode", "TriggerSource"].map(|name| bench.rig.camera().feature(name)), [Some(1), Some(6)]);
    bench.take();
    let before = bench.rig.exposures().len();
    let attempts: u32 = (0..5).map(|_| bench.take().attempts).sum();
    assert!(bench.rig.exposures().len() <= before + attempts as usize, "it takes pictures by itself");
}

#[test]
fn lost_packets_shift_no_frame_and_missing_ones_are_missing_by_number() {
    for ppm in [0, 10_000, 50_000] {
        let mut bench = Bench::armed();
        bench.faults().lose_packets_ppm(ppm);
        let (frames, end) = bench.stream_frames(100, |_| ());
        bench.hold_stream(&frames, 0);
        fits_the_rate(&frames, RATE_HZ, 1e-5);
        let missing = missing(&frames);
        let resent = bench.camera.counters().resent_packets;
        println!(
            "{ppm} ppm lost: {} of 100 frames missing {missing:?}, incomplete {:?}, {resent} packets resent",
            missing.len(),
            end.incomplete
        );
        assert!(ppm == 0 || resent > 0);
        // Beside other tests a thread of the emulated camera may be late for a resend.
        assert!(missing.len() < 10, "{missing:?}");
    }
    // Nothing repairs what is lost: one frame of two.
    let mut bench = Bench::armed_with(|s| AravisSettings { resend: false, ..s });
    bench.faults().lose_packets_ppm(50_000);
    let (frames, end) = bench.stream_frames(60, |_| ());
    bench.hold_stream(&frames, 0);
    let missing = missing(&frames);
    println!("without resend: {} missing, {} of them incomplete", missing.len(), end.incomplete.len());
    assert!(!end.incomplete.is_empty() && !missing.is_empty());
    let between: Vec<u64> = end.incomplete.iter().copied().filter(|id| *id > frames[0].frame_id).collect();
    assert!(between.iter().all(|id| missing.contains(id)), "{between:?} of {missing:?}");
}

#[test]
fn frames_that_were_never_sent_or_came_cut_leave_gaps_and_shift_no_other() {
    let mut bench = Bench::armed();
    let (frames, end) = bench.stream_frames(40, |faults| faults.drop_frames(3));
    bench.hold_stream(&frames, 0);
    let gone = missing(&frames);
    assert!(gone.len() >= 3 && gone[2] == gone[0] + 2, "{gone:?}");
    assert!(gone[..3].iter().all(|id| !end.incomplete.contains(id)), "nothing of them came: {end:?}");
    let before = bench.rig.exposures().len();
    let (frames, end) = bench.stream_frames(40, |faults| faults.cut_frames(2));
    bench.hold_stream(&frames, before);
    let cut = missing(&frames);
    assert!(end.incomplete.len() >= 2 && end.incomplete.iter().all(|id| cut.contains(id)), "{end:?} of {cut:?}");
}

/// A frame every 5 ms, each held back by 20 ms on average.
#[test]
fn frames_for_which_the_camera_has_no_room_are_missing_by_number() {
    let mut bench = Bench::armed();
    bench.faults().hold_frames_ms(40);
    bench.faults().let_frames_wait(3);
    let (frames, end) = bench.stream_frames(40, |_| ());
    bench.hold_stream(&frames, 0);
    fits_the_rate(&frames, RATE_HZ, 1e-5);
    let (missing, exposures) = (missing(&frames), bench.rig.exposures());
    assert!(missing.len() > 10, "{missing:?}");
    let lost = |id: &u64| exposures.iter().any(|e| e.frame_id == *id && !e.sent);
    assert!(missing.iter().all(|id| lost(id) || end.incomplete.contains(id)), "{missing:?}");
}

#[test]
fn numbers_of_16_bits_count_on_where_they_wrap() {
    let mut bench = Bench::armed();
    bench.faults().begin_numbers_at(65_530);
    let (frames, _) = bench.stream_frames(30, |_| ());
    bench.hold_stream(&frames, 0);
    fits_the_rate(&frames, RATE_HZ, 1e-5);
    assert!(frames[29].frame_id > 65_535, "{}", frames[29].frame_id);
}

#[test]
fn a_clock_that_drifts_or_wraps_serves() {
    let mut bench = Bench::armed();
    bench.faults().run_clock_at(1.0001);
    let (frames, _) = bench.stream_frames(40, |_| ());
    bench.hold_stream(&frames, 0);
    fits_the_rate(&frames, RATE_HZ / 1.0001, 1e-5);

    bench.faults().run_clock_at(1.0);
    // In the middle of 4 s of rig time, or before the first frame on a computer that is slow.
    bench.faults().wrap_clock_in(2.0);
    let before = bench.rig.exposures();
    let (frames, _) = bench.stream_frames(80, |_| ());
    fits_the_rate(&frames, RATE_HZ, 1e-5);
    let low_bits: Vec<u64> = bench.rig.exposures()[before.len()..].iter().map(|e| e.camera_ns << 1).collect();
    assert!(frames.iter().all(|frame| low_bits.contains(&(frame.camera_ns << 1))));
}

#[test]
fn a_clock_that_restarts_is_said_and_the_camera_serves_afterwards() {
    let mut bench = Bench::armed();
    let camera = bench.rig.faults().camera();
    let mut seen = 0;
    let error = bench.camera.stream(&plan(DEADLINE), &mut |_| {
        seen += 1;
        if seen == 10 {
            camera.restart_clock();
        }
        ControlFlow::Continue(())
    });
    let said = error.unwrap_err();
    assert!(matches!(said, DeviceError::StreamRestarted { counter: "clock", .. }) && said.is_of_frames(), "{said}");
    waits_for_triggers(&mut bench);
}

/// The comparison allows for late answers, so that a busy computer may need a longer stream to find it.
#[test]
fn a_clock_with_another_frequency_than_it_says_is_found_by_the_computers_clock() {
    let mut bench = Bench::armed();
    for speed in [0.8, 1.25] {
        bench.faults().run_clock_at(speed);
        let found = [1, 4, 16].into_iter().find_map(|seconds| {
            let end = Instant::now() + Duration::from_secs(seconds);
            let outcome = bench.stream(&mut |_| if Instant::now() < end { ControlFlow::Continue(()) } else { ControlFlow::Break(()) });
            outcome.err()
        });
        let error = found.expect("an error");
        let DeviceError::CameraClock { camera_s, host_s, ticks_per_s } = error else { panic!("{error}") };
        assert_eq!(ticks_per_s, 1_000_000_000);
        assert!((camera_s > host_s) == (speed > 1.0), "{speed}: {error}");
    }
    bench.faults().run_clock_at(1.0);
    waits_for_triggers(&mut bench);
}

#[test]
fn the_camera_says_how_fast_it_can_be_and_refuses_more() {
    let rig = rig();
    let mut camera = camera::open(AravisSettings { exposure_us: 25_000.0, ..settings(&rig) }).unwrap();
    assert_eq!(camera.highest_rate_hz().unwrap(), Some(40.0));
    let fast = StreamPlan { rate_hz: 41.0, ..plan(DEADLINE) };
    let said = camera.stream(&fast, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(said.contains("41 Hz") && said.contains("to 40 Hz"), "{said}");
    let mut bench = Bench { camera, rig };
    waits_for_triggers(&mut bench);
}

#[test]
fn a_stream_that_falls_silent_ends_with_what_came_last() {
    let mut bench = Bench::armed();
    let camera = bench.rig.faults().camera();
    let error = bench.camera.stream(&plan(Duration::from_millis(400)), &mut |_| {
        camera.cut_frames(u32::MAX);
        ControlFlow::Continue(())
    });
    let said = error.unwrap_err();
    assert!(matches!(&said, DeviceError::StreamSilent { frames, last, .. } if *frames > 0 && last.contains("not whole")), "{said}");
    camera.cut_frames(0);
    waits_for_triggers(&mut bench);
}

#[test]
fn a_cable_or_control_that_is_lost_in_a_stream_is_a_loss_and_the_camera_is_opened_again() {
    let mut bench = Bench::armed();
    for pulled in [true, false] {
        let camera = bench.rig.faults().camera();
        let error = bench.camera.stream(&plan(Duration::from_millis(400)), &mut |_| {
            if pulled {
                camera.pull_cable(true);
            } else {
                camera.steal_control(true);
            }
            ControlFlow::Continue(())
        });
        let said = error.unwrap_err();
        assert!(said.is_loss_of_camera() && bench.camera.is_lost(), "{said}");
        camera.pull_cable(false);
        camera.steal_control(false);
        until("the camera", || bench.camera.reopen().is_ok());
        bench.camera.arm().unwrap();
        waits_for_triggers(&mut bench);
    }
}

/// Its power fails for a moment: it has forgotten the stream and this computer.
#[test]
fn a_camera_that_restarts_in_a_stream_is_opened_again() {
    let mut bench = Bench::armed();
    let camera = bench.rig.faults().camera();
    let mut restarts = true;
    let error = bench.camera.stream(&plan(Duration::from_millis(400)), &mut |_| {
        if std::mem::take(&mut restarts) {
            camera.restart();
        }
        ControlFlow::Continue(())
    });
    let said = error.unwrap_err();
    assert!(said.is_loss_of_camera(), "{said}");
    until("the camera", || bench.camera.arm().is_ok());
    waits_for_triggers(&mut bench);
}
