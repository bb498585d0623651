//! Everything that lies in the capillary at one time.
//!
//! ```text
//!   ____________________________________
//!     specimens: drawn and measured        o   <- clutter: drawn like them, in no truth
//!   ____________________________________
//! ```

use super::phantom::{PlacementError, Specimen};

/// What is loaded. Each has its own placement; nothing keeps two of them from touching or from lying in one another.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// What a profile should hold: the truth is theirs.
    pub specimens: Vec<Specimen>,
    /// What is seen beside them: bubbles, debris. No truth holds any of it, not even where it touches a specimen.
    pub clutter: Vec<Specimen>,
}

impl Contents {
    /// Adds something that is drawn and not measured.
    #[must_use]
    pub fn beside(mut self, clutter: Specimen) -> Self {
        self.clutter.push(clutter);
        self
    }

    /// All placements carried out.
    pub(super) fn settled(self, bore_radius_um: f64) -> Result<Self, PlacementError> {
        let settle = |all: Vec<Specimen>| all.into_iter().map(|s| s.settled(bore_radius_um)).collect::<Result<Vec<_>, _>>();
        Ok(Self { specimens: settle(self.specimens)?, clutter: settle(self.clutter)? })
    }

    /// Everything carried along x.
    pub(super) fn shifted(mut self, by_um: f64) -> Self {
        for specimen in self.specimens.iter_mut().chain(&mut self.clutter) {
            specimen.move_all(|[x, y, z]| [x + by_um, y, z]);
        }
        self
    }

    /// Everything that is drawn.
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
