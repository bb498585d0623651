//! The accept loop: one slot per connection, a deadline for every request head, and no task left at the end.
//!
//! ```text
//! accept ─> slot free? ─> task: hyper http1 ─┬─ client closes, or does not complete its head in time
//!             ^  └─ no: wanted ─────────────>├─ finish the current request
//!             │                              ├─ shutdown: finish the current request
//!             └──────── slot back ───────────┘        serve new ones too, until none is left; after `drain_ms` drop the rest
//! ```
//! hyper's builder is used directly because `axum::serve` sets no deadline for a request head. While a client waits for a slot, connections
//! that have had an answer end with their current request, and those between two requests end at once. Answers that stay open cannot be
//! ended in this way: [`super::stay`] limits their number.

use super::linger::Lingering;
use super::pace::Peer;
use super::{closed, router};
use crate::config::{Guard, HttpSettings, HttpSettingsError};
use crate::session::SessionHandle;
use crate::session::replays::Replays;
use axum::Router;
use carved_store::StoreReader;
use hyper::Request;
use hyper::body::{Body, Incoming};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use nix::sys::socket::{setsockopt, sockopt};
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::{JoinError, JoinSet};
use tokio::time::Instant;

/// Size limit of a request head, bytes.
const HEAD_BYTES: usize = 16 * 1024;
/// Pause after a failed accept (no free descriptors), in which other connections may end.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// How long a connection that is open while the server ends may be without its first request.
const FIRST_REQUEST: Duration = Duration::from_millis(200);

