//! Tests with a scripted module: the exact bytes that the driver sends, and its reaction to each answer.

#![allow(clippy::decimal_bitwise_operands, reason = "the tests flip bits of positions")]

use super::frame::BYTES;
use super::*;
use crate::rotation::Port;
use crate::rotation::scripted::{Scripted, Step};
use std::collections::BTreeMap;

/// So slow that one motor alone takes a second to come apart by what is allowed: scripts have the time that others wait.
const SPEED: i32 = 20;
const ACCELERATION: i32 = 32_000;
const VERSION: i32 = 0x1844_0100;
const FIRST_MARK: i32 = MARK | 1;

fn settings(port: &str) -> TmclSettings {
    TmclSettings {
        port: Port::Path(port.into()),
        baud: 115_200,
        module_address: 1,
        host_address: 2,
        motors: [0, 1],
        microstep_resolution: 5,
        max_speed: SPEED as u32,
        max_acceleration: ACCELERATION as u32,
        clock_divisors: None,
        max_skew_steps: 20,
        stop_on_stall: None,
        reference: Reference::Here,
        answer_timeout_ms: 1000,
        homing_timeout_ms: 5000,
        outputs: BTreeMap::new(),
    }
}

fn reply(status: u8, command: u8, value: i32) -> Vec<u8> {
    let [a, b, c, d] = value.to_be_bytes();
    let head = [2, 1, status, command, a, b, c, d];
    let sum = head.iter().fold(0, |sum: u8, b| sum.wrapping_add(*b));
    [head.to_vec(), vec![sum]].concat()
}

fn said(request: Request) -> Vec<u8> {
    request.encode(1).to_vec()
}

/// A request and the answer to it.
fn step(request: Request, value: i32) -> Step {
    (said(request), reply(100, request.command, value))
}

fn position(motor: u8, at: i32) -> Step {
    step(Request::get(parameter::ACTUAL_POSITION, motor), at)
}

/// The request of another command that ends a group.
fn fence(mark: i32) -> Step {
    step(Request::mark(), mark)
}

/// A request by itself.
fn alone(request: Request, value: i32, mark: i32) -> Vec<Step> {
    vec![step(request, value), fence(mark)]
}

/// A look at the pair, with what is read of the mark.
fn seen(first: i32, second: i32, mark: i32) -> Vec<Step> {
    vec![position(0, first), position(1, second), position(0, first), fence(mark)]
}

fn look(first: i32, second: i32) -> Vec<Step> {
    seen(first, second, FIRST_MARK)
}

fn speeds(first: i32, second: i32, mark: i32) -> Vec<Step> {
    let [a, b] = [(0, first), (1, second)].map(|(motor, speed)| step(Request::get(parameter::ACTUAL_SPEED, motor), speed));
    vec![a, b, fence(mark)]
}

fn standing() -> Vec<Step> {
    speeds(0, 0, FIRST_MARK)
}

fn opening() -> Vec<Step> {
    let mut steps = vec![step(Request::version(), VERSION)];
    steps.extend(alone(Request::slowed(), 0, 0));
    for motor in [0, 1] {
        for (number, value) in
            [(parameter::MICROSTEP_RESOLUTION, 5), (parameter::MAX_SPEED, SPEED), (parameter::MAX_ACCELERATION, ACCELERATION)]
        {
            steps.extend(alone(Request::get(number, motor), value, 0));
        }
    }
    steps
}

fn stopped(mark: i32) -> Vec<Step> {
    let mut steps = [0, 1].map(|motor| step(Request::stop(motor), 0)).to_vec();
    steps.push(fence(mark));
    steps.extend(speeds(0, 0, mark));
    steps
}

/// Both counters are set to 0, or stand there, and the epoch gets its mark.
fn marked() -> Vec<Step> {
    let mut steps = alone(Request::set_mark(FIRST_MARK), FIRST_MARK, FIRST_MARK);
    steps.extend(look(0, 0));
    steps
}

fn counted_from_here() -> Vec<Step> {
    let mut steps = stopped(0);
    steps.extend([0, 1].map(|motor| step(Request::set(parameter::ACTUAL_POSITION, motor, 0), 0)));
    steps.push(fence(0));
    steps.extend(marked());
    steps
}

