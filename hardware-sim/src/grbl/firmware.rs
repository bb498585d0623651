//! The firmware proper: bytes and rig time in, bytes and steps out. It knows no file descriptor and no clock of its own.
//!
//! ```text
//!  bytes ──┬─ real-time ( ? ! ~ 0x18 0x85 ) ── acted on at once
//!          └─ receive buffer, 128 bytes ── line, 80 bytes ── $ commands
//!             (more is lost in silence)                   └─ G-code ── planner, 15 blocks ── shaft
//!                                          └─ ok, error:n      the main loop waits here when it is full
//! ```
//! `ok` says that a line was taken, not that the machine has arrived; only `G4` waits for the planner to drain.

use super::dialect::Dialect;
use super::gcode::{Action, Parser};
use super::report::{Reporter, Snapshot};
use super::settings::Settings;
use super::words;
use crate::motion::MotionProfile;
use crate::sampler::VendorSampler;
use crate::serial::{self, Button, SerialFaults};
use crate::shaft::Shaft;
use crate::slide::Slide;
use std::collections::VecDeque;
use std::sync::Arc;

/// A line keeps one byte of its 80 for the terminator.
const LINE_BYTES: usize = 80 - 1;
/// A dwell is so many of these as reach it, by Grbl and by grblHAL; none where 0 s are asked for.
const DWELL_STEP_S: f64 = 0.05;
/// What the axes X and Y move.
const SHAFT: usize = 0;
const SLIDE: usize = 1;
/// How much farther than the travel the first homing search may go, and than the pull-off the second.
const HOMING_SEARCH: f64 = 1.5;
const HOMING_LOCATE: f64 = 5.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Idle,
    Run,
    Hold,
    Jog,
    Home,
    /// The safety door is open, or was and nobody has pressed cycle start.
    Door,
    /// Lines are parsed and nothing moves, until `$C` comes again.
    Check,
    /// Until a reset.
    Sleep,
    Alarm,
    /// grblHAL: the emergency stop is pressed, or was and nobody has reset.
    EmergencyStop,
    /// After a limit: deaf to everything but a reset.
    Critical,
}

/// What the main loop is waiting for; while it waits, lines pile up in the receive buffer.
#[derive(Debug)]
enum Wait {
    Nothing,
    Slot(Block),
    Drained(Then),
    Dwell { until_s: f64 },
    Homing,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Then {
    Answer,
    Dwell { seconds: f32 },
    Pause,
    End,
}

/// Why the motor is slowing down in the middle of a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Brake {
    Hold,
    CancelJog,
    SoftLimit,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Block {
    steps: [i64; 3],
    /// Path length in units, units per second, units per second squared.
    length: f64,
    speed: f64,
    acceleration: f64,
}

#[derive(Debug)]
struct Running {
    block: Block,
    start_s: f64,
    profile: Arc<MotionProfile>,
    /// When the hard limit trips, if it does.
    limit_s: Option<f64>,
    brake: Option<Brake>,
}

impl Running {
    fn end_s(&self) -> f64 {
        self.start_s + self.profile.duration_s()
    }

    fn part(&self, now_s: f64) -> f64 {
        self.profile.travelled(now_s - self.start_s) / self.block.length
    }

