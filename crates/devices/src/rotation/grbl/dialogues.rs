//! Tests with a scripted controller: the exact bytes that the driver sends, and its reaction to each answer.

use super::talk::OWN_GREETING;
use super::*;
use crate::cancel::CancelToken;
use crate::rotation::scripted::Scripted;
use proptest::prelude::*;
use std::collections::BTreeMap;

const GREETING: &str = "\r\nGrbl 1.1h ['$' for help]\r\n";
const VERSION: &str = "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n";
const SETTINGS: &str = "$1=255\r\n$10=1\r\n$13=0\r\n$22=1\r\n$23=0\r\n$27=0.720\r\n$100=1.389\r\n$110=3600.000\r\n$120=200.000\r\nok\r\n";
const RESET: &str = "\x18";

type Step<'a> = (&'a str, String);

fn step<'a>(expected: &'a str, reply: &str) -> Step<'a> {
    (expected, reply.to_owned())
}

fn idle(x: &str) -> String {
    format!("<Idle|MPos:{x},0.000,0.000|FS:0,0>\r\n")
}

/// The look whether somebody else has the controller, and the question whose answer makes earlier ones void.
fn woken() -> Vec<Step<'static>> {
    vec![("?", idle("0.000")), step("$I", VERSION)]
}

/// Until the questions about the settings.
fn opened() -> Vec<Step<'static>> {
    [woken(), vec![step("M5M9", "ok\r\n")]].concat()
}

fn opening() -> Vec<Step<'static>> {
    [opened(), vec![step("$$", SETTINGS)]].concat()
}

/// The same of a controller that an alarm locks, which is reset.
fn woken_from_an_alarm() -> Vec<Step<'static>> {
    vec![step("?", "<Alarm|MPos:0.000,0.000,0.000>\r\n"), step(RESET, GREETING), step("$I", VERSION)]
}

/// Opening and a reference "here" at the controller's position `x`.
fn referenced(x: &str) -> Vec<Step<'static>> {
    let mut steps = opening();
    steps.extend(woken());
    steps.push(step("$$", SETTINGS));
    steps.extend((0..3).map(|_| ("?", idle(x))));
    steps
}

/// The modes of every line that moves.
const MODES: &str = "G21G90G94G53G1";

/// 500 steps per revolution of 360 units: view 1 of 21 is step 24, 17.28 units.
const MOVE_24: &str = "G21G90G94G53G1X17.280F3600.000";

fn settings(port: &str) -> GrblSettings {
    GrblSettings {
        port: port.into(),
        baud: 115_200,
        axis: AxisLetter::X,
        steps_per_unit: [500, 360],
        max_rate_units_per_min: 3600.0,
        acceleration_units_per_s2: 200.0,
        reference: Reference::Here,
        dialect: Dialect::Auto,
        answer_timeout_ms: 400,
        homing_timeout_ms: 400,
        outputs: BTreeMap::new(),
    }
}

/// A controller that knows only its script. At the end of the script it hangs up.
fn play(script: Vec<Step<'static>>) -> Scripted {
    let is_real_time = |expected: &str| ["?", "!", RESET, "\u{87}"].contains(&expected);
    let sent = |expected: &str| match expected.chars().next() {
        Some(byte) if is_real_time(expected) => vec![byte as u8],
        _ if expected.as_bytes() == STOP => STOP.to_vec(),
        // Whatever moves, moves at full speed.
        _ if expected.starts_with(MODES) => [FULL_FEED, expected.as_bytes(), b"\n"].concat(),
        _ => format!("{expected}\n").into_bytes(),
    };
    Scripted::play(script.into_iter().map(|(expected, reply)| (sent(expected), reply.into_bytes())).collect())
}

fn open(controller: &Scripted) -> Result<Grbl, DeviceError> {
    Grbl::open(settings(&controller.port()))
}

/// Plays a move to step 24 that goes wrong after `script`, and returns the error and what is then known.
fn failed_move(script: Vec<Step<'static>>) -> (DeviceError, Position) {
    let mut steps = referenced("0.000");
    steps.extend(script);
    let controller = play(steps);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    let error = grbl.move_to(Steps(24)).unwrap_err();
    let known = grbl.position();
    assert!(grbl.move_to(Steps(24)).is_err(), "a suspect axis refuses to move");
    controller.followed(grbl);
    (error, known)
}

fn move_begins() -> Vec<Step<'static>> {
    vec![("?", idle("0.000")), step(MOVE_24, "ok\r\n")]
}

fn halted() -> Vec<Step<'static>> {
    vec![step("!", ""), step(RESET, "")]
}

