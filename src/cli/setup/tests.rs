//! The stages with a fake instrument and a scripted person: every way that a set-up can take besides the straight one.

use super::bench::{Action, Bead, Bench, Controller, Empty, FoundExposure, Listed, Outcome, Request, Turn, Written};
use super::dialogue::{Person, Stopped, converse};
use super::machine::{Machine, Refused};
use super::period::Orbit;
use super::question::Question;
use super::state::State;
use super::wording::question;
use crate::cli::with_causes;
use crate::config::Config;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

const MOVING: [Action; 3] = [Action::Home, Action::Turn, Action::Measure];

/// What happens, in its order.
#[derive(Debug, Clone, PartialEq)]
pub enum Happened {
    Asked(&'static str),
    Acted(Action),
}

/// An instrument that works, with some outcomes replaced.
pub struct FakeBench {
    driver: &'static str,
    /// Outcomes by action, in the order in which it is done; then the usual one.
    replaced: Vec<(Action, VecDeque<Result<Outcome, String>>)>,
    measured: usize,
    exists: bool,
    log: std::rc::Rc<std::cell::RefCell<Vec<Happened>>>,
}

impl FakeBench {
    pub fn new(driver: &'static str) -> Self {
        Self { driver, replaced: Vec::new(), measured: 0, exists: false, log: std::rc::Rc::default() }
    }

    pub fn with(mut self, action: Action, outcomes: impl IntoIterator<Item = Result<Outcome, String>>) -> Self {
        self.replaced.push((action, outcomes.into_iter().collect()));
        self
    }

    fn usual(&mut self, request: &Request) -> Outcome {
        let listed = |name: &str| vec![Listed { name: name.into(), label: name.into() }];
        match request.action {
            Action::ListPorts => Outcome::Ports(listed("/dev/ttyUSB0")),
            Action::Identify => Outcome::Controller(controller(self.driver, request.controller)),
            Action::ListCameras => Outcome::Cameras(listed("192.168.10.2")),
            Action::Expose => Outcome::Exposure(FoundExposure { exposure_us: 4000.0, top: 240.0, follows: true }),
            Action::LookAtEmpty => Outcome::Empty(Empty { bore_px: 118.0, middle_px: 511.0, tilt_deg: 0.1, file: "empty.png".into() }),
            Action::Home => Outcome::Home,
            Action::Turn => Outcome::Turn(turn(500.0)),
            // The scale of the bore is 1 % off, that of the bead is right.
            Action::Measure => Outcome::Bead(bead(if self.measured == 1 { 505.0 } else { 500.5 })),
            Action::Write => Outcome::Written(Written { file: "rig.toml".into(), backup: None, doubts: Vec::new() }),
        }
    }
}

fn controller(driver: &str, port: &str) -> Controller {
    let key = if driver == "relay" { "address" } else { "port" };
    let keys = vec![(key.to_owned(), format!("{port:?}"))];
    Controller { driver: driver.into(), name: driver.into(), keys, homes: None, remark: None }
}

pub fn turn(period_steps: f64) -> Turn {
    let orbit = Orbit { period_steps, axis_px: 511.0, radius_px: 6.0, residual_px: 0.1 };
    Turn { commanded_steps: 500.0, orbit: Some(orbit), seen: [41, 42] }
}

pub fn bead(diameter_um: f64) -> Bead {
    Bead {
        can_sweep: true,
        diameter_um,
        aspect: 1.0,
        volume_um3: 6.5e7,
        closure_iou: Some(0.99),
        closure_px: Some([0.1, 0.1]),
        uy_px: 510.5,
        gamma_deg: 0.2,
        blur_px: Some([1.2, 1.0]),
        flags: Vec::new(),
    }
}

impl Bench for FakeBench {
    fn perform(&mut self, request: &Request) -> Result<Outcome, String> {
        self.log.borrow_mut().push(Happened::Acted(request.action));
        // Whatever is done is done with a configuration that can be loaded.
        self.check(request.draft).unwrap();
        self.measured += usize::from(request.action == Action::Measure);
        let replaced = self.replaced.iter_mut().find(|(action, _)| *action == request.action);
        match replaced.and_then(|(_, outcomes)| outcomes.pop_front()) {
            Some(outcome) => outcome,
            None => Ok(self.usual(request)),
        }
    }

