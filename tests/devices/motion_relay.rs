//! The driver of the relay against an emulated relay and its VAST.
#![cfg(feature = "aravis")]

use crate::motion::{SPEED_DEG_PER_S, is_suspect, true_steps, turn, until, with_camera};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Relay, RelaySettings};
use carved_devices::{Capabilities, DeviceError, Position, RotationAxis};
use carved_records::ViewOrder;
use hardware_sim::RigSettings;
use hardware_sim::relay::{self, Knobs};
use std::time::Duration;

struct Bench {
    knobs: Knobs,
    emulated: hardware_sim::Rig,
}

impl Bench {
    fn new() -> Self {
        let machine = relay::Settings::default();
        let knobs = machine.knobs.clone();
        Self { knobs, emulated: crate::motion::rig(RigSettings { relay: Some(machine), ..RigSettings::default() }) }
    }

    fn settings(&self) -> RelaySettings {
        RelaySettings {
            address: self.emulated.relay_address().unwrap().to_string(),
            boot: false,
            boot_timeout_ms: 5000,
            speed_deg_per_s: SPEED_DEG_PER_S,
            turn_margin_ms: 1000,
            answer_timeout_ms: 700,
        }
    }

    fn open(&self) -> Relay {
        Relay::open(self.settings(), crate::motion::per_revolution()).unwrap()
    }

    /// A referenced axis, and the true position of its step 0.
    fn referenced(&self) -> (Relay, f64) {
        let mut axis = self.open();
        axis.reference(&CancelToken::new()).unwrap();
        (axis, true_steps(&self.emulated))
    }
}

#[test]
fn a_revolution_of_differences_shows_every_view_at_the_angle_of_its_ledger() {
    let bench = Bench::new();
    let axis = Relay::open(RelaySettings { boot: true, ..bench.settings() }, crate::motion::per_revolution()).unwrap();
    let expected = Capabilities {
        has_position: false,
        has_encoder: false,
        has_stall: false,
        can_stop: false,
        absolute: false,
        trigger_only: false,
        outside: false,
    };
    assert_eq!(axis.capabilities(), expected);
    let mut devices = with_camera(&bench.emulated, Box::new(axis));
    for (epoch, order, splits) in [(1, ViewOrder::Sequential, false), (2, ViewOrder::CoarseToFine, true)] {
        bench.knobs.split_answers(splits);
        assert_eq!(devices.rotation.reference(&CancelToken::new()).unwrap().epoch, epoch);
        let ledger = turn(&bench.emulated, &mut devices, order);
        assert_eq!(ledger.closure().unwrap().achieved_steps, Steps(500));
    }
}

/// Sets a fault and makes a move. Checks that the move fails as expected, that at most one difference was turned, and that the axis can be
/// recovered.
fn fails(fault: impl FnOnce(&Bench), mend: impl FnOnce(&Bench), as_it_should: impl Fn(&DeviceError) -> bool) {
    let bench = Bench::new();
    let (mut axis, zero) = bench.referenced();
    fault(&bench);
    let error = axis.move_to(Steps(24)).unwrap_err();
    assert!(as_it_should(&error), "{error:?}");
    assert!(is_suspect(&axis), "{:?}", axis.position());
    assert!(matches!(axis.move_to(Steps(24)), Err(DeviceError::Suspect { .. })), "a suspect axis refuses to move");
    mend(&bench);
    let epoch = axis.reference(&CancelToken::new()).unwrap().epoch;
    assert_eq!(epoch, 3, "one for the first reference, one for the doubt, one for the new reference");
    let here = true_steps(&bench.emulated);
    assert!((here - zero).abs() < 1e-6 || (here - zero - 24.0).abs() < 1e-6, "from {zero} to {here}: a difference was turned twice");
    assert_eq!(axis.move_to(Steps(-24)).unwrap().steps, Steps(-24));
    assert!((true_steps(&bench.emulated) - here + 24.0).abs() < 1e-6);
}

fn unexpected(error: &DeviceError, words: [&str; 2]) -> bool {
    matches!(error, DeviceError::Unexpected { expected, found, .. } if expected.contains(words[0]) && found.contains(words[1]))
}