#[test]
fn a_move_is_stated_absolutely_awaited_by_the_barrier_and_read_back() {
    let mut script = referenced("0.000");
    script.extend(move_begins());
    script.push(step("G4P0", "ok\r\n"));
    script.push(("?", idle("17.280")));
    script.push(("?", idle("17.280")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    assert_eq!(grbl.position(), Position::Unknown);
    assert!(matches!(grbl.move_to(Steps(24)), Err(DeviceError::NotReferenced)));
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
    assert_eq!(grbl.move_to(Steps(24)).unwrap(), Achieved { steps: Steps(24), epoch: 1 });
    assert_eq!(grbl.move_to(Steps(24)).unwrap().steps, Steps(24), "no way to go, but the place is looked at");
    assert!(grbl.identity().starts_with("Grbl 1.1h [VER:1.1h.20190830:]"), "{}", grbl.identity());
    controller.followed(grbl);
}

#[test]
fn step_0_is_where_the_reference_was_taken() {
    // Machine step 100 is 72 units; 24 steps further is machine step 124, 89.28 units.
    let mut script = referenced("72.000");
    script.push(("?", idle("72.000")));
    script.push(step("G21G90G94G53G1X89.280F3600.000", "ok\r\n"));
    script.push(step("G4P0", "ok\r\n"));
    script.push(("?", idle("89.280")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.move_to(Steps(24)).unwrap().steps, Steps(24));
    controller.followed(grbl);
}

#[test]
fn homing_takes_the_reported_place_as_step_0_and_raises_the_epoch() {
    let mut script = opening();
    for stands_at in ["0.000", "-0.720"] {
        script.extend([("?", idle(stands_at)), step("$I", VERSION)]);
        script.extend([step("$$", SETTINGS), step("$H", "ok\r\n")]);
        script.extend((0..2).map(|_| ("?", idle("-0.720"))));
    }
    let controller = play(script);
    let mut grbl = Grbl::open(GrblSettings { reference: Reference::Home, ..settings(&controller.port()) }).unwrap();
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap().epoch, 1);
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 2 });
    controller.followed(grbl);
}

#[test]
fn an_alarm_is_unlocked_only_by_a_reference() {
    let mut script = opening();
    script.extend(woken_from_an_alarm());
    script.extend([step("$$", SETTINGS), step("?", "<Alarm|MPos:0.000,0.000,0.000>\r\n")]);
    script.push(step("$X", "[MSG:Caution: Unlocked]\r\nok\r\n"));
    script.extend((0..2).map(|_| ("?", idle("0.000"))));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    controller.followed(grbl);
}

#[test]
fn a_restart_in_the_middle_of_a_move_is_a_persons_with_and_without_an_alarm() {
    for says in [GREETING.to_owned(), format!("ALARM:3\r\n{GREETING}")] {
        let mut script = move_begins();
        script.push(("G4P0", says));
        let (error, known) = failed_move(script);
        assert!(is_a_persons_reset(&error), "{error}");
        assert_eq!(known, Position::Suspect { epoch: 2 });
    }
}

fn is_a_persons_reset(error: &DeviceError) -> bool {
    matches!(error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved"))
}

/// The greeting has come, or comes with the next report.
#[test]
fn a_reset_at_rest_is_reported_once_by_whatever_asks_next() {
    type Ask = fn(&mut Grbl) -> Result<(), DeviceError>;
    let cancel = CancelToken::new;
    let asks: [(&str, Ask); 4] = [
        ("a check", |grbl| grbl.check()),
        ("a reference", |grbl| grbl.reference(&CancelToken::new()).map(drop)),
        ("the wait for a specimen", |grbl| crate::SpecimenInput::begin(grbl, &CancelToken::new())),
        ("a move", |grbl| grbl.move_to(Steps(0)).map(drop)),
    ];
    for (name, ask) in asks {
        let mut script = referenced("0.000");
        script.push(("?", GREETING.to_owned() + &idle("0.000")));
        // Told: the next check finds nothing, and the next reference finds the position.
        script.push(("?", idle("0.000")));
        script.extend(woken());
        script.push(step("$$", SETTINGS));
        script.extend((0..3).map(|_| ("?", idle("0.000"))));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        grbl.reference(&cancel()).unwrap();
        let error = ask(&mut grbl).unwrap_err();
        assert!(is_a_persons_reset(&error), "{name}: {error}");
        assert_eq!(grbl.position(), Position::Suspect { epoch: 2 }, "{name}");
        grbl.check().unwrap();
        assert_eq!(grbl.reference(&cancel()).unwrap().epoch, 3, "{name}");
        controller.followed(grbl);
    }
}

/// Nothing can be reported where the sampler's wire is read between runs.
#[test]
fn a_reset_that_is_seen_while_the_wire_is_read_is_reported_by_the_next_check() {
    let mut script = referenced("0.000");
    script.push(("?", GREETING.to_owned() + &idle("0.000")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert!(crate::SpecimenInput::is_active_at_rest(&mut grbl).is_err());
    let error = grbl.check().unwrap_err();
    assert!(is_a_persons_reset(&error), "{error}");
    controller.followed(grbl);
}

/// A stop at rest resets the controller. Its greeting comes before the next report, or after it.
#[test]
fn the_greeting_of_a_stop_of_carved_is_no_intervention() {
    for (at_once, later) in [(GREETING, ""), ("", GREETING)] {
        let mut script = referenced("0.000");
        script.extend([step("!", ""), step(RESET, at_once), ("?", idle("0.000") + later), ("?", idle("0.000"))]);
        script.extend(woken());
        script.push(step("$$", SETTINGS));
        script.extend((0..3).map(|_| ("?", idle("0.000"))));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        grbl.reference(&CancelToken::new()).unwrap();
        grbl.stop_handle().stop();
        grbl.check().unwrap();
        grbl.check().unwrap();
        grbl.reference(&CancelToken::new()).unwrap();
        controller.followed(grbl);
    }
}

#[test]
fn a_reset_that_is_answered_late_greets_again_and_that_is_no_restart() {
    // The answer to the question was lost in that reset, or follows upon the greeting.
    for rest in ["", SETTINGS] {
        let mut opened = woken_from_an_alarm();
        opened.extend([step("$$", SETTINGS), ("?", idle("0.000"))]);
        opened.insert(2, step("$I", GREETING));
        let mut script = [opened, vec![step("$I", VERSION)]].concat();
        script.push(("$$", format!("{GREETING}{rest}")));
        script.push(step("$$", SETTINGS));
        script.extend((0..3).map(|_| ("?", idle("0.000"))));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        assert_eq!(grbl.reference(&CancelToken::new()).unwrap().epoch, 1);
        controller.followed(grbl);
    }
}

#[test]
fn a_restart_between_moves_is_noticed_by_its_greeting_or_by_its_place() {
    let mut at_24 = referenced("0.000");
    at_24.extend(move_begins());
    at_24.push(step("G4P0", "ok\r\n"));
    for greets in [true, false] {
        let mut script = at_24.clone();
        script.push(("?", if greets { idle("17.280") + GREETING } else { idle("17.280") }));
        if !greets {
            // The greeting was lost with the cable; the controller counts from 0 again.
            script.extend([("?", idle("0.000")), ("?", idle("0.000"))]);
        }
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        grbl.reference(&CancelToken::new()).unwrap();
        grbl.move_to(Steps(24)).unwrap();
        if greets {
            controller.await_step(at_24.len());
        }
        let error = grbl.move_to(Steps(48)).unwrap_err();
        match error {
            DeviceError::Intervention { what, .. } => assert_eq!(what.contains("left at 17.280"), !greets, "{what}"),
            other => panic!("{other}"),
        }
        assert_eq!(grbl.position(), Position::Suspect { epoch: 2 });
        controller.followed(grbl);
    }
}

/// The controller rests at another place than where it was left, so a person or another program was at work. Nothing was received of it.
#[test]
fn a_place_that_changed_at_rest_is_an_intervention_before_a_move_and_before_a_reference() {
    type Ask = fn(&mut Grbl) -> Result<(), DeviceError>;
    let asks: [(&str, Ask); 2] =
        [("a move", |grbl| grbl.move_to(Steps(48)).map(drop)), ("a reference", |grbl| grbl.reference(&CancelToken::new()).map(drop))];
    let alarm = "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n".to_owned();
    let cases =
        [(idle("0.000"), "reset, but not by carved"), (idle("18.720"), "moved, but not by carved"), (alarm, "reset, but not by carved")];
    for ((name, ask), (report, says)) in asks.iter().flat_map(|ask| cases.iter().map(move |case| (ask, case))) {
        let mut script = referenced("0.000");
        script.extend(move_begins());
        script.push(step("G4P0", "ok\r\n"));
        script.push(("?", idle("17.280")));
        script.extend([("?", report.clone()), ("?", report.clone())]);
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        grbl.reference(&CancelToken::new()).unwrap();
        grbl.move_to(Steps(24)).unwrap();
        let error = ask(&mut grbl).unwrap_err();
        assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(says)), "{name}, {report}: {error}");
        assert_eq!(grbl.position(), Position::Suspect { epoch: 2 }, "{name}");
        controller.followed(grbl);
    }
}

#[test]
fn a_late_ok_is_never_taken_for_the_answer_to_something_else() {
    let mut script = move_begins();
    script.push(step("G4P0", ""));
    // Nor is any of the reports answered that ask what became of it.
    script.extend((0..3).map(|_| step("?", "")));
    // The answer to the barrier comes only after the driver has given up and halted.
    script.extend([step("!", ""), step(RESET, "ok\r\n")]);
    // The next reference must not take that ok for the answer to $$.
    script.extend(woken());
    script.push(step("$$", SETTINGS));
    script.extend((0..3).map(|_| ("?", idle("3.600"))));
    let mut steps = referenced("0.000");
    steps.extend(script);
    let controller = play(steps);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    let error = grbl.move_to(Steps(24)).unwrap_err();
    assert!(matches!(&error, DeviceError::Silent { request, .. } if request == "?"), "{error}");
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 3 });
    controller.followed(grbl);
}

