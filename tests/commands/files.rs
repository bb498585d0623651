//! `carved export nrrd`, `stl`, `glb`, `ome-tiff` and `ome-zarr`, opened by the programs of others.
//!
//! ```text
//!  scene ── pictures of a plate ── import --plate ── run ── export ─┬─ pynrrd, SimpleITK, trimesh
//!                                                                   ├─ tifffile, ome-types, roifile
//!                                                                   └─ zarr, ome-zarr-models, ome-zarr-py, ngio
//! ```

use crate::common::{carved, copy_folder, json, stderr, strict, venv};
use hardware_sim::scene::{Camera, Exposure, Scene, SceneSettings, Specimen};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// Views of a turn; a picture at 360 deg follows.
const VIEWS: u32 = 12;

/// A run of pictures in `dir`: a bead in A02 and a larva in B03, measured. A01 is planned and has no picture. It is made once, and copied.
pub fn plate(dir: &Path) -> PathBuf {
    static MADE: LazyLock<PathBuf> = LazyLock::new(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("plate-of-files");
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        fs::create_dir_all(&folder).unwrap();
        make_plate(&folder);
        folder
    });
    assert!(Command::new("cp").arg("-a").arg(MADE.join(".")).arg(dir).status().unwrap().success());
    dir.join("data/runs/P-017")
}

fn make_plate(dir: &Path) {
    let (pictures, data) = (dir.join("P-017"), dir.join("data"));
    fs::create_dir_all(&pictures).unwrap();
    for (well, specimen) in [("A02", Specimen::bead(500.0).unwrap()), ("B03", Specimen::larva(4, 3).unwrap())] {
        let camera = Camera { height: 200, uy_px: 99.5, ..Camera::default() };
        let scene = Scene::new(SceneSettings { camera, ..SceneSettings::default() });
        scene.load(Some(specimen)).unwrap();
        for i in 0..=VIEWS {
            let frame =
                scene.render(&Exposure { angle_rad: std::f64::consts::TAU * f64::from(i) / f64::from(VIEWS), number: u64::from(i) });
            let path = pictures.join(format!("2021.10.11_5dpf_head_W_{well}_1_{}_rot.tiff", i + 1));
            image::save_buffer(path, &frame.data, frame.width, frame.height, image::ColorType::Rgb8).unwrap();
        }
    }
    let map = dir.join("map.csv");
    fs::write(&map, "well,specimen,dpf,compound,control,replicate,Clutch\nA01,larva,5,,,,\nA02,bead,,,,,\nB03,larva,5,\"DMSO <\u{b5}> & co\",negative,2,c \"7\"\n").unwrap();
    // The emulated rig has no glass. Without these words a thin wall would be assumed.
    let clear = serde_json::json!({"bore_radius_um": 325, "outer_radius_um": 325, "inside": 1.333, "glass": 1.474, "outside": 1.333});
    let mut published = serde_json::to_value(carved_core::geometry::Camera::published(1024, 200)).unwrap();
    published["glass"] = clear;
    let cameras = dir.join("camera.json");
    fs::write(&cameras, published.to_string()).unwrap();
    let mut command = carved();
    command.arg("import").arg(&pictures).arg("--cameras").arg(&cameras);
    command.args(["--plate", "P-017", "--even", "--closure", "--voxel", "14", "--operator", "kim", "--data"]);
    let output = command.arg(&data).arg("--plate-map").arg(&map).output().unwrap();
    // 4: a well was skipped.
    assert!(matches!(output.status.code(), Some(0 | 4)), "{}", stderr(&output));
}

fn done(output: &Output) {
    assert!(output.status.success(), "{}", stderr(output));
}

/// `carved export FORMAT INPUT --out FILE MORE`.
fn export(format: &str, input: &Path, out: &Path, more: &[&str]) -> Output {
    carved().args(["export", format]).arg(input).arg("--out").arg(out).args(more).output().unwrap()
}

