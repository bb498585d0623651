//! The stages of a set-up, without any input or output of their own.
//!
//! ```text
//!               ┌─ Ask(Question) ──► person ──► answer ──┐
//! State ─ next ─┼─ Act(Action) ────► Bench ───► done ────┼──► State
//!               └─ Finished            failed: the question before is asked again, with the reason
//! controller ─ steps ─ camera ─ empty capillary, bore ─ bead ─ turn: steps, sense ─ bead: scale, axis ─ bead again: right? ─ file
//! ```
//! `next` looks for the first thing that is missing. So an interrupted set-up goes on where it was, and a wrong value is corrected by
//! removing it together with what follows from it.

use super::bench::{Action, Bead, Bench, Controller, Empty, FoundExposure, Listed, Outcome, Request, Turn, Written};
use super::draft::{Draft, shipped};
use super::period::likely;
use super::question::{Choice, Kind, Question, steps};
use carved_core::calibration::rig::{ASPECT_OFF_MOST, bead_extents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// What comes next.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    Ask(Box<Question>),
    Act(Action),
    Finished,
}

/// An answer was not taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// It cannot be right.
    Wrong(String),
    /// It is unusual. The same answer a second time is taken.
    Doubtful(String),
}

impl Refused {
    pub fn text(&self) -> String {
        match self {
            Self::Wrong(why) => why.clone(),
            Self::Doubtful(why) => format!("{why}. If it is right, give the same answer again"),
        }
    }
}

/// Everything that is known, as it is stored beside the configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    answers: BTreeMap<String, String>,
    /// The ids of the answers, in the order of answering.
    order: Vec<String>,
    problem: Option<Problem>,
    ports: Option<Vec<Listed>>,
    controller: Option<Controller>,
    cameras: Option<Vec<Listed>>,
    exposure: Option<FoundExposure>,
    empty: Option<Empty>,
    is_home: bool,
    turn: Option<Turn>,
    /// Measured with the scale of the bore.
    bead: Option<Bead>,
    /// Measured with the scale that is written.
    proof: Option<Bead>,
    written: Option<Written>,
}

#[cfg(feature = "simulate")]
impl State {
    /// Whether the person said that the bead is in the picture.
    pub fn is_loaded(&self) -> bool {
        self.answers.contains_key("loaded")
    }
}

/// Why a question is asked again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Problem {
    id: String,
    text: String,
    proposal: Option<String>,
}

/// The set-up.
#[derive(Debug, Clone, Default)]
pub struct Machine {
    state: State,
    /// An answer that was doubted, with its question. It is not stored.
    doubted: Option<(String, String)>,
}

/// The stages, for a person.
pub const STAGES: [&str; 8] = ["Controller", "Camera", "Empty capillary", "Bead", "Two turns", "Scale", "Proof", "File"];

/// The answer of a rig whose light carved does not switch.
const NO_LIGHT: &str = "none";
/// Time that a light gets to become steady, ms: a LED and its driver need less than a tenth of this.
const LIGHT_SETTLE_MS: u32 = 100;

/// The last question. It is asked only where a file exists or could not be written.
const REPLACE: &str = "replace";

/// Diameters of capillary bores that are in use, um, and of beads.
const BEAD_UM: [f64; 2] = [20.0, 4500.0];
/// Usual diameters of beads, as shares of the bore.
const USUAL_BEAD: [f64; 2] = [0.2, 0.97];
/// A larger difference between bead and bore is a wrong number, not a scale to be corrected, %.
const MOST_SCALE_PERCENT: f64 = 15.0;
/// From this difference on, a person must say which of both is the ruler, %. The walls of a bore are seen to half a per cent, and capillaries
/// are made to one or two.
const UNUSUAL_SCALE_PERCENT: f64 = 4.0;
/// Least overlap of the bead with itself after one turn.
pub const LEAST_CLOSURE: f64 = 0.95;
/// Largest difference of the steps of a turn from the configured ones.
pub const MOST_STEPS_OFF: f64 = 0.005;
/// Blur above this multiple of the method's is out of focus.
const MOST_BLUR: f64 = 2.5;

