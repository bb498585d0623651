//! From the pictures of a plate to a run: `carved import --plate`, then what works on every run.
//!
//! ```text
//!  scene ── crops under VAST's names ── import --plate ── run ─┬─ replay, measure
//!                                                              └─ page and API of a daemon
//! ```

use crate::common::{Daemon, json, run, stderr};
use hardware_sim::scene::{Camera, Exposure, Scene, SceneSettings, Specimen};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// A camera of VAST's crops, 1024 x 200 px with the capillary in the middle.
pub fn scene(specimen: Specimen) -> Scene {
    let camera = Camera { height: 200, uy_px: 99.5, ..Camera::default() };
    let scene = Scene::new(SceneSettings { camera, ..SceneSettings::default() });
    scene.load(Some(specimen)).unwrap();
    scene
}

/// Writes `pictures` pictures of a turn of `views`, of which the first has the number `first`.
pub fn shoot(scene: &Scene, pictures: u32, views: u32, name: impl Fn(u32) -> PathBuf) {
    shoot_from(0, scene, pictures, views, name);
}

/// The same by exposures from this number on. Each has its own noise, so that no two are the same picture.
fn shoot_from(first: u64, scene: &Scene, pictures: u32, views: u32, name: impl Fn(u32) -> PathBuf) {
    for i in 0..pictures {
        let angle_rad = std::f64::consts::TAU * f64::from(i) / f64::from(views);
        let frame = scene.render(&Exposure { angle_rad, number: first + u64::from(i) });
        let path = name(i);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::save_buffer(path, &frame.data, frame.width, frame.height, image::ColorType::Rgb8).unwrap();
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs the command. Returns its exit code, its lines of JSON and what it says.
fn import(args: &[&str]) -> (Option<i32>, Vec<Value>, String) {
    let output = run(&[&["import"], args].concat());
    let lines = output.stdout.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    (output.status.code(), lines, stderr(&output))
}

fn refused(args: &[&str]) -> String {
    let (code, _, said) = import(args);
    assert_eq!(code, Some(1), "{args:?}: {said}");
    said
}

/// Everything below a folder, with the lengths of the files.
fn tree(folder: &Path) -> Vec<(PathBuf, u64)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().map(Result::unwrap) {
        let kind = entry.file_type().unwrap();
        found.push((entry.path(), if kind.is_file() { entry.metadata().unwrap().len() } else { 0 }));
        if kind.is_dir() {
            found.extend(tree(&entry.path()));
        }
    }
    found.sort();
    found
}

/// A bead in A02, a larva of which one view is missing in B03, a broken picture in C04, two pictures of one view in D05, and a well of the
/// plate map without pictures.
#[test]
fn a_plate_of_vast_pictures_becomes_a_run_like_any_other() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("P-017"), dir.path().join("data"));
    let bead = scene(Specimen::bead(500.0).unwrap());
    shoot(&bead, 13, 12, |i| plate.join(format!("2021.10.11_5dpf_tail_W_A02_1_{}_rot.tiff", i + 1)));
    let larva = scene(Specimen::larva(4, 3).unwrap());
    shoot(&larva, 13, 12, |i| plate.join(format!("2021.10.11_5dpf_head_W_B03_1_{}_rot.tiff", i + 1)));
    fs::remove_file(plate.join("2021.10.11_5dpf_head_W_B03_1_8_rot.tiff")).unwrap();
    for view in 1..=13 {
        fs::copy(
            plate.join("2021.10.11_5dpf_tail_W_A02_1_1_rot.tiff"),
            plate.join(format!("2021.10.11_5dpf_tail_W_C04_1_{view}_rot.tiff")),
        )
        .unwrap();
        fs::copy(plate.join("2021.10.11_5dpf_tail_W_A02_1_1_rot.tiff"), plate.join(format!("2021.10.11_5dpf_tail_W_D05_1_{view}.tiff")))
            .unwrap();
    }
    fs::write(plate.join("2021.10.11_5dpf_tail_W_C04_1_5_rot.tiff"), "no picture").unwrap();
    fs::rename(plate.join("2021.10.11_5dpf_tail_W_D05_1_13.tiff"), plate.join("2021.10.11_5dpf_tail_W_D05_1_12_rot.tiff")).unwrap();
    fs::write(plate.join("overview.png"), "of the plate").unwrap();
    let map = dir.path().join("map.csv");
    fs::write(&map, "well,specimen,dpf,compound\nB03,larva,,DMSO\nA02,bead,,\nH12,larva,5,\n").unwrap();
    let (plate, data_text) = (text(&plate), text(&data));
    let before = tree(dir.path());
    let args = [
        &[plate, "--plate", "P-017", "--data", data_text, "--even", "--closure", "--voxel", "14", "--operator", "kim"][..],
        &["--plate-map", text(&map), "--plate-format", "384"],
    ]
    .concat();
    let small = [&args[..args.len() - 1], &["24", "--dry-run"]].concat();
    assert!(refused(&small).contains("H12 is not on a plate of 24 wells"), "{}", refused(&small));

    let output = run(&[&["import", "--dry-run"], &args[..]].concat());
    let dry = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    for line in [
        "well B03, fish 1, view 1, 5 dpf; the folder itself, date 2021.10.11",
        "13 views, 0.00 to 360.00 deg, the last repeats the first",
        "A02      13 pictures, bead, 5 dpf\n",
        "B03      12 pictures, larva, 5 dpf; missing: view 8\n",
        "C04      13 pictures, larva, 5 dpf; will fail: 2021.10.11_5dpf_tail_W_C04_1_5_rot.tiff: found no picture",
        "D05      13 pictures, larva, 5 dpf; missing: view 13; will fail: found 2 pictures of view 12",
        "H12      no picture; it will be skipped",
        "5 wells, 4 of them not whole; nothing was written",
    ] {
        assert!(dry.contains(line), "{line:?} in {dry}");
    }
    assert!(stderr(&output).contains("1 pictures are not imported") && stderr(&output).contains("overview.png"), "{}", stderr(&output));
    assert_eq!(tree(dir.path()), before, "a dry run writes nothing");

    let (code, lines, said) = import(&args);
    assert_eq!(code, Some(4), "{said}");
    let of: Vec<(&str, &str)> = lines[..5].iter().map(|l| (l["well"].as_str().unwrap(), l["outcome"].as_str().unwrap())).collect();
    let expected = [("B03", "succeeded"), ("A02", "succeeded"), ("H12", "skipped"), ("C04", "failed"), ("D05", "failed")];
    assert_eq!(of, expected, "{said}");
    assert_eq!((&lines[5]["outcome"], &lines[5]["succeeded"]), (&json!("partial"), &json!(2)));
    assert!(lines[3]["reason"].as_str().unwrap().contains("1 of 13 pictures cannot be used"), "{}", lines[3]);
    let folder = data.join("runs/P-017");
    assert_eq!(json(&folder.join("run.json"))["plan"]["plate_format"], json!(384));
    assert_eq!(fs::read_dir(data.join("runs")).unwrap().count(), 1, "nothing half-written is left");
    // The bead's truth is 500 um. 12 views at 5.5 um per px.
    let measured = json(&folder.join("A02/measurement.json"));
    let diameter = measured["measurement"]["sphere"]["diameter_um"].as_f64().unwrap();
    assert!((diameter / 500.0 - 1.0).abs() < 0.03, "{diameter} um");
    let hull_um3 = larva.truth().unwrap().hull_volume_um3;
    let volume_um3 = lines[0]["volume_um3"].as_f64().unwrap();
    assert!((volume_um3 / hull_um3 - 1.0).abs() < 0.06, "{volume_um3} um^3, ideal hull {hull_um3} um^3");
    // The missing view is missing, and the others stand at their own angles.
    let ledger = json(&folder.join("B03/recording.json"))["ledger"].clone();
    let angles: Vec<f64> = ledger.as_array().unwrap().iter().map(|e| e["omega"].as_f64().unwrap().to_degrees().round()).collect();
    assert_eq!(angles, [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0, 240.0, 270.0, 300.0, 330.0, 360.0]);
    assert!(json(&folder.join("B03/import.json"))["warnings"].to_string().contains("view 8"));
    assert_eq!(json(&folder.join("B03/recording.json"))["missing_views"], json!([8]));
    let flagged = |line: &Value| line["flags"].as_array().unwrap().iter().any(|flag| flag == "missing_views");
    assert!(flagged(&lines[0]) && !flagged(&lines[1]), "{} {}", lines[0], lines[1]);
    assert!(json(&folder.join("import.json"))["not_imported"].to_string().contains("overview.png"));

    // Once more: refused, and nothing is changed.
    let before = tree(dir.path());
    assert!(refused(&args).contains("the run is there already; nothing is overwritten. Give another name with --run"));
    assert_eq!(tree(dir.path()), before);

    let output = run(&["replay", text(&folder)]);
    let replayed = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success() && replayed.matches("identical, bit for bit").count() == 2, "{replayed}{}", stderr(&output));
    let output = run(&["measure", text(&folder)]);
    assert!(output.status.success() && String::from_utf8_lossy(&output.stdout).matches("\"stored\":\"identical\"").count() == 2);

    let daemon = Daemon::start(&data, &["--no-demo"]);
    let listed = &daemon.get("/v1/runs?mode=imported")["runs"][0];
    assert_eq!((&listed["id"], &listed["outcome"], &listed["operator"]), (&json!("P-017"), &json!("partial"), &json!("kim")));
    let detail = daemon.get("/v1/runs/P-017");
    let wells: Vec<&str> = detail["results"].as_array().unwrap().iter().map(|w| w["well"].as_str().unwrap()).collect();
    assert_eq!(wells, ["B03", "A02", "H12", "C04", "D05"]);
    assert_eq!((&detail["results"][0]["views"], &detail["results"][0]["views_planned"]), (&json!(11), &json!(12)));
    assert_eq!(detail["plan"]["plate_map"][0]["compound"], "DMSO");
    let specimen = daemon.get("/v1/runs/P-017/specimens/A02");
    assert_eq!(specimen["measurement"]["measurement"]["sphere"]["diameter_um"], measured["measurement"]["sphere"]["diameter_um"]);
    let links = |of: &str| specimen["links"][of].as_array().unwrap().len();
    assert_eq!((links("views"), links("profiles")), (12, 12), "{}", specimen["links"]);
    assert!(specimen["links"]["mesh_glb"].is_string(), "{}", specimen["links"]);
    // A run that is imported while the daemon serves is listed at once.
    let (code, _, said) = import(&[&args[..], &["--run", "P-017-again"]].concat());
    assert_eq!(code, Some(4), "{said}");
    let runs = daemon.get("/v1/runs?mode=imported");
    let ids: Vec<&str> = runs["runs"].as_array().unwrap().iter().map(|r| r["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["P-017-again", "P-017"]);
}

/// Folders of wells, four views without a repeat, and angles from the list that VAST's public program writes.
#[test]
fn folders_of_wells_and_vasts_own_list_of_angles_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("plate"), dir.path().join("data"));
    let bead = scene(Specimen::bead(400.0).unwrap());
    for (first, well) in [(0, "A01"), (100, "h12")] {
        shoot_from(first, &bead, 4, 4, |i| plate.join(format!("Well_{well}/VAST_1_{}.tiff", i + 1)));
    }
    let list = dir.path().join("external.txt");
    fs::write(&list, "no 0 0,00 1 1 no off\r\nno 0 90,00 1 1 no off\r\nno 0 180,00 1 1 no off\r\nno 0 270,00 1 1 no off\r\n").unwrap();
    let common = ["--plate", "P-2", "--specimen", "bead", "--voxel", "14", "--data", text(&data)];
    let (code, lines, said) = import(&[&[text(&plate), "--angles", text(&list)][..], &common].concat());
    assert_eq!((code, lines.len()), (Some(0), 3), "{said}");
    for well in ["A01", "H12"] {
        let ledger = json(&data.join(format!("runs/P-2/{well}/recording.json")))["ledger"].clone();
        let angles: Vec<f64> = ledger.as_array().unwrap().iter().map(|e| e["omega"].as_f64().unwrap().to_degrees().round()).collect();
        assert_eq!(angles, [0.0, 90.0, 180.0, 270.0], "{well}");
    }
    assert_eq!(json(&data.join("runs/P-2/run.json"))["method"]["asd"], 4);
    // The same by a pattern, with the camera of a configuration whose frames are larger.
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/simulated.toml");
    let pattern = ["--pattern", "Well_{well}/VAST_{fish}_{view}", "--config", config, "--even", "--run", "P-2b"];
    let (code, lines, said) = import(&[&[text(&plate)][..], &common, &pattern].concat());
    assert_eq!((code, lines.len()), (Some(0), 3), "{said}");
    assert!(said.contains("the pictures have 200 of the camera's 1024 rows"), "{said}");
}

