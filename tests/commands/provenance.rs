//! `carved export methods` and `rocrate`, and `carved report`.

use crate::common::{carved, gates, json, stderr, strict, venv};
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
    ] {
        assert!(text.contains(part), "{part}\n{text}");
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
    done(&make(&["--orcid", orcid]));
    let made = json(&run.join("ro-crate-metadata.json"));
    let graph = made["@graph"].as_array().unwrap();
    let entity = |id: &str| graph.iter().find(|e| e["@id"] == id).unwrap_or_else(|| panic!("no {id} in {made:#}"));
    let sums = std::fs::read_to_string(run.join("A01/SHA256SUMS")).unwrap();
    for line in sums.lines() {
        let (hash, name) = line.split_once("  ").unwrap();
        assert_eq!(entity(&format!("A01/{name}"))["sha256"], hash, "{name}");
    }
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
    let validate = || Command::new(&python).arg(&program).arg(&run).output().unwrap();
    let output = validate();
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
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
        ("carved_exposure_id", "ZECO:0000111".into()),
        ("carved_outcome", "succeeded".into()),
    ] {
        assert_eq!(larva[condition], expected, "{condition}");
    }
    assert_eq!(model["assay_conditions"][1]["conditions"]["carved_flags"], "moved;residual");

    // carved reads it as the plate map that it was.
    let checked = carved().args(["plate", "check", "--json"]).arg(&back).output().unwrap();
    done(&checked);
    let map: Value = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(map["plate_map"], stored["plan"]["plate_map"]);
}

#[test]
fn a_report_has_everything_inside_and_escapes_what_plate_maps_say() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let runs = [plate(&data, "r1", "P-1", 96), plate(&data, "r2", "P-2", 4)];
    // A triangle, as carved writes a mesh.
    let numbers: Vec<u8> = [0.0f32, 0.0, 0.0, 3000.0, 0.0, 0.0, 0.0, 600.0, 400.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let face: Vec<u8> = std::iter::once(3).chain([0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes())).collect();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    std::fs::write(runs[0].join("A01/mesh.ply"), [header.as_bytes(), &numbers, &face].concat()).unwrap();
    gates::keep(&data.join("calibrations"));
    let out = dir.path().join("report.html");
    done(&carved().arg("report").args(&runs).arg("--out").arg(&out).output().unwrap());
    let text = std::fs::read_to_string(&out).unwrap();
    let volume = example("larva.json")["measurement"]["volume_um3"].as_f64().unwrap() / 1e6;
    for part in [
        "<!DOCTYPE html>",
        "Simulated: the frames were rendered",
        "Plate P-1, run r1",
        "negative control: DMSO, &quot;&lt;dry&gt;&quot; 0.1 % v/v, 4 dpf, ABxTL, none",
        "<h2>Beads</h2>",
        "method.voxel_um",
        &format!("{volume:.0} ± "),
    ] {
        assert!(text.contains(part), "{part}");
    }
    assert!(!text.contains("<dry>"), "what a plate map says must not become markup");
    for outside in ["src=\"http", "href=\"http", "url(http", "<script", "@import"] {
        assert!(!text.contains(outside), "{outside}");
    }
    assert_eq!(text.matches("data:image/jpeg;base64,").count(), 5, "two pictures of the larva of each run, and one model");
    // A plot of each plate, three of groups, and the charts of the gates and of the beads.
    assert_eq!(text.matches("<svg").count(), 7);
    assert!(text.contains("Bead gates of rig, nominal diameter 500 µm") && text.contains("2026-01-07"), "the gates of the data folder");
    assert!(text.contains("moved") && text.contains("residual"), "flags are listed");
    let refused = carved().arg("report").arg(&runs[0]).args(["--out", "r.pdf"]).output().unwrap();
    assert!(!refused.status.success() && stderr(&refused).contains("ends in .html"), "{}", stderr(&refused));
    assert!(!Path::new("r.pdf").exists());
}