#[test]
fn a_flipped_bit_that_parses_is_asked_again_and_not_believed() {
    let mut script = referenced("0.000");
    script.extend(move_begins());
    script.push(step("G4P0", "ok\r\n"));
    script.extend([("?", idle("1.280")), ("?", idle("17.280"))]);
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.move_to(Steps(24)).unwrap().steps, Steps(24));
    controller.followed(grbl);
}

#[test]
fn a_place_that_is_not_the_target_twice_is_a_miss() {
    let mut script = move_begins();
    script.push(step("G4P0", "ok\r\n"));
    script.extend([("?", idle("16.560")), ("?", idle("16.560"))]);
    script.extend(halted());
    let (error, known) = failed_move(script);
    assert!(matches!(error, DeviceError::Missed { target: Steps(24), achieved: Steps(23) }), "{error}");
    assert_eq!(known, Position::Suspect { epoch: 2 });
}

#[test]
fn a_place_between_two_steps_is_no_place() {
    let mut script = move_begins();
    script.push(step("G4P0", "ok\r\n"));
    script.extend([("?", idle("17.600")), ("?", idle("17.600"))]);
    script.extend(halted());
    assert!(matches!(failed_move(script).0, DeviceError::Suspect { .. }));
}

#[test]
fn garbage_around_and_inside_the_answers_is_survived() {
    let mut script = referenced("0.000");
    script.push(("?", "\u{1}\u{fffd}{~\r\n<Idle|MP\r\n".to_owned()));
    script.push(("?", idle("0.000")));
    script.push(step(MOVE_24, "[GC:G0 G54]\r\n#%&\r\nok\r\n"));
    script.push(step("G4P0", "[MSG:'$H'|'$X' to unlock]\r\nok\r\n"));
    script.push(("?", idle("17.280")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.move_to(Steps(24)).unwrap().steps, Steps(24));
    controller.followed(grbl);
}

#[test]
fn an_alarm_in_the_middle_of_a_move_is_named() {
    let mut script = move_begins();
    script.push(step("G4P0", "ALARM:1\r\n[MSG:Reset to continue]\r\n"));
    script.extend(halted());
    let (error, known) = failed_move(script);
    assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.contains("hard limit")), "{error}");
    assert_eq!(known, Position::Suspect { epoch: 2 });
}