/// Opened, and referenced where it stands, at 77 by both counters.
fn referenced() -> Vec<Step> {
    let mut steps = opening();
    steps.extend(opening());
    steps.extend(stopped(0));
    steps.extend([seen(77, 77, 0), seen(77, 77, 0)].concat());
    steps.extend(counted_from_here());
    steps
}

/// A move from 0 to `target` up to the acceptance of its targets.
fn sent_to(target: i32) -> Vec<Step> {
    let mut steps = look(0, 0);
    steps.extend([0, 1].map(|motor| step(Request::go(motor, target), target)));
    steps
}

fn arrived(target: i32) -> Vec<Step> {
    let mut steps = look(target, target);
    steps.extend(standing());
    steps
}

fn halt() -> Step {
    (stop_pieces(1, [0, 1]).concat(), Vec::new())
}

fn axis(script: Vec<Step>) -> (Scripted, Tmcl) {
    let module = Scripted::play(script);
    let mut tmcl = Tmcl::open(settings(&module.port())).unwrap();
    assert_eq!(tmcl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
    (module, tmcl)
}

/// A move to 1600 that goes as `script` says.
fn moves(script: Vec<Step>) {
    let mut steps = referenced();
    steps.extend(script);
    let (module, mut tmcl) = axis(steps);
    assert_eq!(tmcl.move_to(Steps(1600)).unwrap(), Achieved { steps: Steps(1600), epoch: 1 });
    module.followed(tmcl);
}

/// A move to 1600 that goes wrong as `script` says; the axis then moves no more.
fn fails(script: Vec<Step>) -> DeviceError {
    let mut steps = referenced();
    steps.extend(script);
    let (module, mut tmcl) = axis(steps);
    let error = tmcl.move_to(Steps(1600)).unwrap_err();
    assert_eq!(tmcl.position(), Position::Suspect { epoch: 2 });
    assert!(matches!(tmcl.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
    module.followed(tmcl);
    error
}

#[test]
fn both_motors_get_the_target_and_both_are_believed_only_there_and_at_rest() {
    let mut script = sent_to(1600);
    script.extend(look(700, 690));
    // At the target, but one still has speed.
    script.extend(look(1600, 1600));
    script.extend(speeds(0, 3, FIRST_MARK));
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn the_module_is_named_and_nothing_moves_before_the_reference() {
    let module = Scripted::play(opening());
    let mut tmcl = Tmcl::open(settings(&module.port())).unwrap();
    assert_eq!(tmcl.identity(), "TMCM-6212 1.00");
    assert_eq!(tmcl.position(), Position::Unknown);
    assert!(matches!(tmcl.move_to(Steps(1)), Err(DeviceError::NotReferenced)));
    module.followed(tmcl);
}

#[test]
fn settings_that_differ_are_listed_all_of_them_with_both_numbers() {
    let get = |number, motor, value| alone(Request::get(number, motor), value, 0);
    let mut script = vec![step(Request::version(), VERSION)];
    script.extend(alone(Request::slowed(), 0, 0));
    // What differs is asked twice.
    script.extend([(); 2].map(|()| get(parameter::MICROSTEP_RESOLUTION, 0, 8)).concat());
    script.extend([get(parameter::MAX_SPEED, 0, SPEED), get(parameter::MAX_ACCELERATION, 0, ACCELERATION)].concat());
    script.extend(get(parameter::MICROSTEP_RESOLUTION, 1, 5));
    script.extend([(); 2].map(|()| get(parameter::MAX_SPEED, 1, 2047)).concat());
    script.extend(get(parameter::MAX_ACCELERATION, 1, ACCELERATION));
    let module = Scripted::play(script);
    let error = Tmcl::open(settings(&module.port())).err().unwrap();
    let text = error.to_string();
    assert!(matches!(&error, DeviceError::Mismatch { differences, .. } if differences.len() == 2), "{text}");
    for part in ["motor 0, parameter 140", "configured 5", "found 8", "motor 1, parameter 4 (maximum speed)", "found 2047"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    module.followed(());
}

#[test]
fn a_pair_that_is_apart_while_it_turns_is_stopped_at_once_and_both_numbers_are_said() {
    let mut script = sent_to(1600);
    script.extend(look(300, 280));
    for apart in [(400, 379), (420, 380)] {
        script.extend(look(apart.0, apart.1));
    }
    script.extend(speeds(SPEED, SPEED, FIRST_MARK));
    // Stopped before anything else is asked, and stopped for good by the fault.
    script.extend([halt(), step(Request::version(), VERSION), fence(FIRST_MARK), halt()]);
    let error = fails(script);
    assert!(matches!(error, DeviceError::Skew { first: Steps(420), second: Steps(380), limit: 20, .. }), "{error}");
}

#[test]
fn a_pair_that_is_apart_at_rest_does_not_begin_a_move() {
    let error = fails([look(0, 30), look(0, 30)].concat());
    assert!(matches!(error, DeviceError::Skew { first: Steps(0), second: Steps(30), .. }), "{error}");
}

#[test]
fn the_time_between_two_readings_is_not_taken_for_skew() {
    // The first motor turned 40 steps on while the second was asked.
    let mut script = sent_to(1600);
    script.extend([position(0, 400), position(1, 425), position(0, 440), fence(FIRST_MARK)]);
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn a_flipped_bit_that_parses_is_asked_again_and_not_believed() {
    let mut script = seen(0, 1024, FIRST_MARK ^ 64);
    script.extend(look(0, 0));
    script.extend([0, 1].map(|motor| step(Request::go(motor, 1600), 1600)));
    script.extend([position(0, 500), position(1, 500 ^ 256), position(0, 510), fence(FIRST_MARK)]);
    script.extend(look(550, 550));
    script.extend([position(0, 600), position(1, 610), position(0, 620 ^ (1 << 30)), fence(FIRST_MARK)]);
    script.extend(look(700, 700));
    script.extend(seen(800, 800, FIRST_MARK ^ 64));
    script.extend(look(900, 900));
    script.extend(arrived(1600));
    moves(script);
}

/// Nothing is seen of the pair for as long as it takes to come apart: it is stopped, looked at, and sent on.
#[test]
fn a_late_answer_is_never_taken_for_the_next_one_and_costs_a_stop() {
    let mut script = sent_to(1600);
    script.push(position(0, 500));
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 1)), Vec::new()));
    script.push(halt());
    // The second motor's position comes only after the driver has asked for the version. A copy of that comes still later.
    let late = [reply(100, 6, 501), reply(100, 136, VERSION)].concat();
    script.push((said(Request::version()), late));
    let mut stop = stopped(FIRST_MARK);
    stop[0].1.splice(0..0, reply(100, 136, VERSION));
    script.extend(stop);
    script.extend([look(900, 890), look(900, 890)].concat());
    script.extend([0, 1].map(|motor| step(Request::go(motor, 1600), 1600)));
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn a_pair_that_is_apart_when_it_is_seen_again_is_not_sent_on() {
    let mut script = sent_to(1600);
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 0)), Vec::new()));
    script.extend([halt(), step(Request::version(), VERSION)]);
    script.extend(stopped(FIRST_MARK));
    script.extend([look(900, 870), look(900, 870)].concat());
    script.push(halt());
    let error = fails(script);
    assert!(matches!(error, DeviceError::Skew { first: Steps(900), second: Steps(870), .. }), "{error}");
}

