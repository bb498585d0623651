//! Tests of the emulated camera with the real libaravis.

#![allow(clippy::unwrap_used, clippy::float_cmp)]

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{AcquisitionMode, Buffer, BufferStatus, Camera, GvDevice, GvStream, Stream};
use hardware_sim::{CameraAddress, Exposure, PixelFormat, Pixels, Rig, RigError, RigSettings, Sight, TestCard};
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The longest wait in these tests. A run without errors needs a small part of it.
const DEADLINE: Duration = Duration::from_secs(20);

fn rig(card: TestCard) -> Rig {
    // Fast, so that a revolution takes little time.
    Rig::start(RigSettings { time_scale: 50.0, ..RigSettings::default() }, Arc::new(card)).unwrap()
}

fn open(rig: &Rig) -> Camera {
    let camera = Camera::new(Some(&rig.camera_address().to_string())).unwrap();
    camera.set_exposure_time(1000.0).unwrap();
    // With the right to raw sockets aravis reads the network interface itself. Until its filter is set it accepts every packet on
    // loopback, also frames of rigs in other tests. Their higher ids then make it ignore its own frames.
    camera.device().unwrap().downcast_ref::<GvDevice>().unwrap().set_stream_options(aravis::GvStreamOption::PACKET_SOCKET_DISABLED);
    camera
}

/// A stream with buffers of the size of the payload.
fn stream(camera: &Camera, buffers: usize) -> Stream {
    let stream = camera.create_stream().unwrap();
    let gv = stream.downcast_ref::<GvStream>().unwrap();
    gv.set_socket_buffer(aravis::GvStreamSocketBuffer::Fixed);
    gv.set_socket_buffer_size(4 << 20);
    // On a busy machine a resend request may take longer than the default of 0.2 s.
    gv.set_frame_retention(5_000_000);
    // A resend that takes longer than the packet timeout is requested again, and a frame is given up after requests for a quarter of it.
    gv.set_packet_request_ratio(2.0);
    for _ in 0..buffers {
        stream.push_buffer(Buffer::new_allocate(camera.payload().unwrap() as usize));
    }
    stream
}

/// Triggers one frame. Returns its bytes, if it is complete.
fn grab(camera: &Camera, stream: &Stream, patience: Duration) -> Option<(u64, Vec<u8>)> {
    camera.software_trigger().unwrap();
    let buffer = stream.timeout_pop_buffer(patience.as_micros() as u64)?;
    let whole = (buffer.status() == BufferStatus::Success).then(|| (buffer.frame_id(), buffer.image_data()));
    stream.push_buffer(buffer);
    whole
}

struct Motor {
    port: serialport::TTYPort,
}

impl Motor {
    fn open(rig: &Rig) -> Self {
        // The timeout of the port is the deadline of each answer.
        let port = serialport::new(rig.serial_path().to_string_lossy(), 115_200).timeout(DEADLINE).open_native().unwrap();
        let mut motor = Self { port };
        motor.wait_for("unlock]\r\n");
        motor.ask("$X");
        motor
    }

    fn ask(&mut self, line: &str) {
        self.port.write_all(format!("{line}\n").as_bytes()).unwrap();
        self.wait_for("ok\r\n");
    }

    fn wait_for(&mut self, end: &str) {
        let mut text = String::new();
        let mut chunk = [0; 256];
        while !text.ends_with(end) {
            let n = self.port.read(&mut chunk).unwrap();
            text.push_str(std::str::from_utf8(&chunk[..n]).unwrap());
        }
    }

    /// Moves to an absolute step and waits for the end of the move.
    fn go(&mut self, steps: i64) {
        self.ask(&format!("G90 G0 X{:.3}", steps as f64 / 100.0));
        self.ask("G4 P0.01");
    }
}

fn eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let end = Instant::now() + DEADLINE;
    while !holds() {
        assert!(Instant::now() < end, "{what}");
        std::thread::yield_now();
    }
}

#[test]
fn the_host_finds_features_and_limits() {
    let rig = rig(TestCard::new(1024, 1024));
    let camera = open(&rig);
    assert_eq!(camera.vendor_name().unwrap(), "carved");
    assert_eq!(camera.model_name().unwrap(), "Emulated GE1050C");
    assert_eq!(camera.device_id().unwrap(), rig.camera_serial());
    assert_eq!(camera.sensor_size().unwrap(), (1024, 1024));
    let formats = camera.dup_available_pixel_formats_as_strings().unwrap();
    for name in ["Mono8", "BayerRG8", "RGB8Packed"] {
        assert!(formats.iter().any(|f| f == name), "{name}");
    }
    camera.set_region(128, 256, 512, 384).unwrap();
    assert_eq!(camera.region().unwrap(), (128, 256, 512, 384));
    camera.set_pixel_format_from_string("RGB8Packed").unwrap();
    assert_eq!(camera.payload().unwrap(), 512 * 384 * 3);
    camera.set_exposure_time(2500.0).unwrap();
    assert_eq!(camera.exposure_time().unwrap(), 2500.0);
    camera.set_integer("GainRaw", 6).unwrap();
    assert!(camera.set_integer("GainRaw", 99).is_err());
    assert!(camera.set_string("TriggerSource", "Line2").is_err(), "this line is not wired");
    let device = camera.device().unwrap();
    let tick = device.downcast_ref::<GvDevice>().unwrap().timestamp_tick_frequency().unwrap();
    assert_eq!(tick, 1_000_000_000);
}

