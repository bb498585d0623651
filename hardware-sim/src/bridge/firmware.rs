//! The program of the Arduino: short lines in, short lines out, one pulse in each direction.

use super::{Knobs, Settings, vast::Vast};
use crate::serial;
use crate::shaft::Shaft;
use std::sync::Arc;

/// The lines after the `OK` to `X?`.
const SETTINGS: [&str; 4] = ["trigger pulse 50 ms", "sort pulse 50 ms", "input filter 5 ms", "version 1.0"];
const LONGEST_LINE: usize = 32;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Power {
    Off,
    /// Just switched on. Earlier pulses were not detected.
    Fresh,
    On,
}

pub(crate) struct Firmware {
    vast: Vast,
    knobs: Knobs,
    line: Vec<u8>,
    out: Vec<u8>,
    /// When the detected arrivals are reported, rig seconds.
    pulses: Vec<f64>,
    power: Power,
}

impl Firmware {
    pub fn new(shaft: Arc<Shaft>, settings: Settings) -> Self {
        let knobs = settings.knobs.clone();
        let vast = Vast::new(shaft, settings);
        Self { vast, knobs, line: Vec::new(), out: Vec::new(), pulses: Vec::new(), power: Power::Off }
    }

    fn say(&mut self, text: &str) {
        self.out.extend_from_slice(text.as_bytes());
        if !self.knobs.line_end_lost() {
            self.out.push(b'\n');
        }
    }

    fn trigger(&mut self, now_s: f64) {
        if let Some(number) = self.knobs.error() {
            return self.say(&format!("E{number}"));
        }
        self.say("OK");
        if !self.knobs.trigger_missed() {
            self.vast.trigger(now_s);
        }
        if self.knobs.arrival_stray() {
            self.say("R1");
        }
    }

    fn obey(&mut self, line: &[u8], now_s: f64) {
        if self.knobs.request_lost() {
            return;
        }
        match line {
            b"X?" => {
                self.say("OK");
                for setting in SETTINGS {
                    self.say(setting);
                }
            }
            b"TT" => self.trigger(now_s),
            b"TS" => self.say("OK"),
            _ => self.say("E0"),
        }
    }
}

impl serial::Firmware for Firmware {
    fn restarts_when_opened(&self) -> bool {
        true
    }

    /// Only the Arduino loses power. The machine has its own supply and continues.
    fn lose_power(&mut self, _now_s: f64) {
        self.line.clear();
        self.pulses.clear();
        self.power = Power::Off;
    }

    fn boot(&mut self) {
        self.power = Power::Fresh;
        self.say("OK");
    }

    fn next_event_s(&self) -> Option<f64> {
        if self.power == Power::Off {
            return None;
        }
        self.pulses.iter().copied().chain([self.vast.next_event_s()]).min_by(f64::total_cmp)
    }

    fn advance(&mut self, now_s: f64) {
        let arrived = self.vast.advance(now_s);
        let seen = std::mem::replace(&mut self.power, Power::On) == Power::On;
        if let Some(arrived_s) = arrived.filter(|_| seen) {
            let report_s = arrived_s + self.knobs.arrival_delay_s();
            self.pulses.push(report_s);
            if self.knobs.arrival_doubled() {
                self.pulses.push(report_s);
            }
        }
        let waiting = self.pulses.len();
        self.pulses.retain(|at_s| *at_s > now_s);
        for _ in self.pulses.len()..waiting {
            self.say("R1");
        }
    }

    fn receive(&mut self, bytes: &[u8], now_s: f64) {
        for &byte in bytes {
            match byte {
                b'\n' => {
                    let line = std::mem::take(&mut self.line);
                    self.obey(&line, now_s);
                }
                _ if self.line.len() < LONGEST_LINE => self.line.push(byte),
                _ => {}
            }
        }
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }
}
