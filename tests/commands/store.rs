//! Commands on stored runs: archive, prune, index, replay.

use crate::common::stored::stored;
use crate::common::{carved, run, stderr};
use carved_records::RunOutcome;
use carved_store::{Claim, Store};
use std::path::{Path, PathBuf};
use std::process::Output;

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(output))
}

#[test]
fn a_run_is_archived_with_a_receipt_and_pruned_only_while_the_copy_is_good() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "r1", Some(RunOutcome::Failed));
    let at = |args: &[&str]| carved().current_dir(dir.path()).args(args).output().unwrap();
    let here = data.join("runs/r1");
    let frame = here.join("A01/frames/view_001.png");

    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("never archived"), "{}", text(&output));
    // Names without a folder in front, as one types them.
    let output = at(&["archive", "data/runs/r1", "--to", "copies"]);
    assert!(output.status.success() && text(&output).contains("every hash verified"), "{}", text(&output));
    let copy = dir.path().join("copies/r1");
    for name in ["run.json", "A01/recording.json", "A01/frames/view_001.png", "A01/SHA256SUMS"] {
        assert_eq!(std::fs::read(copy.join(name)).unwrap(), std::fs::read(here.join(name)).unwrap(), "{name}");
    }
    assert!(copy.join("archive.json").is_file());

    // A copy with one flipped bit is refused.
    let good = std::fs::read(copy.join("A01/mesh.ply")).unwrap();
    std::fs::write(copy.join("A01/mesh.ply"), b"plz").unwrap();
    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("its copy is not good"), "{}", text(&output));
    std::fs::write(copy.join("A01/mesh.ply"), good).unwrap();
    // A copy that differs from a later change of the original is refused too.
    let kept = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, b"changed since").unwrap();
    let output = at(&["prune", "data", "r1", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("view_001.png is not in its copy"), "{}", text(&output));
    std::fs::write(&frame, kept).unwrap();

    let output = at(&["prune", "data"]);
    assert!(output.status.success() && text(&output).contains("r1: would remove 3 files"), "{}", text(&output));
    assert!(frame.is_file(), "a dry run removes nothing");
    let output = at(&["prune", "data", "--yes"]);
    assert!(output.status.success() && text(&output).contains("r1: removed 3 files"), "{}", text(&output));
    assert!(!frame.exists() && here.join("A01/mesh.ply").is_file() && here.join("A01/recording.json").is_file());
    let output = at(&["archive", "data/runs/r1", "--to", "others"]);
    assert!(!output.status.success() && text(&output).contains("view_000.png"), "no copy of half a run: {}", text(&output));

    let output = at(&["prune", "data", "r1", "--all", "--yes"]);
    assert!(output.status.success(), "{}", text(&output));
    assert!(!here.exists() && copy.join("A01/frames/view_001.png").is_file());
    let store = Claim::on(&data).and_then(Store::open).unwrap().0;
    assert_eq!(store.budget(None).unwrap().used_bytes, 0);
}

#[test]
fn a_run_under_way_is_not_archived_and_other_files_are_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "open", None);
    stored(&data, "r1", Some(RunOutcome::Failed));
    let to = dir.path().join("copies");
    let archive = |id: &str, to: &Path| run(&["archive", data.join("runs").join(id).to_str().unwrap(), "--to", to.to_str().unwrap()]);
    assert!(text(&archive("open", &to)).contains("no outcome"), "{}", text(&archive("open", &to)));
    std::fs::create_dir_all(to.join("r1/A01")).unwrap();
    std::fs::write(to.join("r1/A01/mesh.ply"), "somebody's").unwrap();
    let output = archive("r1", &to);
    assert!(!output.status.success() && text(&output).contains("nothing is overwritten"), "{}", text(&output));
    // An interrupted copy is completed.
    std::fs::remove_file(to.join("r1/A01/mesh.ply")).unwrap();
    assert!(archive("r1", &to).status.success());
    assert!(text(&archive("r1", &data.join("runs"))).contains("apart from the run's own"));
    std::fs::write(data.join("runs/r1/A01/mesh.ply"), "altered").unwrap();
    assert!(text(&archive("r1", &dir.path().join("more"))).contains("SHA-256"));
}

