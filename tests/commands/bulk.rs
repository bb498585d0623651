//! `carved measure --out`: shards, what is left out, what is computed again, and the table of all.
//!
//! ```text
//!  two runs, three beads ─┬─ measure, stored ───────────────── export table ──────────────────────┐
//!                         └─ measure --out, shard by shard ─── export table --measurements ─── the same bytes
//! ```

use super::import_plate::{scene, shoot};
use crate::common::{carved, json, run, stderr};
use hardware_sim::scene::Specimen;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

struct Bench {
    dir: tempfile::TempDir,
    runs: [String; 2],
}

impl Bench {
    /// Two runs of four views per well: two beads, and one bead.
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let data = dir.path().join("data");
        let plates = [("P-1", &[("A01", 400.0), ("A02", 500.0)][..]), ("P-2", &[("A01", 450.0)][..])];
        let runs = plates.map(|(barcode, wells)| {
            let pictures = dir.path().join(barcode);
            for (well, diameter_um) in wells {
                let bead = scene(Specimen::bead(*diameter_um).unwrap());
                shoot(&bead, 4, 4, |i| pictures.join(format!("W_{well}_1_{}.tiff", i + 1)));
            }
            let args =
                ["import", text(&pictures), "--plate", barcode, "--data", text(&data), "--even", "--specimen", "bead", "--voxel", "14"];
            let output = run(&[&args[..], &["--operator", "kim"]].concat());
            assert!(output.status.success(), "{}", stderr(&output));
            text(&data.join("runs").join(barcode)).to_owned()
        });
        Self { dir, runs }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Measures both runs into `out`. Returns the exit code, the summary and what is said.
    fn measure(&self, out: &str, more: &[&str]) -> (Option<i32>, Value, String) {
        let out = self.path(out);
        let output = run(&[&["measure", "--out", text(&out), &self.runs[1], &self.runs[0]], more].concat());
        (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or_default(), stderr(&output))
    }

    fn counts(&self, out: &str, more: &[&str]) -> [u64; 4] {
        let (code, summary, said) = self.measure(out, more);
        assert_eq!(code, Some(0), "{said}");
        ["recordings", "measured", "left_out", "failed"].map(|key| summary[key].as_u64().unwrap())
    }