/// What cannot be one plate is refused before anything is written.
#[test]
fn what_is_no_plate_is_refused_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let folder = |name: &str, pictures: &[&str]| {
        let folder = dir.path().join(name);
        for picture in pictures {
            let path = folder.join(picture);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let pixels: Vec<u8> = (0..64 * 64u32).map(|i| (150 + (i * 7919) % 13 + picture.len() as u32) as u8).collect();
            image::save_buffer(path, &pixels, 64, 64, image::ColorType::L8).unwrap();
        }
        folder
    };
    let four = ["W_A01_1_1.png", "W_A01_1_2.png", "W_A01_1_3.png", "W_A01_1_4.png"];
    let one = folder("one", &four);
    let two = folder("two", &["P1/W_A01_1_1.png", "P2/W_A01_1_1.png"]);
    let fish = folder("fish", &["W_A01_1_1.png", "W_A01_2_1.png", "W_A02_1_1.png"]);
    let odd = folder("odd", &["VAST_1_1.png", "VAST_1_2.png"]);
    let strange = folder("strange", &["picture1.png", "picture2.png"]);
    let gaps = folder("gaps", &["W_A01_1_1.png", "W_A01_1_2.png", "W_A01_1_9.png"]);
    let empty = folder("empty/none", &["x/W_A01_1_1.png"]);
    fs::remove_dir_all(empty.join("x")).unwrap();
    let huge = folder("huge", &four);
    fs::File::create(huge.join("W_A01_1_2.png")).unwrap().set_len(1 << 40).unwrap();
    let map = dir.path().join("map.csv");
    fs::write(&map, "well\nA99\n").unwrap();
    let before = tree(dir.path());
    for (folder, more, expected) in [
        (&one, &[][..], "no angles: give --cameras with omega"),
        (&one, &["--even", "--run", "../x"], "found \"../x\", expected a name"),
        (&one, &["--even", "--plate-map", text(&map)], "1 mistakes; correct them"),
        (&one, &["--even", "--dpf", "99"], "plate_map/0/dpf: 99 is not an age"),
        (&one, &["--even", "--views", "3"], "found view 4, expected the 3 views 1, 2, 3 of this plate"),
        (&one, &["--even", "--pattern", "{well}_x_{view}"], "found 4 pictures and no name that is understood, as"),
        (&one, &["--even", "--fish", "2"], "--fish 2: no well has it: A01 has fish 1"),
        (&one, &["--even", "--pattern", "{_}_{view}"], "4 pictures name no well"),
        (&two, &["--even"], "two plates"),
        (&fish, &["--even"], "1 of 2 wells have several fish, a run has one specimen per well: A01 has fish 1, 2"),
        (&odd, &["--even"], "2 pictures say fish and view, but no well: "),
        (&odd, &["--even"], "into a folder that is named after it, as A02/VAST_1_4.tiff"),
        (&strange, &["--even"], "give a --pattern for other names"),
        (&gaps, &["--even"], "which leave gaps; say with --views"),
        (&empty, &["--even"], "found no picture"),
        (&huge, &["--even"], "the file has 1048576 MB; expected a picture of 512 MB at most"),
        (&dir.path().join("nowhere"), &["--even"], "found no such file"),
    ] {
        let said = refused(&[&[text(folder), "--plate", "P-1", "--data", text(&data)], more].concat());
        assert!(said.contains(expected), "{more:?}: {said}");
        let now: Vec<_> = tree(dir.path()).into_iter().filter(|(path, _)| *path != data && *path != data.join("runs")).collect();
        assert_eq!(now, before, "{more:?}");
    }
    let output = run(&["import", text(&one), "--plate", "P-1", "--even", "--pattern", "{well}"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("found no {view}"), "{}", stderr(&output));
    let several = folder("several", &["A01_1.png", "A01_2.png", "A01_3.png", "A02_1.png", "A02_2.png", "A02_3.png"]);
    assert!(refused(&[text(&several), "--even"]).contains("the names say 2 wells, A01, A02; expected the pictures of one specimen"));
    let fishes: Vec<String> = (1..=2).flat_map(|fish| (1..=3).map(move |view| format!("VAST_{fish}_{view}.png"))).collect();
    let fishes = folder("fishes", &fishes.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(refused(&[text(&fishes), "--even"]).contains("the names say 2 fish, 1, 2; expected the pictures of one specimen"));
    let output = run(&["import", text(&one), "--even", "--dry-run"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("--plate <BARCODE>"), "{}", stderr(&output));
}

/// A program that stored the pictures of one well for two. Nothing says which of the wells they show.
#[test]
fn wells_with_the_same_pictures_give_no_number() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("plate"), dir.path().join("data"));
    let bead = scene(Specimen::bead(400.0).unwrap());
    for (first, well) in [(0, "A01"), (100, "A02"), (0, "A03")] {
        shoot_from(first, &bead, 4, 4, |i| plate.join(format!("{well}/VAST_1_{}.tiff", i + 1)));
    }
    let common = ["--plate", "P-4", "--specimen", "bead", "--voxel", "14", "--data", text(&data), "--even"];
    let (code, lines, said) = import(&[&[text(&plate)][..], &common].concat());
    assert_eq!(code, Some(4), "{said}");
    // The last line of a well counts.
    for well in ["A01", "A03"] {
        let last = lines.iter().rev().find(|line| line["well"] == well).unwrap();
        assert_eq!((&last["outcome"], &last["volume_um3"]), (&Value::from("failed"), &Value::Null), "{last}");
    }
    assert!(said.contains("wells A01 and A03 have the same pictures"), "{said}");
    let wells = json(&data.join("runs/P-4/run.json"))["wells"].clone();
    let outcomes: Vec<&Value> = wells.as_array().unwrap().iter().map(|well| &well["outcome"]).collect();
    assert_eq!(outcomes, ["failed", "succeeded", "failed"], "{wells:#}");
    assert_eq!((&wells[0]["volume_um3"], &wells[2]["volume_um3"]), (&Value::Null, &Value::Null), "{wells:#}");
}

