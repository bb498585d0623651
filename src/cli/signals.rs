//! The signals that end a command: SIGTERM, SIGINT and SIGHUP.

use anyhow::Context;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Exit code of a command that a signal ended: 128 + 2, as a shell reports Ctrl-C.
pub const INTERRUPTED: i32 = 130;

/// The signals, caught from the moment of [`Signals::listen`].
pub struct Signals(Vec<(Signal, &'static str)>);

impl Signals {
    /// Catches the signals. It must be called within a tokio runtime.
    ///
    /// # Errors
    /// A signal that cannot be caught.
    pub fn listen() -> anyhow::Result<Self> {
        let kinds = [(SignalKind::terminate(), "SIGTERM"), (SignalKind::interrupt(), "SIGINT"), (SignalKind::hangup(), "SIGHUP")];
        let listen = |(kind, name)| anyhow::Ok((signal(kind).with_context(|| format!("cannot listen to {name}"))?, name));
        kinds.into_iter().map(listen).collect::<Result<_, _>>().map(Self)
    }

    /// Waits for the next signal and returns its name.
    pub async fn next(&mut self) -> &'static str {
        let any = self.0.iter_mut().map(|(signal, name)| {
            Box::pin(async move {
                signal.recv().await;
                *name
            })
        });
        futures::future::select_all(any).await.0
    }

    /// Calls `act` at every signal, in a thread of its own, until the program ends.
    ///
    /// # Errors
    /// A signal that cannot be caught, and a thread that cannot be started.
    pub fn at_each(mut act: impl FnMut() + Send + 'static) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the runtime")?;
        let mut signals = runtime.block_on(async { Self::listen() })?;
        std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || {
                runtime.block_on(async {
                    loop {
                        signals.next().await;
                        act();
                    }
                });
            })
            .context("cannot start the thread for signals")?;
        Ok(())
    }
}
