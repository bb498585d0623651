//! The axis along the capillary, which is the second axis of the emulated Grbl: driver, limits, reference, and a specimen that is brought
//! into view.
#![cfg(feature = "aravis")]

use crate::common::{Daemon, configured, controllers, json, port, small_frames, small_scene};
use carved_core::units::{Sense, Steps};
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{AxisLetter, Grbl, Reference, TranslationSettings};
use carved_devices::{DeviceError, Position, RotationAxis};
use hardware_sim::grbl::Settings;
use hardware_sim::scene::{Placement, Specimen};
use hardware_sim::{Controller, Rig, RigSettings, Sight, SlideSettings, TestCard};
use serde_json::json;
use std::sync::Arc;

/// um by which a homing cycle ends before the switch: $27 = 1 unit of 10 um is 213 whole steps.
const PULL_OFF_UM: f64 = 213.0 * 3.0 / 64.0;

/// A controller whose X turns and whose Y, in units of 10 um, has a travel of 20 mm.
fn firmware() -> Settings {
    let mut settings = Settings::default();
    for (number, value) in [(27, 1.0), (101, 213.333_33), (111, 60_000.0), (121, 5000.0), (131, 2000.0)] {
        settings.set(number, value).unwrap();
    }
    settings
}

fn rig(controller: Controller, sight: Arc<dyn Sight>) -> Rig {
    let slide = Some(SlideSettings::default());
    Rig::start(RigSettings { time_scale: 20.0, controller, slide, ..RigSettings::default() }, sight).unwrap()
}

fn bench() -> Rig {
    rig(Controller::Grbl(firmware()), Arc::new(TestCard::new(64, 64)))
}

fn translation() -> TranslationSettings {
    TranslationSettings {
        axis: AxisLetter::Y,
        steps_per_um: [64, 3],
        um_per_unit: 10,
        max_rate_units_per_min: 60_000.0,
        acceleration_units_per_s2: 5000.0,
        limits_um: [-19_000.0, 0.0],
        position_um: -4990.0,
        sense: Sense::Positive,
    }
}

fn open(rig: &Rig, reference: Reference) -> Grbl {
    let settings = controllers::grbl(controllers::serial_port(rig), reference);
    Grbl::with_translation(settings, Some(translation())).unwrap()
}

/// Checks the true position of the slide, um from the switch.
fn stands_at(rig: &Rig, um: f64) {
    let found = rig.slide().unwrap().position_um();
    // Half a step of 3/64 um.
    assert!((found - um).abs() < 0.024, "the slide stands at {found} um, not at {um}");
}

#[test]
fn it_moves_in_whole_steps_within_its_limits_from_where_the_axes_home_together() {
    let rig = bench();
    let mut grbl = open(&rig, Reference::Home);
    let cancel = CancelToken::new();
    assert_eq!(grbl.linear().unwrap().position(), Position::Unknown);
    assert!(matches!(grbl.linear().unwrap().reference(&cancel), Err(DeviceError::Translation { .. })), "the rotation goes first");
    grbl.reference(&cancel).unwrap();
    stands_at(&rig, -PULL_OFF_UM);
    let angle = rig.shaft().angle_rad();
    let axis = grbl.linear().unwrap();
    assert_eq!(axis.reference(&cancel).unwrap().steps, Steps(0));
    for um in [-4990.0, -18_999.0, -0.5, -4990.0] {
        let target = axis.steps_of(um);
        assert_eq!(axis.move_to(target).unwrap().steps, target);
        stands_at(&rig, um - PULL_OFF_UM);
    }
    assert_eq!(rig.shaft().angle_rad().to_bits(), angle.to_bits(), "the other axis has not moved");
    for beyond in [-19_001.0, 1.0] {
        let target = axis.steps_of(beyond);
        let said = axis.move_to(target).unwrap_err().to_string();
        assert!(said.contains("its limits are") && said.contains("-405333"), "{said}");
    }
    stands_at(&rig, -4990.0 - PULL_OFF_UM);
    // A move of the rotation does not move the translation.
    grbl.move_to(Steps(250)).unwrap();
    assert_eq!(grbl.linear().unwrap().position(), Position::Referenced { steps: Steps(-106_453), epoch: 1 });
}

