//! Tests of the sampler with a scripted wire and a scripted clock. The wire keeps its last level. The clock moves only when the sampler
//! pauses or a test moves it, so the number of readings is exact.

use super::*;
use crate::testing::{FakeAxis, FakeInput};
use carved_core::units::Steps;
use std::cell::Cell;

thread_local! {
    /// The time of the test in this thread.
    static NOW: Cell<Instant> = Cell::new(Instant::now());
}

const CLOCK: Clock = Clock { now: || NOW.get(), pause: pass };

fn pass(time: Duration) {
    NOW.set(NOW.get() + time);
}

/// An axis whose specimen input has these levels, one per reading.
fn wired(levels: &[bool]) -> FakeAxis {
    FakeAxis::new().referenced().with_input(FakeInput::new(levels))
}

const QUICK: TriggerSettings =
    TriggerSettings { inverted: false, debounce_ms: 20, load_timeout_ms: 400, eject_timeout_ms: 300, done_output: true };
const A01: Expected<'static> = Expected { well: "A01", bead: false, dpf: None, asked_before: false };

fn sampler(settings: TriggerSettings) -> TriggerSampler {
    TriggerSampler::with_clock(Box::new(wired(&[])), settings, CLOCK).unwrap().0
}

fn words(result: Result<impl std::fmt::Debug, DeviceError>) -> String {
    let error = result.unwrap_err();
    assert!(matches!(error, DeviceError::Sampler { .. }), "{error}");
    error.to_string()
}

/// Number of equal readings that last for `debounce_ms`, counting both ends.
const FOR_LONG: usize = 1 + 20 / POLL.as_millis() as usize;
/// While nothing runs the daemon reads the input once a second.
const BETWEEN_LOOKS: Duration = Duration::from_secs(1);

#[test]
fn an_arrival_is_believed_after_its_bounces_and_a_blink_is_none() {
    let mut sampler = sampler(QUICK);
    // The longest blink is one reading too short.
    let blinks = [&[true, false, false][..], &[true; FOR_LONG - 1], &[false]].concat();
    let levels = [&[false; FOR_LONG], &blinks[..], &[true; FOR_LONG]].concat();
    let mut axis = wired(&levels);
    assert!(sampler.load(&mut axis, A01, &CancelToken::new()).unwrap().is_some());
    assert_eq!(axis.input().levels.len(), 0, "looks too early");
    axis.input().after_done = Some(false);
    sampler.eject(&mut axis, "A01", &CancelToken::new()).unwrap();
    assert_eq!(axis.input().done, [true, false], "the output is on until it is gone");
    // The next one may be there already: the capillary was seen empty in between.
    axis.input().last = true;
    assert!(sampler.load(&mut axis, A01, &CancelToken::new()).unwrap().is_some());
}

#[test]
fn what_comes_in_between_two_runs_is_not_the_next_runs_first_specimen() {
    let mut sampler = sampler(QUICK);
    let mut axis = wired(&[[false; FOR_LONG], [true; FOR_LONG]].concat());
    sampler.begin_run();
    assert!(sampler.load(&mut axis, A01, &CancelToken::new()).unwrap().is_some());
    axis.input().after_done = Some(false);
    sampler.eject(&mut axis, "A01", &CancelToken::new()).unwrap();
    axis.input().last = true;
    sampler.begin_run();
    let said = words(sampler.load(&mut axis, A01, &CancelToken::new()));
    assert!(said.contains("none was asked for"), "{said}");
}

#[test]
fn a_specimen_that_is_there_while_nothing_runs_is_seen_once_it_is_no_blink() {
    for inverted in [false, true] {
        let mut sampler = sampler(TriggerSettings { inverted, ..QUICK });
        let mut axis = wired(&[inverted, !inverted, inverted]);
        assert_eq!(sampler.sees_specimen(), None, "not looked at yet");
        for found in [Some(false), Some(false), Some(false)] {
            sampler.look(&mut axis).unwrap();
            assert_eq!(sampler.sees_specimen(), found, "a blink");
        }
        axis.input().last = !inverted;
        sampler.look(&mut axis).unwrap();
        assert_eq!(sampler.sees_specimen(), Some(false), "a blink as yet");
        pass(BETWEEN_LOOKS);
        sampler.look(&mut axis).unwrap();
        assert_eq!(sampler.sees_specimen(), Some(true));
    }
}

#[test]
fn what_nobody_asked_for_and_what_does_not_come_or_go_is_said() {
    let mut sampler = sampler(QUICK);
    let mut axis = wired(&[true]);
    let said = words(sampler.load(&mut axis, A01, &CancelToken::new()));
    assert!(said.contains("A01") && said.contains("none was asked for"), "{said}");
    let said = words(sampler.load(&mut wired(&[false]), A01, &CancelToken::new()));
    assert!(said.contains("no specimen within 400 ms"), "{said}");
    // It came too late, for nobody.
    let said = words(sampler.load(&mut wired(&[true]), A01, &CancelToken::new()));
    assert!(said.contains("none was asked for"), "{said}");
    let mut axis = wired(&[[false; FOR_LONG], [true; FOR_LONG]].concat());
    sampler.load(&mut axis, A01, &CancelToken::new()).unwrap();
    let said = words(sampler.eject(&mut axis, "A01", &CancelToken::new()));
    assert!(said.contains("still says") && said.contains("stuck"), "{said}");
    assert_eq!(axis.input().done, [true, false]);
}

