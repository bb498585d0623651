//! The table of all flags: what each one means, which limits it belongs to, what a technician does, and what raises it.
//!
//! ```text
//! table ─┬─> the only flags that can be raised: Flag
//!        ├─> the flags of a file: StoredFlag, which also has those of other versions
//!        └─> the table in docs/quality.md, the words of the page and of the Python client, which `make contract` writes
//! ```

use serde::{Deserialize, Serialize};
use std::fmt;

/// The constant properties of a flag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlagEntry {
    /// The word in files and answers.
    pub code: &'static str,
    /// The checks that raise it: keys of the method's `quality` table. Empty for a flag that follows from other facts.
    pub limits: &'static [&'static str],
    /// What raises it.
    pub raised_by: RaisedBy,
    /// What it says about the specimen, in one sentence.
    pub meaning: &'static str,
    /// What a technician does about it, in one sentence.
    pub what_to_do: &'static str,
}

/// What a flag says about the numbers of the specimen, and so whether statistics use them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// The numbers hold. The flag is a remark, or says something about the larva.
    Holds,
    /// The true volume is larger than the number by an unknown part.
    LowerBound,
    /// The number may be wrong by more than its standard deviation says.
    Doubtful,
    /// A person has left the specimen out.
    Excluded,
}

impl Effect {
    /// The same in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Holds => "counts",
            Self::LowerBound => "left out: a bound",
            Self::Doubtful => "left out: doubtful",
            Self::Excluded => "left out: by a person",
        }
    }
}

/// The part of carved that raises a flag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RaisedBy {
    /// The measurement of a turn, in a live run and wherever stored views are measured, also by `carved reconstruct`.
    Turn,
    /// The comparison with reference larvae.
    References,
    /// The import of the pictures of another program.
    Import,
    /// The measurement of the second camera. The flag is in `fluorescence.flags`.
    SecondCamera,
    /// The daemon, for the wells of a run.
    Run,
    /// Only `carved reconstruct`.
    Reconstruct,
    /// A person, about a well of a run.
    Person,
}

impl RaisedBy {
    /// The same in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Turn => "measurement",
            Self::References => "references",
            Self::Import => "import",
            Self::SecondCamera => "second camera",
            Self::Run => "run",
            Self::Reconstruct => "`carved reconstruct`",
            Self::Person => "a person",
        }
    }
}

/// Defines the enum, the list of all flags and the entry of each, so that no flag lacks an entry.
macro_rules! flags {
    ($($name:ident = $code:literal, $raised_by:ident, [$($limit:literal),*], $meaning:literal, $what_to_do:literal;)*) => {
        /// Something that is wrong with the numbers of a specimen.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum Flag {
            $(#[doc = $meaning] #[serde(rename = $code)] $name,)*
        }

        impl Flag {
            /// All flags, in the order of the documents.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// Its row of the table.
            pub const fn entry(self) -> FlagEntry {
                match self {
                    $(Self::$name => FlagEntry {
                        code: $code,
                        limits: &[$($limit),*],
                        raised_by: RaisedBy::$raised_by,
                        meaning: $meaning,
                        what_to_do: $what_to_do,
                    },)*
                }
            }
        }
    };
}

