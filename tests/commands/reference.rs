//! The empty-capillary picture: its benefit, and that a recording made with one needs nothing else.

use crate::common::{json, run, stderr};
use carved::config::Config;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::{Pipeline, SpecimenRecord};
use carved_core::profile::{EmptyCapillary, Mask, Picture, Profile, SegmentSettings, Segmenter};
use carved_core::units::Sense;
use carved_devices::acquisition::RevolutionPlan;
use carved_records::{LedgerEntry, Mode, PlannedWell, SpecimenKind, sha256_hex};
use carved_store::{MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, RigRecord};
use hardware_sim::scene::{Exposure, Marks, Placement, Scene, SceneSettings, Specimen};
use std::path::Path;

/// A scene behind a heavily scratched and dusty window.
fn dusty(seed: u64) -> Scene {
    let mut settings = SceneSettings::default();
    settings.nuisances.seed = seed;
    settings.nuisances.window = Marks { scratches: 20, dust: 150, contrast: 0.9 };
    Scene::new(settings)
}

fn frame(scene: &Scene, angle_rad: f64, number: u64) -> RawFrame {
    let rgb = scene.render(&Exposure { angle_rad, number });
    RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8()).unwrap()
}

/// The marks of the window darken whatever they cover. On these frames the mean overlap with the truth is 0.974 with the empty-capillary
/// picture and 0.961 without. The test asks for a third of this gain.
#[test]
fn dust_and_scratches_that_the_empty_capillary_shows_are_no_specimen() {
    const SEEDS: [u64; 4] = [3, 4, 5, 6];
    let settings = SegmentSettings::of_single_picture();
    let mut segmenter = Segmenter::default();
    let mut mean = [0.0; 2];
    for seed in SEEDS {
        let scene = dusty(seed);
        let reference = EmptyCapillary::new(Picture::from_frame(&frame(&scene, 0.0, 100)), &settings.walls).unwrap();
        scene.load(Some(Specimen::larva(3 + (seed % 3) as u8, seed).unwrap().placed(Placement::default()))).unwrap();
        let truth = scene.truth_mask(0.8);
        let truth = Mask::from_coverage(truth.width as usize, truth.height as usize, truth.data).unwrap();
        let picture = Picture::from_frame(&frame(&scene, 0.8, seed));
        let mut overlap = |reference| -> f64 {
            let profile: Profile = segmenter.segment(&picture, &settings, reference).unwrap();
            profile.mask.iou(&truth)
        };
        let found = [overlap(Some(&reference)), overlap(None)];
        println!("seed {seed}: IoU {:.4} with the empty capillary, {:.4} without", found[0], found[1]);
        for (mean, iou) in mean.iter_mut().zip(found) {
            *mean += iou / SEEDS.len() as f64;
        }
    }
    println!("mean {:.4} and {:.4}", mean[0], mean[1]);
    assert!(mean[0] > 0.965 && mean[0] > mean[1] + 0.004, "IoU {:.4} with, {:.4} without", mean[0], mean[1]);
}

#[test]
fn an_empty_capillary_that_cannot_be_used_is_refused_at_the_start() {
    let dir = tempfile::tempdir().unwrap();
    let shipped = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/config/vast-grbl.toml")).unwrap();
    let file = dir.path().join("rig.toml");
    std::fs::write(&file, shipped.replace("height_px = 1024", "height_px = 1024\nempty_capillary = \"empty.png\"")).unwrap();
    let check = || run(&["config", "check", file.to_str().unwrap()]);
    let save = |frame: &RawFrame, format: image::ColorType| {
        image::save_buffer(dir.path().join("empty.png"), frame.bytes(), frame.width(), frame.height(), format).unwrap();
    };
    let refused = |words: &[&str]| {
        for output in [check(), run(&["serve", "--config", file.to_str().unwrap()])] {
            let said = stderr(&output);
            assert!(!output.status.success());
            for word in ["optics.empty_capillary = \"empty.png\"", "detect.png"].iter().chain(words) {
                assert!(said.contains(word), "{word} is not in: {said}");
            }
        }
    };
    refused(&["cannot read", dir.path().to_str().unwrap()]);
    let grey = |width, height, level| RawFrame::new(width, height, PixelFormat::Mono8, vec![level; (width * height) as usize]).unwrap();
    save(&grey(1024, 1024, 160), image::ColorType::L8);
    refused(&["with method \"standard\"", "no capillary"]);
    save(&grey(512, 1024, 160), image::ColorType::L8);
    refused(&["512 x 1024 px", "1024 x 1024 px"]);
    save(&RawFrame::new(8, 8, PixelFormat::RGB8Packed, vec![9; 192]).unwrap(), image::ColorType::Rgb8);
    refused(&["Rgb8 pixels", "BayerRG8"]);
    save(&frame(&Scene::new(SceneSettings::default()), 0.0, 0), image::ColorType::L8);
    assert!(check().status.success(), "{}", stderr(&check()));
}

