//! Reference larvae, from their files to the record of a specimen.

use carved::config::{Config, references};
use carved_core::carver::Leaves;
use carved_core::flag::Flag;
use carved_core::geometry::{BoxUm, VoxelGrid};
use carved_core::measure::SphereFit;
use carved_core::measure::references::{MissingReason, Quantity, References};
use carved_core::pipeline::SpecimenRecord;
use carved_core::profile::Mask;
use carved_core::quality::UsualOpacity;
use carved_core::reconstruction::{HullModel, ReconstructionSettings};
use carved_records::{Mode, PlannedWell, SpecimenKind};
use carved_store::{MEASUREMENT, MeasurementFile, Recording, RecordingReader, RecordingWriter, RigRecord};
use std::path::{Path, PathBuf};

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/references").join(name)
}

fn config() -> Config {
    Config::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("config/simulated.toml")).unwrap()
}

fn group<'a>(all: &'a [References], name: &str) -> &'a carved_core::measure::references::Group {
    all.iter().flat_map(|r| &r.groups).find(|g| g.name == name).unwrap_or_else(|| panic!("no group {name:?}"))
}

#[test]
fn every_group_of_the_papers_tables_is_built_in() {
    let all = references::embedded().unwrap();
    assert_eq!(all.iter().map(|r| r.groups.len()).collect::<Vec<_>>(), [24, 2]);
}

/// Tables 5 and 6 of the paper.
#[test]
#[cfg_attr(not(has_shared), ignore = "no folder of shared data: name it by CARVED_SHARED")]
fn the_built_in_references_are_the_papers_tables() {
    let all = references::embedded().unwrap();
    let tables = crate::common::json(&crate::common::shared("paper/tables.json"));
    let numbers = |value: &serde_json::Value| value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
    let close = |found: f64, wanted: f64, unit: f64| assert!((found / unit - wanted).abs() < 1e-9, "{found} is not {wanted} x {unit}");
    for dpf in ["3", "4", "5"] {
        let row = &tables["table5_larva_area_1e6_um2"][dpf];
        for ((asd, mean), sd) in numbers(&tables["asd"]).iter().zip(numbers(&row["mean"])).zip(numbers(&row["sd"])) {
            let g = group(&all, &format!("fixed ABxTL, {dpf} dpf, ASD {asd}"));
            let area = g.area_um2.unwrap();
            close(area.mean, mean, 1e6);
            close(area.sd, sd, 1e6);
            assert_eq!((g.n.into(), g.asd.map(f64::from)), (row["n"].as_u64().unwrap(), Some(*asd)));
            assert_eq!((g.dpf.to_string().as_str(), g.treatment.as_deref(), g.estimator.as_str()), (dpf, Some("fixed"), "voxel"));
            assert!(g.volume_um3.is_none() && g.covariance_um5.is_none() && g.voxel_um.is_none(), "not in our copy: {g:?}");
        }
    }
    let living = &tables["table6_living_larva"];
    for (name, dpf) in [("living, 4 dpf", "4_dpf"), ("living, 5 dpf", "5_dpf")] {
        let (g, row) = (group(&all, name), &living[dpf]);
        assert_eq!((u64::from(g.n), g.asd), (row["n"].as_u64().unwrap(), None));
        let area = numbers(&row["area_1e6_um2"]);
        close(g.area_um2.unwrap().mean, area[0], 1e6);
        close(g.area_um2.unwrap().sd, area[1], 1e6);
        match row.get("volume_1e8_um3") {
            Some(volume) => {
                close(g.volume_um3.unwrap().mean, numbers(volume)[0], 1e8);
                close(g.volume_um3.unwrap().sd, numbers(volume)[1], 1e8);
            }
            None => assert!(g.volume_um3.is_none()),
        }
    }
}

#[test]
fn references_are_refused_by_file_and_key() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("lab.toml");
    let text = std::fs::read_to_string(shipped("guo2017-living.toml")).unwrap();
    let refused = |text: &str| {
        std::fs::write(&file, text).unwrap();
        references::load(&file).unwrap_err().to_string()
    };
    for (from, to, said) in [
        ("n = 7", "n = 7\nnumber = 7", "number"),
        ("mean = 2.69e8", "men = 2.69e8", "men"),
        ("n = 7", "n = 2", "group \"living, 4 dpf\": n = 2; expected 3 larvae or more"),
        ("carved.references/1", "carved.references/9", "schema = \"carved.references/9\""),
        ("why = ", "because = ", "because"),
    ] {
        assert!(text.contains(from));
        let error = refused(&text.replacen(from, to, 1));
        assert!(error.contains("lab.toml") && error.contains(said), "{said} is not in: {error}");
    }
    let error = references::load(&dir.path().join("none.toml")).unwrap_err().to_string();
    assert!(error.contains("none.toml") && error.contains("cannot read"), "{error}");
}

