//! The daemon of `serve` and `simulate`, from opening the store to joining all threads.

use super::signals::Signals;
use super::systemd;
use crate::api::Status;
use crate::config::{Config, NotifySettings};
use crate::notify::Notices;
use crate::session::{self, Departure, Driver, Heartbeat, Instrument, SessionHandle, SlowDisk};
use anyhow::Context;
use carved_devices::sampler::LoaderInterlock;
use carved_records::Mode;
use carved_store::{Claim, Store};
use futures::FutureExt;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{oneshot, watch};
use tokio::task::JoinHandle;

/// Longest time until requests are answered, also if the state of the previous process is not restored by then.
const RESTORED: Duration = Duration::from_secs(2);
/// How long a second signal waits for a driver that has not yet written what becomes of the run.
const JOURNALLED: Duration = Duration::from_millis(500);
/// Time for the notices that wait when the daemon ends. The whole daemon must end within 5 s.
const LAST_NOTICES: Duration = Duration::from_secs(1);

/// Time for requests that read the disk when the daemon ends. A listing of a large folder, or a disk that hangs, does not hold it up.
const LAST_READS: Duration = Duration::from_millis(200);

/// A daemon before its start: it owns its data folder, its port is open and its devices answer, but no task runs yet.
pub struct Daemon {
    pub claim: Claim,
    pub config: Arc<Config>,
    pub mode: Mode,
    pub instrument: Instrument,
    pub interlock: LoaderInterlock,
    pub listener: TcpListener,
    /// Printed on standard output, followed by the address, once the daemon serves.
    pub greeting: String,
}

impl Daemon {
    /// Runs until SIGTERM, SIGINT or SIGHUP, or until SIGUSR1, which leaves a run in progress for the next start. `beside` makes a client that runs beside the daemon and may end earlier.
    pub fn run<F>(self, beside: impl FnOnce(SessionHandle) -> F) -> anyhow::Result<Departure>
    where
        F: Future<Output = anyhow::Result<()>> + Send + 'static,
    {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("carved").build().context("cannot start the runtime")?;
        let Self { claim, config, mode, instrument, interlock, listener, greeting } = self;
        let listen = listener.local_addr().context("the address that is served")?;
        let identity = config.identity(claim.instrument_uuid()?);
        let (store, journal, events) = Store::open(claim)?;
        let reader = store.reader().with_calibrations(&config.calibrations());
        let receiver = config.notify.as_ref().map(NotifySettings::receiver).transpose()?;
        let notices = receiver.map(Notices::start).transpose()?;
        let shown = notices.as_ref().map(Notices::status);
        let first = Status { instrument: identity.clone(), notices: shown, ..Driver::first_status(mode, random_id()?) };
        let (handle, mailbox, publisher) = session::channel(first, events);
        let publisher = publisher.noticing(notices.clone());
        let handle = handle.noticing(notices.clone()).offering(config.methods.clone());
        let heartbeat = Heartbeat::default();
        let slow_disk = SlowDisk::new(publisher.shared(), publisher.halt().clone(), heartbeat.clone());
        let driver = Driver {
            config: config.clone(),
            mode,
            store,
            journal,
            publisher,
            instrument,
            identity,
            interlock,
            notices: notices.clone(),
            heartbeat: heartbeat.clone(),
        };
        // Before anything moves: a signal that is not caught ends the process and leaves the motors running.
        let (mut signals, mut restart) = {
            let _context = runtime.enter();
            (Signals::listen()?, signal(SignalKind::user_defined1()).context("cannot listen to SIGUSR1")?)
        };
        let (stop_in, stop) = watch::channel(None);
        let (rest, at_rest) = oneshot::channel();
        let (close, closed) = oneshot::channel::<()>();
        // The driver syncs to disk. It has a thread of its own, so that no request waits for the disk.
        let driving = {
            let runtime = runtime.handle().clone();
            // An error means that the server, or the driver, has ended already.
            let unreachable = move || {
                let _no_server = rest.send(());
                closed.map(drop)
            };
            std::thread::Builder::new()
                .name("driver".into())
                .spawn(move || runtime.block_on(driver.run(mailbox, stopped(stop), unreachable)))
                .context("cannot start the driver")?
        };
        let served = runtime.block_on(async {
            let informs = tokio::spawn(tell_systemd(handle.clone(), heartbeat.clone()));
            tokio::spawn(slow_disk.watch());
            let session = handle.clone();
            let mut serving = tokio::spawn(async move {
                // Clients wait in the backlog of the listener. On a disk that hangs they get a status that says `starting`.
                let _late = tokio::time::timeout(RESTORED, session.until_restored()).await;
                // The port stays open until nothing is left to do: an emergency stop is answered as long as this process lives.
                crate::http::serve(listener, session, reader, config.http.clone(), async {
                    let _no_driver = at_rest.await;
                    close_notices(notices).await;
                })
                .await
            });
            announce!("{greeting} http://{listen}  status: http://{listen}/v1/status");
            let last = handle.clone();
            let beside = beside(handle);
            let client = tokio::spawn(async move {
                if let Err(error) = beside.await {
                    tracing::error!("{error:#}");
                }
            });
            let mut served = None;
            let mut departure = Departure::EndsRun;
            tokio::select! {
                biased;
                name = signals.next() => tracing::info!("{name}: stopping"),
                _ = restart.recv() => {
                    tracing::info!("SIGUSR1: stopping for a restart; a run in progress continues after it");
                    departure = Departure::LeavesRun;
                }
                () = ended(&driving) => tracing::error!("the driver ended: stopping"),
                result = &mut serving => served = Some(result),
            }
            // All receivers are gone only if the server has failed, and its own result reports that.
            let _nobody = stop_in.send(Some(departure));
            // The driver may be within a write to a slow disk. The motors do not wait for it.
            let at_once = last.clone();
            tokio::task::spawn_blocking(move || at_once.stop_motors());
            tokio::spawn(end_at_the_next(signals, last));
            end_with_systemd(&informs, heartbeat);
            client.abort();
            let served = match served {
                Some(early) => early,
                None => serving.await,
            };
            drop(close);
            served.context("the server's task")?.context("the server")?;
            anyhow::Ok(departure)
        });
        let drove = driving.join();
        runtime.shutdown_timeout(LAST_READS);
        let drove = drove.map_err(|_| anyhow::anyhow!("the driver panicked; the motors were stopped as it unwound"))?;
        drove?;
        served
    }
}

