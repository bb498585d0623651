//! Closed sets of words, by the same names as in the records.

use carved_records as records;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Makes each enum with its conversion. A word that the records add does not compile here.
macro_rules! words {
    ($($(#[doc = $doc:literal])* $(#[serde($($as:tt)*)])* $name:ident { $($(#[$of:meta])* $word:ident,)* })*) => {$(
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
        $(#[serde($($as)*)])*
        pub enum $name {
            $($(#[$of])* $word,)*
        }

        impl From<records::$name> for $name {
            fn from(word: records::$name) -> Self {
                match word {
                    $(records::$name::$word => Self::$word,)*
                }
            }
        }
    )*};
}

/// The way back, of words that a request may have.
macro_rules! words_of_requests {
    ($($name:ident { $($word:ident,)* })*) => {$(
        impl From<$name> for records::$name {
            fn from(word: $name) -> Self {
                match word {
                    $($name::$word => Self::$word,)*
                }
            }
        }
    )*};
}

words! {
    /// Whether numbers come from an instrument, from the emulated rig or from imported pictures, of whose origin carved knows
    /// nothing; stamped into every output. A daemon's is one of the first two.
    #[serde(rename_all = "snake_case")]
    Mode {
        Hardware,
        Simulated,
        Imported,
    }

    /// Phase within one specimen.
    #[serde(rename_all = "snake_case")]
    Phase {
        Load,
        Detect,
        Position,
        Revolve,
        Reconstruct,
        Measure,
        Eject,
        Wash,
    }

    /// How a run ended. `null` until it has.
    #[serde(rename_all = "snake_case")]
    RunOutcome {
        Succeeded,
        Partial,
        Failed,
        Aborted,
        Interrupted,
    }

    /// How a specimen ended. `null` until it has.
    #[serde(rename_all = "snake_case")]
    SpecimenOutcome {
        Succeeded,
        Failed,
        Aborted,
        Interrupted,
        Skipped,
    }

    /// What the scheduler does about a fault.
    #[serde(rename_all = "snake_case")]
    SchedulerAction {
        Retry,
        SkipWell,
        RejectPlate,
        AbortPlate,
        PauseInstrument,
        EscalateOperator,
    }

    /// What a fault concerns.
    #[serde(rename_all = "snake_case")]
    Category {
        Camera,
        Views,
        Optics,
        Motion,
        Sampler,
        Storage,
        Software,
        Safety,
    }

    /// What the plate map says is in a well.
    #[serde(rename_all = "snake_case")]
    SpecimenKind {
        Larva,
        Bead,
    }

    /// Whether a well is one that others are held against.
    #[serde(rename_all = "snake_case")]
    Control {
        Positive,
        Negative,
    }

    #[serde(rename_all = "snake_case")]
    HandoffIntent {
        /// The plate is to be put in.
        Load,
        /// The plate is to be taken away.
        Unload,
    }

    /// A unit keeps what the lab wrote: `ug/mL` and `mg/L` are the same amount, and are not made one.
    ConcentrationUnit {
        #[serde(rename = "M")]
        Molar,
        #[serde(rename = "mM")]
        Millimolar,
        #[serde(rename = "uM")]
        Micromolar,
        #[serde(rename = "nM")]
        Nanomolar,
        #[serde(rename = "pM")]
        Picomolar,
        #[serde(rename = "g/L")]
        GramPerLitre,
        #[serde(rename = "mg/L")]
        MilligramPerLitre,
        #[serde(rename = "ug/L")]
        MicrogramPerLitre,
        #[serde(rename = "ng/L")]
        NanogramPerLitre,
        #[serde(rename = "mg/mL")]
        MilligramPerMillilitre,
        #[serde(rename = "ug/mL")]
        MicrogramPerMillilitre,
        #[serde(rename = "ng/mL")]
        NanogramPerMillilitre,
        #[serde(rename = "%")]
        Percent,
        #[serde(rename = "% v/v")]
        PercentByVolume,
        #[serde(rename = "% w/v")]
        PercentWeightByVolume,
        #[serde(rename = "ppm")]
        PartsPerMillion,
    }
}

words_of_requests! {
    SpecimenKind { Larva, Bead, }
    Control { Positive, Negative, }
    HandoffIntent { Load, Unload, }
    ConcentrationUnit { Molar, Millimolar, Micromolar, Nanomolar, Picomolar, GramPerLitre, MilligramPerLitre, MicrogramPerLitre, NanogramPerLitre, MilligramPerMillilitre, MicrogramPerMillilitre, NanogramPerMillilitre, Percent, PercentByVolume, PercentWeightByVolume, PartsPerMillion, }
}
