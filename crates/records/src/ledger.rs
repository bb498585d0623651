//! The ledger of a revolution: the position that the axis reported for each view, and the frame of the view.

use crate::Light;
use carved_core::units::Steps;
use serde::{Deserialize, Serialize};

/// One view. The reconstruction computes its angle from the achieved steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LedgerEntry {
    /// Number of the view around the turn, from 0.
    pub view: u32,
    /// Number of earlier takes of this view. The newest take counts.
    #[serde(default, skip_serializing_if = "is_first")]
    pub retake: u32,
    /// Target of the move, from the reference.
    pub commanded_steps: Steps,
    /// Position that the axis reported, from the reference.
    pub achieved_steps: Steps,
    /// Epoch of the axis' reference. Views of two epochs have no common zero.
    pub epoch: u32,
    /// Angle of the view from the achieved steps and the rig's sense, rad. In a sweep: from the time of the frame.
    pub omega: f64,
    /// The time of a frame that was taken while the axis turned at a constant speed. `None` for a view at a stop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swept: Option<Swept>,
    /// Time from the command to the axis' arrival, ms. In a sweep: the camera's period.
    pub moved_ms: f64,
    /// Settling time between arrival and trigger, ms.
    pub settle_ms: f64,
    /// Time from the first trigger to the accepted frame, ms.
    pub grab_ms: f64,
    /// The part of `grab_ms` until the camera acknowledged the last trigger, ms. The rest is exposure, readout and transfer.
    #[serde(default)]
    pub trigger_ms: f64,
    /// Light and focus of the frame. `None` in imported recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<Light>,
    /// Number of the frame in the camera's stream.
    pub frame_id: u64,
    /// Number of triggers for this frame.
    pub attempts: u32,
    /// SHA-256 of the frame's raw bytes, in hexadecimal.
    pub sha256: String,
    /// The frame of the second camera for the same view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<SecondEntry>,
    /// Whether this is the view at 360 degrees. It is compared with view 0, and never carved.
    pub closure: bool,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "what serde asks for")]
fn is_first(retake: &u32) -> bool {
    *retake == 0
}

/// How the angle of a view of a sweep is known: by the camera's clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Swept {
    /// The camera's clock at the frame, ns.
    pub camera_ns: u64,
    /// Standard deviation of the angle, rad. Most of it is the start of the motion, which is the same error for all views of the turn.
    pub omega_sd: f64,
}

/// A frame of the second camera. It is taken after the frame of the first camera, before the axis moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SecondEntry {
    /// Time from the first trigger to the accepted frame, ms.
    pub grab_ms: f64,
    /// Number of the frame in the camera's stream.
    pub frame_id: u64,
    /// Number of triggers for this frame.
    pub attempts: u32,
    /// Light and focus of the frame.
    pub light: Light,
    /// SHA-256 of the frame's raw bytes, in hexadecimal.
    pub sha256: String,
}

/// Entries of one revolution in the order in which they were taken. All have the same epoch, and no take of a view occurs twice.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(try_from = "Vec<LedgerEntry>", into = "Vec<LedgerEntry>")]
pub struct Ledger {
    entries: Vec<LedgerEntry>,
}

/// An entry that does not fit the ledger.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum LedgerError {
    /// The axis was referenced again within the revolution.
    #[error("view {view} belongs to epoch {found} of the axis' reference, the revolution to epoch {expected}; its angle has another zero")]
    EpochChanged { view: u32, expected: u32, found: u32 },
    /// The take is already in the ledger.
    #[error("take {retake} of view {view} stands twice in the ledger")]
    Repeated { view: u32, retake: u32 },
    /// The angle is not finite.
    #[error("view {view} has the angle {found} rad; it must be a finite number")]
    Angle { view: u32, found: String },
}

impl Ledger {
    /// Adds an entry.
    ///
    /// # Errors
    /// The view has another epoch, its take is already in the ledger, or its angle is not finite.
    pub fn push(&mut self, entry: LedgerEntry) -> Result<(), LedgerError> {
        self.check(&entry)?;
        self.entries.push(entry);
        Ok(())
    }

    /// All takes, in order of time.
    pub fn entries(&self) -> &[LedgerEntry] {
        &self.entries
    }

    /// The newest take of each view, including the closure view, in order of time.
    pub fn counted(&self) -> impl Iterator<Item = &LedgerEntry> {
        self.entries.iter().filter(|e| !self.entries.iter().any(|other| other.view == e.view && other.retake > e.retake))
    }