#[test]
fn it_homes_alone_where_the_rotation_does_not() {
    let rig = bench();
    let mut grbl = open(&rig, Reference::Here);
    let cancel = CancelToken::new();
    grbl.reference(&cancel).unwrap();
    let angle = rig.shaft().angle_rad();
    assert!(grbl.linear().unwrap().move_to(Steps(0)).is_err(), "not referenced");
    assert_eq!(grbl.linear().unwrap().reference(&cancel).unwrap().steps, Steps(0));
    stands_at(&rig, -PULL_OFF_UM);
    assert_eq!(rig.shaft().angle_rad().to_bits(), angle.to_bits(), "the rotation stays");
    grbl.linear().unwrap().move_to(Steps(-6400)).unwrap();
    // The reference of the rotation for the next specimen does not move the translation.
    grbl.reference(&cancel).unwrap();
    assert!(matches!(grbl.linear().unwrap().position(), Position::Referenced { steps: Steps(-6400), .. }));
    grbl.linear().unwrap().move_to(Steps(-64)).unwrap();
    stands_at(&rig, -3.0 - PULL_OFF_UM);
}

#[test]
fn a_restart_makes_both_axes_doubtful_and_its_own_switches_end_a_move() {
    let rig = bench();
    let mut grbl = open(&rig, Reference::Home);
    let cancel = CancelToken::new();
    grbl.reference(&cancel).unwrap();
    rig.faults().reboot_controller();
    assert!(grbl.linear().unwrap().move_to(Steps(-64)).is_err());
    assert!(matches!(grbl.position(), Position::Suspect { .. }));
    assert!(matches!(grbl.linear().unwrap().position(), Position::Suspect { .. }));
    grbl.reference(&cancel).unwrap();
    grbl.linear().unwrap().move_to(Steps(-64)).unwrap();

    let mut limited = firmware();
    limited.set(21, 1.0).unwrap();
    let rig = self::rig(Controller::Grbl(limited), Arc::new(TestCard::new(64, 64)));
    let mut grbl = open(&rig, Reference::Home);
    grbl.reference(&cancel).unwrap();
    // The switch is 10 um away, because the configured limits are wrong.
    rig.faults().serial().rewrite_next_received(b"Y-1.298", b"Y20.000");
    let axis = grbl.linear().unwrap();
    let error = axis.move_to(axis.steps_of(-3.0)).unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.contains("ALARM:1")), "{error}");
    stands_at(&rig, 0.0);
}

/// The second axis of the emulated controller.
const TRANSLATION: &str = "\
[translation]
axis = \"Y\"
steps_per_um = [64, 3]
um_per_unit = 10
max_rate_units_per_min = 60000.0
acceleration_units_per_s2 = 5000.0
limits_um = [-19000.0, 0.0]
position_um = -4990.0

";

/// The right border of the picture cuts a larva that lies 1.8 mm off, until the capillary has been moved along.
#[test]
fn a_specimen_that_is_cut_by_the_pictures_side_is_carried_into_view_and_measured() {
    let folder = tempfile::tempdir().unwrap();
    let scene = small_scene();
    let rig = rig(Controller::Grbl(firmware()), scene.clone());
    let changes = [
        port(&rig),
        ("settle_ms = 50", "settle_ms = 5".into()),
        ("asd = 21", "asd = 12".into()),
        ("exposure_us = 5000.0", "exposure_us = 5000.0\nframe_timeout_ms = 5000".into()),
        ("grab_deadline_ms = 3000", "grab_deadline_ms = 20000".into()),
        ("[sampler]", format!("{TRANSLATION}[sampler]")),
    ];
    let (config, data) = configured("vast-grbl.toml", folder.path(), &rig, &[&changes[..], &small_frames()].concat());
    let daemon = Daemon::serve(&config, &data);
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test",
        "plate_map": [{"well": "A01", "specimen": "larva", "dpf": 4}]});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
    let larva = Specimen::larva(4, 1).unwrap();
    let hull_um3 = serde_json::to_value(larva.truth()).unwrap()["hull_volume_um3"].as_f64().unwrap();
    scene.load(larva.placed(Placement { x_um: 1800.0, ..Placement::default() })).unwrap();
    assert_eq!(daemon.put_loaded("r1", "A01"), 200);
    let status = daemon.wait("the run's end", |s| s["state"] == "Complete" || s["state"] == "Aborted");
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "succeeded", "{status}");
    let volume = well["volume_um3"].as_f64().unwrap();
    assert!((volume / hull_um3 - 1.0).abs() < 0.05, "{volume:e} um^3, hull {hull_um3:e}: {well}");
    let moved_um = rig.slide().unwrap().shift_um();
    assert!((-2700.0..-900.0).contains(&moved_um), "carried along by {moved_um} um");
    assert!(json(&data.join("runs/r1/A01/recording.json"))["ledger"].as_array().unwrap().len() == 13);
}