/// A second signal ends the process without waiting for the driver.
async fn end_at_the_next(mut signals: Signals, session: SessionHandle) {
    let name = signals.next().await;
    session.stop_motors();
    let _late = tokio::time::timeout(JOURNALLED, session.until_ending()).await;
    tracing::warn!("{name}, a second signal: ending at once");
    std::process::exit(1);
}

/// Reports readiness, then the `doing` of every revision, and pings the watchdog while the driver's heartbeat is recent.
async fn tell_systemd(session: SessionHandle, heartbeat: Heartbeat) {
    let sentences = async {
        // Revision 1 is only a placeholder. The driver publishes the first real status after it.
        let mut status = session.status_after(1).await;
        systemd::ready(&status.doing);
        loop {
            let newer = session.status_after(status.revision).await;
            if newer.revision == status.revision {
                // The driver has ended. No revision follows.
                return;
            }
            status = newer;
            systemd::status(&status.doing);
        }
    };
    let alive = || {
        if let Some(takes) = heartbeat.waits_for_disk() {
            tracing::warn!(takes_s = takes.as_secs(), "the driver waits for the disk");
        }
        heartbeat.is_alive()
    };
    tokio::join!(sentences, systemd::watchdog(alive));
}

/// Lets systemd wait for an end on a slow disk, until the driver has closed its files. The watchdog still runs where the daemon ends by
/// itself, as at SIGUSR1.
fn end_with_systemd(informs: &JoinHandle<()>, heartbeat: Heartbeat) {
    systemd::stopping();
    informs.abort();
    tokio::spawn(async move { tokio::join!(systemd::extend_end(), systemd::watchdog(|| heartbeat.is_alive())) });
}

/// Sends the notices that wait.
async fn close_notices(notices: Option<Notices>) {
    if let Some(notices) = notices {
        let closed = tokio::task::spawn_blocking(move || notices.close(LAST_NOTICES)).await;
        if closed.is_err() {
            tracing::error!("the notices that wait were not sent");
        }
    }
}

async fn stopped(mut stop: watch::Receiver<Option<Departure>>) -> Departure {
    // An error means that the sender was dropped, which is also a stop.
    stop.wait_for(Option::is_some).await.ok().and_then(|departure| *departure).unwrap_or(Departure::EndsRun)
}

/// Resolves once the driver has ended by itself.
async fn ended(driving: &std::thread::JoinHandle<Result<(), session::DriverError>>) {
    let mut look = tokio::time::interval(std::time::Duration::from_millis(200));
    while !driving.is_finished() {
        look.tick().await;
    }
}

/// An id that differs between any two calls, as between two boots of the daemon.
pub fn random_id() -> anyhow::Result<String> {
    let id =
        std::fs::read_to_string("/proc/sys/kernel/random/uuid").context("cannot read a random id from /proc/sys/kernel/random/uuid")?;
    Ok(id.trim().to_owned())
}