/// The sampler would take the next specimen for one that is done.
#[test]
fn an_ejection_that_ends_by_an_error_switches_the_output_off() {
    let mut sampler = sampler(QUICK);
    let mut axis = wired(&[[false; FOR_LONG], [true; FOR_LONG]].concat());
    sampler.load(&mut axis, A01, &CancelToken::new()).unwrap();
    axis.input().is_lost = true;
    assert!(matches!(sampler.eject(&mut axis, "A01", &CancelToken::new()), Err(DeviceError::Gone { .. })));
    assert_eq!(axis.input().done, [true, false]);
}

#[test]
fn an_input_that_bounces_for_ever_is_neither_there_nor_gone() {
    let mut sampler = sampler(QUICK);
    let restless: Vec<bool> = [vec![false; FOR_LONG], (0..200).map(|i| i % 2 == 0).collect()].concat();
    let said = words(sampler.load(&mut wired(&restless), A01, &CancelToken::new()));
    assert!(said.contains("no specimen within"), "{said}");
}

#[test]
fn a_stop_leaves_the_specimen_to_the_next_load_and_a_cancel_ends_the_wait() {
    let mut sampler = sampler(QUICK);
    let mut axis = wired(&[[false; FOR_LONG], [true; FOR_LONG]].concat());
    sampler.load(&mut axis, A01, &CancelToken::new()).unwrap();
    axis.input().is_stopped = true;
    let cancel = CancelToken::new();
    cancel.cancel();
    assert!(matches!(sampler.eject(&mut axis, "A01", &cancel), Err(DeviceError::Stopped)));
    assert!(axis.input().done.is_empty(), "nothing moves any more");
    axis.input().after_done = Some(false);
    let said = words(sampler.load(&mut axis, Expected { well: "A02", ..A01 }, &CancelToken::new()));
    assert!(said.contains("A02") && said.contains("no specimen"), "{said}");
    assert_eq!(axis.input().done, [true, false], "the last run's specimen is ejected first");
    let waits = CancelToken::new();
    axis.input().cancels = Some(waits.clone());
    assert_eq!(sampler.load(&mut axis, A01, &waits).unwrap(), None);
}

#[test]
fn a_specimen_that_was_asked_for_before_a_restart_is_taken_whether_it_came_meanwhile_or_comes_now() {
    let asked = Expected { asked_before: true, ..A01 };
    for levels in [&[true; FOR_LONG][..], &[[false; FOR_LONG], [true; FOR_LONG]].concat()] {
        let mut sampler = sampler(QUICK);
        let stopped = CancelToken::new();
        stopped.cancel();
        assert!(matches!(sampler.load(&mut wired(levels), asked, &stopped), Err(DeviceError::Stopped)));
        // The first load is told, the next one is not.
        assert!(sampler.load(&mut wired(levels), A01, &CancelToken::new()).unwrap().is_some());
    }
    // While the run was held it came, and was taken out.
    let (mut sampler, mut axis) = (sampler(QUICK), wired(&[]));
    for there in [true, true, false, false, true, true] {
        axis.input().last = there;
        sampler.look(&mut axis).unwrap();
        pass(BETWEEN_LOOKS);
    }
    assert!(words(sampler.load(&mut axis, asked, &CancelToken::new())).contains("none was asked for"));
}

#[test]
fn a_specimen_that_comes_after_its_load_was_cut_short_is_that_of_this_well() {
    for is_lost in [false, true] {
        let (mut sampler, waits) = (sampler(QUICK), CancelToken::new());
        let mut axis = wired(&[false; FOR_LONG]);
        axis.input().is_lost = is_lost;
        axis.input().cancels = (!is_lost).then(|| waits.clone());
        match sampler.load(&mut axis, A01, &waits) {
            Err(error) => assert!(is_lost && matches!(error, DeviceError::Gone { .. }), "{error}"),
            loaded => assert!(!is_lost && loaded.unwrap().is_none()),
        }
        (axis.input().is_lost, axis.input().cancels, axis.input().last) = (false, None, true);
        if is_lost {
            for there in [true, true, false, false, true, true] {
                axis.input().last = there;
                sampler.look(&mut axis).unwrap();
                pass(BETWEEN_LOOKS);
            }
            let said = words(sampler.load(&mut axis, A01, &CancelToken::new()));
            assert!(said.contains("none was asked for"), "another one may be there: {said}");
        } else {
            assert!(sampler.load(&mut axis, A01, &CancelToken::new()).unwrap().is_some());
        }
    }
}