flags! {
    BadView = "bad_view", Turn, [],
        "A view was left out of the model.",
        "Look at this view for dust, a bubble or a twitch.";
    ClippedLeft = "clipped_left", Turn, [],
        "The specimen extends beyond the left side of the picture, so the volume is a lower bound.",
        "Measure it again, further to the right.";
    ClippedRight = "clipped_right", Turn, [],
        "The specimen extends beyond the right side of the picture, so the volume is a lower bound.",
        "Measure it again, further to the left.";
    OutsideBox = "outside_box", Turn, [],
        "Part of the specimen lies outside of the box that is measured, so the volume is a lower bound.",
        "Widen the `box_um` of the method, and measure the stored views again.";
    FewViews = "few_views", Turn, ["views_least", "gap_deg"],
        "Too few views count, or no view sees an edge over a wide angle.",
        "Find out why views were left out, or take more views.";
    UnusableViews = "unusable_views", Turn, ["usable_percent"],
        "Many of the planned views do not count.",
        "Check light, focus and bubbles.";
    Moved = "moved", Turn, ["closure_overlap", "closure_along_px", "closure_across_px", "closure_turn_deg"],
        "The specimen moved during the turn.",
        "Measure it again, and check flow, bubbles and lost steps if several in a row moved.";
    ClosureUndecided = "closure_undecided", Turn, ["closure_along_px", "closure_across_px", "closure_turn_deg"],
        "The view at 360 deg cannot tell whether the specimen moved.",
        "Look at the frames, or measure it again.";
    NoClosure = "no_closure", Turn, [],
        "No view at 360 deg shows whether the specimen moved.",
        "Let the program that takes the views add one at 360 deg, or find out why it has no outline or is a copy of the view at 0 deg.";
    Residual = "residual", Turn, ["residual_px", "residual_view_px", "scatter_px"],
        "The edges of the views do not agree with each other.",
        "Check focus, vibration and dirt, and measure it again.";
    Overlap = "overlap", Turn, ["overlap_percent"],
        "A view does not fit the model.",
        "Look at the frame of this view.";
    Uncertain = "uncertain", Turn, ["volume_sd_percent"],
        "The standard deviation of the volume is unusually large, or the outlines do not determine the volume.",
        "Look at the frames, or measure it again with more views.";
    Nonconvex = "nonconvex", Turn, [],
        "The body is bent or hollow in places, so a less exact method was used: the voxels were counted.",
        "Look at the frames for a strongly bent larva, debris or a second specimen.";
    FinsUnseen = "fins_unseen", Turn, [],
        "The views do not show all fins, so the volume may be up to 5 % too small.",
        "Check light and focus.";
    DeadLooking = "dead_looking", Turn, [],
        "The larva is opaque in most views, and much darker than the larvae that the rig measured before it.",
        "Look at it, and leave it out of the results if it is dead.";
    Uncalibrated = "uncalibrated", Turn, [],
        "The turn has no calibration of its own and was measured with the camera of the rig.",
        "Look at the frames and at the reason in `uncalibrated`, or turn the calibration of the method on.";
    CalibrationGate = "calibration_gate", Turn, [],
        "Another axis than the calibrated one leaves a larger hull, so the views do not quite agree on one turn.",
        "Look at the frames for a twitch or dirt, or measure it again.";
    CalibrationOff = "calibration_off", Turn, ["uy_px", "gamma_deg", "alpha_deg"],
        "The axis of the turn is not where the configuration says.",
        "Mount the capillary again, or write the new axis into `[optics]`.";
    WrongSteps = "wrong_steps", Turn, ["rho_percent"],
        "The capillary turned by another angle than the steps say.",
        "Check the steps per revolution and the coupling.";
    WrongSense = "wrong_sense", Turn, ["turn_findings"],
        "The views fit a turn in the other sense, so the model is a mirror image and there is no volume.",
        "Check the order of the pictures and the sense of the rig with a marked capillary, correct `sense`, and measure again.";
    RotationSuspect = "rotation_suspect", Turn, ["turn_findings"],
        "The specimen did not turn while the motor did, so there is no volume.",
        "Check the supply of the motor, the coupling and the belt, and measure it again.";
    RepeatedViews = "repeated_views", Turn, ["turn_findings"],
        "Two views of different angles are the same picture, so there is no volume.",
        "Give each view its own picture, and measure it again.";
    MirroredViews = "mirrored_views", Turn, ["turn_findings"],
        "Some views have left and right exchanged, so there is no volume.",
        "Switch the reversing of the camera and of its program off, and take the views again.";
    SpecimenEndsDiffer = "specimen_ends_differ", Turn, ["turn_findings"],
        "The ends of the specimen are not at the same places in all views, so there is no volume.",
        "Look at the frames for another specimen, mirrored views or a slide, and take the turn again.";
    ViewsDisagree = "views_disagree", Turn, ["turn_findings"],
        "Views fit the others at another angle, upside down or not at all, so there is no volume.",
        "Check the order and the number of the pictures and the steps per revolution.";
    AxisOffBore = "axis_off_bore", Turn, ["turn_findings"],
        "The axis of the turn is not in the middle of the bore, so there is no volume.",
        "Check the coupling and how the glass is held, and take the turn again.";
    ScaleOffBore = "scale_off_bore", Turn, [],
        "By the scale of the camera, the bore of the capillary is much wider or narrower than stated, or than 600 um where none is stated.",
        "Check the scale for these pictures (binning, lens), state the bore of the glass, and measure the pictures again.";
    NotOneSpecimen = "not_one_specimen", Turn, [],
        "More than half of the views show nothing, a bubble, debris or several specimens.",
        "Look at the frames.";
    VolumeOffReferences = "volume_off_references", References, ["reference_z"],
        "The volume is far from that of reference larvae of this age.",
        "Look at the frames, and check the age in the plate map.";
    AreaOffReferences = "area_off_references", References, ["reference_z"],
        "The area is far from that of reference larvae of this age.",
        "Look at the frames, and check the age in the plate map.";
    MissingViews = "missing_views", Import, [],
        "Pictures of some views are missing, so the numbers come from the others.",
        "Find the missing pictures, and import the turn again.";
    BeadGate = "bead_gate", Run, [],
        "The daily bead check did not pass, or is too old.",
        "Measure three to five beads.";
    Saturated = "saturated", SecondCamera, [],
        "The second camera is saturated, so its signal is a lower bound.",
        "Lower its exposure or gain.";
    Empty = "empty", Reconstruct, [],
        "All views are blank, so the volume is 0.",
        "Check the masks if the capillary was not empty.";
    Excluded = "excluded", Person, [],
        "A person has left the specimen out of statistics, for the reason in its comment.",
        "Read the comment; the exclusion can be taken back.";
}

