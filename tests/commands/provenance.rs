//! `carved export methods` and `rocrate`, and `carved report`.

use crate::common::{carved, copy_folder, gates, json, stderr, strict, venv};
use crate::tables::{done, example, plate};
use carved_records::sha256_hex;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// The lines of the list that the values of a document have.
fn leaves(path: &str, value: &Value, found: &mut Vec<String>) {
    match value.as_object() {
        Some(fields) => fields.iter().for_each(|(key, value)| leaves(&format!("{path}.{key}"), value, found)),
        None => found.push(format!("| `{path}` | `{value}` |")),
    }
}

#[test]
fn the_methods_name_program_method_and_every_parameter() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    copy_folder(&run.join("A02"), &run.join("A02.attempt-1"));
    let output = carved().args(["export", "methods"]).arg(&run).output().unwrap();
    done(&output);
    let text = String::from_utf8(output.stdout).unwrap();
    let method = json(&run.join("A01/recording.json"))["method"].clone();
    for part in [
        "These are simulated data",
        "1 simulated larva and 1 bead were measured with carved 0.1.0 (commit 0123456789ab)",
        "By the method standard, version 2",
        &format!("SHA-256 of its settings {}", sha256_hex(method.to_string().as_bytes())),
        "at each of 21 evenly spaced angles, to the nearest step of the motor.",
        "the error of the scale was not stated and is not included.",
        "voxels of 6.93 um, of which 5 % of the views may miss a voxel",
        "Of 2 measured specimens, 1 had flags: moved 1, residual 1.",
        "1 specimen needed several attempts, at most 2; the numbers are those of the last one.",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    // Every limit that the specimens were compared with, as their files have them.
    let checks = json(&run.join("A01/measurement.json"))["quality"]["checks"].clone();
    for check in checks.as_array().unwrap() {
        let limit = format!("{} {} {}", check["name"].as_str().unwrap(), check["limit"].as_f64().unwrap(), check["unit"].as_str().unwrap());
        assert!(text.contains(&limit), "{limit}\n{text}");
    }
    // Every value of the method stands in the list.
    let mut lines = Vec::new();
    leaves("method", &method, &mut lines);
    assert!(lines.len() > 50, "{}", lines.len());
    for line in lines {
        assert!(text.contains(&line), "{line}");
    }
}

#[test]
fn a_crate_lists_the_files_with_their_hashes_and_what_made_them() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    let make = |more: &[&str]| carved().args(["export", "rocrate"]).arg(&run).args(more).output().unwrap();
    let refused = make(&["--orcid", "0000-0002"]);
    assert!(!refused.status.success() && stderr(&refused).contains("begins with https://"), "{}", stderr(&refused));
    let orcid = "https://orcid.org/0000-0002-1825-0097";
    // An attempt before this one, a file that somebody added, and the receipt of a copy, which a copy does not have.
    copy_folder(&run.join("A02"), &run.join("A02.attempt-1"));
    std::fs::write(run.join("note of kim.txt"), "a bubble in A02").unwrap();
    done(&carved().arg("archive").arg(&run).arg("--to").arg(dir.path().join("copies")).output().unwrap());
    done(&make(&["--orcid", orcid]));
    let made = json(&run.join("ro-crate-metadata.json"));
    let graph = made["@graph"].as_array().unwrap();
    let entity = |id: &str| graph.iter().find(|e| e["@id"] == id).unwrap_or_else(|| panic!("no {id} in {made:#}"));
    let sums = std::fs::read_to_string(run.join("A01/SHA256SUMS")).unwrap();
    for line in sums.lines() {
        let (hash, name) = line.split_once("  ").unwrap();
        assert_eq!(entity(&format!("A01/{name}"))["sha256"], hash, "{name}");
    }
    for name in ["run.json", "A01/SHA256SUMS", "A02.attempt-1/measurement.json", "A02.attempt-1/SHA256SUMS", "note of kim.txt"] {
        let (bytes, file) = (std::fs::read(run.join(name)).unwrap(), entity(&name.replace(' ', "%20")));
        assert_eq!((&file["sha256"], &file["contentSize"]), (&json!(sha256_hex(&bytes)), &json!(bytes.len().to_string())), "{name}");
    }
    assert!(graph.iter().all(|e| !e["@id"].as_str().unwrap().starts_with("archives")));
    let action = entity("#measure-A01");
    assert_eq!((&action["@type"], &action["agent"]["@id"]), (&json!("CreateAction"), &json!(orcid)));
    let results: Vec<&str> = action["result"].as_array().unwrap().iter().map(|r| r["@id"].as_str().unwrap()).collect();
    assert!(results.contains(&"A01/measurement.json") && results.iter().all(|r| !r.starts_with("A01/frames")), "{results:?}");
    let software = entity(action["instrument"]["@id"].as_str().unwrap());
    assert_eq!((&software["@type"], &software["softwareVersion"]), (&json!("SoftwareApplication"), &json!("0.1.0 (commit 0123456789ab)")));
    assert!(software["@id"].as_str().unwrap().contains("0123456789abcdef"));
    assert!(entity("./")["description"].as_str().unwrap().starts_with("Simulated data"));
    assert!(graph.iter().all(|e| e["@id"] != "#measure-A03"), "nothing was measured there");
    // Each id once, and everything that is named is described.
    let ids: Vec<&str> = graph.iter().map(|e| e["@id"].as_str().unwrap()).collect();
    for (i, id) in ids.iter().enumerate() {
        assert!(!ids[..i].contains(id), "{id} is described twice");
    }
    for part in entity("./")["hasPart"].as_array().unwrap().iter().chain(entity("./")["mentions"].as_array().unwrap()) {
        entity(part["@id"].as_str().unwrap());
    }
}