/// Every file below a folder.
fn files_of(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.symlink_metadata().unwrap().is_dir() { found.extend(files_of(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// Replaces the destination in the run's only receipt.
fn receipt_names(run: &Path, destination: &Path) {
    let receipt = files_of(&run.join("archives")).pop().unwrap();
    let mut value = crate::common::json(&receipt);
    value["destination"] = destination.to_str().unwrap().into();
    std::fs::write(&receipt, value.to_string()).unwrap();
}

/// A receipt may name any destination: it may have been edited or restored, or its disk may be mounted elsewhere.
#[test]
fn a_prune_keeps_a_run_whose_copy_is_the_run_itself() {
    use std::os::unix::fs::symlink;
    type Alias = fn(&Path, &Path, &Path);
    let copies_of = |run: &Path, copy: &Path, link: fn(&Path, &Path)| {
        std::fs::remove_dir_all(copy).unwrap();
        for file in files_of(run).iter().filter(|file| !file.starts_with(run.join("archives"))) {
            let to = copy.join(file.strip_prefix(run).unwrap());
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            link(file, &to);
        }
    };
    let aliases: [(&str, Alias); 7] = [
        ("the run's own folder", |run, _, _| receipt_names(run, run)),
        ("a path with ..", |run, _, dir| receipt_names(run, &dir.join("copies/../data/runs/r1"))),
        ("a symlink to the run", |run, _, dir| {
            symlink(run, dir.join("elsewhere")).unwrap();
            receipt_names(run, &dir.join("elsewhere"));
        }),
        ("a symlink above the run", |run, _, dir| {
            symlink(dir.join("data"), dir.join("other")).unwrap();
            receipt_names(run, &dir.join("other/runs/r1"));
        }),
        ("a folder inside the run", |run, copy, _| {
            std::fs::rename(copy, run.join("archives/copy")).unwrap();
            std::fs::rename(run.join("archives"), run.join("a")).unwrap();
            std::fs::create_dir(run.join("archives")).unwrap();
            std::fs::rename(run.join("a/copy"), run.join("archives/copy")).unwrap();
            for receipt in std::fs::read_dir(run.join("a")).unwrap() {
                let receipt = receipt.unwrap();
                std::fs::rename(receipt.path(), run.join("archives").join(receipt.file_name())).unwrap();
            }
            std::fs::remove_dir(run.join("a")).unwrap();
            let receipt = std::fs::read_dir(run.join("archives")).unwrap().map(|e| e.unwrap().path()).find(|p| p.is_file()).unwrap();
            let mut value = crate::common::json(&receipt);
            value["destination"] = run.join("archives/copy").to_str().unwrap().into();
            std::fs::write(&receipt, value.to_string()).unwrap();
        }),
        ("hard links", |_, _, _| ()),
        ("symlinks", |_, _, _| ()),
    ];
    for (name, alias) in aliases {
        for all in [false, true] {
            let dir = tempfile::tempdir().unwrap();
            let root = dir.path().canonicalize().unwrap();
            let data = root.join("data");
            stored(&data, "r1", Some(RunOutcome::Failed));
            let (here, copy) = (data.join("runs/r1"), root.join("copies/r1"));
            assert!(run(&["archive", here.to_str().unwrap(), "--to", root.join("copies").to_str().unwrap()]).status.success());
            match name {
                "hard links" => copies_of(&here, &copy, |from, to| std::fs::hard_link(from, to).unwrap()),
                "symlinks" => copies_of(&here, &copy, |from, to| symlink(from, to).unwrap()),
                _ => alias(&here, &copy, &root),
            }
            let before = files_of(&here);
            let mut args = vec!["prune", data.to_str().unwrap(), "r1", "--yes"];
            args.extend(all.then_some("--all"));
            let output = run(&args);
            assert!(here.exists() && files_of(&here) == before, "{name}, all {all}: files of the run were removed\n{}", text(&output));
            assert!(!output.status.success() && text(&output).contains("no copy"), "{name}, all {all}: {}", text(&output));
        }
    }
}

#[test]
fn an_archive_into_the_run_itself_is_refused_and_leaves_nothing_there() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "r1", Some(RunOutcome::Failed));
    let here = data.join("runs/r1");
    symlink(&here, dir.path().join("link")).unwrap();
    std::fs::create_dir_all(dir.path().join("linked")).unwrap();
    symlink(&here, dir.path().join("linked/r1")).unwrap();
    std::fs::create_dir_all(dir.path().join("hard/r1")).unwrap();
    std::fs::hard_link(here.join("run.json"), dir.path().join("hard/r1/run.json")).unwrap();
    let before = files_of(&data);
    for to in ["data/runs", "data/runs/r1", "data/runs/r1/sub/sub", "link", "link/sub", "data/runs/r1/../../runs", "linked", "hard"] {
        let output = run(&["archive", here.to_str().unwrap(), "--to", dir.path().join(to).to_str().unwrap()]);
        assert!(!output.status.success() && text(&output).contains("apart from the run"), "{to}: {}", text(&output));
        assert!(files_of(&data) == before && !here.join("sub").exists(), "{to}: the run was changed");
        assert!(!here.join("archives").exists(), "{to}: a receipt was written");
    }
}

/// A run with a link to its own folder, to a folder and a file of somebody else, and a pipe, is refused by what it has. Nothing is followed.
#[test]
fn links_in_a_run_are_followed_by_no_command() {
    use std::os::unix::fs::symlink;
    type Make<'a> = &'a dyn Fn(&Path);
    let dir = tempfile::tempdir().unwrap();
    let (data, copies, other) = (dir.path().join("data"), dir.path().join("copies"), dir.path().join("other"));
    stored(&data, "r1", Some(RunOutcome::Failed));
    let here = data.join("runs/r1");
    let carved = |args: &[&str]| run(args);
    let archive = || carved(&["archive", here.to_str().unwrap(), "--to", copies.to_str().unwrap()]);
    assert!(archive().status.success());
    std::fs::create_dir_all(other.join("frames")).unwrap();
    std::fs::write(other.join("frames/view_000.png"), "of somebody else").unwrap();
    let odd: [(&str, Make); 4] = [
        ("l1", &|path| symlink("..", path).unwrap()),
        ("A02", &|path| symlink(&other, path).unwrap()),
        ("A01/frames/view_009.png", &|path| symlink(other.join("frames/view_000.png"), path).unwrap()),
        ("A01/pipe", &|path| nix::unistd::mkfifo(path, nix::sys::stat::Mode::S_IRWXU).unwrap()),
    ];
    let before = (files_of(&other), files_of(&copies), files_of(&here));
    for (name, make) in odd {
        make(&here.join(name));
        for output in [
            archive(),
            carved(&["prune", data.to_str().unwrap(), "r1", "--yes"]),
            carved(&["prune", data.to_str().unwrap(), "r1", "--all", "--yes"]),
        ] {
            assert!(!output.status.success() && text(&output).contains(name), "{name}: {}", text(&output));
        }
        std::fs::remove_file(here.join(name)).unwrap();
        assert_eq!((files_of(&other), files_of(&copies), files_of(&here)), before, "{name}");
    }
    // A run that is a link is none of this data folder.
    symlink(&here, data.join("runs/r2")).unwrap();
    let output = carved(&["prune", data.to_str().unwrap(), "r2", "--all", "--yes"]);
    assert!(!output.status.success() && text(&output).contains("r2") && here.is_dir(), "{}", text(&output));
    let output = carved(&["prune", data.to_str().unwrap(), "r1", "--all", "--yes"]);
    assert!(output.status.success() && !here.exists(), "{}", text(&output));
    assert_eq!(files_of(&other), before.0);
}

/// Copies in memory. Something happens to the run while one is read again.
struct Copies<'a> {
    objects: &'a std::sync::Mutex<std::collections::BTreeMap<String, Vec<u8>>>,
    meanwhile: &'a dyn Fn(),
}

impl carved_store::Objects for Copies<'_> {
    fn get(&self, address: &str) -> Result<Option<Vec<u8>>, carved_store::StoreError> {
        (self.meanwhile)();
        Ok(self.objects.lock().unwrap().get(address).cloned())
    }

    fn put(&self, address: &str, bytes: Vec<u8>) -> Result<(), carved_store::StoreError> {
        self.objects.lock().unwrap().insert(address.to_owned(), bytes);
        Ok(())
    }
}

