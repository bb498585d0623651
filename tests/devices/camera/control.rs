//! Who controls the camera, and whether it is reachable.

use super::bench::{Bench, rig, settings, until};
use carved_devices::DeviceError;
use carved_devices::camera;
use std::net::UdpSocket;
use std::time::{Duration, Instant};

/// Runs `fault` while frames are taken. Returns the duration of the frame that was affected.
fn through(bench: &mut Bench, out: Duration, fault: impl FnOnce(&Bench)) -> Duration {
    bench.take();
    fault(bench);
    let began = Instant::now();
    std::thread::scope(|scope| {
        let (rig, done) = (&bench.rig, out);
        scope.spawn(move || {
            std::thread::sleep(done);
            rig.faults().camera().pull_cable(false);
            rig.faults().camera().steal_control(false);
        });
        let mut view =
            carved_devices::acquisition::grab(bench.camera.as_mut(), super::bench::DEADLINE, &carved_devices::cancel::CancelToken::new());
        let took = began.elapsed();
        let view = view.as_mut().unwrap();
        println!("frame {} came {:.1} s after the fault", view.frame_id, took.as_secs_f64());
        took
    })
}

#[test]
fn a_cable_that_is_out_for_a_second_costs_time_and_no_view() {
    let mut bench = Bench::armed();
    through(&mut bench, Duration::from_secs(1), |b| b.faults().pull_cable(true));
    bench.take();
}

/// Power fails and returns during a run: the camera has forgotten its configuration, its controller and its stream.
#[test]
fn a_device_that_restarts_is_configured_anew_and_costs_no_view() {
    let mut bench = Bench::armed();
    bench.take();
    bench.faults().restart();
    bench.take();
    bench.take();
    // The same, with the time that the camera needs to start.
    through(&mut bench, Duration::from_secs(4), |b| {
        b.faults().restart();
        b.faults().pull_cable(true);
    });
    bench.take();
}

#[test]
fn a_cable_that_stays_out_is_said_and_the_camera_is_opened_again_once_it_is_in() {
    let mut bench = Bench::armed();
    bench.take();
    let began = Instant::now();
    bench.faults().pull_cable(true);
    let seen = bench.camera.grab(super::bench::DEADLINE).unwrap_err();
    assert!(matches!(seen, DeviceError::CameraSilent { .. } | DeviceError::ControlLost), "{seen}");
    println!("seen after {:.1} s: {seen}", began.elapsed().as_secs_f64());
    assert!(bench.camera.is_lost());
    let gave_up = bench.try_take().unwrap_err();
    println!("given up after {:.1} s: {gave_up}", began.elapsed().as_secs_f64());
    assert!(matches!(gave_up, DeviceError::ControlLost | DeviceError::Open { device: "camera", .. }), "{gave_up}");
    let still_out = bench.camera.reopen().unwrap_err();
    assert!(matches!(still_out, DeviceError::Open { device: "camera", .. }), "{still_out}");
    bench.faults().pull_cable(false);
    let back = until("the camera", || bench.camera.reopen().is_ok());
    println!("open again {:.1} s after the cable was in", back.as_secs_f64());
    assert!(!bench.camera.is_lost());
    bench.camera.arm().unwrap();
    bench.take();
}

/// The cable is out when an acquisition begins. That is a loss, and no refused value.
#[test]
fn a_cable_that_is_out_when_the_camera_is_armed_is_a_loss() {
    let mut bench = Bench::armed();
    bench.take();
    bench.camera.disarm().unwrap();
    bench.faults().pull_cable(true);
    let seen = bench.camera.arm().unwrap_err();
    assert!(seen.is_loss_of_camera(), "{seen}");
    assert!(bench.camera.is_lost(), "{seen}");
    bench.faults().pull_cable(false);
    until("the camera", || bench.camera.reopen().is_ok());
    bench.camera.arm().unwrap();
    bench.take();
}

/// The camera is exchanged for another one of the same model, which has the same address.
#[test]
fn another_camera_of_the_same_model_is_a_loss_that_names_both() {
    let mut bench = Bench::armed();
    bench.take();
    let first = bench.rig.camera_serial().to_owned();
    bench.rig.camera().exchange("E1050C-another");
    let seen = bench.camera.grab(super::bench::DEADLINE).unwrap_err();
    assert!(seen.is_loss_of_camera() && bench.camera.is_lost(), "{seen}");
    let other = bench.camera.reopen().unwrap_err();
    assert!(matches!(other, DeviceError::OtherCamera { .. }) && other.is_loss_of_camera(), "{other}");
    let said = other.to_string();
    assert!(said.contains(&first) && said.contains("E1050C-another"), "{said}");
    bench.rig.camera().exchange(&first);
    until("the first camera", || bench.camera.reopen().is_ok());
    bench.camera.arm().unwrap();
    bench.take();
}

/// Some makers give every camera the same serial number, or none. The hardware address still differs.
#[test]
fn another_camera_with_the_same_serial_number_is_a_loss_that_names_both() {
    let mut bench = Bench::armed();
    bench.take();
    let serial = bench.rig.camera_serial().to_owned();
    bench.rig.camera().exchange(&serial);
    let seen = bench.camera.grab(super::bench::DEADLINE).unwrap_err();
    assert!(seen.is_loss_of_camera() && bench.camera.is_lost(), "{seen}");
    let other = bench.camera.reopen().unwrap_err();
    let DeviceError::OtherCamera { expected, found } = &other else { panic!("{other}") };
    assert!(expected != found && [expected, found].iter().all(|c| c.contains(&serial) && c.contains("hardware address")), "{other}");
    bench.rig.camera().exchange(&serial);
    until("the first camera", || bench.camera.reopen().is_ok());
    bench.camera.arm().unwrap();
    bench.take();
}