impl Flag {
    /// What it says about the numbers. Of [`Flag::Saturated`] this is the signal of the second camera, of all others volume, area and shape.
    ///
    /// A flag that may be a property of the larva, such as [`Flag::DeadLooking`], lets the numbers count: without these larvae, the
    /// statistics of a treatment would be those of the larvae that it does not affect.
    pub const fn effect(self) -> Effect {
        match self {
            Self::ClippedLeft | Self::ClippedRight | Self::OutsideBox | Self::Saturated => Effect::LowerBound,
            Self::FewViews
            | Self::UnusableViews
            | Self::Moved
            | Self::Residual
            | Self::Overlap
            | Self::Uncertain
            | Self::CalibrationGate
            | Self::WrongSteps
            | Self::WrongSense
            | Self::RotationSuspect
            | Self::RepeatedViews
            | Self::MirroredViews
            | Self::SpecimenEndsDiffer
            | Self::ViewsDisagree
            | Self::AxisOffBore
            | Self::ScaleOffBore
            | Self::NotOneSpecimen
            | Self::Empty => Effect::Doubtful,
            Self::Excluded => Effect::Excluded,
            Self::BadView
            | Self::ClosureUndecided
            | Self::NoClosure
            | Self::Nonconvex
            | Self::FinsUnseen
            | Self::DeadLooking
            | Self::Uncalibrated
            | Self::CalibrationOff
            | Self::VolumeOffReferences
            | Self::AreaOffReferences
            | Self::MissingViews
            | Self::BeadGate => Effect::Holds,
        }
    }

    /// The word in files and answers.
    pub const fn code(self) -> &'static str {
        self.entry().code
    }
}

impl fmt::Display for Flag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.code())
    }
}

/// The rows of the table for `docs/quality.md`.
pub fn page() -> String {
    let row = |flag: Flag| {
        let (entry, effect) = (flag.entry(), flag.effect().words());
        let limits = entry.limits.iter().map(|limit| format!("`{limit}`")).collect::<Vec<_>>().join(", ");
        let (code, raised_by) = (entry.code, entry.raised_by.words());
        format!("| `{code}` | {} | {limits} | {} | {raised_by} | {effect} |\n", entry.meaning, entry.what_to_do)
    };
    let rows: String = Flag::ALL.iter().map(|flag| row(*flag)).collect();
    format!("| flag | meaning | limits | what a technician does | raised by | in statistics |\n|---|---|---|---|---|---|\n{rows}")
}

/// A flag as a file has it. Files of other versions may have flags that this version does not raise.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(with = "String", inline))]
#[serde(untagged)]
pub enum StoredFlag {
    /// A flag of this version.
    Known(Flag),
    /// The word of a flag of another version.
    Unknown(String),
}

impl StoredFlag {
    /// The word.
    pub fn as_str(&self) -> &str {
        match self {
            Self::Known(flag) => flag.code(),
            Self::Unknown(word) => word,
        }
    }

    /// What it says about the numbers. Those with a flag that this version does not know count, and are marked as flagged.
    pub fn effect(&self) -> Effect {
        match self {
            Self::Known(flag) => flag.effect(),
            Self::Unknown(_) => Effect::Holds,
        }
    }

    /// Whether these flags of a specimen say that a part of it was not measured, so that its volume, area and length are lower bounds.
    pub fn is_bound(flags: &[Self]) -> bool {
        flags.iter().any(|flag| flag.effect() == Effect::LowerBound)
    }

    /// The flags separated by `separator`.
    pub fn joined(flags: &[Self], separator: &str) -> String {
        flags.iter().map(Self::as_str).collect::<Vec<_>>().join(separator)
    }
}

impl From<Flag> for StoredFlag {
    fn from(flag: Flag) -> Self {
        Self::Known(flag)
    }
}

impl PartialEq<Flag> for StoredFlag {
    fn eq(&self, flag: &Flag) -> bool {
        matches!(self, Self::Known(known) if known == flag)
    }
}

impl fmt::Display for StoredFlag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_flag_is_one_word_with_one_sentence_each_of_meaning_and_remedy() {
        let mut seen = BTreeSet::new();
        for flag in Flag::ALL {
            let FlagEntry { code, meaning, what_to_do, .. } = flag.entry();
            assert!(seen.insert(code), "{code} twice");
            assert!(code.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{code}");
            for text in [meaning, what_to_do] {
                let whole = text.strip_suffix('.').unwrap_or_default();
                assert!(whole.starts_with(|c: char| c.is_ascii_uppercase()), "{code}: {text}");
                assert!(!whole.contains(". ") && !text.contains(['|', '"', '\\']), "{code}: {text}");
            }
        }
    }

    #[test]
    fn a_file_keeps_the_flags_of_other_versions() {
        let text = r#"["moved","blur_mismatch"]"#;
        let flags: Vec<StoredFlag> = serde_json::from_str(text).unwrap();
        assert_eq!(flags, [Flag::Moved.into(), StoredFlag::Unknown("blur_mismatch".into())]);
        assert_eq!(serde_json::to_string(&flags).unwrap(), text);
        assert!(serde_json::from_str::<Vec<StoredFlag>>("[7]").is_err());
        for flag in Flag::ALL {
            assert_eq!(serde_json::to_value(flag).unwrap(), flag.code());
            assert_eq!(serde_json::from_value::<StoredFlag>(flag.code().into()).unwrap(), *flag);
        }
    }
}
