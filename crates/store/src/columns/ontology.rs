//! Terms of ontologies for the words of a plate map, so that tables of different laboratories can be joined.
//!
//! Stages are those of the Zebrafish Developmental Stages Ontology, which begin at the hours post fertilisation of Kimmel et al. 1995. The
//! conditions are those of the Zebrafish Experimental Conditions Ontology.

use carved_records::{Control, PlannedWell, SpecimenKind};

/// A term: its identifier and its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Term {
    pub id: &'static str,
    pub name: &'static str,
}

/// The species of every larva.
pub const ZEBRAFISH: Term = Term { id: "NCBITaxon:7955", name: "Danio rerio" };
const CHEMICAL_TREATMENT: Term = Term { id: "ZECO:0000111", name: "chemical treatment" };

/// Stages by the hour at which they begin. Before the first and from the last on there is no stage that a VAST turns.
const STAGES: [(f64, Option<Term>); 10] = [
    (48.0, Some(Term { id: "ZFS:0000033", name: "Hatching:Long-pec" })),
    (60.0, Some(Term { id: "ZFS:0000034", name: "Hatching:Pec-fin" })),
    (72.0, Some(Term { id: "ZFS:0000035", name: "Larval:Protruding-mouth" })),
    (96.0, Some(Term { id: "ZFS:0000036", name: "Larval:Day 4" })),
    (120.0, Some(Term { id: "ZFS:0000037", name: "Larval:Day 5" })),
    (144.0, Some(Term { id: "ZFS:0000038", name: "Larval:Day 6" })),
    (168.0, Some(Term { id: "ZFS:0000039", name: "Larval:Days 7-13" })),
    (336.0, Some(Term { id: "ZFS:0000040", name: "Larval:Days 14-20" })),
    (504.0, Some(Term { id: "ZFS:0000041", name: "Larval:Days 21-29" })),
    (720.0, None),
];

/// The species of a specimen. `None` for a bead.
pub fn taxon(well: &PlannedWell) -> Option<Term> {
    (well.specimen == SpecimenKind::Larva).then_some(ZEBRAFISH)
}

/// The stage of a larva of known age, from 2 to less than 30 days.
pub fn stage(well: &PlannedWell) -> Option<Term> {
    let hours = 24.0 * well.age_of_larva()?;
    STAGES.iter().rev().find(|(begins, _)| *begins <= hours)?.1
}

/// The experimental condition. `None` where the plate map names no compound, because it may not say everything, and for a negative control:
/// its compound is the vehicle, such as DMSO.
pub fn exposure(well: &PlannedWell) -> Option<Term> {
    let is_treated = well.compound.is_some() && well.control != Some(Control::Negative);
    (well.specimen == SpecimenKind::Larva && is_treated).then_some(CHEMICAL_TREATMENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_begins_at_its_hour() {
        let of = |dpf: f64| stage(&PlannedWell::new("A01", SpecimenKind::Larva, Some(dpf))).map(|term| term.id);
        for (dpf, expected) in
            [(3.0, "ZFS:0000035"), (3.99, "ZFS:0000035"), (4.0, "ZFS:0000036"), (5.5, "ZFS:0000037"), (29.9, "ZFS:0000041")]
        {
            assert_eq!(of(dpf), Some(expected), "{dpf} dpf");
        }
        assert_eq!((of(1.9), of(30.0)), (None, None));
    }

    #[test]
    fn a_vehicle_control_is_not_treated() {
        let of = |control| {
            let well = PlannedWell { compound: Some("DMSO".into()), control, ..PlannedWell::new("A01", SpecimenKind::Larva, Some(4.0)) };
            exposure(&well).map(|term| term.id)
        };
        assert_eq!(
            (of(None), of(Some(Control::Positive)), of(Some(Control::Negative))),
            (Some("ZECO:0000111"), Some("ZECO:0000111"), None)
        );
    }

    #[test]
    fn a_bead_has_no_species_and_no_stage() {
        let bead = PlannedWell { compound: Some("DMSO".into()), ..PlannedWell::new("A01", SpecimenKind::Bead, Some(4.0)) };
        assert_eq!((taxon(&bead), stage(&bead), exposure(&bead)), (None, None, None));
    }
}
