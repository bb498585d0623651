//! From a lab's own frames to numbers: `carved import`, then `carved measure`.
//!
//! ```text
//!  scene ── frames under odd names ── import ── recording ── measure ── beside the scene's truth
//! ```

use crate::common::{json, run, stderr};
use hardware_sim::scene::{Exposure, Scene, SceneSettings, Specimen};
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/simulated.toml");

/// Writes colour frames of a specimen at these angles, named by `name`, as a lab's program saves them.
fn frames(folder: &Path, specimen: Specimen, angles_deg: &[f64], name: impl Fn(usize) -> String) -> Scene {
    std::fs::create_dir_all(folder).unwrap();
    let scene = Scene::new(SceneSettings::default());
    scene.load(Some(specimen)).unwrap();
    for (i, angle) in angles_deg.iter().enumerate() {
        let frame = scene.render(&Exposure { angle_rad: angle.to_radians(), number: i as u64 });
        image::save_buffer(folder.join(name(i)), &frame.data, frame.width, frame.height, image::ColorType::Rgb8).unwrap();
    }
    scene
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a command and returns the lines of JSON that it printed.
fn lines(args: &[&str]) -> Vec<Value> {
    let output = run(args);
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    output.stdout.split(|b| *b == b'\n').filter(|l| !l.is_empty()).map(|l| serde_json::from_slice(l).unwrap()).collect()
}

fn refused(args: &[&str]) -> String {
    let output = run(args);
    assert!(!output.status.success(), "{args:?} was not refused: {}", String::from_utf8_lossy(&output.stdout));
    stderr(&output)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A turn in one file, as Fiji saves it, is the turn in single files.
#[test]
fn the_pages_of_one_file_are_the_views_of_a_turn() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("views");
    let angles: Vec<f64> = (0..12).map(|i| f64::from(i) * 30.0).collect();
    frames(&folder, Specimen::bead(500.0).unwrap(), &angles, |i| format!("v{i}.png"));
    let stack = dir.path().join("turn.ome.tif");
    let mut encoder = tiff::encoder::TiffEncoder::new_big(std::fs::File::create(&stack).unwrap()).unwrap();
    for i in 0..angles.len() {
        let frame = image::open(folder.join(format!("v{i}.png"))).unwrap().into_rgb8();
        encoder.write_image::<tiff::encoder::colortype::RGB8>(frame.width(), frame.height(), &frame).unwrap();
    }
    drop(encoder);
    let recording = |from: &Path, out: &str| {
        let out = dir.path().join(out);
        let told = lines(&["import", text(from), "--even", "--config", CONFIG, "--specimen", "bead", "--out", text(&out)]);
        (told[0].clone(), std::fs::read(out.join("frames/view_011.png")).unwrap(), json(&out.join("import.json")))
    };
    let (_, single, _) = recording(&folder, "single");
    let (told, of_stack, origin) = recording(&stack, "stack");
    assert_eq!(
        (&told["views"], &told["first"], &told["last"]),
        (&12.into(), &"turn.ome.tif page 01".into(), &"turn.ome.tif page 12".into())
    );
    assert!(of_stack == single);
    assert_eq!(origin["views"][4]["file"], "turn.ome.tif page 05");
    // Beside other files it is no view.
    std::fs::copy(&stack, folder.join("v12.tif")).unwrap();
    let error = refused(&["import", text(&folder), "--even", "--config", CONFIG, "--out", text(&dir.path().join("both"))]);
    assert!(error.contains("v12.tif") && error.contains("12 pages"), "{error}");
}

/// The frames of a colour camera whose mosaic begins with green and red. The recording names the format, and is measured in it.
#[test]
fn mosaics_of_another_camera_are_imported_in_their_order() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("mosaics");
    let angles: Vec<f64> = (0..12).map(|i| f64::from(i) * 30.0).collect();
    frames(&folder, Specimen::bead(500.0).unwrap(), &angles, |i| format!("v{i}.png"));
    for file in std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
        let rgb = image::open(&file).unwrap().into_rgb8();
        let grey = image::GrayImage::from_fn(rgb.width(), rgb.height(), |u, v| {
            let colours = rgb.get_pixel(u, v).0;
            let mosaic = [[colours[1], colours[0] / 4 * 3], [colours[2], colours[1]]];
            image::Luma([mosaic[v as usize % 2][u as usize % 2]])
        });
        grey.save(&file).unwrap();
    }
    let out = dir.path().join("A01");
    let common = ["import", text(&folder), "--even", "--config", CONFIG, "--specimen", "bead", "--voxel", "10", "--out", text(&out)];
    let error = refused(&[&common[..], &["--bayer"]].concat());
    assert!(error.contains("12 of 12 pictures") && error.contains("the green pixels of a mosaic rggb"), "{error}");
    lines(&[&common[..], &["--bayer=grbg"]].concat());
    assert_eq!(json(&out.join("recording.json"))["rig"]["pixel_format"], "BayerGR8");
    let measured = &lines(&["measure", text(&out)])[0];
    let diameter = measured["measurement"]["sphere"]["diameter_um"].as_f64().unwrap_or_else(|| panic!("{measured}"));
    assert!((diameter - 500.0).abs() < 3.0, "{diameter}");
}

