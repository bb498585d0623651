//! What a person does about a fault: the remedy of the table, and the next action by the rule that continues a held run.
//!
//! ```text
//!  the fault ends with ─┬─ its cause ────────────── remedy, then the run continues by itself or waits
//!                       ├─ the run's continuation ─ remedy, continue the run
//!                       ├─ acknowledgement ──────── remedy, acknowledge, continue the run
//!                       └─ restart ──────────────── remedy
//! ```
//! The part of a remedy that begins with `If` is placed at the end.

use super::table::{self, Category, FaultCode};
use super::{Device, Fault};

/// What ends a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultEnd {
    /// The end of its cause: a lost device answers, the disk accepts writes.
    Cause,
    /// The continuation of the held run.
    Resumption,
    /// An acknowledgement.
    Acknowledgement,
    /// A restart of the daemon. An acknowledgement alone does not remove the cause.
    Restart,
}

/// The current run while a fault is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunUnderFault {
    /// There is no run, or it is ending.
    None,
    /// The run continues without a person once the cause of the hold is over.
    GoesOnByItself,
    /// The run waits for a person.
    Waits,
}

impl FaultCode {
    /// As [`Fault::is_tried_again`].
    pub fn is_tried_again(&self) -> bool {
        [table::CAMERA_NO_FRAME.code, table::CAMERA_CLOCK.code, table::CAMERA_CHANGED.code].contains(&self.code)
    }

    /// What the operator does, if the method continues the run by itself where possible.
    pub fn what_to_do(&self) -> String {
        let end = end(self.code, self.category.word(), self.operator_required, self.recoverable);
        let by_itself = end == FaultEnd::Cause || self.is_tried_again();
        words(self, end, if by_itself { RunUnderFault::GoesOnByItself } else { RunUnderFault::Waits })
    }
}

impl Fault {
    /// What ends it.
    pub fn end(&self) -> FaultEnd {
        end(&self.code, &self.category, self.operator_required, self.recoverable)
    }

    /// What the operator does about the fault now. A code of another version has the text that was stored with it.
    pub fn advice(&self, run: RunUnderFault) -> String {
        table::of(&self.code).map_or_else(|| self.what_to_do.clone(), |code| words(code, self.end(), run))
    }

    /// Whether a person must act: the fault requires it, or the held run waits.
    pub fn needs_a_person(&self, run: RunUnderFault) -> bool {
        self.operator_required || run == RunUnderFault::Waits && self.is_in_the_way()
    }
}

fn end(code: &str, category: &str, operator_required: bool, recoverable: bool) -> FaultEnd {
    let is_lost_device = [Device::Camera, Device::Rotation, Device::Pictures].iter().any(|device| device.is_named_by(code));
    match (category == Category::Storage.word() || is_lost_device, operator_required, recoverable) {
        (true, ..) => FaultEnd::Cause,
        (_, false, _) => FaultEnd::Resumption,
        (_, _, true) => FaultEnd::Acknowledgement,
        (_, _, false) => FaultEnd::Restart,
    }
}

