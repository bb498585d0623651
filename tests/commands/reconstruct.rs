//! `carved reconstruct` as its users meet it: profile sets with known truth from an independent renderer, and bad input.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn carved(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carved")).current_dir(dir).arg("reconstruct").args(args).output().unwrap()
}

/// The only JSON object on stdout.
fn report(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The message of a refusal: exit code 3 and a JSON object with `flags` and `error`. stderr has the same message.
fn refusal(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stdout));
    let refused: Value = serde_json::from_slice(&output.stdout).unwrap();
    let error = refused["error"].as_str().unwrap();
    assert!(refused["flags"].is_array() && String::from_utf8_lossy(&output.stderr).contains(error), "{refused:#}");
    error.to_owned()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {value:#}"))
}

/// A profile set of the shared data with its truth.
fn set(name: &str) -> (String, String, Value) {
    let folder = crate::common::shared(&format!("data/profile_sets/{name}"));
    let truth = serde_json::from_slice(&std::fs::read(folder.join("truth.json")).unwrap()).unwrap();
    (folder.display().to_string(), folder.join("camera.json").display().to_string(), truth)
}

/// Relative difference from the truth.
fn off(found: &Value, key: &str, truth: &Value, true_key: &str) -> f64 {
    number(found, key) / number(truth, true_key) - 1.0
}

/// With one miss tolerated in 21 views the paper's carver is 3.5 % above the ideal hull of a finned larva; half a percent on either side is
/// for the renderer and the grid. Without tolerance the hull is the ideal one, within the 1.8 % that the set allows any method. The trusted
/// numbers use no tolerance: they are within the set's own 1.8 and 2 %.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_finned_larva_is_what_the_papers_carver_makes_of_it_and_its_hull_by_slices() {
    let (views, cameras, truth) = set("larva_fin_asd21");
    let dir = tempfile::tempdir().unwrap();
    let tolerant = report(&carved(dir.path(), &["--views", &views, "--cameras", &cameras]));
    let voxel = &tolerant["estimators"]["voxel"];
    let excess = off(voxel, "volume_um3", &truth, "hull_volume");
    assert!((excess - 0.035).abs() < 0.005, "{excess}");
    assert!(off(voxel, "area_um2", &truth, "hull_area").abs() < 0.02);
    let voxels_um3 = number(&tolerant, "voxels") * 6.93f64.powi(3);
    assert!((number(voxel, "volume_um3") / voxels_um3 - 1.0).abs() < 1e-12);
    assert_eq!((tolerant["estimator"].as_str(), tolerant["views"].as_array().unwrap().len()), (Some("support"), 21));
    assert!(off(&tolerant, "volume_um3", &truth, "hull_volume").abs() < 0.018, "{tolerant:#}");
    assert!(off(&tolerant, "area_um2", &truth, "hull_area").abs() < 0.02, "{tolerant:#}");
    assert_eq!(tolerant["flags"], serde_json::json!([]));

    let strict = report(&carved(dir.path(), &["--views", &views, "--cameras", &cameras, "--epsilon", "0"]));
    assert!(off(&strict["estimators"]["voxel"], "volume_um3", &truth, "hull_volume").abs() < 0.018);
    // Masks and cameras are exact: the image of the hull is the mask up to the size of the voxels, and to where the fins of all views
    // differ from the masks.
    for view in strict["views"].as_array().unwrap() {
        assert!(number(view, "overlap") > 0.975, "{view}");
    }
    let no_sphere = refusal(&carved(dir.path(), &["--views", &views, "--cameras", &cameras, "--sphere"]));
    assert_eq!(no_sphere.matches("did not settle").count(), 1, "a cause is told once: {no_sphere}");
    // The second mesh has its own file beside the first.
    assert!(dir.path().join("larva_fin_asd21.ply").is_file() && dir.path().join("larva_fin_asd21-2.ply").is_file());
}