/// 24 views of a bead, and even subsets of them, are compared with the truth. The frames of the recording reproduce its numbers.
#[test]
fn a_beads_frames_become_a_recording_that_measures() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("bead frames");
    let angles: Vec<f64> = (0..=24).map(|i| f64::from(i) * 15.0).collect();
    // In byte order b10 comes before b9.
    frames(&folder, Specimen::bead(500.0).unwrap(), &angles, |i| format!("Bead b{}.{}", i + 1, if i % 2 == 0 { "png" } else { "bmp" }));
    std::fs::write(folder.join("notes.txt"), "no picture").unwrap();
    let out = dir.path().join("bead");
    let common = ["--config", CONFIG, "--specimen", "bead", "--voxel", "10", "--well", "B03"];
    let told = lines(&[&["import", text(&folder), "--even", "--closure", "--out", text(&out)][..], &common].concat());
    assert_eq!((&told[0]["views"], &told[0]["closure"], &told[0]["last"]), (&24.into(), &true.into(), &"Bead b25.png".into()));
    assert_eq!(names(&out), ["SHA256SUMS", "frames", "import.json", "profiles", "recording.json"]);
    assert_eq!(names(dir.path()), ["bead", "bead frames"], "nothing half-written is left");
    let recording = json(&out.join("recording.json"));
    assert_eq!(
        (&recording["mode"], &recording["specimen"]["well"], &recording["truth"]),
        (&"imported".into(), &"B03".into(), &Value::Null)
    );
    for (i, entry) in recording["ledger"].as_array().unwrap().iter().enumerate() {
        assert!((entry["omega"].as_f64().unwrap().to_degrees() - angles[i]).abs() < 1e-9, "{entry}");
    }

    let measured = &lines(&["measure", text(&out)])[0];
    assert_eq!((&measured["stored"], &measured["mode"], &measured["asd"]), (&"none".into(), &"imported".into(), &24.into()));
    assert!(measured["closure"]["iou"].as_f64().unwrap() > 0.98, "{}", measured["closure"]);
    let diameter = |line: &Value| line["measurement"]["sphere"]["diameter_um"].as_f64().unwrap();
    assert!((diameter(measured) / 500.0 - 1.0).abs() < 0.015, "{} um, truth 500 um", diameter(measured));

    // A third of the views, with the tolerance for eight views.
    let part = &lines(&["measure", "--asd", "8", text(&out)])[0];
    assert_eq!((&part["stored"], &part["asd"], &part["captured"]), (&"not_compared".into(), &8.into(), &24.into()));
    assert_eq!((&part["measurement"]["planned_views"], part["views"].as_array().unwrap().len()), (&8.into(), 8));
    assert!((diameter(part) / 500.0 - 1.0).abs() < 0.03, "{} um", diameter(part));
    // One recording fails; the others are measured.
    let missing = dir.path().join("missing");
    let output = run(&["measure", "--asd", "5", text(&missing), text(&out)]);
    assert!(!output.status.success() && stderr(&output).contains("Possible numbers: 3, 4, 6, 8, 12, 24"), "{}", stderr(&output));
    let output = run(&["measure", "--asd", "3", text(&missing), text(&out)]);
    let printed: Vec<Value> = output.stdout.split(|b| *b == b'\n').filter_map(|l| serde_json::from_slice(l).ok()).collect();
    assert!(!output.status.success() && stderr(&output).contains("1 recording(s) could not be measured"), "{}", stderr(&output));
    assert!(printed[0]["error"].as_str().unwrap().contains("missing") && printed[1]["asd"] == 3, "{printed:?}");

    // The recording's own frames with its own angles.
    let views: Vec<PathBuf> = (0..24).map(|i| out.join(format!("frames/view_{i:03}.png"))).collect();
    let mut psi = recording["rig"]["camera"].clone();
    psi["omega"] = recording["ledger"].as_array().unwrap()[..24].iter().map(|e| e["omega"].clone()).collect();
    // The emulated rig has no glass. Without these words a thin wall would be assumed.
    psi["glass"] = serde_json::json!({"bore_radius_um": 325, "outer_radius_um": 325, "inside": 1.333, "glass": 1.474, "outside": 1.333});
    let camera = dir.path().join("camera.json");
    // As an editor of Windows stores it.
    std::fs::write(&camera, format!("\u{feff}{psi}")).unwrap();
    let again = dir.path().join("again");
    let named: Vec<&str> = views.iter().map(|p| text(p)).collect();
    let closure = out.join("frames/closure.png");
    let camera_args = ["--cameras", text(&camera), "--specimen", "bead", "--voxel", "10", "--out", text(&again)];
    lines(&[&["import"], &named[..], &camera_args].concat());
    let second = &lines(&["measure", text(&again)])[0];
    assert_eq!((&second["measurement"], &second["views"]), (&measured["measurement"], &measured["views"]));
    assert!(second["flags"].as_array().unwrap().contains(&"no_closure".into()), "{}", second["flags"]);
    let shuffled = refused(&[&["import"], &named[..], &[text(&closure), "--even", "--closure"]].concat());
    assert!(shuffled.contains("was named where") && shuffled.contains("closure.png comes by the order of names"), "{shuffled}");
    let said = refused(&["import", text(closure.parent().unwrap()), "--even"]);
    assert!(said.contains("frames' folder of a recording"), "{said}");
}

