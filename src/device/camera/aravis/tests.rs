//! Against Aravis' own fake camera, a peer that is not ours: skipped where Debian's aravis-tools are not installed.

use super::*;
use crate::frame::PixelFormat;
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};

struct Fake(Child);

impl Fake {
    fn start() -> Option<Self> {
        let mut command = Command::new("arv-fake-gv-camera-0.8");
        let child = command.args(["-i", "127.0.0.1"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().ok()?;
        Some(Self(child))
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
    let until = Instant::now() + patience;
    loop {
        match AravisCamera::open(settings()) {
            Ok(camera) => return camera,
            Err(e) => assert!(Instant::now() < until, "{e}"),
        }
    }
}

// One test, since all of it needs the one address on which the fake can listen.
#[test]
fn a_camera_of_another_maker_is_opened_driven_refused_to_others_and_missed_when_gone() {
    let Some(fake) = Fake::start() else {
        eprintln!("skipped: arv-fake-gv-camera-0.8 is not installed (apt-get install aravis-tools)");
        return;
    };
    let mut camera = open_within(Duration::from_secs(20));
    assert!(camera.identity().contains("Aravis"), "{}", camera.identity());
    let deadline = Duration::from_secs(5);
    assert!(matches!(camera.grab(deadline), Err(DeviceError::NotArmed)));

    // Twice, since a second acquisition on an old stream would lose every frame.
    for _ in 0..2 {
        camera.arm().unwrap();
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

    for (bad, named) in [
        (AravisSettings { width: 100_000, ..settings() }, "Width = 100000"),
        (AravisSettings { gain_raw: Some(1_000_000), ..settings() }, "GainRaw = 1000000"),
        (AravisSettings { exposure_us: 1e12, ..settings() }, "exposure = 1000000000000 us"),
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