/// The main use of both interfaces: a revolution of 84 views. Each frame is pixel for pixel the image of the commanded angle.
#[test]
fn a_revolution_of_84_views_is_pixel_identical_at_the_commanded_angles() {
    let card = TestCard::new(512, 512);
    let rig = rig(card);
    let mut motor = Motor::open(&rig);
    motor.ask("$H");
    let camera = open(&rig);
    camera.set_pixel_format_from_string("BayerRG8").unwrap();
    camera.set_acquisition_mode(AcquisitionMode::Continuous).unwrap();
    camera.set_trigger("Software").unwrap();
    let stream = stream(&camera, 8);
    camera.start_acquisition().unwrap();
    for view in 0..=84_i64 {
        // Absolute targets, each rounded to its nearest step, so that the revolution closes.
        let steps = (view * 500 + 42) / 84;
        motor.go(steps);
        let (id, bytes) = grab(&camera, &stream, DEADLINE).unwrap();
        let angle_rad = steps as f64 / 500.0 * std::f64::consts::TAU;
        let seen =
            TestCard::angle_rad(&hardware_sim::Pixels { width: 512, height: 512, format: PixelFormat::BayerRG8, bytes: bytes.clone() });
        assert!((seen - angle_rad).abs() < 1e-9, "view {view}: {seen} rad seen, {angle_rad} rad commanded");
        let truth = rig.exposures().pop().unwrap();
        assert_eq!((truth.frame_id, truth.number), (id, view as u64));
        let card_there = card.look(&Exposure { angle_rad: truth.angle_rad, number: truth.number }, PixelFormat::BayerRG8);
        assert!(bytes == card_there.bytes, "view {view} differs from the picture of its angle");
        assert_eq!(truth.sha256, <[u8; 32]>::from(Sha256::digest(&bytes)));
    }
    camera.stop_acquisition().unwrap();
    let (completed, failures, underruns) = stream.statistics();
    assert_eq!((completed, failures, underruns), (85, 0, 0));
}

#[test]
fn the_region_and_every_format_arrive_as_configured() {
    let card = TestCard::new(512, 256);
    let rig = rig(card);
    let camera = open(&rig);
    camera.set_trigger("Software").unwrap();
    camera.set_region(64, 32, 256, 128).unwrap();
    for format in PixelFormat::ALL {
        camera.set_pixel_format_from_string(format.name()).unwrap();
        let stream = stream(&camera, 2);
        camera.start_acquisition().unwrap();
        let (_, bytes) = grab(&camera, &stream, DEADLINE).unwrap();
        camera.stop_acquisition().unwrap();
        let truth = rig.exposures().pop().unwrap();
        let whole = card.look(&Exposure { angle_rad: truth.angle_rad, number: truth.number }, format);
        let bpp = format.bytes_per_pixel();
        let expected: Vec<u8> = (32..160).flat_map(|v| whole.bytes[(v * 512 + 64) * bpp..(v * 512 + 320) * bpp].to_vec()).collect();
        assert!(bytes == expected, "{}", format.name());
    }
}

/// 40 frames of 180 packets at 5 % loss: 360 lost packets are expected, so that a run without any loss is practically impossible.
#[test]
fn resend_repairs_five_percent_loss() {
    let rig = rig(TestCard::new(512, 512));
    let camera = open(&rig);
    camera.set_trigger("Software").unwrap();
    let stream = stream(&camera, 8);
    camera.start_acquisition().unwrap();
    rig.faults().camera().lose_packets_ppm(50_000);
    for _ in 0..40 {
        let (_, bytes) = grab(&camera, &stream, DEADLINE).unwrap();
        assert_eq!(rig.exposures().pop().unwrap().sha256, <[u8; 32]>::from(Sha256::digest(&bytes)));
    }
    let (resent, missing) = stream.downcast_ref::<GvStream>().unwrap().statistics();
    assert!(resent > 100, "{resent} packets were sent again");
    assert_eq!(missing, 0);
}