#[test]
fn a_relay_that_never_becomes_idle_ends_the_move_at_its_deadline() {
    fails(|b| b.knobs.never_idle_after_turns(true), |b| b.knobs.never_idle_after_turns(false), |e| matches!(e, DeviceError::Late { .. }));
}

#[test]
fn a_machine_that_somebody_else_moves_is_not_moved() {
    fails(|b| b.knobs.answer_next("1"), |_| {}, |e| matches!(e, DeviceError::Suspect { why } if why.contains("without a request")));
}

#[test]
fn idle_just_after_a_turn_was_asked_for_is_not_believed() {
    let bench = Bench::new();
    let (mut axis, zero) = bench.referenced();
    bench.knobs.say_idle_for(Duration::from_millis(100));
    axis.move_to(Steps(250)).unwrap();
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6, "it still turned when it was said to have arrived");
}

#[test]
fn a_connection_that_ends_within_a_turn_is_told_and_made_anew() {
    fails(|b| b.knobs.hang_up_in_turns(1), |_| {}, |e| matches!(e, DeviceError::Gone { .. }));
}

/// The same fault at the question before the turn, and at the turn itself, which is then made without an acknowledgement.
fn fails_before_and_within(fault: impl Fn(&Knobs), as_it_should: impl Fn(&DeviceError) -> bool) {
    for only_turns in [false, true] {
        let turn_the_knob = |b: &Bench| {
            b.knobs.only_turns(only_turns);
            fault(&b.knobs);
        };
        fails(turn_the_knob, |_| {}, &as_it_should);
    }
}

#[test]
fn an_answer_that_is_missing_or_late_is_never_taken_for_another_ones() {
    let silent = |e: &DeviceError| matches!(e, DeviceError::Silent { .. });
    fails_before_and_within(|k| k.lose_answers(1), silent);
    fails_before_and_within(|k| k.delay_answers(1, Duration::from_millis(900)), silent);
    fails_before_and_within(|k| k.double_answers(1), |e| unexpected(e, ["silence", "nothing"]));
}

#[test]
fn an_answer_that_is_none_is_told_with_what_came() {
    fails_before_and_within(|k| k.send_wrong_lengths(1), |e| unexpected(e, ["512", "4294967295"]));
    fails_before_and_within(|k| k.answer_next("\u{e9}t\u{e9}"), |e| unexpected(e, ["ASCII", "\\xc3\\xa9"]));
    fails(|b| b.knobs.answer_next("idle"), |_| {}, |e| unexpected(e, ["a number", "idle"]));
    let refused = |e: &DeviceError| matches!(e, DeviceError::Alarm { what, .. } if what.contains("no VAST"));
    fails_before_and_within(|k| k.answer_next("error: no VAST"), refused);
}

#[test]
fn a_stop_ends_the_requests_and_vast_ends_its_turn() {
    let bench = Bench::new();
    let (mut axis, zero) = bench.referenced();
    let stop = axis.stop_handle();
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(Steps(250)));
        until("the shaft turns", || true_steps(&bench.emulated) > zero + 1.0);
        stop.stop();
        let error = moving.join().unwrap().unwrap_err();
        assert!(matches!(error, DeviceError::Stopped), "{error}");
    });
    assert!(is_suspect(&axis));
    let cancelled = CancelToken::new();
    cancelled.cancel();
    assert!(matches!(axis.reference(&cancelled), Err(DeviceError::Stopped)), "who stops for good stays stopped");
    // The next reference waits until the turn has ended. A stop handle from before the reference still works.
    axis.reference(&CancelToken::new()).unwrap();
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6);
    stop.stop();
    assert!(matches!(axis.move_to(Steps(1)), Err(DeviceError::Stopped)));
    assert!((true_steps(&bench.emulated) - zero - 250.0).abs() < 1e-6);
}

#[test]
fn nobody_there_and_nobody_referenced_are_told() {
    let bench = Bench::new();
    let mut axis = bench.open();
    assert_eq!(axis.position(), Position::Unknown);
    assert!(matches!(axis.move_to(Steps(24)), Err(DeviceError::NotReferenced)));
    let settings = bench.settings();
    drop(axis);
    drop(bench);
    let nobody = Relay::open(settings, crate::motion::per_revolution()).err().unwrap();
    assert!(matches!(nobody, DeviceError::Open { .. }), "{nobody}");
}
