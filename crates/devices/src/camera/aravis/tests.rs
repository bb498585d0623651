//! Tests against Aravis' own fake camera, which is independent of this program. Debian has it in aravis-tools.

#[path = "../../../../../tests/common/strict.rs"]
mod strict;

use super::*;
use carved_core::frame::PixelFormat;
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};

struct Fake(Child);

impl Fake {
    fn start() -> Self {
        let mut command = Command::new("arv-fake-gv-camera-0.8");
        Self(command.args(["-i", "127.0.0.1"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn settings() -> AravisSettings {
    let select = CameraSelect::Address(Ipv4Addr::LOCALHOST);
    AravisSettings { gain_raw: Some(3), ..AravisSettings::new(select, PixelFormat::Mono8, 512, 256, 1000.0) }
}

/// The fake needs a moment to listen.
fn open_within(patience: Duration) -> AravisCamera {
    opened(&settings(), patience)
}

fn opened(settings: &AravisSettings, patience: Duration) -> AravisCamera {
    let until = Instant::now() + patience;
    loop {
        match AravisCamera::open(settings.clone()) {
            Ok(camera) => return camera,
            Err(e) => assert!(Instant::now() < until, "{e}"),
        }
    }
}

/// Region, pixel format, rate, exposure and gain reach its sensor. An unknown trigger source is refused by its name.
fn takes_what_it_is_given(deadline: Duration) {
    let few = |changed: AravisSettings| {
        let mut camera = opened(&changed, deadline);
        camera.arm().unwrap();
        let frames: Vec<_> = (0..3).map(|_| camera.grab(deadline).unwrap()).collect();
        assert!(frames.windows(2).all(|pair| pair[0].frame_id != pair[1].frame_id), "every frame is a new one");
        let bytes = frames.iter().flat_map(|f| f.frame.bytes()).map(|b| f64::from(*b)).collect::<Vec<_>>();
        let frame = &frames[0].frame;
        assert_eq!((frame.width(), frame.height(), frame.format()), (changed.width, changed.height, changed.pixel_format));
        camera.disarm().unwrap();
        bytes.iter().sum::<f64>() / bytes.len() as f64
    };
    few(AravisSettings { offset_x: 64, offset_y: 32, width: 128, height: 48, ..settings() });
    few(AravisSettings { pixel_format: PixelFormat::BayerRG8, ..settings() });
    few(AravisSettings { trigger: Trigger::FixedRateHz(20.0), ..settings() });
    // It draws its picture as bright as gain and exposure have it.
    let [dark, exposed, amplified] = [(0, 1500.0), (0, 20_000.0), (1, 20_000.0)]
        .map(|(gain, exposure_us)| few(AravisSettings { gain_raw: Some(gain), exposure_us, ..settings() }));
    assert!(dark < 0.5 * exposed && (exposed - amplified).abs() > 5.0, "{dark}, {exposed}, {amplified}");
    let line = AravisSettings { trigger: Trigger::Line("Line9".into()), ..settings() };
    let said = AravisCamera::open(line).err().unwrap().to_string();
    assert!(said.contains("TriggerSource = Line9"), "{said}");
}

/// The receive buffer of the stream's socket, bytes, as the kernel counts it.
fn receive_buffer(camera: &AravisCamera) -> u64 {
    let device = camera.device().unwrap().gv().unwrap();
    let socket = socket::of_stream(&device, camera.armed.as_ref().unwrap().port()).unwrap();
    socket2::SockRef::from(&socket).recv_buffer_size().unwrap() as u64
}

/// What the kernel grants of the configured buffer. It doubles a size for its own needs.
fn granted(settings: &AravisSettings) -> u64 {
    let most: u64 = std::fs::read_to_string("/proc/sys/net/core/rmem_max").unwrap().trim().parse().unwrap();
    2 * most.min(settings.socket_buffer_bytes.into())
}

#[test]
fn a_strict_run_leaves_no_test_out() {
    strict::holds(&[(cfg!(has_fake_camera), "no arv-fake-gv-camera-0.8: apt-get install aravis-tools")]);
}

// One test, since all of it needs the one address on which the fake can listen.
#[test]
#[cfg_attr(not(has_fake_camera), ignore = "no arv-fake-gv-camera-0.8: apt-get install aravis-tools")]
fn a_camera_of_another_maker_is_opened_driven_refused_to_others_and_missed_when_gone() {
    let fake = Fake::start();
    let mut camera = open_within(Duration::from_secs(20));
    assert!(camera.identity().contains("Aravis"), "{}", camera.identity());
    let deadline = Duration::from_secs(5);
    assert!(matches!(camera.grab(deadline), Err(DeviceError::NotArmed)));

    // Twice, since a second acquisition on an old stream would lose every frame.
    for _ in 0..2 {
        camera.arm().unwrap();
        assert_eq!(receive_buffer(&camera), granted(&settings()), "before the first frame");
        let mut last = None;
        for _ in 0..4 {
            let grabbed = camera.grab(deadline).unwrap();
            assert_eq!((grabbed.frame.width(), grabbed.frame.height(), grabbed.frame.bytes().len()), (512, 256, 512 * 256));
            assert!(last.replace(grabbed.frame_id) != Some(grabbed.frame_id), "every frame is a new one");
        }
        camera.disarm().unwrap();
    }
    assert!(camera.counters().completed >= 8);

    let second = AravisCamera::open(settings()).err().unwrap();
    assert!(matches!(second, DeviceError::NotController { .. }), "{second}");
    drop(camera);
    takes_what_it_is_given(deadline);

    for (bad, named) in [
        (AravisSettings { width: 65_535, ..settings() }, "Width = 65535"),
        (AravisSettings { gain_raw: Some(1_000_000), ..settings() }, "GainRaw = 1000000"),
        (AravisSettings { exposure_us: 6e7, ..settings() }, "exposure = 60000000 us"),
        (AravisSettings { features: vec![("NoSuchFeature".into(), "1".into())], ..settings() }, "NoSuchFeature = 1"),
    ] {
        let said = AravisCamera::open(bad).err().unwrap().to_string();
        assert!(said.contains(named), "{said}");
    }

    let mut camera = open_within(Duration::from_secs(20));
    camera.arm().unwrap();
    camera.grab(deadline).unwrap();
    drop(fake);
    let gone = camera.grab(deadline).unwrap_err();
    assert!(matches!(gone, DeviceError::CameraSilent { .. } | DeviceError::ControlLost), "{gone}");
    assert!(matches!(camera.grab(deadline), Err(DeviceError::ControlLost)), "a dead camera is not waited for again");
}