    /// The real rules, without the picture of the empty capillary, which is not on a disk.
    fn check(&self, draft: &str) -> Result<Vec<String>, String> {
        let draft: String = draft.lines().filter(|line| !line.starts_with("empty_capillary")).map(|line| format!("{line}\n")).collect();
        Config::parse(&draft, Path::new("rig.toml")).map(|config| config.doubts).map_err(|error| with_causes(&error.into()))
    }

    fn exists(&self) -> bool {
        self.exists
    }
}

/// A person with an answer to each question, or several where it is asked again. The default is taken where there is none.
pub struct Script {
    answers: BTreeMap<&'static str, VecDeque<&'static str>>,
    /// The number of questions after which the person leaves.
    patience: usize,
    /// What each question said, and each refusal.
    heard: Vec<String>,
    log: std::rc::Rc<std::cell::RefCell<Vec<Happened>>>,
}

impl Script {
    pub fn new(bench: &FakeBench, changes: &[(&'static str, &'static str)]) -> Self {
        let mut answers: BTreeMap<_, VecDeque<_>> = BTreeMap::new();
        for (id, answer) in changes {
            answers.entry(*id).or_default().push_back(*answer);
        }
        Self { answers, patience: usize::MAX, heard: Vec::new(), log: bench.log.clone() }
    }

    pub fn asked(&self) -> Vec<&'static str> {
        let asked = |happened: &Happened| if let Happened::Asked(id) = happened { Some(*id) } else { None };
        self.log.borrow().iter().filter_map(asked).collect()
    }

    pub fn heard(&self, words: &str) -> bool {
        self.heard.iter().any(|heard| heard.contains(words))
    }
}

impl Person for Script {
    fn tell(&mut self, text: &str) -> anyhow::Result<()> {
        self.heard.push(text.to_owned());
        Ok(())
    }

    fn busy(&mut self, _: Action, _: &Machine) -> anyhow::Result<()> {
        Ok(())
    }

    fn ask(&mut self, question: &Question, _: &Machine) -> anyhow::Result<String> {
        anyhow::ensure!(self.patience > 0, "left");
        self.patience -= 1;
        self.log.borrow_mut().push(Happened::Asked(question.id));
        self.heard.extend(question.problem.clone());
        self.heard.push(question.text.clone());
        let usual = if question.id == "bore_um" { Some("650".into()) } else { question.default.clone() };
        let scripted = self.answers.get_mut(question.id).and_then(VecDeque::pop_front).map(str::to_owned);
        anyhow::ensure!(self.heard.len() < 500, "goes round and round: {:?}", self.heard);
        Ok(scripted.or(usual).unwrap_or_else(|| "yes".into()))
    }

    fn answered(&mut self, _: &Question, refused: Option<&Refused>) -> anyhow::Result<()> {
        self.heard.extend(refused.map(Refused::text));
        Ok(())
    }
}

fn go(machine: &mut Machine, bench: &mut FakeBench, person: &mut Script) -> anyhow::Result<()> {
    converse(machine, bench, person, &|| false, &mut |_| Ok(()))
}

/// A whole set-up: the machine at its end, and its person.
fn set_up(mut bench: FakeBench, changes: &[(&'static str, &'static str)]) -> (Machine, Script) {
    let (mut machine, mut person) = (Machine::default(), Script::new(&bench, changes));
    go(&mut machine, &mut bench, &mut person).unwrap();
    (machine, person)
}

fn table(machine: &Machine, path: &[&str]) -> toml::Value {
    let whole: toml::Value = toml::Value::Table(machine.draft().parse().unwrap());
    path.iter().fold(whole, |table, key| table[key].clone())
}