/// The Python with the readers. It is installed once: tests run at the same time.
static READERS: LazyLock<Result<PathBuf, String>> = LazyLock::new(|| {
    let modules = "nrrd, SimpleITK, trimesh, tifffile, roifile, ome_types, zarr, ome_zarr_models, ome_zarr, ngio, PIL, biomero_schema";
    venv::python("files", modules, "tests/readers/requirements-files.txt")
});

/// Runs a program of `tests/readers`. `false`: it cannot be run here, which was reported.
fn read(program: &str, args: &[&Path]) -> bool {
    let python = match &*READERS {
        Ok(python) => python,
        Err(why) => {
            strict::cannot_run(&format!("the readers of exported files cannot be installed: {why}"));
            return false;
        }
    };
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers").join(program);
    let output = Command::new(python).arg(program).args(args).output().unwrap();
    assert!(output.status.success() && output.stdout.ends_with(b"read\n"), "{}", stderr(&output));
    true
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn nrrd_stl_and_glb_have_the_size_and_the_place_of_the_model() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    for well in ["A02", "B03"] {
        let (recording, files) = (run.join(well), dir.path().join(well));
        fs::create_dir(&files).unwrap();
        for stored in ["measurement.json", "mesh.ply", "model.glb"] {
            fs::copy(recording.join(stored), files.join(stored)).unwrap();
        }
        done(&export("nrrd", &recording, &files.join("model.nrrd"), &[]));
        done(&export("stl", &recording, &files.join("model.stl"), &[]));
        for unit in ["m", "mm", "um"] {
            done(&export("glb", &recording, &files.join(format!("{unit}.glb")), &["--unit", unit]));
        }
        done(&export("glb", &recording, &files.join("texture.glb"), &["--texture"]));
        if !read("read_models.py", &[&files, &recording]) {
            return;
        }
    }
}

#[test]
fn a_model_that_cannot_be_exported_is_refused_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let well = run.join("A02");
    let refused = |format: &str, input: &Path, out: &str| {
        let out = dir.path().join(out);
        let output = export(format, input, &out, &[]);
        assert!(!output.status.success() && !out.exists(), "{format}");
        stderr(&output)
    };
    for format in ["nrrd", "stl", "glb"] {
        assert!(refused(format, &well, "model.txt").contains(&format!("ends in .{format}")));
        assert!(refused(format, &run.join("H01"), &format!("model.{format}")).contains("recording.json"));
    }
    // A folder with many recordings: the message names one.
    let runs = run.parent().unwrap();
    for (folder, what) in [(&*run, "is a run"), (runs, "holds runs"), (runs.parent().unwrap(), "holds runs")] {
        for (format, out) in [("nrrd", "model.nrrd"), ("stl", "model.stl"), ("ome-tiff", "views.ome.tiff")] {
            // A run is a plate for this command.
            if format == "ome-tiff" && folder == &*run {
                continue;
            }
            let said = refused(format, folder, out);
            assert!(said.contains(&format!("{} {what}. ", folder.display())), "{said}");
            assert!(said.contains(&format!("such as {}", well.display())), "{said}");
        }
    }
    // Somebody changed the surface: it is not what was measured.
    let mesh = well.join("mesh.ply");
    let bytes = fs::read(&mesh).unwrap();
    let mut changed = bytes.clone();
    *changed.last_mut().unwrap() ^= 1;
    fs::write(&mesh, &changed).unwrap();
    assert!(refused("stl", &well, "model.stl").contains("was altered"));
    fs::write(&mesh, &bytes).unwrap();
    let out = dir.path().join("model.stl");
    done(&export("stl", &well, &out, &["--unit", "um"]));
    assert!(fs::read(&out).unwrap().starts_with(b"carved unit um imported estimator field A02 "));
    // A recording without a surface is computed: the same surface.
    let of_mesh = fs::read(&out).unwrap();
    let bare = dir.path().join("bare");
    fs::create_dir(&bare).unwrap();
    fs::copy(well.join("recording.json"), bare.join("recording.json")).unwrap();
    copy_folder(&well.join("frames"), &bare.join("frames"));
    done(&export("stl", &bare, &out, &["--unit", "um"]));
    assert!(fs::read(&out).unwrap() == of_mesh, "the computed surface is another one");
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn an_ome_tiff_has_the_pixels_the_angles_the_scale_and_the_well() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let refused = export("ome-tiff", &run.join("B03"), &dir.path().join("B03.tiff"), &[]);
    assert!(!refused.status.success() && stderr(&refused).contains("ends in .ome.tiff"), "{}", stderr(&refused));
    for well in ["A02", "B03"] {
        let out = dir.path().join(format!("{well}.ome.tiff"));
        done(&export("ome-tiff", &run.join(well), &out, &[]));
        if !read("read_ome_tiff.py", &[&run.join(well), &out]) {
            return;
        }
    }
}

