//! `queue.json`: the plates that wait for their turn.
//!
//! ```text
//! put, order, remove ──► queue.json, synced ──► memory ──► the front, by its barcode ──► a run of this name
//!                                                              (a start leaves out what has become a run)
//! ```
//! A change is on disk before it counts. If the disk refuses it, nothing has changed. After a crash, a change that was refused at its last step,
//! the sync of the folder, may be there.
//! The front is taken out after its run is on disk. So a crash between the two loses no plate, and begins none twice: a name that is known
//! as a run has left the queue.

use super::{StoreError, durable, schema};
use carved_records::RunPlan;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const SCHEMA: &str = "carved.queue/1";
const FILE: &str = "queue.json";

/// Most plates in a queue: more than a plate hotel holds.
pub const MOST_PLATES: usize = 200;

/// A plate that waits: the name of its run, and the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct QueuedPlate {
    pub run: String,
    pub plan: RunPlan,
}

/// Content of the file.
#[derive(Serialize, Deserialize)]
struct QueueFile {
    schema: String,
    plates: Vec<QueuedPlate>,
}

/// Why the queue stays as it is.
#[derive(Debug, thiserror::Error)]
pub enum QueueError {
    #[error("plate {barcode} is queued already, for run {run}. Change or remove that entry")]
    QueuedAlready { barcode: String, run: String },
    #[error("the queue has {MOST_PLATES} plates, and takes no more. Remove one first")]
    Full,
    #[error("no plate is queued for run {run}. It has begun, or was removed")]
    Unknown { run: String },
    #[error("the order names {named}, and the queue has {queued}. It has changed meanwhile: read it and order it again")]
    OtherPlates { named: String, queued: String },
    #[error("no plate is queued, so plate {found} does not begin. Queue it first: PUT /v1/queue/RUN")]
    Empty { found: String },
    #[error(
        "plate {expected} is next in the queue, and plate {found} was reported. Nothing was begun. Bring {expected}, or change the order of the queue"
    )]
    OtherBarcode { expected: String, found: String },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The plates that wait, the next one first.
#[derive(Debug)]
pub struct PlateQueue {
    path: PathBuf,
    plates: Vec<QueuedPlate>,
    /// Why the file cannot be read. It is then left as it is, and no change is accepted.
    unreadable: Option<String>,
}

impl PlateQueue {
    /// The queue of a data folder. Empty if it has no file, or one that cannot be read.
    pub fn open(root: &Path) -> Self {
        let path = root.join(FILE);
        let read = match carved_files::read_own(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            Err(e) => Err(StoreError::io("read", &path)(e)),
            Ok(text) => read(&path, &text),
        };
        let (plates, unreadable) = match read {
            Ok(plates) => (plates, None),
            Err(error) => (Vec::new(), Some(error.to_string())),
        };
        Self { path, plates, unreadable }
    }

    /// Why the file of the queue cannot be read. `None` if it was read, or does not exist.
    pub fn unreadable(&self) -> Option<&str> {
        self.unreadable.as_deref()
    }

    /// The plates that wait, the next one first.
    pub fn plates(&self) -> &[QueuedPlate] {
        &self.plates
    }

    /// The plate that waits for this run.
    pub fn get(&self, run: &str) -> Option<&QueuedPlate> {
        self.plates.iter().find(|plate| plate.run == run)
    }

    /// Puts a plate at the end, or changes the plan of the one that waits for this run. Returns whether it is a new one.
    ///
    /// # Errors
    /// The queue is full, another entry has this barcode, or the disk refuses the change.
    pub fn put(&mut self, run: &str, plan: RunPlan) -> Result<bool, QueueError> {
        if let Some(other) = self.plates.iter().find(|plate| plate.run != run && plate.plan.plate_barcode == plan.plate_barcode) {
            return Err(QueueError::QueuedAlready { barcode: plan.plate_barcode, run: other.run.clone() });
        }
        let mut plates = self.plates.clone();
        let place = plates.iter().position(|plate| plate.run == run);
        match place {
            Some(place) => plates[place].plan = plan,
            None if plates.len() >= MOST_PLATES => return Err(QueueError::Full),
            None => plates.push(QueuedPlate { run: run.to_owned(), plan }),
        }
        self.replace(plates)?;
        Ok(place.is_none())
    }