/// A replay, another program or an operator adds files while the copy is read, which takes minutes.
#[test]
fn what_is_added_to_a_run_while_its_copy_is_read_is_not_removed() {
    use carved_store::{Packing, RunClaim, archive_to_objects, prune};
    static HERE: std::sync::OnceLock<PathBuf> = std::sync::OnceLock::new();
    static OBJECTS: std::sync::Mutex<std::collections::BTreeMap<String, Vec<u8>>> =
        std::sync::Mutex::new(std::collections::BTreeMap::new());
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "r1", Some(RunOutcome::Failed));
    let here = HERE.get_or_init(|| data.join("runs/r1"));
    archive_to_objects(here, "s3://copies", Packing::Files, &Copies { objects: &OBJECTS, meanwhile: &|| () }).unwrap();
    let pruned = |all: bool, meanwhile: &'static (dyn Fn() + Sync)| {
        prune(&data, "r1", all, true, &|_| Ok(Box::new(Copies { objects: &OBJECTS, meanwhile })))
    };
    let whole = files_of(here);
    let added: [(&str, &'static (dyn Fn() + Sync)); 3] = [
        ("A01/replays/m2/measurement.json", &|| {
            std::fs::create_dir_all(HERE.get().unwrap().join("A01/replays/m2")).unwrap();
            std::fs::write(HERE.get().unwrap().join("A01/replays/m2/measurement.json"), "{}").unwrap();
        }),
        ("A01/frames/view_001.png", &|| {
            std::fs::write(HERE.get().unwrap().join("A01/frames/view_001.png"), "another frame").unwrap();
        }),
        ("A01/mesh.ply", &|| {
            // The same bytes in another file: it has been replaced, so what was verified is not what is there.
            std::fs::write(HERE.get().unwrap().join("new"), "ply").unwrap();
            std::fs::rename(HERE.get().unwrap().join("new"), HERE.get().unwrap().join("A01/mesh.ply")).unwrap();
        }),
    ];
    let frame = std::fs::read(here.join("A01/frames/view_001.png")).unwrap();
    for (name, meanwhile) in added {
        for all in [true, false] {
            let error = pruned(all, meanwhile).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("nothing is removed"), "{name}, all {all}: {error}");
            assert!(here.join(name).is_file(), "{name}, all {all}: it is lost");
            let _added = std::fs::remove_dir_all(here.join("A01/replays"));
            std::fs::write(here.join("A01/frames/view_001.png"), &frame).unwrap();
            assert_eq!(files_of(here), whole, "{name}, all {all}");
        }
    }
    // A replay that is under way when the prune begins.
    let claim = RunClaim::shared(here).unwrap();
    let error = pruned(true, &|| ()).unwrap_err().to_string();
    assert!(error.contains("works on this run now"), "{error}");
    drop(claim);
    // A replay that begins after it.
    pruned(true, &|| {
        let error = RunClaim::shared(HERE.get().unwrap()).unwrap_err().to_string();
        assert!(error.contains("carved prune works on this run now"), "{error}");
    })
    .unwrap();
    assert!(!here.exists() && !data.join("runs/.r1.pruned").exists());
}

