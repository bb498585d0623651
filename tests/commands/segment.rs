//! `carved segment` as its users meet it: frames of the emulated rig in every type of file, and pictures that fail.

use crate::common::{run, stderr};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Mask, Picture, SegmentSettings, segment};
use hardware_sim::scene::{Exposure, Placement, Rgb, Scene, SceneSettings, Specimen};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

/// A larva of 4 dpf on a sensor of an odd size, at 11 um per px, which makes a frame fast to compute.
fn larva() -> (Rgb, Mask) {
    let mut settings = SceneSettings::default();
    let camera = &mut settings.camera;
    (camera.width, camera.height) = (513, 301);
    (camera.kx_px_per_um, camera.ky_px_per_um) = (1.0 / 11.0, 1.0 / 11.0);
    (camera.ux_px, camera.uy_px) = (256.0, 150.0);
    let scene = Scene::new(settings);
    scene.load(Some(Specimen::larva(4, 61).unwrap().placed(Placement::default()))).unwrap();
    let truth = scene.truth_mask(0.7);
    let truth = Mask::from_coverage(truth.width as usize, truth.height as usize, truth.data).unwrap();
    (scene.render(&Exposure { angle_rad: 0.7, number: 3 }), truth)
}

fn colour(frame: &Rgb) -> DynamicImage {
    RgbImage::from_raw(frame.width, frame.height, frame.data.clone()).unwrap().into()
}

fn grey(frame: &Rgb, bytes: Vec<u8>) -> DynamicImage {
    GrayImage::from_raw(frame.width, frame.height, bytes).unwrap().into()
}

fn segment_files(dir: &Path, options: &[&str], images: &[&str]) -> Output {
    let paths: Vec<String> = images.iter().map(|i| dir.join(i).display().to_string()).collect();
    let out = dir.join("out").display().to_string();
    let args: Vec<&str> =
        ["segment", "--out", &out].into_iter().chain(options.iter().copied()).chain(paths.iter().map(String::as_str)).collect();
    run(&args)
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
}

fn mask(path: &Path) -> Mask {
    let image = image::open(path).unwrap();
    assert_eq!(image.color(), image::ColorType::L8);
    assert!(image.as_bytes().iter().all(|p| *p == 0 || *p == 255));
    Mask::from_coverage(image.width() as usize, image.height() as usize, image.into_bytes()).unwrap()
}