#[test]
fn pictures_of_another_kind_than_the_empty_capillary_fail_and_the_others_use_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let scene = dusty(3);
    let save = |name: &str, frame: &RawFrame| {
        image::save_buffer(path(name), frame.bytes(), frame.width(), frame.height(), image::ColorType::L8).unwrap();
    };
    save("empty.png", &frame(&scene, 0.0, 100));
    save("small.png", &RawFrame::new(64, 64, PixelFormat::BayerRG8, vec![99; 64 * 64]).unwrap());
    scene.load(Some(Specimen::larva(3, 3).unwrap().placed(Placement::default()))).unwrap();
    save("larva.png", &frame(&scene, 0.8, 3));
    let (out, empty) = (path("out"), path("empty.png"));
    let segment = |reference: &str, images: &[&str]| {
        let images: Vec<String> = images.iter().map(|i| path(i)).collect();
        let mut args = vec!["segment", "--bayer", "--out", &out, "--reference", reference];
        args.extend(images.iter().map(String::as_str));
        run(&args)
    };
    let output = segment(&empty, &["small.png", "larva.png"]);
    assert!(!output.status.success());
    let said = json(Path::new(&out).join("small.json").as_path())["error"].to_string();
    assert!(said.contains("64 x 64 px BayerRG8") && said.contains("1024 x 1024 px BayerRG8"), "{said}");
    let report = json(Path::new(&out).join("larva.json").as_path());
    assert_eq!(report["reference"], sha256_hex(&std::fs::read(&empty).unwrap()), "{report}");
    let settings = SegmentSettings::of_single_picture();
    let read = |name: &str| {
        let image = image::open(path(name)).unwrap();
        Picture::from_frame(&RawFrame::new(image.width(), image.height(), PixelFormat::BayerRG8, image.into_bytes()).unwrap())
    };
    let reference = EmptyCapillary::new(read("empty.png"), &settings.walls).unwrap();
    let profile = Segmenter::default().segment(&read("larva.png"), &settings, Some(&reference)).unwrap();
    assert_eq!(report["profile"]["area_px"], profile.mask.area_px());

    for (reference, word) in [("small.png", "no capillary"), ("nowhere.png", "cannot be read")] {
        let output = segment(&path(reference), &["larva.png"]);
        let said = stderr(&output);
        assert!(!output.status.success() && said.contains(reference) && said.contains(word), "{said}");
    }
}

/// A recording of a bead behind a dusty window, as a run makes it. Six views and coarse voxels are enough for numbers.
struct Recorded {
    config: Config,
    frames: Vec<(LedgerEntry, RawFrame)>,
    empty: RawFrame,
}

