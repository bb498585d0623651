//! `carved setup check`: proves a rig that has a configuration. A bead goes around twice, and is then measured over one turn.

use super::bench::{Action, Bead, Bench, Outcome, Request, Turn};
use super::dialogue::{Person, Stopped};
use super::judgement::{LEAST_CLOSURE, MOST_STEPS_OFF, out_of_focus};
use super::machine::{Machine, Refused};
use super::period::likely;
use super::question::Question;
use super::rig::{RealBench, Stopper};
use super::terminal::Answers;
use super::wording::question;
use crate::config::Config;
use anyhow::{Context, bail, ensure};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration of the rig. Stop its daemon first: a port and a camera have one owner
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Answers for a check without a person, as for `carved setup`: `bead_um`, `tolerance_percent`, `loaded`, `motion`
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
}

/// What was checked, and how it ended.
#[derive(Debug, PartialEq, Eq)]
struct Verdict {
    what: &'static str,
    is_right: bool,
    found: String,
}

/// Checks the rig.
///
/// # Errors
/// A configuration that cannot be used, devices that do not answer, and a rig that is not right.
pub fn run(args: &Args, stopper: &Stopper) -> anyhow::Result<()> {
    let config = Config::load(&args.config)?;
    ensure!(
        config.rotation.entry().is_some_and(|entry| entry.setup.is_ok()),
        "this rig follows the list of VAST's own program, which turns once per specimen. Measure a plate with one bead instead, and look at \
         diameter_um and closure.iou of its measurement"
    );
    let text = carved_files::read_to_string(&args.config).with_context(|| format!("{}: cannot be read", args.config.display()))?;
    let mut person = Answers::of(args.answers.as_deref())?;
    let mut bench = RealBench::new(args.config.clone(), stopper.clone(), None);
    let verdicts = check(&mut bench, &mut person, &text, &|| stopper.is_stopped())?;
    for verdict in &verdicts {
        say!("{:<6} {:<8} {}", if verdict.is_right { "right" } else { "WRONG" }, verdict.what, verdict.found);
    }
    ensure!(verdicts.iter().all(|verdict| verdict.is_right), "the rig is not right");
    Ok(())
}

/// Asks, turns and measures.
fn check(bench: &mut dyn Bench, person: &mut dyn Person, config: &str, is_stopped: &dyn Fn() -> bool) -> anyhow::Result<Vec<Verdict>> {
    let plain = Machine::default();
    let stated: f64 = ask(person, &question(plain.state(), "bead_um"))?.parse()?;
    let tolerance: f64 = ask(person, &question(plain.state(), "tolerance_percent"))?.parse()?;
    ask(person, &question(plain.state(), "loaded"))?;
    let text = "The motors will now home, and turn the capillary forwards by two turns and then by one turn. Nothing else moves. Keep a hand on \
                their power switch. May they move?";
    ask(person, &Question { text: text.into(), ..question(plain.state(), "motion") })?;
    let mut perform = |action: Action| {
        person.busy(action, &plain)?;
        let outcome = bench.perform(&Request { action, draft: config, controller: "", replaces: false });
        match outcome {
            Ok(outcome) => {
                person.tell(&outcome.to_string())?;
                Ok(outcome)
            }
            Err(_) if is_stopped() => Err(Stopped.into()),
            Err(why) => bail!(why),
        }
    };
    let Outcome::Turn(turn) = perform(Action::Turn)? else { bail!("the two turns gave no path of the bead") };
    // Without a bead that goes around there is nothing to measure.
    let turns = verdict_of_turn(&turn);
    if !turns.is_right {
        return Ok(vec![turns]);
    }
    let Outcome::Bead(bead) = perform(Action::Measure)? else { bail!("the turn gave no bead") };
    Ok(vec![turns, verdict_of_closure(&bead), verdict_of_bead(&bead, stated, tolerance)])
}

/// Asks until the answer has the right form.
fn ask(person: &mut dyn Person, question: &Question) -> anyhow::Result<String> {
    loop {
        let typed = person.ask(question, &Machine::default())?;
        let read = question.kind.read(&typed).map_err(Refused::Wrong);
        person.answered(question, read.as_ref().err())?;
        if let Ok(value) = read {
            return Ok(value);
        }
    }
}