/// A remark about a well changes an archived run. Its copy gets the remark when the run is archived again to the same place, and nothing else.
#[test]
fn an_archived_run_that_got_a_remark_is_archived_again_and_pruned() {
    use carved_store::{Packing, archive, archive_to_objects, prune};
    let objects = std::sync::Mutex::default();
    let dir = tempfile::tempdir().unwrap();
    let copies = dir.path().join("copies");
    for to_objects in [false, true] {
        let data = dir.path().join(format!("data-{to_objects}"));
        stored(&data, "r1", Some(RunOutcome::Failed));
        let here = data.join("runs/r1");
        let archived = || {
            if to_objects {
                archive_to_objects(&here, "s3://copies", Packing::Files, &Copies { objects: &objects, meanwhile: &|| () })
            } else {
                archive(&here, &copies, Packing::Files)
            }
        };
        let pruned = || prune(&data, "r1", true, true, &|address| Err(carved_store::StoreError::NeverArchived { path: address.into() }));
        archived().unwrap();
        let mut record: serde_json::Value = serde_json::from_slice(&std::fs::read(here.join("run.json")).unwrap()).unwrap();
        record["wells"][0]["note"] =
            serde_json::json!({"by": "kim", "time": "2026-03-05T09:30:00Z", "excluded": true, "comment": "a bubble", "tags": []});
        std::fs::write(here.join("run.json"), record.to_string()).unwrap();
        let error = pruned().unwrap_err().to_string();
        assert!(error.contains("run.json") && error.contains("archive it again"), "{error}");
        archived().unwrap();
        let copy = |name: &str| {
            let object = || objects.lock().unwrap().get(&format!("s3://copies/r1/{name}")).cloned().unwrap();
            if to_objects { object() } else { std::fs::read(copies.join("r1").join(name)).unwrap() }
        };
        assert_eq!(copy("run.json"), std::fs::read(here.join("run.json")).unwrap());
        // A copy with another change is not one that carved made.
        let good = copy("run.json");
        let write = |bytes: &[u8]| {
            if to_objects {
                objects.lock().unwrap().insert("s3://copies/r1/run.json".into(), bytes.to_vec());
            } else {
                std::fs::write(copies.join("r1/run.json"), bytes).unwrap();
            }
        };
        write(b"{}");
        assert!(matches!(archived(), Err(carved_store::StoreError::Exists { .. })));
        write(&good);
        if !to_objects {
            pruned().unwrap();
            assert!(!here.exists());
        }
    }
}

