//! `examples/slurm` on a Slurm of one machine, whose two nodes have a processor each: `make test-slurm`.
//!
//! ```text
//!  24 recordings ─┬─ measure --out, serially ──────────────────────────── export table ──┐
//!                 ├─ sbatch array on two nodes, one is killed in the middle ─ export table ─┼─ the same bytes
//!                 └─ Snakemake, its jobs in Slurm ─────────────────────── its table ──────┘
//! ```
//! Slurm and its authentication live in a folder of the test, which is `/etc/slurm` for its processes: Snakemake's jobs do not get
//! `SLURM_CONF`. Nothing of the system is changed.

use super::import_plate::{scene, shoot};
use crate::common::{carved, json, run, stderr, venv};
use hardware_sim::scene::Specimen;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant, SystemTime};

const RECORDINGS: usize = 24;
const TASKS: usize = 4;
/// Slurm notices the death of a node late, and holds a requeued task for two minutes.
const PATIENCE: Duration = Duration::from_secs(15 * 60);

/// Waits until something is there.
fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "{what}: not within {} s", PATIENCE.as_secs());
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn done(what: &str, output: &Output) -> String {
    assert!(output.status.success(), "{what}: {}{}", String::from_utf8_lossy(&output.stdout), stderr(output));
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

/// A port that is free now.
fn port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// A Slurm with the nodes n1 and n2. Its daemons end with it.
struct Slurm {
    folder: PathBuf,
}

impl Slurm {
    fn start(folder: PathBuf) -> Self {
        for part in ["state", "n1", "n2", "munge"] {
            fs::create_dir_all(folder.join(part)).unwrap();
        }
        let slurm = Self { folder };
        let at = |name: &str| slurm.folder.join(name).display().to_string();
        fs::write(slurm.folder.join("munge/key"), (0..1024u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect::<Vec<_>>())
            .unwrap();
        fs::set_permissions(slurm.folder.join("munge/key"), fs::Permissions::from_mode(0o600)).unwrap();
        let own = Command::new("chown").args(["-R", "munge:munge", &at("munge")]).output().unwrap();
        done("chown", &own);
        fs::set_permissions(slurm.folder.join("munge"), fs::Permissions::from_mode(0o755)).unwrap();
        // It refuses to be root.
        let munged = Command::new("setpriv")
            .args(["--reuid=munge", "--regid=munge", "--clear-groups", "munged"])
            .args([format!("--socket={}", at("munge/socket")), format!("--key-file={}", at("munge/key"))])
            .args([format!("--pid-file={}", at("munge/pid")), format!("--log-file={}", at("munge/log"))])
            .arg(format!("--seed-file={}", at("munge/seed")))
            .output();
        done("munged", &munged.unwrap());
        let host = done("hostname", &Command::new("hostname").arg("-s").output().unwrap());
        let config = format!(
            "ClusterName=test\nSlurmctldHost={host}(127.0.0.1)\nSlurmctldPort={}\nSlurmUser=root\nSlurmdUser=root\nAuthType=auth/munge\n\
             AuthInfo=socket={}\nCryptoType=crypto/munge\nStateSaveLocation={}\nSlurmdSpoolDir={}/%n\nSlurmctldPidFile={}\n\
             SlurmdPidFile={}/slurmd.%n.pid\nSlurmctldLogFile={}\nSlurmdLogFile={}/slurmd.%n.log\nProctrackType=proctrack/linuxproc\n\
             TaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n\
             JobCompType=jobcomp/none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nReturnToService=2\n\
             SwitchType=switch/none\nMpiDefault=none\nSchedulerParameters=sched_interval=1,batch_sched_delay=1\nSlurmdTimeout=15\n\
             SlurmdParameters=config_overrides\nKillWait=5\nMinJobAge=900\n\
             NodeName=n[1-2] NodeHostname={host} NodeAddr=127.0.0.1 Port=[{}] CPUs=1 RealMemory=8000 State=UNKNOWN\n\
             PartitionName=main Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP\n",
            port(),
            at("munge/socket"),
            at("state"),
            slurm.folder.display(),
            at("slurmctld.pid"),
            slurm.folder.display(),
            at("slurmctld.log"),
            slurm.folder.display(),
            ports_in_a_row(),
        );
        fs::write(slurm.folder.join("slurm.conf"), config).unwrap();
        done("slurmctld", &slurm.command("slurmctld").output().unwrap());
        for node in ["n1", "n2"] {
            done("slurmd", &slurm.command("slurmd").args(["-N", node]).output().unwrap());
        }
        until("two idle nodes", || {
            let nodes = slurm.command("sinfo").args(["--noheader", "--format=%D %t"]).output().unwrap();
            (String::from_utf8_lossy(&nodes.stdout).trim() == "2 idle").then_some(())
        });
        slurm
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", "mount --bind \"$0\" /etc/slurm && exec \"$@\""]).arg(&self.folder).arg(program);
        command.env("SLURM_CONF", self.folder.join("slurm.conf")).current_dir(&self.folder);
        command
    }

    /// The state of each task of an array, such as `RUNNING n2`, by its number.
    fn tasks(&self, job: &str) -> Vec<(usize, String)> {
        let listed =
            self.command("squeue").args(["--noheader", "--array", "--states=all", "--format=%K %T %N", "--job", job]).output().unwrap();
        let text = String::from_utf8_lossy(&listed.stdout).into_owned();
        text.lines()
            .filter_map(|line| line.trim().split_once(' '))
            .map(|(k, state)| (k.parse().unwrap(), state.trim().to_owned()))
            .collect()
    }

    /// Kills the daemon of a node and everything that it has started.
    fn kill_node(&self, node: &str) {
        let jobs: Vec<i32> = processes().filter(|pid| self.runs_on(*pid, node)).collect();
        let steps = jobs
            .iter()
            .filter_map(|pid| parent(*pid))
            .filter(|pid| fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|name| name.trim() == "slurmstepd"));
        let mut killed: Vec<i32> = self.pid(&format!("slurmd.{node}.pid")).into_iter().chain(steps).collect();
        killed.extend(&jobs);
        for pid in killed {
            let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
        }
    }

    /// Whether a process belongs to a job on this node.
    fn runs_on(&self, pid: i32, node: &str) -> bool {
        let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        let has = |variable: String| environment.split(|byte| *byte == 0).any(|found| found == variable.as_bytes());
        has(format!("SLURMD_NODENAME={node}")) && has(format!("SLURM_CONF={}", self.folder.join("slurm.conf").display()))
    }

    fn pid(&self, file: &str) -> Option<i32> {
        fs::read_to_string(self.folder.join(file)).ok()?.trim().parse().ok()
    }
}