#[test]
fn a_configuration_names_its_references_beside_itself() {
    let dir = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("config/simulated.toml")).unwrap();
    let path = dir.path().join("rig.toml");
    assert_eq!(config().references, references::embedded().unwrap(), "the paper's where none are named");
    std::fs::copy(shipped("guo2017-living.toml"), dir.path().join("mine.toml")).unwrap();
    let mine = Config::parse(&format!("references = [\"mine.toml\"]\n{text}"), &path).unwrap();
    assert_eq!(mine.references.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["Guo et al. 2017, living larvae"]);
    assert!(Config::parse(&format!("references = []\n{text}"), &path).unwrap().references.is_empty());
    let said = Config::parse(&format!("references = [\"mine.toml\", \"other.toml\"]\n{text}"), &path).unwrap_err().to_string();
    assert!(said.contains("other.toml"), "{said}");
}

/// The numbers of a ball of this radius from 21 views.
fn ball(radius_px: f64) -> SpecimenRecord {
    let camera = carved_core::geometry::Camera {
        f: 60_000.0,
        kx: 0.1,
        ky: 0.1,
        ux: 32.0,
        uy: 32.0,
        s: 0.0,
        alpha: 0.0,
        gamma: 0.0,
        phi: std::f64::consts::FRAC_PI_2,
        width: 65,
        height: 65,
        glass: None,
    };
    let mut disc = Mask::empty(65, 65);
    for (u, v) in (0..65).flat_map(|u| (0..65).map(move |v| (u, v))) {
        disc.set(u, v, (f64::from(u as u32) - 32.0).hypot(f64::from(v as u32) - 32.0) <= radius_px);
    }
    let grid = VoxelGrid::new(BoxUm { min: [-300.0; 3], max: [300.0; 3] }, 10.0).unwrap();
    let mut model = HullModel::new(grid, 21, ReconstructionSettings::default()).unwrap();
    for view in 0..21 {
        model.observe(&disc, &[], &camera.projection(std::f64::consts::TAU * f64::from(view) / 21.0), Leaves::default()).unwrap();
    }
    let measurement = serde_json::to_value(model.finish(false).unwrap().measurement).unwrap();
    serde_json::from_value(serde_json::json!({"measurement": measurement, "views": [], "closure": null, "flags": []})).unwrap()
}

/// Stores a recording with numbers and without frames.
fn recorded(folder: &Path, well: PlannedWell, references: &[References], record: SpecimenRecord) -> MeasurementFile {
    let config = config();
    let rig = RigRecord {
        name: "test".into(),
        camera: config.optics.clone(),
        pixel_format: config.camera.pixel_format(),
        empty_capillary_sha256: None,
        steps_per_revolution: config.steps_per_revolution,
        sense: config.acquisition.sense,
        rotation_identity: String::new(),
        camera_identity: String::new(),
        camera_features: std::collections::BTreeMap::default(),
        second: None,
    };
    let recording = Recording::new("r", well, Mode::Simulated, rig, "standard", config.methods["standard"].clone());
    let mut writer = RecordingWriter::create(folder, recording, None).unwrap();
    writer.add_references(references).unwrap();
    let file = MeasurementFile::new(writer.recording(), references, record);
    writer.add_json(MEASUREMENT, &file).unwrap();
    writer.close().unwrap();
    file
}

fn larva(well: &str, dpf: Option<f64>) -> PlannedWell {
    PlannedWell::new(well, SpecimenKind::Larva, dpf)
}

