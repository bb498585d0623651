//! The Grbl driver against the emulated firmware over a pty, with the faults of serial lines and controllers. docs/faults.md describes what
//! operator and loader see of each.
//!
//! ```text
//! driver ── pty ── line: flips, strays, cuts, delays ── firmware ── shaft
//!    └──────────── what it says it achieved ═══ must be ═══════════ true angle
//! ```

use crate::common::controllers;
use crate::driver::turns_evenly;
use carved_core::units::{Steps, StepsPerRevolution};
use carved_devices::acquisition::RevolutionPlan;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Grbl, GrblSettings, Port, Reference};
use carved_devices::{DeviceError, Position, RotationAxis};
use carved_records::ViewOrder;
use hardware_sim::grbl::Settings;
use hardware_sim::serial::Button;
use hardware_sim::{Controller, Rig, RigSettings, TestCard};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

const STEPS: f64 = 500.0;
/// View 1 of 21.
const TARGET: Steps = Steps(24);
/// The many short cases are distributed over this number of rigs, because they mostly wait.
const RIGS: usize = 12;
/// Far longer than anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

struct Bench {
    rig: Rig,
    _folder: tempfile::TempDir,
    settings: GrblSettings,
}

impl Bench {
    fn new(time_scale: f64) -> Self {
        Self::with(time_scale, Controller::default())
    }

    fn with(time_scale: f64, controller: Controller) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("motor");
        let rig = RigSettings { time_scale, controller, serial_link: Some(link.clone()), ..RigSettings::default() };
        let rig = Rig::start(rig, Arc::new(TestCard::new(64, 64))).unwrap();
        let settings = GrblSettings { homing_timeout_ms: 2000, ..controllers::grbl(Port::from(link.to_str().unwrap()), Reference::Home) };
        Self { rig, _folder: folder, settings }
    }

    fn open(&self) -> Grbl {
        let until = Instant::now() + PATIENCE;
        loop {
            match Grbl::open(self.settings.clone()) {
                Ok(grbl) => return grbl,
                Err(e) => assert!(Instant::now() < until, "{e}"),
            }
        }
    }

    fn referenced(&self) -> Grbl {
        let mut grbl = self.open();
        grbl.reference(&CancelToken::new()).unwrap();
        grbl
    }

    /// True steps from the reference switch. Homing leaves the axis one pull-off of 0.05 units before it.
    fn true_steps(&self) -> f64 {
        self.rig.shaft().angle_rad() / TAU * STEPS + 5.0
    }

    fn stands_at(&self, steps: Steps) {
        let found = self.true_steps();
        assert!((found - steps.0 as f64).abs() < 1e-6, "the shaft stands at {found}, the driver says {steps}");
    }

    /// After any fault a reference finds the axis again, and the axis then reaches its target.
    fn is_cured_by_a_reference(&self, grbl: &mut Grbl) {
        grbl.reference(&CancelToken::new()).unwrap();
        grbl.move_to(TARGET).unwrap();
        self.stands_at(TARGET);
    }
}

fn reference_and_move(grbl: &mut Grbl) -> Result<(), DeviceError> {
    grbl.reference(&CancelToken::new())?;
    grbl.move_to(TARGET).map(|_| ())
}

#[test]
fn a_turn_at_a_constant_speed_is_where_its_time_says() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let bench = Bench::with(1.0, controller);
        let mut grbl = bench.referenced();
        turns_evenly(&mut grbl, 180.0, 400, || bench.true_steps());
        grbl.move_to(TARGET).unwrap();
        bench.stands_at(TARGET);
    }
}

/// After a failed reference the position is unknown, after a failed move it is suspect. In both cases nothing moves.
fn refuses_to_move(grbl: &mut Grbl) {
    assert!(matches!(grbl.position(), Position::Unknown | Position::Suspect { .. }), "{:?}", grbl.position());
    assert!(grbl.move_to(Steps(48)).is_err());
}