/// The principal point of the set is 2 px off, which is 11 um at the bead. With the camera as given each view removes up to this from one
/// side of the voxels' radius of 256 um, and one miss is tolerated: the remaining diameter is between that of a ball with an 11 um smaller
/// radius and the true one. After calibration the size of the bead is within the set's 0.7 and 0.8 %, and the axis is right.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_bead_seen_through_a_camera_that_is_off_is_calibrated() {
    let (views, cameras, truth) = set("bead_512um_asd21");
    let dir = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| report(&carved(dir.path(), &[&["--views", &views, "--cameras", &cameras, "--sphere"][..], more].concat()));
    let as_given = run(&["--no-calibrate"]);
    let (diameter, true_diameter) = (number(&as_given["sphere"], "diameter_um"), number(&truth, "diameter"));
    assert!((true_diameter - 22.0..true_diameter).contains(&diameter), "{diameter}");
    assert_eq!(as_given["flags"], serde_json::json!(["uncalibrated"]));
    assert!(as_given["psi_sd"]["uy"].is_null() && (number(&as_given["psi"], "uy") - 511.5).abs() < 1e-9);

    let found = run(&[]);
    assert!(off(&found, "volume_um3", &truth, "volume").abs() < 0.007 && off(&found, "area_um2", &truth, "area").abs() < 0.008);
    assert!((number(&found, "diameter_um") - true_diameter).abs() < 0.5 && number(&found, "sphere_rms_um") < 0.5, "{found:#}");
    assert!((number(&found, "aspect_ratio") - 1.0).abs() < 0.002, "{found:#}");
    assert!((number(&found["psi"], "uy") - number(&truth["psi"], "uy")).abs() < 0.05, "{found:#}");
    assert!(number(&found["psi_sd"], "uy") < 0.05);
    for axis in 0..3 {
        let [lo, hi] = [0, 1].map(|end| truth["bbox_um"][end][axis].as_f64().unwrap());
        assert!((found["sphere"]["centre_um"][axis].as_f64().unwrap() - f64::midpoint(lo, hi)).abs() < 3.5, "{found:#}");
    }
}

/// Everything is off on purpose. The set allows 0.6 % of volume and 1.2 % of area. The goals are 0.05 px for uy and 0.02 deg for gamma.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_larva_with_drift_jitter_and_noise_is_solved() {
    let (views, cameras, truth) = set("larva_drift_asd42");
    let dir = tempfile::tempdir().unwrap();
    let found = report(&carved(dir.path(), &["--views", &views, "--cameras", &cameras]));
    assert!(off(&found, "volume_um3", &truth, "hull_volume").abs() < 0.006, "{found:#}");
    assert!(off(&found, "area_um2", &truth, "hull_area").abs() < 0.012, "{found:#}");
    let dy: Vec<f64> = truth["dy"].as_array().unwrap().iter().map(|d| d.as_f64().unwrap()).collect();
    let mean_dy = dy.iter().sum::<f64>() / dy.len() as f64;
    assert!((number(&found["psi"], "uy") - number(&truth["psi"], "uy") - mean_dy).abs() < 0.05, "{found:#}");
    assert!((number(&found["psi"], "gamma") - number(&truth["psi"], "gamma")).to_degrees().abs() < 0.02, "{found:#}");
    assert!((number(&found, "rho") - 1.0).abs() < 0.002 && found["flags"] == serde_json::json!([]), "{found:#}");
    let spread = number(&found, "volume_sd_um3") / number(&truth, "hull_volume");
    assert!((0.0005..0.005).contains(&spread), "{spread}");
}

/// One silhouette under two names stands at a wrong angle once. The copy is named, not the angles.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_silhouette_under_two_names_is_named_as_repeated() {
    let (views, cameras, _) = set("larva_fin_asd21");
    for (from, to) in [(5, 6), (5, 11), (2, 19)] {
        let dir = tempfile::tempdir().unwrap();
        let own = dir.path().join("views");
        std::fs::create_dir(&own).unwrap();
        let name = |view: u32| format!("view_{view:03}.png");
        for view in 0..21 {
            std::fs::copy(Path::new(&views).join(name(if view == to { from } else { view })), own.join(name(view))).unwrap();
        }
        let output = carved(dir.path(), &["--views", own.to_str().unwrap(), "--cameras", &cameras]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let flags = report["flags"].as_array().unwrap().clone();
        // A script must not go on with the volume.
        assert_eq!((output.status.code(), &report["volume_um3"]), (Some(3), &Value::Null), "{from} {to}");
        assert!(flags.contains(&"repeated_views".into()) && !flags.contains(&"wrong_steps".into()), "{from} {to}: {flags:?}");
        assert!(said.contains(&format!("{} and {} are one silhouette", name(from), name(to))), "{from} {to}: {said}");
    }
}

