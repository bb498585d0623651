//! The firmware: bytes and rig time in, bytes and steps out. It has no file descriptor and no clock of its own.
//!
//! ```text
//!  bytes ──┬─ realtime ( ? ! ~ 0x18 0x85, overrides ) ── acted on at once
//!          └─ Input ── line ──┬─ $ commands ─────┬──► Machine ── Planner ── Stepper ──► shaft, slide
//!                             └─ G-code, Parser ─┘      │
//!                                 ▲                     └── Mode
//!                                 └── Wait: the main loop reads no line while the planner is full, or drains
//!
//!  bytes ◄── Answers ── ok, error:n, ALARM:n, status reports
//! ```
//! `ok` means that a line was accepted. It does not mean that the machine has arrived. Only `G4` waits for the planner to drain.

mod answers;
mod commands;
mod homing;
mod input;
mod machine;
mod mode;
mod planner;
mod stepper;

use super::dialect::Dialect;
use super::gcode::{Action, Parser};
use super::overrides::Overrides;
use super::report::{Reporter, Snapshot};
use super::settings::{LASER_MODE, Settings};
use crate::outputs::{OutputPin, Outputs};
use crate::sampler::VendorSampler;
use crate::serial::{self, Button, SerialFaults};
use crate::shaft::Shaft;
use crate::slide::Slide;
use answers::Answers;
use commands::Command;
use homing::{HomingAxes, HomingProgress};
use input::{Input, Overflow};
use machine::{Machine, MoveEnd};
use mode::Mode;
use planner::Block;
use std::sync::Arc;
use stepper::{MotionEvent, SHAFT, Stepper};

/// A dwell lasts a whole number of these steps in Grbl and in grblHAL, rounded up. A dwell of 0 s has none.
const DWELL_STEP_S: f64 = 0.05;

/// What the main loop waits for. Meanwhile lines stay in the receive buffer.
#[derive(Debug)]
enum Wait {
    Nothing,
    /// A free block in the planner, for this block.
    Slot(Block),
    /// The end of all moves.
    Drained(AfterDrain),
    Dwell {
        until_s: f64,
    },
    Homing,
}

/// What the line that waits for the planner does after it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum AfterDrain {
    Answer,
    Dwell { seconds: f32 },
    Pause,
    End,
}

/// Who answers a `$` command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reply {
    /// The caller, now.
    Ok,
    /// It was answered, or is answered when it is done.
    Elsewhere,
}

/// The firmware of one controller.
pub(crate) struct Firmware {
    settings: Settings,
    dialect: Dialect,
    faults: Arc<SerialFaults>,
    /// At the probe input and the flood output.
    sampler: Option<Arc<VendorSampler>>,
    outputs: Arc<Outputs>,
    input: Input,
    parser: Parser,
    overrides: Overrides,
    wait: Wait,
    machine: Machine,
    reporter: Reporter,
    answers: Answers,
}

impl serial::Firmware for Firmware {
    fn restarts_when_opened(&self) -> bool {
        true
    }

    fn take_output(&mut self) -> Vec<u8> {
        self.answers.take()
    }

    fn lose_power(&mut self, now_s: f64) {
        self.machine.lose_power(now_s);
        self.forget();
    }

    fn boot(&mut self) {
        if self.faults.take_erased_memory() {
            self.settings = Settings::factory();
            self.answers.text("error:7\r\n");
            self.answers.text(&self.settings.report(self.dialect));
        }
        self.machine.enter(if self.settings.is_on(22) { Mode::Alarm } else { self.machine.rest_mode() });
        self.greet();
    }

    fn next_event_s(&self) -> Option<f64> {
        let dwell = match self.wait {
            Wait::Dwell { until_s } => Some(until_s),
            _ => None,
        };
        [self.machine.next_event_s(), dwell].into_iter().flatten().reduce(f64::min)
    }