fn processes() -> impl Iterator<Item = i32> {
    fs::read_dir("/proc").unwrap().filter_map(|entry| entry.unwrap().file_name().to_str()?.parse().ok())
}

fn parent(pid: i32) -> Option<i32> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(')')?.1.split_ascii_whitespace().nth(1)?.parse().ok()
}

/// Two neighbouring ports that are free now, as in `17001-17002`.
fn ports_in_a_row() -> String {
    until("two neighbouring free ports", || {
        let first = port();
        TcpListener::bind(("127.0.0.1", first.checked_add(1)?)).ok().map(|_| format!("{first}-{}", first + 1))
    })
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // A test that failed leaves jobs.
        for node in ["n1", "n2"] {
            self.kill_node(node);
        }
        for file in ["slurmctld.pid", "munge/pid"] {
            if let Some(pid) = self.pid(file) {
                let _ = kill(Pid::from_raw(pid), Signal::SIGTERM);
            }
        }
    }
}

/// Three runs of eight beads, four views each, and their list.
fn plates(folder: &Path) -> (Vec<String>, PathBuf) {
    let data = folder.join("data");
    let plates: Vec<String> = (0..3).map(|plate| format!("P-{plate}")).collect();
    let runs: Vec<String> = plates
        .iter()
        .enumerate()
        .map(|(plate, barcode)| {
            let pictures = folder.join(barcode);
            for well in 0..RECORDINGS / 3 {
                let bead = scene(Specimen::bead(400.0 + 10.0 * (8 * plate + well) as f64).unwrap());
                shoot(&bead, 4, 4, |i| pictures.join(format!("W_A{:02}_1_{}.tiff", well + 1, i + 1)));
            }
            let (pictures, data) = (pictures.display().to_string(), data.display().to_string());
            let args = ["import", &pictures, "--plate", barcode, "--data", &data, "--even", "--specimen", "bead", "--operator", "kim"];
            done("import", &run(&args));
            format!("{data}/runs/{barcode}")
        })
        .collect();
    let list = folder.join("runs.txt");
    fs::write(&list, runs.join("\n") + "\n").unwrap();
    (runs, list)
}

