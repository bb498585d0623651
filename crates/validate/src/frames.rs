//! Profiles as on the instrument: rendered frames with the colour mosaic, segmented.

use super::turn::{True, Turn};
use crate::camera::camera;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Mask, Picture, Polygon, SegmentSettings, Segmenters};
use hardware_sim::scene::{Exposure, Scene, SceneSettings, Specimen};
use rayon::prelude::*;

/// Renders the specimen at each angle and returns the outlines that segmentation finds.
///
/// # Errors
/// Names a view without a profile, and the reason.
pub fn turn(settings: &SceneSettings, specimen: Specimen, ledger: &[f64], segmenters: &Segmenters) -> anyhow::Result<Turn> {
    let scene = Scene::new(settings.clone());
    let size = specimen.truth();
    scene.load(specimen)?;
    let profiles = ledger
        .par_iter()
        .enumerate()
        .map(|(view, &angle_rad)| {
            let rgb = scene.render(&Exposure { angle_rad, number: view as u64 });
            let frame = RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8())?;
            let profile = segmenters
                .segment(&Picture::from_frame(&frame), &SegmentSettings::default(), None)
                .map_err(|e| anyhow::anyhow!("view {view} of {}: {e}", ledger.len()))?;
            Ok((profile.edge, profile.mask))
        })
        .collect::<anyhow::Result<Vec<(Vec<Polygon>, Mask)>>>()?;
    let (outlines, masks) = profiles.into_iter().unzip();
    let nominal = camera(&settings.camera);
    let truth = True { camera: nominal.clone(), dy_px: vec![0.0; ledger.len()], size };
    Ok(Turn::new(nominal, ledger.to_vec(), outlines, Some(masks), truth))
}
