//! Scripted dialogues. The test sets the rig time, so nothing waits.

// Whole steps and their printed values are exact, and these tests check that.
#![allow(clippy::float_cmp)]

use super::*;
use crate::clock::RigClock;
use crate::serial::Firmware as _;
use crate::shaft::ShaftSettings;
use std::f64::consts::TAU;

struct Bench {
    firmware: Firmware,
    shaft: Arc<Shaft>,
    faults: Arc<SerialFaults>,
    now_s: f64,
}

impl Bench {
    fn new() -> Self {
        Self::of(Dialect::Grbl)
    }

    fn of(dialect: Dialect) -> Self {
        let shaft = Arc::new(Shaft::new(RigClock::new(1.0), ShaftSettings::default()));
        let faults = Arc::new(SerialFaults::default());
        let mut firmware = Firmware::new(Arc::clone(&shaft), None, Arc::clone(&faults), Settings::default(), dialect);
        firmware.boot();
        Self { firmware, shaft, faults, now_s: 0.0 }
    }

    /// A controller that has booted and was unlocked without homing. Its messages were read.
    fn unlocked() -> Self {
        let mut bench = Self::new();
        bench.say("$X\n");
        bench
    }

    /// Sends a text. Returns what comes back without any delay.
    fn say(&mut self, text: &str) -> String {
        self.send(text.as_bytes())
    }

    fn send(&mut self, bytes: &[u8]) -> String {
        self.firmware.advance(self.now_s);
        self.firmware.receive(bytes, self.now_s);
        self.heard()
    }

    fn after(&mut self, seconds: f64) -> String {
        self.now_s += seconds;
        self.firmware.advance(self.now_s);
        self.heard()
    }

    fn heard(&mut self) -> String {
        String::from_utf8(self.firmware.take_output()).unwrap()
    }

    fn state(&mut self) -> String {
        self.say("?").split(['<', '|']).nth(1).unwrap_or_default().to_owned()
    }

    fn x(&mut self) -> f64 {
        let report = self.say("?");
        let at = report.find("MPos:").unwrap() + 5;
        report[at..].split(',').next().unwrap().parse().unwrap()
    }

    /// The true position of the shaft, rounded to 1e-9 steps. The conversion through radians is not exact in the last bits.
    fn shaft_steps(&self) -> f64 {
        (self.shaft.angle_at_rad(self.now_s) / TAU * 500.0 * 1e9).round() / 1e9
    }
}

#[test]
fn a_fresh_board_with_a_switch_greets_and_is_locked() {
    let mut b = Bench::new();
    assert_eq!(b.heard(), "\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");
    assert_eq!(b.state(), "Alarm");
    assert_eq!(b.say("G0X1\n"), "error:9\r\n");
    assert_eq!(b.say("$X\n"), "[MSG:Caution: Unlocked]\r\nok\r\n");
    assert_eq!(b.state(), "Idle");
}

#[test]
fn ok_means_queued_and_g4_means_arrived() {
    let mut b = Bench::unlocked();
    assert_eq!(b.say("G91 G1 X5 F300\n"), "ok\r\n");
    assert_eq!(b.state(), "Run");
    assert_eq!(b.say("G4 P0.01\n"), "", "no answer before the planner has drained");
    assert_eq!(b.after(0.3), "");
    assert!(b.x() > 0.0 && b.x() < 5.0);
    assert_eq!(b.after(2.0), "ok\r\n");
    assert_eq!((b.x(), b.state()), (5.0, "Idle".to_owned()));
    assert_eq!(b.shaft_steps(), 137.0 + 500.0);
}

#[test]
fn a_dwell_is_rounded_up_to_50_ms_and_a_dwell_of_0_does_not_wait() {
    let mut b = Bench::unlocked();
    assert_eq!(b.say("G4 P0.01\n"), "");
    assert_eq!(b.after(0.049), "");
    assert_eq!(b.after(0.002), "ok\r\n");
    assert_eq!(b.say("G4 P0\n") + &b.after(0.001), "ok\r\n");
}