/// A disc with a radius of 20 px in each of four views from the sides, with matrices in a world whose unit is not a micrometre.
fn discs(dir: &Path) -> (String, String) {
    let views = dir.join("discs");
    std::fs::create_dir(&views).unwrap();
    let mut lines = String::new();
    for (i, (c, s)) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].into_iter().enumerate() {
        let disc = |u: u32, v: u32| (f64::from(u) - 30.0).hypot(f64::from(v) - 25.0) <= 20.0;
        let image = image::GrayImage::from_fn(64, 48, |u, v| image::Luma([if disc(u, v) { 200 } else { 90 }]));
        // Both types of file, ordered by name.
        image.save(views.join(format!("v{i}.{}", if i % 2 == 0 { "png" } else { "pgm" }))).unwrap();
        // 10 px per unit at a distance of 1000 units, turned about x.
        let row = |scale: f64, centre: f64, y: f64, z: f64| {
            format!("{} {} {} {} ", 0.0, scale * y + centre * s, scale * z + centre * c, 1e3 * centre)
        };
        let first = format!("10000 {} {} {} ", 30.0 * s, 30.0 * c, 30e3);
        lines += &format!("{first}{}0 {s} {c} 1000\n", row(1e4, 25.0, c, -s));
    }
    let cameras = dir.join("cameras.txt");
    std::fs::write(&cameras, lines).unwrap();
    (views.display().to_string(), cameras.display().to_string())
}

/// The intersection of two crossed cylinders of radius r has the volume `16 r^3 / 3` (Steinmetz's solid). Here the silhouettes are those of
/// balls, so that each slice across x is a square of side `2 sqrt(r^2 - x^2)`, which gives the same volume. r is 2 units. Rounding to
/// pixels of a tenth of a unit, and the smaller of two opposite views, cost 1/6 pixel of 20: 2.5 % of volume.
#[test]
fn matrices_of_any_origin_give_numbers_without_a_unit() {
    let dir = tempfile::tempdir().unwrap();
    let (views, cameras) = discs(dir.path());
    let base = ["--views", &views, "--cameras", &cameras, "--unit", "none"];
    let found = report(&carved(dir.path(), &[&base[..], &["--box", "-3,3,-3,3,-3,3", "--voxel", "0.05"]].concat()));
    let expected = 16.0 / 3.0 * 8.0;
    assert!((number(&found, "volume") / expected - 1.0).abs() < 0.025, "{found:#}");
    assert!(found["area"].is_number() && found["volume_um3"].is_null() && found["views"][1]["name"] == "v1.pgm");
    assert!(found["views"].as_array().unwrap().iter().all(|v| number(v, "overlap") > 0.98), "{found:#}");
    assert!(found["overlap_rule"].as_str().unwrap().contains("intersection over union"));
    assert_eq!(found["mirrored_world"], false);

    // Without a given box the grid over the same body is another one. The field surface lies where the outlines put it, between any voxels.
    // Marching cubes have an error of the square of a voxel over the radius, a thousandth. The error of voxels that are no fraction of a
    // pixel is the same on both sides.
    let derived = report(&carved(dir.path(), &[&base[..], &["--voxel", "0.047"]].concat()));
    for key in ["field_volume", "field_area"] {
        assert!((number(&derived, key) / number(&found, key) - 1.0).abs() < 0.005, "{key}: {derived:#} {found:#}");
    }
    assert!((number(&derived, "volume") / expected - 1.0).abs() < 0.025, "{derived:#}");
    for axis in 0..3 {
        let [low, high] = ["min", "max"].map(|end| derived["grid"][end][axis].as_f64().unwrap());
        // A pixel is a tenth of a unit. A cell of 1/64 of 4.1, a margin of 1/32 and two voxels on each side give 2.35. Rounding to whole
        // voxels adds up to half a voxel.
        assert!((-2.4..-2.05).contains(&low) && (2.05..2.4).contains(&high), "axis {axis}: {low} to {high}");
    }
    assert_eq!(derived["touches_box"], false, "{derived:#}");
    let untold = report(&carved(dir.path(), &base));
    assert!((number(&untold, "volume") / expected - 1.0).abs() < 0.025, "15 million voxels: {untold:#}");
}

