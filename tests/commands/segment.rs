//! `carved segment` as its users meet it: frames of the emulated rig in every type of file, and pictures that fail.

use crate::common::{run, stderr};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Annotation, Mask, Picture, SegmentSettings, segment};
use hardware_sim::scene::{Exposure, Placement, Rgb, Scene, SceneSettings, Specimen};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use serde_json::Value;
use std::collections::HashMap;
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
    (scene.render(&Exposure { angle_rad: 0.7, number: 4 }), truth)
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
    let profile = segment(&Picture::from_frame(&raw), &SegmentSettings::of_single_picture()).unwrap();
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

/// The picture of each camera is a mosaic that begins with other colours. Read in its own order, all give the same outline.
#[test]
fn a_mosaic_is_read_in_the_order_of_its_camera() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    // Light with less red and more blue: colours without a difference do not tell an order.
    let tint = |rgb: &[u8]| [rgb[0] / 4 * 3, rgb[1], rgb[2].saturating_add(10)];
    let rgb: Vec<[u8; 3]> = frame.data.chunks_exact(3).map(tint).collect();
    let width = frame.width as usize;
    for format in PixelFormat::ALL {
        let (Some(order), Some([red_u, red_v])) = (format.mosaic(), format.first_red()) else { continue };
        let pixel = |i: usize| rgb[i][(i % width + red_u) % 2 + (i / width + red_v) % 2];
        grey(&frame, (0..rgb.len()).map(pixel).collect()).save(dir.path().join(format!("{order}.png"))).unwrap();
        let output = segment_files(dir.path(), &[&format!("--bayer={order}")], &[&format!("{order}.png")]);
        assert_eq!(output.status.code(), Some(0), "{order}");
        assert_eq!(json(&dir.path().join(format!("out/{order}.json")))["input"]["pixel_format"], format.name());
        let found = mask(&dir.path().join(format!("out/{order}.mask.png")));
        // 0.859 in the order grbg. The limit without the tint is 0.86.
        assert!(found.iou(&truth) > 0.85, "{order}: IoU {}", found.iou(&truth));
    }
    let output = segment_files(dir.path(), &["--bayer=rggb"], &["grbg.png"]);
    assert_eq!(output.status.code(), Some(1));
    let refused = json(&dir.path().join("out/grbg.json"))["error"].as_str().unwrap().to_owned();
    assert!(refused.contains("the green pixels of a mosaic rggb differ by") && refused.contains("--bayer=ORDER"), "{refused}");
    let unknown = segment_files(dir.path(), &["--bayer=rgbg"], &["grbg.png"]);
    let said = String::from_utf8_lossy(&unknown.stderr);
    assert!(unknown.status.code() == Some(2) && said.contains("rggb, grbg, gbrg, bggr"), "{said}");
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

    // A decoder panics on it.
    let tiles = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/commands/data/parsers/picture/planar-tiles.tif");
    std::fs::copy(tiles, dir.path().join("tiles.png")).unwrap();

    let images = ["black.png", "tiles.png", "white.png", "larva.png", "bare.png", "text.png", "cut.png", "absent.png"];
    let output = segment_files(dir.path(), &["--method", "level-set"], &images);
    assert_eq!(output.status.code(), Some(1));
    let told = stderr(&output);
    assert_eq!(told.lines().count(), images.len() + 1, "{told}");
    for (name, why) in [
        ("black", "black"),
        ("white", "over-exposed"),
        ("bare", "no capillary"),
        ("text", "no picture"),
        ("cut", "incomplete"),
        ("tiles", "save it again with another program"),
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
    assert_eq!(left.len(), 7 + 4, "no part is left: {left:?}");
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
    let walls = segment(&Picture::from_frame(&raw), &SegmentSettings::of_single_picture()).unwrap().walls;
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
fn results_that_cannot_be_written_are_distinguished_from_pictures_without_a_profile() {
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

/// The rows of `compare.csv`: by picture, the values by column.
fn compared(dir: &Path) -> HashMap<String, HashMap<String, String>> {
    let mut table = csv::Reader::from_path(dir.join("out/compare.csv")).unwrap();
    let rows = table.deserialize().map(|row: Result<HashMap<String, String>, _>| row.unwrap());
    rows.map(|row| (row["picture"].clone(), row)).collect()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap_or_else(|| panic!("{value}")).iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The file is what FishInspector's own reader expects: it takes the file by the name of the picture, the capillary by the names of its lines
/// with a row for each column of the picture, the outline by the name `fineContour`, and all positions counted from 1.
#[test]
fn outlines_go_to_fishinspector_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("day 3.b.tif")).unwrap();
    let output = segment_files(dir.path(), &["--shapes"], &["day 3.b.tif"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let written = dir.path().join("out/day 3.b__SHAPES.json");
    let file = json(&written);
    assert_eq!((&file["version"], &file["enabled"]), (&Value::from(0.99), &Value::from(1)));
    assert_eq!(numbers(&file["imageDimensions"]), [513.0, 301.0, 3.0]);

    let report = json(&dir.path().join("out/day 3.b.json"));
    let lines = file["capillary"]["shape"].as_array().unwrap();
    assert_eq!(lines.len(), 4);
    let walls = [("upper", "upper", "outer"), ("upper_in", "upper", "inner"), ("lower", "lower", "outer"), ("lower_in", "lower", "inner")];
    for (line, (name, wall, side)) in lines.iter().zip(walls) {
        assert_eq!(line["name"], name);
        assert_eq!(numbers(&line["x"]), (1..=513).map(f64::from).collect::<Vec<_>>());
        let (rows, expected) = (numbers(&line["y"]), &report["profile"]["walls"][wall][side]);
        assert_eq!(rows.len(), 513);
        // In the middle column, to 0.1 px.
        assert!((rows[256] - 1.0 - expected["v_mid"].as_f64().unwrap()).abs() < 0.06, "{name}: {} for {expected}", rows[256]);
    }
    let contour = &file["fishContour"];
    assert_eq!(contour["mode"], "manual");
    for (feature, parameters) in [
        ("capillary", &["threshMultiplier", "vertCutoff", "horizCutoff", "steps"][..]),
        (
            "fishContour",
            &["auto_thresh_multiplier", "width_of_capillary_wall", "imclose_disksize", "binary_contour_smoothing", "min_peak_width"],
        ),
    ] {
        assert!(parameters.iter().all(|key| file[feature]["parameter"][key].is_f64()), "{feature}: {}", file[feature]["parameter"]);
    }
    let edge = json(&dir.path().join("out/day 3.b.edge.json"));
    let ours = edge["polygons"][0]["vertices"].as_array().unwrap();
    for (shape, name) in contour["shape"].as_array().unwrap().iter().zip(["binaryShape", "fineContour"]) {
        assert_eq!(shape["name"], name);
        let (x, y) = (numbers(&shape["x"]), numbers(&shape["y"]));
        assert_eq!((x.len(), y.len()), (ours.len(), ours.len()));
        for ((x, y), vertex) in x.iter().zip(&y).zip(ours) {
            let expected = numbers(vertex);
            assert!((x - 1.0 - expected[0]).abs() < 1e-6 && (y - 1.0 - expected[1]).abs() < 1e-6, "{x}, {y} for {vertex}");
        }
    }

    // Corrections are not replaced, and nothing is written before that is clear.
    let before = std::fs::read(&written).unwrap();
    std::fs::remove_file(dir.path().join("out/day 3.b.json")).unwrap();
    let output = segment_files(dir.path(), &["--shapes"], &["day 3.b.tif"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("corrected by hand; move it, or give another --out"), "{}", stderr(&output));
    assert!(!dir.path().join("out/day 3.b.json").exists() && std::fs::read(&written).unwrap() == before);

    // Back again, without a correction.
    let folder = dir.path().join("out").display().to_string();
    let output = segment_files(dir.path(), &["--compare", &folder], &["day 3.b.tif"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let row = &compared(dir.path())["day 3.b.tif"];
    for (column, expected) in [
        ("outline", "fishContour"),
        ("iou", "1.0000"),
        ("edge_error_abs_mean_px", "0.0000"),
        ("edge_error_abs_p95_px", "0.0000"),
        ("false_area_px", "0"),
        ("missed_area_px", "0"),
        ("humps", "0"),
        ("largest_hump_area_px", "0"),
        ("fins_found_share", ""),
        ("error", ""),
    ] {
        assert_eq!(row[column], expected, "{column}");
    }
    assert!(row["edge_error_mean_px"].trim_start_matches('-') == "0.0000", "{row:?}");
    assert_eq!(row["area_px"], row["annotation_area_px"]);
    assert!(row["annotation"].ends_with("day 3.b__SHAPES.json"), "{row:?}");
}

/// The structure of the published files of releases with neural networks.
#[test]
fn outlines_go_to_releases_with_neural_networks() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("a.png")).unwrap();
    let output = segment_files(dir.path(), &["--shapes=contourDV_net"], &["a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let file = json(&dir.path().join("out/a__SHAPES.json"));
    let keys: Vec<&str> = file.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(keys, ["carved", "contourDV_net", "enabled", "imageDimensions", "version"]);
    let feature = &file["contourDV_net"];
    assert_eq!(feature["parameter"], serde_json::json!({ "disksize_CloseOpen": 0, "min_peak_width": 0, "contour_smoothing": 0 }));
    assert_eq!((&feature["mode"], &feature["shape"]["name"]), (&Value::from("manual"), &Value::from("fineContour")));
    assert!(numbers(&feature["shape"]["x"]).len() > 100);
    let folder = dir.path().join("out").display().to_string();
    let output = segment_files(dir.path(), &["--compare", &folder], &["a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let row = &compared(dir.path())["a.png"];
    assert_eq!((row["outline"].as_str(), row["iou"].as_str()), ("contourDV_net", "1.0000"));
    // A fin of its own belongs to the larva. Without it the outline is the body.
    let mut with_fin = file.clone();
    let (x, y) = (numbers(&feature["shape"]["x"]), numbers(&feature["shape"]["y"]));
    let (left, top) = (x.iter().copied().fold(f64::INFINITY, f64::min), y.iter().copied().fold(f64::INFINITY, f64::min));
    let square = |low: f64| serde_json::json!([low, low + 20.0, low + 20.0, low]);
    let corners = serde_json::json!([top - 20.0, top - 20.0, top - 10.0, top - 10.0]);
    with_fin["fin1_net"] = serde_json::json!({"mode": "auto", "shape": {"name": "fineContour", "x": square(left), "y": corners}});
    std::fs::write(dir.path().join("out/a__SHAPES.json"), with_fin.to_string()).unwrap();
    let output = segment_files(dir.path(), &["--compare", &folder], &["a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let row = &compared(dir.path())["a.png"];
    assert_eq!(row["outline"], "contourDV_net and fins");
    let area = |column: &str| row[column].parse::<f64>().unwrap();
    assert!((area("annotation_area_px") - area("area_px") - 200.0).abs() <= 30.0, "{row:?}");
    assert!(area("fins_found_share").abs() < 1e-12, "{row:?}");
    let output = segment_files(dir.path(), &["--shapes=fishEye"], &["a.png"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("fishContour, contour_net, contourDV_net"), "{}", stderr(&output));
}

/// The tail is cut off by hand: the part of the profile behind the cut, beyond 2 px, is one hump.
#[test]
fn a_corrected_outline_is_compared_by_known_geometry() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, _) = larva();
    colour(&frame).save(dir.path().join("a.png")).unwrap();
    let output = segment_files(dir.path(), &["--shapes"], &["a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let ours = json(&dir.path().join("out/a__SHAPES.json"));
    let fine = &ours["fishContour"]["shape"][1];
    let (x, y) = (numbers(&fine["x"]), numbers(&fine["y"]));
    // Between columns 399 and 400 counted from 0, as FishInspector saves it: columns of numbers, 0.1 px, no size of the picture.
    let cut = 400.5;
    let column = |values: &[f64]| values.iter().map(|x| vec![(x * 10.0).round() / 10.0]).collect::<Vec<_>>();
    let x: Vec<f64> = x.into_iter().map(|x| x.min(cut)).collect();
    let corrected = serde_json::json!({
        "version": 0.99, "enabled": true, "fishEye": {"shape": {"name": "fishEye", "x": 4, "y": 5}},
        "fishContour": {"mode": "manual", "shape": [{"name": "fineContour", "x": column(&x), "y": column(&y)}]},
    });
    std::fs::create_dir(dir.path().join("corrected")).unwrap();
    let file = dir.path().join("corrected/a__SHAPES.json");
    std::fs::write(&file, corrected.to_string()).unwrap();
    let output = segment_files(dir.path(), &["--compare", &file.display().to_string()], &["a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));

    let found = mask(&dir.path().join("out/a.mask.png"));
    let behind = |first: usize| (0..found.height()).map(|v| (first..found.width()).filter(|&u| found.get(u, v)).count()).sum::<usize>();
    let row = &compared(dir.path())["a.png"];
    let number = |column: &str| row[column].parse::<f64>().unwrap_or_else(|e| panic!("{column} {:?}: {e}", row[column]));
    assert!(behind(400) > 200, "the tail is behind the cut: {}", behind(400));
    // Column 402 is 2.5 px behind the cut at 399.5, column 401 is 1.5 px.
    assert_eq!((number("humps"), number("false_area_px"), number("largest_hump_area_px")), (1.0, behind(402) as f64, behind(402) as f64));
    assert_eq!((number("missed_area_px"), number("area_px")), (0.0, found.area_px() as f64));
    // Rounded to 0.1 px, the outline passes a few centres of pixels on the other side.
    assert!((number("annotation_area_px") - (found.area_px() - behind(400)) as f64).abs() < 0.01 * found.area_px() as f64, "{row:?}");
    let iou = 1.0 - behind(400) as f64 / found.area_px() as f64;
    assert!((number("iou") - iou).abs() < 0.01, "{row:?} for {iou}");
    assert!(number("edge_error_mean_px") > 0.5 && number("edge_error_abs_p95_px") > 2.0, "{row:?}");
    let told = stdout(&output);
    assert!(told.contains("1 of 1 pictures compared; 0 without a profile") && told.contains("largest hump, px: median"), "{told}");
}

/// Masks as annotations, with the figures of the library.
#[test]
fn masks_of_the_larva_and_its_body_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    for name in ["a.png", "b.png"] {
        colour(&frame).save(dir.path().join(name)).unwrap();
    }
    let annotated = dir.path().join("annotated");
    std::fs::create_dir(&annotated).unwrap();
    let save = |mask: &Mask, name: &str| {
        GrayImage::from_raw(mask.width() as u32, mask.height() as u32, mask.data().to_vec()).unwrap().save(annotated.join(name)).unwrap();
    };
    // A body without the back half, so that there are fins by definition.
    let mut body = truth.clone();
    (0..truth.height()).for_each(|v| (256..truth.width()).for_each(|u| body.set(u, v, false)));
    save(&truth, "a.truth.png");
    save(&body, "a.body.png");
    save(&truth, "b.png");
    // A mask is preferred by its name.
    save(&Mask::empty(3, 3), "a.mask.png");
    let output = segment_files(dir.path(), &["--compare", &annotated.display().to_string()], &["b.png", "a.png"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let found = mask(&dir.path().join("out/a.mask.png"));
    let raw = RawFrame::new(frame.width, frame.height, PixelFormat::RGB8Packed, frame.data.clone()).unwrap();
    let profile = segment(&Picture::from_frame(&raw), &SegmentSettings::of_single_picture()).unwrap();
    let annotation = Annotation::from_mask(truth.clone());
    let expected = annotation.compare(&profile.mask, &profile.edge).unwrap();
    let rows = compared(dir.path());
    for picture in ["a.png", "b.png"] {
        let row = &rows[picture];
        let edge = expected.edge.unwrap();
        assert_eq!(row["outline"], "mask");
        assert_eq!(row["iou"], format!("{:.4}", found.iou(&truth)));
        assert_eq!(row["edge_error_mean_px"], format!("{:.4}", edge.mean_px));
        assert_eq!(row["edge_error_abs_p95_px"], format!("{:.4}", edge.p95_abs_px));
        assert_eq!(row["missed_area_px"], expected.missed_px.to_string());
    }
    let fins = annotation.fins_found(&body, &found).unwrap().unwrap();
    assert!(fins > 0.5 && fins < 1.0, "{fins}");
    assert_eq!((&rows["a.png"]["fins_found_share"], rows["b.png"]["fins_found_share"].as_str()), (&format!("{fins:.4}"), ""));
    // In the order of the command, with the figures of both pictures.
    let told = stdout(&output);
    let lines: Vec<&str> = told.lines().collect();
    assert!(lines[0].starts_with("picture") && lines[1].starts_with("b.png") && lines[2].starts_with("a.png"), "{told}");
    assert!(lines[3].starts_with("2 of 2 pictures compared"), "{told}");
}

#[test]
fn annotations_that_cannot_be_used_say_why_and_the_others_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    let annotated = dir.path().join("annotated");
    std::fs::create_dir(&annotated).unwrap();
    let grey = |name: &str, width: u32, height: u32, value: u8| {
        GrayImage::from_pixel(width, height, image::Luma([value])).save(annotated.join(name)).unwrap();
    };
    let text = |name: &str, text: &str| std::fs::write(annotated.join(name), text).unwrap();
    let contour = r#""fishContour": {"shape": {"name": "fineContour", "x": [3, 9, 9], "y": [4, 4, 12]}}"#;
    GrayImage::from_raw(513, 301, truth.data().to_vec()).unwrap().save(annotated.join("good.mask.png")).unwrap();
    grey("size.mask.png", 512, 301, 255);
    grey("labels.png", 513, 301, 1);
    grey("body.body.png", 513, 300, 255);
    grey("body.png", 513, 301, 255);
    text("damaged__SHAPES.json", &format!("{{{contour}"));
    text("other__SHAPES.json", &format!(r#"{{"imageDimensions": [1024, 200, 3], {contour}}}"#));
    text("outside__SHAPES.json", r#"{"fishContour": {"shape": {"name": "fineContour", "x": [3, 900, 9], "y": [4, 4, 12]}}}"#);
    text("excluded__SHAPES.json", &format!(r#"{{"enabled": 0, {contour}}}"#));
    text("text.mask.png", "no picture");
    colour(&frame).save(annotated.join("colour.truth.png")).unwrap();
    image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(513, 301, image::Luma([9])).save(annotated.join("deep.png")).unwrap();
    let cases = [
        ("absent", "no annotation; --compare has none of absent__SHAPES.json, absent.truth.png, absent.mask.png, absent.png"),
        ("size", "size.mask.png: it is 512 x 301 px, the picture is 513 x 301 px"),
        ("labels", "its largest value is 1"),
        ("body", "body.body.png: it is 513 x 300 px"),
        ("damaged", "damaged__SHAPES.json: it is not readable JSON"),
        ("other", "it is of a picture of 1024 x 200 px, this picture is 513 x 301 px"),
        ("outside", "fishContour goes to x = 900, y = 4, this picture is 513 x 301 px"),
        ("excluded", "excluded this picture"),
        ("text", "found no picture, expected PNG"),
        ("colour", "found 8 bits in 3 channels, expected a grey mask of 8 bits"),
        ("deep", "found 16 bits in 1 channels"),
        ("black", "no profile: "),
    ];
    let images: Vec<String> = cases.iter().map(|(name, _)| format!("{name}.bmp")).chain(["good.bmp".to_owned()]).collect();
    for image in &images {
        colour(&frame).save(dir.path().join(image)).unwrap();
    }
    GrayImage::from_pixel(513, 301, image::Luma([2])).save(dir.path().join("black.bmp")).unwrap();
    let images: Vec<&str> = images.iter().map(String::as_str).collect();
    let output = segment_files(dir.path(), &["--method", "level-set", "--compare", &annotated.display().to_string()], &images);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("1 of 13 pictures have no profile"), "{}", stderr(&output));
    assert!(stderr(&output).contains("11 of 13 pictures have no annotation that can be used"), "{}", stderr(&output));
    let told = stdout(&output);
    let counts = "1 of 13 pictures compared; 1 without a profile, 1 without an annotation, 10 with an annotation that cannot be used";
    assert!(told.contains(counts), "{told}");
    let rows = compared(dir.path());
    for (name, why) in cases {
        let row = &rows[&format!("{name}.bmp")];
        assert!(row["error"].contains(why) && row["iou"].is_empty(), "{name}: {}", row["error"]);
        assert!(told.lines().any(|line| line.starts_with(name) && line.contains(why)), "{name}: {told}");
    }
    let good = &rows["good.bmp"];
    assert!(good["iou"].parse::<f64>().unwrap() > 0.7 && good["error"].is_empty(), "{good:?}");
}

#[test]
fn annotations_that_would_be_ambiguous_or_replaced_are_refused_whole() {
    let dir = tempfile::tempdir().unwrap();
    let (frame, truth) = larva();
    colour(&frame).save(dir.path().join("a.png")).unwrap();
    for folder in ["one", "two", "out"] {
        std::fs::create_dir(dir.path().join(folder)).unwrap();
        GrayImage::from_raw(513, 301, truth.data().to_vec()).unwrap().save(dir.path().join(folder).join("a.mask.png")).unwrap();
    }
    std::fs::write(dir.path().join("a.txt"), "").unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    for (named, why) in [
        (&["none"][..], "No such file or directory"),
        (&["a.txt"], "expected the name STEM__SHAPES.json, STEM.truth.png, STEM.mask.png, STEM.png or STEM.body.png"),
        (&["one", "two/a.mask.png"], "have the same name; leave one of them out"),
        (&["out"], "a.mask.png is a result of this call and would be replaced; give another --out"),
    ] {
        let options: Vec<String> = named.iter().flat_map(|name| ["--compare".to_owned(), path(name)]).collect();
        let output = segment_files(dir.path(), &options.iter().map(String::as_str).collect::<Vec<_>>(), &["a.png"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(why), "{named:?}: {}", stderr(&output));
        assert_eq!(std::fs::read_dir(dir.path().join("out")).unwrap().count(), 1, "nothing is written");
    }
    // The folder of the pictures: the picture itself is no annotation of it.
    let output = segment_files(dir.path(), &["--compare", &dir.path().display().to_string()], &["a.png"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(compared(dir.path())["a.png"]["error"].contains("no annotation"), "{:?}", compared(dir.path()));
}