    /// Takes a plate out.
    ///
    /// # Errors
    /// No plate waits for this run, or the disk refuses the change.
    pub fn remove(&mut self, run: &str) -> Result<(), QueueError> {
        if self.get(run).is_none() {
            return Err(QueueError::Unknown { run: run.to_owned() });
        }
        let plates = self.plates.iter().filter(|plate| plate.run != run).cloned().collect();
        Ok(self.replace(plates)?)
    }

    /// Puts the plates into the order of these runs.
    ///
    /// # Errors
    /// These are not exactly the runs that wait, or the disk refuses the change.
    pub fn order(&mut self, runs: &[String]) -> Result<(), QueueError> {
        let plates: Vec<QueuedPlate> = runs.iter().filter_map(|run| self.get(run).cloned()).collect();
        let has_each_once = runs.iter().enumerate().all(|(i, run)| !runs[..i].contains(run));
        if plates.len() != runs.len() || plates.len() != self.plates.len() || !has_each_once {
            let queued = self.plates.iter().map(|plate| plate.run.as_str());
            return Err(QueueError::OtherPlates { named: listed(runs.iter().map(String::as_str)), queued: listed(queued) });
        }
        Ok(self.replace(plates)?)
    }

    /// The plate that is to begin, if it has this barcode.
    ///
    /// # Errors
    /// Nothing waits, or another plate is next.
    pub fn next(&self, barcode: &str) -> Result<&QueuedPlate, QueueError> {
        let Some(next) = self.plates.first() else { return Err(QueueError::Empty { found: barcode.to_owned() }) };
        if next.plan.plate_barcode != barcode {
            return Err(QueueError::OtherBarcode { expected: next.plan.plate_barcode.clone(), found: barcode.to_owned() });
        }
        Ok(next)
    }

    /// Takes out every plate that has become a run.
    ///
    /// # Errors
    /// The disk refuses the change. The plates are out all the same, because their runs are on disk.
    pub fn take_begun(&mut self, is_run: impl Fn(&str) -> bool) -> Result<(), StoreError> {
        let queued = self.plates.len();
        self.plates.retain(|plate| !is_run(&plate.run));
        if self.plates.len() == queued { Ok(()) } else { self.write(&self.plates) }
    }

    fn replace(&mut self, plates: Vec<QueuedPlate>) -> Result<(), StoreError> {
        if plates != self.plates {
            self.write(&plates)?;
            self.plates = plates;
        }
        Ok(())
    }

    fn write(&self, plates: &[QueuedPlate]) -> Result<(), StoreError> {
        if let Some(why) = &self.unreadable {
            let expected = "a queue of plates. Move the file away and start the daemon again, or restore it";
            return Err(StoreError::Format { path: self.path.clone(), expected, found: why.clone() });
        }
        durable::write_json(&self.path, &QueueFile { schema: SCHEMA.into(), plates: plates.to_vec() })
    }
}

fn read(path: &Path, text: &[u8]) -> Result<Vec<QueuedPlate>, StoreError> {
    let QueueFile { plates, .. } = schema::parse(path, text, SCHEMA)?;
    Ok(plates)
}