    fn advance(&mut self, now_s: f64) {
        while let Some(at_s) = self.next_event_s().filter(|at| *at <= now_s) {
            self.machine.release_if_due(at_s);
            if let Wait::Dwell { until_s } = self.wait
                && until_s <= at_s
            {
                self.wait = Wait::Nothing;
                self.answers.ok();
            }
            match self.machine.event_due(at_s) {
                Some(MotionEvent::HardLimit) => {
                    self.machine.stop(at_s);
                    self.critical(1);
                }
                Some(MotionEvent::End) => self.move_ended(at_s),
                None => {}
            }
            self.main_loop(at_s);
        }
    }

    fn button(&mut self, button: Button, pressed: bool, now_s: f64) {
        self.machine.set_input(button, pressed);
        match button {
            _ if !pressed => {}
            Button::FeedHold => self.machine.hold(now_s),
            Button::CycleStart => self.machine.resume(),
            Button::Door => self.open_door(now_s),
            Button::EmergencyStop if self.dialect.is_hal() => self.emergency_stop(now_s),
            Button::EmergencyStop => self.reset(now_s),
        }
        self.main_loop(now_s);
    }

    fn receive(&mut self, bytes: &[u8], now_s: f64) {
        for &byte in bytes {
            match byte {
                0x18 => self.reset(now_s),
                b'?' => self.status(now_s, false),
                b'!' => self.machine.hold(now_s),
                b'~' => self.machine.resume(),
                0x85 => self.machine.cancel_jog(now_s),
                0x87 if self.dialect.is_hal() => self.full_status(now_s),
                0x80.. => {
                    if self.overrides.take(byte) {
                        self.reporter.override_changed();
                    }
                }
                _ => {
                    if !self.input.receive(byte) {
                        self.faults.count_lost_byte();
                    }
                }
            }
            self.main_loop(now_s);
        }
    }
}

impl Firmware {
    /// The firmware of a controller whose X axis turns `shaft` and whose Y axis moves `slide`.
    pub fn new(shaft: Arc<Shaft>, slide: Option<Arc<Slide>>, faults: Arc<SerialFaults>, settings: Settings, dialect: Dialect) -> Self {
        let parser = Parser::default();
        Self {
            settings,
            dialect,
            sampler: None,
            outputs: Arc::default(),
            input: Input::new(dialect.receive_bytes()),
            overrides: Overrides::default(),
            wait: Wait::Nothing,
            machine: Machine::new(Stepper::new(shaft, slide), dialect.planner_blocks()),
            reporter: Reporter::default(),
            answers: Answers::new(dialect, Arc::clone(&faults), parser.report()),
            faults,
            parser,
        }
    }

    /// Wires a sampler to the probe input and the flood output.
    pub fn with_sampler(self, sampler: Option<Arc<VendorSampler>>) -> Self {
        Self { sampler, ..self }
    }

    /// Uses these outputs.
    pub fn with_outputs(self, outputs: Arc<Outputs>) -> Self {
        Self { outputs, ..self }
    }

    // ---- the main loop

    fn main_loop(&mut self, now_s: f64) {
        loop {
            self.machine.start_next(now_s, self.settings.is_on(21));
            self.end_wait(now_s);
            let listens = matches!(self.wait, Wait::Nothing) && self.machine.mode().reads_lines();
            if !listens || self.input.is_empty() {
                break;
            }
            match self.input.read_byte() {
                None => {}
                Some(Err(Overflow)) => self.answers.error(11),
                Some(Ok(line)) => self.execute(&line, now_s),
            }
        }
    }