impl Recorded {
    fn new() -> Self {
        let mut config = Config::parse(include_str!("../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
        let method = config.methods.get_mut("standard").unwrap();
        (method.asd, method.voxel_um) = (6, 25.0);
        let plan = RevolutionPlan::new(method.asd, config.steps_per_revolution, method.order).unwrap();
        let scene = dusty(5);
        let empty = frame(&scene, 0.0, 100);
        scene.load(Some(Specimen::bead(500.0).unwrap().placed(Placement::default()))).unwrap();
        let view = |stop: &carved_devices::acquisition::Stop| {
            let omega = Sense::default().omega(stop.target, config.steps_per_revolution);
            let frame = frame(&scene, omega, u64::from(stop.view));
            let entry = LedgerEntry {
                view: stop.view,
                retake: 0,
                commanded_steps: stop.target,
                achieved_steps: stop.target,
                epoch: 1,
                omega,
                swept: None,
                moved_ms: 0.0,
                settle_ms: 0.0,
                grab_ms: 0.0,
                trigger_ms: 0.0,
                light: None,
                second: None,
                frame_id: u64::from(stop.view),
                attempts: 1,
                sha256: sha256_hex(frame.bytes()),
                closure: stop.closure,
            };
            (entry, frame)
        };
        let frames = plan.stops().iter().map(view).collect();
        Self { config, frames, empty }
    }

    /// The numbers that these frames give with this empty-capillary picture, or without one.
    fn numbers(&self, empty: Option<&RawFrame>) -> SpecimenRecord {
        let settings = self.config.methods["standard"].pipeline(&self.config.optics, true).unwrap();
        let mut pipeline = Pipeline::new(settings.compared_with(empty).unwrap()).unwrap();
        for (entry, frame) in &self.frames {
            let seen = pipeline.look(frame).unwrap();
            if entry.closure {
                pipeline.observe_closure(&seen);
            } else {
                pipeline.observe(entry.view, entry.omega, &seen).unwrap();
            }
        }
        pipeline.finish().unwrap().1
    }

    fn store(&self, folder: &Path, empty: Option<&RawFrame>) {
        let rig = RigRecord {
            name: "test".into(),
            camera: self.config.optics.clone(),
            pixel_format: PixelFormat::BayerRG8,
            empty_capillary_sha256: None,
            steps_per_revolution: self.config.steps_per_revolution,
            sense: Sense::default(),
            rotation_identity: String::new(),
            camera_identity: String::new(),
            camera_features: std::collections::BTreeMap::default(),
            second: None,
        };
        let well = PlannedWell::new("A01", SpecimenKind::Bead, None);
        let method = self.config.methods["standard"].clone();
        let recording = Recording::new("r", well, Mode::Simulated, rig, "standard", method);
        let mut writer = RecordingWriter::create(folder, recording, empty).unwrap();
        for (entry, frame) in &self.frames {
            writer.add_view(entry.clone(), frame).unwrap();
        }
        let file = MeasurementFile::new(writer.recording(), &[], self.numbers(empty));
        writer.add_json(MEASUREMENT, &file).unwrap();
        writer.close().unwrap();
    }
}

#[test]
fn a_recording_is_measured_again_with_the_empty_capillary_it_holds() {
    let dir = tempfile::tempdir().unwrap();
    let recorded = Recorded::new();
    let (with, without) = (dir.path().join("with"), dir.path().join("without"));
    recorded.store(&with, Some(&recorded.empty));
    recorded.store(&without, None);
    assert_ne!(std::fs::read(with.join(MEASUREMENT)).unwrap(), std::fs::read(without.join(MEASUREMENT)).unwrap(), "the picture counts");
    assert_eq!(RecordingReader::open(&with).unwrap().empty_capillary().unwrap().as_ref(), Some(&recorded.empty));
    for folder in [&with, &without] {
        let output = run(&["measure", folder.to_str().unwrap()]);
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(String::from_utf8_lossy(&output.stdout).contains("\"stored\":\"identical\""));
    }

    // A recording from before the key existed.
    let file = without.join("recording.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let older: String = text.lines().filter(|l| !l.contains("empty_capillary_sha256")).map(|l| format!("{l}\n")).collect();
    assert!(older.len() < text.len(), "{text}");
    std::fs::write(&file, older).unwrap();
    std::fs::remove_file(without.join("SHA256SUMS")).unwrap();
    assert_eq!(RecordingReader::open(&without).unwrap().empty_capillary().unwrap(), None);

    // Another picture than the recorded one would change the numbers, so it is refused by name.
    let other = recorded.frames[0].1.clone();
    image::save_buffer(with.join("frames/empty.png"), other.bytes(), 1024, 1024, image::ColorType::L8).unwrap();
    let said = stderr(&run(&["measure", with.to_str().unwrap()]));
    assert!(said.contains("empty.png") && said.contains("SHA-256"), "{said}");
}

#[cfg(feature = "aravis")]
#[test]
fn a_replay_uses_the_recordings_own_empty_capillary_and_stores_it_again() {
    let dir = tempfile::tempdir().unwrap();
    let recorded = Recorded::new();
    let recording = dir.path().join("A01");
    recorded.store(&recording, Some(&recorded.empty));
    let args = ["--time-scale", "20", "--replay", recording.to_str().unwrap()];
    let mut daemon = crate::common::Daemon::start(&dir.path().join("replayed"), &args);
    let line = daemon.line_with("Replayed numbers");
    assert!(line.contains("identical, bit for bit"), "{line}");
    let replayed = RecordingReader::open(&daemon.run_folder().join("A01")).unwrap();
    assert_eq!(replayed.empty_capillary().unwrap(), Some(recorded.empty.clone()));
    assert_eq!(json(&daemon.run_folder().join("run.json"))["empty_capillary_sha256"], sha256_hex(recorded.empty.bytes()));
}
