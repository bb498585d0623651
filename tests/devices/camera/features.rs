//! Features that another program left in the camera, or changes while views are taken.

use super::bench::{Bench, rig, settings};
use carved_devices::DeviceError;
use carved_devices::camera::{self, AravisSettings};

const CONTINUOUS: u32 = 2;

#[test]
fn what_another_program_left_is_neutral_when_views_are_taken() {
    let rig = rig();
    let left = [
        ("ReverseX", 1),
        ("ReverseY", 1),
        ("ExposureAuto", CONTINUOUS),
        ("GainAuto", CONTINUOUS),
        ("Gamma", 0.5f32.to_bits()),
        ("BinningHorizontal", 2),
    ];
    for (name, value) in left {
        assert!(rig.camera().leave(name, value), "the camera has {name}");
    }
    let mut camera = camera::open(settings(&rig)).unwrap();
    camera.arm().unwrap();
    let values = camera.features();
    let mut bench = Bench { camera, rig };
    // A reversed frame has the number of its exposure at another place.
    bench.take();
    for (name, value) in [("ReverseX", "false"), ("ExposureAuto", "Off"), ("GainAuto", "Off"), ("Gamma", "1"), ("BinningHorizontal", "1")] {
        assert_eq!(values.get(name).map(String::as_str), Some(value), "{name}: {values:?}");
    }
    assert!(values["ExposureTimeAbs"].starts_with("1000"), "{values:?}");

    // The same between two acquisitions.
    bench.camera.disarm().unwrap();
    for (name, value) in left {
        assert!(bench.rig.camera().leave(name, value));
    }
    bench.camera.arm().unwrap();
    bench.take();
}

#[test]
fn a_change_in_mid_turn_is_said_by_name_and_undone() {
    let mut bench = Bench::armed();
    for (name, value) in [("ExposureTimeAbs", 700f32.to_bits()), ("GainRaw", 5), ("ExposureAuto", CONTINUOUS)] {
        bench.take();
        assert!(bench.rig.camera().leave(name, value));
        let seen = bench.try_take().unwrap_err();
        assert!(matches!(&seen, DeviceError::CameraChanged { name: found, .. } if found == name), "{name}: {seen}");
        bench.take();
    }
}

#[test]
fn a_feature_that_is_not_compared_with_every_frame_is_compared_after_a_turn() {
    let mut bench = Bench::armed();
    for (name, value) in [("Gamma", 0.5f32.to_bits()), ("BinningHorizontal", 2)] {
        bench.take();
        bench.camera.check_features().unwrap();
        assert!(bench.rig.camera().leave(name, value));
        let seen = bench.camera.check_features().unwrap_err();
        assert!(matches!(&seen, DeviceError::CameraChanged { name: found, .. } if found == name), "{name}: {seen}");
        bench.camera.check_features().unwrap();
    }
}

/// A mirror in the light path may be undone by the camera.
#[test]
fn what_the_configuration_names_is_kept() {
    let rig = rig();
    let features = vec![("ReverseY".to_owned(), "true".to_owned())];
    let mut camera = camera::open(AravisSettings { features, ..settings(&rig) }).unwrap();
    camera.arm().unwrap();
    assert_eq!(camera.features()["ReverseY"], "true");
}