/// The first motor's position comes twice, the second time as the answer to the question for the second motor's.
#[test]
fn a_doubled_answer_makes_the_look_void_wherever_the_right_ones_go() {
    let ask = |motor| said(Request::get(parameter::ACTUAL_POSITION, motor));
    let right = |at| reply(100, 6, at);
    let mut script = sent_to(1600);
    // Both answers are there at once when the next is asked for: the right one is left over.
    script.push(position(0, 500));
    script.push((ask(1), [right(500), right(100)].concat()));
    script.extend([position(0, 510), fence(FIRST_MARK)]);
    // Each answer comes one too late; the last of them before the mark.
    script.push(position(0, 520));
    script.extend([(ask(1), right(520)), (ask(0), right(100)), (said(Request::mark()), [right(530), reply(100, 10, FIRST_MARK)].concat())]);
    // A copy that is there before the next question does no harm.
    script.push((ask(0), [right(600), right(600)].concat()));
    script.extend([position(1, 605), position(0, 610), fence(FIRST_MARK)]);
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn an_answer_that_comes_after_the_flush_as_well_is_no_answer_to_a_position() {
    let mut script = sent_to(1600);
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 0)), vec![0xaa; BYTES]));
    // Two versions are answered: the second lies on the wire when the position is asked again, or comes behind that question.
    let version = reply(100, 136, VERSION);
    script.push((said(Request::version()), [version.clone(), version.clone()].concat()));
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 0)), [version, reply(100, 6, 500)].concat()));
    script.extend([position(1, 500), position(0, 500), fence(FIRST_MARK)]);
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn a_stray_byte_at_the_module_is_filled_up_with_zeros_until_it_complains() {
    let mut script = sent_to(1600);
    script.pop();
    // The module took a stray byte and eight of these, and keeps the ninth.
    script.push((said(Request::go(1, 1600)), reply(1, 0, 0)));
    // The first motor does not turn on alone meanwhile.
    script.push(halt());
    script.push((said(Request::version()), reply(1, 1, 0)));
    script.extend((0..7).map(|_| (vec![0], Vec::new())));
    script.push((vec![0], reply(1, 0, 0)));
    script.push(step(Request::version(), VERSION));
    // An absolute target may be sent twice.
    script.extend([0, 1].map(|motor| step(Request::go(motor, 1600), 1600)));
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn stray_bytes_at_the_host_do_not_shift_what_follows() {
    let mut script = sent_to(1600);
    let mut shifted = vec![0xff];
    shifted.extend(reply(100, 6, 500));
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 0)), shifted));
    script.push(step(Request::version(), VERSION));
    script.extend(look(500, 500));
    script.extend(arrived(1600));
    moves(script);
}

