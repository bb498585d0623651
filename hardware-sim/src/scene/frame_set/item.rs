//! Objects that a frame can contain, in serializable form.

use super::FrameSetError;
use crate::scene::{Larva, Look, Placement, Specimen};
use serde::Serialize;

/// The kind of an object, with its sizes in um.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "is")]
pub enum Kind {
    Larva { dpf: u8, fins: bool },
    DeadLarva { dpf: u8 },
    Bead { diameter_um: f64 },
    Bubble { diameter_um: f64 },
    Plug { length_um: f64, diameter_um: f64 },
    Chip { size_um: f64 },
    Fibre { length_um: f64 },
}

/// One object with its placement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Item {
    #[serde(flatten)]
    pub kind: Kind,
    /// Seed of the individual.
    pub seed: u64,
    pub placement: Placement,
    /// Appearance of a living larva. It does not apply to other objects.
    pub look: Look,
}

impl Item {
    /// Makes the object. `frame` is the name of the frame, for errors.
    pub(super) fn specimen(&self, frame: &str) -> Result<Specimen, FrameSetError> {
        let larva = |source| FrameSetError::Larva { name: frame.to_owned(), source };
        let size = |source| FrameSetError::Size { name: frame.to_owned(), source };
        let specimen = match self.kind {
            Kind::Larva { dpf, fins } => Larva::new(dpf, self.seed)
                .map(|larva| larva.with_look(self.look))
                .map(|larva| if fins { larva.specimen() } else { larva.without_fins().specimen() })
                .map_err(larva),
            Kind::DeadLarva { dpf } => Specimen::dead_larva(dpf, self.seed).map_err(larva),
            Kind::Bead { diameter_um } => Specimen::bead(diameter_um).map_err(size),
            Kind::Bubble { diameter_um } => Specimen::bubble(diameter_um).map_err(size),
            Kind::Plug { length_um, diameter_um } => Specimen::plug(length_um, diameter_um).map_err(size),
            Kind::Chip { size_um } => Specimen::chip(size_um, self.seed).map_err(size),
            Kind::Fibre { length_um } => Specimen::fibre(length_um, self.seed).map_err(size),
        }?;
        Ok(specimen.placed(self.placement))
    }
}
