//! Tests of the firmware without a serial port: lines in, lines out.

use super::{Firmware, Settings};
use crate::clock::RigClock;
use crate::motor_faults::MotorFaults;
use crate::outputs::{OutputPin, Outputs};
use crate::serial::Firmware as _;
use crate::shaft::{Shaft, ShaftSettings};
use std::sync::Arc;

/// Later than the end of any move, rig seconds.
const LATER_S: f64 = 1000.0;

struct Bench {
    firmware: Firmware,
    shaft: Arc<Shaft>,
    faults: Arc<MotorFaults>,
    outputs: Arc<Outputs>,
}

impl Bench {
    fn new(settings: Settings) -> Self {
        let shaft = ShaftSettings { steps_per_revolution: (6400, 1), index_steps: 0, power_on_steps: 137 };
        let shaft = Arc::new(Shaft::new(RigClock::new(1.0), shaft));
        let faults = Arc::new(MotorFaults::default());
        let outputs = Arc::new(Outputs::default());
        Self { firmware: Firmware::new(Arc::clone(&shaft), Arc::clone(&faults), Arc::clone(&outputs), settings), shaft, faults, outputs }
    }

    fn homed() -> Self {
        let mut bench = Self::new(Settings::default());
        bench.ask("/1 1 home", 0.0);
        assert_eq!(bench.ask("/1 1 get pos", LATER_S), "@01 1 OK IDLE -- 0");
        bench
    }

    fn ask(&mut self, line: &str, now_s: f64) -> String {
        self.firmware.advance(now_s);
        self.firmware.receive(format!("{line}\n").as_bytes(), now_s);
        String::from_utf8(self.firmware.take_output()).unwrap().trim_end().to_owned()
    }
}

#[test]
fn the_published_exchange_is_answered_as_published() {
    let mut bench = Bench::new(Settings::default());
    bench.ask("/1 0 set comm.checksum 1", 0.0);
    assert_eq!(bench.ask("/1 1 06 move rel 32000:A9", 0.0), "@01 1 06 OK BUSY WR 0:92");
    assert_eq!(bench.ask("/1 1 06 move rel 32000:A8", 0.0), "", "a line with a wrong checksum is ignored");
    assert_eq!(bench.ask("xx/1 1 07", LATER_S).split(':').next().unwrap(), "@01 1 07 OK IDLE WR 0");
}

#[test]
fn homing_gives_a_reference_and_a_restart_loses_it() {
    let mut bench = Bench::homed();
    bench.ask("/1 1 move abs 1600", LATER_S);
    let quarter = std::f64::consts::FRAC_PI_2;
    assert!((bench.shaft.angle_at_rad(2.0 * LATER_S) - quarter).abs() < 1e-9);
    assert_eq!(bench.ask("/1 1 get encoder.pos", 2.0 * LATER_S), "@01 1 OK IDLE -- 1600");
    bench.firmware.lose_power(2.0 * LATER_S);
    bench.firmware.boot();
    assert_eq!(bench.ask("/1 1 get pos", 2.0 * LATER_S), "@01 1 OK IDLE WR 0");
    assert_eq!(bench.ask("/1 1 set pos 5", 2.0 * LATER_S), "@01 1 OK IDLE WH 0");
}

#[test]
fn lost_steps_show_at_the_encoder_alone() {
    let mut bench = Bench::homed();
    bench.shaft.lose_steps(50);
    bench.ask("/1 1 move abs 1600", LATER_S);
    assert_eq!(bench.ask("/1 1 get pos", 2.0 * LATER_S), "@01 1 OK IDLE -- 1600");
    assert_eq!(bench.ask("/1 1 get encoder.pos", 2.0 * LATER_S), "@01 1 OK IDLE -- 1550");
}

#[test]
fn stalls_limits_stops_and_manual_moves_set_flags_until_the_next_move() {
    let mut bench = Bench::homed();
    let mut now_s = LATER_S;
    for (flag, trouble) in [("FS", 0), ("FE", 1)] {
        if trouble == 0 {
            bench.faults.stall_after(0, 300);
        } else {
            bench.faults.limit_after(0, 300);
        }
        bench.ask("/1 1 move rel 1600", now_s);
        now_s += LATER_S;
        assert_eq!(bench.ask("/1 1", now_s), format!("@01 1 OK IDLE {flag} 0"));
    }
    assert_eq!(bench.ask("/1 1 move abs 0", now_s), "@01 1 OK BUSY -- 0");
    assert_eq!(bench.ask("/1 1 stop", now_s + 0.05), "@01 1 OK BUSY NI 0");
    now_s += LATER_S;
    bench.ask("/1 1 warnings clear", now_s);
    bench.shaft.push(60);
    assert_eq!(bench.ask("/1 1", now_s), "@01 1 OK IDLE WM 0");
}

#[test]
fn refusals_give_a_reason_and_alerts_are_sent_without_a_request() {
    let mut bench = Bench::homed();
    for (line, reason) in
        [("/1 1 move abs far", "BADDATA"), ("/1 1 dance", "BADCOMMAND"), ("/1 3 home", "BADAXIS"), ("/1 1 get version", "DEVICEONLY")]
    {
        assert!(bench.ask(line, LATER_S).ends_with(&format!("RJ IDLE -- {reason}")), "{line}");
    }
    bench.ask("/1 0 set comm.alert 1", LATER_S);
    bench.ask("/1 1 move abs 64", LATER_S);
    assert_eq!(bench.ask("/1 1", 2.0 * LATER_S), "!01 1 IDLE --\r\n@01 1 OK IDLE -- 0");
    assert_eq!(bench.ask("/7 1", 2.0 * LATER_S), "", "for another device");
}

#[test]
fn outputs_are_switched_and_read_by_channel_and_a_restart_switches_them_off() {
    let mut bench = Bench::new(Settings::default());
    let said = |answer: String| answer.split(' ').skip(2).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(said(bench.ask("/1 0 io set do 2 1", 0.0)), ["OK", "IDLE", "WR", "0"]);
    assert_eq!(said(bench.ask("/1 0 io get do 2", 0.0))[3], "1");
    assert_eq!(said(bench.ask("/1 0 io get do 1", 0.0))[3], "0");
    for (refused, reason) in [("/1 0 io set do 5 1", "BADDATA"), ("/1 0 io set do 1 7", "BADDATA"), ("/1 1 io set do 1 1", "DEVICEONLY")] {
        assert_eq!(said(bench.ask(refused, 0.0)), ["RJ", "IDLE", "WR", reason], "{refused}");
    }
    bench.outputs.refuse(OutputPin::Number(1), true);
    assert_eq!(said(bench.ask("/1 0 io set do 1 1", 0.0))[0], "RJ");
    bench.ask("/1 0 system reset", 0.0);
    assert_eq!(bench.outputs.switched(), [(OutputPin::Number(2), true), (OutputPin::Number(2), false)]);
}
