//! Tests with a scripted controller: the exact bytes that the driver sends, and its reaction to each answer.

#![allow(clippy::decimal_bitwise_operands, reason = "the tests flip bits of positions")]

use super::*;
use crate::rotation::Port;
use crate::rotation::scripted::{Scripted, Step};
use std::collections::BTreeMap;

fn settings(port: &str) -> ZaberSettings {
    ZaberSettings {
        port: Port::Path(port.into()),
        baud: 115_200,
        device: 1,
        axis: 1,
        resolution: 32,
        maxspeed: 5243,
        accel: 5,
        encoder_tolerance_steps: Some(8),
        reference: Reference::Here,
        answer_timeout_ms: 1000,
        homing_timeout_ms: 5000,
        outputs: BTreeMap::new(),
    }
}

/// A controller's half of a dialogue, with the ids of the driver's.
#[derive(Default)]
struct Script {
    steps: Vec<Step>,
    id: u8,
}

fn line(content: &str) -> String {
    let sum = content[1..].bytes().fold(0_u8, u8::wrapping_add).wrapping_neg();
    format!("{content}:{sum:02X}\r\n")
}

impl Script {
    /// A command and raw bytes as its answer; `{id}` stands for the command's.
    fn raw(mut self, axis: u8, words: &str, answer: &str) -> Self {
        let id = format!("{:02}", self.id);
        let heard = packet::command(1, axis, self.id, words).into_bytes();
        let answer: String = answer.split_inclusive('\n').map(|l| if l.ends_with('\n') { l.to_owned() } else { line(l) }).collect();
        self.steps.push((heard, answer.replace("{id}", &id).into_bytes()));
        self.id = (self.id + 1) % 100;
        self
    }

    /// A command and the reply to it: state, flag, data.
    fn say(self, axis: u8, words: &str, reply: &str) -> Self {
        let id = self.id;
        self.raw(axis, words, &format!("@01 {axis} {id:02} OK {reply}"))
    }

    fn state(self, state: &str) -> Self {
        self.say(1, "", &format!("{state} 0"))
    }

    /// A state with a flag, and all flags, which are asked for then.
    fn flagged(self, state: &str, flags: &[&str]) -> Self {
        let all = flags.join(" ");
        self.state(&format!("{state} {}", flags[0])).say(1, "warnings", &format!("{state} {} {:02} {all}", flags[0], flags.len()))
    }

    fn get(self, setting: &str, value: i64) -> Self {
        self.say(1, &format!("get {setting}"), &format!("IDLE -- {value}"))
    }

    fn settings(self) -> Self {
        self.say(0, "set comm.checksum 1", "IDLE WR 0").get("resolution", 32).get("maxspeed", 5243).get("accel", 5).get("encoder.pos", 90)
    }

    fn opening(self) -> Self {
        self.opening_with(&["WR"])
    }

    /// Opened while these flags are set.
    fn opening_with(self, flags: &[&str]) -> Self {
        self.settings().flagged("IDLE", flags).say(0, "get system.serial", "IDLE WR 51234").say(0, "get version", "IDLE WR 7.32")
    }

    /// Opened and referenced where it stands; the encoder says 95 there.
    fn referenced() -> Self {
        Self::default()
            .opening()
            .settings()
            .flagged("IDLE", &["WR"])
            .say(1, "stop", "IDLE WR 0")
            .flagged("IDLE", &["WR"])
            .say(1, "warnings clear", "IDLE WR 0")
            .flagged("IDLE", &["WR"])
            .say(1, "set pos 0", "IDLE WH 0")
            .get("encoder.pos", 95)
            .stands(0, 95)
    }

    fn stands(self, counter: i64, encoder: i64) -> Self {
        self.flagged("IDLE", &["WH"]).get("pos", counter).get("encoder.pos", encoder)
    }

    /// A move from 0 to 1600 up to its acceptance.
    fn sent(self) -> Self {
        self.stands(0, 95).say(1, "move abs 1600", "BUSY WH 0")
    }

    fn halted(mut self) -> Self {
        self.steps.push((packet::stop(1, 1).into_bytes(), Vec::new()));
        self
    }

    fn axis(self) -> (Scripted, Zaber) {
        let controller = Scripted::play(self.steps);
        let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
        assert_eq!(zaber.reference(&CancelToken::new()).unwrap(), Achieved { steps: Steps(0), epoch: 1 });
        (controller, zaber)
    }

    fn arrives(self) {
        let (controller, mut zaber) = self.axis();
        assert_eq!(zaber.move_to(Steps(1600)).unwrap(), Achieved { steps: Steps(1600), epoch: 1 });
        controller.followed(zaber);
    }