/// Runs `case` for every byte of a reference and a move until it returns false, behind the last byte. Returns the number of bytes. A lost answer
/// is waited for during `answer_timeout_ms`. A busy computer may pause for some 300 ms.
fn for_each_byte(answer_timeout_ms: u32, case: impl Fn(&Bench, usize) -> bool + Sync) -> usize {
    let case = &case;
    std::thread::scope(|scope| {
        let rigs: Vec<_> = (0..RIGS)
            .map(|first| {
                scope.spawn(move || {
                    let mut bench = Bench::new(1000.0);
                    bench.settings.answer_timeout_ms = answer_timeout_ms;
                    (first..).step_by(RIGS).take_while(|offset| case(&bench, *offset)).count()
                })
            })
            .collect();
        rigs.into_iter().map(|r| r.join().unwrap()).sum()
    })
}

#[test]
fn a_cable_pulled_at_any_byte_is_gone_and_nothing_moves_until_the_next_reference() {
    for (direction, least) in [("to the host", 400), ("to the controller", 40)] {
        let bytes = for_each_byte(2000, |bench, offset| {
            let mut grbl = bench.open();
            match direction {
                "to the host" => bench.rig.faults().serial().unplug_after(offset + 1),
                _ => bench.rig.faults().serial().unplug_after_received(offset + 1),
            }
            let outcome = reference_and_move(&mut grbl);
            let cut = outcome.is_err();
            if let Err(error) = outcome {
                assert!(matches!(error, DeviceError::Gone { .. }), "byte {offset} {direction}: {error}");
                refuses_to_move(&mut grbl);
                drop(grbl);
                bench.rig.faults().replug_serial().unwrap();
            } else {
                bench.stands_at(TARGET);
            }
            cut
        });
        assert!(bytes > least, "{bytes} bytes {direction}");
    }
}

#[test]
fn a_bit_that_changes_in_any_byte_never_gives_a_wrong_place() {
    for direction in ["to the host", "to the controller"] {
        let bytes = for_each_byte(1000, |bench, offset| {
            let mut grbl = bench.open();
            let bits = 1 << (offset * 5 % 8);
            match direction {
                "to the host" => bench.rig.faults().serial().flip_sent(offset, bits),
                _ => bench.rig.faults().serial().flip_received(offset, bits),
            }
            if reference_and_move(&mut grbl).is_ok() {
                bench.stands_at(TARGET);
            } else {
                refuses_to_move(&mut grbl);
            }
            bench.rig.faults().serial().clear_line();
            // One flipped bit turns `1` into `!`, a feed hold.
            bench.press(Button::CycleStart);
            bench.is_cured_by_a_reference(&mut grbl);
            offset < if direction == "to the host" { 900 } else { 50 }
        });
        assert!(bytes >= 50, "{bytes} bytes {direction}");
    }
}

#[test]
fn one_bit_that_makes_homing_an_unlocking_is_noticed() {
    let bench = Bench::new(1000.0);
    let mut grbl = bench.open();
    bench.rig.faults().serial().rewrite_next_received(b"$H", b"$X");
    // The driver repeats the homing.
    bench.is_cured_by_a_reference(&mut grbl);
}

#[test]
fn a_position_with_a_wrong_digit_is_not_believed() {
    let bench = Bench::new(1000.0);
    let mut grbl = bench.referenced();
    // After the move the position is 0.240 - 0.050 units.
    bench.rig.faults().serial().rewrite_next(b"MPos:0.190", b"MPos:4.190");
    assert_eq!(grbl.move_to(TARGET).unwrap().steps, TARGET);
    bench.stands_at(TARGET);
    // A wrong digit in the target moves the axis to a wrong place.
    bench.rig.faults().serial().rewrite_next_received(b"X0.430F", b"X0.470F");
    let error = grbl.move_to(Steps(48)).unwrap_err();
    assert!(matches!(error, DeviceError::Missed { target: Steps(48), achieved: Steps(52) }), "{error}");
    refuses_to_move(&mut grbl);
    bench.is_cured_by_a_reference(&mut grbl);
}