/// At 11 um per px the outline is a twelfth of the larva's pixels, so that half a pixel at the edge costs 4 % of overlap. All files of one
/// frame give the same bits, except for the losses of JPEG and the missing colours of mosaic and grey pictures.
#[test]
fn every_kind_of_picture_gives_the_larvas_outline() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    let rgb = colour(&frame);
    let grey8 = grey(&frame, frame.to_mono8());
    let save = |image: DynamicImage, name: &str| image.save(dir.path().join(name)).unwrap();
    save(rgb.clone(), "rgb.png");
    save(rgb.clone().into_rgba8().into(), "rgba.png");
    save(rgb.clone(), "rgb_bmp.bmp");
    save(rgb.clone(), "rgb_tiff.tif");
    // A 12-bit camera: its counts are the low bits of 16.
    let twelve: Vec<u16> = frame.data.iter().map(|&p| u16::from(p) << 4).collect();
    save(image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(frame.width, frame.height, twelve).unwrap().into(), "rgb_12.png");
    let jpeg = std::fs::File::create(dir.path().join("jpeg.jpg")).unwrap();
    image::codecs::jpeg::JpegEncoder::new_with_quality(jpeg, 95).encode_image(&rgb).unwrap();
    save(grey8.clone(), "grey.png");
    save(grey8.clone().into_luma_alpha8().into(), "grey_alpha.png");
    save(grey8.into_luma16().into(), "grey_16.tiff");
    // The type is read from the contents of the file, not from its name.
    rgb.save_with_format(dir.path().join("misnamed.jpeg"), ImageFormat::Png).unwrap();

    let same = [
        vec!["rgb.png", "rgba.png", "rgb_bmp.bmp", "rgb_tiff.tif", "rgb_12.png", "misnamed.jpeg"],
        vec!["grey.png", "grey_alpha.png", "grey_16.tiff"],
        vec!["jpeg.jpg"],
    ];
    let output = segment_files(dir.path(), &[], &same.concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stderr(&output).lines().count(), 10, "a line per picture: {}", stderr(&output));
    let out = |image: &str, suffix: &str| dir.path().join("out").join(format!("{}{suffix}", image.split('.').next().unwrap()));
    for group in &same {
        let first = mask(&out(group[0], ".mask.png"));
        assert_eq!((first.width(), first.height()), (513, 301));
        // At 11 um per px the fin is 4 px wide and is found in part: overlap 0.908 in colour, 0.861 in grey.
        assert!(first.iou(&truth) > 0.85, "{}: IoU {}", group[0], first.iou(&truth));
        for image in group {
            assert_eq!(mask(&out(image, ".mask.png")), first, "{image}");
            let report = json(&out(image, ".json"));
            assert_eq!(report["error"], Value::Null);
            assert_eq!(report["input"]["name"], **image);
            assert_eq!(report["profile"]["area_px"], first.area_px());
            let overlay = image::open(out(image, ".overlay.png")).unwrap();
            assert_eq!((overlay.width(), overlay.height()), (513, 301));
        }
    }
    assert_eq!(json(&out("rgb_12.png", ".json"))["input"]["bits"], 12);

    // The outline equals that of the library, up to the rounding in the file.
    let raw = RawFrame::new(frame.width, frame.height, PixelFormat::RGB8Packed, frame.data.clone()).unwrap();
    let profile = segment(&Picture::from_frame(&raw), &SegmentSettings::default()).unwrap();
    let edge = json(&out("rgb.png", ".edge.json"));
    let polygons = edge["polygons"].as_array().unwrap();
    assert_eq!(polygons.len(), profile.edge.len());
    for (polygon, ours) in polygons.iter().zip(&profile.edge) {
        let vertices = polygon["vertices"].as_array().unwrap();
        for key in ["contrast_sigma", "error_px", "bounded"] {
            assert_eq!(polygon[key].as_array().unwrap().len(), vertices.len(), "{key}");
        }
        assert_eq!(vertices.len(), ours.vertices.len());
        for (vertex, [u, v]) in vertices.iter().zip(&ours.vertices) {
            assert!((vertex[0].as_f64().unwrap() - u).abs() < 1e-4 && (vertex[1].as_f64().unwrap() - v).abs() < 1e-4);
        }
    }
    // The overlay shows the outline at the stated vertices, and the picture elsewhere.
    let overlay = image::open(out("rgb.png", ".overlay.png")).unwrap().into_rgb8();
    let [u, v] = profile.edge[0].vertices[0].map(|x| x.round() as u32);
    assert_eq!(overlay.get_pixel(u, v).0, [255, 64, 160]);
    assert_eq!(overlay.get_pixel(3, 3).0[..], frame.data[(3 * 513 + 3) * 3..][..3]);
}

#[test]
fn a_mosaic_is_read_as_one_and_a_picture_in_colour_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    grey(&frame, frame.to_bayer_rg8()).save(dir.path().join("mosaic.png")).unwrap();
    colour(&frame).save(dir.path().join("colour.png")).unwrap();
    let output = segment_files(dir.path(), &["--bayer"], &["mosaic.png", "colour.png"]);
    assert_eq!(output.status.code(), Some(1));
    let report = json(&dir.path().join("out/mosaic.json"));
    assert_eq!(report["input"]["pixel_format"], "BayerRG8");
    let found = mask(&dir.path().join("out/mosaic.mask.png"));
    assert!(found.iou(&truth) > 0.86, "IoU {}", found.iou(&truth));
    let refused = json(&dir.path().join("out/colour.json"))["error"].as_str().unwrap().to_owned();
    assert!(refused.contains("--bayer"), "{refused}");
}