impl Machine {
    /// Goes on from a stored state. The confirmation that the motors may move is asked for again, and the controller is asked who it is:
    /// its port may have another name by now, and another device its old one.
    pub fn resume(state: State) -> Self {
        let mut machine = Self { state, doubted: None };
        if machine.state.proof.is_none() {
            machine.forget("motion");
            machine.state.is_home = false;
            machine.state.ports = None;
            machine.state.controller = None;
        }
        machine
    }

    pub fn state(&self) -> &State {
        &self.state
    }

    /// The number of the stage in [`STAGES`] to which a step belongs, or one more for the end.
    pub fn stage(&self, step: &Step) -> usize {
        let at = match step {
            Step::Ask(question) => match question.id {
                "name" | "controller" | "steps" | "reference" | "light" => "Controller",
                "camera" | "pixel_format" | "width" | "height" | "data_dir" => "Camera",
                "empty" | "bore_um" => "Empty capillary",
                "bead_um" | "tolerance_percent" | "loaded" => "Bead",
                "motion" | "sense" => "Two turns",
                "ruler" => "Scale",
                _ => "File",
            },
            Step::Act(action) => match action {
                Action::ListPorts | Action::Identify => "Controller",
                Action::ListCameras => "Camera",
                Action::Expose | Action::LookAtEmpty => "Empty capillary",
                Action::Home | Action::Turn => "Two turns",
                Action::Measure if self.state.bead.is_none() => "Scale",
                Action::Measure => "Proof",
                Action::Write => "File",
            },
            Step::Finished => return STAGES.len(),
        };
        STAGES.iter().position(|stage| *stage == at).unwrap_or(STAGES.len())
    }

    /// The questions that are answered, with their answers, in the order of answering.
    pub fn given(&self) -> impl Iterator<Item = (&str, &str)> {
        self.state.order.iter().filter_map(|id| Some((id.as_str(), self.answered(id)?)))
    }

    /// Removes an answer, and nothing that follows from it.
    fn forget(&mut self, id: &str) {
        self.state.answers.remove(id);
        self.state.order.retain(|other| other != id);
    }

    fn answered(&self, id: &str) -> Option<&str> {
        self.state.answers.get(id).map(String::as_str)
    }

    fn number(&self, id: &str) -> Option<f64> {
        self.answered(id)?.parse().ok()
    }

    /// What comes next. `exists`: the configuration's file exists already.
    pub fn next(&self, exists: bool) -> Step {
        let s = &self.state;
        let missing = |id: &str| self.answered(id).is_none();
        let steps = [
            (missing("name"), self.ask("name")),
            (s.ports.is_none(), Step::Act(Action::ListPorts)),
            (missing("controller"), self.ask("controller")),
            (s.controller.is_none(), Step::Act(Action::Identify)),
            (missing("steps"), self.ask("steps")),
            (missing("reference") && self.can_home(), self.ask("reference")),
            (missing("light") && self.can_home(), self.ask("light")),
            (s.cameras.is_none(), Step::Act(Action::ListCameras)),
            (missing("camera"), self.ask("camera")),
            (missing("pixel_format"), self.ask("pixel_format")),
            (missing("width"), self.ask("width")),
            (missing("height"), self.ask("height")),
            (missing("data_dir"), self.ask("data_dir")),
            (missing("empty"), self.ask("empty")),
            (s.exposure.is_none(), Step::Act(Action::Expose)),
            (s.empty.is_none(), Step::Act(Action::LookAtEmpty)),
            (missing("bore_um"), self.ask("bore_um")),
            (missing("bead_um"), self.ask("bead_um")),
            (missing("tolerance_percent"), self.ask("tolerance_percent")),
            (missing("loaded"), self.ask("loaded")),
            (missing("motion"), self.ask("motion")),
            (!s.is_home && s.proof.is_none(), Step::Act(Action::Home)),
            (s.turn.is_none(), Step::Act(Action::Turn)),
            (missing("sense"), self.ask("sense")),
            (s.bead.is_none(), Step::Act(Action::Measure)),
            (missing("ruler"), self.ask("ruler")),
            (s.proof.is_none(), Step::Act(Action::Measure)),
            (missing(REPLACE) && s.written.is_none() && (exists || s.problem.is_some()), self.ask(REPLACE)),
            (s.written.is_none(), Step::Act(Action::Write)),
        ];
        steps.into_iter().find_map(|(is_missing, step)| is_missing.then_some(step)).unwrap_or(Step::Finished)
    }

