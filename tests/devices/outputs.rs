//! The outputs of Grbl, grblHAL, TMCL and Zaber controllers: what the driver says of an output is compared with its true level.

use crate::common::controllers::{self, serial_port};
use crate::driver::until;
use crate::{motion_tmcl, motion_zaber};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::outputs::{OutputSettings, OutputState, OutputTable, OutputUse, views_off, views_on};
use carved_devices::rotation::{Grbl, GrblPin, GrblSettings, Reference, Tmcl, TmclPin, TmclSettings, Zaber, ZaberPin, ZaberSettings};
use carved_devices::{DeviceError, RotationAxis};
use hardware_sim::{Controller, OutputPin, Rig, grbl, tmcl, zaber};

fn table<P: Copy>(outputs: &[(&str, P, OutputUse)]) -> OutputTable<P> {
    outputs.iter().map(|(name, pin, on)| ((*name).to_owned(), OutputSettings { pin: *pin, on: *on, settle_ms: 0 })).collect()
}

/// A light for the views at one pin, a valve at another.
fn light_and_valve<P: Copy>(light: P, valve: P) -> OutputTable<P> {
    table(&[("light", light, OutputUse::Views), ("valve", valve, OutputUse::Manual)])
}

fn grbl_rig(controller: fn(grbl::Settings) -> Controller) -> (Rig, Box<dyn RotationAxis>) {
    let rig = crate::driver::rig(controller(grbl::Settings::default()), (500, 1));
    let outputs = light_and_valve(GrblPin::FloodCoolant, GrblPin::MistCoolant);
    let settings = GrblSettings { outputs, ..controllers::grbl(serial_port(&rig), Reference::Here) };
    let axis = Box::new(Grbl::open(settings).unwrap());
    (rig, axis)
}

fn tmcl_rig() -> (Rig, Box<dyn RotationAxis>) {
    let rig = crate::driver::rig(Controller::Tmcl(tmcl::Settings::default()), (6400, 1));
    let outputs = light_and_valve(TmclPin(0), TmclPin(3));
    let settings = TmclSettings { outputs, reference: Reference::Here, ..motion_tmcl::settings_at(serial_port(&rig)) };
    let axis = Box::new(Tmcl::open(settings).unwrap());
    (rig, axis)
}

fn zaber_rig() -> (Rig, Box<dyn RotationAxis>) {
    let rig = crate::driver::rig(Controller::Zaber(zaber::Settings::default()), (6400, 1));
    let outputs = light_and_valve(ZaberPin(1), ZaberPin(4));
    let settings = ZaberSettings { outputs, reference: Reference::Here, ..motion_zaber::settings(&rig) };
    let axis = Box::new(Zaber::open(settings).unwrap());
    (rig, axis)
}

type Make = (Rig, Box<dyn RotationAxis>);

/// Every make, with the true pins of the light and the valve.
fn makes() -> [(Make, [OutputPin; 2]); 4] {
    let grbl = [OutputPin::Flood, OutputPin::Mist];
    [
        (grbl_rig(Controller::Grbl), grbl),
        (grbl_rig(Controller::GrblHal), grbl),
        (tmcl_rig(), [OutputPin::Number(0), OutputPin::Number(3)]),
        (zaber_rig(), [OutputPin::Number(1), OutputPin::Number(4)]),
    ]
}

/// What the driver says of light and valve.
fn said(axis: &mut dyn RotationAxis) -> [OutputState; 2] {
    let statuses = axis.outputs().unwrap().statuses();
    assert_eq!(statuses.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["light", "valve"]);
    [statuses[0].state, statuses[1].state]
}

fn levels(rig: &Rig, pins: [OutputPin; 2]) -> [bool; 2] {
    pins.map(|pin| rig.outputs().is_on(pin))
}

use OutputState::{Off, On, Unknown};