/// The pictures of A02 are named in the reversed order. The rays of the camera spread, so they show that the capillary turned the other way.
#[test]
fn a_turn_in_the_other_sense_gives_no_number() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("plate"), dir.path().join("data"));
    let (larva, other) = (scene(Specimen::larva(4, 5).unwrap()), scene(Specimen::larva(4, 3).unwrap()));
    shoot(&larva, 13, 12, |i| plate.join(format!("A01/VAST_1_{}.png", i + 1)));
    shoot(&other, 13, 12, |i| plate.join(format!("A02/VAST_1_{}.png", 13 - i)));
    let (code, lines, said) = import(&[text(&plate), "--plate", "P-6", "--voxel", "14", "--data", text(&data), "--even", "--closure"]);
    assert_eq!(code, Some(4), "{said}");
    let last = |well: &str| lines.iter().rev().find(|line| line["well"] == well).unwrap().clone();
    assert_eq!((&last("A01")["outcome"], &last("A01")["flags"]), (&json!("succeeded"), &json!([])), "{said}");
    let reversed = last("A02");
    assert_eq!(
        (&reversed["outcome"], &reversed["volume_um3"], &reversed["flags"]),
        (&json!("failed"), &Value::Null, &json!(["wrong_sense"]))
    );
    assert!(reversed["reason"].as_str().unwrap().contains("a turn in the other sense"), "{reversed}");
    let stored = data.join("runs/P-6/A02");
    assert_eq!(json(&stored.join("measurement.json"))["quality"]["passed"], false);
    // Its number is in no statistics, whatever flags count.
    let statistics = dir.path().join("statistics.json");
    let output = run(&["export", "statistics", text(&data.join("runs/P-6")), "--with-flagged", "--out", text(&statistics)]);
    assert!(output.status.success(), "{}", stderr(&output));
    let volume = &json(&statistics)["quantities"][0];
    let left_out = &volume["left_out"][0];
    assert_eq!((&left_out["well"], &left_out["failed"], &volume["groups"][0]["n"]), (&json!("A02"), &json!(true), &json!(1)), "{volume:#}");
    // The same pictures, measured again.
    let output = run(&["measure", text(&stored)]);
    let measured: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &measured["flags"]), (Some(1), &json!(["wrong_sense"])), "{measured}");
}