#[test]
fn a_recording_holds_what_its_larva_is_compared_with() {
    let dir = tempfile::tempdir().unwrap();
    let all = references::embedded().unwrap();
    let folder = dir.path().join("A01");
    let live = recorded(&folder, larva("A01", Some(3.0)), &all, ball(20.0));
    let voxel = live.reference.as_ref().unwrap().by("voxel").unwrap();
    let area = voxel.area.known().unwrap();
    assert_eq!((area.group.as_str(), area.n), ("fixed ABxTL, 3 dpf, ASD 21", 12));
    let keys: Vec<_> = area.mismatches.iter().map(|m| m.key.as_str()).collect();
    assert_eq!(keys, ["voxel_um", "treatment", "strain", "mode"], "the paper's table says nothing of the first, the plan of the others");
    let carved_core::measure::references::Answer::Missing(volume) = &voxel.volume else { panic!("there is no volume of 3 dpf") };
    assert_eq!((volume.reason, volume.quantity), (MissingReason::Quantity, Quantity::Volume));
    assert!(volume.why[0].contains("table 4") && volume.why.len() == 1, "{volume:?}");

    // The recording's own folder gives the same bytes.
    let reader = RecordingReader::open(&folder).unwrap();
    assert_eq!(reader.references().unwrap(), all.to_vec());
    let again = MeasurementFile::new(reader.recording(), &reader.references().unwrap(), live.record.clone());
    let text = String::from_utf8(carved_store::durable::json_text(&folder, &again).unwrap()).unwrap();
    assert_eq!(text, std::fs::read_to_string(folder.join(MEASUREMENT)).unwrap());
    assert_eq!(serde_json::from_str::<MeasurementFile>(&text).unwrap(), live);

    // Other reference larvae would give other numbers, so they are refused by name.
    let file = folder.join("references.json");
    let altered = std::fs::read_to_string(&file).unwrap().replacen("0.05", "0.06", 1);
    std::fs::write(&file, altered).unwrap();
    let said = reader.references().unwrap_err().to_string();
    assert!(said.contains("references.json") && said.contains("SHA-256"), "{said}");
}

#[test]
fn only_a_larva_of_known_age_has_a_place() {
    let dir = tempfile::tempdir().unwrap();
    let all = references::embedded().unwrap();
    let bead = PlannedWell { specimen: SpecimenKind::Bead, ..larva("A03", Some(3.0)) };
    for (well, given) in [(larva("A01", None), &*all), (larva("A02", Some(3.0)), &[]), (bead, &*all)] {
        let folder = dir.path().join(&well.well);
        assert_eq!(recorded(&folder, well, given, ball(20.0)).reference, None);
        assert!(!folder.join("references.json").exists());
        assert!(!std::fs::read_to_string(folder.join(MEASUREMENT)).unwrap().contains("\"reference\""));
        assert_eq!(RecordingReader::open(&folder).unwrap().references().unwrap(), []);
    }
}

/// A larva with this opacity in all views.
fn of_opacity(opacity: f64) -> SpecimenRecord {
    let likelihoods = serde_json::json!({"empty": 0.0, "larva": 1.0, "two": 0.0, "bubble": 0.0, "debris": 0.0, "bead": 0.0});
    let detection = serde_json::json!({
        "kind": "larva", "confidence": 1.0, "likelihoods": likelihoods, "clipped_left": 0.0, "clipped_right": 0.0,
        "head": {"side": null, "confidence": 0.0}, "dead": if opacity > 0.45 { 0.9 } else { 0.1 }, "opacity": opacity
    });
    let view = |index: u32| serde_json::json!({"index": index, "omega": index, "used": true, "reason": null, "area_px": 100, "quality": null, "detection": detection});
    let mut record = serde_json::to_value(ball(20.0)).unwrap();
    record["views"] = (0..5).map(view).collect();
    serde_json::from_value(record).unwrap()
}

#[test]
fn a_larva_looks_dead_beside_those_that_the_rig_measured_before_it() {
    let dir = tempfile::tempdir().unwrap();
    recorded(&dir.path().join("A01"), larva("A01", None), &[], ball(20.0));
    let recording = RecordingReader::open(&dir.path().join("A01")).unwrap().recording().clone();
    let looks_dead = |opacity: f64, usual: Option<f64>| {
        let usual_opacity = usual.map(|opacity| UsualOpacity { opacity, larvae: 4 });
        let file = MeasurementFile::new(&Recording { usual_opacity, ..recording.clone() }, &[], of_opacity(opacity));
        let again = MeasurementFile::new(&Recording { usual_opacity, ..recording.clone() }, &[], file.record.clone());
        assert_eq!(again, file, "a flag is raised once");
        file.record.flags.iter().any(|flag| *flag == Flag::DeadLooking)
    };
    assert!(looks_dead(0.6, Some(0.25)), "a dead larva of the emulated rig");
    assert!(!looks_dead(0.72, Some(0.7)), "a living larva of a dark rig");
    assert!(looks_dead(0.95, Some(0.7)), "a dead larva of a dark rig");
    assert!(!looks_dead(0.4, Some(0.1)), "no view shows it opaque");
    assert!(!looks_dead(0.95, None), "nothing is known of living larvae");
    let mut bead = of_opacity(0.95);
    bead.measurement.sphere = Some(SphereFit { diameter_um: 500.0, rms_um: 0.7, centre_um: [0.0; 3] });
    assert_eq!(bead.opacity(), None, "a bead does not live");
}