#[test]
fn an_output_is_switched_and_the_other_stays() {
    for ((rig, mut axis), pins) in makes() {
        let cancel = CancelToken::new();
        axis.reference(&cancel).unwrap();
        let axis = axis.as_mut();
        assert_eq!((said(axis), levels(&rig, pins)), ([Unknown; 2], [false; 2]), "{}", axis.identity());
        axis.outputs().unwrap().switch("valve", true).unwrap();
        views_on(axis, &cancel).unwrap();
        assert_eq!((said(axis), levels(&rig, pins)), ([On; 2], [true; 2]), "{}", axis.identity());
        axis.move_to(Steps(64)).unwrap();
        views_off(axis);
        assert_eq!((said(axis), levels(&rig, pins)), ([Off, On], [false, true]), "{}", axis.identity());
        axis.outputs().unwrap().switch("light", true).unwrap();
        axis.outputs().unwrap().switch("valve", false).unwrap();
        assert_eq!((said(axis), levels(&rig, pins)), ([On, Off], [true, false]), "{}", axis.identity());
    }
}

#[test]
fn a_refusal_names_output_and_reason_and_leaves_the_state_unknown() {
    for ((rig, mut axis), pins) in makes() {
        rig.outputs().refuse(pins[1], true);
        axis.reference(&CancelToken::new()).unwrap();
        let error = axis.outputs().unwrap().switch("valve", true).unwrap_err();
        let is_output = matches!(&error, DeviceError::Output { name, on: true, .. } if name == "valve");
        assert!(is_output, "{error}");
        let why = if pins[1] == OutputPin::Mist { "ENABLE_M7" } else { "got " };
        assert!(error.to_string().contains(why), "{error}");
        assert_eq!(said(axis.as_mut())[1], Unknown);
        assert_eq!(axis.outputs().unwrap().statuses()[1].trouble, Some(error.to_string()));
        assert!(axis.move_to(Steps(64)).is_ok(), "the axis is not in doubt");
        rig.outputs().refuse(pins[1], false);
        axis.outputs().unwrap().switch("valve", true).unwrap();
        assert_eq!(axis.outputs().unwrap().statuses()[1].trouble, None);
    }
}

#[test]
fn a_restart_makes_the_states_unknown_and_they_can_be_switched_again() {
    for ((rig, mut axis), pins) in makes() {
        let (axis, cancel) = (axis.as_mut(), CancelToken::new());
        axis.reference(&cancel).unwrap();
        axis.outputs().unwrap().switch("valve", true).unwrap();
        views_on(axis, &cancel).unwrap();
        rig.faults().reboot_controller();
        until("the driver to notice", || {
            let checked = axis.check();
            matches!(checked, Err(DeviceError::Intervention { .. })) && said(axis) == [Unknown; 2]
        });
        assert_eq!(levels(&rig, pins), [false; 2], "{}", axis.identity());
        axis.reference(&cancel).unwrap();
        views_on(axis, &cancel).unwrap();
        assert_eq!((said(axis), levels(&rig, pins)), ([On, Unknown], [true, false]), "{}", axis.identity());
    }
}

#[test]
fn after_a_stop_in_a_move_or_at_rest_outputs_are_switched_and_nothing_moves() {
    for in_a_move in [true, false] {
        for ((rig, mut axis), pins) in makes() {
            let cancel = CancelToken::new();
            axis.reference(&cancel).unwrap();
            views_on(axis.as_mut(), &cancel).unwrap();
            let stop = axis.stop_handle();
            if in_a_move {
                std::thread::scope(|scope| {
                    let moving = scope.spawn(|| axis.move_to(Steps(64_000)));
                    until("the axis to turn", || rig.shaft().is_turning());
                    stop.stop();
                    assert!(moving.join().unwrap().is_err());
                });
            } else {
                stop.end_motion();
            }
            views_off(axis.as_mut());
            assert_eq!((said(axis.as_mut())[0], levels(&rig, pins)), (Off, [false; 2]), "{}", axis.identity());
            // A check of a plan takes a lit frame after an aborted run. The run itself switches nothing on any more.
            views_on(axis.as_mut(), &CancelToken::new()).unwrap();
            assert_eq!((said(axis.as_mut())[0], levels(&rig, pins)), (On, [true, false]), "{}", axis.identity());
            views_off(axis.as_mut());
            cancel.cancel();
            assert!(matches!(views_on(axis.as_mut(), &cancel), Err(DeviceError::Stopped)));
            assert_eq!((said(axis.as_mut())[0], levels(&rig, pins)), (Off, [false; 2]), "{}", axis.identity());
            // The stop stays latched.
            assert!(axis.move_to(Steps(64)).is_err(), "{}", axis.identity());
        }
    }
}

