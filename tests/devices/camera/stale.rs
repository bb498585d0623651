//! Stale frames: complete and of the right geometry, but taken at another angle.

use super::bench::Bench;

#[test]
fn a_frame_that_comes_again_under_a_new_number_is_passed_over() {
    let mut bench = Bench::armed();
    bench.take();
    bench.faults().repeat_frames(3);
    for _ in 0..6 {
        assert_eq!(bench.take().attempts, 1, "the right one comes right after it");
    }
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
    let mut bench = Bench::armed();
    for keep in [false, true, true, false, false] {
        bench.faults().keep_numbers(keep);
        bench.camera.arm().unwrap();
        for _ in 0..5 {
            assert_eq!(bench.take().attempts, 1);
        }
    }
    assert_eq!(bench.camera.counters().ignored_packets, 0);
}
