//! Lists of frames with ground truth, to evaluate segmentation and detection.
//!
//! ```text
//!   frames.rs     72 recipes, easy to vicious  --+
//!                                                +--> recipe + seed = FrameSpec (settings, placements, labels) --> render
//!   detection.rs  6 and more of each class     --+        frame, coverage, outline
//!   vast.rs       48 and 500 as a VAST takes them -+
//! ```
//! A recipe describes the difficulty. The seed draws individuals, pigment, marks, noise, and small turns and shifts. Methods are tuned on
//! seed 1 and evaluated on other seeds, which give other frames of the same recipes. Seed 7 was also looked at during the tuning.
//! Labels (`touches_wall`, `clipped`, `fill`) are measured on the drawn geometry and not copied from the recipe.

mod detection;
mod frames;
mod item;
mod labels;
mod recipe;
mod vast;

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

/// How near the frames of a list are to real VAST frames. The recipes, the seeds of the individuals and the
/// placements are the same in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Realism {
    /// A clean capillary.
    Clean,
    /// The clean frames with as much dust as real frames have.
    Dust,
    /// In addition light, blur, noise, walls and larvae as on real frames, and colours interpolated from a mosaic.
    Real,
}

/// The correct answer of a detector. Clutter beside a larva does not change the class.
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

/// One frame of a list, with all parameters of its image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameSpec {
    pub name: String,
    pub difficulty: Difficulty,
    pub class: Class,
    /// The specimens of the ground truth.
    pub specimens: Vec<Item>,
    /// Objects that are not in the ground truth.
    pub clutter: Vec<Item>,
    pub settings: SceneSettings,
    pub angle_rad: f64,
    /// Number of the exposure.
    pub number: u64,
    /// Seed of this frame, from the seed of the list and the position in the list.
    pub seed: u64,
    /// The frame is to be used as a monochrome frame.
    pub mono: bool,
    /// The colours of the frame are interpolated from its mosaic.
    pub demosaicked: bool,
    #[serde(flatten)]
    pub labels: Labels,
}

/// A frame with its ground truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    pub frame: Rgb,
    pub truth: Coverage,
    pub edge: Vec<Outline>,
    /// The outlines without fins.
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
    /// The contents of the capillary.
    ///
    /// # Errors
    /// A specimen cannot be made with these parameters.
    pub fn contents(&self) -> Result<Contents, FrameSetError> {
        let make = |items: &[Item]| items.iter().map(|item| item.specimen(&self.name)).collect::<Result<Vec<_>, _>>();
        Ok(Contents { specimens: make(&self.specimens)?, clutter: make(&self.clutter)? })
    }

    /// The scene of the frame.
    ///
    /// # Errors
    /// As [`FrameSpec::contents`], or a specimen is outside the bore.
    pub fn scene(&self) -> Result<Scene, FrameSetError> {
        let scene = Scene::new(self.settings.clone());
        scene.load(self.contents()?).map_err(|source| FrameSetError::Placement { name: self.name.clone(), source })?;
        Ok(scene)
    }

    /// Renders the frame without its ground truth, whose outlines take a quarter of the time.
    ///
    /// # Errors
    /// As [`FrameSpec::scene`].
    pub fn frame(&self) -> Result<Rgb, FrameSetError> {
        Ok(self.seen_in(&self.scene()?))
    }

    fn seen_in(&self, scene: &Scene) -> Rgb {
        let frame = scene.render(&Exposure { angle_rad: self.angle_rad, number: self.number });
        if self.demosaicked { frame.demosaicked() } else { frame }
    }

    /// Renders the frame and its ground truth.
    ///
    /// # Errors
    /// As [`FrameSpec::scene`].
    pub fn render(&self) -> Result<Rendered, FrameSetError> {
        let scene = self.scene()?;
        Ok(Rendered {
            frame: self.seen_in(&scene),
            truth: scene.truth_mask(self.angle_rad),
            edge: scene.truth_edge(self.angle_rad),
            body_edge: scene.body_edge(self.angle_rad),
        })
    }
}

/// The 72 frames for the evaluation of segmentation, 18 of each difficulty.
///
/// # Errors
/// A frame cannot be made: its recipe does not fit the individual of this seed.
pub fn frame_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    frame_set_of(seed, Realism::Clean)
}

/// The 72 frames of [`frame_set`] with the dirt of real frames.
///
/// # Errors
/// As [`frame_set`].
pub fn frame_set_of(seed: u64, realism: Realism) -> Result<Vec<FrameSpec>, FrameSetError> {
    specs(frames::recipes(), seed, realism)
}

/// Labelled examples of all classes that a detector must distinguish.
///
/// # Errors
/// As [`frame_set`].
pub fn detection_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    detection_set_of(seed, Realism::Clean)
}

/// The labelled examples of [`detection_set`] with the dirt of real frames.
///
/// # Errors
/// As [`frame_set`].
pub fn detection_set_of(seed: u64, realism: Realism) -> Result<Vec<FrameSpec>, FrameSetError> {
    // These individuals are not those of the frames for segmentation.
    specs(detection::recipes(), seed ^ 0xDE7E_C700, realism)
}

/// 48 larvae as a VAST BioImager takes them: frames of 1024 x 200 px with a bore of 112 px, at [`Realism::Real`]. They are 2 to 7 dpf
/// old, fill 85 to 97 % of the bore, and a quarter is sick. A quarter is seen from above or below. The names state age and view.
///
/// # Errors
/// As [`frame_set`].
pub fn vast_frame_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    specs(vast::frames(seed), seed ^ 0x7A57_0000, Realism::Real)
}

/// 500 labelled frames as a VAST takes them, of all classes, at [`Realism::Real`]. 50 of the 170 larvae leave the image.
///
/// # Errors
/// As [`frame_set`].
pub fn vast_detection_set(seed: u64) -> Result<Vec<FrameSpec>, FrameSetError> {
    specs(vast::detection(seed), seed ^ 0x7A57_DE7E, Realism::Real)
}

fn specs(recipes: Vec<Recipe>, seed: u64, realism: Realism) -> Result<Vec<FrameSpec>, FrameSetError> {
    recipes.into_par_iter().enumerate().map(|(index, recipe)| recipe.spec(seed, index as u64, realism)).collect()
}

#[cfg(test)]
mod tests;