/// A run of larvae of one age and different sizes, and one bead.
fn a_run(folder: &Path, radii_px: &[f64], dpf: f64) {
    for (number, radius_px) in (1..).zip(radii_px) {
        let well = format!("A{number:02}");
        recorded(&folder.join(&well), larva(&well, Some(dpf)), &[], ball(*radius_px));
    }
    recorded(&folder.join("B01"), PlannedWell { specimen: SpecimenKind::Bead, ..larva("B01", None) }, &[], ball(20.0));
    std::fs::write(folder.join("run.json"), "{}").unwrap();
}

#[test]
fn a_labs_own_controls_become_references_that_match_its_next_larva() {
    let dir = tempfile::tempdir().unwrap();
    let (runs, out) = (dir.path().join("r1"), dir.path().join("lab.toml"));
    let radii = [18.0, 19.5, 20.0, 21.5];
    a_run(&runs, &radii, 4.0);
    let build = |more: &[&str]| {
        crate::common::run(
            &[&["reference", "build", "--out", out.to_str().unwrap(), "--source", "run r1", runs.to_str().unwrap()], more].concat(),
        )
    };
    let output = build(&[]);
    let said = crate::common::stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("B01") && said.contains("left out"), "a bead is no control: {said}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("4    "), "the table is shown");

    let lab = references::load(&out).unwrap();
    let voxel = lab.groups.iter().find(|g| g.estimator == "voxel").unwrap();
    let volumes: Vec<f64> = radii.iter().map(|r| ball(*r).measurement.volume_um3).collect();
    let mean = volumes.iter().sum::<f64>() / 4.0;
    assert!((voxel.volume_um3.unwrap().mean / mean - 1.0).abs() < 1e-12 && voxel.covariance_um5.is_some(), "{voxel:?}");
    assert_eq!((voxel.n, voxel.asd, voxel.voxel_um, voxel.epsilon), (4, Some(21), Some(10.0), Some(0.05)));
    assert!(voxel.simulated && voxel.source == "run r1");
    assert!(lab.groups.iter().any(|g| g.estimator == "field"), "every estimator has its own group");

    // The next larva of the lab is compared by both numbers and by their combination, without a remark.
    let next = recorded(&dir.path().join("next"), larva("A05", Some(4.0)), &[lab], ball(20.5));
    for estimator in ["voxel", "field"] {
        let standing = next.reference.as_ref().unwrap().by(estimator).unwrap().clone();
        let (volume, joint) = (standing.volume.known().unwrap(), standing.joint.known().unwrap());
        assert_eq!((&volume.mismatches, &joint.mismatches), (&vec![], &vec![]));
        assert!(volume.z > 0.0 && volume.n == 4, "{volume:?}");
    }

    // A bare name refers to the current folder.
    let bare = crate::common::carved().current_dir(dir.path()).args(["reference", "build", "--out", "bare.toml", "r1"]).output().unwrap();
    assert!(bare.status.success() && dir.path().join("bare.toml").is_file(), "{}", crate::common::stderr(&bare));

    let again = build(&[]);
    assert!(!again.status.success() && crate::common::stderr(&again).contains("nothing is overwritten"));
}

#[test]
fn controls_come_from_a_table_too_and_its_mistakes_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let (table, out) = (dir.path().join("controls.csv"), dir.path().join("lab.toml"));
    let build = |text: &str| {
        std::fs::write(&table, text).unwrap();
        let output = crate::common::run(&["reference", "build", "--strain", "AB", "--out", out.to_str().unwrap(), table.to_str().unwrap()]);
        (output.status.success(), crate::common::stderr(&output))
    };
    let sound = "dpf, group, asd, area_um2\n4, May, 21, 3.2e6\n4, May, 21, 3.3e6\n# a comment\n4, May, 21, 3.35e6\n";
    for (text, said) in [
        (sound.replace("asd", "views"), "unknown field `views`"),
        (sound.replace("3.3e6", "-1"), "line 3: area_um2 = -1; expected a number above 0"),
        (sound.replace("3.3e6", "big"), "line 3"),
        (sound.replace("4, May, 21, 3.35e6", "5, May, 21, 3.35e6"), "2 larva(e)"),
        (sound.replace("21, 3.35e6", "84, 3.35e6"), "ASD is mixed (21, 84)"),
        ("dpf,area_um2\n".into(), "no control larva"),
    ] {
        let (done, error) = build(&text);
        assert!(!done && error.contains(said), "{said} is not in: {error}");
        assert!(!out.exists(), "nothing is written of {text}");
    }
    let (done, error) = build(sound);
    assert!(done, "{error}");
    let group = &references::load(&out).unwrap().groups[0];
    assert_eq!((group.strain.as_deref(), group.cohort.as_deref(), group.estimator.as_str()), (Some("AB"), Some("May"), "voxel"));
    assert_eq!((group.n, group.asd, group.voxel_um, group.volume_um3), (3, Some(21), None, None));
    assert!((group.area_um2.unwrap().mean - 9.85e6 / 3.0).abs() < 1e-3 && !group.simulated);

    let shown = crate::common::run(&["reference", "show", out.to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&shown.stdout).contains("AB May"), "{shown:?}");
}

