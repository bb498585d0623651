//! What is kept of wells whose recordings were not closed: the daemon ended while it wrote them, or their numbers were given up. Their views
//! are counted, and their files get checksums.

use carved_store::{RecordingReader, Store, StoreError};
use std::path::Path;
use std::sync::mpsc::channel;
use std::time::Duration;

/// Maximum time that the driver waits for checksums. If the disk hangs, they are written later or never, and the watchdog must not take the
/// driver for dead.
const WAIT: Duration = Duration::from_secs(3);

/// Computes the checksums on a separate thread, and waits for it up to `WAIT`.
fn within(folder: &Path, seal: fn(&Path) -> Result<(), StoreError>) {
    let (tell, done) = channel();
    let of = folder.to_owned();
    let spawned = std::thread::Builder::new().name("sums".into()).spawn(move || {
        if let Err(error) = seal(&of) {
            tracing::error!(%error, "what is kept of a well has no SHA256SUMS");
        }
        // The receiver is dropped if the driver has stopped waiting.
        let _nobody = tell.send(());
    });
    match spawned {
        Err(error) => tracing::error!(%error, "no thread for the sums of what is kept"),
        Ok(_) => {
            if done.recv_timeout(WAIT).is_err() {
                tracing::warn!(folder = %folder.display(), "the sums of what is kept take long; the disk may hang");
            }
        }
    }
}

/// Seals a finished well of the current run.
pub(super) fn seal_well(store: &Store, run: &str, well: &str) {
    within(&store.run_folder(run).join(well), carved_store::seal);
}

/// Seals every well of a run that ends.
pub(super) fn seal_run(store: &Store, run: &str) {
    within(&store.run_folder(run), carved_store::seal_run);
}

/// Number of views that are stored of a well of the current run, without retakes and the closure view. 0 if there is no recording that can
/// be read.
pub(super) fn views_stored(store: &Store, run: &str, well: &str) -> u32 {
    RecordingReader::open(&store.run_folder(run).join(well)).map_or(0, |reader| reader.recording().ledger.carved().count() as u32)
}