/// Whether every motion follows a confirmation, with no other question that a person answers with a hand at the capillary in between.
fn moves_only_when_confirmed(log: &[Happened]) -> bool {
    let mut confirmed = false;
    log.iter().all(|happened| match happened {
        Happened::Asked("motion") => {
            confirmed = true;
            true
        }
        Happened::Asked("empty" | "loaded" | "controller") => {
            confirmed = false;
            true
        }
        Happened::Acted(action) => confirmed || !MOVING.contains(action),
        Happened::Asked(_) => true,
    })
}

/// The first measurement sets both scales, so that the second one agrees with it whatever the bead is.
#[test]
fn a_bead_that_is_not_round_is_no_ruler_and_no_proof() {
    let oblong = || Ok(Outcome::Bead(Bead { aspect: 1.04, ..bead(505.0) }));
    let round = || Ok(Outcome::Bead(bead(500.5)));
    let (machine, person) = set_up(FakeBench::new("grbl").with(Action::Measure, [oblong(), round(), oblong(), round(), round()]), &[]);
    assert!(person.heard("1.040 times as long as wide, 0.98 to 1.02"));
    let measured = person.log.borrow().iter().filter(|happened| **happened == Happened::Acted(Action::Measure)).count();
    assert_eq!(measured, 5, "again after each oblong one, then ruler and proof");
    assert_eq!(table(&machine, &["optics", "kx_px_per_um"]), table(&machine, &["optics", "ky_px_per_um"]));
    assert!(moves_only_when_confirmed(&person.log.borrow()));
}

#[test]
fn the_straight_way_moves_after_the_confirmation_only() {
    let (machine, person) = set_up(FakeBench::new("grbl"), &[]);
    assert!(moves_only_when_confirmed(&person.log.borrow()));
    assert!(machine.summary().contains("The bead is right") && machine.summary().contains("mirror images"), "{}", machine.summary());
    assert!(machine.summary().contains("84 views in one sweep of 2.8 s"), "{}", machine.summary());
    let k = table(&machine, &["optics", "ky_px_per_um"]).as_float().unwrap();
    assert!((k - 118.0 / 650.0 * 505.0 / 500.0).abs() < 1e-9, "the bead is the ruler: {k}");
}

/// The state goes through its file, as after a crash.
fn resumed(machine: &Machine) -> Machine {
    Machine::resume(serde_json::from_str::<State>(&serde_json::to_string(machine.state()).unwrap()).unwrap())
}

#[test]
fn an_interrupted_setup_goes_on_to_the_same_configuration_and_confirms_motion_again() {
    let (whole, person) = set_up(FakeBench::new("grbl"), &[]);
    let questions = person.asked().len();
    for left_after in 0..questions {
        let mut bench = FakeBench::new("grbl");
        let (mut machine, mut person) = (Machine::default(), Script::new(&bench, &[]));
        person.patience = left_after;
        assert!(go(&mut machine, &mut bench, &mut person).is_err());
        let mut machine = resumed(&machine);
        person.patience = usize::MAX;
        person.log.borrow_mut().clear();
        go(&mut machine, &mut bench, &mut person).unwrap();
        assert_eq!(machine.draft(), whole.draft(), "left after {left_after} questions");
        assert!(moves_only_when_confirmed(&person.log.borrow()), "left after {left_after}: {:?}", person.log.borrow());
        // An answer that was given is not asked for again, except for the confirmation.
        let again = person.asked().len() + left_after - questions;
        assert!(again <= 1, "left after {left_after}: {:?}", person.asked());
    }
}