#[test]
fn a_reset_is_seen_by_its_mark_also_where_the_counters_say_nothing() {
    // Sent to 0, where a reset module counts itself.
    let mut script = sent_to(1600);
    script.extend(arrived(1600));
    script.extend(look(1600, 1600));
    script.extend([0, 1].map(|motor| step(Request::go(motor, 0), 0)));
    script.extend([seen(0, 0, 0), seen(0, 0, 0), speeds(0, 0, 0)].concat());
    script.extend([halt(), step(Request::version(), VERSION), fence(0), fence(0), halt()]);
    let mut steps = referenced();
    steps.extend(script);
    let (module, mut tmcl) = axis(steps);
    tmcl.move_to(Steps(1600)).unwrap();
    let error = tmcl.move_to(Steps(0)).unwrap_err();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved")), "{error}");
    assert_eq!(tmcl.position(), Position::Suspect { epoch: 2 });
    module.followed(tmcl);
}

#[test]
fn a_reset_at_rest_is_reported_once_by_a_check_or_by_the_next_reference() {
    let mut script = referenced();
    script.extend([seen(0, 0, 0), vec![fence(0), fence(0)], alone(Request::get(parameter::ACTUAL_POSITION, 0), 0, 0)].concat());
    let (module, mut tmcl) = axis(script);
    let error = tmcl.check().unwrap_err();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved")), "{error}");
    assert_eq!(tmcl.position(), Position::Suspect { epoch: 2 });
    tmcl.check().unwrap();
    module.followed(tmcl);

    let mut script = referenced();
    script.push(step(Request::version(), VERSION));
    script.extend([seen(0, 0, 0), vec![fence(0), fence(0), halt()]].concat());
    let (module, mut tmcl) = axis(script);
    let error = tmcl.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(&error, DeviceError::Intervention { .. }), "{error}");
    module.followed(tmcl);
}

#[test]
fn counters_that_somebody_cleared_are_reported() {
    let mut script = referenced();
    script.extend(sent_to(1600));
    script.extend(arrived(1600));
    script.extend([look(0, 0), look(0, 0)].concat());
    let (module, mut tmcl) = axis(script);
    tmcl.move_to(Steps(1600)).unwrap();
    let error = tmcl.check().unwrap_err();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("left at 1600")), "{error}");
    module.followed(tmcl);
}