    fn table(&self, more: &[&str]) -> String {
        let output = run(&[&["export", "table", &self.runs[0], &self.runs[1]], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The files below a folder, by their path in it.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = PathBuf::from(entry.file_name().unwrap());
        if entry.is_dir() {
            found.extend(tree(&entry).into_iter().map(|(inner, bytes)| (name.join(inner), bytes)));
        } else {
            found.insert(name, fs::read(&entry).unwrap());
        }
    }
    found
}

#[test]
fn shards_give_the_table_of_a_serial_measurement_byte_by_byte() {
    let bench = Bench::new();
    assert_eq!(bench.counts("all", &["--shard", "1/2", "--jobs", "1"]), [2, 2, 0, 0]);
    // The name of each result is that of its recording, whichever shard measured it.
    assert!(bench.path("all/P-1/A01/measurement.json").is_file() && !bench.path("all/P-1/A02").exists());
    assert_eq!(bench.counts("all", &["--shard", "2/2", "--jobs", "3"]), [1, 1, 0, 0]);
    assert_eq!(bench.counts("all", &[]), [3, 0, 3, 0], "all of it is done");
    for recording in ["P-1/A01", "P-1/A02", "P-2/A01"] {
        let stored = fs::read(bench.path("data/runs").join(recording).join("measurement.json")).unwrap();
        assert!(fs::read(bench.path("all").join(recording).join("measurement.json")).unwrap() == stored, "{recording}");
    }
    assert_eq!(bench.table(&["--measurements", text(&bench.path("all"))]), bench.table(&[]));

    // As where a scheduler starts a job again while the first one still runs: both write each result.
    let twins = [(); 2].map(|()| {
        let mut twin = carved();
        twin.args(["measure", "--jobs", "1", "--out"]).arg(bench.path("twins")).args(&bench.runs).stdout(Stdio::null()).spawn().unwrap()
    });
    for mut twin in twins {
        assert!(twin.wait().unwrap().success());
    }
    assert!(tree(&bench.path("twins")) == tree(&bench.path("all")), "the same files with the same bytes, and none beside them");
}

#[test]
fn results_never_get_into_stored_recordings() {
    let bench = Bench::new();
    let before = tree(&bench.path("data"));
    let method = bench.path("coarse.toml");
    fs::write(&method, "asd = 4\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 28.0\n").unwrap();
    let link = bench.path("link");
    symlink(bench.path("data/runs"), &link).unwrap();
    fs::create_dir(bench.path("links")).unwrap();
    symlink(bench.path("data/runs/P-1"), bench.path("links/P-1")).unwrap();
    // The data folder of another instrument.
    fs::create_dir_all(bench.path("other/runs")).unwrap();
    fs::write(bench.path("other/instrument.json"), "{}").unwrap();
    for (out, relation) in [
        ("data/runs", "is"),
        ("data/runs/P-1", "is"),
        ("data/runs/P-1/A01", "is"),
        ("data/runs/P-1/A01/again", "lies inside"),
        ("data/runs/new/folder", "lies inside"),
        ("missing/../data/runs", "is"),
        ("link/P-2", "is"),
        ("links", "is"),
        ("data", "holds"),
        ("", "holds"),
        ("other", "is"),
        ("other/again", "lies inside"),
    ] {
        for more in [&[][..], &["--method", text(&method)]] {
            let (code, _, said) = bench.measure(out, more);
            assert_eq!(code, Some(1), "{out}: {said}");
            let [written, stored] = [out, if out.starts_with("other") { "other" } else { "data" }].map(|name| bench.path(name));
            let [written, stored] = [text(&written), text(&stored)];
            let words = said.contains(&format!(" {relation} {stored}")) && said.contains("Choose a folder outside the data folder");
            assert!(words && said.contains(written), "{out}: {said}");
        }
    }
    assert!(tree(&bench.path("data")) == before, "a stored file was changed");
    assert!(!bench.path("missing").exists());

    // Where the first guard sees nothing: the folder of one result is a link.
    fs::create_dir_all(bench.path("out/P-2")).unwrap();
    symlink(bench.path("data/runs/P-2/A01"), bench.path("out/P-2/A01")).unwrap();
    let (code, _, said) = bench.measure("out", &[]);
    assert!(code == Some(1) && said.contains("P-2/A01: this is the folder of a recording"), "{said}");
    assert!(tree(&bench.path("data")) == before, "a stored file was changed");
}

#[test]
fn a_folder_of_runs_is_refused_in_every_shard() {
    let bench = Bench::new();
    for folder in ["data/runs", "data"] {
        let named = bench.path(folder);
        for shard in ["1/2", "2/2"] {
            let output = run(&["measure", "--out", text(&bench.path("out")), "--shard", shard, text(&named)]);
            let expected = format!("{} holds runs: name {}/*", named.display(), bench.path("data/runs").display());
            assert!(output.status.code() == Some(1) && stderr(&output).contains(&expected), "{shard}: {}", stderr(&output));
        }
        let output = run(&["measure", text(&named)]);
        assert!(output.status.code() == Some(1) && stderr(&output).contains("holds runs"), "{}", stderr(&output));
    }
    assert!(!bench.path("out").exists());
}

#[test]
fn a_signal_ends_it_with_a_line_that_says_how_far_it_came() {
    const COPIES: usize = 100;
    let bench = Bench::new();
    let files = tree(Path::new(&bench.runs[1]).join("A01").as_path());
    // So many that none of the signals comes after the last one.
    let copies: Vec<PathBuf> = (0..COPIES).map(|i| bench.path("copies").join(format!("W{i:03}"))).collect();
    for (copy, (name, bytes)) in copies.iter().flat_map(|copy| files.iter().map(move |file| (copy, file))) {
        fs::create_dir_all(copy.join(name).parent().unwrap()).unwrap();
        fs::write(copy.join(name), bytes).unwrap();
    }
    for (signal, name, first) in [(Signal::SIGTERM, "SIGTERM", "measured in"), (Signal::SIGINT, "SIGINT", "was measured before")] {
        let mut command = carved();
        command.args(["measure", "--jobs", "1", "--out"]).arg(bench.path("out")).args(&copies);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        let line = lines.next().unwrap();
        assert!(line.starts_with(&format!("carved: 1 of {COPIES}, copies/W000: {first}")), "{line}");
        kill(Pid::from_raw(child.id().try_into().unwrap()), signal).unwrap();
        let rest: Vec<String> = lines.collect();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
        let expected = format!(" of {COPIES} recordings are done, 0 failed. Start the same command again");
        assert!(rest.iter().any(|line| line.starts_with(&format!("carved: {name}: ")) && line.contains(&expected)), "{rest:?}");
    }
}

#[test]
fn what_is_not_intact_or_of_another_method_is_computed_again() {
    let bench = Bench::new();
    assert_eq!(bench.counts("out", &[]), [3, 3, 0, 0]);
    let result = bench.path("out/P-1/A02");
    let sums = fs::read(result.join("SHA256SUMS")).unwrap();
    // As a job leaves it that was killed, and as a broken disk does.
    fs::remove_file(result.join("SHA256SUMS")).unwrap();
    fs::write(bench.path("out/P-2/A01/measurement.json"), "{}").unwrap();
    assert_eq!(bench.counts("out", &[]), [3, 2, 1, 0]);
    assert_eq!(fs::read(result.join("SHA256SUMS")).unwrap().len(), sums.len());

    let method = bench.path("coarse.toml");
    fs::write(&method, "asd = 4\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 28.0\n").unwrap();
    assert_eq!(bench.counts("out", &["--method", text(&method)]), [3, 3, 0, 0]);
    assert_eq!(bench.counts("out", &["--method", text(&method)]), [3, 0, 3, 0]);
    let file = json(&result.join("measurement.json"));
    assert_eq!(file["measurement"]["voxel_size_um"], 28.0, "{}", file["measurement"]);
    let table = bench.table(&["--measurements", text(&bench.path("out"))]);
    let flags = file["flags"].as_array().unwrap().iter().map(|flag| flag.as_str().unwrap()).collect::<Vec<_>>().join(";");
    assert!(table.lines().skip(1).all(|row| row.contains(",coarse,,")), "the method of the numbers, not that of the run: {table}");
    assert!(table.lines().nth(2).unwrap().contains(&format!(",{flags},")), "the flags of the numbers, {flags}: {table}");
}

#[test]
fn a_well_without_numbers_in_the_folder_has_nothing_of_the_earlier_computation() {
    let bench = Bench::new();
    // Of three, the first and the third.
    assert_eq!(bench.counts("part", &["--shard", "1/2"]), [2, 2, 0, 0]);
    let (part, file) = (bench.path("part"), bench.path("part.csv"));
    let output = run(&["export", "table", &bench.runs[0], &bench.runs[1], "--measurements", text(&part), "--out", text(&file)]);
    let said = stderr(&output);
    assert!(output.status.success() && said.contains(&format!("1 of 3 measured wells have no numbers in {}", text(&part))), "{said}");
    let mut reader = csv::Reader::from_path(&file).unwrap();
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().collect::<Result<_, _>>().unwrap();
    let (measured, missing) = (&rows[0], &rows[1]);
    assert_eq!((missing["well"].as_str(), missing["outcome"].as_str()), ("A02", "succeeded"));
    assert_eq!((missing["reason"].as_str(), measured["reason"].as_str()), ("not_measured_again", ""));
    for column in [
        "flag_count",
        "method",
        "method_sha256",
        "software_version",
        "software_commit",
        "software_dirty",
        "volume_um3",
        "measurement_sha256",
        "views_planned",
    ] {
        assert_eq!(missing[column], "", "{column}");
        assert!(!measured[column].is_empty(), "{column}");
    }
}

#[test]
fn what_cannot_be_measured_is_reported_and_the_rest_is_measured() {
    let bench = Bench::new();
    let method = bench.path("coarse.toml");
    fs::write(&method, "asd = 4\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 28.0\n").unwrap();
    assert_eq!(bench.counts("out", &["--method", text(&method)]), [3, 3, 0, 0]);
    fs::remove_dir_all(bench.path("data/runs/P-1/A01/frames")).unwrap();
    let (code, summary, said) = bench.measure("out", &[]);
    assert_eq!((code, &summary["measured"], &summary["failed"]), (Some(3), &2.into(), &1.into()), "{said}");
    assert!(said.contains("P-1/A01") && said.contains("1 recording(s) could not be measured"), "{said}");
    let table = bench.table(&["--measurements", text(&bench.path("out"))]);
    assert_eq!(table.lines().count(), 4, "a row without numbers is there: {table}");
    assert!(!table.contains(",coarse,"), "numbers of the earlier method stand for those that failed: {table}");

    // A table has each run once: another run of this name is refused before anything is computed, whatever its wells are.
    let twin = bench.path("copy/P-2");
    fs::create_dir_all(twin.join("H12")).unwrap();
    let (code, _, said) = bench.measure("twins", &[text(&twin.join("H12"))]);
    assert_eq!((code, bench.path("twins").exists()), (Some(1), false));
    assert!(said.contains("are two runs of the name P-2"), "{said}");
    // The same run in a folder of another name.
    let renamed = bench.path("copy/P-2-again");
    fs::create_dir_all(renamed.join("A01")).unwrap();
    fs::copy(Path::new(&bench.runs[1]).join("run.json"), renamed.join("run.json")).unwrap();
    let (code, _, said) = bench.measure("renamed", &[text(&renamed.join("A01"))]);
    assert_eq!((code, bench.path("renamed").exists()), (Some(1), false));
    assert!(said.contains("P-2-again are two runs of the name P-2"), "{said}");
    fs::write(bench.path("file"), "").unwrap();
    let (code, _, said) = bench.measure("file", &[]);
    assert_eq!(code, Some(1), "{said}");
    for (more, expected) in [(["--shard", "0/2"], "3/16"), (["--jobs", "0"], "--jobs")] {
        assert!(bench.measure("out", &more).2.contains(expected), "{more:?}");
    }
}

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(name)
}

/// A folder with `carved`, to be the first one of the path.
fn path_with_carved(bench: &Bench) -> String {
    let bin = bench.path("bin");
    fs::create_dir(&bin).unwrap();
    symlink(carved().get_program(), bin.join("carved")).unwrap();
    format!("{}:{}", text(&bin), std::env::var("PATH").unwrap())
}

/// The table of the runs as they were measured first.
fn stored_table(bench: &Bench) -> Vec<u8> {
    let table = bench.path("stored.csv");
    let output = carved().args(["export", "table"]).args(&bench.runs).arg("--out").arg(&table).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    fs::read(table).unwrap()
}

/// `examples/biomero/measure` with the options of BIOMERO's job template.
#[test]
fn the_workflow_of_biomero_measures_the_runs_of_a_folder() {
    let bench = Bench::new();
    let path = path_with_carved(&bench);
    let (input, out) = (bench.path("data/runs"), bench.path("out"));
    fs::create_dir(&out).unwrap();
    let measure = |more: &[&str]| Command::new(example("biomero/measure")).args(more).env("PATH", &path).output().unwrap();
    let always = ["--infolder", text(&input), "--outfolder", text(&out), "--gtfolder", "/nowhere", "--local"];
    let output = measure(&[&always[..], &["-nmc"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(fs::read(out.join("specimens.csv")).unwrap() == stored_table(&bench));
    // Another method, as a parameter; one run; and what is no option.
    let method = bench.path("coarse.toml");
    fs::write(&method, "asd = 4\norder = \"sequential\"\nepsilon = 0.1\nvoxel_um = 20\n").unwrap();
    let other = measure(&["--infolder", &bench.runs[1], "--outfolder", text(&out), "--local", "--method", text(&method), "-nmc"]);
    assert!(other.status.success(), "{}", stderr(&other));
    let table = fs::read_to_string(out.join("specimens.csv")).unwrap();
    assert!(table.lines().count() == 2 && table.contains("coarse"), "{table}");
    for (wrong, why) in [(vec!["--infolder", "/nowhere", "--outfolder", text(&out)], "has no run"), (vec!["--gpu"], "is no option")] {
        let refused = measure(&wrong);
        assert!(refused.status.code() == Some(2) && stderr(&refused).contains(why), "{}", stderr(&refused));
    }
}

/// The script of the Nextflow module, with its variables replaced as Nextflow does, in a folder where the runs are links. Nextflow itself is not run.
#[test]
fn the_script_of_the_nextflow_module_measures_linked_runs() {
    let bench = Bench::new();
    let path = path_with_carved(&bench);
    let module = fs::read_to_string(example("nextflow/modules/carved/measure/main.nf")).unwrap();
    let script = module.split_once("script:").unwrap().1.split("\"\"\"").nth(1).unwrap();
    let work = bench.path("work");
    fs::create_dir_all(work.join("runs")).unwrap();
    let staged = bench.runs.each_ref().map(|run| {
        let link = Path::new("runs").join(Path::new(run).file_name().unwrap());
        symlink(run, work.join(&link)).unwrap();
        text(&link).to_owned()
    });
    let mut filled = script.replace("\\\\", "\\").replace("\\$", "$");
    for (name, value) in [("prefix", "screen"), ("task.cpus", "1"), ("with_method", ""), ("args", ""), ("runs", &staged.join(" "))] {
        assert!(filled.contains(&format!("${{{name}}}")), "{name}");
        filled = filled.replace(&format!("${{{name}}}"), value);
    }
    assert!(!filled.contains("${"), "{filled}");
    let output = Command::new("bash").args(["-euo", "pipefail", "-c", &filled]).current_dir(&work).env("PATH", &path).output().unwrap();
    assert!(output.status.success(), "{filled}{}", stderr(&output));
    assert!(fs::read(work.join("screen.csv")).unwrap() == stored_table(&bench));
    assert!(work.join("screen_measurements/P-1/A02/measurement.json").is_file());
    // What the module emits is described.
    let meta = fs::read_to_string(example("nextflow/modules/carved/measure/meta.yml")).unwrap();
    let emitted: Vec<&str> = module.split("emit: ").skip(1).map(|rest| rest.lines().next().unwrap()).collect();
    assert_eq!(emitted, ["measurements", "table", "versions_carved"]);
    assert!(emitted.iter().all(|name| meta.contains(&format!("\n  {name}:\n"))), "{meta}");
}