#[test]
fn a_picture_that_fails_says_why_and_the_others_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("larva.png")).unwrap();
    let flat = |grey: u8, name: &str| GrayImage::from_pixel(301, 203, image::Luma([grey])).save(dir.path().join(name)).unwrap();
    flat(2, "black.png");
    flat(255, "white.png");
    flat(190, "bare.png");
    std::fs::write(dir.path().join("text.png"), "not a picture").unwrap();
    let whole = std::fs::read(dir.path().join("larva.png")).unwrap();
    std::fs::write(dir.path().join("cut.png"), &whole[..whole.len() / 2]).unwrap();
    // If a picture fails, an older result of it is removed.
    std::fs::create_dir(dir.path().join("out")).unwrap();
    std::fs::write(dir.path().join("out/black.mask.png"), "older").unwrap();
    std::fs::write(dir.path().join("out/larva.json"), "older").unwrap();

    let images = ["black.png", "white.png", "larva.png", "bare.png", "text.png", "cut.png", "absent.png"];
    let output = segment_files(dir.path(), &["--method", "level-set"], &images);
    assert_eq!(output.status.code(), Some(1));
    let told = stderr(&output);
    assert_eq!(told.lines().count(), images.len() + 1, "{told}");
    for (name, why) in [
        ("black", "black"),
        ("white", "over-exposed"),
        ("bare", "no capillary"),
        ("text", "no picture"),
        ("cut", "not a readable"),
        ("absent", "cannot be read"),
    ] {
        let error = json(&dir.path().join(format!("out/{name}.json")))["error"].as_str().unwrap().to_owned();
        assert!(error.contains(why), "{name}: {error}");
        assert!(told.lines().any(|l| l.contains(&format!("{name}.png")) && l.contains(why)), "{told}");
        assert!(!dir.path().join(format!("out/{name}.mask.png")).exists(), "{name}");
    }
    let larva = json(&dir.path().join("out/larva.json"));
    assert_eq!((&larva["error"], &larva["settings"]["method"]), (&Value::Null, &Value::from("level-set")));
    let left: Vec<_> = std::fs::read_dir(dir.path().join("out")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(left.len(), 6 + 4, "no part is left: {left:?}");
}

/// Each of these once gave an outline, or an unhelpful error.
#[test]
fn pictures_taken_amiss_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    let rgb = colour(&frame);
    let save = |image: DynamicImage, name: &str| image.save(dir.path().join(name)).unwrap();
    save(grey(&frame, frame.to_bayer_rg8()), "mosaic.png");
    save(rgb.rotate90(), "turned.png");
    // The outer lines of the walls are at rows 91 and 209, which leaves 4 px of water beside them.
    let walls = segment_walls(&frame);
    let (top, bottom) = (walls[0].round() as u32 - 4, walls[1].round() as u32 + 4);
    save(rgb.crop_imm(0, top, frame.width, bottom - top + 1), "tight.png");
    std::fs::create_dir(dir.path().join("folder.png")).unwrap();
    let pipe = dir.path().join("pipe.png");
    nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let refusals = [
        ("mosaic", "--bayer"),
        ("turned", "turn the picture by 90 degrees"),
        ("tight", "4 px of what is beyond the capillary's walls"),
        ("folder", "it is a folder"),
        ("pipe", "it is a pipe"),
    ];
    let images: Vec<String> = refusals.iter().map(|(name, _)| format!("{name}.png")).collect();
    let output = segment_files(dir.path(), &[], &images.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(1));
    for (name, why) in refusals {
        let error = json(&dir.path().join(format!("out/{name}.json")))["error"].as_str().unwrap_or_default().to_owned();
        assert!(error.contains(why), "{name}: {error}");
    }
}

fn segment_walls(frame: &Rgb) -> [f64; 2] {
    let raw = RawFrame::new(frame.width, frame.height, PixelFormat::RGB8Packed, frame.data.clone()).unwrap();
    let walls = segment(&Picture::from_frame(&raw), &SegmentSettings::default()).unwrap().walls;
    let ends = |line: carved_core::profile::Line| [line.at(0.0), line.at(512.0)];
    let ([a, b], [c, d]) = (ends(walls.upper.outer), ends(walls.lower.outer));
    [a.min(b), c.max(d)]
}