/// What a person, or another program, may have written into any text of a recording.
fn nasty() -> String {
    let letters = "\u{b5}M <Wnt> & \"β\" 'c' ]]> <!-- &amp; &#0; \u{1f41f}\u{0}\u{1}\u{b}\t\n\u{7f}\u{85}\u{fffe}\u{ffff}\u{202e}";
    format!("{letters}{}", "x<&".repeat(3400))
}

/// A01 has no view. Every text of the run and of its recordings is `nasty`, but for names that are checked when they are read.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn a_plate_is_one_ome_tiff_that_the_schema_allows_whatever_its_texts_say() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let plain = dir.path().join("plain.ome.tiff");
    done(&export("ome-tiff", &run, &plain, &["--outlines", "--labels"]));
    for well in ["A02", "B03"] {
        fs::remove_file(run.join(well).join("SHA256SUMS")).unwrap();
        let file = run.join(well).join("recording.json");
        let mut recording = json(&file);
        recording["started"] = nasty().into();
        for text in ["compound", "strain", "treatment"] {
            recording["specimen"][text] = nasty().into();
        }
        recording["rig"]["name"] = nasty().into();
        recording["software"]["version"] = nasty().into();
        fs::write(&file, recording.to_string()).unwrap();
    }
    let mut record = json(&run.join("run.json"));
    record["plan"]["metadata"] = serde_json::json!({"columns": {nasty(): {"A02": nasty(), "B03": nasty()}}});
    fs::write(run.join("run.json"), record.to_string()).unwrap();
    let out = dir.path().join("nasty.ome.tiff");
    done(&export("ome-tiff", &run, &out, &[]));
    let text = dir.path().join("nasty.txt");
    fs::write(&text, nasty()).unwrap();
    if !read("read_plate_tiff.py", &[&run, &plain, &out, &text]) {
        return;
    }
    // Named wells, and names that are none.
    let part = dir.path().join("part.ome.tiff");
    let of_wells = |wells: &[&str]| carved().args(["export", "ome-tiff"]).arg(&run).args(wells).arg("--out").arg(&part).output().unwrap();
    for (well, why) in [("H12", "is no well of the run"), ("A01", "nothing was recorded of well A01")] {
        let refused = of_wells(&[well]);
        assert!(!refused.status.success() && !part.exists() && stderr(&refused).contains(why), "{}", stderr(&refused));
    }
    done(&of_wells(&["B03"]));
    assert!(part.metadata().unwrap().len() < out.metadata().unwrap().len());
    // A frame that was altered leaves no file, not even a part of one.
    fs::copy(run.join("A02/frames/view_004.png"), run.join("A02/frames/view_003.png")).unwrap();
    fs::remove_file(&out).unwrap();
    let refused = export("ome-tiff", &run, &out, &[]);
    assert!(!refused.status.success() && stderr(&refused).contains("view_003.png: its SHA-256 is"), "{}", stderr(&refused));
    let left: Vec<_> =
        fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).filter(|n| n.to_string_lossy().contains("nasty.ome")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn outlines_labels_and_voxels_are_opened_in_the_world_of_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    for well in ["A02", "B03"] {
        let (recording, files) = (run.join(well), dir.path().join(well));
        fs::create_dir(&files).unwrap();
        done(&export("rois", &recording, &files.join("rois.zip"), &[]));
        done(&export("ome-tiff", &recording, &files.join("views.ome.tiff"), &["--outlines", "--labels"]));
        done(&export("voxels", &recording, &files.join("voxels.ome.zarr"), &[]));
        let again = export("voxels", &recording, &files.join("voxels.ome.zarr"), &[]);
        assert!(!again.status.success() && stderr(&again).contains("exists already"), "{}", stderr(&again));
        if !read("read_world.py", &[&recording, &files]) {
            return;
        }
    }
}

