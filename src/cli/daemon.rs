//! What `serve` and `simulate` share: the daemon around a session, from opening the store to joining everything.

use super::notify;
use crate::config::Config;
use crate::device::sampler::LoaderGate;
use crate::session::{self, Driver, Heart, Instrument, Mode, SessionHandle};
use crate::store::Store;
use anyhow::Context;
use std::net::TcpListener;
use std::sync::Arc;
use tokio::sync::watch;

/// A daemon under construction: its door is open, its devices answer, nothing runs yet.
pub struct Daemon {
    pub config: Arc<Config>,
    pub mode: Mode,
    pub instrument: Instrument,
    pub gate: LoaderGate,
    pub listener: TcpListener,
}

/// Takes the address that the page and the API are served on.
pub fn bind(listen: std::net::SocketAddr) -> anyhow::Result<TcpListener> {
    TcpListener::bind(listen)
        .with_context(|| format!("cannot serve on {listen}: is another carved running? --listen chooses another address"))
}

impl Daemon {
    /// Runs until SIGTERM, SIGINT or SIGHUP. `beside` is a client that lives as long as it wants.
    pub fn run<F>(self, beside: impl FnOnce(SessionHandle) -> F) -> anyhow::Result<()>
    where
        F: Future<Output = anyhow::Result<()>> + Send + 'static,
    {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("carved").build().context("cannot start the runtime")?;
        let Self { config, mode, instrument, gate, listener } = self;
        let (store, journal, events) = Store::open(&config.store.data_dir)?;
        let (handle, mailbox, publisher) = session::channel(Driver::first_status(mode, boot_id()?), events);
        let heart = Heart::default();
        let driver = Driver { config: config.clone(), mode, store, journal, publisher, instrument, gate, heart: heart.clone() };
        let (stop_in, stop) = watch::channel(false);
        // The driver syncs to disk: it has a thread of its own, so that no request waits for a disk.
        let driving = {
            let (runtime, stop) = (runtime.handle().clone(), stop.clone());
            std::thread::Builder::new()
                .name("driver".into())
                .spawn(move || runtime.block_on(driver.run(mailbox, stopped(stop))))
                .context("cannot start the driver")?
        };
        let served = runtime.block_on(async {
            let told = tokio::spawn(tell_systemd(handle.clone(), heart.clone()));
            let serving = tokio::spawn(crate::http::serve(listener, handle.clone(), config.http.clone(), stopped(stop)));
            let client = tokio::spawn(beside(handle));
            let ended = wait_for_end(&driving).await;
            tracing::info!("{ended}: stopping");
            notify::stopping();
            told.abort();
            // Everyone who listens has gone only if the server has failed, which its own result says.
            let _nobody = stop_in.send(true);
            client.abort();
            serving.await.context("the server's task")?.context("the server")
        });
        let drove = driving.join().map_err(|_| anyhow::anyhow!("the driver panicked; the motors were stopped as it unwound"))?;
        drove?;
        served
    }
}

/// Ready, then the sentence of every revision, and the watchdog's ping while the driver's heart beats.
async fn tell_systemd(session: SessionHandle, heart: Heart) {
    let sentences = async {
        let mut status = session.status();
        notify::ready(&status.doing);
        loop {
            status = session.status_after(status.revision).await;
            notify::status(&status.doing);
        }
    };
    tokio::join!(sentences, notify::watchdog(|| heart.beats()));
}

async fn stopped(mut stop: watch::Receiver<bool>) {
    // An error means that the sender is gone, which is a stop as well.
    let _gone = stop.wait_for(|s| *s).await;
}

/// A signal, or the end of the driver.
async fn wait_for_end(driving: &std::thread::JoinHandle<Result<(), session::DriverError>>) -> String {
    use tokio::signal::unix::{SignalKind, signal};
    let mut signals = Vec::new();
    for (kind, name) in [(SignalKind::terminate(), "SIGTERM"), (SignalKind::interrupt(), "SIGINT"), (SignalKind::hangup(), "SIGHUP")] {
        match signal(kind) {
            Ok(s) => signals.push((s, name)),
            Err(error) => tracing::error!(%error, name, "cannot listen to this signal"),
        }
    }
    let any = futures::future::select_all(signals.iter_mut().map(|(s, name)| {
        let name = *name;
        Box::pin(async move {
            s.recv().await;
            name
        })
    }));
    let mut tick = tokio::time::interval(std::time::Duration::from_millis(200));
    tokio::pin!(any);
    loop {
        tokio::select! {
            (name, _, _) = &mut any => return name.to_owned(),
            _ = tick.tick() => if driving.is_finished() { return "the driver ended".into() },
        }
    }
}

/// Tells one boot of the daemon from another.
fn boot_id() -> anyhow::Result<String> {
    let id =
        std::fs::read_to_string("/proc/sys/kernel/random/uuid").context("cannot read a random id from /proc/sys/kernel/random/uuid")?;
    Ok(id.trim().to_owned())
}