    fn fails(self) -> DeviceError {
        let (controller, mut zaber) = self.axis();
        let error = zaber.move_to(Steps(1600)).unwrap_err();
        assert_eq!(zaber.position(), Position::Suspect { epoch: 2 });
        assert!(matches!(zaber.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
        controller.followed(zaber);
        error
    }
}

#[test]
fn a_move_is_absolute_and_believed_at_rest_by_counter_and_encoder() {
    // The encoder's own zero is where the reference found it, and 8 steps are tolerated.
    Script::referenced().sent().state("BUSY WH").stands(1600, 1695 + 8).arrives();
}

#[test]
fn the_controller_is_named_and_nothing_moves_before_the_reference() {
    let controller = Scripted::play(Script::default().opening().steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    assert_eq!(zaber.identity(), "Zaber 51234, firmware 7.32");
    assert!(zaber.capabilities().has_encoder);
    assert!(matches!(zaber.move_to(Steps(1)), Err(DeviceError::NotReferenced)));
    controller.followed(zaber);
}

#[test]
fn an_encoder_that_differs_is_a_miss_with_both_numbers() {
    let error = Script::referenced().sent().stands(1600, 1695 - 9).stands(1600, 1695 - 9).halted().fails();
    assert!(matches!(error, DeviceError::Missed { target: Steps(1600), achieved: Steps(1591) }), "{error}");
}

#[test]
fn a_flipped_bit_that_parses_is_asked_again_and_not_believed() {
    Script::referenced().sent().flagged("IDLE", &["FS"]).get("pos", 700).stands(1600, 1695).arrives();
    Script::referenced().sent().flagged("IDLE", &["WH"]).get("pos", 1600 ^ 256).stands(1600, 1695).arrives();
}

#[test]
fn flags_are_named_errors_and_a_stall_says_where() {
    let twice = |script: Script, flags: &[&str]| script.flagged("IDLE", flags).get("pos", 700).flagged("IDLE", flags).get("pos", 700);
    let stalled = twice(Script::referenced().sent(), &["FS", "WH"]).halted().fails();
    assert!(matches!(&stalled, DeviceError::Stalled { at: Steps(700), target: Steps(1600), .. }), "{stalled}");
    for (flags, word) in [
        (&["FE"][..], "limit"),
        (&["FQ"], "encoder"),
        (&["FD"], "switched off"),
        (&["WS"], "something holds the shaft"),
        (&["WR"], "restarted"),
        (&["WM"], "turned while it stood"),
        // Under the flag of a place that was taken as it is.
        (&["WH", "NI"], "NI: a move was interrupted by hand"),
        (&["FS", "WH", "NC"], "knob"),
    ] {
        let error = twice(Script::referenced().sent(), flags).halted().fails();
        assert!(error.to_string().contains(word), "{flags:?}: {error}");
    }
}

#[test]
fn a_refusal_carries_the_controllers_reason() {
    let script = Script::referenced().stands(0, 95);
    let id = script.id;
    let error = script.raw(1, "move abs 1600", &format!("@01 1 {id:02} RJ IDLE -- BADDATA")).halted().fails();
    assert!(error.to_string().contains("RJ BADDATA") && error.to_string().contains("move abs 1600"), "{error}");
}

#[test]
fn late_replies_alerts_and_information_answer_nothing() {
    let script = Script::referenced().sent().flagged("IDLE", &["WH"]);
    let id = script.id;
    // The position of an earlier question, an alert, information about this one, a reply without id: then the reply.
    let late = format!(
        "{}{}{}{}",
        line(&format!("@01 1 {:02} OK IDLE -- 7", id - 1)),
        line("!01 1 IDLE --"),
        line(&format!("#01 1 {id:02} x")),
        line("@01 1 OK IDLE -- 8")
    );
    let answer = late + &line(&format!("@01 1 {id:02} OK IDLE -- 1600"));
    script.raw(1, "get pos", &answer).get("encoder.pos", 1695).arrives();
}

/// A move from 0 to 1600 whose reply is lost.
fn lost() -> Script {
    Script::referenced().stands(0, 95).raw(1, "move abs 1600", "")
}

impl Script {
    /// A look at the state and the counter of an axis that stands.
    fn rests_at(self, counter: i64) -> Self {
        self.flagged("IDLE", &["WH"]).get("pos", counter)
    }
}

#[test]
fn what_is_lost_or_broken_is_asked_again_under_another_id() {
    let script = lost().rests_at(0).say(1, "move abs 1600", "BUSY WH 0");
    // A broken checksum, and the late reply to the first of the two.
    let id = script.id;
    let script = script.raw(1, "", &format!("@01 1 {id:02} OK IDLE WH 0:00\r\n"));
    let late = line(&format!("@01 1 {id:02} OK BUSY WH 0")) + &line(&format!("@01 1 {:02} OK IDLE WH 0", id + 1));
    script.raw(1, "", &late).say(1, "warnings", "IDLE WH 01 WH").get("pos", 1600).get("encoder.pos", 1695).arrives();
}

#[test]
fn a_motion_is_sent_again_only_to_an_axis_that_has_not_heard_it() {
    // It turns, or has already arrived.
    lost().state("BUSY WH").stands(1600, 1695).arrives();
    lost().rests_at(1600).stands(1600, 1695).arrives();
    // The second reply is lost as well, and the axis has heard that one.
    let twice = || lost().rests_at(0).raw(1, "move abs 1600", "");
    twice().state("BUSY WH").stands(1600, 1695).arrives();
    // Each attempt comes after a look of its own, and there is an end to them.
    let error = twice().rests_at(0).raw(1, "move abs 1600", "").rests_at(0).halted().fails();
    assert!(matches!(&error, DeviceError::Silent { request, waited_ms: 3000, .. } if request == "move abs 1600"), "{error}");
}

#[test]
fn a_motion_that_a_person_may_have_interrupted_is_not_sent_again() {
    // Its reply was lost; then the axis was held at once, or on its way.
    let taken = |script: Script| script.flagged("IDLE", &["WH", "NI"]).get("pos", 0);
    let error = taken(taken(lost().flagged("IDLE", &["WH", "NI"]))).halted().fails();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("NI")), "{error}");
    let error = lost().rests_at(700).rests_at(700).rests_at(700).halted().fails();
    assert!(matches!(error, DeviceError::Missed { target: Steps(1600), achieved: Steps(700) }), "{error}");
}

#[test]
fn a_homing_whose_reply_is_lost_is_not_sent_to_an_axis_that_homes() {
    let before = || {
        let script = Script::default().opening().settings().flagged("IDLE", &["WR"]).say(1, "stop", "IDLE WR 0");
        script.flagged("IDLE", &["WR"]).say(1, "warnings clear", "IDLE WR 0").flagged("IDLE", &["WR"]).raw(1, "home", "")
    };
    let after = |script: Script| script.state("IDLE --").get("encoder.pos", 95).state("IDLE --").get("pos", 0).get("encoder.pos", 95);
    // It was heard; or it was not, and the reply to the second one is lost.
    for script in [before(), before().flagged("IDLE", &["WR"]).raw(1, "home", "")] {
        let controller = Scripted::play(after(script.state("BUSY --")).steps);
        let mut zaber = Zaber::open(ZaberSettings { reference: Reference::Home, ..settings(&controller.port()) }).unwrap();
        zaber.reference(&CancelToken::new()).unwrap();
        controller.followed(zaber);
    }
}

#[test]
fn settings_that_differ_are_all_listed() {
    let script =
        Script::default().say(0, "set comm.checksum 1", "IDLE -- 0").get("resolution", 64).get("resolution", 64).get("maxspeed", 5243);
    let controller = Scripted::play(script.get("accel", 205).get("accel", 205).get("encoder.pos", 0).steps);
    let error = Zaber::open(settings(&controller.port())).err().unwrap();
    let text = error.to_string();
    assert!(matches!(&error, DeviceError::Mismatch { differences, .. } if differences.len() == 2), "{text}");
    for part in ["resolution", "configured 32", "found 64", "accel", "found 205"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    controller.followed(());
}

#[test]
fn a_stop_reaches_the_wire_while_an_answer_is_awaited() {
    let script = Script::referenced().sent().raw(1, "", "");
    let waiting = script.steps.len() - 1;
    // Then the controller is asked whether it is there; the flag of the stop is this program's own.
    let mut script = script.halted().halted();
    // Replies that nobody waits for any more: to the state that was asked for, and to the stop.
    let late = format!("@01 1 {:02} OK BUSY WH 0", script.id - 1);
    script.steps.last_mut().unwrap().1 = [line(&late), line("@01 1 OK BUSY NI 0")].concat().into_bytes();
    let script = script.say(1, "warnings", "IDLE WH 02 WH NI");
    let controller = Scripted::play(script.steps);
    // An answer time of minutes: only the stop can end this move in time.
    let mut zaber = Zaber::open(ZaberSettings { answer_timeout_ms: 600_000, ..settings(&controller.port()) }).unwrap();
    zaber.reference(&CancelToken::new()).unwrap();
    let stop = zaber.stop_handle();
    let mut zaber = std::thread::scope(|scope| {
        let moving = scope.spawn(|| {
            let error = zaber.move_to(Steps(1600)).unwrap_err();
            assert!(matches!(error, DeviceError::Stopped), "{error}");
            zaber
        });
        controller.await_step(waiting);
        stop.stop();
        moving.join().unwrap()
    });
    assert_eq!(zaber.position(), Position::Suspect { epoch: 2 });
    zaber.check().unwrap();
    controller.followed(zaber);
}

#[test]
fn an_axis_that_somebody_has_is_not_turned_by_the_first_reference() {
    let script = Script::default().opening().settings().flagged("BUSY", &["WR", "NC"]);
    let controller = Scripted::play(script.steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    let error = zaber.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("knob")), "{error}");
    controller.followed(zaber);
}

#[test]
fn an_axis_that_somebody_has_is_opened_and_the_check_tells_of_it() {
    for (flags, word) in [(&["FH", "WR"][..], "FH: the hardware emergency stop"), (&["NC", "NI"], "NC: the axis was turned with")] {
        let all = format!("IDLE {} {:02} {}", flags[0], flags.len(), flags.join(" "));
        // Asked twice, told once; nothing but questions is sent.
        let script = Script::default().opening_with(flags).say(1, "warnings", &all).say(1, "warnings", &all);
        let controller = Scripted::play(script.steps);
        let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
        assert_eq!((zaber.position(), zaber.identity()), (Position::Unknown, "Zaber 51234, firmware 7.32"));
        let error = zaber.check().unwrap_err();
        assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(word)), "{error}");
        zaber.check().unwrap();
        assert_eq!(zaber.position(), Position::Unknown);
        controller.followed(zaber);
    }
}