#[test]
fn a_crate_states_no_hash_that_a_file_does_not_have() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = plate(&data, "r1", "P-1", 4);
    let make = || carved().args(["export", "rocrate"]).arg(&run).output().unwrap();
    let profile = std::fs::read_dir(run.join("A01/profiles")).unwrap().next().unwrap().unwrap().path();
    let good = std::fs::read(&profile).unwrap();
    std::fs::write(&profile, b"another").unwrap();
    let refused = make();
    let name = profile.strip_prefix(&run).unwrap().display().to_string();
    assert!(!refused.status.success() && stderr(&refused).contains(&format!("{name}: its SHA-256 is")), "{}", stderr(&refused));
    assert!(!run.join("ro-crate-metadata.json").exists());
    // A file that is gone is named, and not listed.
    std::fs::remove_file(&profile).unwrap();
    let made = make();
    done(&made);
    assert!(stderr(&made).contains("1 file(s) that SHA256SUMS lists are missing") && stderr(&made).contains(&name), "{}", stderr(&made));
    assert!(!std::fs::read_to_string(run.join("ro-crate-metadata.json")).unwrap().contains(&name));
    // Frames that were pruned are in the archive.
    std::fs::write(&profile, good).unwrap();
    done(&carved().arg("archive").arg(&run).arg("--to").arg(dir.path().join("copies")).output().unwrap());
    done(&carved().arg("prune").arg(&data).args(["r1", "--yes"]).output().unwrap());
    assert!(!run.join("A01/frames/detect.png").exists());
    let made = make();
    done(&made);
    assert!(!stderr(&made).contains("missing"), "{}", stderr(&made));
}