/// The driver asks a camera to stop that does not answer, and gives it up.
#[test]
fn a_camera_whose_loss_was_not_noticed_is_closed_and_can_be_opened_again() {
    let rig = rig();
    let mut camera = camera::open(settings(&rig)).unwrap();
    camera.arm().unwrap();
    rig.faults().camera().pull_cable(true);
    drop(camera);
    rig.faults().camera().pull_cable(false);
    let mut opened = None;
    until("the camera", || {
        opened = camera::open(settings(&rig)).ok();
        opened.is_some()
    });
    let mut bench = Bench { camera: opened.unwrap(), rig };
    bench.camera.arm().unwrap();
    bench.take();
}

#[test]
fn stolen_control_is_said_by_name_and_taken_back_when_it_is_free() {
    let mut bench = Bench::armed();
    bench.take();
    let began = Instant::now();
    bench.faults().steal_control(true);
    let link = bench.camera.link();
    until("the loss to be seen without a frame being asked for", || link.is_lost());
    println!("theft seen after {:.1} s", began.elapsed().as_secs_f64());
    assert!(matches!(bench.camera.grab(super::bench::DEADLINE), Err(DeviceError::ControlLost)));
    let taken = bench.camera.reopen().unwrap_err();
    assert!(matches!(taken, DeviceError::NotController { .. }), "{taken}");
    bench.faults().steal_control(false);
    bench.camera.arm().unwrap();
    bench.take();
    through(&mut bench, Duration::from_secs(3), |b| b.faults().steal_control(true));
    bench.take();
}

/// A minimal host that follows the GigE Vision standard.
struct Host(UdpSocket);

impl Host {
    fn of(rig: &hardware_sim::Rig) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect((rig.camera_address(), 3956)).unwrap();
        socket.set_read_timeout(Some(super::bench::PATIENCE)).unwrap();
        Self(socket)
    }

    fn read(&self, address: u32) -> u32 {
        let mut packet = vec![0x42, 1, 0, 0x80, 0, 4, 0, 1];
        packet.extend(address.to_be_bytes());
        self.0.send(&packet).unwrap();
        let mut answer = [0; 12];
        assert_eq!((self.0.recv(&mut answer).unwrap(), &answer[..2]), (12, &[0, 0][..]));
        u32::from_be_bytes(*answer.last_chunk().unwrap())
    }

    fn write(&self, address: u32, value: u32) {
        let mut packet = vec![0x42, 1, 0, 0x82, 0, 8, 0, 1];
        packet.extend(address.to_be_bytes());
        packet.extend(value.to_be_bytes());
        self.0.send(&packet).unwrap();
        let mut answer = [0; 64];
        self.0.recv(&mut answer).unwrap();
        assert_eq!(answer[..2], [0, 0], "the camera takes {value} at {address:#x}");
    }
}

/// A daemon that is started right after a crash waits until the control privilege of its predecessor expires.
#[test]
fn a_crashed_predecessors_lock_is_waited_for() {
    let rig = rig();
    let crashed = Host::of(&rig);
    crashed.write(0xa00, 2);
    crashed.write(0x938, 1500);
    let began = Instant::now();
    let mut camera = camera::open(settings(&rig)).unwrap();
    println!("opened {:.1} s after the crash, heartbeat 1.5 s", began.elapsed().as_secs_f64());
    camera.arm().unwrap();
    let mut bench = Bench { camera, rig };
    bench.take();
}

#[test]
fn a_living_predecessor_keeps_the_camera_and_is_said_by_name() {
    let mut bench = Bench::armed();
    bench.take();
    let denied = camera::open(settings(&bench.rig)).err().unwrap();
    assert!(matches!(denied, DeviceError::NotController { .. }), "{denied}");
    let said = denied.to_string();
    assert!(said.contains(&bench.rig.camera_address().to_string()) && said.contains("controlled by another program"), "{said}");
    bench.take();
}

/// A whole frame of the configured format, numbered and stamped in the future, with a leader, packets of data and a trailer.
fn forged(frame: u16) -> Vec<Vec<u8>> {
    let head = |kind: u8, packet: u32| {
        let mut bytes = vec![0, 0];
        bytes.extend(frame.to_be_bytes());
        bytes.extend(((u32::from(kind) << 24) | packet).to_be_bytes());
        bytes
    };
    let mut leader = head(1, 0);
    leader.extend([0, 0, 0, 1]);
    leader.extend((u64::MAX / 4).to_be_bytes());
    for word in [0x0108_0001, super::bench::WIDTH, super::bench::HEIGHT, 0, 0, 0] {
        leader.extend(word.to_be_bytes());
    }
    let pixels = vec![0x55; (super::bench::WIDTH * super::bench::HEIGHT) as usize];
    let data = pixels.chunks(1500 - 36).zip(1..).map(|(chunk, packet)| [head(3, packet), chunk.to_vec()].concat());
    let mut packets = vec![leader];
    packets.extend(data);
    let mut trailer = head(2, packets.len() as u32);
    trailer.extend([0, 0, 0, 1]);
    trailer.extend(super::bench::HEIGHT.to_be_bytes());
    packets.push(trailer);
    packets
}

/// Another computer sends frames to the port of the stream.
#[test]
fn frames_of_another_sender_are_not_taken() {
    let mut bench = Bench::armed();
    let port = Host::of(&bench.rig).read(0xd00) as u16;
    let stranger = UdpSocket::bind("127.0.0.77:0").unwrap();
    for frame in 1..20 {
        for packet in forged(frame) {
            stranger.send_to(&packet, ("127.0.0.1", port)).unwrap();
        }
        bench.take();
    }
    assert_eq!(bench.camera.counters().ignored_packets, 0, "no packet of it reaches the stream");
}
