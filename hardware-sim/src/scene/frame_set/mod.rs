//! Two fixed lists of frames with truth, to judge segmentation and detection by.
//!
//! ```text
//!   frames.rs     72 recipes, easy to vicious  --+
//!                                                +--> recipe + seed = FrameSpec (settings, placements, labels) --> render
//!   detection.rs  6 and more of each class     --+        frame, coverage, outline
//! ```
//! A recipe says what is difficult; the seed draws individuals, pigment, marks, noise, and small turns and shifts. Seed 1 is
//! THE set: methods are tuned on it (7 was looked at meanwhile) and judged on other seeds, which give other frames of the same recipes. Labels
//! (`touches_wall`, `clipped`, `fill`) are measured on the geometry that is drawn, not copied from the recipe.

mod detection;
mod frames;
mod item;
mod labels;
mod recipe;

pub use item::{Item, Kind};
pub use labels::{Labels, Side};

use super::{Contents, Coverage, Exposure, Outline, PlacementError, Rgb, Scene, SceneSettings};
use crate::scene::phantom::{LarvaError, SizeError};
use rayon::prelude::*;
use recipe::Recipe;
use serde::Serialize;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Difficulty {
    Easy,
    Medium,
    Hard,
    Vicious,
}

/// What a detector should say. Clutter beside a larva does not change its class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    Empty,
    Bead,
    Larva,
    DeadLarva,
    TwoLarvae,
    Bubble,
    Debris,
}

/// One frame of a list: all that it takes to render it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameSpec {
    pub name: String,
    pub difficulty: Difficulty,
    pub class: Class,
    /// What the truth is of.
    pub specimens: Vec<Item>,
    /// What is seen beside it.
    pub clutter: Vec<Item>,
    pub settings: SceneSettings,
    pub angle_rad: f64,
    /// Number of the exposure.
    pub number: u64,
    /// Of this frame: from the list's seed and the place in the list.
    pub seed: u64,
    /// To be used without colour.
    pub mono: bool,
    #[serde(flatten)]
    pub labels: Labels,
}

/// A frame with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    pub frame: Rgb,
    pub truth: Coverage,
    pub edge: Vec<Outline>,
    /// Without fins.
    pub body_edge: Vec<Outline>,
}

#[derive(Debug, thiserror::Error)]
pub enum FrameSetError {
    #[error("frame {name}: {source}")]
    Larva { name: String, source: LarvaError },
    #[error("frame {name}: {source}")]
    Size { name: String, source: SizeError },
    #[error("frame {name}: {source}")]
    Placement { name: String, source: PlacementError },
}

impl FrameSpec {
    /// What it puts into the capillary.
    ///
    /// # Errors
    /// Names what cannot be made.
    pub fn contents(&self) -> Result<Contents, FrameSetError> {
        let make = |items: &[Item]| items.iter().map(|item| item.specimen(&self.name)).collect::<Result<Vec<_>, _>>();
        Ok(Contents { specimens: make(&self.specimens)?, clutter: make(&self.clutter)? })
    }

    /// The scene that it is taken of.
    ///
    /// # Errors
    /// As [`FrameSpec::contents`], and where something leaves the bore.
    pub fn scene(&self) -> Result<Scene, FrameSetError> {
        let scene = Scene::new(self.settings.clone());
        scene.load(self.contents()?).map_err(|source| FrameSetError::Placement { name: self.name.clone(), source })?;
        Ok(scene)
    }

    /// # Errors
    /// As [`FrameSpec::scene`].
    pub fn render(&self) -> Result<Rendered, FrameSetError> {
        let scene = self.scene()?;
        Ok(Rendered {
            frame: scene.render(&Exposure { angle_rad: self.angle_rad, number: self.number }),
            truth: scene.truth_mask(self.angle_rad),
            edge: scene.truth_edge(self.angle_rad),
            body_edge: scene.body_edge(self.angle_rad),
        })
    }
}

/// The 72 frames that segmentation is judged by, 18 of each difficulty.
///
/// # Errors
/// Names the frame that cannot be made: a recipe does not fit the individual that the seed drew.
pub fn frame_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    specs(frames::recipes(), seed)
}

/// Labelled examples of all that a detector must tell apart.
///
/// # Errors
/// As [`frame_set`].
pub fn detection_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    // Other individuals than those of the frames to segment.
    specs(detection::recipes(), seed ^ 0xDE7E_C700)
}

fn specs(recipes: Vec<Recipe>, seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    recipes.into_par_iter().enumerate().map(|(index, recipe)| recipe.spec(seed, index as u64)).collect()
}

#[cfg(test)]
mod tests;
