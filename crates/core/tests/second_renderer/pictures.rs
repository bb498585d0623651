//! Writes frames for the eye, where `CARVED_SECOND_PICTURES` names a folder:
//!
//! ```sh
//! CARVED_SECOND_PICTURES=/tmp/frames cargo test -p carved-core --test second_renderer -- --include-ignored
//! ```
//! Besides the frames of [`pictures`], these are the profiles with the most false pixels.

use crate::cases::{Kind, Size, scene};
use crate::dust::Dirt;
use crate::scene::Frame;
use crate::truth::mask;
use carved_core::profile::Mask;
use std::path::Path;

/// A binary PPM file.
fn write(path: &Path, width: usize, height: usize, rgb: &[u8]) {
    let mut bytes = format!("P6 {width} {height} 255\n").into_bytes();
    bytes.extend_from_slice(rgb);
    std::fs::write(path, bytes).unwrap();
}

/// Writes a frame with its profile: found pixels beside the specimen in red, missed pixels in blue. Without a folder it does nothing.
pub fn write_profile(name: &str, frame: &Frame, found: &Mask) {
    let Ok(folder) = std::env::var("CARVED_SECOND_PICTURES") else { return };
    let truth = mask(frame, &frame.covered);
    let mut rgb = frame.rgb();
    for (i, pixel) in rgb.chunks_exact_mut(3).enumerate() {
        match (found.data()[i] != 0, truth.data()[i] != 0) {
            (true, false) => pixel[0] = 255,
            (false, true) => pixel[2] = 255,
            _ => {}
        }
    }
    write(&Path::new(&folder).join(format!("{}.ppm", name.replace([' ', ','], "_"))), frame.width, frame.height, &rgb);
}

#[test]
#[ignore = "writes pictures into the folder that CARVED_SECOND_PICTURES names"]
fn pictures() {
    let folder = std::env::var("CARVED_SECOND_PICTURES").expect("CARVED_SECOND_PICTURES names a folder");
    for (name, kind) in [("bead", Kind::Bead), ("ellipsoid", Kind::Ellipsoid), ("finned", Kind::Finned), ("finless", Kind::Finless)] {
        for seed in [1, 2] {
            for (dirt_name, dirt) in [("clean", Dirt::NONE), ("dust", Dirt::MEASURED)] {
                let scene = scene(kind, Size::Crop, dirt, seed);
                for deg in [0u32, 45, 90] {
                    let frame = scene.render(f64::from(deg).to_radians(), 0);
                    let path = |what: &str| Path::new(&folder).join(format!("{name}{seed}_{dirt_name}_{deg:03}{what}.ppm"));
                    write(&path(""), frame.width, frame.height, &frame.rgb());
                    let truth = frame.covered.iter().zip(&frame.body).flat_map(|(c, b)| [255.0 * c, 255.0 * b, 255.0 * b].map(|p| p as u8));
                    write(&path("_truth"), frame.width, frame.height, &truth.collect::<Vec<u8>>());
                }
            }
        }
    }
}
