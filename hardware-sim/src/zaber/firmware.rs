//! The firmware: lines in, lines out. It has no file descriptor and no clock of its own.
//!
//! ```text
//!  bytes ── line ── from its last slash ── checksum, if it has one ── device, axis, id ── words ──► axis ──► shaft
//! ```
//! A line without a slash, for another device, or with a wrong checksum is ignored. The reply repeats the id of the line, if it has
//! one.

use super::Settings;
use super::axis::Axis;
use crate::motor_faults::MotorFaults;
use crate::outputs::{OutputPin, Outputs};
use crate::serial;
use crate::shaft::Shaft;
use std::sync::Arc;

pub(crate) struct Firmware {
    settings: Settings,
    axis: Axis,
    outputs: Arc<Outputs>,
    received: Vec<u8>,
    checksums: bool,
    alerts: bool,
    out: Vec<u8>,
}

/// Why a command is refused, as the protocol names it.
type Reason = &'static str;

impl serial::Firmware for Firmware {
    fn restarts_when_opened(&self) -> bool {
        false
    }

    fn lose_power(&mut self, now_s: f64) {
        self.axis.lose_power(now_s);
        self.outputs.all_off();
        self.received.clear();
        (self.checksums, self.alerts) = (false, false);
    }

    /// A controller sends nothing when it starts. Its flag `WR` shows the restart.
    fn boot(&mut self) {}

    fn next_event_s(&self) -> Option<f64> {
        self.axis.next_event_s()
    }

    fn advance(&mut self, now_s: f64) {
        self.axis.advance(now_s, &self.settings);
        if std::mem::take(&mut self.axis.ended) && self.alerts {
            let content = format!("{:02} 1 IDLE {}", self.settings.device, self.axis.flag());
            self.say('!', &content);
        }
    }

    fn receive(&mut self, bytes: &[u8], now_s: f64) {
        self.received.extend_from_slice(bytes);
        while let Some(end) = self.received.iter().position(|b| *b == b'\n') {
            let line: Vec<u8> = self.received.drain(..=end).collect();
            self.line(String::from_utf8_lossy(&line).trim_end(), now_s);
        }
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }
}

impl Firmware {
    pub fn new(shaft: Arc<Shaft>, faults: Arc<MotorFaults>, outputs: Arc<Outputs>, settings: Settings) -> Self {
        Self { settings, axis: Axis::new(shaft, faults), outputs, received: Vec::new(), checksums: false, alerts: false, out: Vec::new() }
    }

    fn line(&mut self, line: &str, now_s: f64) {
        let Some((before, content)) = line.rsplit_once('/') else { return };
        if self.settings.slash_first && !before.is_empty() {
            return;
        }
        let content = match content.rsplit_once(':') {
            Some((content, sum)) if u8::from_str_radix(sum, 16) == Ok(lrc(content)) => content,
            Some(_) => return,
            None => content,
        };
        let mut words = content.split_whitespace().peekable();
        let mut number = || words.next_if(|w| w.bytes().all(|b| b.is_ascii_digit())).map(str::to_owned);
        let (device, axis, id) = (number().unwrap_or_default(), number().unwrap_or_default(), number());
        if !["", "0", "00", "1", "01"].contains(&device.as_str()) && device.parse() != Ok(self.settings.device) {
            return;
        }
        let axis: u8 = axis.parse().unwrap_or(0);
        let words: Vec<&str> = words.collect();
        let answer = if axis > 1 { Err("BADAXIS") } else { self.carry_out(axis, &words, now_s) };
        let (verdict, data) = match answer {
            Ok(data) => ("OK", data),
            Err(reason) => ("RJ", reason.to_owned()),
        };
        let state = if self.axis.is_moving() { "BUSY" } else { "IDLE" };
        let id = id.map(|id| format!(" {id}")).unwrap_or_default();
        let content = format!("{:02} {axis}{id} {verdict} {state} {} {data}", self.settings.device, self.axis.flag());
        self.say('@', &content);
    }

    fn say(&mut self, kind: char, content: &str) {
        let sum = if self.checksums { format!(":{:02X}", lrc(content)) } else { String::new() };
        self.out.extend(format!("{kind}{content}{sum}\r\n").bytes());
    }

