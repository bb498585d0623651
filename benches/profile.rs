//! From frame to profile, on frames of the emulated rig of 1024 x 1024: `cargo bench --bench profile`.

use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Method, Picture, SegmentSettings, Segmenter};
use criterion::{Criterion, criterion_group, criterion_main};
use hardware_sim::scene::Exposure;
use hardware_sim::scene::frame_set::{Class, detection_set, frame_set};
use std::hint::black_box;

/// The first frame of each kind in the set that is used to judge the segmentation.
fn frames() -> Result<Vec<(&'static str, RawFrame)>, Box<dyn std::error::Error>> {
    let specs = frame_set(1)?.into_iter().chain(detection_set(1)?).collect::<Vec<_>>();
    let wanted = [("larva", Class::Larva), ("bead", Class::Bead), ("empty", Class::Empty)];
    let mut frames = Vec::new();
    for (name, class) in wanted {
        let spec = specs.iter().find(|s| s.class == class && !s.mono).ok_or("the set has no such frame")?;
        let rgb = spec.scene()?.render(&Exposure { angle_rad: spec.angle_rad, number: spec.number });
        frames.push((name, RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8())?));
    }
    Ok(frames)
}

fn profiles(c: &mut Criterion) {
    let frames = match frames() {
        Ok(frames) => frames,
        Err(error) => panic!("the scene gave no frames: {error}"),
    };
    let methods = [("hybrid", Method::Hybrid), ("level-set", Method::LevelSet)];
    let mut segmenter = Segmenter::default();
    let mut group = c.benchmark_group("profile");
    for (name, frame) in &frames {
        let picture = Picture::from_frame(frame);
        group.bench_function(format!("demosaic {name}"), |b| b.iter(|| black_box(Picture::from_frame(black_box(frame)))));
        for (method_name, method) in methods {
            let settings = SegmentSettings { method, ..SegmentSettings::default() };
            group.bench_function(format!("{method_name} {name}"), |b| {
                b.iter(|| black_box(segmenter.segment(black_box(&picture), &settings, None)));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, profiles);
criterion_main!(benches);