/// Uneven and descending angles of a larva, in rad in camera.json and as VAST's list.
#[test]
fn a_larvas_falling_uneven_turn_is_measured() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("frames");
    // The angles differ by up to 2 deg from even spacing, and are no multiples of a coarse step.
    let angles: Vec<f64> = (0..21).map(|i| -(f64::from(i) * 360.0 / 21.0 + 2.0 * (1.7 * f64::from(i)).sin())).collect();
    let scene = frames(&folder, Specimen::larva(4, 3).unwrap(), &angles, |i| format!("larve_{i}.png"));
    let hull_um3 = scene.truth().unwrap().hull_volume_um3;

    let list = dir.path().join("external.txt");
    let rows: String = angles.iter().map(|a| format!("1\t0\t{}\t1\t1\t0\t1\r\n", format!("{:.4}", -a).replace('.', ","))).collect();
    std::fs::write(&list, rows).unwrap();
    let out = dir.path().join("vast");
    let common = ["--config", CONFIG, "--dpf", "4", "--voxel", "10", "--sense", "-1"];
    lines(&[&["import", text(&folder), "--angles", text(&list), "--out", text(&out)][..], &common].concat());
    let recording = json(&out.join("recording.json"));
    assert_eq!((&recording["rig"]["sense"], &recording["specimen"]["dpf"]), (&(-1).into(), &4.0.into()));
    for (entry, angle) in recording["ledger"].as_array().unwrap().iter().zip(&angles) {
        let omega = entry["omega"].as_f64().unwrap();
        assert!((omega.to_degrees() - angle).abs() < 0.001, "{} deg for {angle}", omega.to_degrees());
        let [steps, per_turn] = [&entry["achieved_steps"], &recording["rig"]["steps_per_revolution"][0]].map(|x| x.as_f64().unwrap());
        assert!((omega + TAU * steps / per_turn).abs() < 1e-12, "the angle is that of the steps");
    }
    let measured = &lines(&["measure", text(&out)])[0];
    let volume_um3 = measured["measurement"]["volume_um3"].as_f64().unwrap();
    assert!((volume_um3 / hull_um3 - 1.0).abs() < 0.04, "{volume_um3} um^3, ideal hull {hull_um3} um^3");
}