#[test]
fn a_packed_copy_gets_a_crate_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = plate(&data, "r1", "P-1", 4);
    let make = |folder: &Path| carved().args(["export", "rocrate"]).arg(folder).output().unwrap();
    done(&make(&run));
    let packed = carved().arg("archive").arg(&run).arg("--pack").arg("--to").arg(dir.path().join("copies")).output().unwrap();
    done(&packed);
    assert!(stderr(&packed).contains("r1: ro-crate-metadata.json is not copied"), "{}", stderr(&packed));
    let copy = dir.path().join("copies/r1");
    assert!(!copy.join("ro-crate-metadata.json").exists());
    done(&make(&copy));
    let made = json(&copy.join("ro-crate-metadata.json"));
    let graph = made["@graph"].as_array().unwrap();
    let files: Vec<&str> = graph.iter().filter(|e| e["@type"] == "File").map(|e| e["@id"].as_str().unwrap()).collect();
    assert_eq!(files, ["A01.tar", "A02.tar", "run.json"]);
    let action = graph.iter().find(|e| e["@id"] == "#measure-A01").unwrap();
    assert!(action["result"] == json!([{"@id": "A01.tar"}]) && action["object"][0]["@id"] == "A01.tar", "{action:#}");
    // The crates of run and copy differ, and the copy still lets the run be pruned.
    done(&carved().arg("prune").arg(&data).args(["r1", "--all", "--yes"]).output().unwrap());
    assert!(!run.exists());
    // A bit of a file in a pack.
    let pack = copy.join("A01.tar");
    let mut bytes = std::fs::read(&pack).unwrap();
    let name = b"A01/profiles/";
    let header = bytes.windows(name.len()).position(|w| w == name).unwrap();
    bytes[header + 512] ^= 1;
    std::fs::write(&pack, bytes).unwrap();
    let refused = make(&copy);
    assert!(!refused.status.success() && stderr(&refused).contains("its SHA-256 is"), "{}", stderr(&refused));
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn the_validator_of_ro_crates_accepts_a_run() {
    let python = match venv::python("rocrate", "rocrate_validator", "tests/readers/requirements-crate.txt") {
        Ok(python) => python,
        Err(why) => return strict::cannot_run(&format!("roc-validator cannot be installed: {why}")),
    };
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    done(&carved().args(["export", "rocrate"]).arg(&run).output().unwrap());
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/validate_crate.py");
    let validate_folder = |folder: &Path| Command::new(&python).arg(&program).arg(folder).output().unwrap();
    let validate = || validate_folder(&run);
    done(&carved().arg("archive").arg(&run).arg("--pack").arg("--to").arg(dir.path().join("copies")).output().unwrap());
    let copy = dir.path().join("copies/r1");
    done(&carved().args(["export", "rocrate"]).arg(&copy).output().unwrap());
    for output in [validate(), validate_folder(&copy)] {
        assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    }
    // It sees a run without its action's program.
    let file = run.join("ro-crate-metadata.json");
    let mut made = json(&file);
    for entity in made["@graph"].as_array_mut().unwrap().iter_mut().filter(|e| e["@type"] == "CreateAction") {
        entity.as_object_mut().unwrap().remove("instrument");
    }
    std::fs::write(&file, made.to_string()).unwrap();
    let output = validate();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        !output.status.success() && said.contains("process-run-crate-0.5_"),
        "an action without an instrument: {said}{}",
        stderr(&output)
    );
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn mihcsme_comes_back_with_the_results_and_with_the_plate_map_as_it_was() {
    let python = match venv::python("readers", "duckdb, mihcsme_py, pandas, polars, pyarrow", "tests/readers/requirements.txt") {
        Ok(python) => python,
        Err(why) => return strict::cannot_run(&format!("mihcsme-py cannot be installed: {why}")),
    };
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    // As the laboratory has written it, with the names of the spreadsheet.
    let record = run.join("run.json");
    let mut stored = json(&record);
    stored["mode"] = "imported".into();
    stored["plan"]["plate_map"][2]["compound"] = "rapamycin".into();
    stored["plan"]["metadata"] = json!({
        "InvestigationInformation": {"DataOwner": {"First Name": "Kim"}, "DataCollaborator": {"ORCID  Data Collaborator_0": "https://orcid.org/0000-0002-1825-0097"}},
        "StudyInformation": {"Study": {"Study Title": "Growth"}},
        "AssayInformation": {"Specimen": {"Channel Transmission id": "1", "Channel 1 entity": "larva"}},
        "AssayConditions": [{"Plate": "P-1", "Well": "A01", "Compound": "DMSO", "Medium": "E3"}],
    });
    std::fs::write(&record, stored.to_string()).unwrap();
    let (file, back) = (dir.path().join("mihcsme.json"), dir.path().join("back.json"));
    done(&carved().args(["export", "mihcsme"]).arg(&run).arg("--out").arg(&file).output().unwrap());
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/read_mihcsme.py");
    let output = Command::new(&python).arg(&program).args([&file, &back]).output().unwrap();
    done(&output);
    let study: Value = serde_json::from_slice(&output.stdout).unwrap();
    let sample = json!({"Biosample Taxon": "NCBITaxon:7955", "Biosample Organism": "Danio rerio"});
    assert_eq!(study, json!({"Study": {"Study Title": "Growth"}, "Biosample": sample}));

    let model = json(&back);
    assert_eq!(model["investigation_information"]["data_collaborators"][0]["orcid"], "https://orcid.org/0000-0002-1825-0097");
    assert_eq!(model["assay_information"]["specimen"]["channels"][0]["entity"], "larva");
    let larva = &model["assay_conditions"][0]["conditions"];
    let numbers = example("larva.json");
    for (condition, expected) in [
        ("Medium", "E3".to_owned()),
        ("carved_volume_um3", format!("{:?}", numbers["measurement"]["volume_um3"].as_f64().unwrap())),
        ("carved_area_um2", format!("{:?}", numbers["measurement"]["area_um2"].as_f64().unwrap())),
        ("carved_taxon_id", "NCBITaxon:7955".into()),
        ("carved_stage_id", "ZFS:0000036".into()),
        ("carved_outcome", "succeeded".into()),
    ] {
        assert_eq!(larva[condition], expected, "{condition}");
    }
    let exposure = |well: usize| &model["assay_conditions"][well]["conditions"]["carved_exposure_id"];
    assert_eq!((exposure(0), exposure(2)), (&Value::Null, &json!("ZECO:0000111")), "a vehicle is no treatment");
    assert_eq!(model["assay_conditions"][1]["conditions"]["carved_flags"], "moved;residual");

    // carved reads it as the plate map that it was.
    let checked = carved().args(["plate", "check", "--json"]).arg(&back).output().unwrap();
    done(&checked);
    let map: Value = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(map["plate_map"], stored["plan"]["plate_map"]);
}