#[test]
fn a_refused_line_is_named_with_its_reason() {
    let mut script = vec![("?", idle("0.000")), step(MOVE_24, "error:9\r\n")];
    script.extend(halted());
    let (error, _) = failed_move(script);
    assert!(error.to_string().contains("locked by an alarm"), "{error}");
}

#[test]
fn a_cable_pulled_in_the_middle_of_a_move_is_gone_and_not_waited_for() {
    let mut script = move_begins();
    script.push(step("G4P0", ""));
    let (error, known) = failed_move(script);
    assert!(matches!(error, DeviceError::Gone { .. }), "{error}");
    assert_eq!(known, Position::Suspect { epoch: 2 });
}

#[test]
fn a_stop_reaches_the_wire_while_a_move_waits_and_stays_until_the_reference() {
    let mut script = referenced("0.000");
    script.extend(move_begins());
    script.push(step("G4P0", ""));
    let barrier = script.len() - 1;
    script.extend(halted());
    // The driver's own halt after the failed move, then the reference.
    script.extend(halted());
    script.extend(woken());
    script.push(step("$$", SETTINGS));
    script.extend((0..3).map(|_| ("?", idle("3.600"))));
    let controller = play(script);
    // A deadline of minutes: only the stop can end this move in time.
    let mut grbl = Grbl::open(GrblSettings { answer_timeout_ms: 600_000, ..settings(&controller.port()) }).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    let stop = grbl.stop_handle();
    let mut grbl = std::thread::scope(|scope| {
        let moving = scope.spawn(|| {
            let error = grbl.move_to(Steps(24)).unwrap_err();
            assert!(matches!(error, DeviceError::Stopped), "{error}");
            grbl
        });
        controller.await_step(barrier);
        stop.stop();
        moving.join().unwrap()
    });
    assert!(grbl.move_to(Steps(48)).is_err());
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.position(), Position::Referenced { steps: Steps(0), epoch: 3 });
    controller.followed(grbl);
}

#[test]
fn a_stop_of_a_standing_axis_lets_no_command_follow_it_onto_the_wire() {
    let mut script = referenced("0.000");
    script.extend(halted());
    let last = script.len() - 1;
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    grbl.stop_handle().stop();
    controller.await_step(last);
    assert!(matches!(grbl.link.send(b"G1X1F1\n"), Err(DeviceError::Stopped)));
    assert!(matches!(grbl.move_to(Steps(24)), Err(DeviceError::Stopped)));
    assert_eq!(grbl.position(), Position::Suspect { epoch: 2 });
    controller.followed(grbl);
}

#[test]
fn a_stop_handle_that_outlives_its_axis_holds_no_port_open() {
    let controller = play(opening());
    let grbl = open(&controller).unwrap();
    let stop = grbl.stop_handle();
    drop(grbl);
    stop.stop();
    let again = Link::serial(DEVICE, &controller.port().as_str().into(), 115_200, Stop::of(STOP));
    assert!(again.is_ok(), "the port is free again");
    assert!(Link::serial(DEVICE, &controller.port().as_str().into(), 115_200, Stop::of(STOP)).is_err(), "one owner per port");
}

#[test]
fn every_setting_that_differs_is_named_at_once_by_both_numbers() {
    let other = SETTINGS.replace("1.389", "250.000").replace("3600.000", "500.000").replace("$10=1", "$10=0").replace("$22=1", "$22=0");
    // Asked twice: a disturbed byte is no difference.
    let mut script = opened();
    script.extend((0..2).map(|_| ("$$", other.clone())));
    let controller = play(script);
    let home = GrblSettings { reference: Reference::Home, ..settings(&controller.port()) };
    let said = Grbl::open(home).err().unwrap();
    let DeviceError::Mismatch { differences, .. } = &said else { panic!("{said}") };
    assert_eq!(differences.len(), 4, "{said}");
    for (row, parts) in said.to_string().lines().skip(1).zip([
        ["$10 ", "configured odd", "found 0"],
        ["$22 ", "configured on", "found 0"],
        ["$100 ", "configured 1.389", "found 250"],
        ["$110 ", "configured at least 3600", "found 500"],
    ]) {
        assert!(parts.iter().all(|part| row.contains(part)), "{row}");
    }
}

/// Another program takes every second line of the answer.
#[test]
fn settings_that_are_missing_twice_are_no_wrong_settings() {
    let half = SETTINGS.replace("$1=255\r\n", "").replace("$100=1.389\r\n", "");
    let mut script = opened();
    script.extend((0..2).map(|_| ("$$", half.clone())));
    let controller = play(script);
    let error = open(&controller).err().unwrap();
    let said = error.to_string();
    assert!(matches!(error, DeviceError::Unreadable { .. }), "{said}");
    assert!(
        said.contains("$1 ")
            && said.contains("$100 ")
            && said.contains("other program")
            && !said.contains("cable")
            && !said.contains("$10 "),
        "{said}"
    );
    controller.followed(());
}

/// At another baud rate every byte is another one. Nothing that can be read comes, but something comes.
#[test]
fn bytes_that_cannot_be_read_ask_for_the_baud_rate_and_silence_for_the_cable() {
    for (answer, word, other) in [("\u{1}\u{f}\u{1}x\u{3}", "baud rate", "xit any"), ("", "power and cable", "baud")] {
        let mut script = vec![step("?", answer)];
        script.extend((0..4).flat_map(|_| [step(RESET, answer), step("?", answer)]));
        // It stays connected.
        script.push(step("never", ""));
        let controller = play(script);
        let said = open(&controller).err().unwrap().to_string();
        assert!(said.contains(word) && !said.contains(other), "{said}");
        assert!(answer.is_empty() || said.contains(r"\x01\x0f\x01x\x03"), "{said}");
    }
}