#[test]
fn an_answer_that_comes_after_its_time_is_not_the_answer_to_something_else() {
    let mut bench = Bench::new(1000.0);
    bench.settings.answer_timeout_ms = 200;
    let mut grbl = bench.referenced();
    // Later than the time for three requests of a report.
    bench.rig.faults().serial().delay_answers(Duration::from_millis(900));
    let error = grbl.move_to(TARGET).unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    refuses_to_move(&mut grbl);
    // Each line end is answered by an `ok`, which arrives late, during the reference.
    bench.rig.faults().serial_noise(b"\n\n\n");
    bench.rig.faults().serial().delay_answers(Duration::ZERO);
    bench.is_cured_by_a_reference(&mut grbl);
}

#[test]
fn a_lost_answer_is_asked_for_again_and_a_silent_controller_is_not_waited_for() {
    let mut bench = Bench::new(1000.0);
    bench.settings.answer_timeout_ms = 600;
    let mut grbl = bench.referenced();
    let serial = bench.rig.faults();
    for target in [TARGET, Steps(48), Steps(0)] {
        serial.serial().drop_oks(1);
        assert_eq!(grbl.move_to(target).unwrap().epoch, 1);
        bench.stands_at(target);
        serial.serial().drop_answers(1);
        assert_eq!(grbl.move_to(target).unwrap().epoch, 1);
    }
    serial.serial().drop_answers(3);
    let error = grbl.move_to(TARGET).unwrap_err();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    refuses_to_move(&mut grbl);
    bench.is_cured_by_a_reference(&mut grbl);
}

#[test]
fn stray_bytes_and_split_and_merged_lines_do_no_harm() {
    let mut bench = Bench::new(1000.0);
    bench.settings.answer_timeout_ms = 600;
    let serial = bench.rig.faults();
    let serial = serial.serial();
    let mut grbl = bench.referenced();
    serial.split_answers(true);
    bench.is_cured_by_a_reference(&mut grbl);
    serial.split_answers(false);
    for noise in [&b"\xff"[..], b"\0\0", b"#%\r\n", b"ok", b"<Idle|MPos:9"] {
        serial.stray_to_host(noise);
        if grbl.move_to(Steps(48)).is_ok() {
            bench.stands_at(Steps(48));
        }
        bench.is_cured_by_a_reference(&mut grbl);
    }
    for noise in [&b"\xff"[..], b"\0", b"Q", b"9", b"\n", b"!", b"~", b"\x85"] {
        serial.stray_to_controller(noise);
        if grbl.move_to(Steps(48)).is_ok() {
            bench.stands_at(Steps(48));
        } else {
            refuses_to_move(&mut grbl);
        }
        // A stray `!` is a feed hold.
        bench.press(Button::CycleStart);
        bench.is_cured_by_a_reference(&mut grbl);
    }
    for line in [&b"$100=100.000\r\n"[..], b"help]\r\n", b"ok\r\n", b">\r\n"] {
        serial.rewrite_next(line, &line[..line.len() - 2]);
        if reference_and_move(&mut grbl).is_ok() {
            bench.stands_at(TARGET);
        }
        bench.is_cured_by_a_reference(&mut grbl);
    }
}

/// A move of hundreds of turns. `meanwhile` runs during it.
fn disturbed_move(bench: &Bench, grbl: &mut Grbl, meanwhile: impl FnOnce()) -> DeviceError {
    let from = bench.true_steps();
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| grbl.move_to(Steps(500_000)));
        let until = Instant::now() + PATIENCE;
        while bench.true_steps() - from < 50.0 {
            assert!(Instant::now() < until, "the shaft never moved");
            std::thread::yield_now();
        }
        meanwhile();
        moving.join().unwrap().unwrap_err()
    })
}

