//! The signals that end a command: SIGTERM, SIGINT and SIGHUP.

use anyhow::Context;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Exit code of a command that a signal ended: 128 + 2, as a shell reports Ctrl-C.
pub const INTERRUPTED: i32 = 130;

/// SIGHUP is the last.
const ENDING: [(SignalKind, &str); 3] =
    [(SignalKind::terminate(), "SIGTERM"), (SignalKind::interrupt(), "SIGINT"), (SignalKind::hangup(), "SIGHUP")];

/// The signals, caught from the moment of [`Signals::listen`].
pub struct Signals(Vec<(Signal, &'static str)>);

impl Signals {
    /// Catches the signals. It must be called within a tokio runtime.
    ///
    /// # Errors
    /// A signal that cannot be caught.
    pub fn listen() -> anyhow::Result<Self> {
        Self::of(&ENDING)
    }

    fn of(kinds: &[(SignalKind, &'static str)]) -> anyhow::Result<Self> {
        let listen = |&(kind, name)| anyhow::Ok((signal(kind).with_context(|| format!("cannot listen to {name}"))?, name));
        kinds.iter().map(listen).collect::<Result<_, _>>().map(Self)
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
        Self::act_at(&ENDING, move |_| act())
    }

    /// As [`Signals::at_each`], with the name of the signal, and without SIGHUP: a long computation under `nohup` ignores it.
    ///
    /// # Errors
    /// A signal that cannot be caught, and a thread that cannot be started.
    pub fn at_each_but_hangup(act: impl FnMut(&'static str) + Send + 'static) -> anyhow::Result<()> {
        Self::act_at(&ENDING[..2], act)
    }

    fn act_at(kinds: &[(SignalKind, &'static str)], mut act: impl FnMut(&'static str) + Send + 'static) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the runtime")?;
        let mut signals = runtime.block_on(async { Self::of(kinds) })?;
        std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || {
                runtime.block_on(async {
                    loop {
                        act(signals.next().await);
                    }
                });
            })
            .context("cannot start the thread for signals")?;
        Ok(())
    }
}