    /// Goes on with the line that had to wait, if it need not wait any more.
    fn end_wait(&mut self, now_s: f64) {
        match self.wait {
            Wait::Slot(block) if self.machine.push(block) => {
                self.wait = Wait::Nothing;
                self.answers.ok();
            }
            Wait::Drained(then) if self.machine.is_drained() => {
                self.wait = Wait::Nothing;
                match then {
                    AfterDrain::Answer => self.answers.ok(),
                    AfterDrain::Dwell { seconds } => {
                        let steps = (f64::from(seconds) / DWELL_STEP_S).ceil();
                        self.wait = Wait::Dwell { until_s: now_s + steps * DWELL_STEP_S };
                    }
                    AfterDrain::Pause => {
                        self.answers.ok();
                        self.machine.enter(Mode::Hold);
                    }
                    AfterDrain::End => {
                        self.answers.message("Pgm End");
                        self.answers.ok();
                    }
                }
            }
            _ => {}
        }
    }

    fn execute(&mut self, line: &[u8], now_s: f64) {
        let last_error = self.answers.take_last_error();
        match line {
            [] => self.answers.ok(),
            [b'$', command @ ..] => match self.command(Command::read(command), now_s) {
                Ok(Reply::Ok) => self.answers.ok(),
                Ok(Reply::Elsewhere) => {}
                Err(number) => self.answers.error(number),
            },
            _ if matches!(self.machine.mode(), Mode::Alarm | Mode::Jog) => self.answers.error(9),
            code => match last_error {
                Some(number) => self.answers.error(number),
                None => self.execute_code(code, now_s),
            },
        }
    }

    fn execute_code(&mut self, code: &[u8], now_s: f64) {
        let offset = self.parser.offset();
        let before = self.parser.clone();
        match self.parser.take(code) {
            Ok(_) if self.is_refused(&before) => {
                self.parser = before;
                self.answers.error(20);
            }
            Ok(action) => self.act(action, now_s),
            Err(number) => self.answers.error(number),
        }
        self.update_outputs();
        if self.parser.offset().map(f32::to_bits) != offset.map(f32::to_bits) {
            self.reporter.offset_changed();
        }
    }

    fn act(&mut self, action: Action, now_s: f64) {
        match action {
            _ if self.machine.mode() == Mode::Check => self.answers.ok(),
            Action::None => self.answers.ok(),
            Action::Move { target, .. } if self.is_beyond_soft_limits(target) => self.soft_limit(now_s),
            Action::Move { target, feed } => self.queue(target, feed.map(|f| f * f32::from(self.overrides.feed) / 100.0)),
            Action::Dwell { seconds } => self.wait = Wait::Drained(AfterDrain::Dwell { seconds }),
            Action::Synchronise => self.wait = Wait::Drained(AfterDrain::Answer),
            Action::Pause => self.wait = Wait::Drained(AfterDrain::Pause),
            Action::End => self.wait = Wait::Drained(AfterDrain::End),
        }
    }

    /// Executes a `$` command. The error is Grbl's number.
    fn command(&mut self, command: Command, now_s: f64) -> Result<Reply, u8> {
        let mode = self.machine.mode();
        match command {
            Command::Help => self.answers.text("[HLP:$$ $# $G $I $N $x=val $J=line $X $H ~ ! ? ctrl-x]\r\n"),
            Command::Modes => self.answers.text(&self.parser.report()),
            Command::Unlock | Command::Home(_) if self.machine.inputs().door_open() => return Err(13),
            Command::Check if mode == Mode::Check => {
                self.machine.enter(Mode::Idle);
                self.answers.ok();
                self.restart();
                return Ok(Reply::Elsewhere);
            }
            Command::Unlock => {
                if mode == Mode::Alarm {
                    self.machine.enter(Mode::Idle);
                    self.answers.message("Caution: Unlocked");
                }
            }
            Command::Jog(line) => return self.jog(line),
            // All others use the EEPROM or print much, and need a machine at rest.
            _ if !mode.is_quiet() => return Err(8),
            Command::Settings => self.answers.text(&self.settings.report(self.dialect)),
            Command::Offsets => self.answers.text(&self.parser.report_offsets()),
            Command::Version => self.answers.text(self.dialect.version()),
            Command::StartupLines => self.answers.text("$N0=\r\n$N1=\r\n"),
            Command::Check if mode == Mode::Idle => self.machine.enter(Mode::Check),
            Command::Check => return Err(3),
            Command::Sleep => self.machine.enter(Mode::Sleep),
            Command::Home(axes) => return self.home(axes, now_s),
            Command::Setting(text) => {
                let (number, value) = commands::setting(text)?;
                self.settings.set(number, value)?;
            }
        }
        Ok(Reply::Ok)
    }