#[test]
fn back_returns_to_the_question_before_from_each_question() {
    let (whole, person) = set_up(FakeBench::new("grbl"), &[]);
    let asked = person.asked();
    for (at, id) in asked.iter().enumerate().skip(1) {
        let mut bench = FakeBench::new("grbl");
        let mut person = Script::new(&bench, &[(*id, "back")]);
        let mut machine = Machine::default();
        go(&mut machine, &mut bench, &mut person).unwrap();
        assert_eq!(person.asked()[..=at], asked[..=at]);
        assert_eq!(person.asked()[at + 1], asked[at - 1], "back at {id}");
        assert_eq!(machine.draft(), whole.draft(), "back at {id}");
        assert!(moves_only_when_confirmed(&person.log.borrow()), "back at {id}: {:?}", person.log.borrow());
    }
    let (_, person) = set_up(FakeBench::new("grbl"), &[("name", "back")]);
    assert!(person.heard("This is the first question"));
}

#[test]
fn back_to_the_empty_capillary_brings_the_bead_again_before_anything_moves() {
    // From the question of the ruler back over six questions to the bore, and over that to the empty capillary.
    let (_, person) = set_up(
        FakeBench::new("grbl"),
        &[
            ("ruler", "back"),
            ("sense", "back"),
            ("motion", "yes"),
            ("motion", "back"),
            ("loaded", "yes"),
            ("loaded", "back"),
            ("tolerance_percent", "1"),
            ("tolerance_percent", "back"),
            ("bead_um", "500"),
            ("bead_um", "back"),
            ("bore_um", "650"),
            ("bore_um", "back"),
        ],
    );
    let asked = person.asked();
    let second_empty = asked.iter().rposition(|id| *id == "empty").unwrap();
    assert_eq!(asked.iter().filter(|id| **id == "empty").count(), 2);
    assert!(asked[second_empty..].contains(&"loaded") && asked[second_empty..].contains(&"motion"), "{asked:?}");
    assert!(moves_only_when_confirmed(&person.log.borrow()));
}

#[test]
fn a_failure_of_each_work_asks_the_question_that_remedies_it() {
    for (action, id) in [
        (Action::Identify, "controller"),
        (Action::Expose, "camera"),
        (Action::LookAtEmpty, "empty"),
        (Action::Home, "motion"),
        (Action::Turn, "loaded"),
        (Action::Measure, "loaded"),
        (Action::Write, "replace"),
    ] {
        let bench = FakeBench::new("grbl").with(action, [Err(format!("{action:?} went wrong"))]);
        let (machine, person) = set_up(bench, &[("controller", "/dev/ttyUSB0"), ("controller", "/dev/ttyUSB0")]);
        assert!(person.heard(&format!("{action:?} went wrong")), "{action:?}");
        let expected = if id == "replace" { 1 } else { 2 };
        assert_eq!(person.asked().iter().filter(|asked| **asked == id).count(), expected, "{action:?}");
        assert!(moves_only_when_confirmed(&person.log.borrow()), "{action:?}: {:?}", person.log.borrow());
        assert!(machine.summary().contains("The bead is right"));
    }
}

#[test]
fn a_stop_ends_the_setup_and_keeps_what_was_measured() {
    let mut bench = FakeBench::new("grbl").with(Action::Measure, [Err("stopped".into())]);
    let (mut machine, mut person) = (Machine::default(), Script::new(&bench, &[]));
    let error = converse(&mut machine, &mut bench, &mut person, &|| true, &mut |_| Ok(())).unwrap_err();
    assert!(error.is::<Stopped>());
    bench.log.borrow_mut().clear();
    let mut machine = resumed(&machine);
    go(&mut machine, &mut bench, &mut person).unwrap();
    assert_eq!(person.asked(), ["motion", "ruler"]);
    assert!(!person.log.borrow().contains(&Happened::Acted(Action::Turn)), "the two turns were measured already");
    assert!(moves_only_when_confirmed(&person.log.borrow()));
}

