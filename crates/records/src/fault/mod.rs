//! Faults, as people, schedulers and the journal read them.

mod advice;
pub mod table;

pub use advice::{FaultEnd, RunUnderFault};

use crate::SchedulerAction;
use serde::{Deserialize, Serialize};
use table::{Category, FaultCode};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Its number. Numbers increase, also across restarts.
    pub seq: u64,
    pub code: String,
    pub category: String,
    pub message: String,
    pub recoverable: bool,
    pub scheduler_action: SchedulerAction,
    pub operator_required: bool,
    /// The meaning of its code, in plain words. `message` describes this occurrence.
    #[serde(default)]
    pub meaning: String,
    /// What the operator does, in plain words, as of the time when the fault was raised. [`Fault::advice`] has the current advice.
    #[serde(default)]
    pub what_to_do: String,
    /// RFC 3339, UTC.
    pub since: String,
}

impl Fault {
    /// A fault with the entry of the table for its code. `since`: RFC 3339, UTC.
    pub fn new(seq: u64, code: &FaultCode, message: String, since: String) -> Self {
        Self {
            seq,
            code: code.code.into(),
            category: code.category.word().into(),
            message,
            recoverable: code.recoverable,
            scheduler_action: code.scheduler_action,
            operator_required: code.operator_required,
            meaning: code.meaning.into(),
            what_to_do: code.what_to_do(),
            since,
        }
    }

    /// What is wrong, in plain words: the meaning of the code. Early journals lack it, and then it is the message.
    pub fn plainly(&self) -> &str {
        if self.meaning.is_empty() { &self.message } else { &self.meaning }
    }

    /// Whether the disk refuses writes.
    pub fn is_of_storage(&self) -> bool {
        self.category == Category::Storage.word() && self.is_in_the_way()
    }

    /// Whether it can hold a run. A slow disk only delays it.
    pub fn is_in_the_way(&self) -> bool {
        self.code != table::DISK_SLOW.code
    }

    /// Whether the run may continue without a person once the fault has ended by itself.
    ///
    /// After a lost axis it may not. A cable that was out, a controller that lost its power, and an emergency stop that cuts the supply look
    /// the same, and opening the port may itself restart the controller. So a person decides when the axis turns again.
    pub fn lets_run_go_on(&self) -> bool {
        self.ends_by_itself() && self.code != table::ROTATION_LOST.code
    }

    /// Whether a held run tries again after a pause: a frame that did not come, or a camera that was changed, may be right the next time, and
    /// nothing has to be done before.
    pub fn is_tried_again(&self) -> bool {
        table::of(&self.code).is_some_and(FaultCode::is_tried_again)
    }

    /// Whether it ends with its cause. [`FaultEnd`] has the other ways.
    pub fn ends_by_itself(&self) -> bool {
        self.end() == FaultEnd::Cause
    }
}

/// A device that can be lost and found again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Device {
    /// The camera of the axial views.
    Camera,
    /// The controller of the rotation axis.
    Rotation,
    /// The folder into which another program stores the views.
    Pictures,
}

impl Device {
    /// What to do if the device is lost.
    pub fn way_out(self) -> &'static str {
        match self {
            Self::Camera => {
                "the camera is lost: check its power and cable, and that no other program has it; it is opened again when it answers"
            }
            Self::Rotation => {
                "the rotation axis is lost: check its power and cable, and any emergency stop that cuts its supply; it is opened again when it answers"
            }
            Self::Pictures => {
                "the folder of the pictures is lost: check the computer with the folder and its share; it is read again when it is there"
            }
        }
    }

    /// The text that the device was found again.
    pub fn back_text(self) -> &'static str {
        match self {
            Self::Camera => "the camera is back",
            Self::Rotation => "the rotation axis is back",
            Self::Pictures => "the folder of the pictures is back",
        }
    }

    /// Whether the fault only says that this device is lost. Such a fault ends when the device is back.
    pub fn is_all_of(self, fault: &Fault) -> bool {
        self.is_named_by(&fault.code)
    }

    fn is_named_by(self, code: &str) -> bool {
        match self {
            Self::Camera => [table::CAMERA_LOST.code, table::CAMERA_TAKEN.code].contains(&code),
            Self::Rotation => code == table::ROTATION_LOST.code,
            Self::Pictures => code == table::PICTURES_LOST.code,
        }
    }
}