    fn jog(&mut self, line: &[u8]) -> Result<Reply, u8> {
        match self.machine.mode() {
            Mode::Idle | Mode::Jog => {}
            Mode::Alarm => return Err(9),
            _ => return Err(8),
        }
        let before = self.parser.position;
        let Action::Move { target, feed } = self.parser.jog(line)? else { return Err(16) };
        if self.is_beyond_soft_limits(target) {
            self.parser.position = before;
            return Err(15);
        }
        self.machine.enter(Mode::Jog);
        self.queue(target, feed);
        Ok(Reply::Elsewhere)
    }

    // ---- moves

    /// Queues a move, or waits until there is room. It is answered when it is in the queue.
    fn queue(&mut self, target: [f32; 3], feed: Option<f32>) {
        match Block::plan(self.machine.planned_position(), target, feed, &self.settings) {
            Some(block) if !self.machine.push(block) => self.wait = Wait::Slot(block),
            _ => self.answers.ok(),
        }
    }

    fn move_ended(&mut self, at_s: f64) {
        let idle_s = self.settings.idle_s(SHAFT, self.dialect);
        match self.machine.finish_move(at_s, idle_s, &self.settings) {
            None | Some(MoveEnd::AtRest) => {}
            Some(MoveEnd::JogCancelled) => {
                self.wait = Wait::Nothing;
                self.update_parser_position();
            }
            Some(MoveEnd::SoftLimit) => self.critical(2),
            Some(MoveEnd::Homing(progress)) => self.homing_went(progress),
        }
    }

    fn home(&mut self, axes: HomingAxes, now_s: f64) -> Result<Reply, u8> {
        if !self.settings.is_on(22) {
            return Err(5);
        }
        if axes == HomingAxes::Slide && !self.machine.stepper().has_slide() {
            return Err(3);
        }
        self.wait = Wait::Homing;
        let progress = self.machine.home(axes, now_s, &self.settings);
        self.homing_went(progress);
        Ok(Reply::Elsewhere)
    }

    fn homing_went(&mut self, progress: HomingProgress) {
        match progress {
            HomingProgress::Moving => {}
            HomingProgress::Done => {
                self.update_parser_position();
                self.wait = Wait::Nothing;
                self.answers.ok();
            }
            HomingProgress::Failed(number) => self.homing_failed(number),
        }
    }

    fn homing_failed(&mut self, number: u8) {
        self.answers.alarm(number);
        self.restart();
    }

    fn update_parser_position(&mut self) {
        self.parser.position = self.settings.to_units(self.machine.stepper().position());
    }

    /// Whether the parser would switch an output that refuses.
    fn is_refused(&self, before: &Parser) -> bool {
        let (was, is) = (self.levels(before), self.levels(&self.parser));
        was.iter().zip(is).any(|((pin, was), (_, is))| *was != is && self.outputs.is_refused(*pin))
    }

    fn levels(&self, parser: &Parser) -> [(OutputPin, bool); 3] {
        let spindle = parser.is_spinning(self.settings.is_on(LASER_MODE));
        [(OutputPin::Mist, parser.is_misting()), (OutputPin::Flood, parser.is_flooding()), (OutputPin::Spindle, spindle)]
    }

    fn update_outputs(&self) {
        if self.machine.mode() == Mode::Check {
            return;
        }
        for (pin, on) in self.levels(&self.parser) {
            self.outputs.set(pin, on);
        }
        if let Some(sampler) = &self.sampler {
            sampler.done(self.parser.is_flooding());
        }
    }

