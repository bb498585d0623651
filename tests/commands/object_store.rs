//! `carved archive --to s3://...` and `prune` on the S3 of moto: `make test-features`.

use crate::common::{carved, json, stderr, stored::stored, until, venv};
use crate::files::plate;
use carved_records::RunOutcome;
use carved_store::{Objects, Packing, StoreError, archive_to_objects, fetch, recordings_at};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// moto does not check signatures, but refuses who has none.
const SIGNED: &str = "AWS4-HMAC-SHA256 Credential=test/20260101/us-east-1/s3/aws4_request";

/// A server with the bucket `copies`. It ends with the test.
struct S3 {
    server: Child,
    port: u16,
}

impl S3 {
    fn start() -> Self {
        let python = venv::python("moto", "moto.server", "tests/readers/requirements-s3.txt").unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let server = Command::new(python.with_file_name("moto_server"))
            .args(["-H", "127.0.0.1", "-p", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        until("moto answers", || TcpStream::connect(("127.0.0.1", port)).is_ok());
        let s3 = Self { server, port };
        s3.put("", b"");
        s3
    }

    fn address(&self, key: &str) -> String {
        format!("http://127.0.0.1:{}/copies/{key}", self.port)
    }

    fn put(&self, key: &str, bytes: &[u8]) {
        ureq::put(self.address(key)).header("authorization", SIGNED).send(bytes).unwrap();
    }

    fn get(&self, key: &str) -> Vec<u8> {
        ureq::get(self.address(key)).header("authorization", SIGNED).call().unwrap().body_mut().read_to_vec().unwrap()
    }

    fn delete(&self, key: &str) {
        ureq::delete(self.address(key)).header("authorization", SIGNED).call().unwrap();
    }

    /// Keys that begin like this.
    fn keys(&self, prefix: &str) -> Vec<String> {
        let list = String::from_utf8(self.get(&format!("?list-type=2&prefix={prefix}"))).unwrap();
        list.split("<Key>").skip(1).map(|rest| rest.split_once('<').unwrap().0.to_owned()).collect()
    }

    /// A carved that knows the server and its credentials.
    fn carved(&self) -> Command {
        let mut command = carved();
        command.envs([("AWS_ACCESS_KEY_ID", "test"), ("AWS_SECRET_ACCESS_KEY", "test"), ("AWS_REGION", "us-east-1")]);
        command.env("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", self.port));
        // Instead of that of Amazon's computers, which nobody answers for here.
        command.env("AWS_METADATA_ENDPOINT", "http://127.0.0.1:1");
        command
    }

    fn archive(&self, run: &Path, to: &str, more: &[&str]) -> Output {
        self.carved().arg("archive").arg(run).args(["--to", to]).args(more).output().unwrap()
    }
}

impl Drop for S3 {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn done(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn refused(output: &Output, why: &str) {
    assert!(!output.status.success() && stderr(output).contains(why), "{why}: {}", stderr(output));
}

/// A run `r1` with the specimen A01 of three views.
fn run(data: &Path) -> PathBuf {
    stored(data, "r1", Some(RunOutcome::Failed));
    data.join("runs/r1")
}

#[test]
#[ignore = "starts an S3 server, which is installed from PyPI: make test-features"]
fn a_copy_is_read_back_goes_on_after_an_interruption_and_is_verified_again_before_a_prune() {
    let s3 = S3::start();
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = run(&data);
    let frame = fs::read(run.join("A01/frames/view_001.png")).unwrap();
    let said = done(&s3.archive(&run, "s3://copies/lab/", &[]));
    assert!(said.contains("every hash verified at s3://copies/lab/r1"), "{said}");
    let receipt: serde_json::Value = serde_json::from_slice(&s3.get("lab/r1/archive.json")).unwrap();
    let files = receipt["files"].as_object().unwrap();
    assert_eq!(s3.keys("lab/").len(), files.len() + 1, "each file and the receipt: {:?}", s3.keys("lab/"));
    assert!(s3.get("lab/r1/A01/frames/view_001.png") == frame);

    // As an interruption leaves it. What is there with other bytes is never replaced.
    for key in ["lab/r1/archive.json", "lab/r1/A01/SHA256SUMS", "lab/r1/A01/frames/view_002.png"] {
        s3.delete(key);
    }
    done(&s3.archive(&run, "s3://copies/lab", &[]));
    assert_eq!(s3.keys("lab/").len(), files.len() + 1);
    s3.put("lab/r1/A01/frames/view_001.png", b"other");
    refused(&s3.archive(&run, "s3://copies/lab", &[]), "view_001.png: exists already; nothing is overwritten");

    let prune = || s3.carved().arg("prune").arg(&data).args(["r1", "--yes"]).output().unwrap();
    refused(&prune(), "its copy is not good");
    s3.delete("lab/r1/A01/frames/view_001.png");
    refused(&prune(), "its copy is not good");
    assert!(run.join("A01/frames/view_001.png").is_file(), "nothing was removed");
    s3.put("lab/r1/A01/frames/view_001.png", &frame);
    assert!(done(&prune()).contains("they are in s3://copies/lab/r1"));
    assert!(!run.join("A01/frames/view_001.png").exists());
    let measured = carved().arg("measure").arg(run.join("A01")).output().unwrap();
    refused(&measured, "it was archived to s3://copies/lab/r1/A01");
    assert!(stderr(&measured).contains("fetch that copy"), "{}", stderr(&measured));
}

#[test]
#[ignore = "starts an S3 server, which is installed from PyPI: make test-features"]
fn a_packed_copy_has_an_object_per_well_and_is_verified_inside() {
    let s3 = S3::start();
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = run(&data);
    done(&s3.archive(&run, "s3://copies", &["--pack"]));
    let mut keys = s3.keys("");
    keys.sort();
    assert_eq!(keys, ["r1/A01.tar", "r1/archive.json", "r1/run.json"]);
    done(&s3.archive(&run, "s3://copies", &["--pack"]));
    // The object is a pack that carved reads.
    let folder = dir.path().join("fetched/r1");
    fs::create_dir_all(&folder).unwrap();
    let mut pack = s3.get("r1/A01.tar");
    fs::write(folder.join("A01.tar"), &pack).unwrap();
    let listed = Command::new("tar").arg("-tf").arg(folder.join("A01.tar")).output().unwrap();
    assert!(done(&listed).lines().any(|line| line == "A01/frames/view_002.png"));

    let prune = || s3.carved().arg("prune").arg(&data).args(["--all", "--yes", "r1"]).output().unwrap();
    let frame = pack.windows(4).position(|w| w == b"IDAT").unwrap() + 6;
    pack[frame] ^= 1;
    s3.put("r1/A01.tar", &pack);
    refused(&prune(), "its copy is not good");
    refused(&s3.archive(&run, "s3://copies", &["--pack"]), "A01.tar: exists already");
    pack[frame] ^= 1;
    s3.put("r1/A01.tar", &pack);
    done(&prune());
    assert!(!run.exists());
}

#[test]
#[ignore = "starts an S3 server, which is installed from PyPI: make test-features"]
fn what_is_missing_is_named_with_the_way_out() {
    let s3 = S3::start();
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let run = run(&data);
    refused(&s3.archive(&run, "s3://", &[]), "expected s3://BUCKET/PREFIX");
    refused(&s3.archive(&run, "s3://nobody", &[]), "there is no bucket s3://nobody; create it first");
    let without = s3.carved().env_remove("AWS_ACCESS_KEY_ID").arg("archive").arg(&run).args(["--to", "s3://copies"]).output().unwrap();
    refused(&without, "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY");
    let nowhere = s3.carved().env("AWS_ENDPOINT_URL", "http://127.0.0.1:1").arg("archive").arg(&run).args(["--to", "s3://copies"]).output();
    refused(&nowhere.unwrap(), "the store cannot be reached; look at the network");
    assert!(!run.join("archives").exists(), "no receipt of a copy that there is not");

    // A copy that cannot be reached is none.
    done(&s3.archive(&run, "s3://copies", &[]));
    let receipt = fs::read_dir(run.join("archives")).unwrap().next().unwrap().unwrap().path();
    assert_eq!(json(&receipt)["destination"], "s3://copies/r1");
    let mut prune = s3.carved();
    prune.env("AWS_ENDPOINT_URL", "http://127.0.0.1:1").arg("prune").arg(&data).args(["r1", "--yes"]);
    refused(&prune.output().unwrap(), "the store cannot be reached");
    assert!(run.join("A01/frames/view_000.png").is_file());
}

/// Lines of `carved measure` without the names of the recordings.
fn lines(output: &Output) -> Vec<String> {
    done(output).lines().map(|line| line.split_once(",\"well\"").unwrap().1.to_owned()).collect()
}

#[test]
#[ignore = "starts an S3 server, which is installed from PyPI: make test-features"]
fn recordings_of_a_copy_are_measured_where_it_is() {
    let s3 = S3::start();
    let dir = tempfile::tempdir().unwrap();
    let run = plate(dir.path());
    let temporary = dir.path().join("temporary");
    fs::create_dir(&temporary).unwrap();
    let measure = |names: &[&str]| s3.carved().env("TMPDIR", &temporary).arg("measure").args(names).output().unwrap();
    done(&s3.archive(&run, "s3://copies/files", &[]));
    done(&s3.archive(&run, "s3://copies/packs", &["--pack"]));
    let here = lines(&measure(&[run.to_str().unwrap()]));
    assert!(here.len() == 2 && here.iter().all(|line| line.contains("\"stored\":\"identical\"")));
    for copy in ["s3://copies/files/P-017", "s3://copies/packs/P-017/"] {
        assert!(lines(&measure(&[copy])) == here, "{copy}");
    }
    for one in ["s3://copies/packs/P-017/B03", "s3://copies/packs/P-017/B03.tar", "s3://copies/files/P-017/B03"] {
        assert!(lines(&measure(&[one])) == here[1..], "{one}");
    }

    // Into a folder, in two parts, and again.
    let out = dir.path().join("again");
    let into = |shard: &str| {
        let said = done(&measure(&["--out", out.to_str().unwrap(), "--shard", shard, "s3://copies/packs/P-017"]));
        serde_json::from_str::<serde_json::Value>(said.lines().last().unwrap()).unwrap()
    };
    assert_eq!([into("1/2")["measured"].clone(), into("2/2")["measured"].clone()], [1, 1]);
    assert_eq!(into("1/1")["left_out"], 2);
    let of_run = |folder: &Path| ["A02", "B03"].map(|well| fs::read(folder.join(well).join("measurement.json")).unwrap());
    let local = dir.path().join("local");
    done(&measure(&["--out", local.to_str().unwrap(), run.to_str().unwrap()]));
    assert!(of_run(&out.join("P-017")) == of_run(&local.join("P-017")));

    // What is altered, missing or no copy is named, and the others are measured.
    let mut pack = s3.get("packs/P-017/A02.tar");
    let frame = pack.windows(4).position(|w| w == b"IDAT").unwrap() + 6;
    pack[frame] ^= 1;
    s3.put("packs/P-017/A02.tar", &pack);
    let spoiled = measure(&["s3://copies/packs/P-017"]);
    refused(&spoiled, "s3://copies/packs/P-017/A02/frames/");
    assert!(String::from_utf8_lossy(&spoiled.stdout).contains("\"well\":\"B03\""));
    s3.delete("files/P-017/A02/frames/view_003.png");
    refused(&measure(&["s3://copies/files/P-017/A02"]), "s3://copies/files/P-017/A02/frames/view_003.png");
    refused(&measure(&["s3://copies/files/P-017/H12"]), "the copy has no recording H12; it has A02, B03");
    refused(&measure(&["s3://copies/nothing"]), "there is no archive.json of a copy");
    assert_eq!(fs::read_dir(&temporary).unwrap().count(), 0, "fetched files are removed");
}

#[test]
#[cfg(not(feature = "s3"))]
fn a_program_without_the_feature_says_how_to_build_one() {
    refused(&carved().args(["measure", "s3://copies/r1"]).output().unwrap(), "--features s3");
}

#[test]
fn a_recording_is_fetched_as_it_was_archived_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(&dir.path().join("data"));
    for packing in [Packing::Files, Packing::PerWell] {
        let store = Spoiling { ending: "nothing", objects: RefCell::default() };
        archive_to_objects(&run, "s3://copies", packing, &store).unwrap();
        let to = tempfile::tempdir().unwrap();
        let found = fetch(&store, "s3://copies/r1/A01", to.path()).unwrap();
        let files = carved_store::RecordingFiles::of(&found).unwrap();
        assert!(files.require("frames/view_001.png").unwrap() == fs::read(run.join("A01/frames/view_001.png")).unwrap());
        assert_eq!(recordings_at(&store, "s3://copies/r1/A01").unwrap(), ["s3://copies/r1/A01"]);
        // Each object in turn is another one, or gone.
        let addresses: Vec<String> = store.objects.borrow().keys().filter(|at| at.starts_with("s3://copies/r1/A01")).cloned().collect();
        assert!(!addresses.is_empty());
        for address in addresses {
            let mut bytes = store.objects.borrow()[&address].clone();
            let whole = bytes.clone();
            // In a pack the pixels of a frame: between its files are bytes that mean nothing.
            let at = bytes.windows(4).position(|found| found == b"IDAT").map_or(bytes.len() / 3, |at| at + 6);
            bytes[at] ^= 1;
            for other in [Some(bytes), None] {
                match other {
                    Some(bytes) => store.objects.borrow_mut().insert(address.clone(), bytes),
                    None => store.objects.borrow_mut().remove(&address),
                };
                let to = tempfile::tempdir().unwrap();
                assert!(fetch(&store, "s3://copies/r1/A01", to.path()).is_err(), "{address}");
            }
            store.objects.borrow_mut().insert(address, whole);
        }
    }
}

/// A store in memory that changes a byte of the objects whose address has this ending.
struct Spoiling {
    ending: &'static str,
    objects: RefCell<BTreeMap<String, Vec<u8>>>,
}

impl Objects for Spoiling {
    fn get(&self, address: &str) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(self.objects.borrow().get(address).cloned())
    }

    fn put(&self, address: &str, mut bytes: Vec<u8>) -> Result<(), StoreError> {
        if address.ends_with(self.ending) {
            let last = bytes.iter().rposition(|&byte| byte != 0).unwrap();
            bytes[last] ^= 1;
        }
        self.objects.borrow_mut().insert(address.to_owned(), bytes);
        Ok(())
    }
}

#[test]
fn an_object_that_reads_back_differently_ends_the_archive_without_a_receipt() {
    let dir = tempfile::tempdir().unwrap();
    let run = run(&dir.path().join("data"));
    for (packing, ending) in [(Packing::Files, "A01/frames/view_001.png"), (Packing::PerWell, "A01.tar")] {
        let store = Spoiling { ending, objects: RefCell::default() };
        let refused = archive_to_objects(&run, "s3://copies", packing, &store).unwrap_err().to_string();
        assert!(refused.contains("s3://copies/r1/A01"), "{refused}");
        assert!(!store.objects.borrow().contains_key("s3://copies/r1/archive.json") && !run.join("archives").exists());
    }
    archive_to_objects(&run, "s3://copies", Packing::Files, &Spoiling { ending: "nothing", objects: RefCell::default() }).unwrap();
    assert!(run.join("archives").is_dir());
}
