//! What a set-up knows, and what follows from it directly.

use super::bench::{Bead, Controller, Empty, FoundExposure, Listed, Turn, Written};
use carved_core::calibration::rig::bead_extents;
use carved_devices::rotation::{Setup, entry};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A larger difference between bead and bore is a wrong number, not a scale to be corrected, %.
const MOST_SCALE_PERCENT: f64 = 15.0;

/// Everything that is known, as it is stored beside the configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    answers: BTreeMap<String, String>,
    /// The ids of the answers, in the order of answering.
    order: Vec<String>,
    pub(super) problem: Option<Problem>,
    pub(super) ports: Option<Vec<Listed>>,
    pub(super) controller: Option<Controller>,
    pub(super) cameras: Option<Vec<Listed>>,
    pub(super) exposure: Option<FoundExposure>,
    pub(super) empty: Option<Empty>,
    pub(super) is_home: bool,
    pub(super) turn: Option<Turn>,
    /// Measured with the scale of the bore.
    pub(super) bead: Option<Bead>,
    /// Measured with the scale that is written.
    pub(super) proof: Option<Bead>,
    pub(super) written: Option<Written>,
}

impl State {
    /// Whether the person said that the bead is in the picture.
    #[cfg(feature = "simulate")]
    pub fn is_loaded(&self) -> bool {
        self.answers.contains_key("loaded")
    }

    /// The questions that are answered, with their answers, in the order of answering.
    pub fn given(&self) -> impl Iterator<Item = (&str, &str)> {
        self.order.iter().filter_map(|id| Some((id.as_str(), self.answered(id)?)))
    }

    /// The question that was answered last.
    pub fn newest(&self) -> Option<&str> {
        self.order.last().map(String::as_str)
    }

    /// Removes an answer, and nothing that follows from it.
    pub fn forget(&mut self, id: &str) {
        self.answers.remove(id);
        self.order.retain(|other| other != id);
    }

    /// Adds an answer, the newest.
    pub fn insert(&mut self, id: &str, answer: &str) {
        self.forget(id);
        self.answers.insert(id.into(), answer.into());
        self.order.push(id.into());
    }

    pub fn answered(&self, id: &str) -> Option<&str> {
        self.answers.get(id).map(String::as_str)
    }

    pub fn number(&self, id: &str) -> Option<f64> {
        self.answered(id)?.parse().ok()
    }

    /// What the driver of the controller states for a set-up. `None` until the controller is known.
    pub fn controller_setup(&self) -> Option<&'static Setup> {
        entry(&self.controller.as_ref()?.driver)?.setup.as_ref().ok()
    }

    pub fn can_home(&self) -> bool {
        self.controller_setup().is_some_and(|setup| setup.can_home)
    }

    /// Deviation of a measured diameter from the stated one, %.
    pub fn off_percent(&self, bead: Option<&Bead>) -> Option<f64> {
        Some(100.0 * (bead?.diameter_um / self.number("bead_um")? - 1.0))
    }

    /// Whether bead and bore contradict each other.
    pub fn contradicts(&self) -> bool {
        self.off_percent(self.bead.as_ref()).is_some_and(|off| off.abs() > MOST_SCALE_PERCENT)
    }

    /// Scales in px/um along and across. `None` until the bore is known.
    pub fn scales(&self) -> Option<[f64; 2]> {
        let k = self.empty.as_ref()?.bore_px / self.number("bore_um")?;
        let (Some("bead"), Some(bead), Some(known)) = (self.answered("ruler"), &self.bead, self.number("bead_um")) else {
            return Some([k, k]);
        };
        let extents = bead_extents(bead.diameter_um, bead.aspect).unwrap_or([bead.diameter_um; 2]);
        Some(extents.map(|extent| k * extent / known))
    }

    pub fn sense(&self) -> Option<i8> {
        Some(if self.answered("sense")? == "up" { -1 } else { 1 })
    }
}

/// Why a question is asked again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Problem {
    pub id: String,
    pub text: String,
    pub proposal: Option<String>,
}

impl Problem {
    pub fn new(id: &str, text: impl Into<String>, proposal: Option<String>) -> Self {
        Self { id: id.into(), text: text.into(), proposal }
    }
}