#[test]
fn the_stall_stop_is_armed_only_after_a_stop_has_forgotten_the_old_move() {
    let mut script = opening();
    script.extend(opening());
    script.extend(stopped(0));
    script.extend([0, 1].map(|motor| step(Request::set(parameter::STOP_ON_STALL, motor, 100), 100)));
    script.push(fence(0));
    script.extend([seen(77, 77, 0), seen(77, 77, 0)].concat());
    script.extend(counted_from_here());
    let module = Scripted::play(script);
    let mut tmcl = Tmcl::open(TmclSettings { stop_on_stall: Some(100), ..settings(&module.port()) }).unwrap();
    assert!(tmcl.capabilities().has_stall);
    tmcl.reference(&CancelToken::new()).unwrap();
    module.followed(tmcl);
}

#[test]
fn a_motor_that_stands_short_is_a_miss_where_nothing_says_why() {
    let mut script = sent_to(1600);
    for _ in 0..5 {
        script.extend(look(1590, 1590));
    }
    script.extend(standing());
    script.push(fence(FIRST_MARK));
    for motor in [0, 1] {
        script.extend(
            [parameter::RIGHT_LIMIT, parameter::LEFT_LIMIT].map(|number| alone(Request::get(number, motor), 0, FIRST_MARK)).concat(),
        );
    }
    script.push(halt());
    let error = fails(script);
    assert!(matches!(error, DeviceError::Missed { target: Steps(1600), achieved: Steps(1590) }), "{error}");
}

#[test]
fn ends_that_are_a_little_apart_after_a_stop_are_brought_together_by_the_reference() {
    let mut script = opening();
    script.extend(opening());
    script.extend(stopped(0));
    // A flipped bit, and then twice the same.
    script.extend([seen(77, 70, 0), seen(77, 70 ^ 16, 0), seen(77, 70, 0), seen(77, 70, 0)].concat());
    script.extend(alone(Request::go(1, 77), 77, 0));
    script.extend(seen(77, 77, 0));
    script.extend(speeds(0, 0, 0));
    script.extend(counted_from_here());
    let (module, tmcl) = axis(script);
    module.followed(tmcl);
}

#[test]
fn a_refusal_is_named_by_its_status() {
    let mut script = sent_to(1600);
    script.pop();
    script.push((said(Request::go(1, 1600)), reply(4, 4, 0)));
    script.push(halt());
    let error = fails(script);
    assert!(error.to_string().contains("status 4 (invalid value)"), "{error}");
}

#[test]
fn a_stop_reaches_the_wire_while_an_answer_is_awaited_and_stays_until_the_reference() {
    let mut script = referenced();
    script.extend(sent_to(1600));
    script.push((said(Request::get(parameter::ACTUAL_POSITION, 0)), Vec::new()));
    let waiting = script.len() - 1;
    // By the handle, and by the driver's own doubt.
    script.extend([halt(), halt()]);
    let module = Scripted::play(script);
    // An answer time of minutes, and hours until the pair is apart: only the stop can end this move in time.
    let patient = TmclSettings { answer_timeout_ms: 600_000, max_skew_steps: 1_000_000, ..settings(&module.port()) };
    let mut tmcl = Tmcl::open(patient).unwrap();
    tmcl.reference(&CancelToken::new()).unwrap();
    let stop = tmcl.stop_handle();
    let tmcl = std::thread::scope(|scope| {
        let moving = scope.spawn(|| {
            let error = tmcl.move_to(Steps(1600)).unwrap_err();
            assert!(matches!(error, DeviceError::Stopped), "{error}");
            tmcl
        });
        module.await_step(waiting);
        stop.stop();
        moving.join().unwrap()
    });
    assert_eq!(tmcl.position(), Position::Suspect { epoch: 2 });
    module.followed(tmcl);
}

#[test]
fn a_stop_begins_with_plain_frames_for_both_motors() {
    let stop = stop_pieces(1, [0, 1]);
    assert_eq!(stop[0], Request::stop(0).encode(1));
    assert_eq!(stop[1][..BYTES], Request::stop(1).encode(1));
}