/// One larva in two wells, in another format in the second, and another larva in a third.
#[test]
fn wells_with_the_same_larva_in_another_format_give_no_number() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("plate"), dir.path().join("data"));
    let (larva, other) = (scene(Specimen::larva(4, 3).unwrap()), scene(Specimen::larva(4, 5).unwrap()));
    shoot(&larva, 12, 12, |i| plate.join(format!("A01/VAST_1_{}.png", i + 1)));
    shoot(&other, 12, 12, |i| plate.join(format!("A02/VAST_1_{}.png", i + 1)));
    fs::create_dir_all(plate.join("A03")).unwrap();
    for i in 1..=12 {
        let picture = image::open(plate.join(format!("A01/VAST_1_{i}.png"))).unwrap().into_rgb8();
        let file = fs::File::create(plate.join(format!("A03/VAST_1_{i}.jpg"))).unwrap();
        picture.write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(file, 80)).unwrap();
    }
    let (code, lines, said) = import(&[text(&plate), "--plate", "P-5", "--voxel", "14", "--data", text(&data), "--even"]);
    assert_eq!(code, Some(4), "{said}");
    let last = |well: &str| lines.iter().rev().find(|line| line["well"] == well).unwrap().clone();
    let outcomes = ["A01", "A02", "A03"].map(|well| last(well)["outcome"].clone());
    assert_eq!(outcomes, ["failed", "succeeded", "failed"], "{said}");
    assert!(said.contains("wells A01 and A03 have the same pictures") && last("A03")["volume_um3"].is_null(), "{said}");
}