/// The study file of a run of larvae, by the models that the `BioImage` Archive publishes: what they miss is what the file names.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn a_study_file_has_what_the_run_knows_and_names_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let (imported, taken) = (dir.path().join("imported.json"), dir.path().join("taken.json"));
    done(&export("rembi", &run, &imported, &[]));
    // A run of the instrument knows its camera and axis.
    let as_if = |mode: &str| {
        let mut record = json(&run.join("run.json"));
        record["mode"] = mode.into();
        fs::write(run.join("run.json"), record.to_string()).unwrap();
    };
    as_if("hardware");
    done(&export("rembi", &run, &taken, &[]));
    as_if("simulated");
    let refused = export("rembi", &run, &dir.path().join("none.json"), &[]);
    assert!(!refused.status.success() && stderr(&refused).contains("the run P-017 is simulated"), "{}", stderr(&refused));
    as_if("imported");
    let python = match venv::python("rembi", "bia_rembi_models", "tests/readers/requirements-rembi.txt") {
        Ok(python) => python,
        Err(why) => return strict::cannot_run(&format!("the models of REMBI cannot be installed: {why}")),
    };
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/validate_rembi.py");
    let output = Command::new(python).arg(program).args([&imported, &taken]).output().unwrap();
    assert!(output.status.success() && output.stdout.ends_with(b"read\n"), "{}", stderr(&output));
    // A plate of beads has no biological sample.
    let mut record = json(&run.join("run.json"));
    record["plan"]["plate_map"].as_array_mut().unwrap().retain(|well| well["specimen"] == "bead");
    fs::write(run.join("run.json"), record.to_string()).unwrap();
    let refused = export("rembi", &run, &dir.path().join("none.json"), &[]);
    assert!(!refused.status.success() && stderr(&refused).contains("no larva"), "{}", stderr(&refused));
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn the_descriptor_of_biomero_is_valid_and_describes_the_program() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/biomero");
    read("validate_biomero.py", &[&folder, Path::new(env!("CARGO_PKG_VERSION"))]);
}

/// Every file of the list is the frame of its view, by the hash of its pixels.
#[test]
fn the_list_for_cellprofiler_names_each_frame_with_its_well_and_view() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let out = dir.path().join("load_data.csv");
    done(&export("loaddata", &run, &out, &[]));
    let mut list = csv::Reader::from_path(&out).unwrap();
    let rows: Vec<BTreeMap<String, String>> = list.deserialize().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2 * VIEWS as usize);
    for row in &rows {
        let recording = json(&run.join(&row["Metadata_Well"]).join("recording.json"));
        let ledger = recording["ledger"].as_array().unwrap();
        let entry = ledger.iter().find(|e| e["closure"] == false && e["view"].as_u64() == row["Metadata_View"].parse().ok()).unwrap();
        let picture = |name: &str| {
            image::open(Path::new(&row[&format!("Image_PathName_{name}")]).join(&row[&format!("Image_FileName_{name}")])).unwrap()
        };
        let hash = carved_records::sha256_hex(picture("Frame").as_bytes());
        assert_eq!(entry["sha256"], hash, "{row:?}");
        assert_eq!(picture("Profile").width(), picture("Frame").width());
        let degrees: f64 = row["Metadata_AngleDeg"].parse().unwrap();
        assert!((degrees - entry["omega"].as_f64().unwrap().to_degrees()).abs() < 1e-9);
        assert_eq!((row["Metadata_Plate"].as_str(), row["Metadata_Run"].as_str()), ("P-017", "P-017"));
        let of_larva =
            if row["Metadata_Well"] == "B03" { ["larva", "5.0", "DMSO <\u{b5}> & co", "negative"] } else { ["bead", "5.0", "", ""] };
        assert_eq!(["Specimen", "Dpf", "Compound", "Control"].map(|name| row[&format!("Metadata_{name}")].as_str()), of_larva);
        // The lab's own column.
        assert_eq!(row["Metadata_Clutch"], if row["Metadata_Well"] == "B03" { "c \"7\"" } else { "" });
    }
    // CellProfiler cannot read inside a pack.
    let copies = dir.path().join("copies");
    done(&archive(&run, &copies));
    let refused = export("loaddata", &copies.join("P-017"), &dir.path().join("none.csv"), &[]);
    assert!(!refused.status.success() && stderr(&refused).contains("tar -xf"), "{}", stderr(&refused));
    // LoadData stops at a row without the file of an image.
    fs::remove_file(Path::new(&rows[0]["Image_PathName_Profile"]).join(&rows[0]["Image_FileName_Profile"])).unwrap();
    let fewer = export("loaddata", &run, &out, &[]);
    assert!(fewer.status.success() && stderr(&fewer).contains("1 view(s) without a profile"), "{}", stderr(&fewer));
    assert_eq!(csv::Reader::from_path(&out).unwrap().records().count(), rows.len() - 1);
}