#[test]
fn both_acknowledgements_share_the_time_in_which_the_pair_comes_apart() {
    let mut script = look(0, 0);
    for _ in 0..2 {
        // The first turns, the second does not say.
        script.extend([step(Request::go(0, 1600), 1600), (said(Request::go(1, 1600)), Vec::new()), halt()]);
        script.push(step(Request::version(), VERSION));
    }
    script.push(halt());
    let error = fails(script).to_string();
    // Of the second in which the pair comes apart by 20 steps, an exchange at the end is for the stop.
    let waited: u32 = error.split("within ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().parse().unwrap();
    assert!(waited < 1000 - 4, "{error}");
}

/// From the opening of a reference at the switches to the search; the pair stands at `first` and `second`.
fn about_to_search(first: i32, second: i32, mark: i32) -> Vec<Step> {
    let mut script = opening();
    script.extend(stopped(mark));
    script.extend([seen(first, second, mark), seen(first, second, mark)].concat());
    script
}

fn search_begins() -> Vec<Step> {
    let mut script = alone(Request::set_mark(0), 0, 0);
    script.extend([0, 1].map(|motor| step(Request::search(motor), 0)));
    script
}

/// A reference at the switches that goes as `rounds` say.
fn searches(rounds: Vec<Step>) {
    let script = [opening(), about_to_search(77, 77, 0), search_begins(), rounds, marked()].concat();
    let module = Scripted::play(script);
    let mut tmcl = Tmcl::open(TmclSettings { reference: Reference::Home, ..settings(&module.port()) }).unwrap();
    assert_eq!(tmcl.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
    module.followed(tmcl);
}

fn searching(first: i32, second: i32) -> Vec<Step> {
    vec![step(Request::searching(0), first), step(Request::searching(1), second), fence(0)]
}

fn ended() -> Vec<Step> {
    [searching(0, 0), searching(0, 0), seen(0, 0, 0)].concat()
}

#[test]
fn an_end_of_the_search_is_asked_for_twice() {
    let both = [searching(1, 1), seen(90, 90, 0)].concat();
    let flipped = [searching(0, 0), searching(1, 1), seen(110, 110, 0)].concat();
    searches([both, flipped, ended()].concat());
}

#[test]
fn a_wrong_reading_is_not_what_a_late_motor_is_held_against() {
    let late = |at| [searching(0, 1), searching(0, 1), seen(0, at, 0)].concat();
    searches([late(95 ^ 1024), late(97), late(99), late(101), ended()].concat());
}

/// By counters of an earlier reference, this driver's or another's.
#[test]
fn a_pair_that_is_apart_is_searched_for_only_after_a_person_was_informed() {
    let told = [about_to_search(77, 98, FIRST_MARK), vec![halt()]].concat();
    let script = [opening(), told, about_to_search(77, 98, FIRST_MARK), search_begins(), ended(), marked()].concat();
    let module = Scripted::play(script);
    let mut tmcl = Tmcl::open(TmclSettings { reference: Reference::Home, ..settings(&module.port()) }).unwrap();
    let error = tmcl.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(error, DeviceError::Skew { first: Steps(77), second: Steps(98), .. }), "{error}");
    tmcl.reference(&CancelToken::new()).unwrap();
    module.followed(tmcl);
}

#[test]
fn between_runs_a_counter_is_asked_for_and_of_a_stopped_module_its_version() {
    let mut script = opening();
    script.extend(alone(Request::get(parameter::ACTUAL_POSITION, 0), 5, 0));
    script.extend([halt(), step(Request::version(), VERSION)]);
    let module = Scripted::play(script);
    let mut tmcl = Tmcl::open(settings(&module.port())).unwrap();
    tmcl.check().unwrap();
    tmcl.stop_handle().stop();
    tmcl.check().unwrap();
    module.followed(tmcl);
}

/// Opening waits for a controller that moves, and refuses one with other settings.
#[test]
fn the_stop_is_written_without_a_question() {
    let controller = Scripted::play(stop_pieces(1, [0, 1]).into_iter().map(|piece| (piece, Vec::new())).collect());
    crate::rotation::driver::Driver::stop(&settings(&controller.port())).unwrap();
    controller.followed(());
}