#[test]
fn a_driver_that_is_dropped_leaves_no_light_on_and_leaves_a_valve_as_it_is() {
    for ((rig, mut axis), pins) in makes() {
        let cancel = CancelToken::new();
        axis.reference(&cancel).unwrap();
        axis.outputs().unwrap().switch("valve", true).unwrap();
        views_on(axis.as_mut(), &cancel).unwrap();
        drop(axis);
        until("the light to go off", || levels(&rig, pins) == [false, true]);
    }
}

#[test]
fn a_light_whose_switching_on_was_not_confirmed_is_switched_off_with_the_driver() {
    let (rig, mut axis) = tmcl_rig();
    axis.reference(&CancelToken::new()).unwrap();
    rig.faults().serial().drop_answers(u32::MAX);
    let error = axis.outputs().unwrap().switch("light", true).unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    assert!(said(axis.as_mut())[0] == Unknown && rig.outputs().is_on(OutputPin::Number(0)), "the request arrived, its answer did not");
    rig.faults().serial().drop_answers(0);
    drop(axis);
    until("the light to go off", || !rig.outputs().is_on(OutputPin::Number(0)));
}

#[test]
fn a_spindle_output_needs_a_controller_without_laser_mode() {
    let settings = |rig: &Rig| {
        let outputs = table(&[("light", GrblPin::Spindle, OutputUse::Views)]);
        GrblSettings { outputs, ..controllers::grbl(serial_port(rig), Reference::Here) }
    };
    let rig = crate::driver::rig(Controller::Grbl(grbl::Settings::default()), (500, 1));
    let mut axis = Grbl::open(settings(&rig)).unwrap();
    axis.reference(&CancelToken::new()).unwrap();
    for on in [true, false] {
        axis.outputs().unwrap().switch("light", on).unwrap();
        assert_eq!(rig.outputs().is_on(OutputPin::Spindle), on);
    }
    let mut laser = grbl::Settings::default();
    laser.set(32, 1.0).unwrap();
    let rig = crate::driver::rig(Controller::Grbl(laser), (500, 1));
    let error = Grbl::open(settings(&rig)).err().unwrap();
    assert!(matches!(&error, DeviceError::Mismatch { differences, .. } if differences.len() == 1), "{error}");
    assert!(error.to_string().contains("$32 (laser mode)"), "{error}");
}

/// The sampler's wire is the flood output, and M9 ends it: the light at the mist output must survive.
#[test]
fn the_sampler_s_wire_does_not_switch_the_light_off() {
    let rig = crate::driver::rig(Controller::Grbl(grbl::Settings::default()), (500, 1));
    let outputs = table(&[("light", GrblPin::MistCoolant, OutputUse::Views)]);
    let mut axis = Grbl::open(GrblSettings { outputs, ..controllers::grbl(serial_port(&rig), Reference::Here) }).unwrap();
    let cancel = CancelToken::new();
    axis.reference(&cancel).unwrap();
    views_on(&mut axis, &cancel).unwrap();
    for done in [true, false] {
        axis.specimen_input().unwrap().say_done(done).unwrap();
        assert_eq!((rig.outputs().is_on(OutputPin::Flood), rig.outputs().is_on(OutputPin::Mist)), (done, true));
    }
}