fn table(runs: &[String], numbers: &Path) -> String {
    done("export table", &carved().args(["export", "table"]).args(runs).arg("--measurements").arg(numbers).output().unwrap())
}

/// Results in a folder of numbers.
fn results(numbers: &Path) -> usize {
    let folders = |path: &Path| fs::read_dir(path).into_iter().flatten().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    folders(numbers).iter().flat_map(|run| folders(run)).filter(|well| well.join("SHA256SUMS").is_file()).count()
}

/// Prints the logs of the jobs of a workflow.
fn logs(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()) {
        match fs::read_to_string(&path) {
            Ok(text) => println!("{}:\n{text}", path.display()),
            Err(_) => logs(&path),
        }
    }
}

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/slurm").join(name)
}

#[test]
#[ignore = "installs Snakemake: make test-slurm"]
fn a_workflow_measures_what_a_plate_a_method_a_run_or_a_number_of_shards_changes() {
    let dir = tempfile::tempdir().unwrap();
    let (runs, list) = plates(dir.path());
    let (out, method) = (dir.path().join("out"), dir.path().join("method.toml"));
    let python = venv::python("snakemake", "snakemake", "examples/slurm/requirements.txt").unwrap();
    let workflow = |more: &[String]| {
        let output = Command::new(python.with_file_name("snakemake"))
            .arg("--snakefile")
            .arg(example("Snakefile"))
            .args(["--cores", "2", "--directory"])
            .arg(dir.path())
            .arg("--config")
            .args([format!("runs={}", list.display()), format!("out={}", out.display()), "cpus=1".into()])
            .arg(format!("carved={}", env!("CARGO_BIN_EXE_carved")))
            .args(more)
            .output();
        let output = output.unwrap();
        done("snakemake", &output);
        (fs::read_to_string(out.join("table.csv")).unwrap(), stderr(&output).contains("Nothing to be done"))
    };
    let wells = |table: &str| table.lines().count() - 1;
    let (two, three) = (["shards=2".to_owned()], ["shards=3".to_owned()]);

    fs::write(&list, runs[..2].join("\n")).unwrap();
    assert_eq!(wells(&workflow(&two).0), 16);
    assert!(workflow(&two).1, "nothing has changed");
    fs::write(&list, runs.join("\n")).unwrap();
    assert_eq!(wells(&workflow(&two).0), 24, "a plate was added");
    assert!(!workflow(&three).1, "another number of shards");
    let with_method = [three[0].clone(), format!("method={}", method.display())];
    // Times do not tell of a change: a copy keeps the time of the file that it was made from.
    let aged = |file: &Path, text: String| {
        fs::write(file, text).unwrap();
        fs::File::options().write(true).open(file).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
    };
    let voxel = |um: f64| aged(&method, format!("asd = 4\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = {um:.1}\n"));
    voxel(20.0);
    let coarse = workflow(&with_method).0;
    voxel(25.0);
    let coarser = workflow(&with_method).0;
    assert!(workflow(&with_method).1);
    assert!(coarse != coarser, "the content of the method has changed");

    let file = Path::new(&runs[1]).join("run.json");
    let mut record = json(&file);
    record["wells"][0]["note"] =
        serde_json::json!({"excluded": true, "by": "kim", "time": "2026-02-03T04:05:06Z", "comment": "burst", "tags": []});
    aged(&file, record.to_string());
    let noted = workflow(&with_method).0;
    assert!(!coarser.contains("burst") && noted.contains("burst"), "a well was excluded");
    assert!(workflow(&with_method).1);
}

