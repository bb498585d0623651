//! A running server, and the driver at its other end, which the tests control.

use crate::wire::{self, Answer};
use carved::api::{Check, HandoffNeeds, HardwareStatus, InstrumentIdentity, Mode, Pending, Plate, State, Status};
use carved::config::HttpSettings;
use carved::http::{HttpError, bind, serve};
use carved::session::{Accepted, Command, Publisher, QueueChange, QueueRefusal, Refusal, channel};
use carved_records::{Asked, Event, EventBody, EventData, Method, RunPlan, ViewTaken};
use carved_store::StoreReader;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use tokio::runtime::Runtime;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

/// Number of the driver's newest fault.
pub const NEWEST_FAULT: u64 = 17;
pub const BOOT: &str = "boot-7f";
pub const PLAN: &str =
    r#"{"plate_barcode": "P-1", "method": "standard", "operator": "kim", "plate_map": [{"well": "A01", "dpf": 3}, {"well": "A02"}]}"#;

/// The methods of this instrument.
fn methods() -> BTreeMap<String, Method> {
    let method = json!({"asd": 21, "order": "coarse_to_fine", "epsilon": 0.05, "voxel_um": 6.93});
    BTreeMap::from([("standard".to_owned(), serde_json::from_value(method).unwrap())])
}

pub struct Rig {
    pub address: SocketAddr,
    pub driver: Arc<Publisher>,
    /// If set, the driver refuses every command with this.
    pub refusal: Arc<Mutex<Option<Refusal>>>,
    /// Commands that reached the driver.
    pub commands: Arc<Mutex<Vec<String>>>,
    /// Who asked for the commands that change a run, and from where.
    pub asked: Arc<Mutex<Vec<Asked>>>,
    /// The data folder that results are read from; empty, without an index, until a test fills it.
    pub data: tempfile::TempDir,
    contract: Value,
    runtime: Runtime,
    server: Option<JoinHandle<Result<(), HttpError>>>,
    stop: Option<oneshot::Sender<()>>,
}

pub fn status() -> Status {
    Status {
        schema: "carved/status/1".into(),
        revision: 41,
        boot_id: BOOT.into(),
        server_time: String::new(),
        uptime_s: 0.0,
        version: "1.2.3".into(),
        instrument: InstrumentIdentity {
            name: "vast-1".into(),
            uuid: "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11".into(),
            ..InstrumentIdentity::default()
        },
        mode: Mode::Simulated,
        ready: true,
        not_ready_reason: None,
        state: State::Idle,
        doing: "Waiting for a run.".into(),
        pending: Pending::default(),
        plate: Plate::default(),
        queue: Vec::new(),
        run: None,
        specimen: None,
        hardware: HardwareStatus::default(),
        notices: None,
        calibration: None,
        faults: Vec::new(),
    }
}

pub fn event(id: u64) -> Event {
    let data = EventData::ViewTaken(ViewTaken::default());
    Event { id, body: EventBody { time: "2026-01-01T00:00:00Z".into(), run: None, well: None, data } }
}

pub fn settings() -> HttpSettings {
    HttpSettings { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..HttpSettings::default() }
}

impl Rig {
    pub fn start() -> Self {
        Self::with(settings(), Vec::new())
    }

    pub fn with(settings: HttpSettings, tail: Vec<Event>) -> Self {
        let runtime = Runtime::new().unwrap();
        let (session, mailbox, driver) = channel(status(), tail);
        let session = session.offering(methods());
        let (refusal, commands) = <(Arc<Mutex<Option<Refusal>>>, Arc<Mutex<Vec<String>>>)>::default();
        let asked = Arc::default();
        runtime.spawn(drive(mailbox, refusal.clone(), commands.clone(), Arc::clone(&asked)));
        let data = tempfile::tempdir().unwrap();
        let reader = StoreReader::new(data.path());
        let listener = bind(&settings).unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, stopped) = oneshot::channel::<()>();
        let server = runtime.spawn(async move {
            let shutdown = async { drop(stopped.await) };
            serve(listener, session, reader, settings, shutdown).await
        });
        let contract = wire::exchange(address, b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n").json();
        let driver = Arc::new(driver);
        Self { address, driver, refusal, commands, asked, data, contract, runtime, server: Some(server), stop: Some(stop) }
    }

