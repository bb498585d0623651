//! Stale frames: complete and of the right geometry, but taken at another angle.

use super::bench::Bench;

/// Frames that may be lost beside other tests, because a thread of the emulated camera is late. A stale frame that costs an attempt would
/// cost one each time.
const BY_CHANCE: u32 = 1;

#[test]
fn a_frame_that_comes_again_under_a_new_number_is_passed_over() {
    let mut bench = Bench::armed();
    bench.take();
    bench.faults().repeat_frames(3);
    let attempts: u32 = (0..6).map(|_| bench.take().attempts).sum();
    assert!(attempts <= 6 + BY_CHANCE, "the right one comes right after it: {attempts} attempts");
}

/// A frame number ahead of the new acquisition makes a stream ignore all later frames until the stream is renewed.
#[test]
fn the_tail_of_an_old_stream_costs_no_frame() {
    let mut bench = Bench::armed();
    for _ in 0..40 {
        bench.take();
    }
    bench.camera.arm().unwrap();
    bench.faults().leave_stale_packets(6);
    for _ in 0..10 {
        bench.take();
    }
}

#[test]
fn a_whole_frame_of_an_old_stream_is_passed_over() {
    let mut bench = Bench::armed();
    for _ in 0..3 {
        bench.take();
    }
    bench.camera.arm().unwrap();
    bench.faults().leave_stale_packets(u32::MAX);
    for _ in 0..10 {
        bench.take();
    }
}

/// Frame numbers may restart at 1 or continue: each acquisition has its own stream, which starts at the first number that it receives.
#[test]
fn numbers_may_begin_anew_or_go_on_with_each_acquisition() {
    let (mut bench, mut attempts) = (Bench::armed(), 0);
    for keep in [false, true, true, false, false] {
        bench.faults().keep_numbers(keep);
        bench.camera.arm().unwrap();
        attempts += (0..5).map(|_| bench.take().attempts).sum::<u32>();
    }
    assert!(attempts <= 25 + BY_CHANCE, "{attempts} attempts");
}