/// The matrices of a world that is mirrored at x = 0 and then moved by 5 along x.
fn mirrored(cameras: &str) -> String {
    let text = std::fs::read_to_string(cameras).unwrap();
    let lines = text.lines().map(|line| {
        let mut m: Vec<f64> = line.split_whitespace().map(|x| x.parse().unwrap()).collect();
        for row in m.chunks_exact_mut(4) {
            // x is replaced by 5 - x: P x = -P0 x' + (P3 + 5 P0).
            row[3] += 5.0 * row[0];
            row[0] = -row[0];
        }
        m.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Signed volume of a mesh, positive if its triangles face outwards, and the centre of its bounding box.
fn solid(ply: &Path) -> (f64, [f64; 3]) {
    let bytes = std::fs::read(ply).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let count = |what: &str| header.lines().find_map(|l| l.strip_prefix(what)).unwrap().trim().parse::<usize>().unwrap();
    let (points, faces) = bytes[end..].split_at(12 * count("element vertex "));
    assert_eq!(faces.len(), 13 * count("element face "));
    let points: Vec<[f64; 3]> = points
        .chunks_exact(12)
        .map(|p| std::array::from_fn(|a| f64::from(f32::from_le_bytes(p[4 * a..4 * a + 4].try_into().unwrap()))))
        .collect();
    let volume = faces.chunks_exact(13).map(|face| {
        let corner =
            |k: usize| nalgebra::Vector3::from(points[u32::from_le_bytes(face[1 + 4 * k..5 + 4 * k].try_into().unwrap()) as usize]);
        corner(0).dot(&corner(1).cross(&corner(2))) / 6.0
    });
    let middle = std::array::from_fn(|a| {
        let (low, high) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[a]), h.max(p[a])));
        f64::midpoint(low, high)
    });
    (volume.sum(), middle)
}

#[test]
fn a_mirrored_world_is_recognised_and_measured_as_its_image() {
    let dir = tempfile::tempdir().unwrap();
    let (views, cameras) = discs(dir.path());
    std::fs::write(dir.path().join("mirrored.txt"), mirrored(&cameras)).unwrap();
    let run = |cameras: &str, bounds: &[&str], out: &str| {
        let base = ["--views", &views, "--cameras", cameras, "--unit", "none", "--voxel", "0.047", "--out", out];
        carved(dir.path(), &[&base[..], bounds].concat())
    };
    let plain = report(&run(&cameras, &["--box", "-3,3,-3,3,-3,3"], "plain.ply"));
    for (bounds, out) in [(&["--box", "2,8,-3,3,-3,3"][..], "given.ply"), (&[], "derived.ply")] {
        let output = run("mirrored.txt", bounds, out);
        let found = report(&output);
        assert_eq!(found["mirrored_world"], true);
        assert!(String::from_utf8_lossy(&output.stderr).contains("mirrored world"), "{output:?}");
        for key in ["field_volume", "field_area"] {
            assert!((number(&found, key) / number(&plain, key) - 1.0).abs() < 0.005, "{key}: {found:#} {plain:#}");
        }
        let (volume, middle) = solid(&dir.path().join(out));
        let (plain_volume, _) = solid(&dir.path().join("plain.ply"));
        assert!(plain_volume > 0.0 && (volume / plain_volume - 1.0).abs() < 0.01, "{volume} of {plain_volume}: turned inside out?");
        for (axis, expected) in [5.0, 0.0, 0.0].into_iter().enumerate() {
            let centroid = found["centroid"][axis].as_f64().unwrap();
            assert!((middle[axis] - expected).abs() < 0.05 && (centroid - expected).abs() < 0.05, "axis {axis}: {middle:?} {found:#}");
        }
        let [low, high] = ["min", "max"].map(|end| found["grid"][end][0].as_f64().unwrap());
        assert!((1.9..3.1).contains(&low) && (6.9..8.1).contains(&high), "{low} to {high}");
    }
    // One matrix is not mirrored.
    let text = mirrored(&cameras);
    let mut lines: Vec<String> = text.lines().map(String::from).collect();
    let negated: Vec<String> = lines[2]
        .split(' ')
        .enumerate()
        .map(|(i, x)| if i % 4 == 0 { (-x.parse::<f64>().unwrap()).to_string() } else { x.into() })
        .collect();
    lines[2] = negated.join(" ");
    std::fs::write(dir.path().join("mixed.txt"), lines.join("\n")).unwrap();
    let said = refusal(&run("mixed.txt", &["--box", "2,8,-3,3,-3,3"], "mixed.ply"));
    assert!(said.contains("view 2 ") && said.contains("not of one world"), "{said}");
}