/// A script reads the exit code. For a whole data folder, too, a copy that cannot be trusted is a failure. A run that was never archived is
/// not.
#[test]
fn a_prune_of_all_fails_by_the_name_of_each_bad_copy_and_prunes_the_good_ones() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let data_arg = data.to_str().unwrap();
    let copies = dir.path().join("copies");
    for id in ["flipped", "gone", "good", "never"] {
        stored(&data, id, Some(RunOutcome::Failed));
    }
    stored(&data, "open", None);
    for id in ["flipped", "gone", "good"] {
        assert!(run(&["archive", data.join("runs").join(id).to_str().unwrap(), "--to", copies.to_str().unwrap()]).status.success());
    }
    let path = copies.join("flipped/A01/frames/view_001.png");
    let mut bytes = std::fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&path, bytes).unwrap();
    std::fs::remove_dir_all(copies.join("gone")).unwrap();
    for args in [&["prune", data_arg][..], &["prune", data_arg, "--yes"], &["prune", data_arg, "--yes"]] {
        let output = run(args);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", text(&output));
        assert!(said.contains("flipped: ") && said.contains("gone: ") && said.contains("view_001.png"), "{args:?}: {said}");
        assert!(!said.lines().any(|line| line.starts_with("never") || line.starts_with("open")), "{args:?}: {said}");
    }
    let frame = |id: &str| data.join("runs").join(id).join("A01/frames/view_001.png").is_file();
    assert_eq!(["flipped", "gone", "good", "never", "open"].map(frame), [true, true, false, true, true]);
    // Without the bad runs there is nothing left to report.
    for id in ["flipped", "gone"] {
        std::fs::remove_dir_all(data.join("runs").join(id)).unwrap();
    }
    let output = run(&["prune", data_arg, "--yes"]);
    assert!(output.status.success() && text(&output).contains("never archived"), "{}", text(&output));
    // A pruned run needs no check of its copy, whose disk may be stored away.
    std::fs::remove_dir_all(&copies).unwrap();
    let output = run(&["prune", data_arg, "--yes"]);
    assert!(output.status.success(), "{}", text(&output));
}

#[cfg(not(feature = "s3"))]
#[test]
fn an_object_store_is_refused_with_the_feature_that_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let output = carved().arg("archive").arg(dir.path()).args(["--to", "s3://copies"]).output().unwrap();
    assert!(!output.status.success() && stderr(&output).contains("--features s3"), "{}", stderr(&output));
}

