//! The contents of the capillary.
//!
//! ```text
//!   ____________________________________
//!     specimens: drawn and measured        o   <- clutter: drawn, but not in the ground truth
//!   ____________________________________
//! ```

use super::phantom::{PlacementError, Specimen};

/// Specimens and clutter, each with its own placement. They may touch or overlap each other.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// The specimens. The ground truth describes them.
    pub specimens: Vec<Specimen>,
    /// Bubbles and debris. The ground truth does not contain them, also where they touch a specimen.
    pub clutter: Vec<Specimen>,
}

impl Contents {
    /// Adds clutter.
    #[must_use]
    pub fn beside(mut self, clutter: Specimen) -> Self {
        self.clutter.push(clutter);
        self
    }

    /// The contents in the frame of the capillary, with all placements applied.
    pub(super) fn settled(self, bore_radius_um: f64) -> Result<Self, PlacementError> {
        let settle = |all: Vec<Specimen>| all.into_iter().map(|s| s.settled(bore_radius_um)).collect::<Result<Vec<_>, _>>();
        Ok(Self { specimens: settle(self.specimens)?, clutter: settle(self.clutter)? })
    }

    /// The contents, shifted along x.
    pub(super) fn shifted(mut self, by_um: f64) -> Self {
        for specimen in self.specimens.iter_mut().chain(&mut self.clutter) {
            specimen.move_all(|[x, y, z]| [x + by_um, y, z]);
        }
        self
    }

    /// All specimens and clutter.
    pub(super) fn all(&self) -> impl Iterator<Item = &Specimen> {
        self.specimens.iter().chain(&self.clutter)
    }
}

impl From<Specimen> for Contents {
    fn from(specimen: Specimen) -> Self {
        Self { specimens: vec![specimen], clutter: Vec::new() }
    }
}

impl From<Option<Specimen>> for Contents {
    fn from(specimen: Option<Specimen>) -> Self {
        specimen.map(Self::from).unwrap_or_default()
    }
}