#[test]
fn a_turn_that_does_not_close_is_repeated_after_another_confirmation() {
    let open = |iou| Ok(Outcome::Bead(Bead { closure_iou: iou, ..bead(500.0) }));
    for outcomes in [vec![open(Some(0.8))], vec![open(None)], vec![Ok(Outcome::Bead(bead(505.0))), open(Some(0.8))]] {
        let (machine, person) = set_up(FakeBench::new("grbl").with(Action::Measure, outcomes.clone()), &[]);
        assert!(person.heard("The turn does not close"), "{outcomes:?}");
        assert!(moves_only_when_confirmed(&person.log.borrow()), "{:?}", person.log.borrow());
        assert!(machine.summary().contains("The bead is right"));
    }
}

#[test]
fn a_second_measurement_that_differs_is_not_accepted() {
    let outcomes = [Ok(Outcome::Bead(bead(505.0))), Ok(Outcome::Bead(bead(507.0)))];
    let (_, person) = set_up(FakeBench::new("grbl").with(Action::Measure, outcomes), &[]);
    assert!(person.heard("The second measurement of the bead is +1.40 % off, 1 % is allowed"));
    assert_eq!(person.asked().iter().filter(|id| **id == "ruler").count(), 2);
    assert!(moves_only_when_confirmed(&person.log.borrow()));
}

#[test]
fn a_bead_out_of_focus_is_named_with_both_numbers() {
    let blurred = || Bead { blur_px: Some([4.0, 1.0]), ..bead(500.0) };
    let far = Bead { diameter_um: 800.0, ..blurred() };
    let outcomes = [Ok(Outcome::Bead(far)), Ok(Outcome::Bead(blurred()))];
    let (machine, person) = set_up(FakeBench::new("grbl").with(Action::Measure, outcomes), &[("bead_um", "500"), ("bead_um", "500")]);
    assert!(person.heard("blurred over 4.0 px, 1.0 px are expected"), "{:?}", person.heard);
    // The number was right, so the bead was measured again, after another confirmation.
    assert_eq!(person.asked().iter().filter(|id| **id == "motion").count(), 2);
    assert!(machine.summary().contains("The bead is right"), "{}", machine.summary());
}

#[test]
fn a_blurred_proof_is_named_at_the_end() {
    let blurred = |diameter| Ok(Outcome::Bead(Bead { blur_px: Some([4.0, 1.0]), can_sweep: false, ..bead(diameter) }));
    let (machine, _) = set_up(FakeBench::new("grbl").with(Action::Measure, [blurred(505.0), blurred(500.5)]), &[]);
    assert!(machine.summary().contains("focus the lens"), "{}", machine.summary());
    assert!(!machine.summary().contains("sweep"), "this rig cannot: {}", machine.summary());
}

#[test]
fn the_bore_is_the_ruler_where_it_agrees_with_the_bead() {
    let near = || [Ok(Outcome::Bead(bead(503.0))), Ok(Outcome::Bead(bead(503.0)))];
    let (machine, _) = set_up(FakeBench::new("grbl").with(Action::Measure, near()), &[("ruler", "bore")]);
    let k = table(&machine, &["optics", "ky_px_per_um"]).as_float().unwrap();
    assert!((k - 118.0 / 650.0).abs() < 1e-12);
    // 3 % off, 1 % is allowed: the bore is refused, and the bead taken.
    let far = [Ok(Outcome::Bead(bead(515.0))), Ok(Outcome::Bead(bead(500.0)))];
    let (machine, person) = set_up(FakeBench::new("grbl").with(Action::Measure, far), &[("ruler", "bore")]);
    assert!(person.heard("With the scale of the bore the bead is +3.00 % off, 1 % is allowed"));
    let k = table(&machine, &["optics", "ky_px_per_um"]).as_float().unwrap();
    assert!((k - 118.0 / 650.0 * 1.03).abs() < 1e-9);
}

#[test]
fn a_wrong_number_of_steps_is_proposed_right() {
    let (machine, person) = set_up(FakeBench::new("grbl").with(Action::Turn, [Ok(Outcome::Turn(turn(399.0)))]), &[]);
    assert!(person.heard("the bead is back after 399.0 steps, but 500 are configured. 400 is likely"));
    assert_eq!(table(&machine, &["rig", "steps_per_revolution"]), toml::Value::from(vec![400, 1]));
}