/// A run that was copied under another name.
#[test]
fn pictures_that_two_runs_have_in_common_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let copy = dir.path().join("P-018");
    assert!(Command::new("cp").arg("-a").args([&run, &copy]).status().unwrap().success());
    let mut record = json(&copy.join("run.json"));
    record["id"] = "P-018".into();
    fs::write(copy.join("run.json"), record.to_string()).unwrap();
    let table = |runs: &[&Path]| carved().args(["export", "table"]).args(runs).output().unwrap();
    let alone = table(&[&run]);
    done(&alone);
    assert!(!stderr(&alone).contains("in common"), "{}", stderr(&alone));
    let both = table(&[&run, &copy]);
    done(&both);
    for well in ["A02", "B03"] {
        let expected = format!("P-017 {well} and P-018 {well} have {} picture(s) in common", VIEWS + 1);
        assert!(stderr(&both).contains(&expected), "{expected}: {}", stderr(&both));
    }
}

/// All files below a folder with their bytes.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            found.extend(tree(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

/// The first planned well has no view, and the turn of the last one was ended early.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn an_ome_zarr_plate_is_valid_with_empty_wells_and_with_turns_that_ended_early() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let well = run.join("B03");
    fs::remove_file(well.join("SHA256SUMS")).unwrap();
    let mut recording = json(&well.join("recording.json"));
    recording["ended_after_views"] = 10.into();
    recording["ledger"].as_array_mut().unwrap().retain(|entry| entry["closure"] == true || entry["view"].as_u64().unwrap() < 10);
    fs::write(well.join("recording.json"), recording.to_string()).unwrap();
    for view in ["frames/view_010.png", "frames/view_011.png", "profiles/view_010.png", "profiles/view_011.png"] {
        fs::remove_file(well.join(view)).unwrap();
    }
    let views = PathBuf::from(VIEWS.to_string());
    let whole = dir.path().join("whole.ome.zarr");
    done(&export("ome-zarr", &run, &whole, &[]));
    if !read("read_plate.py", &[&run, &whole, &views]) {
        return;
    }
    // An export that was killed in the second well: its files are there in part, and the plate does not list it.
    let parts = dir.path().join("parts.ome.zarr");
    done(&carved().args(["export", "ome-zarr"]).arg(&run).args(["A02", "--out"]).arg(&parts).output().unwrap());
    fs::create_dir_all(parts.join("B/3/0/0/c/0/0/0")).unwrap();
    fs::write(parts.join("B/3/0/0/c/0/0/0/0"), b"cut short").unwrap();
    let listed = |plate: &Path| json(&plate.join("zarr.json"))["attributes"]["ome"]["plate"]["wells"].as_array().unwrap().len();
    assert_eq!((listed(&parts), listed(&whole)), (1, 2));
    assert_eq!(json(&whole.join("zarr.json"))["attributes"]["ome"]["plate"]["version"], "0.5");
    done(&export("ome-zarr", &run, &parts, &[]));
    let relative = |plate: &Path| -> BTreeMap<PathBuf, Vec<u8>> {
        tree(plate).into_iter().map(|(path, bytes)| (path.strip_prefix(plate).unwrap().to_owned(), bytes)).collect()
    };
    assert!(relative(&parts) == relative(&whole), "an export that goes on gives the same files");
}