    fn can_home(&self) -> bool {
        self.state.controller.as_ref().is_some_and(|c| ["grbl", "zaber", "tmcl"].contains(&c.driver.as_str()))
    }

    fn ask(&self, id: &'static str) -> Step {
        Step::Ask(Box::new(self.question(id)))
    }

    /// A question, as it is asked now.
    pub fn question(&self, id: &'static str) -> Question {
        let (text, kind, default) = self.words(id);
        let problem = self.state.problem.as_ref().filter(|problem| problem.id == id);
        let default = problem.and_then(|p| p.proposal.clone()).or(default);
        Question { id, text, kind, default, problem: problem.map(|p| p.text.clone()) }
    }

    /// Text, form and default of a question.
    fn words(&self, id: &str) -> (String, Kind, Option<String>) {
        let s = &self.state;
        let listed = |list: &Option<Vec<Listed>>| list.iter().flatten().map(|l| Choice::new(&l.name, &l.label)).collect::<Vec<_>>();
        let only = |options: &[Choice]| if let [one] = options { Some(one.value.clone()) } else { None };
        let some = |text: &str| Some(text.to_owned());
        let chosen = |options: &[(&str, &str)]| Kind::Choice {
            options: options.iter().map(|(value, label)| Choice::new(*value, *label)).collect(),
            open: false,
        };
        let pixels = Kind::Number { unit: "px", range: [64.0, 65_535.0] };
        match id {
            "controller" => {
                let options = listed(&s.ports);
                let text = "Port of the controller that turns the capillary, such as /dev/ttyUSB0, or HOST:PORT of a VAST relay.";
                let default = only(&options);
                (text.into(), Kind::Choice { options, open: true }, default)
            }
            "steps" => (
                "Motor steps of one turn of the capillary: motor steps x microsteps x gear, such as 500, 200 x 16 or 200 x 32 x 5/2."
                    .into(),
                Kind::Steps,
                some(if s.controller.as_ref().is_some_and(|c| ["zaber", "tmcl"].contains(&c.driver.as_str())) { "6400" } else { "500" }),
            ),
            "reference" => (
                "Where step 0 is.".into(),
                chosen(&[("home", "The motors search a home switch"), ("here", "Where the motors stand when carved starts")]),
                some(if s.controller.as_ref().and_then(|c| c.homes) == Some(false) { "here" } else { "home" }),
            ),
            "light" => (
                "Output of the controller that switches the light. carved then has it on while it takes pictures, and off otherwise."
                    .into(),
                Kind::Choice { options: self.light_pins(), open: false },
                some(NO_LIGHT),
            ),
            "camera" => {
                let options = listed(&s.cameras);
                let default = only(&options);
                ("Address of the camera that looks at the capillary.".into(), Kind::Choice { options, open: true }, default)
            }
            "pixel_format" => (
                "Format of the frames.".into(),
                chosen(&[("BayerRG8", "A colour camera, as on VAST"), ("Mono8", "Grey"), ("RGB8Packed", "Colour, made by the camera")]),
                some("BayerRG8"),
            ),
            "width" => ("Width of the picture, along the capillary.".into(), pixels, some("1024")),
            "height" => ("Height of the picture, across the capillary.".into(), pixels, some("1024")),
            "data_dir" => ("Folder for the runs.".into(), Kind::Text, some("/var/lib/carved")),
            "tolerance_percent" => (
                "How far the measured diameter may be from the stated one. The spread of the batch is on the certificate.".into(),
                Kind::Number { unit: "%", range: [0.1, 10.0] },
                some("1"),
            ),
            REPLACE => ("Write the configuration? A file of that name is kept with the ending .bak.".into(), Kind::Confirm, None),
            "name" => ("Name of this instrument. It is written into every recording.".into(), Kind::Text, some("vast-1")),
            _ => self.words_of_specimens(id),
        }
    }

