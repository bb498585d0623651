//! The conversation: the machine says what comes next, a person answers, the bench works.
//!
//! ```text
//! machine ─┬─ Ask ──► Person::ask ──► Machine::answer ─┬─ taken
//!          │                                           └─ refused: Person::answered, and the same question again
//!          └─ Act ──► Bench::perform ─┬─ outcome: Person::tell, Machine::done
//!                                     └─ failed: Machine::failed, a question with the reason. Stopped: the end
//! ```
//! The state is stored after each step. Nobody is named here: a terminal, a file of answers and a page are a [`Person`] each.

use super::bench::{Action, Bench};
use super::machine::{Machine, Refused, Step};
use super::question::Question;
use super::state::State;

/// Who answers.
pub trait Person {
    /// Hears what was found or done.
    ///
    /// # Errors
    /// Nobody listens any more.
    fn tell(&mut self, text: &str) -> anyhow::Result<()>;
    /// Hears what the bench does from now on.
    ///
    /// # Errors
    /// Nobody listens any more.
    fn busy(&mut self, action: Action, machine: &Machine) -> anyhow::Result<()>;
    /// Answers a question, as typed.
    ///
    /// # Errors
    /// Nobody answers any more, or a file has no answer.
    fn ask(&mut self, question: &Question, machine: &Machine) -> anyhow::Result<String>;
    /// Hears whether the answer was taken.
    ///
    /// # Errors
    /// A file cannot give another answer.
    fn answered(&mut self, question: &Question, refused: Option<&Refused>) -> anyhow::Result<()>;
}

/// The set-up was stopped while the bench worked.
#[derive(Debug, thiserror::Error)]
#[error("stopped: the motors were told to stop, and the light to go off. The answers are kept; the same command goes on with them")]
pub struct Stopped;

/// Sets up until the configuration is written. `keep` stores the state after each step.
///
/// # Errors
/// [`Stopped`], those of the person, and those of `keep`.
pub fn converse(
    machine: &mut Machine,
    bench: &mut dyn Bench,
    person: &mut dyn Person,
    is_stopped: &dyn Fn() -> bool,
    keep: &mut dyn FnMut(&State) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    loop {
        match machine.next(bench.exists()) {
            Step::Finished => return Ok(()),
            Step::Act(action) => {
                person.busy(action, machine)?;
                let draft = machine.draft();
                match bench.perform(&machine.request(action, &draft)) {
                    Ok(outcome) => {
                        person.tell(&outcome.to_string())?;
                        machine.done(outcome);
                    }
                    Err(_) if is_stopped() => return Err(Stopped.into()),
                    Err(why) => machine.failed(action, why),
                }
            }
            Step::Ask(question) => {
                let typed = person.ask(&question, machine)?;
                let refused = machine.answer(&typed, bench).err();
                person.answered(&question, refused.as_ref())?;
            }
        }
        keep(machine.state())?;
    }
}
