//! The interface to the session. Commands enter a mailbox, and are accepted or refused by name. All others read snapshots. Only the driver
//! changes state.

use super::halt::Halt;
use super::tally::Tally;
use super::{Check, State, Status};
use crate::api::{HandoffNeeds, RunOutcome};
use crate::notify::Notices;
use carved_records::{Asked, Event, FieldError, Handoff, HandoffEnd, HandoffIntent, Method, RunPlan, SaidBy, WellNote};
use carved_store::{QueueError, StoreError, size};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Instant;
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// Why a command was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    #[error("the plan has {} mistake(s)", .0.len())]
    InvalidPlan(Vec<FieldError>),
    #[error("the handover has {} mistake(s)", .0.len())]
    InvalidHandoff(Vec<FieldError>),
    #[error("the body has {} mistake(s)", .0.len())]
    InvalidSaying(Vec<FieldError>),
    #[error("nothing is done about well {well} of run {run}: {why}")]
    WellNotNow { run: String, well: String, why: String },
    #[error("run {id} exists with another plan; name the new run otherwise")]
    OtherPlan { id: String },
    #[error("run {id} was measured before and is no longer in the data folder. Choose another run id")]
    Pruned { id: String },
    #[error("the instrument is in state {state:?}; this command is accepted in {accepted_in:?}")]
    WrongState { state: State, accepted_in: Vec<State> },
    #[error("run {id} has ended{}; nothing can be done to it any more", outcome.map(|o| format!(" as {}", format!("{o:?}").to_lowercase())).unwrap_or_default())]
    RunEnded { id: String, outcome: Option<RunOutcome> },
    #[error(
        "the specimen of well {well} is still in the capillary. Take it out and say so: PUT /v1/runs/{run}/wells/{well} {{\"loaded\": false}}"
    )]
    CapillaryFull { run: String, well: String },
    #[error(
        "the sampler was asked for the specimen of well {well} and may still bring it. Take it out once it has come, then say so, also if it \
         does not come: PUT /v1/runs/{run}/wells/{well} {{\"loaded\": false}}"
    )]
    MayStillCome { run: String, well: String },
    #[error("no run {id}; {}", newest.as_ref().map_or("there is none yet".to_owned(), |n| format!("the newest is {n}")))]
    UnknownRun { id: String, newest: Option<String> },
    #[error("the instrument expects no message about well {well} of run {run} now: {instead}")]
    UnexpectedWell { run: String, well: String, instead: String },
    #[error("nothing can run: {why}")]
    DeviceLost { why: String },
    #[error(
        "nothing runs before fault {seq} ({code}) is acknowledged: {} Mend its cause, then POST /v1/faults/{seq}/acknowledge",
        sentence(message)
    )]
    FaultStands { seq: u64, code: String, message: String },
    #[error("there has been no fault {seq}; the newest is {newest}")]
    UnknownFault { seq: u64, newest: u64 },
    #[error("plate {expected} is inside; the plan names plate {found}")]
    OtherBarcode { expected: String, found: String },
    #[error("plate {inside} is still inside: {}", first(*.intent, inside, found))]
    PlateInside { intent: HandoffIntent, inside: String, found: String },
    #[error("no plate is being handed over; announce it: PUT /v1/plate/handoff {{\"intent\", \"barcode\"}}")]
    NoHandoff,
    #[error("plate {barcode} is being handed over; say how that ended first: PUT /v1/plate/handoff/completed or /aborted")]
    HandoffOpen { barcode: String },
    #[error("the plate cannot be taken yet: {needs}")]
    PlateNeeded { needs: String },
    #[error("the plate needs {} on the disk and {} are free: remove runs that are archived, or split the plate", size(*needed_bytes), size(*free_bytes))]
    WillNotFit { needed_bytes: u64, free_bytes: u64 },
    #[error("no run can start: {why}")]
    OverBudget { why: String },
    #[error("the instrument is being checked; ask again when that is done")]
    Busy,
    #[error("there is no picture: {why}")]
    NoPicture { why: String },
    #[error("{why}")]
    Queue { why: String, kind: QueueRefusal },
    #[error("run {id} is queued. It begins in its turn: report its plate as the next one, or remove it from the queue")]
    Queued { id: String },
    #[error("the disk refused the write: {why}")]
    Store { why: String, full: bool },
    #[error("the instrument is shutting down")]
    ShuttingDown,
}