#[test]
fn after_lost_frames_and_ignored_triggers_the_next_trigger_works() {
    let rig = rig(TestCard::new(256, 64));
    let camera = open(&rig);
    camera.set_trigger("Software").unwrap();
    let stream = stream(&camera, 4);
    camera.start_acquisition().unwrap();
    let short = Duration::from_millis(200);
    rig.faults().camera().drop_frames(1);
    assert!(grab(&camera, &stream, short).is_none());
    rig.faults().camera().ignore_triggers(1);
    assert!(grab(&camera, &stream, short).is_none());
    let (id, _) = grab(&camera, &stream, DEADLINE).unwrap();
    assert_eq!(id, 2, "the dropped frame has a number, the ignored trigger has none");
    assert_eq!(rig.exposures().iter().map(|e| e.sent).collect::<Vec<_>>(), [false, true]);
}

#[test]
fn free_run_needs_no_trigger_and_single_frame_mode_sends_one() {
    let rig = rig(TestCard::new(256, 64));
    let camera = open(&rig);
    camera.set_string("TriggerSelector", "FrameStart").unwrap();
    camera.set_string("TriggerMode", "Off").unwrap();
    // Of rig time: a hundred per second.
    camera.set_float("AcquisitionFrameRateAbs", 2.0).unwrap();
    let live = stream(&camera, 8);
    camera.start_acquisition().unwrap();
    for _ in 0..20 {
        let buffer = live.timeout_pop_buffer(DEADLINE.as_micros() as u64).unwrap();
        assert_eq!(buffer.status(), BufferStatus::Success);
        live.push_buffer(buffer);
    }
    camera.stop_acquisition().unwrap();
    drop(live);
    camera.set_acquisition_mode(AcquisitionMode::SingleFrame).unwrap();
    let before = {
        // A frame that was being sent when the acquisition was stopped is in the log.
        let mut last = rig.exposures().len();
        eventually("the camera goes on after the stop", || {
            std::thread::sleep(Duration::from_millis(20));
            std::mem::replace(&mut last, rig.exposures().len()) == rig.exposures().len()
        });
        last
    };
    let single = stream(&camera, 4);
    camera.start_acquisition().unwrap();
    assert!(single.timeout_pop_buffer(DEADLINE.as_micros() as u64).is_some());
    assert!(single.timeout_pop_buffer(100_000).is_none());
    assert_eq!(rig.exposures().len(), before + 1);
}

#[test]
fn one_host_has_control_at_a_time_and_notices_when_another_takes_it() {
    let rig = rig(TestCard::new(256, 64));
    let camera = open(&rig);
    let second = Camera::new(Some(&rig.camera_address().to_string())).unwrap();
    let is_controller = |camera: &Camera| camera.device().unwrap().downcast_ref::<GvDevice>().unwrap().is_controller();
    assert!(is_controller(&camera) && !is_controller(&second));
    assert!(second.set_exposure_time(3000.0).is_err());
    rig.faults().camera().steal_control(true);
    assert!(camera.set_exposure_time(3000.0).is_err());
    eventually("aravis sees that control is gone", || !is_controller(&camera));
}

#[test]
fn a_mute_control_channel_times_out_and_recovers() {
    let rig = rig(TestCard::new(256, 64));
    let camera = open(&rig);
    rig.faults().camera().mute_control(true);
    assert!(camera.set_exposure_time(3000.0).is_err());
    rig.faults().camera().mute_control(false);
    // Reads only. The timeout of aravis is about as long as the heartbeat, so control may be lost meanwhile.
    assert_eq!(camera.exposure_time().unwrap(), 1000.0, "the muted write has not arrived");
}

#[test]
fn two_rigs_run_side_by_side_and_a_used_address_is_an_error() {
    let (a, b) = (rig(TestCard::new(256, 64)), rig(TestCard::new(256, 64)));
    assert_ne!(a.camera_address(), b.camera_address());
    assert_ne!(a.camera_serial(), b.camera_serial());
    let settings = RigSettings { camera: CameraAddress::Fixed(a.camera_address()), ..RigSettings::default() };
    match Rig::start(settings, Arc::new(TestCard::new(256, 64))) {
        Err(RigError::AddressInUse(address)) => assert_eq!(address, a.camera_address()),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("two cameras on one address"),
    }
    let address = a.camera_address();
    drop(a);
    let settings = RigSettings { camera: CameraAddress::Fixed(address), ..RigSettings::default() };
    // The rig of another test may have taken the first free address meanwhile.
    match Rig::start(settings, Arc::new(TestCard::new(256, 64))) {
        Ok(again) => assert_eq!(again.camera_address(), address),
        Err(RigError::AddressInUse(_)) => {}
        Err(other) => panic!("{other}"),
    }
}