#[test]
fn bad_input_is_named_with_what_was_found_and_expected_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let (views, cameras) = discs(dir.path());
    let box_ = ["--unit", "none", "--box", "-3,3,-3,3,-3,3", "--voxel", "0.2"];
    let out = dir.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let run =
        |views: &str, cameras: &str, more: &[&str]| carved(&out, &[&["--views", views, "--cameras", cameras][..], &box_, more].concat());
    let expect = |output: Output, parts: &[&str]| {
        let message = refusal(&output);
        assert!(parts.iter().all(|p| message.contains(p)), "{message:?} lacks one of {parts:?}");
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0, "something was written");
    };
    expect(run("nowhere", &cameras, &[]), &["nowhere", "cannot be read"]);
    expect(run(&views, "nofile.json", &[]), &["nofile.json", "cannot be read"]);
    expect(run(&out.display().to_string(), &cameras, &[]), &["no .png or .pgm file"]);
    expect(run(&views, &cameras, &["--epsilon", "1"]), &["epsilon is 1"]);
    expect(run(&views, &cameras, &["--epsilon", "-0.1"]), &["epsilon is -0.1"]);
    expect(run(&views, &cameras, &["--fairing-iterations", "1001"]), &["fairing_iterations = 1001", "0 to 1000"]);
    expect(run(&views, &cameras, &["--out", "q.obj"]), &["q.obj", ".ply"]);
    expect(run(&views, &cameras, &["--out", "gone/x.ply"]), &["gone", "found no folder"]);

    let three = dir.path().join("three.txt");
    let text = std::fs::read_to_string(&cameras).unwrap();
    std::fs::write(&three, text.lines().take(3).collect::<Vec<_>>().join("\n")).unwrap();
    expect(run(&views, &three.display().to_string(), &[]), &["three.txt", "3 matrices", "4 images"]);
    let short = dir.path().join("short.txt");
    std::fs::write(&short, "1 2 3\n").unwrap();
    expect(run(&views, &short.display().to_string(), &[]), &["short.txt", "line 1", "3 numbers", "expected 12"]);

    let last = Path::new(&views).join("v3.pgm");
    std::fs::write(&last, "no image").unwrap();
    expect(run(&views, &cameras, &[]), &["v3.pgm", "PNG or PGM"]);
    std::fs::write(&last, "P5 8 8 255\n").unwrap();
    expect(run(&views, &cameras, &[]), &["v3.pgm"]);
    image::GrayImage::from_pixel(10, 10, image::Luma([255])).save(&last).unwrap();
    expect(run(&views, &cameras, &[]), &["v3.pgm", "10 x 10", "64 x 48"]);
    image::GrayImage::from_pixel(64, 48, image::Luma([1])).save(&last).unwrap();
    expect(run(&views, &cameras, &[]), &["v3.pgm", "inverted"]);
    // A blank view is left out by name. Blank views alone are no answer that a script may go on with.
    image::GrayImage::from_pixel(64, 48, image::Luma([0])).save(&last).unwrap();
    let found = report(&run(&views, &cameras, &["--out", "one_blank.ply"]));
    assert_eq!((found["views"][3]["used"].as_bool(), found["flags"][1].as_str()), (Some(false), Some("bad_view")), "{found:#}");
    assert!(found["views"][3]["reason"].as_str().unwrap().contains("blank"));
    for n in 0..4 {
        let name = Path::new(&views).join(format!("v{n}.{}", if n % 2 == 0 { "png" } else { "pgm" }));
        image::GrayImage::new(64, 48).save(name).unwrap();
    }
    let output = run(&views, &cameras, &[]);
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("the volume is 0"));
    let empty: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((empty["flags"].clone(), empty["volume"].as_f64(), &empty["mesh"]), (serde_json::json!(["empty"]), Some(0.0), &Value::Null));
}