#[test]
fn a_restart_in_the_middle_of_a_move_is_a_persons_with_and_without_an_alarm() {
    let mut without_lock = Settings::default();
    without_lock.set(22, 0.0).unwrap();
    for (name, controller) in [
        ("locked, after a power cut", Controller::default()),
        ("silent, after a power cut", Controller::Grbl(without_lock)),
        ("with an alarm, by a reset", Controller::default()),
        ("grblHAL, with an alarm, by a reset", Controller::GrblHal(Settings::default())),
    ] {
        let mut bench = Bench::with(20.0, controller);
        if name.starts_with("silent") {
            bench.settings.reference = Reference::Here;
        }
        let mut grbl = bench.referenced();
        let epoch = 1;
        let error = disturbed_move(&bench, &mut grbl, || {
            if name.ends_with("by a reset") { bench.rig.faults().serial_noise(b"\x18") } else { bench.rig.faults().reboot_controller() }
        });
        assert!(is_a_persons_reset(&error), "{name}: {error}");
        grbl.check().unwrap();
        assert_eq!(grbl.position(), Position::Suspect { epoch: epoch + 1 }, "{name}");
        refuses_to_move(&mut grbl);
        assert_eq!(grbl.reference(&CancelToken::new()).unwrap().epoch, epoch + 2, "{name}");
    }
}

fn is_a_persons_reset(error: &DeviceError) -> bool {
    matches!(error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved"))
}

/// Inches, relative positions, and a tenth of the speed: at that one the move of nine turns takes longer than it is waited for.
#[test]
fn what_another_program_left_in_force_changes_no_move() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let bench = Bench::with(4.0, controller);
        let mut grbl = bench.referenced();
        bench.rig.faults().serial_noise(b"G20G91\n\x92\x92\x92\x92\x92\x92\x92\x92\x92");
        for target in [Steps(4500), TARGET] {
            assert_eq!(grbl.move_to(target).unwrap().steps, target);
            bench.stands_at(target);
        }
    }
}

/// By the reset button, by a power cut, and by another program.
#[test]
fn a_reset_at_rest_is_a_persons_and_reported_once() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let bench = Bench::with(20.0, controller);
        let mut grbl = bench.referenced();
        for by_program in [false, true] {
            let reset = || if by_program { bench.rig.faults().serial_noise(b"\x18") } else { bench.rig.faults().reboot_controller() };
            reset();
            let until = Instant::now() + PATIENCE;
            let error = loop {
                match grbl.check() {
                    Ok(()) => assert!(Instant::now() < until, "the reset is not seen"),
                    Err(error) => break error,
                }
            };
            assert!(is_a_persons_reset(&error), "{error}");
            refuses_to_move(&mut grbl);
            grbl.check().unwrap();
            bench.is_cured_by_a_reference(&mut grbl);
            // Nobody has looked before the next specimen is begun.
            let stands = bench.true_steps();
            reset();
            let error = grbl.reference(&CancelToken::new()).unwrap_err();
            assert!(is_a_persons_reset(&error), "{error}");
            assert!((bench.true_steps() - stands).abs() < 1e-9, "it moved");
            bench.is_cured_by_a_reference(&mut grbl);
        }
    }
}

#[test]
fn an_erased_settings_memory_is_named_with_every_difference_and_nothing_moves() {
    let bench = Bench::new(20.0);
    let mut grbl = bench.referenced();
    bench.rig.faults().serial().erase_memory();
    disturbed_move(&bench, &mut grbl, || bench.rig.faults().reboot_controller());
    let stands = bench.true_steps();
    for _ in 0..2 {
        let error = grbl.reference(&CancelToken::new()).unwrap_err();
        let said = error.to_string();
        let DeviceError::Mismatch { differences, .. } = error else { panic!("{said}") };
        let steps = differences.iter().find(|d| d.name.starts_with("$100")).unwrap();
        assert_eq!((steps.configured.as_str(), steps.found.as_str()), ("100.000", "250"));
        for part in ["$22", "$120"] {
            assert!(said.contains(part), "{part} is missing: {said}");
        }
    }
    refuses_to_move(&mut grbl);
    assert!((bench.true_steps() - stands).abs() < 1e-9, "nothing moved");
}

