//! The set-up in a terminal, or by answers that are given beforehand.

use super::bench::Action;
use super::dialogue::Person;
use super::machine::{Machine, Refused};
use super::question::{Kind, Question, ids};
use super::rig::Stopper;
use super::{Args, Work};
use anyhow::{Context, bail, ensure};
use std::collections::{BTreeMap, VecDeque};
use std::io::IsTerminal;
use std::path::Path;

/// Where the answers come from.
pub enum Answers {
    /// One line per question.
    Lines(std::io::Lines<std::io::StdinLock<'static>>),
    /// By question, in the order of being asked.
    File(BTreeMap<String, VecDeque<String>>),
}

/// Sets up in a terminal, or by given answers.
///
/// # Errors
/// Files that cannot be used, and a set-up that cannot go on without a person.
pub fn run(args: &Args, stopper: &Stopper) -> anyhow::Result<()> {
    let mut answers = Answers::of(args.answers.as_deref())?;
    let mut work = Work::begin(args, stopper, None)?;
    say!("Type back to answer the question before again. Ctrl-C ends the set-up and stops the motors.");
    let summary = work.converse(&mut answers)?;
    say!("\n{summary}");
    Ok(())
}

impl Person for Answers {
    fn tell(&mut self, text: &str) -> anyhow::Result<()> {
        say!("{text}");
        Ok(())
    }

    fn busy(&mut self, action: Action, _: &Machine) -> anyhow::Result<()> {
        say!("\n{}", action.doing());
        Ok(())
    }

    fn ask(&mut self, question: &Question, _: &Machine) -> anyhow::Result<String> {
        say!("\n{}", shown(question));
        self.next(question)
    }

    fn answered(&mut self, question: &Question, refused: Option<&Refused>) -> anyhow::Result<()> {
        if let Some(refused) = refused {
            self.refused(question, refused)?;
            say!("{}.", refused.text());
        }
        Ok(())
    }
}

impl Answers {
    /// Answers of a file, of standard input with the name `-`, or of a terminal.
    ///
    /// # Errors
    /// A file that cannot be read, and no terminal.
    pub fn of(file: Option<&Path>) -> anyhow::Result<Self> {
        let lines = || Ok(Self::Lines(std::io::stdin().lines()));
        match file {
            Some(file) if file == Path::new("-") => lines(),
            Some(file) => {
                let text = carved_files::read_to_string(file).with_context(|| format!("{}: cannot be read", file.display()))?;
                Self::parse(&text).with_context(|| file.display().to_string())
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

    /// Answers of the text of a file.
    ///
    /// # Errors
    /// Another form, or an answer to a question that is not asked.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let table: toml::Table = text.parse().context("is no TOML")?;
        if let Some(unknown) = table.keys().find(|key| !ids().any(|id| id == *key)) {
            let known = ids().collect::<Vec<_>>().join(", ");
            bail!("there is no question {unknown:?}; the questions are {known}");
        }
        let word = |value: &toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let list = |value: &toml::Value| value.as_array().map_or_else(|| [word(value)].into(), |all| all.iter().map(word).collect());
        Ok(Self::File(table.iter().map(|(id, value)| (id.clone(), list(value))).collect()))
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