/// Why the server does not start, or had to end.
#[derive(Debug, thiserror::Error)]
pub enum HttpError {
    #[error(transparent)]
    Settings(#[from] HttpSettingsError),
    #[error("http: cannot listen on {listen}: {why}. Another program may hold the port; choose another with --listen ADDRESS:PORT")]
    Bind { listen: SocketAddr, why: io::Error },
    #[error("http: the listening socket failed: {0}")]
    Socket(#[from] io::Error),
}

/// Opens the port.
///
/// # Errors
/// The settings do not allow it, or the port cannot be opened.
pub fn bind(settings: &HttpSettings) -> Result<std::net::TcpListener, HttpError> {
    settings.guard(settings.listen)?;
    std::net::TcpListener::bind(settings.listen).map_err(|why| HttpError::Bind { listen: settings.listen, why })
}

/// Serves until `shutdown` resolves, then ends open connections within the settings' `drain_ms`. Meanwhile new ones are served too, so
/// that an emergency stop is answered as long as possible. Every task is joined.
///
/// # Errors
/// Other machines can reach the listener without a token, or the settings are invalid.
pub async fn serve(
    listener: std::net::TcpListener,
    session: SessionHandle,
    reader: StoreReader,
    settings: HttpSettings,
    shutdown: impl Future<Output = ()>,
) -> Result<(), HttpError> {
    let replays = Replays::new(session.clone());
    let (of_routes, until_ending) = (replays.clone(), session.clone());
    let routes = |guard, closing| router(session, of_routes, reader, &settings, guard, closing);
    // Replays end with the session, or at the latest with the server.
    let end = async {
        let mut shutdown = pin!(shutdown);
        tokio::select! {
            () = shutdown.as_mut() => replays.end().await,
            () = until_ending.until_ending() => {
                tokio::join!(shutdown, replays.end());
            }
        }
    };
    let served = serve_routes(listener, &settings, routes, end).await;
    replays.end().await;
    served
}

/// As [`serve`], for other routes. `routes` gets the access rules, and what becomes true when the server must end.
///
/// # Errors
/// As [`serve`].
pub async fn serve_routes(
    listener: std::net::TcpListener,
    settings: &HttpSettings,
    routes: impl FnOnce(Guard, watch::Receiver<bool>) -> Router,
    shutdown: impl Future<Output = ()>,
) -> Result<(), HttpError> {
    let guard = settings.guard(listener.local_addr()?)?;
    listener.set_nonblocking(true)?;
    let listener = TcpListener::from_std(listener)?;
    let (close, closing) = watch::channel(false);
    let router = routes(guard, closing.clone());
    let slots = Arc::new(Semaphore::new(settings.max_connections));
    let (want, wanted) = watch::channel(false);
    // Only a change wakes the tasks of all connections.
    let waits = |is_waiting: bool| want.send_if_modified(|waits| std::mem::replace(waits, is_waiting) != is_waiting);
    let mut next = None;
    let mut connections = JoinSet::new();
    let mut shutdown = pin!(shutdown);
    let mut deadline = pin!(tokio::time::sleep(Duration::MAX));
    loop {
        let is_closing = *close.borrow();
        tokio::select! {
            biased;
            () = &mut shutdown, if !is_closing => {
                close.send_replace(true);
                deadline.as_mut().reset(Instant::now() + Duration::from_millis(settings.drain_ms));
            }
            () = &mut deadline, if is_closing => break,
            Some(ended) = connections.join_next() => note(ended),
            Ok(slot) = slots.clone().acquire_owned(), if next.is_some() => {
                waits(false);
                if let Some((stream, peer)) = next.take() {
                    let ends = Ends { closing: closing.clone(), wanted: wanted.clone() };
                    connections.spawn(connection(stream, peer, slot, builder(settings), router.clone(), ends));
                }
            }
            accepted = next_client(&listener, settings), if next.is_none() => match accepted {
                Ok(client) => {
                    next = Some(client);
                    waits(slots.available_permits() == 0);
                }
                Err(why) => {
                    tracing::warn!(%why, "could not accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            },
            () = std::future::ready(()), if is_closing && next.is_none() && connections.is_empty() => break,
        }
    }
    drop(listener);
    if !connections.is_empty() {
        tracing::warn!(open = connections.len(), "cutting connections that did not end in time");
        connections.shutdown().await;
    }
    Ok(())
}

async fn next_client(listener: &TcpListener, settings: &HttpSettings) -> io::Result<(TcpStream, Peer)> {
    let (stream, peer) = listener.accept().await?;
    // Answers are small, and clients wait for them.
    stream.set_nodelay(true)?;
    // A client that does not read its answer would keep its slot for ever: hyper has no deadline for writing.
    let unread_ms = u32::try_from(settings.head_timeout_ms).unwrap_or(u32::MAX);
    setsockopt(&stream, sockopt::TcpUserTimeout, &unread_ms)?;
    Ok((stream, Peer(peer.ip().to_canonical())))
}

fn builder(settings: &HttpSettings) -> http1::Builder {
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(Duration::from_millis(settings.head_timeout_ms)).max_buf_size(HEAD_BYTES);
    builder
}

/// Why a connection ends with its current request.
struct Ends {
    /// The server ends.
    closing: watch::Receiver<bool>,
    /// A client waits for a slot.
    wanted: watch::Receiver<bool>,
}

impl Ends {
    /// Resolves when the connection must end. Its first request is always answered, however many clients wait. If the server ends, the
    /// first request must come soon.
    async fn asked(mut self, answered: &Notify) {
        tokio::select! {
            () = answered.notified() => {}
            () = async {
                closed(self.closing.clone()).await;
                tokio::time::sleep(FIRST_REQUEST).await;
            } => return,
        }
        tokio::select! {
            () = closed(self.closing) => {}
            // An error means that the server itself was dropped.
            _ = self.wanted.wait_for(|wanted| *wanted) => {}
        }
    }
}

async fn connection(stream: TcpStream, peer: Peer, slot: OwnedSemaphorePermit, builder: http1::Builder, router: Router, ends: Ends) {
    let inner = TowerToHyperService::new(router);
    let answered = Arc::new(Notify::new());
    let answers = answered.clone();
    let sends = Arc::new(AtomicBool::new(false));
    let stream = Lingering::new(stream, sends.clone());
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(peer);
        let has_body = !request.body().is_end_stream();
        let (answer, answers, sends) = (inner.call(request), answers.clone(), sends.clone());
        async move {
            let answer = answer.await;
            // The body of a request that is refused may still be coming.
            sends.store(has_body && answer.as_ref().is_ok_and(|answer| !answer.status().is_success()), Ordering::Relaxed);
            answers.notify_one();
            answer
        }
    });
    let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service));
    let ended = tokio::select! {
        // First, so that a request that has arrived is read before the connection ends.
        biased;
        ended = connection.as_mut() => ended,
        () = ends.asked(&answered) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(why) = ended {
        tracing::debug!(%why, "a connection broke off");
    }
    drop(slot);
}

fn note(ended: Result<(), JoinError>) {
    if let Err(why) = ended {
        tracing::error!(%why, "a connection's task ended badly");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_taken_is_said_with_the_way_out() {
        let held = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let settings = HttpSettings { listen: held.local_addr().unwrap(), ..HttpSettings::default() };
        let said = bind(&settings).unwrap_err().to_string();
        assert!(said.contains(&settings.listen.to_string()) && said.contains("--listen"), "{said}");
    }
}