#[test]
fn a_memory_found_erased_when_the_port_is_opened_is_said_to_be_erased() {
    let bench = Bench::new(1000.0);
    // The controller has begun to run. Otherwise it may find its memory erased before anybody can hear it, which it says only once.
    drop(bench.open());
    bench.rig.faults().serial().erase_memory();
    let said = Grbl::open(bench.settings.clone()).err().unwrap().to_string();
    assert!(said.contains("error:7") && said.contains("$100") && said.contains("250"), "{said}");
}

#[test]
fn the_receive_buffer_never_runs_over() {
    let bench = Bench::new(1000.0);
    let mut grbl = bench.referenced();
    let plan = RevolutionPlan::new(84, StepsPerRevolution::new(500, 1).unwrap(), ViewOrder::Sequential).unwrap();
    for stop in plan.stops() {
        assert_eq!(grbl.move_to(stop.target).unwrap().steps, stop.target);
        bench.stands_at(stop.target);
    }
    assert_eq!(bench.rig.faults().serial().lost_bytes(), 0);
    // This line overruns the buffer on purpose: the bytes behind a line that is still executed are counted as lost.
    let dwell = [&b"G4P1000\n"[..], &[b' '; 200]].concat();
    bench.rig.faults().serial_noise(&dwell);
    let until = Instant::now() + PATIENCE;
    while bench.rig.faults().serial().lost_bytes() == 0 {
        assert!(Instant::now() < until, "the counter counts nothing");
        std::thread::yield_now();
    }
}

#[test]
fn a_hard_limit_is_named_and_its_deaf_controller_is_woken_by_the_next_reference() {
    let mut limited = Settings::default();
    limited.set(21, 1.0).unwrap();
    let mut bench = Bench::with(20.0, Controller::Grbl(limited));
    bench.settings.reference = Reference::Here;
    let mut grbl = bench.referenced();
    // The switch trips within one revolution of the power-on position.
    let error = grbl.move_to(Steps(1000)).unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.contains("ALARM:1")), "{error}");
    refuses_to_move(&mut grbl);
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap().epoch, 3);
    grbl.move_to(Steps(-100)).unwrap();

    // The switch trips while no command waits for an answer. The controller then answers neither `?` nor `$X`.
    bench.rig.faults().serial_noise(b"G91G1X5F500\n");
    let until = Instant::now() + PATIENCE;
    let mut before = f64::NAN;
    while before.to_bits() != bench.true_steps().to_bits() {
        assert!(Instant::now() < until, "the shaft never stops");
        before = bench.true_steps();
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(grbl.move_to(Steps(0)).is_err());
    refuses_to_move(&mut grbl);
    grbl.reference(&CancelToken::new()).unwrap();
    grbl.move_to(Steps(-100)).unwrap();
}

#[test]
fn a_reference_after_three_thousand_turns_begins_near_the_controllers_zero_again() {
    let mut bench = Bench::new(1e6);
    bench.settings.reference = Reference::Here;
    let mut grbl = bench.referenced();
    let start = bench.true_steps();
    let far = 3000 * 500 * 4;
    grbl.move_to(Steps(far)).unwrap();
    assert!((bench.true_steps() - start - far as f64).abs() < 1e-3);
    grbl.reference(&CancelToken::new()).unwrap();
    assert!((bench.true_steps() - start).abs() < 1e-3, "it has unwound");
    for view in 1..=84 {
        let target = Steps(view * 500 / 84);
        grbl.move_to(target).unwrap();
        assert!((bench.true_steps() - start - target.0 as f64).abs() < 1e-3, "view {view}");
    }
}