    /// The outputs of the controller at which a light can be.
    fn light_pins(&self) -> Vec<Choice> {
        let numbered = |pins: std::ops::RangeInclusive<u32>, label: &str| {
            pins.map(|pin| Choice::new(pin.to_string(), format!("{label} {pin}"))).collect::<Vec<_>>()
        };
        let mut options = vec![Choice::new(NO_LIGHT, "None: the light is always on, or something else switches it")];
        options.extend(match self.state.controller.as_ref().map(|c| c.driver.as_str()) {
            Some("tmcl") => numbered(0..=7, "OUT"),
            Some("zaber") => numbered(1..=4, "Digital output"),
            _ => vec![
                Choice::new("flood_coolant", "Flood coolant, M8"),
                Choice::new("mist_coolant", "Mist coolant, M7"),
                Choice::new("spindle", "Spindle, M3"),
            ],
        });
        options
    }

    /// As `words`, for the questions about what is in the capillary.
    fn words_of_specimens(&self, id: &str) -> (String, Kind, Option<String>) {
        match id {
            "empty" => ("Flush the capillary, so that it is empty and full of water. Is it empty?".into(), Kind::Confirm, None),
            "bore_um" => (
                "Inner diameter of the capillary, by its data sheet.".into(),
                Kind::Number { unit: "um", range: [100.0, 5000.0] },
                Some("600".into()),
            ),
            "bead_um" => ("Certified diameter of the bead.".into(), Kind::Number { unit: "um", range: BEAD_UM }, Some("500".into())),
            "loaded" => ("Bring one bead into the middle of the picture. Is it there?".into(), Kind::Confirm, None),
            "motion" => (
                "The motors will now home and turn the capillary: two turns forwards, then one turn up to three times. Nothing else moves. Keep a \
                 hand on their power switch. May they move?"
                    .into(),
                Kind::Confirm,
                None,
            ),
            "sense" => (
                "While the capillary turned forwards, did its near side go down or up in the picture? A wrong answer makes the models mirror \
                 images; volumes do not change."
                    .into(),
                Kind::Choice {
                    options: vec![
                        Choice::new("down", "Down"),
                        Choice::new("up", "Up"),
                        Choice::new("unknown", "Not seen; measure it later with carved calibrate marked"),
                    ],
                    open: false,
                },
                Some("unknown".into()),
            ),
            _ => {
                let off = self.off_percent(self.state.bead.as_ref()).unwrap_or(0.0);
                let is_usual = off.abs() <= UNUSUAL_SCALE_PERCENT;
                let advice = if is_usual {
                    "The walls are seen to about half a per cent, so take the bead unless you doubt its certificate."
                } else {
                    "So large a difference comes from a wrong number: read both certificates again, and type back to correct the diameter of \
                     the bore or of the bead."
                };
                (
                    format!("By the scale of the bore the bead measures {off:+.2} % against its certificate. Which of both is the ruler? {advice}"),
                    Kind::Choice { options: vec![Choice::new("bead", "The bead"), Choice::new("bore", "The bore")], open: false },
                    is_usual.then(|| "bead".into()),
                )
            }
        }
    }

    /// Deviation of a measured diameter from the stated one, %.
    fn off_percent(&self, bead: Option<&Bead>) -> Option<f64> {
        Some(100.0 * (bead?.diameter_um / self.number("bead_um")? - 1.0))
    }

    /// Whether bead and bore contradict each other.
    fn contradicts(&self) -> bool {
        self.off_percent(self.state.bead.as_ref()).is_some_and(|off| off.abs() > MOST_SCALE_PERCENT)
    }

