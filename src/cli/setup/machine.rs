//! The stages of a set-up, without any input or output of their own.
//!
//! ```text
//!               ┌─ Ask(Question) ──► person ──► answer ──┐
//! State ─ next ─┼─ Act(Action) ────► Bench ───► done ────┼──► State
//!               └─ Finished            failed: the question before is asked again, with the reason
//! controller ─ steps ─ camera ─ empty capillary, bore ─ bead ─ turn: steps, sense ─ bead: scale, axis ─ bead again: right? ─ file
//! ```
//! `next` looks for the first thing that is missing. An interrupted set-up therefore continues at the same place, and a wrong value is
//! corrected by removing it together with what follows from it.

use super::bench::{Action, Bench, Outcome, Request};
use super::judgement;
use super::question::Question;
use super::result;
use super::state::{Problem, State};
use super::wording::{REPLACE, question};

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

/// The set-up.
#[derive(Debug, Clone, Default)]
pub struct Machine {
    state: State,
    /// An answer that was doubted, with its question. It is not stored.
    doubted: Option<(String, String)>,
}

/// The stages, for a person.
pub const STAGES: [&str; 8] = ["Controller", "Camera", "Empty capillary", "Bead", "Two turns", "Scale", "Proof", "File"];

/// Usual diameters of beads, as shares of the bore.
const USUAL_BEAD: [f64; 2] = [0.2, 0.97];

impl Machine {
    /// Continues from a stored state. The confirmation that the motors may move is asked for again, and the controller is asked who it is:
    /// its port may have another name by now, and another device its old one.
    pub fn resume(state: State) -> Self {
        let mut machine = Self { state, doubted: None };
        if machine.state.proof.is_none() {
            machine.state.forget("motion");
            machine.state.is_home = false;
            machine.state.ports = None;
            machine.state.controller = None;
        }
        machine
    }

    pub fn state(&self) -> &State {
        &self.state
    }

    /// The questions that are answered, with their answers, in the order of answering.
    pub fn given(&self) -> impl Iterator<Item = (&str, &str)> {
        self.state.given()
    }

    /// The configuration, as far as it is known.
    pub fn draft(&self) -> String {
        result::configuration(&self.state)
    }

    /// The last words: what was found, what is not known, and what to do next.
    pub fn summary(&self) -> String {
        result::summary(&self.state)
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

    /// What comes next. `exists`: the configuration's file exists already.
    pub fn next(&self, exists: bool) -> Step {
        let s = &self.state;
        let missing = |id: &str| self.state.answered(id).is_none();
        let steps = [
            (missing("name"), self.ask("name")),
            (s.ports.is_none(), Step::Act(Action::ListPorts)),
            (missing("controller"), self.ask("controller")),
            (s.controller.is_none(), Step::Act(Action::Identify)),
            (missing("steps"), self.ask("steps")),
            (missing("reference") && s.can_home(), self.ask("reference")),
            (missing("light") && s.can_home(), self.ask("light")),
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

    fn ask(&self, id: &'static str) -> Step {
        Step::Ask(Box::new(question(&self.state, id)))
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
        later.state.insert(question.id, &value);
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
            "ruler" => self.act_on(judgement::of_ruler(&self.state)),
            // The person insists: not a number but the measurement is wrong.
            "bead_um" if question.problem.is_some() && self.state.contradicts() => {
                self.state.bead = None;
                self.state.is_home = false;
                self.state.forget("motion");
            }
            "bead_um" => self.act_on(judgement::of_bead(&self.state)),
            _ => {}
        }
        Ok(())
    }

    /// What no configuration holds, but bead and bore show together.
    fn doubt(&self, id: &str) -> Result<Option<String>, Refused> {
        let (Some(bead), Some(bore)) = (self.state.number("bead_um"), self.state.number("bore_um")) else { return Ok(None) };
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
        let Some(id) = self.state.newest().map(str::to_owned) else {
            return Err(Refused::Wrong("This is the first question".into()));
        };
        self.doubted = None;
        self.remove(&id);
        self.state.problem = None;
        Ok(())
    }

    /// Removes an answer and everything that follows from it.
    fn remove(&mut self, id: &str) {
        self.state.forget(id);
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
            self.state.forget(id);
        }
    }

    /// Asks again the question that can remedy a problem.
    fn again(&mut self, problem: Problem) {
        self.remove(&problem.id);
        match problem.id.as_str() {
            "controller" => self.state.ports = None,
            "camera" => self.state.cameras = None,
            _ => {}
        }
        self.state.problem = Some(problem);
    }

    fn act_on(&mut self, found: Option<Problem>) {
        if let Some(problem) = found {
            self.again(problem);
        }
    }

    /// The answers that an action needs.
    pub fn request<'a>(&'a self, action: Action, draft: &'a str) -> Request<'a> {
        Request {
            action,
            draft,
            controller: self.state.answered("controller").unwrap_or_default(),
            replaces: self.state.answered(REPLACE).is_some(),
        }
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
                self.act_on(judgement::of_turn(&self.state));
            }
            Outcome::Bead(bead) if s.bead.is_none() => {
                s.bead = Some(bead);
                self.act_on(judgement::of_bead(&self.state));
            }
            Outcome::Bead(bead) => {
                let unsound = judgement::of_measurement(&bead);
                s.proof = Some(bead);
                match unsound {
                    Some(problem) => self.again(problem),
                    None => {
                        if let Some(problem) = judgement::of_proof(&self.state) {
                            self.again(problem);
                            self.state.forget("ruler");
                        }
                    }
                }
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
        self.again(Problem::new(id, why, None));
    }
}