#[test]
fn an_error_that_grblhal_would_repeat_for_ever_is_cleared_before_the_next_line() {
    let bench = Bench::with(1000.0, Controller::GrblHal(Settings::default()));
    let mut grbl = bench.referenced();
    assert!(grbl.identity().contains("GrblHAL 1.1f"), "{}", grbl.identity());
    for target in [TARGET, Steps(48), Steps(500)] {
        // Noise on the line that the controller reads as a command.
        bench.rig.faults().serial_noise(b"G1Q3\n");
        assert_eq!(grbl.move_to(target).unwrap().steps, target);
        bench.stands_at(target);
    }
}

#[test]
fn grblhal_that_did_not_home_is_homed_once_more() {
    let bench = Bench::with(1000.0, Controller::GrblHal(Settings::default()));
    let mut grbl = bench.open();
    bench.rig.faults().serial().rewrite_next_received(b"$H", b"$X");
    // The driver repeats the homing.
    bench.is_cured_by_a_reference(&mut grbl);
}

/// After an intervention the axis stands, and no command of carved moves it.
fn is_left_alone(bench: &Bench, grbl: &mut Grbl, reads: &str) {
    let stands = bench.settled();
    // The daemon does this when a fault ends a run.
    grbl.stop_handle().end_motion();
    for _ in 0..2 {
        let found = [grbl.reference(&CancelToken::new()).unwrap_err(), grbl.check().unwrap_err()];
        for error in found {
            assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(reads)), "{error}");
        }
    }
    refuses_to_move(grbl);
    assert!((bench.true_steps() - stands).abs() < 1e-9, "{reads}: it moved");
    assert!(!bench.rig.shaft().is_turning());
}

impl Bench {
    /// The position at which the shaft comes to rest.
    fn settled(&self) -> f64 {
        let until = Instant::now() + PATIENCE;
        let mut before = f64::NAN;
        while before.to_bits() != self.true_steps().to_bits() {
            assert!(Instant::now() < until, "the shaft never stops");
            before = self.true_steps();
            std::thread::sleep(Duration::from_millis(20));
        }
        before
    }

    fn press(&self, button: Button) {
        self.rig.faults().button(button, true);
        self.rig.faults().button(button, false);
    }
}

#[test]
fn a_feed_hold_in_mid_move_is_a_persons_and_waits_for_one() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let mut bench = Bench::with(4.0, controller);
        bench.settings.answer_timeout_ms = 300;
        let mut grbl = bench.referenced();
        let error = held_move(&bench, &mut grbl, || bench.press(Button::FeedHold));
        assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("feed hold")), "{error}");
        assert_eq!(grbl.position(), Position::Suspect { epoch: 2 });
        is_left_alone(&bench, &mut grbl, "feed hold");
        bench.press(Button::CycleStart);
        bench.is_cured_by_a_reference(&mut grbl);
        grbl.check().unwrap();
    }
}

#[test]
fn an_open_door_in_mid_move_waits_until_it_is_closed_and_cycle_start_is_pressed() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let mut bench = Bench::with(4.0, controller);
        bench.settings.answer_timeout_ms = 300;
        let mut grbl = bench.referenced();
        let error = held_move(&bench, &mut grbl, || bench.rig.faults().button(Button::Door, true));
        assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("door")), "{error}");
        is_left_alone(&bench, &mut grbl, "door is open");
        bench.rig.faults().button(Button::Door, false);
        is_left_alone(&bench, &mut grbl, "door was open");
        bench.press(Button::CycleStart);
        bench.is_cured_by_a_reference(&mut grbl);
    }
}