/// Masks of 0 and 1, in 8 and 16 bits, under names without leading zeros, and a hidden file of macOS beside them.
#[test]
fn masks_of_other_values_and_names_give_the_same_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let (views, cameras) = discs(dir.path());
    let run = |views: &str| {
        let base = ["--views", views, "--cameras", &cameras, "--unit", "none", "--box", "-3,3,-3,3,-3,3", "--voxel", "0.2"];
        report(&carved(dir.path(), &base))
    };
    let expected = run(&views);
    let others = dir.path().join("others");
    std::fs::create_dir(&others).unwrap();
    // In byte order v10 and v11 come before v8.
    for i in 0..4 {
        let whole = image::open(Path::new(&views).join(format!("v{i}.{}", if i % 2 == 0 { "png" } else { "pgm" }))).unwrap().into_luma8();
        let name = others.join(format!("v{}.png", i + 8));
        if i % 2 == 0 {
            image::GrayImage::from_fn(64, 48, |u, v| image::Luma([u8::from(whole.get_pixel(u, v)[0] == 200)])).save(name).unwrap();
        } else {
            let deep = |u, v| image::Luma([if whole.get_pixel(u, v)[0] == 200 { 255u16 } else { 0 }]);
            image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_fn(64, 48, deep).save(name).unwrap();
        }
    }
    std::fs::write(others.join("._v8.png"), "Mac OS X").unwrap();
    let found = run(&others.display().to_string());
    assert_eq!(
        (&found["volume"], &found["views"][0]["name"], &found["views"][2]["name"]),
        (&expected["volume"], &"v8.png".into(), &"v10.png".into())
    );
    assert!(number(&found, "volume") > 0.0);
}

#[test]
fn a_mesh_that_is_there_is_replaced_only_by_force() {
    let dir = tempfile::tempdir().unwrap();
    let (views, cameras) = discs(dir.path());
    let base = ["--views", &views, "--cameras", &cameras, "--unit", "none", "--box", "-3,3,-3,3,-3,3", "--voxel", "0.2", "--out", "m.ply"];
    let mesh = dir.path().join("m.ply");
    std::fs::write(&mesh, "mine").unwrap();
    assert!(refusal(&carved(dir.path(), &base)).contains("--force"));
    assert_eq!(std::fs::read(&mesh).unwrap(), b"mine");
    report(&carved(dir.path(), &[&base[..], &["--force"]].concat()));
    assert!(std::fs::read(&mesh).unwrap().starts_with(b"ply\n"));
}

/// A world that is turned and moved, with a unit of 250 um.
fn other_world() -> (nalgebra::Rotation3<f64>, nalgebra::Vector3<f64>) {
    (nalgebra::Rotation3::from_euler_angles(0.3, 0.2, -1.1), nalgebra::Vector3::new(2.0, -1.0, 5.0))
}

/// The views of psi as matrices of that world, and the box of psi in it.
fn as_matrices(cameras: &str) -> (String, [[f64; 3]; 2]) {
    const UNIT_UM: f64 = 250.0;
    let text: Value = serde_json::from_slice(&std::fs::read(cameras).unwrap()).unwrap();
    let camera: carved_core::geometry::Camera = serde_json::from_value(text.clone()).unwrap();
    let (turned, shift) = other_world();
    let of = |omega: &Value| {
        let rows = *camera.projection(omega.as_f64().unwrap()).rows();
        let m = nalgebra::Matrix3::from_fn(|i, j| rows[i][j]) * turned.inverse().matrix() * UNIT_UM;
        let p4 = nalgebra::Vector3::from_fn(|i, _| rows[i][3]) - m * shift;
        // The scale of the matrices is free.
        (0..3).flat_map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)], p4[i]]).map(|x| (x * 0.37).to_string()).collect::<Vec<_>>().join(" ")
    };
    let lines: Vec<String> = text["omega"].as_array().unwrap().iter().map(of).collect();
    let corners = (0..8).map(|i| {
        let at = [2500.0, 500.0, 500.0].iter().enumerate().map(|(a, half)| if i >> a & 1 == 0 { -half } else { *half } / UNIT_UM);
        turned * nalgebra::Vector3::from_iterator(at) + shift
    });
    let corners: Vec<_> = corners.collect();
    let side = |pick: fn(f64, f64) -> f64| [0, 1, 2].map(|a| corners.iter().map(|c| c[a]).reduce(pick).unwrap());
    (lines.join("\n"), [side(f64::min), side(f64::max)])
}