    pub fn contract(&self) -> &Value {
        &self.contract
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], "")
    }

    pub fn put(&self, path: &str, body: &str) -> Answer {
        self.send("PUT", path, &[("Content-Type", "application/json")], body)
    }

    /// Sends an ordinary request and checks the answer against the contract.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut request = format!("{method} {path} HTTP/1.1\r\n");
        if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("host")) {
            request += &format!("Host: {}\r\n", self.address);
        }
        for (name, value) in headers {
            request += &format!("{name}: {value}\r\n");
        }
        request += &format!("Content-Length: {}\r\n\r\n{body}", body.len());
        let answer = wire::exchange(self.address, request.as_bytes());
        if let Some(operation) = self.operation(method, path) {
            let declared = operation["responses"].get(answer.status.to_string());
            assert!(declared.is_some(), "{method} {path}: the contract does not declare {answer:?}");
        }
        answer
    }

    /// The operation of the contract for a path.
    fn operation(&self, method: &str, path: &str) -> Option<&Value> {
        let path = path.split('?').next()?;
        let fits = |pattern: &str| {
            let (mut a, mut b) = (pattern.split('/'), path.split('/'));
            a.clone().count() == b.clone().count() && a.all(|part| b.next().is_some_and(|found| part.starts_with('{') || part == found))
        };
        let (_, item) = self.contract["paths"].as_object()?.iter().find(|(pattern, _)| fits(pattern))?;
        item.get(method.to_lowercase())
    }

    pub fn refuse(&self, refusal: Refusal) {
        *self.refusal.lock().unwrap() = Some(refusal);
    }

    /// Requests the end of the server; `finish` waits for it.
    pub fn stop(&mut self) {
        drop(self.stop.take());
    }

    pub fn finish(mut self) -> Result<(), HttpError> {
        self.stop();
        let server = self.server.take().unwrap();
        self.runtime.block_on(async { tokio::time::timeout(wire::PATIENCE, server).await }).unwrap().unwrap()
    }
}

/// The plates that wait, as the commands arrange them. Its rules are tested with the driver; here the requests must reach it whole.
#[derive(Default)]
struct Queue(Vec<(String, RunPlan)>);

impl Queue {
    fn change(&mut self, change: QueueChange) -> Accepted {
        match change {
            QueueChange::Put { run, plan } => {
                if let Some((_, queued)) = self.0.iter_mut().find(|(queued, _)| *queued == run) {
                    *queued = plan;
                } else {
                    self.0.push((run, plan));
                    return Accepted::Created;
                }
            }
            QueueChange::Remove { run } => self.0.retain(|(queued, _)| *queued != run),
            QueueChange::Order { runs } => self.0.sort_by_key(|(queued, _)| runs.iter().position(|run| run == queued)),
        }
        Accepted::Same
    }

    fn plan(&self, run: &str) -> Option<RunPlan> {
        self.0.iter().find(|(queued, _)| queued == run).map(|(_, plan)| plan.clone())
    }

    /// The run of the first plate, which has this barcode.
    fn begin(&mut self, barcode: &str) -> String {
        let (run, plan) = self.0.remove(0);
        assert_eq!(plan.plate_barcode, barcode, "{run}");
        run
    }
}