#[test]
fn a_bead_that_is_not_seen_or_does_not_go_around_is_brought_again() {
    for (broken, words) in [
        (Turn { seen: [4, 42], ..turn(500.0) }, "found in 4 of 42 pictures"),
        (Turn { orbit: None, ..turn(500.0) }, "moves less than 1 px"),
    ] {
        let (_, person) = set_up(FakeBench::new("grbl").with(Action::Turn, [Ok(Outcome::Turn(broken))]), &[]);
        assert!(person.heard(words));
        assert_eq!(person.asked().iter().filter(|id| **id == "loaded").count(), 2);
        assert!(moves_only_when_confirmed(&person.log.borrow()));
    }
}

#[test]
fn bead_and_bore_that_contradict_each_other_are_corrected() {
    let small = [Ok(Outcome::Bead(bead(252.0))), Ok(Outcome::Bead(bead(250.2)))];
    let bench = FakeBench::new("grbl").with(Action::Measure, small);
    let (machine, person) = set_up(bench, &[("bead_um", "500")]);
    assert!(person.heard("One of both numbers is wrong"), "{:?}", person.heard);
    assert!(machine.given().any(|given| given == ("bead_um", "250")), "the measured diameter is proposed");
}

#[test]
fn an_older_file_is_replaced_only_after_a_question() {
    let mut bench = FakeBench::new("grbl");
    bench.exists = true;
    let (_, person) = set_up(bench, &[]);
    assert_eq!(person.asked().last(), Some(&"replace"));
    let (_, person) = set_up(FakeBench::new("grbl"), &[]);
    assert!(!person.asked().contains(&"replace"));
}

/// The file would state two scales: the measured one, and that of the example beside it.
#[test]
fn no_comment_beside_a_value_of_the_rig_states_another_value() {
    for (driver, port) in [("grbl", "/dev/ttyUSB0"), ("tmcl", "/dev/ttyACM0"), ("zaber", "/dev/ttyUSB0"), ("relay", "10.0.0.3:5000")] {
        let (machine, _) = set_up(FakeBench::new(driver), &[("controller", port)]);
        let draft = machine.draft();
        let of_the_rig = ["kx_px_per_um", "ky_px_per_um", "uy_px", "gamma_deg", "steps_per_revolution", "exposure_us", "width", "height"];
        for line in draft.lines().filter(|line| of_the_rig.iter().any(|key| line.split(" = ").next() == Some(key))) {
            let stated = line.split_once('#').map_or("", |(_, comment)| comment);
            assert!(!stated.contains('.') && !stated.contains("um per px:"), "{driver}: {line}");
        }
    }
}

#[test]
fn each_controller_gets_its_configuration() {
    for (driver, port, key) in [
        ("grbl", "/dev/ttyUSB1", "port"),
        ("tmcl", "/dev/ttyACM0", "port"),
        ("zaber", "/dev/ttyUSB0", "port"),
        ("relay", "10.0.0.3:5000", "address"),
    ] {
        let (machine, person) = set_up(FakeBench::new(driver), &[("controller", port)]);
        assert_eq!(table(&machine, &["rotation", "driver"]).as_str(), Some(driver));
        assert_eq!(table(&machine, &["rotation", key]).as_str(), Some(port));
        // The relay has no switch to search, and no outputs.
        assert_eq!(person.asked().contains(&"reference"), driver != "relay");
        assert_eq!(person.asked().contains(&"light"), driver != "relay");
    }
    let (machine, _) = set_up(FakeBench::new("grbl"), &[("controller", "/dev/ttyUSB1"), ("reference", "here")]);
    assert_eq!(table(&machine, &["rotation", "reference"]).as_str(), Some("here"));
}