/// Adds a model to a recording: a triangle, as carved writes a mesh.
fn add_mesh(recording: &Path) {
    let numbers: Vec<u8> = [0.0f32, 0.0, 0.0, 3000.0, 0.0, 0.0, 0.0, 600.0, 400.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let face: Vec<u8> = std::iter::once(3).chain([0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes())).collect();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let mesh = [header.as_bytes(), &numbers, &face].concat();
    let sums = recording.join("SHA256SUMS");
    let listed = std::fs::read_to_string(&sums).unwrap();
    std::fs::write(sums, format!("{listed}{}  mesh.ply\n", sha256_hex(&mesh))).unwrap();
    std::fs::write(recording.join("mesh.ply"), mesh).unwrap();
}

#[test]
fn a_report_leaves_out_a_picture_of_a_file_that_was_altered_and_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    let larva = run.join("A01");
    add_mesh(&larva);
    let out = dir.path().join("report.html");
    let report = || {
        done(&carved().arg("report").arg(&run).arg("--out").arg(&out).output().unwrap());
        std::fs::read_to_string(&out).unwrap()
    };
    let pictures = |text: &str| text.matches("data:image/jpeg;base64,").count();
    let whole = report();
    assert!(whole.contains("No bead gate is on file."));
    assert!(pictures(&whole) == 3 && !whole.contains("It is not shown."), "two views and the model");
    let view = example("larva.json")["facing"]["lateral_views"][0].as_u64().unwrap();
    let (frame, mask) = (format!("frames/view_{view:03}.png"), format!("profiles/view_{view:03}.png"));
    for (name, other) in [("mesh.ply".to_owned(), None), (frame, Some("frames/detect.png")), (mask, Some("frames/detect.png"))] {
        let good = std::fs::read(larva.join(&name)).unwrap();
        // A good file of the same kind, of something else.
        let bad = other.map_or_else(
            || [&good[..good.len() - 37], &2000f32.to_le_bytes(), &good[good.len() - 33..]].concat(),
            |other| std::fs::read(larva.join(other)).unwrap(),
        );
        std::fs::write(larva.join(&name), bad).unwrap();
        let text = report();
        assert!(pictures(&text) == 2 && text.contains(&format!("{name} was altered after it was recorded. It is not shown.")), "{name}");
        std::fs::write(larva.join(&name), good).unwrap();
    }
    // A standard picture is shown beside them.
    let picture = std::fs::read(larva.join("frames/detect.png")).unwrap();
    let sums = std::fs::read_to_string(larva.join("SHA256SUMS")).unwrap();
    std::fs::write(larva.join("SHA256SUMS"), format!("{sums}{}  lateral.png\n", sha256_hex(&picture))).unwrap();
    std::fs::write(larva.join("lateral.png"), picture).unwrap();
    let text = report();
    assert!(pictures(&text) == 4 && text.contains("left side"), "the standard picture is missing");
    std::fs::remove_file(larva.join("lateral.png")).unwrap();
    std::fs::write(larva.join("SHA256SUMS"), sums).unwrap();
    // Of a pruned run there is nothing to show, and nothing wrong.
    std::fs::remove_dir_all(larva.join("frames")).unwrap();
    let text = report();
    assert!(pictures(&text) == 1 && !text.contains("It is not shown."));
}

#[test]
fn a_report_of_flagged_specimens_alone_says_why_it_has_no_groups() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    let mut stored = json(&run.join("run.json"));
    stored["wells"][0]["flags"] = json!(["moved"]);
    std::fs::write(run.join("run.json"), stored.to_string()).unwrap();
    let out = dir.path().join("report.html");
    for (more, expected) in [(None, true), (Some("--with-flagged"), false), (Some("--without-flagged"), true)] {
        done(&carved().arg("report").arg(&run).arg("--out").arg(&out).args(more).output().unwrap());
        let text = std::fs::read_to_string(&out).unwrap();
        assert_eq!(text.contains("So there are no groups"), expected, "{more:?}");
    }
}