#[test]
fn a_move_that_was_interrupted_before_the_port_was_opened_is_a_stop_of_the_driver_before() {
    let script = Script::default().opening_with(&["NI"]).say(1, "warnings", "IDLE NI 01 NI");
    let controller = Scripted::play(script.steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    zaber.check().unwrap();
    controller.followed(zaber);
}

#[test]
fn a_fault_that_stays_after_it_was_cleared_refuses_the_reference() {
    let flags = ["FN", "WR"];
    let script = Script::default().opening().settings().flagged("IDLE", &flags).say(1, "stop", "IDLE FN 0").flagged("IDLE", &flags);
    let controller = Scripted::play(script.say(1, "warnings clear", "IDLE FN 0").flagged("IDLE", &flags).steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    let error = zaber.reference(&CancelToken::new()).unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.contains("peripheral is not supported")), "{error}");
    controller.followed(zaber);
}

#[test]
fn a_controller_that_has_forgotten_its_checksums_was_restarted() {
    let script = Script::referenced();
    let id = script.id;
    let bare = |id| format!("@01 1 {id:02} OK IDLE -- 0\r\n");
    let error = script.raw(1, "", &bare(id)).raw(1, "", &bare(id + 1)).fails();
    assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains("reset, but not by carved")), "{error}");
}

