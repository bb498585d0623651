//! Frame to profile on the emulated rig's frames, 1024 x 1024: `cargo bench --bench profile`.

use carved::frame::{PixelFormat, RawFrame};
use carved::profile::{Picture, SegmentSettings, segment};
use criterion::{Criterion, criterion_group, criterion_main};
use hardware_sim::scene::{Exposure, Scene, SceneSettings, Specimen};
use std::hint::black_box;

fn frames() -> Result<Vec<(&'static str, RawFrame)>, Box<dyn std::error::Error>> {
    let scene = Scene::new(SceneSettings::default());
    let contents = [("larva 5 dpf", Some(Specimen::larva(5, 41)?)), ("bead", Some(Specimen::bead(500.0)?)), ("empty", None)];
    contents
        .into_iter()
        .map(|(name, specimen)| {
            scene.load(specimen)?;
            let rgb = scene.render(&Exposure { angle_rad: 0.6, number: 0 });
            Ok((name, RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8())?))
        })
        .collect()
}

fn profiles(c: &mut Criterion) {
    let frames = match frames() {
        Ok(frames) => frames,
        Err(error) => panic!("the scene gave no frames: {error}"),
    };
    let settings = SegmentSettings::default();
    let mut group = c.benchmark_group("profile");
    for (name, frame) in &frames {
        let picture = Picture::from_frame(frame);
        group.bench_function(format!("demosaic {name}"), |b| b.iter(|| black_box(Picture::from_frame(black_box(frame)))));
        group.bench_function(format!("segment {name}"), |b| b.iter(|| black_box(segment(black_box(&picture), &settings))));
    }
    group.finish();
}

criterion_group!(benches, profiles);
criterion_main!(benches);