/// Two fish in A01 and one in A02, with one list of angles that names the files. The command is killed in the middle, and repeated.
#[test]
fn every_fish_becomes_a_run_and_an_interrupted_import_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (plate, data) = (dir.path().join("plate"), dir.path().join("data"));
    let bead = scene(Specimen::bead(400.0).unwrap());
    for (first, (well, fish)) in (0..).zip([("A01", 1), ("A01", 2), ("A02", 1), ("B01", 1), ("B02", 1)]) {
        shoot_from(100 * first, &bead, 4, 4, |i| plate.join(format!("{well}/VAST_{fish}_{}.tiff", i + 1)));
    }
    let list = dir.path().join("angles.csv");
    fs::write(&list, "file,degrees\nVAST_1_1.tiff,0\nVAST_1_2.tiff,90\nVAST_1_3,180\nVAST_1_4,270\n").unwrap();
    let args = ["import", text(&plate), "--plate", "P-3", "--specimen", "bead", "--voxel", "14", "--data", text(&data)];
    let said = refused(&[&args[1..], &["--even"]].concat());
    assert!(said.contains("A01 has fish 1, 2") && said.contains("--fish all"), "{said}");

    // Killed after the first well.
    let first = [&args[..], &["--fish", "1", "--run", "P-3-fish1", "--angles", text(&list)]].concat();
    let mut child =
        crate::common::carved().args(&first).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(child.stdout.take().unwrap()), &mut line).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    let before: Value = serde_json::from_str(&line).unwrap();
    let runs = data.join("runs");
    assert!(runs.join(".P-3-fish1.part/done/A01.json").is_file() && !runs.join("P-3-fish1").exists(), "{line}");
    let (code, lines, said) = import(&first[1..]);
    assert_eq!((code, &lines[0]), (Some(0), &before), "{said}");
    assert!(said.contains("A01: was imported before the interruption"), "{said}");
    assert!(!runs.join(".P-3-fish1.part").exists() && !runs.join("P-3-fish1/done").exists());
    let output = run(&["replay", text(&runs.join("P-3-fish1"))]);
    assert_eq!(String::from_utf8_lossy(&output.stdout).matches("identical, bit for bit").count(), 4, "{}", stderr(&output));

    // All fish: the run that is there stays as it is, and the other is made.
    let (code, lines, said) = import(&[&args[1..], &["--fish", "all", "--even"]].concat());
    assert_eq!((code, lines.len()), (Some(0), 2), "{said}");
    assert!(said.contains("the run P-3-fish1 is there already"), "{said}");
    assert_eq!(json(&runs.join("P-3-fish2/run.json"))["wells"].as_array().unwrap().len(), 1);
    assert_eq!(json(&runs.join("P-3-fish2/import.json"))["fish"], 2);
    let said = refused(&[&args[1..], &["--fish", "all", "--even"]].concat());
    assert!(said.contains("the runs of all 2 fish are there already"), "{said}");
    let output = run(&[&args[..], &["--fish", "some", "--even"]].concat());
    assert!(output.status.code() == Some(2) && stderr(&output).contains("expected the number of a fish, or all"));
}