    /// Takes the answer to the question that `next` asks.
    ///
    /// # Errors
    /// The answer cannot be right, or is unusual and was given once only. Nothing has changed.
    pub fn answer(&mut self, typed: &str, bench: &dyn Bench) -> Result<(), Refused> {
        let Step::Ask(question) = self.next(bench.exists()) else { return Ok(()) };
        if typed.trim() == "back" {
            return self.back();
        }
        let value = question.kind.read(typed).map_err(Refused::Wrong)?;
        let before = bench.check(&self.draft()).unwrap_or_default();
        let mut later = self.clone();
        // What followed from an earlier answer was removed with it. Something that does not follow stays: two turns that were measured
        // before an interruption.
        later.forget(question.id);
        later.state.answers.insert(question.id.into(), value.clone());
        later.state.order.push(question.id.into());
        later.state.problem = None;
        let mut doubts = bench.check(&later.draft()).map_err(Refused::Wrong)?;
        doubts.retain(|doubt| !before.contains(doubt));
        doubts.extend(later.doubt(question.id)?);
        let given = (question.id.to_owned(), value);
        if !doubts.is_empty() && self.doubted.as_ref() != Some(&given) {
            self.doubted = Some(given);
            return Err(Refused::Doubtful(doubts.join(". ")));
        }
        later.doubted = None;
        *self = later;
        match question.id {
            "ruler" => self.judge_ruler(),
            // The person insists: not a number but the measurement is wrong.
            "bead_um" if question.problem.is_some() && self.contradicts() => {
                self.state.bead = None;
                self.state.is_home = false;
                self.forget("motion");
            }
            "bead_um" => self.judge_bead(),
            _ => {}
        }
        Ok(())
    }

    /// What no configuration holds, but bead and bore show together.
    fn doubt(&self, id: &str) -> Result<Option<String>, Refused> {
        let (Some(bead), Some(bore)) = (self.number("bead_um"), self.number("bore_um")) else { return Ok(None) };
        if !["bead_um", "bore_um"].contains(&id) {
            return Ok(None);
        }
        let share = bead / bore;
        if share >= 1.0 {
            return Err(Refused::Wrong(format!("A bead of {bead} um does not fit into a bore of {bore} um")));
        }
        let [least, most] = USUAL_BEAD.map(|share| share * bore);
        Ok((!(USUAL_BEAD[0]..=USUAL_BEAD[1]).contains(&share))
            .then(|| format!("A bead of {bead} um in a bore of {bore} um; usual are {least:.0} to {most:.0} um")))
    }

    /// Removes the newest answer, so that its question is asked again.
    fn back(&mut self) -> Result<(), Refused> {
        let Some(id) = self.state.order.last().cloned() else {
            return Err(Refused::Wrong("This is the first question".into()));
        };
        self.doubted = None;
        self.remove(&id);
        self.state.problem = None;
        Ok(())
    }

    /// Removes an answer and everything that follows from it.
    fn remove(&mut self, id: &str) {
        self.forget(id);
        let s = &mut self.state;
        s.written = None;
        if id == REPLACE {
            return;
        }
        s.proof = None;
        // The capillary is looked at again while it is empty. So the bead is brought again, and a person with a hand at the capillary
        // confirms again that the motors may move.
        let is_emptied = ["camera", "pixel_format", "width", "height", "empty", "light"].contains(&id);
        if is_emptied {
            (s.exposure, s.empty) = (None, None);
        }
        if !["name", "data_dir", "bore_um", "bead_um", "tolerance_percent", "sense", "ruler"].contains(&id) {
            s.turn = None;
            s.is_home = false;
        }
        if !["name", "data_dir", "bead_um", "tolerance_percent", "sense", "ruler"].contains(&id) {
            s.bead = None;
        }
        if id == "controller" {
            s.controller = None;
        }
        let follows: &[&str] = match id {
            // Another controller has other outputs, and perhaps no switch.
            "controller" => &["reference", "light", "loaded", "motion"],
            _ if is_emptied => &["empty", "loaded", "motion"],
            // A specimen that is brought in again is turned after another confirmation only.
            "loaded" => &["motion"],
            "bore_um" | "bead_um" => &["ruler"],
            _ => &[],
        };
        for id in follows {
            self.forget(id);
        }
    }

    /// Asks `id` again, because of `text`.
    fn again(&mut self, id: &str, text: String, proposal: Option<String>) {
        self.remove(id);
        match id {
            "controller" => self.state.ports = None,
            "camera" => self.state.cameras = None,
            _ => {}
        }
        self.state.problem = Some(Problem { id: id.into(), text, proposal });
    }