#[test]
fn homing_finds_the_index_and_sets_the_position_as_grbl_does() {
    let mut b = Bench::new();
    b.heard();
    assert_eq!(b.say("$H\n"), "");
    assert_eq!(b.state(), "Home");
    assert_eq!(b.after(10.0), "ok\r\n");
    assert_eq!(b.x(), -0.05, "minus the pull-off");
    assert!((b.shaft_steps() + 5.0).abs() < 1e-9, "angles count from the index, not from power-on");
    b.say("G90 G0 X0\n");
    b.after(1.0);
    assert!(b.shaft_steps().abs() < 1e-9);
    let report = b.say("?");
    assert!(report.contains("|Pn:X"), "the reference switch is pressed: {report}");

    b.say("$23=1\n");
    b.say("$H\n");
    assert_eq!(b.after(10.0), "ok\r\n");
    assert_eq!(b.x(), -9.95, "minus the travel plus the pull-off");
    assert!((b.shaft_steps() - 5.0).abs() < 1e-9);
}

#[test]
fn homing_without_a_switch_in_reach_alarms() {
    let mut b = Bench::new();
    b.say("$130=1\n");
    b.heard();
    // 363 steps to the index, 1.5 units of 100 steps are searched.
    assert!(b.say("$H\n").starts_with("ALARM:9\r\n"));
    assert_eq!(b.state(), "Alarm");
    b.say("$22=0\n");
    assert_eq!(b.say("$H\n"), "error:5\r\n");
}

#[test]
fn lines_have_80_bytes_and_the_receive_buffer_128() {
    let mut b = Bench::unlocked();
    let line = |n: usize| format!("G91{}\n", "G91".repeat(n)).replace("G91G91", "G91");
    assert_eq!(b.say(&line(1)), "ok\r\n");
    assert_eq!(b.say(&format!("({})G91 {}\n", "c".repeat(200), " ".repeat(200))), "ok\r\n", "comments and blanks are not stored");
    assert_eq!(b.say(&format!("X{}\n", "1".repeat(79))), "error:11\r\n");
    assert_eq!(b.say("\n"), "ok\r\n");

    b.say("G4 P1\n");
    // 20 lines of 18 bytes during a dwell. 7 complete lines fit into 128 bytes, and the rest is lost without a message.
    let flood = (0..20).map(|i| format!("G91 G1 X0.01 F{i:03}\n")).collect::<Vec<_>>().concat();
    assert_eq!(flood.len(), 20 * 18);
    assert_eq!(b.say(&flood), "");
    let answers = b.after(5.0);
    assert_eq!(answers.matches("ok").count() + answers.matches("error").count(), 1 + 7, "{answers}");
}

#[test]
fn the_planner_takes_15_blocks_and_answers_the_next_when_one_is_done() {
    let mut b = Bench::unlocked();
    for i in 0..15 {
        assert_eq!(b.say("G91 G1 X1 F60\n"), "ok\r\n", "block {i}");
    }
    assert_eq!(b.say("G91 G1 X1 F60\n"), "");
    assert_eq!(b.after(1.2), "ok\r\n", "1 unit at 1 unit/s, and its ramps");
    b.after(60.0);
    assert_eq!(b.x(), 16.0);
}

#[test]
fn settings_read_back_with_three_decimals() {
    let mut b = Bench::unlocked();
    assert_eq!(b.say("$101=17.777778\n"), "ok\r\n");
    let all = b.say("$$\n");
    assert!(all.contains("$101=17.778\r\n") && all.contains("$100=100.000\r\n") && all.contains("$22=1\r\n"), "{all}");
    assert!(all.ends_with("$132=10.000\r\nok\r\n"));
    for (line, answer) in [
        ("$100=-1\n", "error:4\r\n"),
        ("$77=1\n", "error:3\r\n"),
        ("$100=x\n", "error:2\r\n"),
        ("$100\n", "error:3\r\n"),
        ("$0=2\n", "error:6\r\n"),
    ] {
        assert_eq!(b.say(line), answer, "{line}");
    }
    b.say("G91 G0 X1\n");
    assert_eq!(b.say("$$\n"), "error:8\r\n", "not while it moves");
    b.after(9.0);
    b.firmware.lose_power(b.now_s);
    b.firmware.boot();
    assert!(b.say("$$\n").contains("$101=17.778"), "the EEPROM keeps them");
}