#[test]
fn a_restart_at_rest_is_reported_once_by_a_check_or_by_the_next_reference() {
    let restarted = "IDLE WR 02 WR WH";
    let is_told = |error: &DeviceError| matches!(error, DeviceError::Intervention { what, .. } if what.contains("it reports WR"));
    let controller = Scripted::play(Script::referenced().say(1, "warnings", restarted).say(1, "warnings", restarted).steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    zaber.reference(&CancelToken::new()).unwrap();
    let error = zaber.check().unwrap_err();
    assert!(is_told(&error), "{error}");
    assert_eq!(zaber.position(), Position::Suspect { epoch: 2 });
    zaber.check().unwrap();
    controller.followed(zaber);

    let controller = Scripted::play(Script::referenced().settings().flagged("IDLE", &["WR", "WH"]).steps);
    let mut zaber = Zaber::open(settings(&controller.port())).unwrap();
    zaber.reference(&CancelToken::new()).unwrap();
    let error = zaber.reference(&CancelToken::new()).unwrap_err();
    assert!(is_told(&error), "{error}");
    controller.followed(zaber);
}

/// Opening waits for a controller that moves, and refuses one with other settings.
#[test]
fn the_stop_is_written_without_a_question() {
    let controller = Scripted::play(vec![(packet::stop(1, 1).into_bytes(), Vec::new())]);
    crate::rotation::driver::Driver::stop(&settings(&controller.port())).unwrap();
    controller.followed(());
}