/// The same views have the same rays. Only the positions of the voxels and rounding differ, and the calibrated estimate depends on neither.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn matrices_of_a_turn_are_calibrated_as_psi_is_when_asked() {
    let (views, cameras, _) = set("larva_drift_asd42");
    let dir = tempfile::tempdir().unwrap();
    let (matrices, [min, max]) = as_matrices(&cameras);
    std::fs::write(dir.path().join("matrices.txt"), &matrices).unwrap();
    let bounds = (0..3).map(|a| format!("{},{}", min[a], max[a])).collect::<Vec<_>>().join(",");
    let run = |cameras: &str, more: &[&str]| carved(dir.path(), &[&["--views", &views, "--cameras", cameras][..], more].concat());
    let psi = report(&run(&cameras, &["--voxel", "12"]));
    let asked = ["--calibrate", "--unit", "none", "--voxel", "0.048", "--box", &bounds];
    let found = report(&run("matrices.txt", &asked));
    assert_eq!(found["flags"], psi["flags"], "{found:#}");
    for (key, sd, um) in [("volume", "volume_sd", 250.0f64.powi(3)), ("area", "area_sd", 250.0f64.powi(2))] {
        let (of_psi, sd_of_psi) = (number(&psi, &format!("{key}_um{}", if key == "area" { 2 } else { 3 })), number(&found, sd) * um);
        let off = number(&found, key) * um - of_psi;
        // A tenth of the standard deviation between turns.
        assert!(off.abs() < 0.1 * sd_of_psi && sd_of_psi < 0.01 * of_psi, "{key}: {off} of {of_psi} +- {sd_of_psi}");
    }
    for (key, within) in [("uy", 0.01), ("gamma", 1e-5), ("alpha", 1e-3)] {
        assert!((number(&found["psi"], key) - number(&psi["psi"], key)).abs() < within, "{key}: {found:#}");
    }
    assert!((number(&found["psi"], "kx") / 250.0 - number(&psi["psi"], "kx")).abs() < 1e-6, "{found:#}");
    assert!(number(&found["turntable"], "off_px") < 0.01 && number(&found, "length") < 20.0, "{found:#}");
    // Calibration is made only on request.
    let as_given = report(&run("matrices.txt", &["--unit", "none", "--voxel", "0.048", "--box", &bounds]));
    // Through a camera that is off, the hull does not cover the masks.
    assert_eq!(as_given["flags"], serde_json::json!(["uncalibrated", "overlap"]));
    // The body has the same position as with psi, to less than a voxel.
    let (turned, shift) = other_world();
    let middle = nalgebra::Vector3::from_fn(|a, _| psi["centroid_um"][a].as_f64().unwrap() / 250.0);
    let expected = turned * middle + shift;
    for a in 0..3 {
        let x = found["centroid"][a].as_f64().unwrap();
        assert!((x - expected[a]).abs() < 0.02, "{x} on axis {a}, expected {expected}");
    }

    // One view has another axis, so these views are no turn.
    let mut lines: Vec<&str> = matrices.lines().collect();
    let other = lines[7].split(' ').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let tilted = (0..12).map(|i| if i % 4 == 0 { other[i] * 1.02 } else { other[i] }.to_string()).collect::<Vec<_>>().join(" ");
    lines[7] = &tilted;
    std::fs::write(dir.path().join("matrices.txt"), lines.join("\n")).unwrap();
    let said = refusal(&run("matrices.txt", &asked));
    assert!(said.contains("--calibrate") && said.contains("px off, 1.0 at most") && said.contains("deg from a common one"), "{said}");
}

/// The same discs through psi: a camera that looks along z at a capillary along x, 10 px per unit. Only the silhouettes show where the
/// specimen is.
#[test]
fn psi_without_a_unit_takes_its_box_from_the_silhouettes() {
    let dir = tempfile::tempdir().unwrap();
    let (views, _) = discs(dir.path());
    let quarter = std::f64::consts::FRAC_PI_2;
    let psi = serde_json::json!({
        "f": 1000.0, "kx": 10.0, "ky": 10.0, "ux": 30.0, "uy": 25.0, "s": 0.0, "alpha": 0.0, "gamma": 0.0, "phi": quarter,
        "width": 64, "height": 48, "omega": [0.0, quarter, 2.0 * quarter, 3.0 * quarter],
    });
    let cameras = dir.path().join("psi.json").display().to_string();
    std::fs::write(&cameras, psi.to_string()).unwrap();
    let base = ["--views", &views, "--cameras", &cameras, "--unit", "none", "--no-calibrate"];
    let found = report(&carved(dir.path(), &base));
    // As with matrices, and 15 million voxels.
    assert!((number(&found, "field_volume") / (16.0 / 3.0 * 8.0) - 1.0).abs() < 0.025, "{found:#}");
    assert_eq!(found["touches_box"], false, "{found:#}");
    for axis in 0..3 {
        let [low, high] = ["min", "max"].map(|end| found["grid"][end][axis].as_f64().unwrap());
        // 41 px at 10 px per unit, with 1/32 of margin and 1/64 of a cell on each side.
        assert!((-2.4..-2.05).contains(&low) && (2.05..2.4).contains(&high), "axis {axis}: {low} to {high}");
    }
    let blank = dir.path().join("blank");
    std::fs::create_dir(&blank).unwrap();
    (0..4).for_each(|i| image::GrayImage::new(64, 48).save(blank.join(format!("v{i}.png"))).unwrap());
    let said = refusal(&carved(dir.path(), &["--views", &blank.display().to_string(), "--cameras", &cameras, "--unit", "none"]));
    assert!(said.contains("--box: no box was given") && said.contains("Give a box"), "{said}");
}

