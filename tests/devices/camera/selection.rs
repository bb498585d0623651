//! How a camera is found and configured.

use super::bench::{Bench, DEADLINE, rig, settings};
use carved_devices::DeviceError;
use carved_devices::camera::{self, AravisSettings, CameraSelect, Trigger};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[test]
fn a_name_that_nobody_has_is_an_error_that_lists_who_answers() {
    for select in [CameraSelect::Serial("no-such-serial".into()), CameraSelect::Mac("02:00:00:00:00:01".parse().unwrap())] {
        let rig = rig();
        let said = camera::open(AravisSettings { select: select.clone(), ..settings(&rig) }).err().unwrap().to_string();
        assert!(said.contains(&select.to_string()) && (said.contains("none does") || said.contains("these do")), "{said}");
    }
}

fn is_listed(listed: &[camera::Listed], serial: &str) -> bool {
    listed.iter().any(|camera| camera.serial.as_deref() == Some(serial))
}

/// Two cameras on one network: each of its names selects a camera, and never the other one.
#[test]
fn a_camera_is_found_by_its_address_id_serial_number_and_hardware_address() {
    let (one, other) = (rig(), rig());
    // A camera answers a broadcast with one datagram, which a busy computer may lose.
    let is_whole = |listed: &Vec<_>| [&one, &other].iter().all(|rig| is_listed(listed, rig.camera_serial()));
    let listed = (0..9).map(|_| camera::discover()).find(is_whole).unwrap_or_else(camera::discover);
    for (rig, another) in [(&one, &other), (&other, &one)] {
        let named =
            |serial: &str| listed.iter().find(|camera| camera.serial.as_deref() == Some(serial)).unwrap_or_else(|| panic!("{listed:?}"));
        let own = named(rig.camera_serial());
        assert_ne!((&own.id, &own.mac), (&named(another.camera_serial()).id, &named(another.camera_serial()).mac));
        assert_eq!(own.address.as_deref(), Some(rig.camera_address().to_string().as_str()));
        let before = another.exposures().len();
        for select in [
            CameraSelect::Address(rig.camera_address()),
            CameraSelect::Id(own.id.clone().unwrap()),
            CameraSelect::Serial(rig.camera_serial().to_owned()),
            CameraSelect::Mac(own.mac.as_ref().unwrap().parse().unwrap()),
        ] {
            let mut opened = camera::open(AravisSettings { select: select.clone(), ..settings(rig) }).unwrap();
            assert!(opened.identity().contains(&format!("({})", rig.camera_serial())), "{select}: {}", opened.identity());
            opened.arm().unwrap();
            opened.grab(DEADLINE).unwrap();
            assert_eq!(another.exposures().len(), before, "{select}: the other camera was triggered");
        }
    }
}

#[test]
fn gain_goes_to_the_feature_that_is_there() {
    let rig = rig();
    let base = settings(&rig);
    let open = |gain, gain_raw| camera::open(AravisSettings { gain, gain_raw, ..base.clone() });
    assert!(open(Some(1.5), Some(6)).is_ok(), "GainRaw is there and has a value");
    let said = open(Some(1.5), None).err().unwrap().to_string();
    assert!(said.contains("no Gain") && said.contains("gain_raw"), "{said}");
    let said = open(None, Some(99)).err().unwrap().to_string();
    assert!(said.contains("GainRaw = 99"), "values are held against the feature's range: {said}");
}

#[test]
fn values_out_of_range_are_refused_by_name() {
    let rig = rig();
    let good = settings(&rig);
    let feature = |name: &str, value: &str| vec![(name.to_owned(), value.to_owned())];
    for (bad, named) in [
        (AravisSettings { exposure_us: 1.0, ..good.clone() }, "exposure = 1 us"),
        (AravisSettings { width: 65_535, ..good.clone() }, "Width = 65535"),
        (AravisSettings { offset_x: 3, width: 128, ..good.clone() }, "OffsetX = 3"),
        (AravisSettings { trigger: Trigger::Line("Line2".into()), ..good.clone() }, "TriggerSource = Line2"),
        (AravisSettings { trigger: Trigger::FixedRateHz(1e4), ..good.clone() }, "frame rate = 10000 Hz"),
        (AravisSettings { features: feature("StreamBytesPerSecond", "5"), ..good.clone() }, "StreamBytesPerSecond = 5"),
    ] {
        let said = camera::open(bad).err().unwrap_or_else(|| panic!("taken: {named}"));
        assert!(matches!(said, DeviceError::Camera { .. }) && said.to_string().contains(named), "{said}");
    }
}

#[test]
fn a_fixed_rate_gives_only_frames_that_were_exposed_after_they_were_asked_for() {
    let mut bench = Bench::armed_with(|s| AravisSettings { trigger: Trigger::FixedRateHz(20.0), ..s });
    for _ in 0..20 {
        bench.take();
    }
}

#[test]
fn a_line_triggers_and_without_its_pulse_nothing_is_taken() {
    let mut bench = Bench::armed_with(|s| AravisSettings { trigger: Trigger::Line("Line1".into()), ..s });
    let error = bench.camera.grab(DEADLINE).unwrap_err();
    assert!(matches!(error, DeviceError::NoFrame { .. }), "{error}");
    assert_eq!(bench.rig.exposures().len(), 0);
    for _ in 0..5 {
        let before = bench.rig.exposures().len() as u64;
        let quit = AtomicBool::new(false);
        let grabbed = std::thread::scope(|scope| {
            let (rig, quit) = (&bench.rig, &quit);
            // The controller signals its arrival repeatedly until the camera has been read.
            scope.spawn(move || {
                while !quit.load(Ordering::SeqCst) {
                    rig.pulse_camera_line();
                    std::thread::sleep(Duration::from_millis(20));
                }
            });
            let grabbed = bench.camera.grab(DEADLINE);
            quit.store(true, Ordering::SeqCst);
            grabbed.unwrap()
        });
        bench.hold(&grabbed, before);
    }
}
