//! The G-code parser: the modal state, and what one line requests of the machine.

use super::words::{self, Word};
use std::fmt::Write;

/// What a line requests after it has changed the modal state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Action {
    /// Nothing. The line has changed modes only.
    None,
    /// A straight move to a target in machine coordinates, units. `feed` is in units/min. Without it the axes go as fast as they may.
    Move { target: [f32; 3], feed: Option<f32> },
    /// `G4`
    Dwell { seconds: f32 },
    /// A code that waits for the planner to drain.
    Synchronise,
    /// `M0`: wait for the planner to drain, then hold.
    Pause,
    /// `M2`, `M30`: wait for the planner to drain. The modes are those of power-up.
    End,
}

#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // modes that are independent of each other
pub(super) struct Parser {
    rapid: Motion,
    absolute: bool,
    inches: bool,
    /// G93: the feed is the number of such moves in a minute.
    inverse_time: bool,
    feed: f32,
    /// Work offset of G92. The offsets of G54 to G59 are zero.
    g92: [f32; 3],
    /// Number of the work coordinate system, 54 to 59.
    system: u8,
    spindle: &'static str,
    /// Of the last S word. An output with speed 0 is off.
    speed: f32,
    /// M7 and M8. M9 ends both.
    mist: bool,
    flood: bool,
    /// The position after all accepted moves, in machine coordinates, units.
    pub position: [f32; 3],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Motion {
    Rapid,
    Feed,
    None,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Coolant {
    Mist,
    Flood,
    Off,
}

const MM_PER_INCH: f32 = 25.4;

impl Default for Parser {
    fn default() -> Self {
        Self {
            rapid: Motion::Rapid,
            absolute: true,
            inches: false,
            inverse_time: false,
            feed: 0.0,
            g92: [0.0; 3],
            system: 54,
            spindle: "M5",
            speed: 0.0,
            mist: false,
            flood: false,
            position: [0.0; 3],
        }
    }
}

/// The words of a line, sorted by their meaning. As in the real firmware, a line is read completely before it takes effect.
#[derive(Default)]
// Each is a code that the line may contain.
#[allow(clippy::struct_excessive_bools)]
struct Line {
    motion: Option<Motion>,
    absolute: Option<bool>,
    inches: Option<bool>,
    inverse_time: Option<bool>,
    system: Option<u8>,
    spindle: Option<&'static str>,
    coolant: Option<Coolant>,
    speed: Option<f32>,
    machine_coordinates: bool,
    dwell: bool,
    set_g92: bool,
    clear_g92: bool,
    pause: bool,
    end: bool,
    axes: [Option<f32>; 3],
    feed: Option<f32>,
    p: Option<f32>,
}

impl Line {
    /// The error is Grbl's number.
    fn read(words: &[Word]) -> Result<Self, u8> {
        let mut line = Self::default();
        for w in words {
            match w.letter {
                b'G' => line.take_g(w.value)?,
                b'M' => line.take_m(w.value)?,
                b'X' | b'Y' | b'Z' => once(&mut line.axes[usize::from(w.letter - b'X')], w.value)?,
                b'F' | b'P' | b'S' if w.value < 0.0 => return Err(4),
                b'F' => once(&mut line.feed, w.value)?,
                b'P' => once(&mut line.p, w.value)?,
                b'S' => once(&mut line.speed, w.value)?,
                b'N' | b'T' => {}
                _ => return Err(20),
            }
        }
        Ok(line)
    }

    fn take_g(&mut self, value: f32) -> Result<(), u8> {
        match (value * 10.0).round() as i32 {
            0 => once(&mut self.motion, Motion::Rapid).map_err(|_| 21),
            10 => once(&mut self.motion, Motion::Feed).map_err(|_| 21),
            800 => once(&mut self.motion, Motion::None).map_err(|_| 21),
            900 => once(&mut self.absolute, true).map_err(|_| 21),
            910 => once(&mut self.absolute, false).map_err(|_| 21),
            200 => once(&mut self.inches, true).map_err(|_| 21),
            210 => once(&mut self.inches, false).map_err(|_| 21),
            930 => once(&mut self.inverse_time, true).map_err(|_| 21),
            940 => once(&mut self.inverse_time, false).map_err(|_| 21),
            code @ (540 | 550 | 560 | 570 | 580 | 590) => once(&mut self.system, (code / 10) as u8).map_err(|_| 21),
            40 => {
                self.dwell = true;
                Ok(())
            }
            530 => {
                self.machine_coordinates = true;
                Ok(())
            }
            920 => {
                self.set_g92 = true;
                Ok(())
            }
            921 => {
                self.clear_g92 = true;
                Ok(())
            }
            // Plane, cutter compensation, tool length: this machine has only these values.
            170 | 400 | 490 | 911 | 610 => Ok(()),
            _ => Err(20),
        }
    }

    fn take_m(&mut self, value: f32) -> Result<(), u8> {
        match value.round() as i32 {
            0 => self.pause = true,
            1 => {}
            2 | 30 => self.end = true,
            3 => self.spindle = Some("M3"),
            4 => self.spindle = Some("M4"),
            5 => self.spindle = Some("M5"),
            // One word of a group on a line.
            7..=9 if self.coolant.is_some() => return Err(21),
            7 => self.coolant = Some(Coolant::Mist),
            8 => self.coolant = Some(Coolant::Flood),
            9 => self.coolant = Some(Coolant::Off),
            _ => return Err(20),
        }
        Ok(())
    }

    fn has_axes(&self) -> bool {
        self.axes.iter().any(Option::is_some)
    }
}

fn once<T>(slot: &mut Option<T>, value: T) -> Result<(), u8> {
    if slot.replace(value).is_some() { Err(25) } else { Ok(()) }
}

fn length(from: [f32; 3], to: [f32; 3]) -> f32 {
    (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f32>().sqrt()
}

impl Parser {
    /// The modes of power-up, at a position.
    pub fn at(position: [f32; 3]) -> Self {
        Self { position, ..Self::default() }
    }

    /// Restores the modes of power-up. The offset of G92 and the position stay.
    pub fn restore_modes(&mut self) {
        *self = Self { position: self.position, g92: self.g92, ..Self::default() };
    }

    /// Executes one line of G-code. The error is Grbl's number, and then nothing has changed.
    pub fn take(&mut self, line: &[u8]) -> Result<Action, u8> {
        let line = Line::read(&words::split(line)?)?;
        if line.dwell && line.p.is_none() {
            return Err(28);
        }
        if (line.dwell || line.clear_g92) && line.set_g92 {
            return Err(21);
        }
        if line.set_g92 && !line.has_axes() {
            return Err(26);
        }
        let motion = line.motion.unwrap_or(self.rapid);
        let moves = line.has_axes() && !line.set_g92 && !line.dwell;
        let scale = if line.inches.unwrap_or(self.inches) { MM_PER_INCH } else { 1.0 };
        let inverse_time = line.inverse_time.unwrap_or(self.inverse_time);
        // A feed counts in its own mode, and each move in inverse time states its own.
        let known = if inverse_time || self.inverse_time { 0.0 } else { self.feed };
        let feed = line.feed.map_or(known, |f| if inverse_time { f } else { f * scale });
        if moves && motion == Motion::None {
            return Err(24);
        }
        if line.motion == Some(Motion::Feed) && !line.has_axes() && line.machine_coordinates {
            return Err(26);
        }
        if moves && motion == Motion::Feed && feed == 0.0 {
            return Err(22);
        }

        let offset = self.offset();
        self.rapid = motion;
        self.absolute = line.absolute.unwrap_or(self.absolute);
        self.inches = line.inches.unwrap_or(self.inches);
        self.system = line.system.unwrap_or(self.system);
        self.inverse_time = inverse_time;
        self.feed = feed;
        if let Some(spindle) = line.spindle {
            self.spindle = spindle;
        }
        self.speed = line.speed.unwrap_or(self.speed);
        match line.coolant {
            Some(Coolant::Mist) => self.mist = true,
            Some(Coolant::Flood) => self.flood = true,
            Some(Coolant::Off) => (self.mist, self.flood) = (false, false),
            None => {}
        }
        if line.clear_g92 {
            self.g92 = [0.0; 3];
        }
        if line.set_g92 {
            for (axis, value) in line.axes.iter().enumerate() {
                if let Some(value) = value {
                    self.g92[axis] = self.position[axis] - value * scale;
                }
            }
        }
        Ok(if line.dwell {
            Action::Dwell { seconds: line.p.unwrap_or(0.0) }
        } else if moves {
            let target = self.target(&line.axes, scale, self.absolute || line.machine_coordinates, line.machine_coordinates, offset);
            let from = std::mem::replace(&mut self.position, target);
            let per_min = if inverse_time { feed * length(from, target) } else { feed };
            Action::Move { target, feed: (motion == Motion::Feed).then_some(per_min) }
        } else if line.end {
            self.restore_modes();
            Action::End
        } else if line.pause {
            Action::Pause
        } else if line.coolant.is_some() || line.spindle.is_some() {
            Action::Synchronise
        } else {
            Action::None
        })
    }

    /// Executes a `$J=` line. It has its own modes and does not change those of the parser. The error is Grbl's number.
    pub fn jog(&mut self, line: &[u8]) -> Result<Action, u8> {
        let line = Line::read(&words::split(line)?)?;
        let allowed = line.motion.is_none() && !line.dwell && !line.set_g92 && !line.clear_g92 && !line.end && !line.pause;
        if !allowed || line.system.is_some() || line.spindle.is_some() {
            return Err(16);
        }
        if !line.has_axes() {
            return Err(26);
        }
        let scale = if line.inches.unwrap_or(self.inches) { MM_PER_INCH } else { 1.0 };
        let Some(feed) = line.feed.filter(|f| *f > 0.0) else { return Err(22) };
        let absolute = line.absolute.unwrap_or(self.absolute) || line.machine_coordinates;
        let target = self.target(&line.axes, scale, absolute, line.machine_coordinates, self.offset());
        self.position = target;
        Ok(Action::Move { target, feed: Some(feed * scale) })
    }

    pub fn is_misting(&self) -> bool {
        self.mist
    }

    pub fn is_flooding(&self) -> bool {
        self.flood
    }

    /// Whether the spindle's output is on. In laser mode it is off unless the motion is G1.
    pub fn is_spinning(&self, laser_mode: bool) -> bool {
        self.spindle != "M5" && self.speed > 0.0 && (!laser_mode || self.rapid == Motion::Feed)
    }

    /// Letters of what is on, as the status report has them.
    pub fn accessories(&self) -> String {
        let spindle = match self.spindle {
            "M3" => "S",
            "M4" => "C",
            _ => "",
        };
        [spindle, if self.flood { "F" } else { "" }, if self.mist { "M" } else { "" }].concat()
    }

    pub fn offset(&self) -> [f32; 3] {
        self.g92
    }

    fn target(&self, axes: &[Option<f32>; 3], scale: f32, absolute: bool, machine: bool, offset: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| match axes[axis] {
            None => self.position[axis],
            Some(value) if machine => value * scale,
            Some(value) if absolute => value * scale + offset[axis],
            Some(value) => self.position[axis] + value * scale,
        })
    }

    /// The answer to `$G`.
    pub fn report(&self) -> String {
        let motion = match self.rapid {
            Motion::Rapid => "G0",
            Motion::Feed => "G1",
            Motion::None => "G80",
        };
        let units = if self.inches { "G20" } else { "G21" };
        let rate = if self.inverse_time { "G93" } else { "G94" };
        let distance = if self.absolute { "G90" } else { "G91" };
        let feed = if self.inches && !self.inverse_time { self.feed / MM_PER_INCH } else { self.feed };
        let coolant = match (self.mist, self.flood) {
            (true, true) => "M7 M8",
            (true, false) => "M7",
            (false, true) => "M8",
            (false, false) => "M9",
        };
        let (system, spindle, speed) = (self.system, self.spindle, self.speed);
        format!("[GC:{motion} G{system} G17 {units} {distance} {rate} {spindle} {coolant} T0 F{feed:.0} S{speed:.0}]\r\n")
    }

    /// The answer to `$#`.
    pub fn report_offsets(&self) -> String {
        let zero = "0.000,0.000,0.000";
        let mut text = (54..60).map(|n| format!("[G{n}:{zero}]\r\n")).collect::<Vec<_>>().concat();
        let _ = write!(text, "[G28:{zero}]\r\n[G30:{zero}]\r\n[G92:{}]\r\n", super::report::triple(self.g92));
        let _ = write!(text, "[TLO:0.000]\r\n[PRB:{zero}:0]\r\n");
        text
    }
}

#[cfg(test)]
mod tests {
    // These decimal numbers and their sums are exact in floating point, and these tests check that.
    #![allow(clippy::float_cmp)]

    use super::*;

    fn to(action: Action) -> [f32; 3] {
        match action {
            Action::Move { target, .. } => target,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn modes_offsets_and_machine_coordinates() {
        let mut p = Parser::default();
        assert_eq!(to(p.take(b"G0X1.5").unwrap()), [1.5, 0.0, 0.0]);
        assert_eq!(to(p.take(b"G91X.5Y2").unwrap()), [2.0, 2.0, 0.0]);
        assert_eq!(p.take(b"G92X0").unwrap(), Action::None);
        assert_eq!(to(p.take(b"G90X1").unwrap()), [3.0, 2.0, 0.0], "counted from where G92 put zero");
        assert_eq!(to(p.take(b"G53X1").unwrap()), [1.0, 2.0, 0.0]);
        p.take(b"G92.1").unwrap();
        assert_eq!(to(p.take(b"G20X1").unwrap()), [25.4, 2.0, 0.0]);
        p.restore_modes();
        assert_eq!(to(p.take(b"X1").unwrap()), [1.0, 2.0, 0.0], "a reset restores G90 and G21");
    }

    #[test]
    fn a_refused_line_changes_nothing() {
        let mut p = Parser::default();
        let before = p.clone();
        for (line, error) in
            [(&b"G1X1"[..], 22), (b"G91G90X1", 21), (b"X1X2", 25), (b"G4", 28), (b"G2X1", 20), (b"G92", 26), (b"G80X1", 24), (b"F-1", 4)]
        {
            assert_eq!(p.take(line).unwrap_err(), error, "{}", String::from_utf8_lossy(line));
            assert_eq!(p, before);
        }
    }

    #[test]
    fn a_jog_leaves_the_modes_alone() {
        let mut p = Parser::default();
        assert_eq!(to(p.jog(b"G91X1F100").unwrap()), [1.0, 0.0, 0.0]);
        assert_eq!(p.jog(b"X1").unwrap_err(), 22);
        assert_eq!(p.jog(b"G0X1F1").unwrap_err(), 16);
        assert!(p.report().contains("G90") && p.report().contains(" F0 "));
    }
}