/// The camera of the set is 2 px off, and another 10 px here: calibration moves the bead by 12 px, with a radius of 47 px.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_box_of_silhouettes_holds_what_calibration_moves() {
    let (views, cameras, truth) = set("bead_512um_asd21");
    let dir = tempfile::tempdir().unwrap();
    let mut psi: Value = serde_json::from_slice(&std::fs::read(&cameras).unwrap()).unwrap();
    psi["uy"] = (number(&psi, "uy") + 10.0).into();
    let off_axis = dir.path().join("psi.json").display().to_string();
    std::fs::write(&off_axis, psi.to_string()).unwrap();
    let found = report(&carved(dir.path(), &["--views", &views, "--cameras", &off_axis, "--sphere", "--unit", "none", "--voxel", "6.93"]));
    assert_eq!((&found["touches_box"], &found["flags"]), (&false.into(), &serde_json::json!([])), "{found:#}");
    assert!((number(&found["psi"], "uy") - number(&truth["psi"], "uy")).abs() < 0.1, "{found:#}");
    // The set allows this to any method.
    assert!((number(&found, "volume") / number(&truth, "volume") - 1.0).abs() < 0.007, "{found:#}");
    let [low, high] = ["min", "max"].map(|end| found["grid"][end][1].as_f64().unwrap());
    assert!(high - low < 800.0, "a bead of 512: {low} to {high}");
}

/// The matrices of a left-handed world with positive depths: the turn is recognised and calibrated in its mirror image.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn a_mirrored_world_is_calibrated_as_its_image() {
    let (views, cameras, _) = set("larva_drift_asd42");
    let dir = tempfile::tempdir().unwrap();
    let (matrices, [min, max]) = as_matrices(&cameras);
    let [plain, image] = ["plain.txt", "image.txt"].map(|name| dir.path().join(name));
    std::fs::write(&plain, &matrices).unwrap();
    std::fs::write(&image, mirrored(plain.to_str().unwrap())).unwrap();
    let run = |cameras: &Path, more: &[&str]| {
        let base = ["--views", &views, "--cameras", cameras.to_str().unwrap(), "--calibrate", "--unit", "none", "--voxel", "0.048"];
        report(&carved(dir.path(), &[&base[..], more].concat()))
    };
    let bounds = |x: [f64; 2]| format!("{},{},{},{},{},{}", x[0], x[1], min[1], max[1], min[2], max[2]);
    let (of_plain, of_image) = (bounds([min[0], max[0]]), bounds([5.0 - max[0], 5.0 - min[0]]));
    let expected = run(&plain, &["--box", &of_plain]);
    assert_eq!(expected["mirrored_world"], false);
    for more in [&["--box", &of_image][..], &[]] {
        let found = run(&image, more);
        assert_eq!((&found["mirrored_world"], &found["flags"]), (&true.into(), &expected["flags"]), "{found:#}");
        for (key, sd) in [("volume", "volume_sd"), ("area", "area_sd")] {
            let off = number(&found, key) - number(&expected, key);
            // A tenth of the standard deviation between turns, as for matrices and psi.
            assert!(off.abs() < 0.1 * number(&expected, sd), "{key}: {off}");
        }
        for (axis, sign, shift) in [(0, -1.0, 5.0), (1, 1.0, 0.0), (2, 1.0, 0.0)] {
            let [ours, theirs] = [&found, &expected].map(|report| report["centroid"][axis].as_f64().unwrap());
            // Less than half a voxel.
            assert!((ours - (shift + sign * theirs)).abs() < 0.02, "axis {axis}: {ours} and {theirs}");
        }
    }
}
