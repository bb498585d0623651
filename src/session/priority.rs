//! Threads that give way to the instrument.

/// Lowers the priority of the calling thread, and of threads that it starts later. `nice` is 0 (the default) to 19 (gives way to all others).
/// The thread keeps its priority where the system refuses the change.
pub fn lower_this_thread(nice: i32) {
    // On Linux this is the priority of a thread, not of the process.
    if let Err(error) = rustix::process::setpriority_process(None, nice) {
        tracing::warn!(%error, nice, "a thread keeps the priority of a run");
    }
}