/// The hold is pressed behind any report, however soon. Nothing resets or releases it, at the opening and at a reference.
#[test]
fn a_hold_that_is_pressed_while_the_controller_is_identified_or_referenced_is_kept() {
    let hold = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n";
    let asked_in_a_hold = |at: &str| match at {
        "?" => hold.to_owned(),
        // It is executed at the end of the hold, and answered then.
        "M5M9" | "G21G90G94G53G1X17.280F3600.000" => String::new(),
        _ => "error:8\r\n".to_owned(),
    };
    let all = referenced("0.000");
    for first in 1..all.len() {
        let mut script = all[..first].to_vec();
        script.push((all[first].0, asked_in_a_hold(all[first].0)));
        // An intervention is read twice, by whatever asks, then by a check and a reference.
        let looked = if all[first].0 == "?" { 5 } else { 6 };
        script.extend((0..looked).map(|_| step("?", hold)));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        if first >= opening().len() {
            let error = grbl.reference(&CancelToken::new()).unwrap_err();
            assert!(matches!(error, DeviceError::Intervention { .. }), "{first}: {error}");
        }
        let error = grbl.check().unwrap_err();
        assert!(matches!(error, DeviceError::Intervention { .. }), "{first}: {error}");
        assert!(matches!(grbl.reference(&CancelToken::new()), Err(DeviceError::Intervention { .. })), "{first}");
        controller.followed(grbl);
    }
}

/// The opening of the port reset it after the report. The reset has switched the outputs off, and locked it until it is homed.
#[test]
fn a_controller_that_a_reset_has_locked_since_it_was_idle_is_opened() {
    let controller = play([woken(), vec![step("M5M9", "error:9\r\n"), step("$$", SETTINGS)]].concat());
    let grbl = open(&controller).unwrap();
    controller.followed(grbl);
}

/// The greeting of the reset is lost, and a person presses the hold before the next one.
#[test]
fn a_hold_that_is_pressed_between_two_resets_is_kept() {
    let hold = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n";
    let mut script = vec![step("?", ""), step(RESET, "")];
    script.extend((0..6).map(|_| step("?", hold)));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    assert!(matches!(grbl.check(), Err(DeviceError::Intervention { .. })));
    assert!(matches!(grbl.reference(&CancelToken::new()), Err(DeviceError::Intervention { .. })));
    controller.followed(grbl);
}

#[test]
fn a_setting_that_was_garbled_on_the_way_is_asked_for_again() {
    let garbled = SETTINGS.replace("$100=1.389\r\n$110", "$100=1.389$110");
    let mut script = opened();
    script.push(("$$", garbled));
    script.push(step("$$", SETTINGS));
    let controller = play(script);
    let grbl = open(&controller).unwrap();
    controller.followed(grbl);
}

#[test]
fn an_erased_memory_is_said_to_be_one() {
    let defaults = SETTINGS.replace("1.389", "250.000");
    let greeting = format!("error:7\r\n{defaults}{GREETING}");
    let mut script = vec![("?", greeting)];
    script.extend(opened());
    script.extend((0..2).map(|_| ("$$", defaults.clone())));
    let controller = play(script);
    let said = open(&controller).err().unwrap().to_string();
    assert!(said.contains("error:7") && said.contains("configured 1.389, found 250"), "{said}");
}

#[test]
fn an_ok_to_homing_that_has_not_homed_is_not_believed() {
    let mut script = opening();
    // It is tried once more.
    for _ in 0..2 {
        script.extend(woken());
        script.extend([step("$$", SETTINGS), step("$H", "ok\r\n"), ("?", idle("3.600"))]);
    }
    let controller = play(script);
    let mut grbl = Grbl::open(GrblSettings { reference: Reference::Home, ..settings(&controller.port()) }).unwrap();
    let said = grbl.reference(&CancelToken::new()).unwrap_err().to_string();
    assert!(said.contains("homing to end at -0.720") && said.contains("3.600"), "{said}");
    assert_eq!(grbl.position(), Position::Suspect { epoch: 0 });
    controller.followed(grbl);
}

#[test]
fn grblhal_is_known_by_its_version_and_forgets_its_last_error_before_each_line() {
    const HAL: &str = "[VER:1.1f.20240301:]\r\n[OPT:VNM,35,1024]\r\n[FIRMWARE:grblHAL]\r\nok\r\n";
    let full = "<Idle|MPos:-0.720,0.000,0.000|Bf:100,1023|FS:0,0|WCO:0.000,0.000,0.000|A:|H:1>\r\n";
    let script = vec![
        ("?", idle("0.000")),
        step("$I", HAL),
        step("", "ok\r\n"),
        step("M5M9", "ok\r\n"),
        step("$$", SETTINGS),
        ("?", idle("0.000")),
        step("$I", HAL),
        step("$$", SETTINGS),
        step("$H", "[GC:G0 G54 G17]\r\nok\r\n"),
        ("?", idle("-0.720")),
        step("\u{87}", full),
        ("?", idle("-0.720")),
        ("?", format!("error:20\r\n[GC:G1 G54]\r\n{}", idle("-0.720"))),
        step("", "ok\r\n"),
        step("G21G90G94G53G1X16.560F3600.000", "ok\r\n"),
        step("G4P0", "ok\r\n"),
        ("?", idle("16.560")),
    ];
    let controller = play(script);
    let mut grbl = Grbl::open(GrblSettings { reference: Reference::Home, ..settings(&controller.port()) }).unwrap();
    assert!(grbl.identity().starts_with("GrblHAL 1.1f"), "{}", grbl.identity());
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.move_to(Steps(24)).unwrap().steps, Steps(24));
    controller.followed(grbl);
}