/// Its own specimen is out, or is still on its way.
#[test]
fn a_specimen_that_comes_after_the_load_of_another_well_was_cut_short_is_not_believed() {
    let (mut sampler, waits) = (sampler(QUICK), CancelToken::new());
    let mut axis = wired(&[false; FOR_LONG]);
    axis.input().cancels = Some(waits.clone());
    assert!(sampler.load(&mut axis, A01, &waits).unwrap().is_none());
    (axis.input().cancels, axis.input().last) = (None, true);
    let said = words(sampler.load(&mut axis, Expected { well: "A02", ..A01 }, &CancelToken::new()));
    assert!(said.contains("its well is not known"), "{said}");
}

#[test]
fn a_specimen_that_leaves_in_mid_turn_ends_it_and_a_blink_does_not() {
    let levels = [[false; FOR_LONG], [true; FOR_LONG]].concat();
    for (then, leaves) in [(vec![false, true], false), (vec![false], true)] {
        let wire = wired(&[levels.clone(), then].concat());
        let (mut sampler, mut axis) = TriggerSampler::with_clock(Box::new(wire), QUICK, CLOCK).unwrap();
        axis.move_to(Steps(1)).unwrap();
        let mut looks = 0;
        sampler.load(axis.as_mut(), A01, &CancelToken::new()).unwrap();
        let turned = loop {
            match axis.move_to(Steps(2)) {
                Ok(_) if looks < 2 * FOR_LONG => looks += 1,
                other => break other,
            }
        };
        assert_eq!(turned.is_err(), leaves);
        if let Err(error) = turned {
            assert!(error.to_string().contains("mid-turn"), "{error}");
        }
    }
}

/// A sampler whose specimen was left in the capillary, and its axis. While nothing runs the input then has these levels, a second apart.
fn looked_at(levels: &[bool]) -> (TriggerSampler, FakeAxis) {
    let mut sampler = sampler(QUICK);
    let mut axis = wired(&[[false; FOR_LONG], [true; FOR_LONG]].concat());
    sampler.begin_run();
    sampler.load(&mut axis, A01, &CancelToken::new()).unwrap();
    axis.input().levels = levels.iter().copied().collect();
    while !axis.input().levels.is_empty() {
        sampler.look(&mut axis).unwrap();
        pass(BETWEEN_LOOKS);
    }
    (sampler, axis)
}

#[test]
fn a_specimen_that_may_have_been_exchanged_while_the_run_was_held_is_not_gone_on_with() {
    let (mut sampler, mut axis) = looked_at(&[true, false, false, true, true]);
    let error = sampler.go_on(&mut axis, A01, &CancelToken::new()).unwrap_err();
    assert!(matches!(&error, DeviceError::Sampler { well, why } if well == "A01" && why.contains("Empty the capillary")), "{error}");
    assert_eq!(sampler.sees_specimen(), Some(true), "it is refused although one is there");
    assert!(sampler.go_on(&mut axis, A01, &CancelToken::new()).is_err(), "no second try makes it the same specimen");
}

#[test]
fn a_specimen_that_every_look_has_seen_is_gone_on_with() {
    let (mut sampler, mut axis) = looked_at(&[true; 5]);
    assert_eq!(sampler.go_on(&mut axis, A01, &CancelToken::new()).unwrap(), Some(Loaded::default()));
}

#[test]
fn a_blink_while_the_run_was_held_does_not_make_it_another_specimen() {
    // Each is a single reading, which may be a bounce.
    let (mut sampler, mut axis) = looked_at(&[true, false, true, false, true]);
    assert_eq!(sampler.go_on(&mut axis, A01, &CancelToken::new()).unwrap(), Some(Loaded::default()));
}

#[test]
fn a_new_run_forgets_that_the_capillary_was_empty_before_it() {
    let (mut sampler, mut axis) = looked_at(&[true, false, false, true, true]);
    sampler.begin_run();
    assert_eq!(sampler.sees_specimen(), None);
    assert_eq!(sampler.go_on(&mut axis, A01, &CancelToken::new()).unwrap(), Some(Loaded::default()));
}

#[test]
fn an_inverted_input_is_active_while_it_is_empty() {
    let mut sampler = sampler(TriggerSettings { inverted: true, done_output: false, ..QUICK });
    let mut axis = wired(&[[true; FOR_LONG], [false; FOR_LONG]].concat());
    sampler.load(&mut axis, A01, &CancelToken::new()).unwrap();
    axis.input().last = true;
    axis.input().levels.clear();
    sampler.eject(&mut axis, "A01", &CancelToken::new()).unwrap();
    assert!(axis.input().done.is_empty(), "no such wire");
}

#[test]
fn settings_that_no_sampler_can_have_are_refused() {
    for (bad, name) in [
        (TriggerSettings { debounce_ms: 0, ..QUICK }, "debounce_ms"),
        (TriggerSettings { load_timeout_ms: 79, ..QUICK }, "load_timeout_ms"),
        (TriggerSettings { eject_timeout_ms: 10, ..QUICK }, "eject_timeout_ms"),
    ] {
        assert!(bad.check().unwrap_err().to_string().contains(name));
    }
}