fn verdict_of_turn(turn: &Turn) -> Verdict {
    let verdict = |is_right, found| Verdict { what: "turn", is_right, found };
    let [seen, all] = turn.seen;
    if seen * 2 < all {
        return verdict(false, format!("the bead was found in {seen} of {all} pictures: look at its place, focus and light"));
    }
    let Some(orbit) = turn.orbit else {
        let why = "the bead moves less than 1 px, or not on a circle: the motors have no power or do not hold the capillary, or the bead is on the axis";
        return verdict(false, why.into());
    };
    let is_right = (orbit.period_steps / turn.commanded_steps - 1.0).abs() <= MOST_STEPS_OFF;
    let likely =
        if is_right { String::new() } else { format!("; rig.steps_per_revolution = [{}, 1] is likely", likely(orbit.period_steps)) };
    verdict(is_right, format!("the bead is back after {:.1} steps, {} are configured{likely}", orbit.period_steps, turn.commanded_steps))
}

fn verdict_of_closure(bead: &Bead) -> Verdict {
    let least = 100.0 * LEAST_CLOSURE;
    let is_right = bead.closure_iou.is_some_and(|iou| iou >= LEAST_CLOSURE);
    let found = match bead.closure_iou {
        Some(iou) => format!("after one turn the bead overlaps with itself by {:.1} %, {least:.0} % or more are expected", 100.0 * iou),
        None => "the overlap of the bead with itself after one turn could not be measured".into(),
    };
    let remedy = if is_right { "" } else { ": the bead moved in the water, or the motors lost steps" };
    Verdict { what: "closure", is_right, found: format!("{found}{remedy}") }
}

fn verdict_of_bead(bead: &Bead, stated: f64, tolerance: f64) -> Verdict {
    let off = 100.0 * (bead.diameter_um / stated - 1.0);
    let is_right = off.abs() <= tolerance;
    let remedy = if is_right { String::new() } else { format!(": measure the scale again with carved setup{}", out_of_focus(bead)) };
    Verdict {
        what: "bead",
        is_right,
        found: format!("{:.2} um measured, {stated} um stated: {off:+.2} %, {tolerance} % is allowed{remedy}", bead.diameter_um),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::setup::tests::{FakeBench, Script, bead, turn};

    fn checked(bench: FakeBench, changes: &[(&'static str, &'static str)]) -> (Vec<Verdict>, Script) {
        let (mut person, mut bench) = (Script::new(&bench, changes), bench);
        let config = include_str!("../../../config/vast-grbl.toml");
        (check(&mut bench, &mut person, config, &|| false).unwrap(), person)
    }

    fn wrong(verdicts: &[Verdict]) -> Vec<&'static str> {
        verdicts.iter().filter(|verdict| !verdict.is_right).map(|verdict| verdict.what).collect()
    }

    #[test]
    fn a_right_rig_is_right_and_moves_after_the_confirmation_only() {
        let outcomes = [Ok(Outcome::Bead(bead(500.4)))];
        let (verdicts, person) = checked(FakeBench::new("grbl").with(Action::Measure, outcomes), &[("bead_um", "60x"), ("bead_um", "500")]);
        assert_eq!((verdicts.len(), wrong(&verdicts)), (3, vec![]));
        assert_eq!(person.asked(), ["bead_um", "bead_um", "tolerance_percent", "loaded", "motion"]);
        assert!(person.heard("is no number; expected 20 to 4500 um"));
    }

    #[test]
    fn each_fault_of_a_rig_is_named() {
        let bench = FakeBench::new("grbl").with(Action::Turn, [Ok(Outcome::Turn(turn(399.0)))]);
        let (verdicts, _) = checked(bench, &[]);
        assert_eq!((verdicts.len(), wrong(&verdicts)), (1, vec!["turn"]));
        assert!(verdicts[0].found.contains("[400, 1] is likely"), "{}", verdicts[0].found);
        for broken in [Turn { orbit: None, ..turn(500.0) }, Turn { seen: [3, 42], ..turn(500.0) }] {
            let (verdicts, _) = checked(FakeBench::new("grbl").with(Action::Turn, [Ok(Outcome::Turn(broken))]), &[]);
            assert_eq!(wrong(&verdicts), ["turn"]);
        }
        let measured = |bead| FakeBench::new("grbl").with(Action::Measure, [Ok(Outcome::Bead(bead))]);
        let (verdicts, _) = checked(measured(bead(506.0)), &[]);
        assert_eq!(wrong(&verdicts), ["bead"]);
        let (verdicts, _) = checked(measured(bead(506.0)), &[("tolerance_percent", "2")]);
        assert!(wrong(&verdicts).is_empty());
        for iou in [Some(0.9), None] {
            let (verdicts, _) = checked(measured(Bead { closure_iou: iou, ..bead(500.0) }), &[]);
            assert_eq!(wrong(&verdicts), ["closure"]);
        }
    }
}
