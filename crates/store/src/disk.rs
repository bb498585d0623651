//! The file operations behind durable writes. The tests hook in here: they simulate a power loss after each operation, and a failure of
//! each operation (`power_loss`). A watch tells how long an operation of its thread takes, and [`busy_for`] that of any thread.

use std::cell::RefCell;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

#[cfg(any(test, feature = "testing"))]
use crate::testing::trace;

/// Reports an operation to the tests before it is done. Returns the error that a test injects.
macro_rules! step {
    ($op:ident, $path:expr $(, $what:expr)*) => {
        let _: &Path = $path;
        #[cfg(any(test, feature = "testing"))]
        trace::step(trace::Op::$op($path.into() $(, $what.into())*))?;
    };
}

#[cfg(any(test, feature = "testing"))]
use trace::is_traced;

#[cfg(not(any(test, feature = "testing")))]
fn is_traced() -> bool {
    false
}

/// What a thread does on the disk: since when, and how long the slowest operation took. A thread that waits for a slow disk does not hang.
#[derive(Debug, Clone, Default)]
pub struct DiskWatch(Arc<Mutex<Watched>>);

#[derive(Debug, Default)]
struct Watched {
    began: Option<Instant>,
    ended: Option<Instant>,
    slowest: Duration,
}

thread_local!(static WATCH: RefCell<Option<DiskWatch>> = const { RefCell::new(None) });

impl DiskWatch {
    /// Watches the calling thread from now on.
    pub fn of_this_thread(&self) {
        WATCH.set(Some(self.clone()));
    }

    fn with<T>(&self, work: impl FnOnce(&mut Watched) -> T) -> T {
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How long the operation in progress has taken so far. `None` outside of one.
    pub fn takes(&self) -> Option<Duration> {
        self.with(|watched| watched.began).map(|began| began.elapsed())
    }

    /// How long ago the newest operation ended. `None` before the first.
    pub fn idle(&self) -> Option<Duration> {
        self.with(|watched| watched.ended).map(|ended| ended.elapsed())
    }

    /// The time of the slowest write since the last call.
    pub fn take_slowest(&self) -> Duration {
        self.with(|watched| std::mem::take(&mut watched.slowest))
    }

    /// An operation begins.
    pub fn begin(&self) {
        self.with(|watched| watched.began = Some(Instant::now()));
    }

    /// The operation has ended after `took`.
    pub fn end(&self, took: Duration) {
        self.with(|watched| {
            (watched.began, watched.ended) = (None, Some(Instant::now()));
            watched.slowest = watched.slowest.max(took);
        });
    }
}

/// The operations of all threads.
struct UnderWay {
    began: Vec<Instant>,
    ended: Option<Instant>,
}

static UNDER_WAY: Mutex<UnderWay> = Mutex::new(UnderWay { began: Vec::new(), ended: None });

/// An operation of any thread, until it is dropped.
struct Operation(Instant);

impl Operation {
    fn begin() -> Self {
        let began = Instant::now();
        UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner).began.push(began);
        Self(began)
    }
}

impl Drop for Operation {
    fn drop(&mut self) {
        let mut all = UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = all.began.iter().position(|began| *began == self.0) {
            all.began.swap_remove(at);
        }
        all.ended = Some(Instant::now());
    }
}

/// How long the longest operation in progress of any thread has taken so far. Zero if there is none, but one ended within `recent`. `None`
/// if no thread works on the disk.
pub fn busy_for(recent: Duration) -> Option<Duration> {
    let all = UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner);
    let longest = all.began.iter().min().map(Instant::elapsed);
    longest.or_else(|| all.ended.filter(|ended| ended.elapsed() < recent).map(|_| Duration::ZERO))
}

/// Does an operation under the watch of this thread, if it has one. An operation within another one belongs to it. `is_write`: its time
/// tells how fast the disk is.
pub(super) fn watched<T>(is_write: bool, work: impl FnOnce() -> T) -> T {
    let _operation = Operation::begin();
    let watch = WATCH.with_borrow(Option::clone).filter(|watch| watch.takes().is_none());
    let Some(watch) = watch else { return work() };
    watch.begin();
    let began = Instant::now();
    let done = work();
    watch.end(if is_write { began.elapsed() } else { Duration::ZERO });
    done
}

/// Creates a file with these bytes. It is not synced yet.
pub(super) fn create(path: &Path, bytes: &[u8]) -> io::Result<File> {
    step!(Create, path, bytes);
    watched(true, || {
        let mut file = carved_files::open_own(path, OpenOptions::new().write(true).create(true).truncate(true))?;
        file.write_all(bytes)?;
        Ok(file)
    })
}

pub(super) fn append(file: &mut File, path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A full disk may accept a part of a line. In tests the first half is a separate operation.
    let (front, back) = bytes.split_at(if is_traced() { bytes.len() / 2 } else { 0 });
    for part in [front, back].into_iter().filter(|part| !part.is_empty()) {
        step!(Append, path, part);
        watched(true, || file.write_all(part))?;
    }
    Ok(())
}

/// Truncates a file to its first `bytes`.
pub(super) fn cut(file: &File, path: &Path, bytes: u64) -> io::Result<()> {
    step!(Cut, path, bytes);
    watched(true, || file.set_len(bytes))
}

pub(super) fn sync(file: &File, path: &Path) -> io::Result<()> {
    step!(Sync, path);
    watched(true, || file.sync_data())
}

pub(super) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    step!(Rename, from, to);
    watched(true, || fs::rename(from, to))
}

pub(super) fn remove(path: &Path) -> io::Result<()> {
    step!(Remove, path);
    watched(true, || fs::remove_file(path))
}

pub(super) fn create_folder(folder: &Path) -> io::Result<()> {
    step!(CreateFolder, folder);
    watched(true, || fs::create_dir(folder))
}

/// Makes the names in a folder durable.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    step!(SyncFolder, folder);
    watched(true, || File::open(folder)?.sync_all())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_watch_tells_what_its_thread_does_and_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let watch = DiskWatch::default();
        let other = watch.clone();
        std::thread::spawn(move || {
            watch.of_this_thread();
            assert!(watch.takes().is_none() && watch.idle().is_none());
            let seen = watch.clone();
            let both = watched(true, || {
                let before = seen.takes();
                // An operation within another one does not end it.
                watched(false, || ());
                (before, seen.takes())
            });
            assert!(both.0.is_some() && both.1 >= both.0);
            assert!(watch.takes().is_none() && watch.idle().is_some());
            assert!(watch.take_slowest() > Duration::ZERO && watch.take_slowest() == Duration::ZERO);
            watched(false, std::thread::yield_now);
            assert_eq!(watch.take_slowest(), Duration::ZERO, "reading tells nothing about the disk's writes");
        })
        .join()
        .unwrap();
        create(&dir.path().join("file"), b"x").unwrap();
        assert_eq!(other.take_slowest(), Duration::ZERO);
    }

    #[test]
    fn the_disk_is_busy_while_any_thread_works_on_it() {
        let (begin, begun) = std::sync::mpsc::channel();
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let at_work = std::thread::spawn(move || {
            watched(true, || {
                begin.send(()).unwrap();
                ended.recv().unwrap();
            });
        });
        begun.recv().unwrap();
        let first = busy_for(Duration::ZERO).unwrap();
        assert!(busy_for(Duration::ZERO).unwrap() >= first, "another thread's operation");
        end.send(()).unwrap();
        at_work.join().unwrap();
        assert!(busy_for(Duration::MAX).is_some(), "it has just ended");
    }
}