#[test]
fn a_reset_in_motion_alarms_and_keeps_its_count() {
    let mut b = Bench::unlocked();
    b.say("G91 G1 X5 F300\n");
    b.after(0.5);
    let said = b.send(&[0x18]);
    assert!(said.starts_with("ALARM:3\r\n\r\nGrbl 1.1h"), "{said}");
    assert_eq!(b.state(), "Alarm");
    let x = b.x();
    assert!(x > 0.0 && x < 5.0);
    assert!((b.shaft_steps() - 137.0 - 100.0 * x).abs() < 1e-6);
    assert_eq!(b.after(5.0), "");
    assert_eq!(b.x(), x, "the move does not continue");
    b.say("$X\n");
    b.say("G0 X0\n");
    b.after(5.0);
    assert_eq!(b.x(), 0.0, "a reset restores G90");
}

#[test]
fn a_reset_at_rest_only_greets() {
    let mut b = Bench::unlocked();
    assert_eq!(b.send(&[0x18]), "\r\nGrbl 1.1h ['$' for help]\r\n");
    assert_eq!(b.state(), "Idle");
}

#[test]
fn losing_power_in_motion_is_silent_and_counts_from_zero() {
    let mut b = Bench::unlocked();
    b.say("G91 G1 X5 F300\n");
    b.after(0.5);
    b.firmware.lose_power(b.now_s);
    b.firmware.boot();
    assert!(!b.heard().contains("ALARM"));
    assert_eq!(b.x(), 0.0);
    assert!(b.shaft_steps() > 138.0, "the shaft stands where it was stopped");
}

#[test]
fn hold_slows_down_and_resume_ends_the_move_on_its_step() {
    let mut b = Bench::unlocked();
    b.say("G91 G1 X5 F300\n");
    b.after(0.6);
    let before = b.shaft_steps();
    b.say("!");
    assert_eq!(b.state(), "Hold:1");
    assert!((b.shaft_steps() - before).abs() < 1e-6, "braking does not jump");
    b.after(3.0);
    assert_eq!(b.state(), "Hold:0");
    // From 5 units/s at 20 units/s^2 the axis needs 0.625 units to stop.
    assert!((b.shaft_steps() - before - 62.5).abs() <= 1.0);
    assert_eq!(b.say("$G\n"), "", "held lines wait");
    let said = b.say("~");
    assert!(said.starts_with("[GC:G1 "), "{said}");
    b.after(5.0);
    assert_eq!((b.x(), b.state()), (5.0, "Idle".to_owned()));
    assert_eq!(b.shaft_steps(), 637.0);
}

#[test]
fn a_cancelled_jog_stops_short_and_is_idle() {
    let mut b = Bench::unlocked();
    assert_eq!(b.say("$J=G91X50F300\n"), "ok\r\n");
    assert_eq!(b.state(), "Jog");
    assert_eq!(b.say("G0X1\n"), "error:9\r\n");
    b.after(1.0);
    b.send(&[0x85]);
    b.after(2.0);
    assert_eq!(b.state(), "Idle");
    let x = b.x();
    assert!(x > 1.0 && x < 10.0);
    b.say("G91G0X1\n");
    b.after(2.0);
    assert!((b.x() - x - 1.0).abs() < 5e-4, "the parser knows where the jog ended");
}

#[test]
fn after_a_hard_limit_only_a_reset_is_accepted() {
    let mut b = Bench::unlocked();
    b.say("$21=1\n");
    b.say("G91 G1 X5 F300\n");
    assert_eq!(b.after(5.0), "ALARM:1\r\n[MSG:Reset to continue]\r\n");
    assert_eq!(b.shaft_steps(), 500.0, "stopped at the switch");
    assert_eq!(b.say("?$X\n"), "");
    let said = b.send(&[0x18]);
    assert!(said.starts_with("\r\nGrbl") && said.contains("to unlock"), "{said}");
    assert_eq!(b.state(), "Alarm");
}

#[test]
fn a_soft_limit_alarms_before_it_moves_and_a_jog_is_refused() {
    let mut b = Bench::new();
    b.say("$H\n");
    b.after(10.0);
    assert_eq!(b.say("$20=1\n"), "ok\r\n");
    assert_eq!(b.say("$J=G90X1F100\n"), "error:15\r\n");
    let before = b.shaft_steps();
    assert_eq!(b.say("G90 G0 X1\n"), "ALARM:2\r\n[MSG:Reset to continue]\r\n");
    assert_eq!(b.shaft_steps(), before);
}