#[test]
fn an_ome_zarr_plate_does_not_replace_what_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let refused = |run: &Path, out: &Path, wells: &[&str]| {
        let output = export("ome-zarr", run, out, wells);
        assert!(!output.status.success());
        stderr(&output)
    };
    let out = dir.path().join("plate.ome.zarr");
    assert!(refused(&run, &dir.path().join("plate.zarr"), &[]).contains("ends in .ome.zarr"));
    assert!(refused(&run, &out, &["H12"]).contains("H12"));
    assert!(refused(&run, &out, &["A01"]).contains("nothing was recorded of well A01"));
    fs::create_dir(&out).unwrap();
    assert!(refused(&run, &out, &[]).contains("exists already"));
    fs::write(
        out.join("zarr.json"),
        r#"{"zarr_format": 3, "node_type": "group", "attributes": {"carved": {"run": "other", "views": 12}}}"#,
    )
    .unwrap();
    assert!(refused(&run, &out, &[]).contains("it holds another plate (run \"other\", 12 views)"));
    // A frame that was altered is not exported.
    let frame = run.join("A02/frames/view_003.png");
    fs::copy(run.join("A02/frames/view_004.png"), &frame).unwrap();
    assert!(refused(&run, &dir.path().join("new.ome.zarr"), &[]).contains("view_003.png: its SHA-256 is"));
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(output))
}

fn archive(run: &Path, to: &Path) -> Output {
    carved().arg("archive").arg(run).arg("--to").arg(to).arg("--pack").output().unwrap()
}

/// What `carved measure` prints, without the names of the recordings.
fn measured(recordings: &Path) -> Vec<String> {
    let output = carved().arg("measure").arg(recordings).output().unwrap();
    done(&output);
    let lines = String::from_utf8(output.stdout).unwrap();
    lines.lines().map(|line| line.split_once(",\"well\"").unwrap().1.to_owned()).collect()
}