    fn carry_out(&mut self, axis: u8, words: &[&str], now_s: f64) -> Result<String, Reason> {
        let done = Ok("0".to_owned());
        match words {
            [] => done,
            ["home"] | ["move", ..] if !self.axis.is_enabled() => Err("DRIVERDISABLED"),
            ["driver", "enable"] => {
                if self.axis.enable() {
                    done
                } else {
                    Err("DRIVERDISABLED")
                }
            }
            ["warnings"] => {
                let flags = self.axis.flags();
                Ok(flags.iter().fold(format!("{:02}", flags.len()), |said, flag| format!("{said} {flag}")))
            }
            ["home"] => {
                self.axis.home(now_s, &self.settings);
                done
            }
            ["stop"] => {
                self.axis.stop(now_s, &self.settings);
                done
            }
            ["move", how @ ("abs" | "rel"), steps, speed @ ..] => {
                let steps: i64 = steps.parse().map_err(|_| "BADDATA")?;
                let maxspeed = match speed {
                    [] => self.settings.maxspeed,
                    [speed] => speed.parse().ok().filter(|speed| (1..=self.settings.maxspeed).contains(speed)).ok_or("BADDATA")?,
                    _ => return Err("BADCOMMAND"),
                };
                let from = if *how == "rel" { self.axis.counter(now_s) } else { 0 };
                self.axis.go(from + steps, now_s, &Settings { maxspeed, ..self.settings.clone() });
                done
            }
            ["warnings", "clear"] => {
                self.axis.clear_flags();
                done
            }
            ["io", ..] if axis != 0 => Err("DEVICEONLY"),
            ["io", words @ ..] => self.io(words),
            ["get", name] => self.get(axis, name, now_s),
            ["set", name, value] => self.set(axis, name, value).map(|()| "0".to_owned()),
            ["system", "reset"] if axis == 0 => {
                serial::Firmware::lose_power(self, now_s);
                done
            }
            _ => Err("BADCOMMAND"),
        }
    }

    /// The digital outputs, from 1 to 4.
    fn io(&self, words: &[&str]) -> Result<String, Reason> {
        let pin = |channel: &str| {
            let channel = channel.parse().ok().filter(|channel| (1..=4).contains(channel)).ok_or("BADDATA")?;
            Ok::<_, Reason>(OutputPin::Number(channel))
        };
        match words {
            ["get", "do", channel] => Ok(u8::from(self.outputs.is_on(pin(channel)?)).to_string()),
            ["set", "do", channel, level @ ("0" | "1")] => {
                let pin = pin(channel)?;
                if self.outputs.is_refused(pin) {
                    return Err("BADDATA");
                }
                self.outputs.set(pin, *level == "1");
                Ok("0".to_owned())
            }
            ["set", "do", ..] => Err("BADDATA"),
            _ => Err("BADCOMMAND"),
        }
    }

    fn get(&self, axis: u8, name: &str, now_s: f64) -> Result<String, Reason> {
        let Settings { resolution, maxspeed, accel, encoder, serial_number, .. } = &self.settings;
        Ok(match name {
            "version" | "system.serial" | "comm.checksum" | "comm.alert" if axis != 0 => return Err("DEVICEONLY"),
            "version" => "7.32".into(),
            "system.serial" => serial_number.to_string(),
            "comm.checksum" => u8::from(self.checksums).to_string(),
            "comm.alert" => u8::from(self.alerts).to_string(),
            "pos" => self.axis.counter(now_s).to_string(),
            "encoder.pos" if *encoder => format!("{:.0}", self.axis.encoder(now_s)),
            "resolution" => resolution.to_string(),
            "maxspeed" => maxspeed.to_string(),
            "accel" => accel.to_string(),
            _ => return Err("BADCOMMAND"),
        })
    }

    fn set(&mut self, axis: u8, name: &str, value: &str) -> Result<(), Reason> {
        let value: i64 = value.parse().map_err(|_| "BADDATA")?;
        match name {
            "comm.checksum" | "comm.alert" if axis != 0 => return Err("DEVICEONLY"),
            "comm.checksum" => self.checksums = value != 0,
            "comm.alert" => self.alerts = value != 0,
            "pos" if self.axis.is_moving() => return Err("STATUSBUSY"),
            "pos" => self.axis.set_counter(value),
            _ => return Err("BADCOMMAND"),
        }
        Ok(())
    }
}

/// Makes the sum of all bytes 0 modulo 256.
fn lrc(content: &str) -> u8 {
    content.bytes().fold(0_u8, u8::wrapping_add).wrapping_neg()
}