#[test]
fn another_dialect_than_the_configured_one_is_refused() {
    let controller = play(woken());
    let said = Grbl::open(GrblSettings { dialect: Dialect::GrblHal, ..settings(&controller.port()) }).err().unwrap().to_string();
    assert!(said.contains("grblHAL 1.1") && said.contains("Grbl 1.1h"), "{said}");
}

#[test]
fn a_deaf_moment_at_power_up_is_waited_out_but_not_for_ever() {
    let mut script = vec![step("?", ""), step(RESET, ""), step("?", ""), step(RESET, ""), step("?", ""), step(RESET, GREETING)];
    script.extend([step("$I", VERSION), step("$$", SETTINGS)]);
    let controller = play(script);
    let grbl = open(&controller).unwrap();
    controller.followed(grbl);

    // A step that never comes keeps the port open: a busy machine may need longer than the controller to hang up.
    let old = play(vec![step("?", ""), step(RESET, "Grbl 0.9j ['$' for help]\r\n"), step("$I", VERSION)]);
    let said = open(&old).err().unwrap().to_string();
    assert!(said.contains("Grbl 1.1") && said.contains("Grbl 0.9j"), "{said}");
}

/// Opens, references and moves to step 24, where the script has this between the report before the move and the end.
fn moves_all_the_same(script: Vec<Step<'static>>) {
    let mut steps = referenced("0.000");
    steps.push(("?", idle("0.000")));
    steps.extend(script);
    let controller = play(steps);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert_eq!(grbl.move_to(Steps(24)).unwrap(), Achieved { steps: Steps(24), epoch: 1 });
    controller.followed(grbl);
}

fn running(x: &str) -> String {
    idle(x).replace("Idle", "Run")
}

#[test]
fn a_line_whose_ok_is_disturbed_is_asked_about_and_not_sent_again_where_the_axis_turns_or_has_arrived() {
    for report in [running("3.000"), idle("17.280")] {
        moves_all_the_same(vec![step(MOVE_24, "mk\r\n"), ("?", report), step("G4P0", "ok\r\n"), ("?", idle("17.280"))]);
    }
}

#[test]
fn a_line_that_was_lost_is_sent_again_where_the_axis_stands_where_it_stood() {
    let rest = [step("G4P0", "ok\r\n"), ("?", idle("17.280"))];
    for answer in ["", "errnr:2\r\n"] {
        let lost = [step(MOVE_24, answer), ("?", idle("0.000")), step(MOVE_24, "ok\r\n")];
        moves_all_the_same([&lost[..], &rest[..]].concat());
    }
    // Not for ever.
    let mut script = vec![("?", idle("0.000"))];
    for _ in 0..3 {
        script.extend([step(MOVE_24, ""), ("?", idle("0.000"))]);
    }
    script.push(("?", idle("0.000")));
    script.extend(halted());
    let (error, known) = failed_move(script);
    assert!(matches!(&error, DeviceError::Silent { request, .. } if request == MOVE_24), "{error}");
    assert_eq!(known, Position::Suspect { epoch: 2 });
}

#[test]
fn a_line_is_not_sent_again_where_the_axis_stands_anywhere_else() {
    let mut script = vec![("?", idle("0.000")), step(MOVE_24, ""), ("?", idle("3.600")), step("G4P0", "ok\r\n")];
    script.extend((0..2).map(|_| ("?", idle("3.600"))));
    script.extend(halted());
    let (error, _) = failed_move(script);
    assert!(matches!(error, DeviceError::Missed { target: Steps(24), achieved: Steps(5) }), "{error}");
}

#[test]
fn a_line_is_not_sent_again_after_a_restart() {
    // Nothing is sent to a controller that somebody has reset.
    let script = vec![("?", idle("0.000")), step(MOVE_24, ""), ("?", GREETING.to_owned() + &idle("0.000"))];
    let (error, _) = failed_move(script);
    assert!(is_a_persons_reset(&error), "{error}");
}

#[test]
fn a_barrier_without_an_ok_is_no_loss_where_the_axis_has_arrived() {
    // Disturbed it is asked about soon, lost when the axis is due.
    for (answer, reports) in [("oj\r\n", vec![running("9.000"), idle("17.280")]), ("", vec![idle("17.280")])] {
        let mut script = vec![step(MOVE_24, "ok\r\n"), step("G4P0", answer)];
        script.extend(reports.into_iter().map(|report| ("?", report)));
        moves_all_the_same(script);
    }
}

#[test]
fn a_report_that_is_lost_or_disturbed_anywhere_is_asked_for_again() {
    for report in
        ["", "<Jdle|MPos:17.280,0.000,0.000|FS:0,0>\r\n", "|Idle|MPos:17.280,0.000,0.000|FS:0,0>\r\n", "<Idle|MPps:17.280|FS:0,0>\r\n"]
    {
        moves_all_the_same(vec![step(MOVE_24, "ok\r\n"), step("G4P0", "ok\r\n"), step("?", report), ("?", idle("17.280"))]);
    }
}

