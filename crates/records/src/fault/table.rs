//! The table of all faults: what each one means, what the scheduler does, and what the operator does.
//!
//! ```text
//! table ─┬─> faults in the status and the journal
//!        ├─> GET /v1/fault-codes
//!        └─> the table of codes in docs/faults.md, which a test compares
//! ```
//! A fault is `recoverable` if the daemon does not have to be restarted: it recovers by itself, or after the action of the operator in this
//! table.

use crate::SchedulerAction::{self, EscalateOperator, PauseInstrument, Retry};
use serde::Serialize;

/// A fault code, with its constant properties.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FaultCode {
    /// Stable name for use in programs.
    pub code: &'static str,
    pub category: Category,
    /// What the scheduler does, unless the fault overrides it.
    pub scheduler_action: SchedulerAction,
    /// Whether a person must act before the instrument can be used again.
    pub operator_required: bool,
    /// Whether the daemon continues without a restart.
    pub recoverable: bool,
    pub meaning: &'static str,
    /// What the operator does about the cause, in plain words. [`Fault::advice`](super::Fault::advice) adds how the fault ends and how the
    /// run continues.
    pub remedy: &'static str,
}

/// The entry of a code. `None` if the code is unknown.
pub fn of(code: &str) -> Option<&'static FaultCode> {
    ALL.iter().find(|known| known.code == code)
}

/// The part of the instrument that a fault concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Category {
    Camera,
    Views,
    Optics,
    Motion,
    Sampler,
    Storage,
    Software,
    Safety,
}

impl Category {
    pub fn word(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Views => "views",
            Self::Optics => "optics",
            Self::Motion => "motion",
            Self::Sampler => "sampler",
            Self::Storage => "storage",
            Self::Software => "software",
            Self::Safety => "safety",
        }
    }
}

/// Defines a constant for each entry and the list of all entries, so that no code is missing in the list.
macro_rules! codes {
    ($($name:ident = $code:literal, $category:ident, $action:ident, operator: $operator:literal, recoverable: $recoverable:literal,
       $meaning:literal, $remedy:literal;)*) => {
        $(pub const $name: FaultCode = FaultCode {
            code: $code,
            category: Category::$category,
            scheduler_action: $action,
            operator_required: $operator,
            recoverable: $recoverable,
            meaning: $meaning,
            remedy: $remedy,
        };)*
        /// All codes, in the order of the documents.
        pub const ALL: &[FaultCode] = &[$($name),*];
    };
}

