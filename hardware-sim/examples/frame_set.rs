//! Writes the frames with which segmentation and detection are evaluated, with their ground truth.
//!
//! `frame_set OUT [SEED] [clean|dust|real|vast]`. Seed 1 is the set on which methods are tuned. `clean` frames have a clean capillary.
//! `dust` gives the same frames with as much dust as real VAST frames have, and `real` also their light, walls, blur, noise and larvae.
//! `vast` gives other frames: 48 larvae in crops of 1024 x 200 px as a VAST stores them, and 500 labelled frames. Per frame:
//!
//! ```text
//!   NAME.png        image of the camera, RGB         NAME.truth.png   coverage by the specimens, 0 to 255
//!   NAME.bayer.png  its mosaic, first row R G R G    NAME.edge.json   [[[u, v], ...], ...] closed outlines, px
//!   NAME.mono.png   luma, for monochrome frames      NAME.body.json   the same without fins
//!   set.json        all specs with their labels
//! ```
//! Frames for segmentation are written to OUT, labelled examples for detection to OUT/detection.

use hardware_sim::scene::Outline;
use hardware_sim::scene::frame_set::{FrameSpec, Realism, detection_set_of, frame_set_of, vast_detection_set, vast_frame_set};
use image::ColorType::{L8, Rgb8};
use rayon::prelude::*;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1);
    let Some(out) = args.next().map(PathBuf::from) else {
        return Err("frame_set OUT [SEED] [clean|dust|real|vast]".into());
    };
    let seed: u64 = args.next().map(|s| s.parse()).transpose()?.unwrap_or(1);
    let kind = args.next();
    if kind.as_deref() == Some("vast") {
        write_all(&out, &vast_frame_set(seed)?)?;
        return write_all(&out.join("detection"), &vast_detection_set(seed)?);
    }
    let realism = match kind.as_deref() {
        None | Some("clean") => Realism::Clean,
        Some("dust") => Realism::Dust,
        Some("real") => Realism::Real,
        Some(other) => return Err(format!("{other} is no kind of frames; choose clean, dust, real or vast").into()),
    };
    write_all(&out, &frame_set_of(seed, realism)?)?;
    write_all(&out.join("detection"), &detection_set_of(seed, realism)?)
}

fn write_all(out: &Path, specs: &[FrameSpec]) -> Result<(), Failure> {
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("set.json"), serde_json::to_vec_pretty(specs)?)?;
    let done = AtomicUsize::new(0);
    specs.par_iter().try_for_each(|spec| {
        write(out, spec)?;
        let number = done.fetch_add(1, Ordering::Relaxed) + 1;
        eprintln!("{number}/{} {}", specs.len(), spec.name);
        Ok(())
    })
}

fn write(out: &Path, spec: &FrameSpec) -> Result<(), Failure> {
    let rendered = spec.render()?;
    let (width, height) = (rendered.frame.width, rendered.frame.height);
    let to = |kind: &str| out.join(format!("{}{kind}", spec.name));
    image::save_buffer(to(".png"), &rendered.frame.data, width, height, Rgb8)?;
    image::save_buffer(to(".bayer.png"), &rendered.frame.to_bayer_rg8(), width, height, L8)?;
    if spec.mono {
        image::save_buffer(to(".mono.png"), &rendered.frame.to_mono8(), width, height, L8)?;
    }
    image::save_buffer(to(".truth.png"), &rendered.truth.data, width, height, L8)?;
    // 1e-4 px is less than the error of the outline.
    let round = |x: f64| (x * 1e4).round() / 1e4;
    for (kind, edge) in [(".edge.json", &rendered.edge), (".body.json", &rendered.body_edge)] {
        let rounded: Vec<Outline> = edge.iter().map(|o| o.iter().map(|p| p.map(round)).collect()).collect();
        std::fs::write(to(kind), serde_json::to_vec(&rounded)?)?;
    }
    Ok(())
}
