//! The set-up in a terminal, or by answers that are given beforehand.

use super::Args;
use super::bench::Bench;
use super::machine::{Machine, Refused, State, Step};
use super::question::{Kind, Question};
use super::rig::{RealBench, Shown, Stopper, stored};
use anyhow::{Context, bail, ensure};
use carved_store::durable;
use std::collections::{BTreeMap, VecDeque};
use std::io::IsTerminal;
use std::path::Path;

/// Where the answers come from.
enum Answers {
    /// One line per question.
    Lines(std::io::Lines<std::io::StdinLock<'static>>),
    /// By question, in the order of being asked.
    File(BTreeMap<String, VecDeque<String>>),
}

pub fn run(args: &Args, state: &Path, stopper: &Stopper) -> anyhow::Result<()> {
    let mut answers = Answers::of(args)?;
    let mut bench = RealBench::new(args.out.clone(), stopper.clone(), Shown::default());
    let mut machine = stored::<State>(state)?.map(Machine::resume).unwrap_or_default();
    if machine.state() != &State::default() {
        say!("Going on with the answers in {}. Remove that file to begin again.", state.display());
    }
    say!("Type back to answer the question before again. Ctrl-C ends the set-up and stops the motors.");
    loop {
        match machine.next(bench.exists()) {
            Step::Finished => break,
            Step::Act(action) => {
                say!("\n{}", action.doing());
                let draft = machine.draft();
                match bench.perform(&machine.request(action, &draft)) {
                    Ok(outcome) => {
                        say!("{outcome}");
                        machine.done(outcome);
                    }
                    Err(_) if stopper.is_stopped() => {
                        bail!("stopped: the motors were told to stop. The answers are in {}", state.display())
                    }
                    Err(why) => machine.failed(action, why),
                }
            }
            Step::Ask(question) => {
                say!("\n{}", shown(&question));
                let typed = answers.next(&question)?;
                if let Err(refused) = machine.answer(&typed, &bench) {
                    answers.refused(&question, &refused)?;
                    say!("{}.", refused.text());
                }
            }
        }
        durable::write_json(state, machine.state())?;
    }
    say!("\n{}", machine.summary());
    std::fs::remove_file(state).with_context(|| format!("{}: cannot be removed", state.display()))
}

impl Answers {
    fn of(args: &Args) -> anyhow::Result<Self> {
        let lines = || Ok(Self::Lines(std::io::stdin().lines()));
        match &args.answers {
            Some(file) if file == Path::new("-") => lines(),
            Some(file) => {
                let text = carved_files::read_to_string(file).with_context(|| format!("{}: cannot be read", file.display()))?;
                let table: toml::Table = text.parse().with_context(|| format!("{}: is no TOML", file.display()))?;
                let word = |value: &toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                let list =
                    |value: &toml::Value| value.as_array().map_or_else(|| [word(value)].into(), |all| all.iter().map(word).collect());
                Ok(Self::File(table.iter().map(|(id, value)| (id.clone(), list(value))).collect()))
            }
            None => {
                ensure!(
                    std::io::stdin().is_terminal(),
                    "standard input is no terminal, so nobody can be asked; give --answers FILE, or --answers - for one answer per line"
                );
                lines()
            }
        }
    }

    /// The answer to a question.
    fn next(&mut self, question: &Question) -> anyhow::Result<String> {
        let default = question.default.clone();
        match self {
            Self::Lines(lines) => {
                let typed = lines.next().context("standard input ended before the set-up did; start it again to go on")??;
                Ok(if typed.trim().is_empty() { default.unwrap_or_default() } else { typed })
            }
            Self::File(answers) => match answers.get_mut(question.id).and_then(VecDeque::pop_front) {
                Some(answer) => {
                    say!("> {answer}");
                    Ok(answer)
                }
                None => match (&question.problem, default) {
                    (Some(problem), _) => bail!("{problem}. The file of answers has no further answer to {:?}", question.id),
                    (None, Some(default)) => {
                        say!("> {default}");
                        Ok(default)
                    }
                    (None, None) => bail!("the file of answers has no answer to {:?}: {}", question.id, question.text),
                },
            },
        }
    }

    /// A file whose answer was refused must have another one.
    fn refused(&self, question: &Question, refused: &Refused) -> anyhow::Result<()> {
        match self {
            Self::File(answers) if answers.get(question.id).is_none_or(VecDeque::is_empty) => bail!("{}: {}", question.id, refused.text()),
            _ => Ok(()),
        }
    }
}

/// The question as it is printed, with its default in brackets.
fn shown(question: &Question) -> String {
    let mut text = String::new();
    if let Some(problem) = &question.problem {
        text += &format!("! {problem}.\n");
    }
    text += &question.text;
    if let Kind::Choice { options, .. } = &question.kind {
        for (number, option) in (1..).zip(options) {
            text += &format!("\n  {number}  {:<18} {}", option.value, option.label);
        }
    }
    let unit = if let Kind::Number { unit, .. } = &question.kind { format!(", in {unit}") } else { String::new() };
    let default = match (&question.kind, &question.default) {
        (Kind::Confirm, _) => " [type yes]".into(),
        (_, Some(default)) => format!(" [{default}]"),
        _ => String::new(),
    };
    format!("{text}\n{}{unit}{default}:", question.id)
}