/// Compression artefacts are not noise: the outline is given together with its quality.
#[test]
fn a_picture_that_was_compressed_too_much_is_flagged() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    for quality in [75, 95] {
        let file = std::fs::File::create(dir.path().join(format!("q{quality}.jpg"))).unwrap();
        image::codecs::jpeg::JpegEncoder::new_with_quality(file, quality).encode_image(&colour(&frame)).unwrap();
    }
    colour(&frame).save(dir.path().join("whole.png")).unwrap();
    let output = segment_files(dir.path(), &[], &["q75.jpg", "q95.jpg", "whole.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let warning = |name: &str| json(&dir.path().join(format!("out/{name}.json")))["warning"].clone();
    assert!(warning("q75").as_str().is_some_and(|w| w.contains("compression")), "{}", warning("q75"));
    assert!(stderr(&output).lines().any(|l| l.contains("q75.jpg") && l.contains("compression")), "{}", stderr(&output));
    assert_eq!((warning("q95"), warning("whole")), (Value::Null, Value::Null));
}

/// A folder has the name of the mask. No partial file is left, and the output refers to no missing file.
#[test]
fn results_that_cannot_be_written_are_told_from_pictures_without_a_profile() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("a.png")).unwrap();
    std::fs::create_dir_all(dir.path().join("out/a.mask.png/in_the_way")).unwrap();
    let output = segment_files(dir.path(), &[], &["a.png"]);
    assert_eq!(output.status.code(), Some(1));
    let told = stderr(&output);
    assert!(told.contains("not written") && told.contains("1 of 1 pictures could not be written"), "{told}");
    assert!(!told.contains("JSON"), "{told}");
    let left: Vec<_> = std::fs::read_dir(dir.path().join("out")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(left, ["a.mask.png"]);
}

/// A wrong command line writes no file.
#[test]
fn a_call_that_would_lose_a_result_is_refused_whole() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    std::fs::create_dir(dir.path().join("other")).unwrap();
    for name in ["a.png", "a.bmp", "a.edge.png", "a.mask.png"] {
        colour(&frame).save(dir.path().join(name)).unwrap();
    }
    std::fs::write(dir.path().join("bad.toml"), "faint_sigma = 0.05\nlow_sigma = 1.3\n").unwrap();
    std::fs::write(dir.path().join("unknown.toml"), "clip = 4\n").unwrap();
    let (bad, unknown) = (dir.path().join("bad.toml").display().to_string(), dir.path().join("unknown.toml").display().to_string());
    let refusals: [(&[&str], &[&str], &str); 5] = [
        (&[], &["a.png", "a.bmp"], "a.mask.png"),
        (&[], &["a.png", "a.edge.png"], "a.edge.json"),
        (
            &["--settings", &bad],
            &["a.png"],
            "faint_sigma = 0.05; expected 0.1 to 100 standard deviations of the noise; low_sigma is no longer a setting",
        ),
        (&["--settings", &unknown], &["a.png"], "unknown field `clip`"),
        (&["--settings", "absent.toml"], &["a.png"], "absent.toml"),
    ];
    for (options, images, why) in refusals {
        let output = segment_files(dir.path(), options, images);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(why), "{}", stderr(&output));
        assert!(!dir.path().join("out").exists(), "{images:?}");
    }
    // Output into the folder of the pictures: the mask of a.png would overwrite the picture a.mask.png.
    let (folder, a, masked) = (dir.path().display().to_string(), dir.path().join("a.png"), dir.path().join("a.mask.png"));
    let before = std::fs::read(&masked).unwrap();
    let output = run(&["segment", "--out", &folder, &a.display().to_string(), &masked.display().to_string()]);
    assert!(!output.status.success() && stderr(&output).contains("replace the picture"), "{}", stderr(&output));
    assert_eq!(std::fs::read(&masked).unwrap(), before);
}

/// The same command gives the same bytes on one core and on many, also over older results.
#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("a.png")).unwrap();
    grey(&frame, frame.to_mono8()).save(dir.path().join("b.png")).unwrap();
    std::fs::write(dir.path().join("s.toml"), "method = \"hybrid\"\nfaint_sigma = 4.0\n[edge]\nblur_px = 0.9\n").unwrap();
    let results = |threads: &str| {
        let output = crate::common::carved()
            .env("RAYON_NUM_THREADS", threads)
            .current_dir(dir.path())
            .args(["segment", "--settings", "s.toml", "--out", "out", "a.png", "b.png"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let mut files: Vec<_> = std::fs::read_dir(dir.path().join("out")).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        files.into_iter().map(|f| (f.clone(), std::fs::read(f).unwrap())).collect::<Vec<_>>()
    };
    let one = results("1");
    assert_eq!(one.len(), 8);
    assert!(one == results("4"));
    let report = json(&dir.path().join("out/a.json"));
    assert_eq!(report["settings"]["method"], "hybrid");
    assert_eq!(report["settings"]["faint_sigma"], 4.0);
    assert_eq!(report["settings"]["edge"]["blur_px"], 0.9);
}