    /// The answers that an action needs.
    pub fn request<'a>(&'a self, action: Action, draft: &'a str) -> Request<'a> {
        Request { action, draft, controller: self.answered("controller").unwrap_or_default(), replaces: self.answered(REPLACE).is_some() }
    }

    /// Takes the result of an action.
    pub fn done(&mut self, outcome: Outcome) {
        let s = &mut self.state;
        match outcome {
            Outcome::Ports(ports) => s.ports = Some(ports),
            Outcome::Controller(controller) => s.controller = Some(controller),
            Outcome::Cameras(cameras) => s.cameras = Some(cameras),
            Outcome::Exposure(exposure) => s.exposure = Some(exposure),
            Outcome::Empty(empty) => s.empty = Some(empty),
            Outcome::Home => s.is_home = true,
            Outcome::Turn(turn) => {
                s.turn = Some(turn);
                self.judge_turn();
            }
            Outcome::Bead(bead) if s.bead.is_none() => {
                s.bead = Some(bead);
                self.judge_bead();
            }
            Outcome::Bead(bead) => {
                s.proof = Some(bead);
                self.judge_proof();
            }
            Outcome::Written(written) => s.written = Some(written),
        }
    }

    /// An action failed. The question that can remedy it is asked again.
    pub fn failed(&mut self, action: Action, why: String) {
        let id = match action {
            Action::ListPorts | Action::Identify => "controller",
            Action::ListCameras | Action::Expose => "camera",
            Action::LookAtEmpty => "empty",
            Action::Home => "motion",
            Action::Turn | Action::Measure => "loaded",
            Action::Write => REPLACE,
        };
        self.again(id, why, None);
    }

    fn judge_turn(&mut self) {
        let Some(turn) = self.state.turn.clone() else { return };
        let ratio = |orbit: super::period::Orbit| orbit.period_steps / turn.commanded_steps;
        if turn.seen[0] * 2 < turn.seen[1] {
            let text = format!(
                "A bead was found in {} of {} pictures. Bring a bead into the middle of the picture, and look at focus and light",
                turn.seen[0], turn.seen[1]
            );
            return self.again("loaded", text, None);
        }
        match turn.orbit {
            Some(orbit) if (ratio(orbit) - 1.0).abs() > MOST_STEPS_OFF => {
                let proposal = likely(orbit.period_steps);
                let text = format!(
                    "The steps per turn are wrong: the bead is back after {:.1} steps, but {} are configured. {proposal} is likely",
                    orbit.period_steps, turn.commanded_steps
                );
                self.again("steps", text, Some(proposal.to_string()));
            }
            None => {
                let text = "The bead moves less than 1 px while the capillary is told to turn, or not on a circle. Check that the motors have power \
                            and hold the capillary. Let the bead rest on the glass: one on the axis does not show the turn";
                self.again("loaded", text.into(), None);
            }
            Some(_) => {}
        }
    }

    fn judge_bead(&mut self) {
        let Some(bead) = self.state.bead.clone() else { return };
        if self.judge_closure(&bead) || self.judge_roundness(&bead) {
            return;
        }
        let Some(stated) = self.answered("bead_um") else { return };
        if self.contradicts() {
            let bore = self.answered("bore_um").unwrap_or_default();
            let text = format!(
                "The bead measures {:.1} um with the scale of a bore of {bore} um, but {stated} um are stated, {:.2} times as much as measured. One of \
                 both numbers is wrong. Correct the diameter of the bead here, or go back until the bore is asked. If both are right, give \
                 the same diameter again: the bead is then measured again{}",
                bead.diameter_um,
                stated.parse::<f64>().unwrap_or(f64::NAN) / bead.diameter_um,
                out_of_focus(&bead)
            );
            let proposal = format!("{:.0}", (bead.diameter_um / 10.0).round() * 10.0);
            self.again("bead_um", text, Some(proposal));
        }
    }