#[test]
fn a_report_gives_a_bound_as_one() {
    let dir = tempfile::tempdir().unwrap();
    let run = plate(&dir.path().join("data"), "r1", "P-1", 4);
    let out = dir.path().join("report.html");
    let report = |flags: Value| {
        let mut stored = json(&run.join("run.json"));
        stored["wells"][0]["flags"] = flags;
        std::fs::write(run.join("run.json"), stored.to_string()).unwrap();
        done(&carved().arg("report").arg(&run).arg("--out").arg(&out).output().unwrap());
        std::fs::read_to_string(&out).unwrap()
    };
    let volume = format!("{:.0}", example("larva.json")["measurement"]["volume_um3"].as_f64().unwrap() / 1e6);
    let z = |text: &str| text.matches("<td>+").count() + text.matches("<td>-").count();
    // The place of A01 among reference larvae, in the table.
    let place = || {
        let table = carved().args(["export", "table"]).arg(&run).output().unwrap();
        let mut read = csv::Reader::from_reader(&table.stdout[..]);
        let at = read.headers().unwrap().iter().position(|name| name == "reference_area_z").unwrap();
        read.records().next().unwrap().unwrap()[at].to_owned()
    };
    let whole = report(json!([]));
    assert!(!place().is_empty());
    assert!(whole.contains(&format!("<td>{volume} ± ")) && !whole.contains("<td>at least ") && z(&whole) > 0);
    for flag in ["clipped_left", "clipped_right", "outside_box"] {
        let bound = report(json!([flag]));
        // In the table with area and length, on the card, and on the plate.
        assert_eq!(bound.matches("<td>at least ").count(), 3, "{flag}");
        assert!(bound.contains(&format!("<td>at least {volume}</td>")) && bound.contains(&format!("<p>at least {volume} · ")), "{flag}");
        assert!(bound.contains(&format!("≥ {volume}")) && !bound.contains(&format!("{volume} ± ")), "{flag}");
        assert_eq!(z(&bound), 0, "{flag}");
        assert!(place().is_empty(), "{flag}");
    }
}

#[test]
fn a_report_has_everything_inside_and_escapes_what_plate_maps_say() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let runs = [plate(&data, "r1", "P-1", 96), plate(&data, "r2", "P-2", 4)];
    add_mesh(&runs[0].join("A01"));
    gates::keep(&data.join("calibrations"));
    let out = dir.path().join("report.html");
    done(&carved().arg("report").args(&runs).arg("--out").arg(&out).output().unwrap());
    let text = std::fs::read_to_string(&out).unwrap();
    let volume = example("larva.json")["measurement"]["volume_um3"].as_f64().unwrap() / 1e6;
    for part in [
        // Wells, measured, of them flagged, failed, skipped, not done.
        "<td>4</td><td>2</td><td>1</td><td>0</td><td>2</td><td>0</td>",
        "<!DOCTYPE html>",
        "Simulated: the frames were rendered",
        "Plate P-1, run r1",
        "negative control: DMSO, &quot;&lt;dry&gt;&quot; 0.1 % v/v, 4 dpf, ABxTL, none",
        "<h2>Beads</h2>",
        "method.voxel_um",
        &format!("{volume:.0} ± "),
        // The organs, as other quantities.
        "<th>volume of an eye, 10⁶ µm³</th><th>distance of the eyes, µm</th><th>swim bladder, 10⁶ µm³</th>",
        "<td>8.36 ± 0.460</td><td>334 ± 2.90</td><td>6.71 ± 0.369</td>",
    ] {
        assert!(text.contains(part), "{part}");
    }
    assert!(!text.contains("<dry>"), "what a plate map says must not become markup");
    for outside in ["src=\"http", "href=\"http", "url(http", "<script", "@import"] {
        assert!(!text.contains(outside), "{outside}");
    }
    assert_eq!(text.matches("data:image/jpeg;base64,").count(), 5, "two pictures of the larva of each run, and one model");
    // A plot of each plate, six of groups, and the charts of the gates and of the beads.
    assert_eq!(text.matches("<svg").count(), 10);
    assert!(text.contains("Bead gates of rig, nominal diameter 500 µm") && text.contains("2026-01-07"), "the gates of the data folder");
    assert!(text.contains("moved") && text.contains("residual"), "flags are listed");
    let refused = carved().arg("report").arg(&runs[0]).args(["--out", "r.pdf"]).output().unwrap();
    assert!(!refused.status.success() && stderr(&refused).contains("ends in .html"), "{}", stderr(&refused));
    assert!(!Path::new("r.pdf").exists());
}