fn listed<'a>(runs: impl Iterator<Item = &'a str>) -> String {
    let runs: Vec<&str> = runs.collect();
    if runs.is_empty() { "no plate".into() } else { runs.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{PlannedWell, SpecimenKind};

    fn plan(barcode: &str) -> RunPlan {
        RunPlan::new(barcode, "standard", "kim", vec![PlannedWell::new("A01", SpecimenKind::Larva, None)])
    }

    fn with(root: &Path, runs: &[&str]) -> PlateQueue {
        let mut queue = PlateQueue::open(root);
        for run in runs {
            assert!(queue.put(run, plan(&format!("P-{run}"))).unwrap());
        }
        queue
    }

    fn runs(queue: &PlateQueue) -> Vec<&str> {
        queue.plates().iter().map(|plate| plate.run.as_str()).collect()
    }

    #[test]
    fn each_change_is_there_after_a_crash() {
        let dir = tempfile::tempdir().unwrap();
        let again = || PlateQueue::open(dir.path());
        let mut queue = with(dir.path(), &["a", "b", "c"]);
        assert_eq!(again().plates(), queue.plates());
        queue.order(&["c", "a", "b"].map(str::to_owned)).unwrap();
        assert_eq!(runs(&again()), ["c", "a", "b"]);
        assert!(!queue.put("a", RunPlan { operator: "lee".into(), ..plan("P-9") }).unwrap(), "it is changed, in its place");
        assert_eq!((runs(&again()), again().get("a").unwrap().plan.operator.as_str()), (vec!["c", "a", "b"], "lee"));
        queue.remove("c").unwrap();
        assert_eq!(runs(&again()), ["a", "b"]);
        assert!(matches!(queue.remove("c"), Err(QueueError::Unknown { run }) if run == "c"));
    }

    #[test]
    fn only_the_plate_whose_turn_it_is_is_given() {
        let dir = tempfile::tempdir().unwrap();
        let queue = with(dir.path(), &["a", "b"]);
        assert_eq!(queue.next("P-a").unwrap().run, "a");
        for barcode in ["P-b", "P-A", "P-a ", ""] {
            let Err(QueueError::OtherBarcode { expected, found }) = queue.next(barcode) else { panic!("{barcode:?}") };
            assert_eq!((expected.as_str(), found.as_str()), ("P-a", barcode));
        }
        assert!(matches!(PlateQueue::open(&dir.path().join("none")).next("P-a"), Err(QueueError::Empty { .. })));
    }

    #[test]
    fn a_barcode_waits_once_and_an_order_names_each_plate_once() {
        let dir = tempfile::tempdir().unwrap();
        let mut queue = with(dir.path(), &["a", "b"]);
        assert!(matches!(queue.put("c", plan("P-a")), Err(QueueError::QueuedAlready { run, .. }) if run == "a"));
        for order in [&["a"][..], &["a", "a"], &["a", "b", "c"], &["a", "c"], &["a", "b", "a"], &[]] {
            let order: Vec<String> = order.iter().map(|run| (*run).to_owned()).collect();
            assert!(matches!(queue.order(&order), Err(QueueError::OtherPlates { .. })), "{order:?}");
        }
        assert_eq!(runs(&queue), ["a", "b"]);
    }

    #[test]
    fn a_plate_that_became_a_run_has_left_the_queue_whenever_the_process_ended() {
        let dir = tempfile::tempdir().unwrap();
        drop(with(dir.path(), &["a", "b"]));
        let mut queue = PlateQueue::open(dir.path());
        queue.take_begun(|run| run == "a").unwrap();
        assert_eq!(runs(&queue), ["b"]);
        assert_eq!(runs(&PlateQueue::open(dir.path())), ["b"]);
    }

    #[test]
    fn a_file_that_cannot_be_read_is_left_as_it_is_and_nothing_is_queued() {
        for text in ["", "{", r#"{"schema": "carved.queue/1"}"#, r#"{"schema": "carved.queue/2", "plates": []}"#, r#"{"plates": []}"#] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join(FILE);
            std::fs::write(&path, text).unwrap();
            let mut queue = PlateQueue::open(dir.path());
            assert!(queue.unreadable().is_some_and(|why| why.contains(FILE)), "{text}: {:?}", queue.unreadable());
            let refused = queue.put("a", plan("P-a")).unwrap_err().to_string();
            assert!(refused.contains("Move the file away"), "{refused}");
            assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), queue.plates()), (text, &[][..]));
        }
    }

    #[test]
    fn a_full_disk_or_a_full_queue_loses_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let mut queue = with(dir.path(), &["a"]);
        crate::testing::trace::fill(0, || ());
        let refused = queue.put("b", plan("P-b"));
        crate::testing::trace::end();
        assert!(matches!(&refused, Err(QueueError::Store(error)) if error.is_full()), "{refused:?}");
        assert_eq!((runs(&queue), runs(&PlateQueue::open(dir.path()))), (vec!["a"], vec!["a"]));
        queue.plates = (0..MOST_PLATES).map(|n| QueuedPlate { run: format!("r{n}"), plan: plan(&format!("P{n}")) }).collect();
        assert!(matches!(queue.put("b", plan("P-b")), Err(QueueError::Full)));
    }
}