#[test]
fn a_packed_run_has_a_file_per_recording_and_is_read_as_the_folders_are() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    // An earlier attempt is a recording, too.
    let copied = Command::new("cp").arg("-a").arg(run.join("A02")).arg(run.join("A02.attempt-1")).status().unwrap();
    assert!(copied.success());
    let copies = dir.path().join("copies");
    done(&archive(&run, &copies));
    let copy = copies.join("P-017");
    let names: Vec<String> = tree(&copy).into_keys().map(|path| path.strip_prefix(&copy).unwrap().display().to_string()).collect();
    assert_eq!(names, ["A02.attempt-1.tar", "A02.tar", "B03.tar", "archive.json", "import.json", "run.json"]);

    // Lossless, by the programs of every system.
    let unpacked = dir.path().join("unpacked");
    fs::create_dir(&unpacked).unwrap();
    for recording in ["A02", "A02.attempt-1", "B03"] {
        let tar = Command::new("tar").arg("-xf").arg(copy.join(format!("{recording}.tar"))).current_dir(&unpacked).status().unwrap();
        assert!(tar.success());
        let checked =
            Command::new("sha256sum").args(["--quiet", "-c", "SHA256SUMS"]).current_dir(unpacked.join(recording)).status().unwrap();
        assert!(checked.success());
        let relative = |folder: &Path| -> BTreeMap<PathBuf, Vec<u8>> {
            tree(folder).into_iter().map(|(path, bytes)| (path.strip_prefix(folder).unwrap().to_owned(), bytes)).collect()
        };
        assert!(relative(&unpacked.join(recording)) == relative(&run.join(recording)), "{recording}");
    }

    // The same bytes from both.
    let (of_run, of_copy) = (measured(&run), measured(&copy));
    assert_eq!(of_run.len(), 3);
    assert!(of_run.iter().all(|line| line.contains("\"stored\":\"identical\"")) && of_run == of_copy);
    assert!(measured(&copy.join("B03")) == measured(&copy.join("B03.tar")), "by the name of its folder, too");
    let replayed = carved().arg("replay").arg(&copy).output().unwrap();
    assert_eq!(said(&replayed).matches("identical, bit for bit (measurement.json, mesh.ply)").count(), 3, "{}", said(&replayed));
    for (format, ending) in [("stl", "stl"), ("glb", "glb"), ("nrrd", "nrrd"), ("ome-tiff", "ome.tiff")] {
        let files = [&run, &copy].map(|of| {
            let out = dir.path().join(format!("B03.{ending}"));
            done(&export(format, &of.join("B03"), &out, &[]));
            fs::read(out).unwrap()
        });
        assert!(files[0] == files[1], "{format}");
    }
    let out = dir.path().join("table.csv");
    let tables = [&run, &copy].map(|of| {
        done(&export("table", of, &out, &[]));
        fs::read(&out).unwrap()
    });
    assert!(tables[0] == tables[1], "table");
    let out = dir.path().join("report.html");
    let pictures = [&run, &copy].map(|of| {
        done(&carved().arg("report").arg(of).arg("--out").arg(&out).output().unwrap());
        fs::read_to_string(&out).unwrap().matches("data:image/jpeg;base64,").count()
    });
    assert!(pictures[0] > 0 && pictures[0] == pictures[1], "{pictures:?}");

    // A replay by another method lies beside the pack, which is still what is read.
    let method = dir.path().join("coarse.toml");
    fs::write(&method, "asd = 12\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 21.0\n").unwrap();
    let output = carved().arg("replay").arg(&copy).args(["A02", "--method"]).arg(&method).output().unwrap();
    done(&output);
    assert!(copy.join("A02/replays/coarse/measurement.json").is_file());
    assert!(measured(&copy) == of_run);
}

#[test]
fn a_pack_that_is_spoiled_is_found_and_frames_that_were_pruned_are_found_in_it() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let (data, copies) = (dir.path().join("data"), dir.path().join("copies"));
    done(&archive(&run, &copies));
    done(&archive(&run, &copies));
    let pack = copies.join("P-017/A02.tar");
    let good = fs::read(&pack).unwrap();
    let refused = |output: Output, why: &str| assert!(!output.status.success() && said(&output).contains(why), "{why}: {}", said(&output));
    let measure = |path: &Path| carved().arg("measure").arg(path).output().unwrap();
    let prune = || carved().arg("prune").arg(&data).args(["P-017", "--yes"]).output().unwrap();

    // A bit of a frame: the last byte of the pixels of a view.
    let name = b"A02/frames/view_003.png";
    let header = good.windows(name.len()).position(|w| w == name).unwrap();
    let mut flipped = good.clone();
    flipped[header + 512 + 2000] ^= 1;
    fs::write(&pack, &flipped).unwrap();
    refused(measure(&pack), "view_003.png");
    refused(prune(), "its copy is not good");
    refused(archive(&run, &copies), "exists already; nothing is overwritten");
    // Cut short within a file.
    fs::write(&pack, &good[..good.len() / 2]).unwrap();
    refused(measure(&pack), &format!("found: {} bytes, of which A02/", good.len() / 2));
    refused(measure(&copies.join("P-017")), "A02.tar");
    fs::write(&pack, b"no archive").unwrap();
    refused(measure(&pack), "a tar of the files of one recording");
    // A pack of another well.
    fs::copy(copies.join("P-017/B03.tar"), &pack).unwrap();
    refused(measure(&pack), "which is not in the folder A02");

    fs::write(&pack, &good).unwrap();
    done(&prune());
    assert!(!run.join("A02/frames/view_003.png").exists());
    refused(measure(&run.join("A02")), &format!("carved measure {}", pack.display()));
    done(&measure(&pack));
    fs::remove_file(&pack).unwrap();
    refused(measure(&run.join("A02")), "is not there now");
}