#[test]
fn an_emergency_stop_at_the_controller_waits_until_it_is_released() {
    for (controller, reads) in [(Controller::GrblHal(Settings::default()), "emergency stop"), (Controller::default(), "reset input")] {
        let bench = Bench::with(20.0, controller);
        let mut grbl = bench.referenced();
        let error = disturbed_move(&bench, &mut grbl, || bench.rig.faults().button(Button::EmergencyStop, true));
        assert!(matches!(error, DeviceError::Intervention { .. } | DeviceError::Alarm { .. }), "{error}");
        is_left_alone(&bench, &mut grbl, reads);
        bench.rig.faults().button(Button::EmergencyStop, false);
        bench.is_cured_by_a_reference(&mut grbl);
    }
}

#[test]
fn whatever_a_hand_does_between_two_moves_stops_the_next_and_is_seen_at_rest() {
    for (name, reads, begin, end) in [
        ("hold", "feed hold", &b"!"[..], &b"~"[..]),
        ("jog", "jogged", b"$J=G91X9F10\n", b"\x85"),
        ("check mode", "check mode", b"$C\n", b"$C\n"),
        ("sleep", "sleep", b"$SLP\n", b"\x18"),
    ] {
        let bench = Bench::new(20.0);
        let mut grbl = bench.referenced();
        bench.rig.faults().serial_noise(begin);
        let until = Instant::now() + PATIENCE;
        let error = loop {
            match grbl.check() {
                Ok(()) => assert!(Instant::now() < until, "{name} is not seen"),
                Err(error) => break error,
            }
        };
        assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(reads)), "{name}: {error}");
        let stands = bench.true_steps();
        let error = grbl.reference(&CancelToken::new()).unwrap_err();
        assert!(matches!(error, DeviceError::Intervention { .. }), "{name}: {error}");
        refuses_to_move(&mut grbl);
        assert!(name == "jog" || (bench.true_steps() - stands).abs() < 1e-9, "{name}: it moved");
        bench.rig.faults().serial_noise(end);
        bench.settled();
        bench.is_cured_by_a_reference(&mut grbl);
    }
}

#[test]
fn a_door_that_is_open_when_the_port_is_opened_is_reported_and_the_controller_left_alone() {
    let mut without_lock = Settings::default();
    without_lock.set(22, 0.0).unwrap();
    let mut bench = Bench::with(20.0, Controller::Grbl(without_lock));
    bench.settings.reference = Reference::Here;
    bench.rig.faults().button(Button::Door, true);
    let mut grbl = Grbl::open(bench.settings.clone()).unwrap();
    assert_eq!(grbl.position(), Position::Unknown);
    is_left_alone(&bench, &mut grbl, "door is open");
    bench.rig.faults().button(Button::Door, false);
    bench.press(Button::CycleStart);
    let zero = bench.true_steps();
    reference_and_move(&mut grbl).unwrap();
    let turned = bench.true_steps() - zero;
    assert!((turned - TARGET.0 as f64).abs() < 1e-6, "the shaft turned by {turned} of {TARGET} steps");
    assert!(grbl.identity().starts_with("Grbl 1.1"), "{}", grbl.identity());
}

#[test]
fn a_door_that_opens_during_homing_is_no_failed_homing() {
    let mut bench = Bench::with(1.0, Controller::default());
    bench.settings.homing_timeout_ms = 60_000;
    let mut grbl = bench.open();
    let error = std::thread::scope(|scope| {
        let homing = scope.spawn(|| grbl.reference(&CancelToken::new()));
        let until = Instant::now() + PATIENCE;
        while !bench.rig.shaft().is_turning() {
            assert!(Instant::now() < until, "the shaft never moved");
            std::thread::yield_now();
        }
        bench.rig.faults().button(Button::Door, true);
        homing.join().unwrap().unwrap_err()
    });
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("door")), "{error}");
    is_left_alone(&bench, &mut grbl, "door");
}