#[test]
fn a_hold_is_asked_for_twice_and_then_left_alone_until_a_person_asks_for_a_stop() {
    let hold = "<Hold:0|MPos:9.000,0.000,0.000|FS:0,0>\r\n";
    let mut script = referenced("0.000");
    script.extend([("?", idle("0.000")), step(MOVE_24, "ok\r\n"), step("G4P0", ""), step("?", hold), step("?", hold)]);
    // The program's stop writes nothing; the reference looks: no reset, no line. A person's stop is a reset in the hold.
    script.extend([step("?", hold), step("?", hold)]);
    script.extend(halted());
    let last = script.len() - 1;
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    let error = grbl.move_to(Steps(24)).unwrap_err();
    let DeviceError::Intervention { what, .. } = &error else { panic!("{error}") };
    assert!(what.contains("reports Hold:0, machine position 9.000, 0.000, 0.000"), "{what}");
    grbl.stop_handle().end_motion();
    assert!(matches!(grbl.link.send(b"G1X1F1\n"), Err(DeviceError::Stopped)), "it is latched all the same");
    assert!(matches!(grbl.reference(&CancelToken::new()), Err(DeviceError::Intervention { .. })));
    assert_eq!(grbl.position(), Position::Suspect { epoch: 2 });
    grbl.stop_handle().stop();
    controller.await_step(last);
    controller.followed(grbl);
}

/// A controller that somebody has when its port is opened: what it reports, twice to each question before it is believed.
fn taken(report: &'static str) -> Vec<Step<'static>> {
    vec![step("?", report), step("?", report)]
}

#[test]
fn a_controller_that_somebody_has_is_opened_left_alone_and_asked_once_it_is_free() {
    for (report, reads) in [
        ("<Hold:0|MPos:3.600,0.000,0.000|FS:0,0>\r\n", "feed hold"),
        ("<Door:1|MPos:3.600,0.000,0.000|FS:0,0|Pn:D>\r\n", "door is open"),
        ("<Alarm:10|MPos:3.600,0.000,0.000|FS:0,0|Pn:E>\r\n", "emergency stop"),
    ] {
        // Open, check, reference and the wait for a specimen: each looks, and sends no reset and no line.
        let mut script: Vec<_> = (0..4).flat_map(|_| taken(report)).collect();
        // It is free: the check sees it, and then does what the opening did not.
        script.push(("?", idle("3.600")));
        script.extend(opening());
        script.push(("?", idle("3.600")));
        script.extend(woken());
        script.push(step("$$", SETTINGS));
        script.extend((0..3).map(|_| ("?", idle("3.600"))));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        assert_eq!(grbl.position(), Position::Unknown);
        assert!(grbl.identity().contains("not read yet"), "{}", grbl.identity());
        let cancel = CancelToken::new();
        for error in [grbl.check(), grbl.reference(&cancel).map(drop), crate::SpecimenInput::begin(&mut grbl, &cancel)] {
            let error = error.unwrap_err();
            assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(reads)), "{error}");
        }
        grbl.stop_handle().end_motion();
        assert!(grbl.move_to(Steps(24)).is_err());
        grbl.link.release(&cancel).unwrap();
        grbl.check().unwrap();
        assert!(grbl.identity().starts_with("Grbl 1.1h [VER:1.1h.20190830:]"), "{}", grbl.identity());
        grbl.check().unwrap();
        assert_eq!(grbl.reference(&cancel).unwrap().steps, Steps(0));
        controller.followed(grbl);
    }
}