async fn drive(
    mut mailbox: mpsc::Receiver<Command>,
    refusal: Arc<Mutex<Option<Refusal>>>,
    commands: Arc<Mutex<Vec<String>>>,
    asking: Arc<Mutex<Vec<Asked>>>,
) {
    let methods = methods();
    let mut runs: BTreeMap<String, RunPlan> = BTreeMap::new();
    let mut queue = Queue::default();
    while let Some(command) = mailbox.recv().await {
        let refusal = refusal.lock().unwrap().clone();
        match command {
            Command::PutRun { id, plan, answer } => {
                commands.lock().unwrap().push(format!("put {id}"));
                let verdict = match (refusal, runs.get(&id)) {
                    (Some(refusal), _) => Err(refusal),
                    (None, Some(known)) if *known == plan => Ok(Accepted::Same),
                    (None, Some(_)) => Err(Refusal::OtherPlan { id }),
                    (None, None) => plan.check(&methods).map_err(Refusal::InvalidPlan).map(|()| {
                        runs.insert(id, plan);
                        Accepted::Created
                    }),
                };
                answer.send(verdict).unwrap();
            }
            Command::Queue { change, answer } => {
                answer.send(refusal.map_or_else(|| Ok(queue.change(change)), Err)).unwrap();
            }
            Command::Queued { run, answer } => {
                let unknown = Refusal::Queue { why: format!("no plate is queued for run {run}"), kind: QueueRefusal::Unknown };
                answer.send(refusal.map_or_else(|| queue.plan(&run).ok_or(unknown), Err)).unwrap();
            }
            Command::NextPlate { barcode, answer } => {
                answer.send(refusal.map_or_else(|| Ok((queue.begin(&barcode), Accepted::Created)), Err)).unwrap();
            }
            Command::Steer { id, towards, asked, answer } => {
                asking.lock().unwrap().push(asked);
                commands.lock().unwrap().push(format!("{towards:?} {id}").to_lowercase());
                let known = runs.contains_key(&id);
                let unknown = Refusal::UnknownRun { id, newest: runs.keys().next_back().cloned() };
                answer.send(refusal.map_or(if known { Ok(()) } else { Err(unknown) }, Err)).unwrap();
            }
            Command::EmergencyStop { answer } => {
                commands.lock().unwrap().push("emergency stop".into());
                answer.send(refusal.map_or(Ok(()), Err)).unwrap();
            }
            Command::Acknowledge { seq, answer, .. } => {
                commands.lock().unwrap().push(format!("acknowledge {seq}"));
                let verdict = if seq <= NEWEST_FAULT { Ok(()) } else { Err(Refusal::UnknownFault { seq, newest: NEWEST_FAULT }) };
                answer.send(refusal.map_or(verdict, Err)).unwrap();
            }
            Command::OfWell { run, well, said, answer } => {
                commands.lock().unwrap().push(format!("{said:?} {run} {well}"));
                let unknown = Refusal::UnknownRun { id: run.clone(), newest: runs.keys().next_back().cloned() };
                answer.send(refusal.map_or(if runs.contains_key(&run) { Ok(()) } else { Err(unknown) }, Err)).unwrap();
            }
            Command::Picture { answer } => {
                commands.lock().unwrap().push("picture".into());
                answer.send(refusal.map_or(Ok(Arc::new(vec![0xff, 0xd8])), Err)).unwrap();
            }
            Command::Handoff { plate, answer } => {
                commands.lock().unwrap().push(format!("{:?} {}", plate.intent, plate.barcode));
                let needs = HandoffNeeds { intent: plate.intent, barcode: plate.barcode, needs: Some("the run to end".into()) };
                answer.send(refusal.map_or(Ok(needs), Err)).unwrap();
            }
            Command::EndHandoff { end, answer } => {
                commands.lock().unwrap().push(format!("{end:?}"));
                answer.send(refusal.map_or(Ok(()), Err)).unwrap();
            }
            Command::Preflight { plan, answer } => {
                commands.lock().unwrap().push(format!("preflight {}", plan.plate_barcode));
                let found = |code: &str, passed: bool, blocks: bool| Check {
                    code: code.into(),
                    passed,
                    blocks,
                    detail: "found".into(),
                    what_to_do: (!passed).then(|| "mend it".into()),
                };
                let checks =
                    vec![found("camera", true, true), found("references", false, false), found("disk", plan.operator != "full", true)];
                answer.send(refusal.map_or(Ok(checks), Err)).unwrap();
            }
            Command::Loaded { run, well, loaded, answer } => {
                commands.lock().unwrap().push(format!("{} {run} {well}", if loaded { "loaded" } else { "unloaded" }));
                let verdict = match runs.get(&run) {
                    None => Err(Refusal::UnknownRun { id: run, newest: None }),
                    Some(plan) if plan.plate_map.iter().any(|w| w.well == well) => Ok(()),
                    Some(_) => Err(Refusal::UnexpectedWell { run, well, instead: "that of well A01 is waited for".into() }),
                };
                answer.send(refusal.map_or(verdict, Err)).unwrap();
            }
        }
    }
}