#[test]
fn the_built_in_references_are_shown_with_what_they_lack() {
    let output = crate::common::run(&["reference", "show"]);
    let shown = String::from_utf8(output.stdout).unwrap();
    for line in ["fixed ABxTL  12  21   -      0.05     voxel      -            3.200e6 +- 1.50e5", "missing: volume of 5 dpf: ", "table 4"]
    {
        assert!(shown.contains(line), "{line} is not in:\n{shown}");
    }
}

#[test]
fn beads_are_scored_against_their_nominal_diameter() {
    let dir = tempfile::tempdir().unwrap();
    let bead = |well: &str, radius_px: f64| {
        let mut record = serde_json::to_value(ball(radius_px)).unwrap();
        record["measurement"]["sphere"] = serde_json::json!({"diameter_um": 20.0 * radius_px, "rms_um": 1.0, "centre_um": [0.0, 0.0, 0.0]});
        let planned = PlannedWell { specimen: SpecimenKind::Bead, ..larva(well, None) };
        recorded(&dir.path().join("r").join(well), planned, &[], serde_json::from_value(record).unwrap());
    };
    bead("A01", 19.0);
    bead("A02", 20.0);
    std::fs::write(dir.path().join("r/run.json"), "{}").unwrap();
    let score = || crate::common::run(&["reference", "beads", "--nominal-um", "410", dir.path().join("r").to_str().unwrap()]);
    assert!(crate::common::stderr(&score()).contains("2 bead(s) found; a score needs 3 or more"));
    bead("A03", 21.0);
    let score: serde_json::Value = serde_json::from_slice(&score().stdout).unwrap();
    // Diameters 380, 400, 420 um: mean 400, SD with the divisor n 16.33, t = 10 sqrt(2) / 16.33.
    assert!((score["t_score"].as_f64().unwrap() - 0.866_025_403_784_438_6).abs() < 1e-9, "{score}");
    assert_eq!((&score["n"], &score["mean_um"]), (&serde_json::json!(3), &serde_json::json!(400.0)));
}

/// After an open quote the CSV reader takes the rest of the file for one cell: larvae would be missing without a message.
#[test]
fn a_table_with_an_open_quote_is_refused_by_the_line_of_the_quote() {
    let dir = tempfile::tempdir().unwrap();
    let (table, out) = (dir.path().join("controls.csv"), dir.path().join("lab.toml"));
    let build = |text: &str| {
        std::fs::write(&table, text).unwrap();
        let output = crate::common::run(&["reference", "build", table.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        (output.status.success(), crate::common::stderr(&output))
    };
    let larvae: String = (0..6).map(|i| format!("3,2.{i}e8,fixed\n")).collect();
    for (text, line) in [
        (format!("dpf,volume_um3,strain\n{larvae}3,2.4e8,\"AB\n{larvae}"), 8),
        (format!("\u{feff}\"dpf,volume_um3,strain\n{larvae}"), 1),
        (format!("# \"said\ndpf,volume_um3,strain\n3,2.4e8,\"A \"\"B\n{larvae}"), 3),
    ] {
        let (built, said) = build(&text);
        assert!(!built && said.contains(&format!("controls.csv, line {line}: a quote opens")) && !out.exists(), "{text}: {said}");
    }
    // A quote in a comment or inside a cell does not open a quotation.
    let (built, said) = build(&format!("# \"said\ndpf,volume_um3,strain\n3,2.4e8,5\" AB\n{larvae}"));
    assert!(!said.contains("quote"), "{built}: {said}");
}
