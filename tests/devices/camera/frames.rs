//! Faults of network and sensor: none of them may cost a view or change a frame.

use super::bench::{Bench, DEADLINE, seen};
use carved_core::frame::PixelFormat;
use carved_devices::DeviceError;
use carved_devices::camera::{AravisSettings, Packed};
use sha2::{Digest, Sha256};

/// Frames of each loss test: at 12 packets a frame, 1 % of loss spoils one in nine.
const FRAMES: u32 = 100;

fn with_loss(ppm: u32) -> u32 {
    let mut bench = Bench::armed();
    bench.faults().lose_packets_ppm(ppm);
    let attempts = (0..FRAMES).map(|_| bench.take().attempts).sum();
    let counters = bench.camera.counters();
    println!("{ppm} ppm lost: {FRAMES} frames with {attempts} triggers, {counters:?}");
    assert!(counters.resent_packets > 0, "{counters:?}");
    attempts
}

#[test]
fn one_percent_of_loss_costs_no_frame() {
    assert!(with_loss(10_000) < FRAMES * 11 / 10);
}

#[test]
fn five_percent_of_loss_costs_no_frame() {
    assert!(with_loss(50_000) < FRAMES * 12 / 10);
}

/// Without resend requests frames are missing. The driver reports this and accepts no partial frame.
#[test]
fn without_resend_loss_is_a_typed_error_and_never_half_a_frame() {
    let mut bench = Bench::armed_with(|s| AravisSettings { resend: false, frame_timeout_ms: 100, ..s });
    bench.faults().lose_packets_ppm(500_000);
    let error = bench.try_take().unwrap_err();
    assert!(
        matches!(error, DeviceError::NoFrame { waited_ms, attempts, .. } if attempts > 1 && waited_ms + 100 >= DEADLINE.as_millis()),
        "{error}"
    );
    bench.faults().lose_packets_ppm(0);
    bench.take();
}

#[test]
fn packets_that_come_twice_or_in_another_order_make_the_same_frames() {
    let mut bench = Bench::armed();
    bench.faults().double_packets_ppm(300_000);
    bench.faults().swap_packets_ppm(300_000);
    for _ in 0..FRAMES {
        bench.take();
    }
    // The same with loss: a resent packet and the late original may cross.
    bench.faults().lose_packets_ppm(50_000);
    for _ in 0..FRAMES {
        bench.take();
    }
}

/// The emulated camera packs by its own code. Eight bits that it widened to ten or twelve come back as they were.
#[test]
fn every_format_arrives_pixel_by_pixel() {
    for format in PixelFormat::ALL {
        let mut bench = Bench::armed_with(|s| AravisSettings { pixel_format: format, ..s });
        assert_eq!(bench.take().frame.format(), format);
    }
    for packed in [Packed::Mono10p, Packed::Mono12p, Packed::Mono10Packed, Packed::Mono12Packed] {
        let mut bench = Bench::armed_with(|s| AravisSettings { sent_as: Some(packed), ..s });
        let frame = bench.camera.grab(DEADLINE).unwrap().frame;
        let number = u64::from_be_bytes(*frame.bytes().first_chunk().unwrap());
        assert!(frame.format() == PixelFormat::Mono8 && frame.bytes() == seen(number), "{packed:?}");
        let exposures = bench.rig.exposures();
        assert_ne!(Sha256::digest(frame.bytes())[..], exposures.last().unwrap().sha256, "{packed:?}: the camera sent other bytes");
        // Of another packing nothing is taken, and both formats are said.
        bench.faults().reformat_frames(u32::MAX);
        if packed != Packed::Mono10p {
            let said = bench.camera.grab(std::time::Duration::from_secs(2)).unwrap_err().to_string();
            assert!(said.contains(&format!("expected {packed:?}")) && said.contains("got format 0x010c"), "{said}");
        }
    }
}

#[test]
fn a_truncated_frame_is_not_taken_and_is_triggered_again() {
    let mut bench = Bench::armed();
    bench.faults().cut_frames(2);
    assert!(bench.take().attempts >= 3);
    bench.faults().cut_frames(u32::MAX);
    let error = bench.try_take().unwrap_err();
    let said = error.to_string();
    assert!(said.contains("not whole") && said.contains("of its 16384 bytes"), "what should have come: {said}");
}

/// The last trigger before the deadline may have no time left for its frame. That is not the reported cause.
#[test]
fn the_cause_of_the_frames_that_came_is_reported_though_the_last_one_did_not_come() {
    // With an exposure of 0.3 s in real time two frames arrive before the deadline and a third does not.
    let mut bench = Bench::armed_with(|s| AravisSettings { exposure_us: 3e6, ..s });
    bench.faults().reformat_frames(u32::MAX);
    let said = bench.camera.grab(std::time::Duration::from_millis(700)).unwrap_err().to_string();
    assert!(said.contains("expected Mono8") && said.contains("got BayerRG8"), "both formats are said: {said}");
    bench.faults().reformat_frames(0);
    bench.faults().cut_frames(u32::MAX);
    let said = bench.camera.grab(std::time::Duration::from_millis(1100)).unwrap_err().to_string();
    assert!(said.contains("of its 16384 bytes"), "what should have come: {said}");
}

#[test]
fn a_whole_frame_of_another_geometry_is_not_taken() {
    let mut bench = Bench::armed();
    bench.faults().misshape_frames(1);
    assert!(bench.take().attempts >= 2);
    bench.faults().misshape_frames(u32::MAX);
    let error = bench.try_take().unwrap_err().to_string();
    assert!(error.contains("[256, 64, 0, 0]") && error.contains("[256, 32, 0, 0]"), "both geometries are said: {error}");
}

#[test]
fn a_deaf_trigger_is_repeated_and_given_up_at_the_deadline() {
    let mut bench = Bench::armed();
    bench.faults().ignore_triggers(2);
    assert!(bench.take().attempts >= 3);
    bench.faults().ignore_triggers(u32::MAX);
    let error = bench.try_take().unwrap_err();
    assert!(matches!(&error, DeviceError::NoFrame { last, .. } if last.contains("nothing came")), "{error}");
}

/// A switch between was replaced by one that drops long packets. The leader and the trailer of a frame are short.
#[test]
fn packets_too_long_for_the_way_are_named_as_that() {
    let mut bench = Bench::armed_with(|s| AravisSettings { frame_timeout_ms: 300, ..s });
    bench.faults().lose_packets_longer_than(1400);
    let said = bench.try_take().unwrap_err().to_string();
    assert!(
        said.contains("packets of 1500 bytes do not pass") && said.contains("set packet_size in the configuration to that MTU"),
        "{said}"
    );
    // That is the cure.
    drop(bench);
    let mut bench = Bench::armed_with(|s| AravisSettings { packet_size: 1400, ..s });
    bench.faults().lose_packets_longer_than(1400);
    bench.take();
}