/// A move of eight turns that a person holds up. The driver waits for as long as it would take in real time, and reports that it did not
/// arrive.
fn held_move(bench: &Bench, grbl: &mut Grbl, hold: impl FnOnce()) -> DeviceError {
    let from = bench.true_steps();
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| grbl.move_to(Steps(4000)));
        let until = Instant::now() + PATIENCE;
        while bench.true_steps() - from < 50.0 {
            assert!(Instant::now() < until, "the shaft never moved");
            std::thread::yield_now();
        }
        hold();
        moving.join().unwrap().unwrap_err()
    })
}

/// One wrong character in any answer of a turn: the driver asks again, and the turn continues.
#[test]
fn a_character_that_changes_in_any_answer_of_a_turn_costs_neither_a_view_nor_an_epoch() {
    let bytes = for_each_byte(1000, |bench, offset| {
        let mut grbl = bench.referenced();
        let epoch = |grbl: &Grbl| match grbl.position() {
            Position::Referenced { epoch, .. } => epoch,
            other => panic!("byte {offset}: {other:?}"),
        };
        let before = epoch(&grbl);
        bench.rig.faults().serial().flip_sent(offset, 1 << (offset % 7));
        for target in [TARGET, Steps(48), Steps(0)] {
            let achieved = grbl.move_to(target).unwrap_or_else(|e| panic!("byte {offset}, to {target}: {e}"));
            assert_eq!(achieved.steps, target);
            bench.stands_at(target);
        }
        assert_eq!(epoch(&grbl), before);
        bench.rig.faults().serial().clear_line();
        offset < 330
    });
    assert!(bytes >= 330, "{bytes}");
}

#[test]
fn a_restart_whose_greeting_is_garbled_is_still_one() {
    // At 0 the controller restarts with the position that the driver expects: only its greeting shows the restart.
    let mut without_lock = Settings::default();
    without_lock.set(22, 0.0).unwrap();
    let mut bench = Bench::with(20.0, Controller::Grbl(without_lock));
    bench.settings.reference = Reference::Here;
    bench.settings.answer_timeout_ms = 300;
    for (from, to) in [(&b"Grbl"[..], &b"Grjl"[..]), (b"for help]", b"for hulp]")] {
        let mut grbl = bench.referenced();
        bench.rig.faults().serial().rewrite_next(from, to);
        let error = disturbed_move(&bench, &mut grbl, || bench.rig.faults().reboot_controller());
        assert!(is_a_persons_reset(&error), "{error}");
    }
}

#[test]
fn motors_that_are_switched_off_between_moves_are_refused() {
    for (controller, steppers) in
        [(Controller::Grbl as fn(Settings) -> Controller, false), (Controller::GrblHal as fn(Settings) -> Controller, true)]
    {
        let mut idle = Settings::default();
        idle.set(1, 25.0).unwrap();
        let bench = Bench::with(1000.0, controller(idle.clone()));
        let said = Grbl::open(bench.settings.clone()).err().unwrap().to_string();
        assert!(said.contains("$1 ") && said.contains("255") && said.contains("found 25"), "{said}");
        if steppers {
            // grblHAL can keep single motors powered: bit 0 is X.
            idle.set(37, 1.0).unwrap();
            Bench::with(1000.0, controller(idle)).open();
        }
    }
}

/// A person presses feed hold while the axis stands. Before the controller is asked again another fault ends the run. The reset of that
/// stop must not end the hold.
#[test]
fn a_hold_at_rest_outlasts_the_programs_stop_and_not_a_persons() {
    for controller in [Controller::default(), Controller::GrblHal(Settings::default())] {
        let mut bench = Bench::with(20.0, controller);
        bench.settings.answer_timeout_ms = 300;
        let mut grbl = bench.referenced();
        bench.press(Button::FeedHold);
        is_left_alone(&bench, &mut grbl, "feed hold");
        grbl.stop_handle().stop();
        bench.is_cured_by_a_reference(&mut grbl);
    }
}