#[test]
fn a_reference_asks_what_could_not_be_asked_when_the_port_was_opened() {
    let mut script = taken("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    script.extend(opening());
    script.extend(woken());
    script.extend([step("$$", SETTINGS), step("$H", "ok\r\n")]);
    script.extend((0..2).map(|_| ("?", idle("-0.720"))));
    let controller = play(script);
    let mut grbl = Grbl::open(GrblSettings { reference: Reference::Home, ..settings(&controller.port()) }).unwrap();
    grbl.reference(&CancelToken::new()).unwrap();
    assert!(grbl.identity().starts_with("Grbl 1.1h"), "{}", grbl.identity());
    controller.followed(grbl);
}

#[test]
fn settings_that_differ_are_reported_once_a_hold_that_stood_at_the_opening_is_over() {
    let other = SETTINGS.replace("$10=1", "$10=0");
    let mut script = taken("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    script.push(("?", idle("0.000")));
    script.extend(opened());
    script.extend((0..2).map(|_| ("$$", other.clone())));
    // Told once at rest: every reference holds them against the configuration again.
    script.push(("?", idle("0.000")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    assert!(matches!(grbl.check(), Err(DeviceError::Mismatch { .. })));
    grbl.check().unwrap();
    controller.followed(grbl);
}

#[test]
fn a_check_neither_resets_nor_awaits_a_motion_that_goes_on_after_a_hold() {
    let mut script = taken("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    script.push(("?", running("3.600")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.check().unwrap();
    controller.followed(grbl);
}

#[test]
fn a_controller_that_is_stopped_is_not_reset_by_a_check() {
    let mut script = taken("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    script.push(("?", idle("0.000")));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.stop_handle().end_motion();
    grbl.check().unwrap();
    controller.followed(grbl);
}

#[test]
fn greetings_of_earlier_resets_hide_no_hold() {
    let hold = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n";
    let mut script = opening();
    // The question is put again after each greeting, and once more for the hold.
    script.push(("?", GREETING.repeat(5)));
    script.extend((0..4).map(|_| step("?", "")));
    script.extend((0..2).map(|_| step("?", hold)));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    assert!(matches!(grbl.reference(&CancelToken::new()), Err(DeviceError::Intervention { .. })));
    controller.followed(grbl);
}

#[test]
fn a_greeting_before_anything_moves_makes_the_reference_try_once_more() {
    let mut script = opening();
    script.extend(woken());
    script.extend([step("$$", SETTINGS), ("?", GREETING.to_owned() + &idle("0.000"))]);
    script.extend(woken());
    script.push(step("$$", SETTINGS));
    script.extend((0..3).map(|_| ("?", idle("0.000"))));
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    assert_eq!(grbl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
    controller.followed(grbl);
}

/// The reset button, pressed at rest before the first reference: seen by a check, or by the reference that follows.
#[test]
fn a_reset_long_after_the_controller_was_opened_is_that_of_a_person() {
    for looks in [true, false] {
        let mut script = opening();
        script.push(("?", GREETING.to_owned() + "<Alarm|MPos:0.000,0.000,0.000>\r\n"));
        let controller = play(script);
        let mut grbl = open(&controller).unwrap();
        grbl.own_reset = Instant::now().checked_sub(OWN_GREETING * 2).expect("the computer runs for longer");
        let seen = if looks { grbl.check() } else { grbl.reference(&CancelToken::new()).map(drop) };
        assert!(matches!(seen, Err(DeviceError::Intervention { .. })), "{seen:?}");
        controller.followed(grbl);
    }
}

/// carved has stopped the axis after an error, and asks again much later. The greeting has waited since then.
#[test]
fn the_greeting_of_a_stop_of_carved_may_be_read_late_and_counts_once() {
    let mut script = opening();
    let report = GREETING.to_owned() + &idle("0.000");
    script.extend([("?", report.clone()), ("?", idle("0.000")), ("?", report)]);
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    (grbl.own_reset, grbl.owed_greetings) = (Instant::now().checked_sub(OWN_GREETING * 2).unwrap(), 1);
    assert!(!matches!(grbl.check(), Err(DeviceError::Intervention { .. })));
    let again = (0..2).map(|_| grbl.check()).find_map(Result::err);
    assert!(matches!(again, Some(DeviceError::Intervention { .. })), "{again:?}");
}

/// An abort stops a turning axis, and so does the driver that finds its move cut short: the controller resets twice.
#[test]
fn the_greetings_of_two_stops_are_both_those_of_carved() {
    let mut script = opening();
    let report = GREETING.to_owned() + &idle("0.000");
    script.extend([step("!\x18", ""), step("!\x18", ""), ("?", report.clone()), ("?", report.clone()), ("?", report)]);
    let controller = play(script);
    let mut grbl = open(&controller).unwrap();
    grbl.own_reset = Instant::now().checked_sub(OWN_GREETING * 2).unwrap();
    grbl.link.halt();
    grbl.link.halt();
    for _ in 0..2 {
        assert!(!matches!(grbl.check(), Err(DeviceError::Intervention { .. })));
    }
    assert!(matches!(grbl.check(), Err(DeviceError::Intervention { .. })));
}

#[test]
fn a_port_that_is_not_there_is_named() {
    let said = Grbl::open(settings("/dev/no-such-port")).err().unwrap().to_string();
    assert!(said.contains("/dev/no-such-port") && said.contains("cable"), "{said}");
}

#[test]
fn settings_that_no_axis_can_have_are_refused() {
    let good = settings("x");
    for (bad, name) in [
        (GrblSettings { steps_per_unit: [500, 0], ..good.clone() }, "steps_per_unit"),
        (GrblSettings { steps_per_unit: [401, 1], ..good.clone() }, "steps_per_unit"),
        (GrblSettings { max_rate_units_per_min: 0.0, ..good.clone() }, "max_rate_units_per_min"),
        (GrblSettings { acceleration_units_per_s2: f64::NAN, ..good.clone() }, "acceleration_units_per_s2"),
        (GrblSettings { answer_timeout_ms: 0, ..good.clone() }, "answer_timeout_ms"),
    ] {
        assert!(bad.check().unwrap_err().to_string().contains(name));
    }
    assert!(good.check().is_ok());
    assert!(serde_json::from_str::<GrblSettings>(r#"{"port":"x","colour":1}"#).is_err(), "unknown keys are refused");
}

proptest! {
    /// What the driver sends in thousandths of a unit is the same whole step again when it is read back.
    #[test]
    fn a_step_survives_three_decimals(num in 1_u32..40_000, den in 1_u32..1000, steps in -200_000_i64..200_000) {
        prop_assume!(f64::from(num) / f64::from(den) <= 400.0);
        let settings = GrblSettings { steps_per_unit: [num, den], ..settings("x") };
        let axis = Geometry::of(&settings);
        let printed: f64 = geometry::three_decimals(axis.units(steps)).parse().unwrap();
        prop_assert_eq!(axis.machine_steps(printed), Some(steps));
    }

    /// The deadline of a move is longer than the trapezoid takes, however short or long the way.
    #[test]
    fn a_deadline_leaves_room_for_the_move(steps in 1_i64..100_000) {
        let settings = settings("x");
        let axis = Geometry::of(&settings);
        let (way, v, a) = (axis.units(steps), 60.0, 200.0);
        let exact = if way < v * v / a { 2.0 * (way / a).sqrt() } else { way / v + v / a };
        prop_assert!((axis.travel_time(steps) + settings.answer_timeout()).as_secs_f64() > exact + 0.3);
    }
}

/// Opening waits for a controller that moves, and refuses one with other settings.
#[test]
fn the_stop_is_written_without_a_question() {
    let controller = Scripted::play(vec![(STOP.to_vec(), Vec::new())]);
    crate::rotation::driver::Driver::stop(&settings(&controller.port())).unwrap();
    controller.followed(());
}