    fn steps(&self, now_s: f64) -> [i64; 3] {
        let part = self.part(now_s);
        self.block.steps.map(|s| (s as f64 * part).round() as i64)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Homing {
    Search,
    PullOff,
    Locate,
    Leave,
}

/// The control inputs.
#[derive(Debug, Clone, Copy, Default)]
struct Inputs {
    hold: bool,
    door_open: bool,
    /// The emergency stop of grblHAL, the reset input of Grbl.
    stop: bool,
}

pub(crate) struct Firmware {
    shaft: Arc<Shaft>,
    /// On Y, where there is one.
    slide: Option<Arc<Slide>>,
    /// On the probe input and the flood output.
    sampler: Option<Arc<VendorSampler>>,
    faults: Arc<SerialFaults>,
    settings: Settings,
    dialect: Dialect,
    /// grblHAL's last error, which it repeats.
    sticky: Option<u8>,
    /// The modes as they were last told without being asked for.
    told_modes: String,
    homed: bool,
    parser: Parser,
    reporter: Reporter,
    received: VecDeque<u8>,
    line: LineBuffer,
    planner: VecDeque<Block>,
    running: Option<Running>,
    homing: Homing,
    /// The axis that is being homed, and whether the other follows.
    homing_axis: usize,
    homing_all: bool,
    /// Steps counted up to the move under way.
    position: [i64; 3],
    mode: Mode,
    wait: Wait,
    inputs: Inputs,
    /// When the motors lose their current, unless they move again.
    release_s: Option<f64>,
    out: Vec<u8>,
}

impl serial::Firmware for Firmware {
    fn restarts_when_opened(&self) -> bool {
        true
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn lose_power(&mut self, now_s: f64) {
        self.stop_motor(now_s);
        self.position = [0; 3];
        self.homed = false;
        self.forget();
    }

    fn boot(&mut self) {
        if self.faults.take_erased_memory() {
            self.settings = Settings::factory();
            self.say("error:7\r\n");
            let report = self.settings.report(self.dialect);
            self.say(&report);
        }
        self.mode = if self.settings.is_on(22) { Mode::Alarm } else { self.at_rest() };
        self.greet();
    }

    fn next_event_s(&self) -> Option<f64> {
        let motion = self.running.as_ref().map(|r| r.limit_s.unwrap_or_else(|| r.end_s()));
        let dwell = match self.wait {
            Wait::Dwell { until_s } => Some(until_s),
            _ => None,
        };
        [motion, dwell, self.release_s].into_iter().flatten().reduce(f64::min)
    }

    fn advance(&mut self, now_s: f64) {
        while let Some(at_s) = self.next_event_s().filter(|at| *at <= now_s) {
            if self.release_s.is_some_and(|release_s| release_s <= at_s) {
                self.release_s = None;
                self.shaft.release();
            }
            if let Wait::Dwell { until_s } = self.wait
                && until_s <= at_s
            {
                self.wait = Wait::Nothing;
                self.ok();
            }
            if self.running.as_ref().is_some_and(|r| r.limit_s.is_some_and(|limit| limit <= at_s)) {
                self.stop_motor(at_s);
                self.critical(1);
            } else if self.running.as_ref().is_some_and(|r| r.end_s() <= at_s) {
                self.arrived(at_s);
            }
            self.main_loop(at_s);
        }
    }

    fn button(&mut self, button: Button, pressed: bool, now_s: f64) {
        match button {
            Button::FeedHold => self.inputs.hold = pressed,
            Button::CycleStart => {}
            Button::Door => self.inputs.door_open = pressed,
            Button::EmergencyStop => self.inputs.stop = pressed,
        }
        match button {
            _ if !pressed => {}
            Button::FeedHold => self.hold(now_s),
            Button::CycleStart => self.resume(),
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
                b'?' => self.status(now_s),
                b'!' => self.hold(now_s),
                b'~' => self.resume(),
                0x85 => self.cancel_jog(now_s),
                0x87 if self.dialect.is_hal() => self.full_status(now_s),
                0x80.. => {}
                _ if self.received.len() < self.dialect.receive_bytes() => self.received.push_back(byte),
                _ => self.faults.count_lost_byte(),
            }
            self.main_loop(now_s);
        }
    }
}

impl Firmware {
    pub fn new(shaft: Arc<Shaft>, slide: Option<Arc<Slide>>, faults: Arc<SerialFaults>, settings: Settings, dialect: Dialect) -> Self {
        Self {
            shaft,
            slide,
            sampler: None,
            faults,
            settings,
            dialect,
            sticky: None,
            told_modes: Parser::default().report(),
            homed: false,
            parser: Parser::default(),
            reporter: Reporter::default(),
            received: VecDeque::new(),
            line: LineBuffer::default(),
            planner: VecDeque::new(),
            running: None,
            homing: Homing::Search,
            homing_axis: SHAFT,
            homing_all: true,
            position: [0; 3],
            mode: Mode::Idle,
            wait: Wait::Nothing,
            inputs: Inputs::default(),
            release_s: None,
            out: Vec::new(),
        }
    }

    pub fn with_sampler(self, sampler: Option<Arc<VendorSampler>>) -> Self {
        Self { sampler, ..self }
    }

    fn tell_sampler(&self) {
        if let Some(sampler) = &self.sampler {
            sampler.done(self.parser.is_flooding());
        }
    }

    // ---- the main loop: lines

    fn main_loop(&mut self, now_s: f64) {
        loop {
            self.start(now_s);
            self.unblock(now_s);
            let deaf = matches!(self.mode, Mode::Critical | Mode::Hold | Mode::Door | Mode::Sleep | Mode::EmergencyStop);
            let listening = matches!(self.wait, Wait::Nothing) && !deaf;
            let Some(byte) = listening.then(|| self.received.pop_front()).flatten() else { break };
            match self.line.push(byte) {
                None => {}
                Some(Err(Overflow)) => self.error(11),
                Some(Ok(line)) => self.execute(&line, now_s),
            }
        }
    }

    /// Goes on where the main loop had to wait, if it need not any more.
    fn unblock(&mut self, now_s: f64) {
        match self.wait {
            Wait::Slot(block) if self.free_blocks() > 0 => {
                self.wait = Wait::Nothing;
                self.planner.push_back(block);
                self.ok();
            }
            Wait::Drained(then) if self.planner.is_empty() && self.running.is_none() && self.mode == Mode::Idle => {
                self.wait = Wait::Nothing;
                match then {
                    Then::Answer => self.ok(),
                    Then::Dwell { seconds } => {
                        let steps = (f64::from(seconds) / DWELL_STEP_S).ceil();
                        self.wait = Wait::Dwell { until_s: now_s + steps * DWELL_STEP_S };
                    }
                    Then::Pause => {
                        self.ok();
                        self.mode = Mode::Hold;
                    }
                    Then::End => {
                        self.say("[MSG:Pgm End]\r\n");
                        self.ok();
                    }
                }
            }
            _ => {}
        }
    }

    fn execute(&mut self, line: &[u8], now_s: f64) {
        let last_error = self.sticky.take();
        match line {
            [] => self.ok(),
            [b'$', command @ ..] => match self.command(command, now_s) {
                Ok(true) => self.ok(),
                Ok(false) => {}
                Err(number) => self.error(number),
            },
            _ if matches!(self.mode, Mode::Alarm | Mode::Jog) => self.error(9),
            code => {
                if let Some(number) = last_error {
                    return self.error(number);
                }
                let offset = self.parser.offset();
                match self.parser.take(code) {
                    Ok(action) => self.act(action, now_s),
                    Err(number) => self.error(number),
                }
                self.tell_sampler();
                if self.parser.offset().map(f32::to_bits) != offset.map(f32::to_bits) {
                    self.reporter.offset_changed();
                }
            }
        }
    }

    fn act(&mut self, action: Action, now_s: f64) {
        match action {
            _ if self.mode == Mode::Check => self.ok(),
            Action::None => self.ok(),
            Action::Move { target, feed } => {
                if self.beyond_soft_limits(target) {
                    return self.soft_limit(now_s);
                }
                self.queue(target, feed);
            }
            Action::Dwell { seconds } => self.wait = Wait::Drained(Then::Dwell { seconds }),
            Action::Synchronise => self.wait = Wait::Drained(Then::Answer),
            Action::Pause => self.wait = Wait::Drained(Then::Pause),
            Action::End => self.wait = Wait::Drained(Then::End),
        }
    }

    /// A `$` command; whether it is to be answered now. The error is Grbl's number.
    fn command(&mut self, command: &[u8], now_s: f64) -> Result<bool, u8> {
        let quiet = matches!(self.mode, Mode::Idle | Mode::Alarm);
        match command {
            [] => self.say("[HLP:$$ $# $G $I $N $x=val $J=line $X $H ~ ! ? ctrl-x]\r\n"),
            b"G" => self.say(&self.parser.report()),
            b"X" | b"H" | b"HX" | b"HY" if self.inputs.door_open => return Err(13),
            b"C" if self.mode == Mode::Check => {
                self.mode = Mode::Idle;
                self.ok();
                self.restart();
                return Ok(false);
            }
            b"X" => {
                if self.mode == Mode::Alarm {
                    self.mode = Mode::Idle;
                    self.say("[MSG:Caution: Unlocked]\r\n");
                }
            }
            [b'J', b'=', line @ ..] => return self.jog(line),
            // Everything else touches the EEPROM or prints for long: only at rest.
            _ if !quiet => return Err(8),
            b"$" => self.say(&self.settings.report(self.dialect)),
            b"#" => self.say(&self.parser.report_offsets()),
            b"I" => self.say(self.dialect.version()),
            b"N" => self.say("$N0=\r\n$N1=\r\n"),
            b"C" if self.mode == Mode::Idle => self.mode = Mode::Check,
            b"SLP" => self.mode = Mode::Sleep,
            b"H" | b"HX" | b"HY" => {
                if !self.settings.is_on(22) {
                    return Err(5);
                }
                if command == b"HY" && self.slide.is_none() {
                    return Err(3);
                }
                self.homing_axis = if command == b"HY" { SLIDE } else { SHAFT };
                self.homing_all = command == b"H";
                self.mode = Mode::Home;
                self.homed = false;
                self.wait = Wait::Homing;
                self.home(Homing::Search, now_s);
                return Ok(false);
            }
            setting => self.store(setting)?,
        }
        Ok(true)
    }

    fn store(&mut self, setting: &[u8]) -> Result<(), u8> {
        let (number, used) = words::number(setting).ok_or(3)?;
        let [b'=', value @ ..] = &setting[used..] else { return Err(3) };
        let (value, used) = words::number(value).filter(|(_, n)| *n == value.len()).ok_or(2)?;
        if used == 0 || number.fract() != 0.0 || !(0.0..=255.0).contains(&number) {
            return Err(3);
        }
        self.settings.set(number as u16, value)
    }

    fn jog(&mut self, line: &[u8]) -> Result<bool, u8> {
        if !matches!(self.mode, Mode::Idle | Mode::Jog) {
            return Err(if self.mode == Mode::Alarm { 9 } else { 8 });
        }
        let before = self.parser.position;
        let Action::Move { target, feed } = self.parser.jog(line)? else { return Err(16) };
        if self.beyond_soft_limits(target) {
            self.parser.position = before;
            return Err(15);
        }
        self.mode = Mode::Jog;
        self.queue(target, feed);
        Ok(false)
    }

    // ---- motion

    /// Puts a move into the planner, or the main loop to sleep until there is room. Answers either way.
    fn queue(&mut self, target: [f32; 3], feed: Option<f32>) {
        let per_unit = self.settings.per_axis(100);
        let planned = self.planned_position();
        let steps: [i64; 3] = std::array::from_fn(|i| (target[i] * per_unit[i]).round() as i64 - planned[i]);
        if steps == [0; 3] {
            return self.ok();
        }
        let units: [f64; 3] = std::array::from_fn(|i| steps[i] as f64 / f64::from(per_unit[i]));
        let length = units.iter().map(|u| u * u).sum::<f64>().sqrt();
        // The axis that reaches its own limit first limits the path.
        let along_path = |limits: [f32; 3]| {
            (0..3).filter(|&i| steps[i] != 0).map(|i| f64::from(limits[i]) * length / units[i].abs()).fold(f64::INFINITY, f64::min)
        };
        let rapid = along_path(self.settings.per_axis(110)) / 60.0;
        let speed = feed.map_or(rapid, |f| rapid.min(f64::from(f) / 60.0));
        let block = Block { steps, length, speed: speed.max(1e-3), acceleration: along_path(self.settings.per_axis(120)).max(1e-3) };
        if self.free_blocks() > 0 {
            self.planner.push_back(block);
            self.ok();
        } else {
            self.wait = Wait::Slot(block);
        }
    }

    /// The block under way keeps its place until it is done.
    fn free_blocks(&self) -> usize {
        self.dialect.planner_blocks().saturating_sub(self.planner.len() + usize::from(self.running.is_some()))
    }

    fn planned_position(&self) -> [i64; 3] {
        let mut at = self.position;
        for block in self.running.iter().map(|r| &r.block).chain(&self.planner) {
            for (a, s) in at.iter_mut().zip(block.steps) {
                *a += s;
            }
        }
        at
    }

    /// The planner starts by itself once the line at hand is done.
    fn start(&mut self, now_s: f64) {
        if self.running.is_some() || !matches!(self.mode, Mode::Idle | Mode::Run | Mode::Jog) {
            return;
        }
        let Some(block) = self.planner.pop_front() else {
            if matches!(self.mode, Mode::Run | Mode::Jog) {
                self.mode = Mode::Idle;
            }
            return;
        };
        if self.mode == Mode::Idle {
            self.mode = Mode::Run;
        }
        self.run(block, now_s);
    }

    fn run(&mut self, block: Block, start_s: f64) {
        self.release_s = None;
        let profile = Arc::new(MotionProfile::trapezoid(block.length, block.speed, block.acceleration));
        let limit_s = (self.settings.is_on(21) && self.mode != Mode::Home).then(|| self.limit_hit_s(&block, &profile, start_s)).flatten();
        if block.steps[0] != 0 {
            self.shaft.begin(start_s, block.steps[0], block.length, Arc::clone(&profile));
        }
        if let (Some(slide), true) = (&self.slide, block.steps[SLIDE] != 0) {
            slide.begin(start_s, block.steps[SLIDE], block.length, Arc::clone(&profile));
        }
        self.running = Some(Running { block, start_s, profile, limit_s, brake: None });
    }

    fn limit_hit_s(&self, block: &Block, profile: &MotionProfile, start_s: f64) -> Option<f64> {
        let hit = |steps: i64, to_switch: i64| {
            (steps != 0 && to_switch <= steps.abs())
                .then(|| start_s + profile.time_at_s(block.length * to_switch as f64 / steps.unsigned_abs() as f64))
        };
        let [turn, along, _] = block.steps;
        let index = hit(turn, self.shaft.steps_to_next_index(turn.signum()));
        let end = self.slide.as_ref().and_then(|slide| hit(along, slide.steps_to_end(along.signum())));
        index.into_iter().chain(end).reduce(f64::min)
    }

    /// The move under way is over, as planned or by braking.
    fn arrived(&mut self, at_s: f64) {
        let Some(running) = self.running.take() else { return };
        let done = self.count(&running, at_s);
        self.release_s = self.settings.idle_s(SHAFT, self.dialect).map(|idle_s| at_s + idle_s);
        match running.brake {
            None if self.mode == Mode::Home => self.homed(at_s),
            None => {}
            Some(Brake::Hold) => {
                let steps: [i64; 3] = std::array::from_fn(|i| running.block.steps[i] - done[i]);
                if steps != [0; 3] {
                    let length = running.block.length * (1.0 - running.part(at_s)).max(f64::EPSILON);
                    self.planner.push_front(Block { steps, length, ..running.block });
                }
            }
            Some(Brake::CancelJog) => {
                self.planner.clear();
                self.wait = Wait::Nothing;
                self.mode = Mode::Idle;
                self.parser.position = self.machine(self.position);
            }
            Some(Brake::SoftLimit) => self.critical(2),
        }
    }

    /// Adds what a move has issued to the position.
    fn count(&mut self, running: &Running, at_s: f64) -> [i64; 3] {
        let mut done = running.steps(at_s);
        if running.block.steps[0] != 0 {
            done[0] = self.shaft.end(at_s);
        }
        if let (Some(slide), true) = (&self.slide, running.block.steps[SLIDE] != 0) {
            done[SLIDE] = slide.end(at_s);
        }
        for (p, d) in self.position.iter_mut().zip(done) {
            *p += d;
        }
        done
    }

    fn brake(&mut self, why: Brake, now_s: f64) -> bool {
        let Some(running) = &mut self.running else { return false };
        if running.brake.is_none() {
            let (from, speed) = (running.profile.travelled(now_s - running.start_s), running.profile.speed(now_s - running.start_s));
            let profile = Arc::new(MotionProfile::braking(from, speed, running.block.acceleration, running.block.length));
            if running.block.steps[0] != 0 {
                self.shaft.replan(now_s, Arc::clone(&profile));
            }
            if let (Some(slide), true) = (&self.slide, running.block.steps[SLIDE] != 0) {
                slide.replan(now_s, Arc::clone(&profile));
            }
            running.start_s = now_s;
            running.profile = profile;
        }
        running.brake = Some(why);
        true
    }

    fn hold(&mut self, now_s: f64) {
        match self.mode {
            Mode::Jog => self.cancel_jog(now_s),
            Mode::Idle | Mode::Run => {
                self.mode = Mode::Hold;
                self.brake(Brake::Hold, now_s);
            }
            _ => {}
        }
    }

    fn open_door(&mut self, now_s: f64) {
        match self.mode {
            Mode::Idle | Mode::Run | Mode::Jog | Mode::Hold => {
                self.mode = Mode::Door;
                self.brake(Brake::Hold, now_s);
            }
            Mode::Home => {
                self.stop_motor(now_s);
                self.homing_failed(7);
            }
            _ => {}
        }
    }

    fn emergency_stop(&mut self, now_s: f64) {
        self.stop_motor(now_s);
        self.forget();
        self.homed = false;
        self.mode = Mode::EmergencyStop;
        self.say("ALARM:10\r\n[MSG:Emergency stop]\r\n");
    }

    fn resume(&mut self) {
        let may = self.mode == Mode::Hold || self.mode == Mode::Door && !self.inputs.door_open;
        if may && self.running.is_none() {
            self.mode = Mode::Idle;
        }
    }

    /// What an unlocked controller is in where nothing moves.
    fn at_rest(&self) -> Mode {
        if self.inputs.door_open { Mode::Door } else { Mode::Idle }
    }

    fn cancel_jog(&mut self, now_s: f64) {
        if self.mode == Mode::Jog {
            self.brake(Brake::CancelJog, now_s);
        }
    }

    fn stop_motor(&mut self, now_s: f64) {
        if let Some(running) = self.running.take() {
            self.count(&running, now_s);
        }
    }

    // ---- homing

    fn home(&mut self, phase: Homing, start_s: f64) {
        self.homing = phase;
        let axis = self.homing_axis;
        let per_unit = f64::from(self.settings.per_axis(100)[axis]);
        let direction = self.homing_direction();
        let pull_off = f64::from(self.settings.get(27)) * per_unit;
        let (steps, feed) = match phase {
            Homing::Search | Homing::Locate => {
                let (range, feed) = if phase == Homing::Search {
                    (HOMING_SEARCH * f64::from(self.settings.per_axis(130)[axis]) * per_unit, self.settings.get(25))
                } else {
                    (HOMING_LOCATE * pull_off, self.settings.get(24))
                };
                let to_go = match (&self.slide, axis) {
                    (Some(slide), SLIDE) => slide.steps_to_end(direction),
                    _ => self.shaft.steps_to_index(direction),
                };
                if to_go as f64 > range {
                    return self.homing_failed(9);
                }
                (direction * to_go, feed)
            }
            Homing::PullOff | Homing::Leave => (-direction * pull_off.round() as i64, self.settings.get(25)),
        };
        if steps == 0 {
            return self.homed(start_s);
        }
        let length = steps.unsigned_abs() as f64 / per_unit;
        let (speed, acceleration) = ((f64::from(feed) / 60.0).max(1e-3), f64::from(self.settings.per_axis(120)[axis]).max(1e-3));
        let debounce_s = f64::from(self.settings.get(26)) / 1000.0;
        let mut block = Block { steps: [0; 3], length, speed, acceleration };
        block.steps[axis] = steps;
        self.run(block, start_s + debounce_s);
    }

    fn homing_direction(&self) -> i64 {
        if (self.settings.get(23) as i64 >> self.homing_axis) & 1 == 0 { 1 } else { -1 }
    }

    fn at_homing_switch(&self, at_s: f64) -> bool {
        match (&self.slide, self.homing_axis) {
            (Some(slide), SLIDE) => slide.steps_to_end(self.homing_direction()) == 0,
            _ => self.shaft.at_index(at_s),
        }
    }

    /// One leg of the homing cycle is done.
    fn homed(&mut self, at_s: f64) {
        match self.homing {
            Homing::Search => self.home(Homing::PullOff, at_s),
            Homing::PullOff if self.at_homing_switch(at_s) => self.homing_failed(8),
            Homing::PullOff => self.home(Homing::Locate, at_s),
            Homing::Locate => {
                if self.homing_axis == SHAFT {
                    self.shaft.count_from_here();
                }
                self.home(Homing::Leave, at_s);
            }
            Homing::Leave => {
                let axis = self.homing_axis;
                let pull_off = self.settings.get(27);
                let units = if self.homing_direction() > 0 { -pull_off } else { pull_off - self.settings.per_axis(130)[axis] };
                self.position[axis] = (units * self.settings.per_axis(100)[axis]).round() as i64;
                if self.homing_all && axis == SHAFT && self.slide.is_some() {
                    self.homing_axis = SLIDE;
                    return self.home(Homing::Search, at_s);
                }
                self.parser.position = self.machine(self.position);
                self.mode = Mode::Idle;
                self.homed = true;
                self.wait = Wait::Nothing;
                self.ok();
            }
        }
    }

    fn homing_failed(&mut self, number: u8) {
        self.say(&format!("ALARM:{number}\r\n"));
        self.mode = Mode::Alarm;
        self.restart();
    }

    // ---- alarms and resets

    fn beyond_soft_limits(&self, target: [f32; 3]) -> bool {
        let travel = self.settings.per_axis(130);
        self.settings.is_on(20) && (0..3).any(|i| target[i] > 0.0 || target[i] < -travel[i])
    }

    fn soft_limit(&mut self, now_s: f64) {
        self.planner.clear();
        if self.brake(Brake::SoftLimit, now_s) {
            self.mode = Mode::Hold;
        } else {
            self.critical(2);
        }
    }

    fn critical(&mut self, number: u8) {
        self.planner.clear();
        self.wait = Wait::Nothing;
        self.mode = Mode::Critical;
        self.say(&format!("ALARM:{number}\r\n[MSG:Reset to continue]\r\n"));
    }

    fn reset(&mut self, now_s: f64) {
        if self.mode == Mode::EmergencyStop && self.inputs.stop {
            return self.emergency_stop(now_s);
        }
        let alarm = match (self.mode, &self.running) {
            (Mode::Home, _) => Some(6),
            (_, Some(_)) => Some(3),
            (_, None) => None,
        };
        self.stop_motor(now_s);
        if let Some(number) = alarm {
            self.say(&format!("ALARM:{number}\r\n"));
        }
        let locked = alarm.is_some() || matches!(self.mode, Mode::Alarm | Mode::Critical | Mode::Sleep | Mode::EmergencyStop);
        self.mode = if locked { Mode::Alarm } else { self.at_rest() };
        self.restart();
    }

    /// What every reset does: queues and modes are forgotten, the position is not.
    fn restart(&mut self) {
        self.forget();
        self.greet();
    }

    fn forget(&mut self) {
        self.received.clear();
        self.line = LineBuffer::default();
        self.planner.clear();
        self.wait = Wait::Nothing;
        self.parser = Parser::at(self.machine(self.position));
        self.tell_sampler();
        self.reporter = Reporter::default();
        self.sticky = None;
        self.told_modes = self.parser.report();
    }

    fn greet(&mut self) {
        self.say(self.dialect.greeting());
        if self.mode == Mode::Alarm {
            self.say("[MSG:'$H'|'$X' to unlock]\r\n");
        }
    }

    // ---- answers

    /// Tells every optional field at once.
    fn full_status(&mut self, now_s: f64) {
        self.reporter = Reporter::default();
        self.report(now_s, true);
    }

    fn status(&mut self, now_s: f64) {
        self.report(now_s, false);
    }

    fn report(&mut self, now_s: f64, full: bool) {
        let state = match (self.mode, &self.running) {
            // A controller that waits for a reset answers nothing else.
            (Mode::Critical, _) => return,
            (Mode::Idle, _) => "Idle",
            (Mode::Run, _) => "Run",
            (Mode::Hold, Some(_)) => "Hold:1",
            (Mode::Hold, None) => "Hold:0",
            (Mode::Jog, _) => "Jog",
            (Mode::Home, _) => "Home",
            (Mode::Door, Some(_)) => "Door:2",
            (Mode::Door, None) if self.inputs.door_open => "Door:1",
            (Mode::Door, None) => "Door:0",
            (Mode::Check, _) => "Check",
            (Mode::Sleep, _) => "Sleep",
            // The number of an alarm comes with a full report only, as grblHAL is set by default.
            (Mode::EmergencyStop, _) if full => "Alarm:10",
            (Mode::Alarm | Mode::EmergencyStop, _) => "Alarm",
        };
        let mut steps = self.position;
        let mut feed = 0.0;
        if let Some(running) = &self.running {
            for (s, d) in steps.iter_mut().zip(running.steps(now_s)) {
                *s += d;
            }
            feed = (running.profile.speed(now_s - running.start_s) * 60.0) as f32;
        }
        let snapshot = Snapshot {
            state,
            busy: !matches!(self.mode, Mode::Idle | Mode::Alarm),
            machine: self.machine(steps),
            offset: self.parser.offset(),
            feed,
            at_limit: self.shaft.at_index(now_s),
            control: self.control_inputs(),
            at_probe: self.sampler.as_ref().is_some_and(|sampler| sampler.line()),
            free: (self.free_blocks(), self.dialect.receive_bytes() - self.received.len()),
            homed: self.dialect.is_hal().then_some(self.homed),
            mask: self.settings.get(10) as u8,
        };
        let text = self.reporter.status(&snapshot);
        let modes = self.parser.report();
        if self.dialect.is_hal() && modes != self.told_modes {
            self.say(&modes);
            self.told_modes = modes;
        }
        self.say(&text);
    }

    fn control_inputs(&self) -> String {
        let stop = if self.dialect.is_hal() { "E" } else { "R" };
        let Inputs { hold, door_open, stop: stopped } = self.inputs;
        [(door_open, "D"), (hold, "H"), (stopped, stop)].into_iter().filter_map(|(active, letter)| active.then_some(letter)).collect()
    }

    fn machine(&self, steps: [i64; 3]) -> [f32; 3] {
        let per_unit = self.settings.per_axis(100);
        std::array::from_fn(|i| steps[i] as f32 / per_unit[i])
    }

    fn ok(&mut self) {
        if !self.faults.take_dropped_ok() {
            self.say("ok\r\n");
        }
    }

    fn error(&mut self, number: u8) {
        self.sticky = self.dialect.is_hal().then_some(number);
        self.say(&format!("error:{number}\r\n"));
    }

    fn say(&mut self, text: &str) {
        self.out.extend_from_slice(text.as_bytes());
    }
}

struct Overflow;

/// Gathers a line as the firmware does: white space dropped, comments dropped, lower case raised.
#[derive(Default)]
struct LineBuffer {
    bytes: Vec<u8>,
    overflow: bool,
    comment: Comment,
}

#[derive(Default, PartialEq)]
enum Comment {
    #[default]
    None,
    Parenthesis,
    Semicolon,
}

impl LineBuffer {
    /// A line, once its end has come.
    fn push(&mut self, byte: u8) -> Option<Result<Vec<u8>, Overflow>> {
        if matches!(byte, b'\n' | b'\r') {
            let done = std::mem::take(self);
            return Some(if done.overflow { Err(Overflow) } else { Ok(done.bytes) });
        }
        match (&self.comment, byte) {
            (Comment::Parenthesis, b')') => self.comment = Comment::None,
            (Comment::Parenthesis | Comment::Semicolon, _) | (_, ..=b' ' | b'/') => {}
            (_, b'(') => self.comment = Comment::Parenthesis,
            (_, b';') => self.comment = Comment::Semicolon,
            _ if self.bytes.len() >= LINE_BYTES => self.overflow = true,
            _ => self.bytes.push(byte.to_ascii_uppercase()),
        }
        None
    }
}

#[cfg(test)]
#[path = "firmware_tests.rs"]
mod tests;