    fn open_door(&mut self, now_s: f64) {
        if !self.machine.open_door(now_s) {
            self.homing_failed(7);
        }
    }

    // ---- alarms and resets

    fn is_beyond_soft_limits(&self, target: [f32; 3]) -> bool {
        let travel = self.settings.per_axis(130);
        self.settings.is_on(20) && (0..3).any(|i| target[i] > 0.0 || target[i] < -travel[i])
    }

    fn soft_limit(&mut self, now_s: f64) {
        if !self.machine.brake_at_soft_limit(now_s) {
            self.critical(2);
        }
    }

    fn critical(&mut self, number: u8) {
        self.machine.drop_queued();
        self.machine.enter(Mode::Critical);
        self.wait = Wait::Nothing;
        self.answers.alarm(number);
        self.answers.message("Reset to continue");
    }

    fn emergency_stop(&mut self, now_s: f64) {
        self.machine.stop(now_s);
        self.forget();
        self.machine.forget_homing();
        self.machine.enter(Mode::EmergencyStop);
        self.answers.alarm(10);
        self.answers.message("Emergency stop");
    }

    fn reset(&mut self, now_s: f64) {
        let mode = self.machine.mode();
        if mode == Mode::EmergencyStop && self.machine.inputs().stop_pressed() {
            return self.emergency_stop(now_s);
        }
        let alarm = match mode {
            Mode::Home => Some(6),
            _ if self.machine.stepper().is_moving() => Some(3),
            _ => None,
        };
        self.machine.stop(now_s);
        if let Some(number) = alarm {
            self.answers.alarm(number);
        }
        let is_locked = alarm.is_some() || mode.stays_locked();
        self.machine.enter(if is_locked { Mode::Alarm } else { self.machine.rest_mode() });
        self.restart();
    }

    /// Every reset clears the queues and the modes. The position stays.
    fn restart(&mut self) {
        self.forget();
        self.greet();
    }

    fn forget(&mut self) {
        self.input.clear();
        self.machine.drop_queued();
        self.wait = Wait::Nothing;
        self.parser = Parser::at(self.settings.to_units(self.machine.stepper().position()));
        self.overrides = Overrides::default();
        self.update_outputs();
        self.reporter = Reporter::default();
        self.answers.reset(self.parser.report());
    }

    fn greet(&mut self) {
        self.answers.text(self.dialect.greeting());
        if self.machine.mode() == Mode::Alarm {
            self.answers.message("'$H'|'$X' to unlock");
        }
    }

    // ---- status reports

    /// Sends a report with all optional fields.
    fn full_status(&mut self, now_s: f64) {
        self.reporter = Reporter::default();
        self.status(now_s, true);
    }

    fn status(&mut self, now_s: f64, full: bool) {
        let (mode, inputs, stepper) = (self.machine.mode(), self.machine.inputs(), self.machine.stepper());
        let Some(state) = mode.name(stepper.is_moving(), inputs.door_open(), full) else { return };
        let snapshot = Snapshot {
            state,
            busy: !mode.is_quiet(),
            machine: self.settings.to_units(stepper.position_at(now_s)),
            offset: self.parser.offset(),
            feed: (stepper.speed(now_s) * 60.0) as f32,
            at_limit: stepper.at_index(now_s),
            accessories: self.parser.accessories(),
            control: inputs.letters(self.dialect),
            at_probe: self.sampler.as_ref().is_some_and(|sampler| sampler.line()),
            free: (self.machine.free_blocks(), self.input.free()),
            overrides: self.overrides,
            homed: self.dialect.is_hal().then_some(self.machine.is_homed()),
            mask: self.settings.get(10) as u8,
        };
        let text = self.reporter.status(&snapshot);
        self.answers.modes_if_changed(self.parser.report());
        self.answers.text(&text);
    }
}

#[cfg(test)]
mod tests;
