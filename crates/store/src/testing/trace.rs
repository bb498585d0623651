//! Traces the file operations of this thread, and refuses them as a full disk does.

use std::cell::RefCell;
use std::io;
use std::path::PathBuf;

#[derive(Debug, Clone)]
pub enum Op {
    Create(PathBuf, Vec<u8>),
    Append(PathBuf, Vec<u8>),
    Cut(PathBuf, u64),
    Sync(PathBuf),
    Rename(PathBuf, PathBuf),
    Remove(PathBuf),
    CreateFolder(PathBuf),
    SyncFolder(PathBuf),
}

#[derive(Default)]
pub struct Trace {
    pub ops: Vec<Op>,
    /// Number of the operation that fails.
    pub fails: Option<usize>,
    /// All later operations fail too, until there is room.
    pub stays_full: bool,
    /// The process is dead: operations that free space have no effect either.
    pub is_dead: bool,
    /// Number of refused operations.
    pub refused: usize,
    /// Called before each operation.
    pub witness: Option<Box<dyn Fn()>>,
}

thread_local!(pub static TRACE: RefCell<Option<Trace>> = const { RefCell::new(None) });

pub fn step(op: Op) -> io::Result<()> {
    TRACE.with_borrow_mut(|trace| {
        let Some(trace) = trace else { return Ok(()) };
        if let Some(witness) = &trace.witness {
            witness();
        }
        // Operations that free space succeed on a full disk.
        let frees = trace.stays_full && !trace.is_dead && matches!(op, Op::Cut(..) | Op::Remove(..));
        if trace.fails.is_some_and(|at| trace.ops.len() >= at) && !frees {
            trace.fails = trace.fails.filter(|_| trace.stays_full);
            trace.refused += 1;
            return Err(io::ErrorKind::StorageFull.into());
        }
        trace.ops.push(op);
        Ok(())
    })
}

/// Whether the operations of this thread are recorded.
pub fn is_traced() -> bool {
    TRACE.with_borrow(Option::is_some)
}

pub fn begin(fails: Option<usize>) {
    TRACE.set(Some(Trace { fails, ..Trace::default() }));
}

/// Fills the disk at the operation of this number, until [`make_room`]. `witness` is called before each operation.
pub fn fill(at: usize, witness: impl Fn() + 'static) {
    TRACE.set(Some(Trace { fails: Some(at), stays_full: true, witness: Some(Box::new(witness)), ..Trace::default() }));
}

/// The process dies at the operation of this number: it has no effect, nor has any later one until [`make_room`].
pub fn die(at: usize) {
    TRACE.set(Some(Trace { fails: Some(at), stays_full: true, is_dead: true, ..Trace::default() }));
}

pub fn was_full() -> bool {
    TRACE.with_borrow(|trace| trace.as_ref().is_some_and(|t| t.refused > 0))
}

pub fn make_room() {
    TRACE.with_borrow_mut(|trace| trace.iter_mut().for_each(|trace| trace.fails = None));
}

pub fn end() -> Vec<Op> {
    TRACE.take().map_or_else(Vec::new, |trace| trace.ops)
}

pub fn count() -> usize {
    TRACE.with_borrow(|trace| trace.as_ref().map_or(0, |t| t.ops.len()))
}
