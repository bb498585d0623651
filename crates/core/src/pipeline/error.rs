//! Why a specimen cannot be measured.

use crate::geometry::GridError;
use crate::profile::ProfileError;
use crate::reconstruction::ReconstructionError;

/// Why a specimen cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The box or the voxel size.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The reconstruction.
    #[error(transparent)]
    Reconstruction(#[from] ReconstructionError),
    /// A frame is not of the camera's size.
    #[error("the frame is {found_width} x {found_height} px, the rig's camera {width} x {height} px")]
    FrameSize {
        /// Width of the camera's sensor, px.
        width: u32,
        /// Height of the sensor, px.
        height: u32,
        /// Width of the frame, px.
        found_width: u32,
        /// Height of the frame, px.
        found_height: u32,
    },
    /// The picture of the empty capillary cannot be used.
    #[error("the picture of the empty capillary cannot be used: {0}")]
    EmptyCapillary(ProfileError),
    /// Too few views have a profile.
    #[error("{used} of {planned} views gave a profile; {needed} are needed. First reason: {reason}")]
    TooFewViews {
        /// Views with a profile.
        used: usize,
        /// Views planned.
        planned: u32,
        /// Views needed.
        needed: usize,
        /// Why the first of the others has none.
        reason: String,
    },
}

impl PipelineError {
    /// Whether camera, method or grid refuse every specimen, so that this specimen is not the cause.
    pub fn is_of_setup(&self) -> bool {
        match self {
            Self::Grid(_) | Self::FrameSize { .. } | Self::EmptyCapillary(_) => true,
            Self::Reconstruction(e) => matches!(
                e,
                ReconstructionError::Camera(_)
                    | ReconstructionError::MaskSize { .. }
                    | ReconstructionError::CameraInBox { .. }
                    | ReconstructionError::Setting(_)
            ),
            Self::TooFewViews { .. } => false,
        }
    }
}
