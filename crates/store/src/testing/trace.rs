//! The file operations that this thread does: counted, watched, and refused as by a full disk.

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
    /// The operation of this number is not done.
    pub fails: Option<usize>,
    /// Nor is any that follows, until there is room.
    pub stays_full: bool,
    /// How many were not done.
    pub refused: usize,
    /// Looks on before each operation.
    pub witness: Option<Box<dyn Fn()>>,
}

thread_local!(pub static TRACE: RefCell<Option<Trace>> = const { RefCell::new(None) });

pub fn step(op: Op) -> io::Result<()> {
    TRACE.with_borrow_mut(|trace| {
        let Some(trace) = trace else { return Ok(()) };
        if let Some(witness) = &trace.witness {
            witness();
        }
        // Room is made on a full disk as well.
        let frees = trace.stays_full && matches!(op, Op::Cut(..) | Op::Remove(..));
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

/// From the operation of this number on the disk is full, until [`make_room`]; `witness` looks on before each.
pub fn fill(at: usize, witness: impl Fn() + 'static) {
    TRACE.set(Some(Trace { fails: Some(at), stays_full: true, witness: Some(Box::new(witness)), ..Trace::default() }));
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