/// Every bad input is named, and no files are left.
#[test]
fn what_cannot_be_imported_is_named_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("frames");
    std::fs::create_dir_all(&folder).unwrap();
    let save = |name: &str, width: u32| {
        let pixels: Vec<u8> = (0..width * 64).map(|i| (150 + (i * 7919) % 13 + name.len() as u32) as u8).collect();
        image::save_buffer(folder.join(name), &pixels, width, 64, image::ColorType::L8).unwrap();
    };
    for i in [1, 2, 3, 10] {
        save(&format!("v{i}.png"), 64);
    }
    let out = dir.path().join("out");
    let write = |name: &str, text: &str| {
        std::fs::write(dir.path().join(name), text).unwrap();
        dir.path().join(name)
    };
    let psi = |more: &str| format!(r#"{{"f": 60000, "kx": 0.18, "ky": 0.18, "ux": 31.5, "uy": 31.5, "width": 64, "height": 64{more}}}"#);
    let (two, deg) =
        (write("two.csv", "file,angle_deg\nv1.png,0\nv2.png,90\n"), write("deg.json", &psi(r#", "omega": [0, 90, 180, 270]"#)));
    let (wide, bare) = (write("wide.json", &psi("").replace("64", "65")), write("bare.json", &psi("")));
    let camera = |name: &str, from: &str, to: &str| write(name, &psi("").replace(from, to));
    let (mm, inverse) = (camera("mm.json", "60000", "60"), camera("inverse.json", "0.18", "5.5"));
    let (tiny, aside) = (camera("tiny.json", "0.18", "1e-9"), camera("aside.json", "\"uy\": 31.5", "\"uy\": 3e7"));
    let (unlike, tilted) = (camera("unlike.json", "\"ky\": 0.18", "\"ky\": 0.6"), write("tilted.json", &psi(r#", "gamma": 12"#)));
    let elsewhere = write("elsewhere.csv", "file,angle_deg\nv1.png,0\n../../x/v2.png,90\nv3.png,180\nv10.png,270\n");
    let film = write("film.csv", "file,time_s\nv1.png,10.0\nv2.png,10.7\nv3.png,11.4\nv10.png,12.1\n");
    let backwards = write("backwards.csv", "time_s\n10.0\n10.7\n10.7\n12.1\n");
    let same = write("same.txt", "4,32\n4,32\n4,32\n4,32\n");
    let before = names(dir.path());
    let import = |args: &[&str]| {
        let said = refused(&[&["import", text(&folder), "--out", text(&out)], args].concat());
        assert_eq!(names(dir.path()), before, "{args:?}");
        said
    };
    for (args, expected) in [
        (&[][..], "no angles"),
        (&["--even", "--closure", "--well", "AG1"], "--well: \"AG1\" is not a well"),
        (&["--even", "--dpf", "99"], "--dpf: 99"),
        (&["--even", "--epsilon", "0.7"], "--epsilon is 0.7"),
        (&["--even", "--voxel", "0"], "--voxel"),
        (&["--even", "--config", CONFIG], "1024 x 1024 px, the pictures 64 x 64 px"),
        (&["--even", "--method", "x"], "give --config too"),
        (&["--angles", text(&two)], "found no angle of v3.png, v10.png"),
        (&["--angles", text(&same)], "say --relative"),
        (&["--angles", text(&film)], "say with --turn-s how long a turn takes"),
        (&["--angles", text(&film), "--turn-s", "1.4"], "v10.png was taken 540.0 deg after the first picture"),
        (&["--angles", text(&film), "--turn-s", "0"], "expected a time above 0 s"),
        (&["--angles", text(&backwards), "--turn-s", "2.8"], "the time of v3.png is not after that of the picture before it"),
        (&["--angles", text(&same), "--turn-s", "2.8"], "has no column time_s"),
        (&["--cameras", text(&deg)], "go around 43 times"),
        (&["--cameras", text(&deg), "--even"], "--cameras gives omega and --even other angles"),
        (&["--cameras", text(&wide), "--even"], "65 x 65 px, the pictures 64 x 64 px"),
        (&["--cameras", text(&bare)], "no angles"),
        (&["--cameras", text(&mm), "--even"], "f is 60 um"),
        (&["--cameras", text(&inverse), "--even"], "kx is 5.5 px per um, so that a pixel is 1.818e-1 um; expected 0.25 to 100 um"),
        (&["--cameras", text(&tiny), "--even"], "a pixel is 1.000e9 um"),
        (&["--cameras", text(&aside), "--even"], "uy is 30000000 px; expected a row of the picture, 0 to 63"),
        (&["--cameras", text(&unlike), "--even"], "kx is 0.18 and ky 0.6 px per um"),
        (&["--cameras", text(&tilted), "--even"], "gamma is 12 rad, 687.5 deg"),
        (&["--angles", text(&elsewhere)], "line 3: found \"../../x/v2.png\", which leads out of a folder"),
        (&["--even", "--empty", text(&dir.path().join("none.png"))], "none.png: cannot be read"),
    ] {
        let said = import(args);
        assert!(said.contains(expected), "{args:?}: {said}");
    }
    save("v4.png", 63);
    assert!(import(&["--even"]).contains("v4.png is 63 x 64 px Mono8"));
    std::fs::write(folder.join("v4.png"), "no picture").unwrap();
    assert!(import(&["--even"]).contains("v4.png"));
    std::fs::remove_file(folder.join("v4.png")).unwrap();
    save("v3.bmp", 64);
    assert!(import(&["--even"]).contains("have one name"));
    std::fs::remove_file(folder.join("v3.bmp")).unwrap();

    // v10 follows v3: the command says so and records it. An existing output is not overwritten.
    let output = run(&["import", text(&folder), "--even", "--out", text(&out)]);
    assert!(output.status.success() && stderr(&output).contains("v10.png follows v3.png"), "{}", stderr(&output));
    assert!(json(&out.join("import.json"))["warnings"].to_string().contains("v10.png follows v3.png"));
    assert!(refused(&["import", text(&folder), "--even", "--out", text(&out)]).contains("nothing is overwritten"));

    // A film of a turn at a constant speed.
    let filmed = dir.path().join("filmed");
    let output = run(&["import", text(&folder), "--angles", text(&film), "--turn-s", "2.8", "--out", text(&filmed)]);
    assert!(output.status.success(), "{}", stderr(&output));
    let omegas = |of: &Path| {
        let ledger = json(&of.join("recording.json"))["ledger"].clone();
        ledger.as_array().unwrap().iter().map(|e| e["omega"].as_f64().unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(omegas(&filmed), omegas(&out), "a quarter of a turn in 0.7 s");
}
