//! The newest view and the finished model, encoded for the page.

use super::Live;
use crate::export;
use carved_core::pipeline::SegmentedFrame;
use carved_core::profile::{Mask, Picture};
use carved_core::surface::Mesh;
use std::sync::Arc;

/// Allowed error of the page's model: less than a fifth of a pixel, of the camera and of the page. It reduces a larva of 374 000 triangles
/// (9.0 MB) to 21 000 (0.5 MB).
const MODEL_ERROR_UM: f64 = 1.0;

/// The pictures of one view. A picture that cannot be encoded is `None` and logged. The run continues.
pub fn of_view(seen: &SegmentedFrame, mesh: &Mesh) -> Live {
    Live {
        shown: None,
        frame_jpg: jpeg(&seen.picture),
        profile_png: seen.profile.as_ref().ok().and_then(|p| outline(&p.mask)),
        mesh_glb: glb(mesh),
    }
}

/// The finished surface as GLB, with as few triangles as its error allows.
pub fn model(mesh: &Mesh) -> Option<Arc<Vec<u8>>> {
    glb(&export::decimate(mesh, MODEL_ERROR_UM).mesh)
}

fn glb(mesh: &Mesh) -> Option<Arc<Vec<u8>>> {
    let mut out = Vec::new();
    if mesh.triangles.is_empty() {
        return None;
    }
    export::write_glb(mesh, None, export::Unit::M, &export::facts_of_mesh(), &mut out)
        .inspect_err(|error| tracing::warn!(%error, "the model was not encoded"))
        .ok()
        .map(|()| Arc::new(out))
}

/// A frame as JPEG. One that cannot be encoded is `None` and logged.
pub fn jpeg(picture: &Picture) -> Option<Arc<Vec<u8>>> {
    carved_pictures::jpeg(picture, None).inspect_err(|error| tracing::warn!(%error, "the live frame was not encoded")).ok().map(Arc::new)
}

fn outline(mask: &Mask) -> Option<Arc<Vec<u8>>> {
    carved_pictures::outline(mask).inspect_err(|error| tracing::warn!(%error, "the live profile was not encoded")).ok().map(Arc::new)
}
