//! `carved reconstruct` on silhouettes of solids with known volume and area. `tests/independent/generate.py` computes them without any code
//! of carved or of the emulated rig. `tests/independent/README.md` describes the frames and the formulas.

use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::Command;

const PIXEL_UM: f64 = 5.5;
const VIEWS: usize = 24;
/// Solids with smooth slices whose ideal hull is the solid.
const SMOOTH: [&str; 3] = ["ellipsoid", "capsule", "tapered"];

fn committed(solid: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/independent").join(solid)
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// A solid with every (24 / `views`)th view, in its own folder.
struct Set {
    dir: tempfile::TempDir,
    truth: Value,
}

impl Set {
    fn of(solid: &str, views: usize) -> Self {
        let (from, dir) = (committed(solid), tempfile::tempdir().unwrap());
        let every = VIEWS / views;
        std::fs::create_dir(dir.path().join("views")).unwrap();
        for i in (0..VIEWS).step_by(every) {
            let name = format!("view_{i:02}.png");
            std::fs::copy(from.join(&name), dir.path().join("views").join(name)).unwrap();
        }
        let matrices = std::fs::read_to_string(from.join("cameras.txt")).unwrap();
        let kept: Vec<&str> = matrices.lines().step_by(every).collect();
        std::fs::write(dir.path().join("cameras.txt"), kept.join("\n")).unwrap();
        let mut camera = json(&from.join("camera.json"));
        camera["omega"] = camera["omega"].as_array().unwrap().iter().step_by(every).cloned().collect();
        std::fs::write(dir.path().join("camera.json"), camera.to_string()).unwrap();
        Self { truth: json(&from.join("truth.json")), dir }
    }

    /// Reconstructs with epsilon 0. With a larger epsilon the paper's carver gives more volume by design.
    fn reconstructed(&self, cameras: &str) -> Value {
        let mut command = Command::new(env!("CARGO_BIN_EXE_carved"));
        command.current_dir(self.dir.path()).args(["reconstruct", "--views", "views", "--epsilon", "0", "--cameras", cameras]);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Volume in um^3 and area in um^2.
    fn truth(&self, of: &str) -> [f64; 2] {
        numbers(&self.truth[of])
    }
}

fn numbers(of: &Value) -> [f64; 2] {
    ["volume_um3", "area_um2"].map(|key| of[key].as_f64().unwrap_or_else(|| panic!("no {key} in {of:#}")))
}

/// The numbers from anti-aliased outlines. The error of an edge has three parts: 255 grey levels; the polygon of an outline, which lies up
/// to 0.001 px inside it; and the mean of an outline of radius R px over a column, 1/(24 R) px, which is 0.006 px at the tail of 7 px.
/// Together an edge is known to 1/100 px. The volume is therefore known to area x 0.01 px, which is 0.07 to 0.08 %. The area of a tube has
/// half of this relative error; the other half is for the ends, which are found from slices of one pixel. 12 views are enough: the slices
/// are ellipses with an axis ratio below 1.5, whose harmonics from the sixth on are below 1e-5 of the area.
///
/// The axis of the camera as given is 3 px off, and its roll is missing. The mean of some hundred columns, whose edges are known to 1/100
/// px, gives the row of the axis to at least 0.01 px, and the roll to 0.01 px over 200 px.
#[test]
fn calibrated_volume_and_area_of_smooth_solids_are_right() {
    for solid in SMOOTH {
        for views in [VIEWS / 2, VIEWS] {
            let set = Set::of(solid, views);
            let found = set.reconstructed("camera.json");
            let [volume_um3, area_um2] = set.truth("solid");
            let share = 0.01 * PIXEL_UM * area_um2 / volume_um3;
            let [of_volume, of_area] = numbers(&found);
            let off = [of_volume / volume_um3 - 1.0, of_area / area_um2 - 1.0];
            println!("{solid}, {views} views: volume {:+.3} %, area {:+.3} %, allowed {:.3} %", 1e2 * off[0], 1e2 * off[1], 1e2 * share);
            assert!(off.iter().all(|off| off.abs() < share), "{solid}, {views} views: {off:?} with {share} allowed");
            assert_eq!((&found["estimator"], &found["flags"]), (&json!("support"), &json!([])), "{solid}, {views} views");
            let axis = |key: &str| found["psi"][key].as_f64().unwrap() - set.truth["axis"][key].as_f64().unwrap();
            assert!(axis("uy").abs() < 0.01 && axis("gamma").abs() < 0.01 / 200.0, "{solid}, {views} views: {}", found["psi"]);
        }
    }
}

/// The numbers from voxels, with the true matrices. An even number n of views gives n tangents of a slice, whose polygon is larger than a
/// disc by `n tan(pi/n) / pi - 1`; the finned solid has its own polygon in truth.json. The edge of a mask is rounded to a pixel, and the
/// smaller of two opposite views counts: the mean of the smaller of two uniform errors of up to half a pixel is -1/6 px. The same amount is
/// allowed on either side.
#[test]
fn voxels_are_the_hull_of_their_views() {
    for solid in SMOOTH.into_iter().chain(["finned"]) {
        for views in [VIEWS / 2, VIEWS] {
            let set = Set::of(solid, views);
            let n = views as f64;
            let own = format!("hull_of_{views}");
            let hull_um3 = if set.truth[&own].is_null() { set.truth("hull")[0] * n * (PI / n).tan() / PI } else { set.truth(&own)[0] };
            let rounding_um3 = set.truth("hull")[1] * PIXEL_UM / 6.0;
            let found = set.reconstructed("cameras.txt");
            let [volume_um3, _] = numbers(&found["estimators"]["voxel"]);
            let off = volume_um3 - (hull_um3 - rounding_um3);
            println!(
                "{solid}, {views} views: {:+.2} % of the ideal hull, expected {:+.2} +- {:.2} %",
                1e2 * (volume_um3 / set.truth("hull")[0] - 1.0),
                1e2 * ((hull_um3 - rounding_um3) / set.truth("hull")[0] - 1.0),
                1e2 * rounding_um3 / set.truth("hull")[0]
            );
            assert!(off.abs() < rounding_um3, "{solid}, {views} views: {off} um^3 off with {rounding_um3} allowed");
            assert_eq!(found["flags"], json!(["uncalibrated"]), "{solid}, {views} views");
        }
    }
}

/// Another zlib may compress the same pixels to other bytes. Pictures are therefore compared by their pixels, and all other files by their
/// bytes.
#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn the_committed_silhouettes_are_what_the_generator_makes() {
    let dir = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/independent/generate.py");
    let output = Command::new("python3").arg(program).arg(dir.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for solid in SMOOTH.into_iter().chain(["finned"]) {
        let names = |folder: &Path| {
            let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let (kept, made) = (committed(solid), dir.path().join(solid));
        assert_eq!(names(&kept), names(&made), "{solid}");
        for name in names(&made) {
            let [kept, made] = [&kept, &made].map(|folder| folder.join(&name));
            let same = if kept.extension().is_some_and(|e| e == "png") {
                image::open(&kept).unwrap() == image::open(&made).unwrap()
            } else {
                std::fs::read(&kept).unwrap() == std::fs::read(&made).unwrap()
            };
            assert!(same, "{}: the generator makes another one", kept.display());
        }
    }
}
