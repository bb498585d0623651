//! The rig's empty capillary: a picture that frames are compared with.

use super::walls::WallFinder;
use crate::profile::raster::damage::Inspector;
use crate::profile::settings::WallSettings;
use crate::profile::{Picture, ProfileError, Walls};

/// A picture of the empty capillary with its walls, which place it over each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct EmptyCapillary {
    picture: Picture,
    walls: Walls,
}

impl EmptyCapillary {
    /// Finds the walls of a picture of the empty capillary.
    ///
    /// # Errors
    /// A picture without two walls, or a damaged one.
    pub fn new(picture: Picture, settings: &WallSettings) -> Result<Self, ProfileError> {
        let walls = WallFinder::default().find(&picture, settings)?;
        if let Some(part) = Inspector::default().find(&picture, &walls.rows(picture.width(), picture.height())) {
            return Err(part.error());
        }
        Ok(Self { picture, walls })
    }

    /// The walls of the picture.
    pub fn walls(&self) -> Walls {
        self.walls
    }

    pub(in crate::profile) fn size(&self) -> (usize, usize) {
        (self.picture.width(), self.picture.height())
    }

    pub(in crate::profile) fn plane(&self, channel: usize) -> &[u8] {
        &self.picture.planes()[channel]
    }
}