fn words(code: &FaultCode, end: FaultEnd, run: RunUnderFault) -> String {
    let remedy = code.remedy;
    let over = match code.category {
        Category::Camera => "the camera answers",
        Category::Views => "the folder can be read",
        Category::Storage => "the disk accepts writes again",
        _ => "the axis answers",
    };
    // A conditional part comes last, because it may end the run or the daemon instead.
    let condition = if remedy.starts_with("If ") { Some(0) } else { remedy.find(" If ").map(|at| at + 1) };
    let (first, otherwise) = remedy.split_at(condition.unwrap_or(remedy.len()));
    let rule = match (end, run) {
        _ if code.code == table::DISK_SLOW.code => "The fault ends by itself when the disk is fast again.".to_owned(),
        (_, RunUnderFault::None) if code.code == table::ROTATION_LOST.code => format!("When {over}, acknowledge that it is back."),
        _ if code.code == table::ROTATION_LOST.code => format!("When {over}, acknowledge that it is back and let the run go on."),
        (FaultEnd::Cause, RunUnderFault::GoesOnByItself) => format!("The run continues by itself when {over}."),
        (FaultEnd::Cause, RunUnderFault::Waits) => format!("When {over}, let the run go on."),
        (FaultEnd::Cause, RunUnderFault::None) => format!("The fault ends by itself when {over}."),
        (FaultEnd::Resumption, RunUnderFault::None) => "The fault ends when a run starts.".to_owned(),
        (FaultEnd::Resumption, RunUnderFault::GoesOnByItself) if code.is_tried_again() => {
            "The run continues by itself after a pause: the specimen is begun anew. You can let it go on at once.".to_owned()
        }
        (FaultEnd::Resumption, _) => "Then let the run go on: the specimen is begun anew.".to_owned(),
        // An aborted run does not continue.
        (FaultEnd::Acknowledgement, RunUnderFault::None) => "Then acknowledge the fault.".to_owned(),
        (FaultEnd::Acknowledgement, _) if code.code == table::EMERGENCY_STOP.code => "Then acknowledge the fault.".to_owned(),
        (FaultEnd::Acknowledgement, _) => "Then acknowledge the fault and let the run go on.".to_owned(),
        (FaultEnd::Restart, _) => return remedy.to_owned(),
    };
    let rule = match rule.strip_prefix("Then ").filter(|_| first.is_empty()) {
        Some(rest) => rest[..1].to_uppercase() + &rest[1..],
        None => rule,
    };
    [first.trim_end(), &rule, otherwise].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For any state of the run, the advice does not contradict it.
    #[test]
    fn an_advice_says_of_the_run_what_the_run_does() {
        for code in table::ALL {
            let fault = Fault::new(1, code, String::new(), String::new());
            for run in [RunUnderFault::None, RunUnderFault::GoesOnByItself, RunUnderFault::Waits] {
                let advice = fault.advice(run);
                let asks_for_a_person = advice.contains("et the run go on");
                assert!(run != RunUnderFault::None || !asks_for_a_person, "{}: {advice}", code.code);
                assert_eq!(
                    advice.contains("run continues by itself"),
                    run == RunUnderFault::GoesOnByItself && (code.is_tried_again() || fault.lets_run_go_on() && fault.is_in_the_way()),
                    "{}: {advice}",
                    code.code
                );
                // When a lost axis is back, another fault says so.
                let is_to_be_acknowledged = fault.end() == FaultEnd::Acknowledgement || code.code == table::ROTATION_LOST.code;
                assert_eq!(advice.contains("cknowledge"), is_to_be_acknowledged, "{}: {advice}", code.code);
                assert!(run != RunUnderFault::Waits || fault.needs_a_person(run) == fault.is_in_the_way(), "{}", code.code);
                if let Some(at) = advice.find("cknowledge") {
                    for instead in ["end the run", "start the daemon again"] {
                        assert!(advice.find(instead).is_none_or(|other| at < other), "{}: {advice}", code.code);
                    }
                }
            }
        }
    }

    #[test]
    fn a_stored_fault_gets_the_words_of_today_unless_its_code_is_not_known() {
        let stored = |code: &FaultCode| Fault { what_to_do: "Wait.".into(), ..Fault::new(1, code, String::new(), String::new()) };
        let lost = stored(&table::CAMERA_LOST);
        assert_eq!(
            lost.advice(RunUnderFault::Waits),
            "Check the camera's power and network cable. When the camera answers, let the run go on."
        );
        assert_eq!(Fault { code: "of_old".into(), ..lost }.advice(RunUnderFault::Waits), "Wait.");
        let no_frame = stored(&table::CAMERA_NO_FRAME);
        assert!(no_frame.advice(RunUnderFault::Waits).starts_with("Let the run go on"));
        assert!(no_frame.needs_a_person(RunUnderFault::Waits) && !no_frame.needs_a_person(RunUnderFault::None));
    }
}