    /// The views that are carved: the newest takes without the closure view.
    pub fn carved(&self) -> impl Iterator<Item = &LedgerEntry> {
        self.counted().filter(|e| !e.closure)
    }

    /// The view at 360 degrees. `None` if it was not taken yet.
    pub fn closure(&self) -> Option<&LedgerEntry> {
        self.counted().find(|e| e.closure)
    }

    fn check(&self, entry: &LedgerEntry) -> Result<(), LedgerError> {
        let view = entry.view;
        if let Some(first) = self.entries.first()
            && first.epoch != entry.epoch
        {
            return Err(LedgerError::EpochChanged { view, expected: first.epoch, found: entry.epoch });
        }
        if self.entries.iter().any(|e| (e.view, e.retake) == (view, entry.retake)) {
            return Err(LedgerError::Repeated { view, retake: entry.retake });
        }
        if !entry.omega.is_finite() {
            return Err(LedgerError::Angle { view, found: entry.omega.to_string() });
        }
        Ok(())
    }
}

impl TryFrom<Vec<LedgerEntry>> for Ledger {
    type Error = LedgerError;
    fn try_from(entries: Vec<LedgerEntry>) -> Result<Self, LedgerError> {
        let mut ledger = Self::default();
        for entry in entries {
            ledger.push(entry)?;
        }
        Ok(ledger)
    }
}

impl From<Ledger> for Vec<LedgerEntry> {
    fn from(ledger: Ledger) -> Self {
        ledger.entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(view: u32, epoch: u32) -> LedgerEntry {
        LedgerEntry {
            view,
            retake: 0,
            commanded_steps: Steps(24 * i64::from(view)),
            achieved_steps: Steps(24 * i64::from(view)),
            epoch,
            omega: 0.1 + f64::from(view) / 3.0,
            swept: None,
            moved_ms: 41.25,
            settle_ms: 10.0,
            grab_ms: 33.3,
            trigger_ms: 0.4,
            light: Some(Light { background: 211.0, saturated: 1e-3, focus: 0.0123 }),
            frame_id: u64::from(view) + 1,
            attempts: 1,
            sha256: "00".repeat(32),
            second: None,
            closure: false,
        }
    }

    #[test]
    fn a_ledger_survives_its_file_to_the_last_bit() {
        let mut ledger = Ledger::default();
        for view in 0..3 {
            ledger.push(entry(view, 4)).unwrap();
        }
        let text = serde_json::to_string(&ledger).unwrap();
        assert_eq!(serde_json::from_str::<Ledger>(&text).unwrap(), ledger);
    }

    #[test]
    fn of_a_view_taken_again_both_takes_are_kept_and_the_newest_counts() {
        let mut ledger = Ledger::default();
        for view in 0..3 {
            ledger.push(entry(view, 4)).unwrap();
        }
        ledger.push(LedgerEntry { retake: 1, ..entry(1, 4) }).unwrap();
        assert_eq!(ledger.entries().len(), 4);
        let carved: Vec<_> = ledger.carved().map(|e| (e.view, e.retake)).collect();
        assert_eq!(carved, [(0, 0), (2, 0), (1, 1)]);
        assert_eq!(ledger.push(LedgerEntry { retake: 1, ..entry(1, 4) }), Err(LedgerError::Repeated { view: 1, retake: 1 }));
        assert!(!serde_json::to_string(&entry(0, 4)).unwrap().contains("retake"), "files of turns without a retake stay as they were");
    }

    #[test]
    fn views_of_two_epochs_never_share_a_ledger_not_even_in_a_file() {
        let mut ledger = Ledger::default();
        ledger.push(entry(0, 4)).unwrap();
        let refusal = LedgerError::EpochChanged { view: 1, expected: 4, found: 5 };
        assert_eq!(ledger.push(entry(1, 5)), Err(refusal));
        assert_eq!(ledger.push(entry(0, 4)), Err(LedgerError::Repeated { view: 0, retake: 0 }));
        let text = serde_json::to_string(&vec![entry(0, 4), entry(1, 5)]).unwrap();
        let said = serde_json::from_str::<Ledger>(&text).unwrap_err().to_string();
        assert!(said.contains("epoch 5") && said.contains("epoch 4"), "{said}");
    }
}
