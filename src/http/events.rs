//! `GET /v1/events`: the journal as server-sent events.
//!
//! ```text
//! Last-Event-ID: 41 ──> 42, 43 (in memory) ──> 44 ... (live)
//! older ──> read from the index in pages ──> in memory ──> live
//! too old, or from another journal ──> event: resync ──> live
//! ```
//! `data` is the event as JSON. Its kind is a field in it, so that one listener receives all events. Only `resync` has an event name: the
//! client reads the status again and continues.

use super::problem::Problem;
use super::{AppState, closed};
use crate::api;
use crate::session::Missed;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::sse::{Event as Sent, KeepAlive, Sse};
use carved_records::Event;
use carved_store::EventsAfter;
use futures::stream::{self, Stream};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::broadcast::{Receiver, error::RecvError};

/// A comment in this interval keeps proxies from closing an idle stream.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// Number of events read from the index at a time, and number of such reads for one reader that returns. For older events the status is
/// more useful.
const PAGE: usize = 500;
const PAGES: u32 = 40;
/// Pause before a browser reconnects.
const RETRY: Duration = Duration::from_secs(2);

/// Everything that happens, as it happens; `Last-Event-ID` asks for what was missed.
#[utoipa::path(
    get, path = "/v1/events", tag = "status",
    params(("Last-Event-ID" = Option<u64>, Header, description = "Id of the newest event that the client has seen")),
    responses(
        (status = 200, description = "Server-sent events: `id`, and an Event as JSON in `data`; an event named `resync` where the gap is too old", body = api::Event, content_type = "text/event-stream"),
        (status = 503, description = "Too many clients wait for events or for a change of the status", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn get(
    State(app): State<AppState>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Sent, Infallible>>>, Problem> {
    let slot = app.staying.take()?;
    let asked = headers.get("last-event-id").map(|v| v.to_str().unwrap_or_default().trim()).filter(|v| !v.is_empty());
    // An id that is not a number was never used by this journal. It must differ from a missing id.
    let feed = Feed::open(app, asked.map(|id| id.parse().unwrap_or(u64::MAX)), PAGES).await;
    let hello = stream::iter([Ok(Sent::default().retry(RETRY).comment("carved"))]);
    let events = stream::unfold((feed, slot), |(mut feed, slot)| async move { feed.next().await.map(|sent| (Ok(sent), (feed, slot))) });
    Ok(Sse::new(stream::StreamExt::chain(hello, events)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

/// The position of one reader in the journal.
struct Feed {
    app: AppState,
    /// Id of the newest event sent to this reader.
    seen: Option<u64>,
    missed: VecDeque<Arc<Event>>,
    resync: bool,
    /// The missed events reach further back than the memory: more must be read after `missed`.
    more: bool,
    pages_left: u32,
    live: Receiver<Arc<Event>>,
}

impl Feed {
    async fn open(app: AppState, seen: Option<u64>, pages_left: u32) -> Self {
        let (missed, live) = app.session.events().subscribe(seen);
        let mut feed = Self { app, seen, missed: VecDeque::new(), resync: false, more: false, pages_left, live };
        match (missed, seen) {
            (Missed::Events(events), _) => feed.missed = events.into(),
            (Missed::Resync, Some(seen)) if pages_left > 0 => {
                feed.pages_left -= 1;
                feed.missed = page(&feed.app, seen).await.into();
                feed.more = !feed.missed.is_empty();
                feed.resync = !feed.more;
            }
            (Missed::Resync, _) => feed.resync = true,
        }
        feed
    }

    /// The next thing to send; `None` when the server ends.
    async fn next(&mut self) -> Option<Sent> {
        loop {
            if std::mem::take(&mut self.resync) {
                let status = self.app.session.status();
                let place = serde_json::json!({ "boot_id": status.boot_id, "revision": status.revision });
                return Some(Sent::default().event("resync").data(place.to_string()));
            }
            if let Some(event) = self.missed.pop_front() {
                return Some(self.send(&event));
            }
            if std::mem::take(&mut self.more) {
                *self = Self::open(self.app.clone(), self.seen, self.pages_left).await;
                continue;
            }
            let received = tokio::select! {
                received = self.live.recv() => received,
                () = closed(self.app.closing.clone()) => return None,
            };
            match received {
                Ok(event) => return Some(self.send(&event)),
                // A slow reader was dropped from the live channel. The journal's tail in memory reaches further back.
                Err(RecvError::Lagged(_)) if self.seen.is_some() => *self = Self::open(self.app.clone(), self.seen, PAGES).await,
                Err(RecvError::Lagged(_)) => self.resync = true,
                Err(RecvError::Closed) => return None,
            }
        }
    }

    fn send(&mut self, event: &Event) -> Sent {
        self.seen = Some(event.id);
        let data = serde_json::to_string(&api::Event::from(event)).unwrap_or_default();
        Sent::default().id(event.id.to_string()).data(data)
    }
}

/// The next events of the journal after `seen`. Empty if the journal does not know `seen` or cannot be read.
async fn page(app: &AppState, seen: u64) -> Vec<Arc<Event>> {
    let reader = app.reader.clone();
    match tokio::task::spawn_blocking(move || reader.events_after(seen, PAGE)).await {
        Ok(Ok(EventsAfter::Events(events))) => events.into_iter().map(Arc::new).collect(),
        Ok(Ok(EventsAfter::Unknown)) | Err(_) => Vec::new(),
        Ok(Err(error)) => {
            tracing::warn!(%error, "old events are not read");
            Vec::new()
        }
    }
}