codes! {
    CAMERA_LOST = "camera_lost", Camera, PauseInstrument, operator: true, recoverable: true,
        "Camera lost. It does not answer, or the control of it was lost, for longer than a run waits.",
        "Check the camera's power and network cable.";
    CAMERA_TAKEN = "camera_taken", Camera, PauseInstrument, operator: true, recoverable: true,
        "Another program controls the camera.",
        "Exit the other program, on this or another computer. A VAST's own program has its camera until it is exited.";
    CAMERA_NO_FRAME = "camera_no_frame", Camera, Retry, operator: false, recoverable: true,
        "No whole frame came within the step's deadline, though the camera answers.",
        "If it comes again, check the network cable and the other traffic on its network.";
    CAMERA_CLOCK = "camera_clock", Camera, Retry, operator: false, recoverable: true,
        "The camera's clock or frame numbers began anew in the middle of a turn, or its clock does not run as fast as the camera reports.",
        "If it comes again, check the camera's power supply and firmware, and use a method that takes the views one by one.";
    CAMERA_CHANGED = "camera_changed", Camera, Retry, operator: false, recoverable: true,
        "A feature of the camera, such as exposure, gain or a mirrored picture, was changed while the run took views.",
        "If it comes again, exit the other program that changes the camera, and look at the camera's own automatic functions.";
    CAMERA_REFUSED = "camera_refused", Camera, EscalateOperator, operator: true, recoverable: false,
        "The camera does not take a value of the configuration.",
        "Correct the value that the message names in the configuration, and start the daemon again.";
    SECOND_CAMERA_FAILED = "second_camera_failed", Camera, PauseInstrument, operator: true, recoverable: true,
        "The second camera failed in a run.",
        "Check the second camera's power and cable, and exit any other program that uses it.";
    PICTURES_LOST = "pictures_lost", Views, PauseInstrument, operator: true, recoverable: true,
        "The folder into which another program stores the pictures cannot be read.",
        "Check that the computer with the folder is on and that its share is mounted.";
    PICTURES_LATE = "pictures_late", Views, PauseInstrument, operator: true, recoverable: true,
        "In the middle of a turn, the other program has stored no picture for longer than `views.next_picture_s`.",
        "Look whether the other program still turns the capillary and stores pictures.";
    PICTURES_EARLIER = "pictures_earlier", Views, EscalateOperator, operator: true, recoverable: true,
        "The folder of the plate had pictures before its run began. They are measured as this plate if the run is continued.",
        "Look which plate they show. If they belong to another plate, end the run, move them out of the folder, and start a new run.";
    PICTURES_UNFIT = "pictures_unfit", Views, EscalateOperator, operator: true, recoverable: true,
        "The pictures of the other program have another size or format than the configuration says.",
        "Set the other program to the size of the configuration. If the configuration is wrong, correct `[optics]` or `[views]` and start the daemon again.";
    PICTURE_LIGHT = "picture_light", Optics, EscalateOperator, operator: true, recoverable: true,
        "The light is too dark or too bright to see a specimen. The run is held, and the specimen stays in the capillary.",
        "Look at the lamp, at what stands in its light, and at the exposure.";
    CAPILLARY_NOT_SEEN = "capillary_not_seen", Optics, EscalateOperator, operator: true, recoverable: true,
        "The picture does not show the capillary's walls, or a part of it is damaged. The run is held, and the specimen stays in the capillary.",
        "Look whether the capillary is in place, clean and in focus, and whether the camera has been moved; for a damaged picture look at the camera, its cable and the network.";
    SCALE_OFF = "scale_off", Optics, EscalateOperator, operator: true, recoverable: true,
        "The capillary in the picture is not as wide as the configuration says. The run is held, and the specimen stays in the capillary.",
        "Look whether the lens or the capillary was changed. If the scale, bore_um, box_um or the picture of the empty capillary is wrong, correct it and start the daemon again.";
    SETUP_UNUSABLE = "setup_unusable", Optics, EscalateOperator, operator: true, recoverable: false,
        "No specimen can be measured with this method on this rig. The run is held, and nothing is ejected.",
        "If the message names the configuration, correct it and start the daemon again. If it names the method of the run, end the run and choose another method.";
    ROTATION_LOST = "rotation_lost", Motion, PauseInstrument, operator: true, recoverable: true,
        "The axis' controller does not answer any more.",
        "Check the controller's power and cable, and whether an emergency stop cut its supply.";
    ROTATION_SUSPECT = "rotation_suspect", Motion, Retry, operator: false, recoverable: true,
        "The position of the axis is uncertain, or the pictures show that the specimen does not turn. The axis was stopped. A stock VAST that may be out of step and a specimen that does not turn ask for a person.",
        "If a stock VAST steps through a list, end the list first. If the specimen does not turn, check the motor's supply, the coupling and the belt.";
    ROTATION_ALARM = "rotation_alarm", Motion, EscalateOperator, operator: true, recoverable: true,
        "The controller is in alarm: a limit switch, a stall, motors that came apart, an encoder's or driver's error.",
        "Look what touched the switch or holds the capillary, and clear it.";
    ROTATION_INTERVENTION = "rotation_intervention", Motion, EscalateOperator, operator: true, recoverable: true,
        "Somebody stopped, moved or reset the axis at its controller, or a safety circuit did: feed hold, knob, emergency stop, open door, reset button. A restart that carved did not request counts as a reset. The run is held and the axis is left alone.",
        "Finish what you are doing at the instrument, and release what the message names: its stop, its door, its hold or its check mode.";
    VAST_LIST = "vast_list", Motion, EscalateOperator, operator: true, recoverable: true,
        "VAST's program does not have the list of the views yet. The run is held before the next specimen is asked for.",
        "In VAST's program, open Imaging, Imaging with external device, and load the list. Tick \"Enable external imaging\" and press \"Run external imaging\".";
    VAST_PROGRAM = "vast_program", Motion, EscalateOperator, operator: true, recoverable: true,
        "VAST is not started, or the program on its computer is not connected. The run is held and VAST is left alone.",
        "Start VAST at its computer, or press Connect there. The message says which.";
    ROTATION_SETTINGS = "rotation_settings", Motion, EscalateOperator, operator: true, recoverable: true,
        "The controller's settings are not those of the configuration; the message names each.",
        "Write the settings into the controller. If the configuration is what is wrong, correct it and start the daemon again.";
    ROTATION_FAILED = "rotation_failed", Motion, PauseInstrument, operator: true, recoverable: true,
        "The axis could not do what it was asked to, for another reason than those above.",
        "Read the message: it says what was asked and why it was refused.";
    OUTPUT_FAILED = "output_failed", Motion, EscalateOperator, operator: true, recoverable: true,
        "The controller did not switch an output on that the pictures need, such as that of the light. The run is held, and the specimen stays in the capillary.",
        "Check what is wired to the output. If the message says that the controller does not have it, choose another pin in the configuration and start the daemon again.";
    REVOLUTION_FAILED = "revolution_failed", Motion, PauseInstrument, operator: true, recoverable: true,
        "A revolution could not be planned or carried through.",
        "Read the message. If it names the method, end the run and choose another method for the next.";
    SAMPLER_FAILED = "sampler_failed", Sampler, PauseInstrument, operator: true, recoverable: true,
        "The sampler did not bring or take away a specimen, or brought one that no run asked for.",
        "Look whether a specimen is stuck in the tubing or the capillary, take it out and say so to the instrument.";
    POSITION_OVERRUN = "position_overrun", Motion, PauseInstrument, operator: true, recoverable: true,
        "The reference, or bringing the specimen into view, exceeded its deadline in every attempt that the method's policy permits.",
        "Look what holds the capillary or the axis up. If it is only slow, allow the phase more time in the method's policy.";
    SAMPLER_OVERRUN = "sampler_overrun", Sampler, PauseInstrument, operator: true, recoverable: true,
        "Loading, ejecting or washing took longer than the method's policy allows.",
        "Look whether a specimen is stuck, or who should have brought it. If it is only slow, allow the phase more time in the method's policy.";
    STORE_FAILED = "store_failed", Storage, PauseInstrument, operator: true, recoverable: true,
        "Something could not be written to disk. Leave the plate in.",
        "Check that the data folder is there, belongs to the daemon and can be written.";
    DISK_FULL = "disk_full", Storage, PauseInstrument, operator: true, recoverable: true,
        "The disk that holds the data is full. Leave the plate in.",
        "Make room on the data disk.";
    DISK_SLOW = "disk_slow", Storage, Retry, operator: false, recoverable: true,
        "The disk that holds the data takes seconds for a write. Everything is still written, and everything takes longer.",
        "Look what else uses the disk, and whether it is about to fail.";
    EMERGENCY_STOP = "emergency_stop", Safety, EscalateOperator, operator: true, recoverable: true,
        "Somebody pressed the emergency stop. The motors stand, a run that was under way is aborted, and nothing starts.",
        "Make sure that the instrument is safe.";
    JOURNAL_DAMAGED = "journal_damaged", Software, PauseInstrument, operator: true, recoverable: true,
        "A line of the journal could not be read and was left out. What it said of the plate, the capillary or a run is not known.",
        "Look which plate is inside and whether a specimen is in the capillary, and correct what the instrument says of them.";
    QUEUE_UNREADABLE = "queue_unreadable", Software, EscalateOperator, operator: true, recoverable: false,
        "The file of the queue of plates cannot be read. It is left as it is. The queue is empty and takes no plate, and no run starts.",
        "Restore queue.json in the data folder from a copy, or move it away, and start the daemon again.";
    INTERNAL_ERROR = "internal_error", Software, PauseInstrument, operator: true, recoverable: true,
        "A part of the program ended that should not have.",
        "Keep the daemon's log and report it.";
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn codes_are_plain_words_each_given_once_and_explained() {
        let mut seen = BTreeSet::new();
        for c in ALL {
            assert!(seen.insert(c.code), "{} twice", c.code);
            assert!(c.code.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{}", c.code);
            for text in [c.meaning, c.remedy] {
                assert!(text.ends_with('.') && !text.contains('|'), "{}: {text}", c.code);
            }
            // A scheduler retries exactly if no operator is required.
            assert_eq!(c.operator_required, c.scheduler_action != Retry, "{}", c.code);
        }
    }

    /// The rule says how a fault ends and whether the run continues. A remedy that repeats it could contradict it.
    #[test]
    fn a_remedy_leaves_to_the_rule_how_the_run_goes_on() {
        for c in ALL {
            for words in ["acknowledge", "go on", "continues", "by itself", "Nothing"] {
                assert!(!c.remedy.contains(words), "{}: {}", c.code, c.remedy);
            }
        }
    }

    /// One row of the documents.
    fn row(c: &FaultCode) -> String {
        let action = serde_json::to_value(c.scheduler_action).unwrap();
        let yes = |it: bool| if it { "yes" } else { "no" };
        format!(
            "| `{}` | {} | `{}` | {} | {} | {} | {} |",
            c.code,
            c.category.word(),
            action.as_str().unwrap(),
            yes(c.operator_required),
            yes(c.recoverable),
            c.meaning,
            c.what_to_do()
        )
    }

    #[test]
    fn the_documents_table_is_this_one() {
        let documents = include_str!("../../../../docs/faults.md");
        let section = documents.split("\n## All codes\n").nth(1).expect("docs/faults.md has a section `All codes`");
        let section = section.split("\n## ").next().unwrap();
        let found: Vec<&str> = section.lines().filter(|l| l.starts_with("| `")).collect();
        let wanted: Vec<String> = ALL.iter().map(row).collect();
        assert!(found == wanted, "docs/faults.md, All codes, should have these rows:\n{}", wanted.join("\n"));
    }

    /// Every code that a row of the documents mentions must exist.
    #[test]
    fn no_row_of_the_documents_names_a_code_that_is_none() {
        let documents = include_str!("../../../../docs/faults.md");
        let prefixes = ["camera_", "second_camera_", "picture_", "scale_", "setup_", "rotation_", "revolution_", "sampler_", "store_"];
        let words = documents.split('`').skip(1).step_by(2).filter(|w| w.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'));
        for word in words.filter(|w| prefixes.iter().any(|p| w.starts_with(p))) {
            assert!(ALL.iter().any(|c| c.code == word), "docs/faults.md names {word}, which is no code");
        }
    }
}