/// What a refusal of the queue of plates is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueueRefusal {
    /// The entry that the request names does not exist.
    Unknown,
    /// Another plate than the next one was reported.
    OtherPlate,
    /// No plate is queued.
    Empty,
    /// The change does not fit the queue as it is.
    Conflict,
}

/// What comes before the handover of a plate while another one is inside.
fn first(intent: HandoffIntent, inside: &str, found: &str) -> String {
    let unload = format!("hand it over with intent unload and its barcode {inside}");
    match intent {
        HandoffIntent::Load => format!("{unload}, then load {found}"),
        HandoffIntent::Unload => format!("{unload}, not {found}"),
    }
}

/// The text with exactly one full stop at its end.
fn sentence(text: &str) -> String {
    format!("{}.", text.trim_end_matches('.'))
}

impl From<StoreError> for Refusal {
    fn from(e: StoreError) -> Self {
        Self::Store { full: e.is_full(), why: e.to_string() }
    }
}

impl From<QueueError> for Refusal {
    fn from(error: QueueError) -> Self {
        let kind = match error {
            QueueError::Store(error) => return error.into(),
            QueueError::Unknown { .. } => QueueRefusal::Unknown,
            QueueError::OtherBarcode { .. } => QueueRefusal::OtherPlate,
            QueueError::Empty { .. } => QueueRefusal::Empty,
            QueueError::QueuedAlready { .. } | QueueError::Full | QueueError::OtherPlates { .. } => QueueRefusal::Conflict,
        };
        Self::Queue { why: error.to_string(), kind }
    }
}

/// The answer of `put_run`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accepted {
    /// A new run is in the journal and will start.
    Created,
    /// The same run was accepted before. Nothing changed.
    Same,
}

/// The requested change of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Towards {
    /// Hold after the current specimen.
    Hold,
    /// Continue a held run.
    Unhold,
    /// End after the current specimen.
    Stop,
    /// End at once.
    Abort,
}

/// What a person says about a well.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Said {
    /// The held run leaves it out.
    Skip(SaidBy),
    /// The held run measures it again.
    Redo(SaidBy),
    /// A remark, also on a well of a run that has ended.
    Note(WellNote),
}

/// A change of the queue of plates.
#[derive(Debug, Clone, PartialEq)]
pub enum QueueChange {
    /// A plate at the end, or another plan for the one that waits for this run.
    Put {
        run: String,
        plan: RunPlan,
    },
    Remove {
        run: String,
    },
    /// All runs that wait, in their new order.
    Order {
        runs: Vec<String>,
    },
}