    /// Whether the turn does not close.
    fn judge_closure(&mut self, bead: &Bead) -> bool {
        let closes = bead.closure_iou.is_some_and(|iou| iou >= LEAST_CLOSURE);
        if !closes {
            let found = bead.closure_iou.map_or("not measured".into(), |iou| format!("{:.1} %", 100.0 * iou));
            let text = format!(
                "The turn does not close: the overlap of the bead with itself after one turn is {found}, {:.0} % or more are expected. The bead moved in \
                 the water, or the motors lost steps. Wait until it rests, and lower the speed of the motors if it happens again",
                100.0 * LEAST_CLOSURE
            );
            self.again("loaded", text, None);
        }
        !closes
    }

    /// Whether the bead is not round. Its diameter is no length then, and a second measurement would not show it.
    fn judge_roundness(&mut self, bead: &Bead) -> bool {
        let is_round = bead_extents(bead.diameter_um, bead.aspect).is_ok();
        if !is_round {
            let text = format!(
                "The bead is {:.3} times as long as wide, {} to {} are allowed. It is no sphere, or something lies at it: \
                 flush the capillary and bring another bead. If the next one is the same, the scales along and across \
                 differ, as they do in air: put the capillary into water, or measure both scales with carved calibrate \
                 beads",
                bead.aspect,
                1.0 - ASPECT_OFF_MOST,
                1.0 + ASPECT_OFF_MOST
            );
            self.again("loaded", text, None);
        }
        !is_round
    }

    fn judge_ruler(&mut self) {
        let tolerance = self.number("tolerance_percent").unwrap_or(1.0);
        if let (Some("bore"), Some(off)) = (self.answered("ruler"), self.off_percent(self.state.bead.as_ref()))
            && off.abs() > tolerance
        {
            let text = format!(
                "With the scale of the bore the bead is {off:+.2} % off, {tolerance} % is allowed. Take the bead as the ruler, or type back and \
                 correct the numbers"
            );
            self.again("ruler", text, None);
        }
    }

    fn judge_proof(&mut self) {
        let Some(bead) = self.state.proof.clone() else { return };
        if self.judge_closure(&bead) || self.judge_roundness(&bead) {
            return;
        }
        let tolerance = self.number("tolerance_percent").unwrap_or(1.0);
        if let Some(off) = self.off_percent(Some(&bead))
            && off.abs() > tolerance
        {
            let text = format!(
                "The second measurement of the bead is {off:+.2} % off, {tolerance} % is allowed, although the scale was corrected by the first one: \
                 {:.1} um. The bead is not the same or moved between both{}",
                bead.diameter_um,
                out_of_focus(&bead)
            );
            self.again("loaded", text, None);
            self.forget("ruler");
        }
    }

    /// Scales in px/um along and across. `None` until the bore is known.
    fn scales(&self) -> Option<[f64; 2]> {
        let k = self.state.empty.as_ref()?.bore_px / self.number("bore_um")?;
        let (Some("bead"), Some(bead), Some(known)) = (self.answered("ruler"), &self.state.bead, self.number("bead_um")) else {
            return Some([k, k]);
        };
        let extents = bead_extents(bead.diameter_um, bead.aspect).unwrap_or([bead.diameter_um; 2]);
        Some(extents.map(|extent| k * extent / known))
    }