#[test]
fn the_light_gets_an_output_of_its_controller() {
    for (driver, answer, pin) in [
        ("grbl", "spindle", toml::Value::from("spindle")),
        // A number is the place in the list only where it is no answer itself.
        ("tmcl", "2", toml::Value::from(2)),
        ("zaber", "1", toml::Value::from(1)),
    ] {
        let (machine, _) = set_up(FakeBench::new(driver), &[("light", answer)]);
        let light = table(&machine, &["rotation", "outputs", "light"]);
        assert_eq!((&light["pin"], light["on"].as_str()), (&pin, Some("views")), "{driver}");
    }
    let (machine, _) = set_up(FakeBench::new("grbl"), &[]);
    assert!(table(&machine, &["rotation"]).get("outputs").is_none());
}

#[test]
fn another_controller_is_asked_for_its_own_light() {
    // Back from the question after the light to the controller, and another one there.
    let mut bench = FakeBench::new("grbl").with(Action::Identify, [Ok(Outcome::Controller(controller("grbl", "/dev/ttyUSB0")))]);
    bench.driver = "zaber";
    let changes = [
        ("light", "spindle"),
        ("camera", "back"),
        ("light", "back"),
        ("reference", "home"),
        ("reference", "back"),
        ("steps", "500"),
        ("steps", "back"),
        ("light", "1"),
    ];
    let (machine, _) = set_up(bench, &changes);
    assert_eq!(table(&machine, &["rotation", "driver"]).as_str(), Some("zaber"));
    assert_eq!(table(&machine, &["rotation", "outputs", "light", "pin"]).as_integer(), Some(1));
}

#[test]
fn the_sense_that_was_seen_is_written() {
    for (answer, sense) in [("down", 1), ("up", -1), ("unknown", 1)] {
        let (machine, _) = set_up(FakeBench::new("grbl"), &[("sense", answer)]);
        assert_eq!(table(&machine, &["acquisition", "sense"]).as_integer(), Some(sense));
        assert_eq!(machine.summary().contains("The sense of rotation is not measured"), answer == "unknown");
    }
}

#[test]
fn micrometres_that_cannot_be_meant_are_refused_and_doubtful_ones_asked_twice() {
    let changes = [("bore_um", "60"), ("bore_um", "650"), ("bead_um", "5000"), ("bead_um", "700"), ("bead_um", "50"), ("bead_um", "500")];
    let (_, person) = set_up(FakeBench::new("grbl"), &changes);
    for words in ["60 um; expected 100 to 5000 um", "5000 um; expected 20 to 4500 um", "does not fit", "give the same answer again"] {
        assert!(person.heard(words), "{words}");
    }
}

#[test]
fn a_resumed_setup_asks_the_controller_again_who_it_is_before_anything_moves() {
    let mut bench = FakeBench::new("grbl").with(Action::Measure, [Err("stopped".into())]);
    let (mut machine, mut person) = (Machine::default(), Script::new(&bench, &[]));
    assert!(converse(&mut machine, &mut bench, &mut person, &|| true, &mut |_| Ok(())).is_err());
    bench.log.borrow_mut().clear();
    let mut machine = resumed(&machine);
    go(&mut machine, &mut bench, &mut person).unwrap();
    let acted: Vec<Action> = person
        .log
        .borrow()
        .iter()
        .filter_map(|happened| if let Happened::Acted(action) = happened { Some(*action) } else { None })
        .collect();
    assert_eq!(acted[..3], [Action::ListPorts, Action::Identify, Action::Home], "{acted:?}");
}

#[test]
fn a_large_difference_between_bead_and_bore_has_no_ruler_by_default() {
    for (measured_um, default) in [(505.0, Some("bead")), (541.0, None), (459.0, None)] {
        let bench = FakeBench::new("grbl").with(Action::Measure, [Ok(Outcome::Bead(bead(measured_um)))]);
        let (machine, _) = set_up(bench, &[("ruler", "bead")]);
        assert_eq!(question(machine.state(), "ruler").default.as_deref(), default, "{measured_um} um");
    }
}