#[test]
fn only_some_reports_have_the_optional_fields() {
    let mut b = Bench::unlocked();
    b.send(&[0x18]);
    b.heard();
    let reports: Vec<String> = (0..22).map(|_| b.say("?")).collect();
    let with = |field: &str| reports.iter().enumerate().filter(|(_, r)| r.contains(field)).map(|(i, _)| i).collect::<Vec<_>>();
    assert_eq!(with("|WCO:"), [0, 10, 20]);
    assert_eq!(with("|Ov:"), [1, 11, 21]);
    assert_eq!(reports[5], "<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
    assert!(b.say("G92X1\n?").contains("|WCO:-1.000,"), "a changed offset is in the next report");
}

#[test]
fn lost_steps_and_lost_oks_are_silent() {
    let mut b = Bench::unlocked();
    b.faults.drop_oks(1);
    b.shaft.lose_steps(50);
    assert_eq!(b.say("G91 G0 X8\n"), "");
    b.after(10.0);
    assert_eq!(b.x(), 8.0);
    assert_eq!(b.shaft_steps(), 137.0 + 750.0);
    assert_eq!(b.say("\n"), "ok\r\n");
}

/// Every whole step of three revolutions is exact in the printed position, so that a driver may test for equality.
#[test]
fn whole_steps_are_exact_with_three_decimals() {
    let mut b = Bench::unlocked();
    for step in [1_i64, 6, 7, 499, 500, 1499, -3, -1500] {
        let units = step as f64 / 100.0;
        b.say(&format!("G90 G0 X{units:.3}\n"));
        b.after(20.0);
        assert_eq!((b.x() * 100.0).round() as i64, step);
        assert_eq!(b.shaft_steps(), 137.0 + step as f64);
    }
}

#[test]
fn bytes_that_do_not_fit_into_the_receive_buffer_are_lost_and_counted() {
    let mut b = Bench::unlocked();
    let flood = "G1X1F100\n".repeat(20);
    b.say("G4P10\n");
    let ok = b.say(&flood) + &b.after(60.0);
    assert_eq!(b.faults.lost_bytes(), flood.len() as u64 - 128);
    // One for the dwell, and one for each line that fitted.
    assert!(ok.matches("ok\r\n").count() <= 16, "{ok}");
}

#[test]
fn an_erased_memory_is_reported_at_the_start_and_gives_the_factory_settings() {
    let mut b = Bench::new();
    b.faults.erase_memory();
    b.firmware.lose_power(0.0);
    b.firmware.boot();
    let said = b.heard();
    assert!(said.contains("error:7\r\n") && said.contains("$100=250.000") && said.ends_with("help]\r\n"), "{said}");
    assert_eq!(b.say("$H\n"), "error:5\r\n");
}

#[test]
fn grblhal_repeats_its_last_error_until_an_empty_line_a_command_or_a_reset() {
    for cure in ["\n", "$G\n", "\x18"] {
        let mut b = Bench::of(Dialect::GrblHal);
        b.say("$X\n");
        assert_eq!(b.say("G1Q1\n"), b.say("G0X1\n"), "the same error");
        assert_eq!(b.say("G0X1\n"), "error:20\r\n");
        b.say(cure);
        b.say("$X\n");
        assert_eq!(b.say("G0X1\n"), "ok\r\n", "after {cure:?}");
    }
    let mut grbl = Bench::unlocked();
    grbl.say("G1Q1\n");
    assert_eq!(grbl.say("G0X1\n"), "ok\r\n");
}

#[test]
fn grblhal_has_full_reports_and_reports_changed_modes_without_a_request() {
    let mut b = Bench::of(Dialect::GrblHal);
    b.say("$X\n");
    assert!(b.send(&[0x87]).contains("|H:0"), "not homed yet");
    b.say("$H\n");
    b.after(60.0);
    assert!(b.send(&[0x87]).contains("|WCO:0.000,0.000,0.000") && b.send(&[0x87]).contains("|H:1>"));
    b.say("G91\n");
    let said = b.say("?");
    assert!(said.starts_with("[GC:") && said.contains("\r\n<Idle|"), "{said}");
    assert!(b.say("?").starts_with("<Idle|"), "they are reported once");
    assert_eq!(Bench::unlocked().send(&[0x87]), "", "Grbl drops the byte");
}

impl Bench {
    fn button(&mut self, button: Button, pressed: bool) -> String {
        self.firmware.advance(self.now_s);
        self.firmware.button(button, pressed, self.now_s);
        self.heard()
    }
}

#[test]
fn an_open_door_stops_the_axis_until_it_is_closed_and_cycle_start_is_pressed() {
    let mut b = Bench::unlocked();
    b.say("G91 G1 X5 F300\n");
    b.after(0.5);
    b.button(Button::Door, true);
    assert_eq!(b.state(), "Door:2");
    b.after(3.0);
    assert_eq!(b.state(), "Door:1");
    assert!(b.say("?").contains("|Pn:D"));
    assert_eq!(b.say("G4 P0\n"), "", "no line is executed");
    b.button(Button::CycleStart, true);
    assert_eq!(b.state(), "Door:1");
    b.button(Button::Door, false);
    assert_eq!(b.state(), "Door:0");
    assert_eq!(b.say("!") + &b.after(1.0), "", "a hold changes nothing");
    b.button(Button::CycleStart, true);
    assert_eq!(b.after(5.0), "ok\r\n");
    assert_eq!((b.x(), b.state()), (5.0, "Idle".to_owned()));
    b.button(Button::Door, true);
    assert_eq!(b.send(&[0x18]), "\r\nGrbl 1.1h ['$' for help]\r\n");
    assert_eq!(b.state(), "Door:1", "a reset does not close it");
}

#[test]
fn a_door_that_opens_during_homing_ends_it_and_keeps_the_axis_locked() {
    let mut b = Bench::new();
    b.say("$H\n");
    b.after(0.1);
    b.heard();
    assert!(b.button(Button::Door, true).starts_with("ALARM:7\r\n"));
    assert_eq!((b.say("$X\n"), b.say("$H\n")), ("error:13\r\n".to_owned(), "error:13\r\n".to_owned()));
    assert_eq!(b.state(), "Alarm");
}

#[test]
fn a_feed_hold_button_holds_and_is_reported_while_it_is_pressed() {
    let mut b = Bench::unlocked();
    b.button(Button::FeedHold, true);
    assert_eq!(b.state(), "Hold:0");
    assert!(b.say("?").contains("|Pn:H"));
    b.button(Button::FeedHold, false);
    b.button(Button::CycleStart, true);
    assert_eq!(b.state(), "Idle");
}

#[test]
fn an_emergency_stop_of_grblhal_lasts_until_it_is_released_and_reset() {
    let mut b = Bench::of(Dialect::GrblHal);
    b.say("$X\n");
    b.say("G91 G1 X5 F300\n");
    b.after(0.5);
    assert!(b.button(Button::EmergencyStop, true).starts_with("ALARM:10\r\n"));
    let stands = b.shaft_steps();
    assert!(b.say("?").contains("<Alarm|") && b.say("?").contains("|Pn:E"));
    assert!(b.send(&[0x87]).contains("<Alarm:10|"));
    assert!(b.send(&[0x18]).starts_with("ALARM:10\r\n"), "no greeting");
    b.button(Button::EmergencyStop, false);
    assert!(b.send(&[0x18]).contains("GrblHAL 1.1f"));
    assert_eq!(b.state(), "Alarm");
    assert_eq!(b.shaft_steps(), stands);
}

#[test]
fn check_mode_moves_nothing_and_sleep_lasts_until_a_reset() {
    let mut b = Bench::unlocked();
    b.say("$C\n");
    assert_eq!(b.state(), "Check");
    assert_eq!(b.say("G91 G1 X5 F300\n"), "ok\r\n");
    b.after(5.0);
    assert_eq!(b.x(), 0.0);
    assert!(b.say("$C\n").contains("Grbl 1.1h"));
    b.say("$SLP\n");
    assert_eq!((b.state(), b.say("$$\n")), ("Sleep".to_owned(), String::new()));
    b.send(&[0x18]);
    assert_eq!(b.state(), "Alarm");
}

/// `$1` is the time for which the motors keep their current after a move. 255 means always.
#[test]
fn motors_that_lose_their_current_let_a_hose_turn_the_capillary() {
    for (idle_ms, slips) in [(255, 0.0), (25, 3.0)] {
        let mut b = Bench::unlocked();
        b.say(&format!("$1={idle_ms}\n"));
        b.shaft.pull_when_released(3);
        b.say("G91 G1 X1 F300\n");
        b.after(5.0);
        assert_eq!((b.x(), b.shaft_steps()), (1.0, 237.0 + slips), "$1={idle_ms}");
    }
}

#[test]
fn m9_ends_both_coolants_and_every_reset_ends_all_outputs() {
    use OutputPin::{Flood, Mist, Spindle};
    let mut bench = Bench::unlocked();
    let outputs = Arc::clone(&bench.firmware.outputs);
    assert_eq!(bench.say("M7\nM8\nM3S1000\n"), "ok\r\nok\r\nok\r\n");
    assert!([Mist, Flood, Spindle].iter().all(|pin| outputs.is_on(*pin)));
    assert!(bench.say("$G\n").contains(" M3 M7 M8 T0 F0 S1000]"));
    let reports: String = (0..20).map(|_| bench.say("?")).collect();
    assert!(reports.contains("|Ov:100,100,100|A:SFM"), "{reports}");
    assert_eq!(bench.say("M9\nM5\n"), "ok\r\nok\r\n");
    assert!(![Mist, Flood, Spindle].iter().any(|pin| outputs.is_on(*pin)));
    assert_eq!(bench.say("M7M8\n"), "error:21\r\n", "they are of one group");
    bench.say("M8\nM3S1000\n");
    bench.send(b"\x18");
    assert!(!outputs.is_on(Flood) && !outputs.is_on(Spindle) && bench.say("$G\n").contains(" M5 M9 "));
}

#[test]
fn an_output_that_is_not_built_in_refuses_and_a_laser_is_off_without_a_motion() {
    let mut bench = Bench::unlocked();
    let outputs = Arc::clone(&bench.firmware.outputs);
    outputs.refuse(OutputPin::Mist, true);
    assert_eq!(bench.say("M7\n"), "error:20\r\n");
    assert!(bench.say("$G\n").contains(" M9 "));
    bench.say("$32=1\nM3S1000\n");
    assert!(!outputs.is_on(OutputPin::Spindle));
}

/// Another program leaves inches, relative positions, inverse time and a tenth of the speed. A line with its own modes, after the byte that
/// resets the override, moves at its own feed all the same: 60 units/min are 0.4 s for 0.4 units.
#[test]
fn a_line_with_its_own_modes_moves_at_its_own_feed() {
    let moves_in_s = |line: &[u8]| {
        let mut b = Bench::unlocked();
        assert_eq!(b.say("G20G91\nG93\n"), "ok\r\nok\r\n");
        b.send(&[0x92; 9]);
        assert_eq!(b.send(line), "ok\r\n");
        b.send(b"G4P0\n");
        let mut waited_s = 0.0;
        while b.after(0.1).is_empty() {
            waited_s += 0.1;
        }
        assert_eq!(b.x(), 0.4);
        waited_s
    };
    let own = moves_in_s(b"\x90G21G90G94G53G1X0.4F60\n");
    assert!((0.3..0.6).contains(&own), "{own}");
    assert!(moves_in_s(b"G21G90G94G53G1X0.4F60\n") > 3.0, "a tenth of the speed");
    assert!(moves_in_s(b"\x90G21G90G53G1X0.4F60\n") > 0.8, "60 moves in a minute");
}

#[test]
fn overrides_are_reported_and_end_with_a_reset() {
    let mut b = Bench::unlocked();
    b.say("?");
    b.send(&[0x92, 0x94, 0x9a, 0x9c]);
    let reported = |b: &mut Bench| (0..20).map(|_| b.say("?")).find(|report| report.contains("Ov:")).unwrap();
    assert!(reported(&mut b).contains("|Ov:89,100,111"));
    b.send(&[0x91; 20]);
    assert!(reported(&mut b).contains("|Ov:200,100,111"));
    b.send(&[0x90]);
    assert!(reported(&mut b).contains("|Ov:100,100,111"));
    b.send(&[0x99]);
    assert!(reported(&mut b).contains("|Ov:100,100,100"));
    b.send(&[0x92, 0x18]);
    assert!(reported(&mut b).contains("|Ov:100,100,100"));
}
