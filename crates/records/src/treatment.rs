//! What a plate map says was done to a larva, as far as it decides whether the larva may be compared with untreated ones.
//!
//! ```text
//!  compound, neither a negative control nor at concentration 0 ── treated, whatever the treatment says
//!  treatment: none, untreated, living ────────────────────────── untreated
//!  negative control or concentration 0 ── no treatment stated ── untreated
//!                                      ── immersion, vehicle ─── untreated: it brings no agent
//!                                      ── heat shock, fixed ──── treated
//! ```

use crate::{Control, PlannedWell};
use carved_core::measure::references::is_untreated;

/// First words of a treatment that brings an agent to the larva and has no effect of its own.
const ROUTES: [&str; 7] = ["immersion", "immersed", "bath", "vehicle", "solvent", "medium", "mock"];
/// What fixes a larva, also by immersion.
const FIXATION: [&str; 4] = ["fix", "pfa", "formaldehyde", "formalin"];

impl PlannedWell {
    /// What was done to the larva, in the words of the plate map. The compound, if it acts on the larva and no other treatment is stated.
    pub fn treatment_of_larva(&self) -> Option<String> {
        let stated = self.treatment.clone();
        if self.is_exposed() && stated.as_deref().is_none_or(is_untreated) { self.compound.clone() } else { stated }
    }

    /// Whether nothing was done to the larva that could change it. Immersion in the vehicle alone changes nothing. `false` where the plate
    /// map does not state it.
    pub fn is_untreated(&self) -> bool {
        if self.is_exposed() {
            return false;
        }
        match self.treatment.as_deref() {
            None => self.is_vehicle(),
            Some(stated) => is_untreated(stated) || (self.is_vehicle() && is_route(stated)),
        }
    }

    fn is_exposed(&self) -> bool {
        self.compound.is_some() && !self.is_vehicle()
    }

    fn is_vehicle(&self) -> bool {
        self.control == Some(Control::Negative) || self.concentration == Some(0.0)
    }
}

/// Whether a treatment only says how an agent is brought to the larva: `immersion from 3 dpf`.
fn is_route(treatment: &str) -> bool {
    let treatment = treatment.to_lowercase();
    let first = treatment.split(|c: char| !c.is_alphanumeric()).find(|word| !word.is_empty());
    first.is_some_and(|first| ROUTES.contains(&first)) && !FIXATION.iter().any(|word| treatment.contains(word))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SpecimenKind;

    fn well(compound: Option<&str>, treatment: Option<&str>, control: Option<Control>) -> PlannedWell {
        let [compound, treatment] = [compound, treatment].map(|text| text.map(str::to_owned));
        PlannedWell { compound, treatment, control, ..PlannedWell::new("A01", SpecimenKind::Larva, Some(4.0)) }
    }

    #[test]
    fn a_larva_is_untreated_by_what_the_words_of_its_well_mean() {
        let negative = Some(Control::Negative);
        for (compound, treatment, control, expected) in [
            (None, Some("none"), None, true),
            (None, Some(" Untreated"), None, true),
            (Some("DMSO"), Some("immersion from 3 dpf"), negative, true),
            (Some("DMSO"), None, negative, true),
            (None, None, negative, true),
            (None, None, None, false),
            (None, Some("immersion from 3 dpf"), None, false),
            (Some("DMSO"), None, None, false),
            (Some("valproic acid"), Some("none"), None, false),
            (Some("valproic acid"), Some("none"), Some(Control::Positive), false),
            (Some("DMSO"), Some("heat shock"), negative, false),
            (None, Some("fixed"), negative, false),
            (None, Some("immersion in 4 % PFA"), negative, false),
        ] {
            assert_eq!(well(compound, treatment, control).is_untreated(), expected, "{compound:?}, {treatment:?}, {control:?}");
        }
        let at_zero = PlannedWell { concentration: Some(0.0), ..well(Some("valproic acid"), Some("immersion"), None) };
        assert!(at_zero.is_untreated(), "concentration 0 is the vehicle");
    }

    #[test]
    fn a_compound_is_the_treatment_where_no_other_is_stated() {
        let of = |compound, treatment| well(Some(compound), treatment, None).treatment_of_larva();
        assert_eq!(of("valproic acid", None).as_deref(), Some("valproic acid"));
        assert_eq!(of("valproic acid", Some("none")).as_deref(), Some("valproic acid"));
        assert_eq!(of("valproic acid", Some("immersion")).as_deref(), Some("immersion"));
        assert_eq!(well(Some("DMSO"), None, Some(Control::Negative)).treatment_of_larva(), None);
    }
}