    /// The configuration, as far as it is known.
    pub fn draft(&self) -> String {
        let s = &self.state;
        let driver = s.controller.as_ref().map_or("grbl", |c| c.driver.as_str());
        let mut draft = Draft::of(shipped(driver).unwrap_or_default());
        let mut set = |table: &str, key: &str, value: Option<String>| {
            if let Some(value) = value {
                draft.set(table, key, &value);
            }
        };
        let quoted = |id: &str| self.answered(id).map(|text| toml::Value::from(text).to_string());
        set("store", "data_dir", quoted("data_dir"));
        set("rig", "name", quoted("name"));
        let ratio = self.answered("steps").and_then(|typed| steps(typed).ok());
        set("rig", "steps_per_revolution", ratio.map(|ratio| format!("{:?}", <[u32; 2]>::from(ratio))));
        set("acquisition", "sense", self.sense().map(|sense| sense.to_string()));
        let number = |value: f64| format!("{value:?}");
        let scales = self.scales();
        set("optics", "kx_px_per_um", scales.map(|k| number(k[0])));
        set("optics", "ky_px_per_um", scales.map(|k| number(k[1])));
        let middle = |id: &str| self.number(id).map(|size| number((size - 1.0) / 2.0));
        set("optics", "ux_px", middle("width"));
        let axis = s.bead.as_ref().map(|b| [b.uy_px, b.gamma_deg]).or(s.empty.as_ref().map(|e| [e.middle_px, e.tilt_deg]));
        set("optics", "uy_px", axis.map(|a| number((a[0] * 1e3).round() / 1e3)).or_else(|| middle("height")));
        set("optics", "gamma_deg", axis.map(|a| number((a[1] * 1e4).round() / 1e4)));
        set("optics", "bore_um", self.number("bore_um").map(number));
        set("optics", "empty_capillary", s.empty.as_ref().map(|e| toml::Value::from(e.file.as_str()).to_string()));
        for (table, [width, height]) in [("optics", ["width_px", "height_px"]), ("camera", ["width", "height"])] {
            set(table, width, self.answered("width").map(str::to_owned));
            set(table, height, self.answered("height").map(str::to_owned));
        }
        for (key, value) in s.controller.iter().flat_map(|c| &c.keys) {
            set("rotation", key, Some(value.clone()));
        }
        set("rotation", "reference", quoted("reference").filter(|_| self.can_home()));
        if let Some(pin) = self.answered("light").filter(|pin| *pin != NO_LIGHT && self.can_home()) {
            let pin = pin.parse::<u32>().map_or_else(|_| toml::Value::from(pin), toml::Value::from);
            for (key, value) in [("pin", pin.to_string()), ("on", "\"views\"".into()), ("settle_ms", LIGHT_SETTLE_MS.to_string())] {
                set("rotation.outputs.light", key, Some(value));
            }
        }
        set("camera", "select", quoted("camera").map(|address| format!("{{ address = {address} }}")));
        set("camera", "pixel_format", quoted("pixel_format"));
        set("camera", "exposure_us", s.exposure.as_ref().map(|e| number(e.exposure_us)));
        draft.text()
    }

    fn sense(&self) -> Option<i8> {
        Some(if self.answered("sense")? == "up" { -1 } else { 1 })
    }

    /// The last words: what was found, what is not known, and what to do next.
    pub fn summary(&self) -> String {
        let s = &self.state;
        let (Some(written), Some(proof)) = (&s.written, &s.proof) else { return String::new() };
        let stated = self.number("bead_um").unwrap_or(f64::NAN);
        let [kx, ky] = self.scales().unwrap_or([f64::NAN; 2]).map(|k| 1.0 / k);
        let mut text = format!(
            "The bead is right: {:.2} um measured, {stated} um stated ({:+.2} %); its volume is {:.4e} um^3, that of a sphere of {stated} um {:.4e} \
             um^3.\nA pixel is {kx:.4} um along the capillary and {ky:.4} um across it.\n",
            proof.diameter_um,
            self.off_percent(Some(proof)).unwrap_or(f64::NAN),
            proof.volume_um3,
            PI / 6.0 * stated.powi(3)
        );
        if self.answered("sense") == Some("unknown") {
            text += "The sense of rotation is not measured: models may be mirror images. Measure it with carved calibrate marked.\n";
        }
        for word in [out_of_focus(proof)].iter().filter(|word| !word.is_empty()) {
            text += &format!("Look again{word}.\n");
        }
        for doubt in &written.doubts {
            text += &format!("Look again: {doubt}\n");
        }
        text + &format!("Next: carved serve --config {}", written.file)
    }
}

/// What to do where the edges are blurred; empty where they are not.
pub fn out_of_focus(bead: &Bead) -> String {
    match bead.blur_px {
        Some([found, expected]) if found > MOST_BLUR * expected => {
            format!(
                ". The edges are blurred over {found:.1} px, {expected:.1} px are expected: focus the lens on the axis of the capillary"
            )
        }
        _ => String::new(),
    }
}