#[test]
#[ignore = "starts a Slurm as root and waits minutes for it: make test-slurm"]
fn a_node_that_dies_in_the_middle_changes_no_byte_of_the_table() {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let (runs, list) = plates(dir.path());
    let serial = dir.path().join("serial");
    done("measure", &carved().args(["measure", "--jobs", "1", "--out"]).arg(&serial).args(&runs).output().unwrap());
    let expected = table(&runs, &serial);
    assert_eq!(expected.lines().count(), 1 + RECORDINGS);

    let slurm = Slurm::start(dir.path().join("slurm"));
    let numbers = dir.path().join("numbers");
    let submitted = slurm
        .command("sbatch")
        .args(["--parsable", &format!("--array=1-{TASKS}"), "--cpus-per-task=1"])
        .env("RUNS", &list)
        .env("OUT", &numbers)
        .env("CARVED", env!("CARGO_BIN_EXE_carved"))
        .arg(example("measure.sbatch"))
        .output();
    let job = done("sbatch", &submitted.unwrap());

    // The node dies after a task on it has written its first result and before it has written its last.
    let log = |task: usize| fs::read_to_string(slurm.folder.join(format!("carved-{job}_{task}.log"))).unwrap_or_default();
    let task = until("a result of a task on n2", || {
        let running = slurm.tasks(&job).into_iter().find(|(_, state)| state == "RUNNING n2")?.0;
        log(running).contains("measured in").then_some(running)
    });
    slurm.kill_node("n2");
    let before = log(task).matches("measured in").count();
    assert!((1..RECORDINGS / TASKS).contains(&before), "task {task} was not in its middle: {}", log(task));
    println!("n2 died in task {task}, after {before} of {} recordings", RECORDINGS / TASKS);

    until("the end of the array", || {
        let states = slurm.tasks(&job);
        assert!(states.iter().all(|(_, state)| !state.starts_with("FAILED")), "{states:?}\n{}", (1..=TASKS).map(log).collect::<String>());
        (states.len() == TASKS && states.iter().all(|(_, state)| state.starts_with("COMPLETED"))).then_some(())
    });
    assert!(log(task).contains("was measured before"), "the task that was started again leaves out what is done: {}", log(task));
    assert_eq!(results(&numbers), RECORDINGS);
    assert_eq!(table(&runs, &numbers), expected);

    // The same plates by the workflow, on the node that is left.
    let python = venv::python("snakemake", "snakemake", "examples/slurm/requirements.txt").unwrap();
    let out = dir.path().join("workflow");
    let workflow = slurm
        .command(python.with_file_name("snakemake").to_str().unwrap())
        .arg("--snakefile")
        .arg(example("Snakefile"))
        .args(["--executor", "slurm", "--jobs", "2", "--latency-wait", "10", "--slurm-no-account", "--slurm-status-command", "squeue"])
        .arg("--config")
        .args([format!("runs={}", list.display()), format!("out={}", out.display()), format!("carved={}", env!("CARGO_BIN_EXE_carved"))])
        .args(["shards=2", "cpus=1"])
        .output();
    let workflow = workflow.unwrap();
    if !workflow.status.success() {
        logs(&slurm.folder.join(".snakemake/slurm_logs"));
    }
    done("snakemake", &workflow);
    assert_eq!(fs::read_to_string(out.join("table.csv")).unwrap().trim_end(), expected);
}

/// `examples/dask` on the processors of this machine.
#[test]
#[ignore = "installs Dask: make test-slurm"]
fn a_dask_cluster_gives_the_table_of_a_serial_measurement_and_measures_only_what_changed() {
    let dir = tempfile::tempdir().unwrap();
    let (runs, list) = plates(dir.path());
    let (serial, out) = (dir.path().join("serial"), dir.path().join("out"));
    done("measure", &carved().arg("measure").arg("--out").arg(&serial).args(&runs).output().unwrap());
    let expected = table(&runs, &serial);
    let python = venv::python("dask", "distributed", "examples/dask/requirements.txt").unwrap();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/dask/measure.py");
    let measured = |more: &[&str]| {
        let output = Command::new(&python)
            .arg(&program)
            .args(["--shards", "5", "--carved", env!("CARGO_BIN_EXE_carved"), "--runs"])
            .args([&list, Path::new("--out"), &out])
            .args(more)
            .current_dir(dir.path())
            .output();
        let said = done("dask", &output.unwrap());
        serde_json::from_str::<serde_json::Value>(said.lines().last().unwrap()).unwrap()
    };
    fs::write(&list, runs[..2].join("\n")).unwrap();
    assert_eq!(measured(&[])["measured"], RECORDINGS * 2 / 3);
    fs::write(&list, runs.join("\n")).unwrap();
    let found = measured(&[]);
    assert_eq!(found["measured"], RECORDINGS / 3, "a plate more");
    assert!(found["plates_per_core_hour"].as_f64().unwrap() > 0.0, "{found}");
    assert_eq!(fs::read_to_string(out.join("table.csv")).unwrap().trim(), expected);
    assert_eq!(measured(&[])["measured"], 0, "nothing has changed");
    let method = dir.path().join("method.toml");
    fs::write(&method, "asd = 4\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 28.0\n").unwrap();
    assert_eq!(measured(&["--method", method.to_str().unwrap()])["measured"], RECORDINGS);
}
