//! The real program, started like a user starts it.
#![allow(dead_code, unused_imports, clippy::unwrap_used, clippy::expect_used)] // each test binary uses its own part; a harness may panic

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

pub mod bench;
pub mod contract;
pub mod controllers;
pub mod crash;
pub mod gates;
pub mod generated;
pub mod held_disk;
mod instrument;
pub mod receiver;
mod shared;
mod small;
pub mod spoiled;
pub mod stored;
pub mod strict;
pub mod venv;
mod wait;

pub use instrument::{Instrument, QUICK, Rate, SLOW, SLOW_REFERENCE, standing};
pub use shared::shared;
pub use small::{small_frames, small_scene};
pub use wait::{PATIENCE, until};

pub fn carved() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_carved"));
    command.env("CARVED_LOG", "warn");
    command
}

pub fn run(args: &[&str]) -> Output {
    carved().args(args).output().unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The text of the file that a user starts from, `shipped` in config/.
pub fn configured_text(shipped: &str) -> String {
    std::fs::read_to_string(format!("{}/config/{shipped}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// Writes the file that a user starts from, `shipped` in config/, into `folder`, with the ports of this rig and with `changes`. The data
/// folder lies beside it.
pub fn configured(shipped: &str, folder: &Path, rig: &hardware_sim::Rig, changes: &[(&str, String)]) -> (PathBuf, PathBuf) {
    let data = folder.join("data");
    let mut text = configured_text(shipped);
    let doors = [
        ("127.0.0.1:8420", "127.0.0.1:0".to_owned()),
        ("/var/lib/carved", data.display().to_string()),
        ("address = \"192.168.10.2\"", format!("address = \"{}\"", rig.camera_address())),
    ];
    for (from, to) in doors.iter().chain(changes) {
        assert!(text.contains(from), "the shipped configuration has no {from:?}");
        text = text.replace(from, to);
    }
    let config = folder.join("rig.toml");
    std::fs::write(&config, text).unwrap();
    (config, data)
}

/// Changes of a shipped configuration that wait long for a frame: rendering a picture can take long on a busy machine.
pub fn patient() -> [(&'static str, String); 2] {
    [
        ("exposure_us = 5000.0", "exposure_us = 5000.0\nframe_timeout_ms = 20000".into()),
        ("grab_deadline_ms = 3000", "grab_deadline_ms = 60000".into()),
    ]
}

/// The change that sets the controller's port in a shipped configuration.
pub fn port(rig: &hardware_sim::Rig) -> (&'static str, String) {
    ("/dev/carved-rotation", rig.serial_path().display().to_string())
}

/// A running `carved simulate` or `carved serve`.
pub struct Daemon {
    child: Child,
    out: Box<dyn BufRead + Send + Sync>,
    pub url: String,
    pub data: PathBuf,
}

impl Daemon {
    pub fn start(data: &Path, args: &[&str]) -> Self {
        Self::spawn(carved().args(["simulate", "--listen", "127.0.0.1:0", "--data"]).arg(data).args(args), data)
    }

    /// Starts `carved serve` with a configuration file whose `data_dir` is `data`.
    pub fn serve(config: &Path, data: &Path) -> Self {
        Self::spawn(carved().args(["serve", "--config"]).arg(config), data)
    }

    /// As `serve`, with further variables of the environment.
    pub fn serve_in(config: &Path, data: &Path, environment: &[(&str, &Path)]) -> Self {
        Self::spawn(carved().envs(environment.iter().copied()).args(["serve", "--config"]).arg(config), data)
    }

    /// Starts `carved simulate` with its full log, which is not read. Of standard output only the address is read.
    pub fn unread(data: &Path, args: &[&str]) -> Self {
        let (log, writer) = std::io::pipe().unwrap();
        drop(log);
        let mut command = carved();
        command.env("CARVED_LOG", "trace").stderr(writer);
        let mut daemon = Self::spawn(command.args(["simulate", "--listen", "127.0.0.1:0", "--data"]).arg(data).args(args), data);
        let (nobody, _) = std::io::pipe().unwrap();
        daemon.out = Box::new(BufReader::new(nobody));
        daemon
    }

    fn spawn(command: &mut Command, data: &Path) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let at = line.find("http://").unwrap_or_else(|| panic!("no address in {line:?}"));
        let url = line[at..].split_whitespace().next().unwrap().to_owned();
        Self { child, out: Box::new(out), url, data: data.to_owned() }
    }

    pub fn get(&self, path: &str) -> Value {
        ureq::get(format!("{}{path}", self.url)).call().unwrap().body_mut().read_json().unwrap()
    }

    pub fn status(&self) -> Value {
        self.get("/v1/status")
    }

    /// Long-polls the status until `done` holds for it.
    pub fn wait(&self, what: &str, done: impl Fn(&Value) -> bool) -> Value {
        let until = Instant::now() + PATIENCE;
        let mut revision = 0;
        loop {
            let status = self.get(&format!("/v1/status?wait=25&after={revision}"));
            if done(&status) {
                return status;
            }
            assert!(Instant::now() < until, "waited for {what}; last status: {status}");
            revision = status["revision"].as_u64().unwrap();
        }
    }

    pub fn wait_for_outcome(&self) -> Value {
        self.wait("the run's outcome", |s| !s["run"]["outcome"].is_null())
    }

    /// Reads the program's output up to the line that contains `text`.
    pub fn line_with(&mut self, text: &str) -> String {
        loop {
            let mut line = String::new();
            assert_ne!(self.out.read_line(&mut line).unwrap(), 0, "the program ended before it printed {text:?}");
            if line.contains(text) {
                return line;
            }
        }
    }

    pub fn put_run(&self, id: &str, plan: &Value) -> u16 {
        self.put(&format!("/v1/runs/{id}"), plan)
    }

    /// Reports, as the plate-loader, that the specimen is in the capillary.
    pub fn put_loaded(&self, run: &str, well: &str) -> u16 {
        self.put(&format!("/v1/runs/{run}/wells/{well}"), &serde_json::json!({"loaded": true}))
    }

    /// Reports, as the plate-loader, that it has taken the specimen out.
    pub fn put_unloaded(&self, run: &str, well: &str) -> u16 {
        self.put(&format!("/v1/runs/{run}/wells/{well}"), &serde_json::json!({"loaded": false}))
    }

    fn put(&self, path: &str, body: &Value) -> u16 {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        agent.put(format!("{}{path}", self.url)).send_json(body).unwrap().status().as_u16()
    }

    /// Sends a request with a body, if there is one. Returns the status code and the answer, whatever the code is.
    pub fn send(&self, method: &str, path: &str, body: &Value) -> (u16, Value) {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        let url = format!("{}{path}", self.url);
        let request = if method == "PUT" { agent.put(url) } else { agent.post(url) };
        let mut answer = if body.is_null() { request.send_empty() } else { request.send_json(body) }.unwrap();
        (answer.status().as_u16(), answer.body_mut().read_json().unwrap())
    }

    pub fn post(&self, path: &str) -> u16 {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        agent.post(format!("{}{path}", self.url)).send_empty().unwrap().status().as_u16()
    }

    /// Acknowledges the fault that holds a run, and lets the run go on.
    pub fn go_on(&self, run: &str, fault: &Value) {
        assert_eq!(self.post(&format!("/v1/faults/{}/acknowledge", fault["seq"])), 200);
        assert_eq!(self.post(&format!("/v1/runs/{run}/unhold")), 200);
    }

    /// Processor time used by the program, s.
    pub fn cpu_s(&self) -> f64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap();
        // The fields follow the name in parentheses. Fields 14 and 15 are user and system time in hundredths of a second.
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
        (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
    }

    pub fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status().unwrap().success());
    }

    /// Kills the process like a power cut: it closes nothing and reports nothing.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for the end of the process and gives its exit code.
    pub fn ended(mut self) -> Option<i32> {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(Instant::now() < until, "the daemon did not end");
            std::thread::yield_now();
            std::thread::park_timeout(Duration::from_millis(20));
        }
    }

    /// The folder of the newest run.
    pub fn run_folder(&self) -> PathBuf {
        self.data.join("runs").join(self.status()["run"]["id"].as_str().unwrap())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
}

pub fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_folder(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}