/// `prune --all` renames the run, removes it, and updates the index. Whatever a crash leaves, the next prune completes it.
#[test]
fn what_a_crash_leaves_of_a_prune_is_named_at_a_start_and_ended_by_the_next_prune() {
    let removed = |run: &Path, names: &[&str]| names.iter().for_each(|name| std::fs::remove_file(run.join(name)).unwrap());
    let frames = ["A01/frames/view_000.png", "A01/frames/view_001.png", "A01/frames/view_002.png"];
    for step in 0..5 {
        let dir = tempfile::tempdir().unwrap();
        let data = dir.path().join("data");
        let data_arg = data.to_str().unwrap();
        stored(&data, "r1", Some(RunOutcome::Failed));
        stored(&data, "r2", Some(RunOutcome::Failed));
        let here = data.join("runs/r1");
        assert!(run(&["archive", here.to_str().unwrap(), "--to", dir.path().join("copies").to_str().unwrap()]).status.success());
        let left = data.join("runs/.r1.pruned");
        std::fs::rename(&here, &left).unwrap();
        match step {
            0 => {}
            1 => removed(&left, &frames[..1]),
            2 => removed(&left, &frames),
            3 => ["A01", "run.json"].iter().for_each(|name| {
                let path = left.join(name);
                if path.is_dir() { std::fs::remove_dir_all(path).unwrap() } else { std::fs::remove_file(path).unwrap() }
            }),
            _ => {
                std::fs::remove_dir_all(&left).unwrap();
                std::fs::create_dir(&left).unwrap();
            }
        }
        let daemon = crate::common::Daemon::start(&data, &["--no-demo"]);
        let listed = daemon.get("/v1/runs").to_string();
        assert!(listed.contains("\"r2\"") && !listed.contains("\"r1\""), "step {step}: {listed}");
        drop(daemon);
        assert!(left.is_dir(), "a start removes nothing");

        let output = run(&["prune", data_arg]);
        assert!(output.status.success() && text(&output).contains("r1: "), "step {step}: {}", text(&output));
        assert!(left.is_dir(), "a dry run removes nothing");
        // If the copy is bad, the rest of the run is kept.
        if step < 3 {
            let copied = dir.path().join("copies/r1/A01/mesh.ply");
            std::fs::write(&copied, b"plz").unwrap();
            let before = files_of(&left);
            let output = run(&["prune", data_arg, "--yes"]);
            assert_eq!((output.status.code(), files_of(&left)), (Some(1), before), "step {step}: {}", text(&output));
            std::fs::write(&copied, b"ply").unwrap();
        }
        // The run may have been restored from its copy meanwhile.
        if step == 2 {
            crate::common::copy_folder(&dir.path().join("copies/r1"), &here);
        }
        let output = run(&["prune", data_arg, "--yes"]);
        assert!(output.status.success() && !left.exists(), "step {step}: {}", text(&output));
        assert_eq!(here.exists(), step == 2, "step {step}");
        assert!(data.join("runs/r2/A01/frames/view_000.png").is_file(), "step {step}: another run was touched");
    }
}

#[test]
fn the_index_is_rebuilt_by_hand_and_not_under_a_daemon() {
    let dir = tempfile::tempdir().unwrap();
    stored(dir.path(), "r1", Some(RunOutcome::Failed));
    let data = dir.path().to_str().unwrap();
    std::fs::write(dir.path().join("index.sqlite"), "broken").unwrap();
    let output = run(&["index", "rebuild", data]);
    assert!(output.status.success() && text(&output).contains("1 run(s), 0 of them"), "{}", text(&output));
    std::fs::create_dir(dir.path().join("runs/r2")).unwrap();
    std::fs::write(dir.path().join("runs/r2/run.json"), r#"{"schema": "carved.run/9", "software": {"version": "7.0"}}"#).unwrap();
    let output = run(&["index", "rebuild", data]);
    assert!(!output.status.success() && text(&output).contains("carved.run/9"), "{}", text(&output));
    let _daemon = Claim::on(dir.path()).and_then(Store::open).unwrap();
    assert!(text(&run(&["index", "rebuild", data])).contains("another carved uses this folder"));
}