/// A crashed host keeps control of the camera until its heartbeat has run out.
#[test]
fn control_is_free_when_the_heartbeat_has_run_out() {
    let rig = rig(TestCard::new(256, 64));
    let host = || {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect((rig.camera_address(), 3956)).unwrap();
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        socket
    };
    let write = |socket: &std::net::UdpSocket, address: u32, value: u32| {
        let mut packet = vec![0x42, 1, 0, 0x82, 0, 8, 0, 1];
        packet.extend(address.to_be_bytes());
        packet.extend(value.to_be_bytes());
        socket.send(&packet).unwrap();
        let mut answer = [0; 64];
        socket.recv(&mut answer).unwrap();
        u16::from_be_bytes([answer[0], answer[1]])
    };
    let (crashed, next) = (host(), host());
    assert_eq!(write(&crashed, 0xa00, 2), 0);
    assert_eq!(write(&crashed, 0x938, 500), 0);
    assert_eq!(write(&next, 0xa00, 2), 0x8006, "access denied");
    eventually("control falls free", || write(&next, 0xa00, 2) == 0);
    assert_eq!(write(&crashed, 0x938, 500), 0x8006, "the old host has lost control");
}

/// A sight whose bytes are the angles at the beginning, the middle and the end of the exposure.
struct Way;

impl Sight for Way {
    fn size(&self) -> (u32, u32) {
        (64, 32)
    }

    fn look(&self, _: &Exposure, format: PixelFormat) -> Pixels {
        Pixels::filled(64, 32, format, 0)
    }

    fn look_along(&self, exposure: &Exposure, path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        let mut pixels = self.look(exposure, format);
        let angles = [path_rad(0.0), path_rad(0.5), path_rad(1.0)].map(f64::to_be_bytes).concat();
        pixels.bytes[..angles.len()].copy_from_slice(&angles);
        pixels
    }
}

/// Free run over a whole move. However late a frame is made and sent, it shows where the shaft stood at its time.
#[test]
fn frames_in_free_run_show_the_way_of_the_shaft_during_their_exposures() {
    // 48 deg/s: 60 frames of a turn at 8 Hz.
    let (speed_rad_s, rate_hz, exposure_s) = (48f64.to_radians(), 8.0, 0.02);
    let rig = Rig::start(RigSettings { time_scale: 4.0, ..RigSettings::default() }, Arc::new(Way)).unwrap();
    rig.faults().camera().hold_frames_ms(40);
    let mut motor = Motor::open(&rig);
    motor.ask("$H");
    let camera = open(&rig);
    camera.set_region(0, 0, 64, 32).unwrap();
    camera.set_pixel_format_from_string("Mono8").unwrap();
    camera.set_exposure_time(exposure_s * 1e6).unwrap();
    camera.set_frame_rate(rate_hz).unwrap();
    let stream = stream(&camera, 64);
    camera.start_acquisition().unwrap();
    // Units of 72 deg, as in `Motor::go`, per minute.
    motor.ask(&format!("G90 G1 X5.000 F{:.3}", speed_rad_s.to_degrees() / 72.0 * 60.0));
    let mut steady = 0;
    let end_rad = 360f64.to_radians();
    let mut last_id = 0;
    eventually("the end of the turn", || {
        let buffer = stream.timeout_pop_buffer(DEADLINE.as_micros() as u64).unwrap();
        let (id, bytes) = (buffer.frame_id(), buffer.image_data());
        assert_eq!((buffer.status(), id), (BufferStatus::Success, last_id + 1));
        last_id = id;
        let [from, middle, to] = [0, 8, 16].map(|i| f64::from_be_bytes(bytes[i..i + 8].try_into().unwrap()));
        let exposures = rig.exposures();
        let truth = exposures.iter().find(|e| e.frame_id == id).unwrap();
        assert_eq!((buffer.timestamp(), middle), (truth.camera_ns, truth.angle_rad));
        if (middle - 0.5 * (from + to)).abs() < 1e-9 && ((to - from) / exposure_s / speed_rad_s - 1.0).abs() < 1e-6 {
            steady += 1;
            // The frame before was exposed one period earlier, and shows that angle.
            if let Some(before) = exposures.iter().find(|e| e.frame_id + 1 == id && steady > 1) {
                let turned = middle - before.angle_rad;
                assert!((turned - speed_rad_s * (truth.middle_s - before.middle_s)).abs() < 1e-9, "{turned}");
            }
        }
        stream.push_buffer(buffer);
        to >= end_rad - 1e-9
    });
    // 7.5 s at 8 Hz, less the ramps.
    assert!(steady >= 50, "{steady} frames at constant speed");
}