/// A command with the channel for its answer.
pub enum Command {
    PutRun {
        id: String,
        plan: RunPlan,
        answer: oneshot::Sender<Result<Accepted, Refusal>>,
    },
    /// Changes the queue of plates.
    Queue {
        change: QueueChange,
        answer: oneshot::Sender<Result<Accepted, Refusal>>,
    },
    /// The plan of a queued plate.
    Queued {
        run: String,
        answer: oneshot::Sender<Result<RunPlan, Refusal>>,
    },
    /// The plate of this barcode is in its place. Begins its run if it is the next one. Returns the name of the run.
    NextPlate {
        barcode: String,
        answer: oneshot::Sender<Result<(String, Accepted), Refusal>>,
    },
    /// Changes the state of a run.
    Steer {
        id: String,
        towards: Towards,
        asked: Asked,
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
    /// The motors have stopped already.
    EmergencyStop {
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
    Acknowledge {
        seq: u64,
        asked: Asked,
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
    /// What a person says about a well.
    OfWell {
        run: String,
        well: String,
        said: Said,
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
    Handoff {
        plate: Handoff,
        answer: oneshot::Sender<Result<HandoffNeeds, Refusal>>,
    },
    EndHandoff {
        end: HandoffEnd,
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
    Preflight {
        plan: RunPlan,
        answer: oneshot::Sender<Result<Vec<Check>, Refusal>>,
    },
    /// Takes a picture at rest.
    Picture {
        answer: oneshot::Sender<Result<Arc<Vec<u8>>, Refusal>>,
    },
    Loaded {
        run: String,
        well: String,
        loaded: bool,
        answer: oneshot::Sender<Result<(), Refusal>>,
    },
}

/// The specimen in the live pictures, and its number of views so far. The number is 0 at the detection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    pub run: String,
    pub well: String,
    pub views: u32,
}

/// The newest frame, its profile and the live model, encoded for the page.
#[derive(Debug, Clone, Default)]
pub struct Live {
    /// Set by the driver, which knows the run.
    pub shown: Option<Shown>,
    /// JPEG of the newest frame, in colour.
    pub frame_jpg: Option<Arc<Vec<u8>>>,
    /// PNG of the frame's size. It shows the edge of the profile and is transparent elsewhere.
    pub profile_png: Option<Arc<Vec<u8>>>,
    /// Binary glTF of the live hull, then of the finished model, in um.
    pub mesh_glb: Option<Arc<Vec<u8>>>,
}

/// Read access to the session, and its mailbox. It can be cloned freely.
#[derive(Clone)]
pub struct SessionHandle {
    commands: mpsc::Sender<Command>,
    status: watch::Receiver<Arc<Status>>,
    live: Arc<Mutex<Live>>,
    events: Arc<EventLog>,
    halt: Halt,
    booted: Instant,
    methods: Arc<BTreeMap<String, Method>>,
    notices: Option<Notices>,
}

impl SessionHandle {
    /// The newest snapshot, with the current time and ages.
    pub fn status(&self) -> Status {
        self.stamp(&self.status.borrow().clone())
    }

    fn stamp(&self, snapshot: &Status) -> Status {
        let mut status = snapshot.clone();
        let now = jiff::Timestamp::now();
        status.server_time = now.to_string();
        if let Some(calibration) = &mut status.calibration {
            calibration.age_s = calibration.age_s(now).unwrap_or(calibration.age_s);
        }
        status.uptime_s = self.booted.elapsed().as_secs_f64();
        status
    }

    /// Waits until the revision is above `after`. The caller must limit the time of the wait.
    pub async fn status_after(&self, after: u64) -> Status {
        let mut watch = self.status.clone();
        let newer = watch.wait_for(|s| s.revision > after).await.map(|s| s.clone());
        newer.map_or_else(|_| self.status(), |s| self.stamp(&s))
    }

    /// Waits until the status is so, or the driver has ended.
    pub(super) async fn until(&self, is_so: impl FnMut(&Status) -> bool) {
        let (mut status, mut is_so) = (self.status.clone(), is_so);
        let _ended = status.wait_for(|status| is_so(status)).await;
    }

    /// Waits until the status shows what the previous process left, or the driver has ended.
    pub async fn until_restored(&self) {
        self.until(|status| !status.is_starting()).await;
    }

    /// Sets the methods that a run may name.
    #[must_use]
    pub fn offering(self, methods: BTreeMap<String, Method>) -> Self {
        Self { methods: methods.into(), ..self }
    }

    /// The methods that a run may name.
    pub fn methods(&self) -> &BTreeMap<String, Method> {
        &self.methods
    }

    /// Sets who sends notices.
    #[must_use]
    pub fn noticing(self, notices: Option<Notices>) -> Self {
        Self { notices, ..self }
    }

    pub fn notices(&self) -> Option<&Notices> {
        self.notices.as_ref()
    }

    pub fn live(&self) -> Live {
        self.live.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn events(&self) -> &EventLog {
        &self.events
    }

    async fn ask<T>(&self, make: impl FnOnce(oneshot::Sender<Result<T, Refusal>>) -> Command) -> Result<T, Refusal> {
        let (answer, answered) = oneshot::channel();
        self.commands.send(make(answer)).await.map_err(|_| Refusal::ShuttingDown)?;
        answered.await.unwrap_or(Err(Refusal::ShuttingDown))
    }

    /// Starts a run under the client's name for it. The answer comes once the run is on disk.
    pub async fn put_run(&self, id: String, plan: RunPlan) -> Result<Accepted, Refusal> {
        self.ask(|answer| Command::PutRun { id, plan, answer }).await
    }

    /// Changes the queue of plates. The answer comes once the change is on disk.
    pub async fn change_queue(&self, change: QueueChange) -> Result<Accepted, Refusal> {
        self.ask(|answer| Command::Queue { change, answer }).await
    }

    /// The plan of the plate that waits for this run.
    pub async fn queued(&self, run: String) -> Result<RunPlan, Refusal> {
        self.ask(|answer| Command::Queued { run, answer }).await
    }

    /// Begins the run of the next plate in the queue, if this is its barcode.
    pub async fn next_plate(&self, barcode: String) -> Result<(String, Accepted), Refusal> {
        self.ask(|answer| Command::NextPlate { barcode, answer }).await
    }

    /// Holds, continues, stops or aborts a run. `asked` says for whom. The answer comes once the request is in the journal, and not
    /// once the state is reached.
    pub async fn steer(&self, id: String, towards: Towards, asked: Asked) -> Result<(), Refusal> {
        self.ask(|answer| Command::Steer { id, towards, asked, answer }).await
    }

    /// Carries out what a person says about a well. The answer comes once it is on disk.
    pub async fn said(&self, run: String, well: String, said: Said) -> Result<(), Refusal> {
        self.ask(|answer| Command::OfWell { run, well, said, answer }).await
    }

    /// Stops the motors, whether or not the caller waits, and returns once the stop is on the wire.
    pub async fn emergency_stop(&self, asked: Asked) {
        self.halt.stop(asked).await;
    }

    /// Asks the driver to journal an emergency stop. It takes the stop in any case.
    pub async fn latch_emergency_stop(&self) -> Result<(), Refusal> {
        self.ask(|answer| Command::EmergencyStop { answer }).await
    }

    /// Waits until the driver knows that the daemon ends, or has ended.
    pub async fn until_ending(&self) {
        self.until(Status::is_ending).await;
    }

    /// Stops the motors without the driver, before the process ends at once.
    pub fn stop_motors(&self) {
        self.halt.stop_motors();
    }

    /// Acknowledges a fault for the operator.
    pub async fn acknowledge(&self, seq: u64, asked: Asked) -> Result<(), Refusal> {
        self.ask(|answer| Command::Acknowledge { seq, asked, answer }).await
    }

    /// Announces that a plate will be brought or taken away. Returns what must happen first.
    pub async fn handoff(&self, plate: Handoff) -> Result<HandoffNeeds, Refusal> {
        self.ask(|answer| Command::Handoff { plate, answer }).await
    }

    pub async fn end_handoff(&self, end: HandoffEnd) -> Result<(), Refusal> {
        self.ask(|answer| Command::EndHandoff { end, answer }).await
    }

    /// Checks everything that would prevent this plan from running, on the instrument itself.
    pub async fn preflight(&self, plan: RunPlan) -> Result<Vec<Check>, Refusal> {
        self.ask(|answer| Command::Preflight { plan, answer }).await
    }

    /// Takes a picture while no run is under way, as JPEG. Nothing moves.
    pub async fn picture(&self) -> Result<Arc<Vec<u8>>, Refusal> {
        self.ask(|answer| Command::Picture { answer }).await
    }

    /// Reports for the loader that the specimen of this well is in the capillary, or was taken out.
    pub async fn loaded(&self, run: String, well: String, loaded: bool) -> Result<(), Refusal> {
        self.ask(|answer| Command::Loaded { run, well, loaded, answer }).await
    }
}

/// The newest status, as it is written.
pub type SharedStatus = watch::Sender<Arc<Status>>;

/// The driver's end: it writes everything that the handle reads. It has no way to read the status, which is output only.
pub struct Publisher {
    status: Arc<SharedStatus>,
    live: Arc<Mutex<Live>>,
    events: Arc<EventLog>,
    halt: Halt,
    notices: Option<Notices>,
}

impl Publisher {
    /// Shows every revision to `notices`.
    #[must_use]
    pub fn noticing(self, notices: Option<Notices>) -> Self {
        Self { notices, ..self }
    }

    /// The path of the emergency stop.
    pub fn halt(&self) -> &Halt {
        &self.halt
    }

    /// The status, for what shows that the driver waits for the disk.
    pub fn shared(&self) -> Weak<SharedStatus> {
        Arc::downgrade(&self.status)
    }

    /// The newest events in memory, oldest first.
    pub fn tail(&self) -> Vec<Arc<Event>> {
        self.events.tail.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// Publishes `change` as one new revision.
    pub fn publish(&self, change: impl FnOnce(&mut Status)) {
        self.status.send_modify(|current| {
            let mut next = Status::clone(current);
            change(&mut next);
            next.revision += 1;
            *current = Arc::new(next);
        });
        if let Some(notices) = &self.notices {
            notices.see(&self.status.borrow());
        }
    }

    /// Publishes `change`, and `derive` after it, as one new revision, unless `change` changes nothing.
    pub fn publish_news(&self, change: impl FnOnce(&mut Status), derive: impl FnOnce(&mut Status)) {
        let is_news = self.status.send_if_modified(|current| {
            let mut next = Status::clone(current);
            change(&mut next);
            if next == **current {
                return false;
            }
            derive(&mut next);
            next.revision += 1;
            *current = Arc::new(next);
            true
        });
        if let Some(notices) = self.notices.as_ref().filter(|_| is_news) {
            notices.see(&self.status.borrow());
        }
    }

    pub fn set_live(&self, change: impl FnOnce(&mut Live)) {
        change(&mut self.live.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// The log that receives events once they are on disk, and sends them to all subscribers.
    pub fn log(&self) -> Arc<EventLog> {
        self.events.clone()
    }
}

/// Number of events in memory, for readers that reconnect.
const KEPT_EVENTS: usize = 2000;

/// The tail of the event journal and its live continuation.
pub struct EventLog {
    tail: Mutex<std::collections::VecDeque<Arc<Event>>>,
    live: broadcast::Sender<Arc<Event>>,
    tally: Tally,
}

/// The events that a reader has missed.
pub enum Missed {
    /// These events, then the live ones.
    Events(Vec<Arc<Event>>),
    /// More events than are in memory. Read the status again, then continue with live events.
    Resync,
}

impl EventLog {
    pub fn new(tail: Vec<Event>) -> Self {
        let skip = tail.len().saturating_sub(KEPT_EVENTS);
        Self {
            tail: Mutex::new(tail.into_iter().skip(skip).map(Arc::new).collect()),
            live: broadcast::channel(256).0,
            tally: Tally::default(),
        }
    }

    /// Appends an event that is on disk, and sends it to all subscribers.
    pub fn push(&self, event: Event) {
        self.tally.take(&event.body.data);
        let event = Arc::new(event);
        let mut tail = self.tail.lock().unwrap_or_else(PoisonError::into_inner);
        if tail.len() == KEPT_EVENTS {
            tail.pop_front();
        }
        tail.push_back(event.clone());
        // Sent under the lock, so that a new subscriber gets each event once: as missed or as live.
        let _nobody_listens = self.live.send(event);
    }

    /// The numbers of what has happened since the start of the daemon.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Subscribes to live events. Returns also the events since `after`, or none if `after` is `None`.
    pub fn subscribe(&self, after: Option<u64>) -> (Missed, broadcast::Receiver<Arc<Event>>) {
        let tail = self.tail.lock().unwrap_or_else(PoisonError::into_inner);
        let live = self.live.subscribe();
        let Some(after) = after else { return (Missed::Events(Vec::new()), live) };
        let oldest = tail.front().map(|e| e.id);
        let newest = tail.back().map_or(0, |e| e.id);
        // An id above the newest belongs to another journal. Before the oldest, some events are no longer in memory.
        if after > newest || oldest.is_some_and(|o| after + 1 < o) {
            return (Missed::Resync, live);
        }
        (Missed::Events(tail.iter().filter(|e| e.id > after).cloned().collect()), live)
    }
}

/// The handle for clients, and mailbox and publisher for the driver.
pub fn channel(first: Status, tail: Vec<Event>) -> (SessionHandle, mpsc::Receiver<Command>, Publisher) {
    let (commands, mailbox) = mpsc::channel(16);
    let (status, watch) = watch::channel(Arc::new(first));
    let live = Arc::new(Mutex::new(Live::default()));
    let events = Arc::new(EventLog::new(tail));
    let halt = Halt::default();
    let handle = SessionHandle {
        commands,
        status: watch,
        live: live.clone(),
        events: events.clone(),
        halt: halt.clone(),
        booted: Instant::now(),
        methods: Arc::default(),
        notices: None,
    };
    (handle, mailbox, Publisher { status: Arc::new(status), live, events, halt, notices: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::EventData;

    fn event(id: u64) -> Event {
        Event { id, body: carved_store::now(None, None, EventData::RunStarted) }
    }

    #[test]
    fn a_returning_reader_gets_each_event_once_or_must_resync() {
        let log = EventLog::new((5..8).map(event).collect());
        let ids = |after| match log.subscribe(after).0 {
            Missed::Events(list) => Some(list.iter().map(|e| e.id).collect::<Vec<_>>()),
            Missed::Resync => None,
        };
        assert_eq!(ids(Some(5)), Some(vec![6, 7]));
        assert_eq!(ids(Some(4)), Some(vec![5, 6, 7]));
        assert_eq!(ids(Some(3)), None, "event 4 is not kept any more");
        assert_eq!(ids(Some(99)), None, "an id this journal never gave");
        assert_eq!(ids(None), Some(vec![]));
        let (_, mut live) = log.subscribe(Some(7));
        log.push(event(8));
        assert_eq!(live.try_recv().unwrap().id, 8);
    }
}
