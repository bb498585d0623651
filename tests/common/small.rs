//! Frames with the capillary, which is 110 px high, and some rows beside it. A frame of 1024 rows is rendered, sent and looked through in
//! four times this time, and shows no more of the specimen.

use hardware_sim::scene::{Camera, Scene, SceneSettings};
use std::sync::Arc;

const HEIGHT_PX: u32 = 256;
/// Row of the axis: the middle.
const AXIS_ROW_PX: f64 = 127.5;

pub fn small_scene() -> Arc<Scene> {
    let camera = Camera { height: HEIGHT_PX, uy_px: AXIS_ROW_PX, ..Camera::default() };
    Arc::new(Scene::new(SceneSettings { camera, ..SceneSettings::default() }))
}

/// The changes of a shipped configuration for this scene.
pub fn small_frames() -> [(&'static str, String); 3] {
    [
        ("height_px = 1024", format!("height_px = {HEIGHT_PX}")),
        ("\nheight = 1024", format!("\nheight = {HEIGHT_PX}")),
        ("\nuy_px = 511.5", format!("\nuy_px = {AXIS_ROW_PX:?}")),
    ]
}
