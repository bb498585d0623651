//! All files of a run as one download, and its events.
//!
//! ```text
//!  blocking thread: files ── tar ──> channel of a few parts ──> body of the answer ──> client
//!                                     waits while the client is slow, ends when the client is gone
//! ```

use super::{RunEvents, json, read, unknown_run};
use crate::api;
use crate::http::AppState;
use crate::http::problem::Problem;
use axum::body::{Body, Bytes};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use carved_store::RunFiles;
use futures::stream;
use serde::Deserialize;
use std::io::{self, BufWriter, Write};
use tokio::sync::mpsc;
use utoipa::IntoParams;

/// Number of simultaneous downloads of runs: each reads the disk at full speed.
pub(in crate::http) const DOWNLOADS: usize = 2;

/// Parts of a download that wait for a slow client, and their size.
const PARTS: usize = 4;
const PART_BYTES: usize = 256 * 1024;

/// Most events of one answer.
const EVENTS: usize = 1000;

/// Sends what is written to it to the body of an answer.
struct Parts(mpsc::Sender<io::Result<Bytes>>);

impl Write for Parts {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent = self.0.blocking_send(Ok(Bytes::copy_from_slice(bytes)));
        sent.map(|()| bytes.len()).map_err(|_| io::ErrorKind::BrokenPipe.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes the archive. An error breaks the answer off, so that the client does not take half an archive for a whole one.
fn send(files: &RunFiles, to: &mpsc::Sender<io::Result<Bytes>>) {
    let mut out = BufWriter::with_capacity(PART_BYTES, Parts(to.clone()));
    let sent = files.write_tar(&mut out).map_err(io::Error::other).and_then(|()| out.flush());
    if let Err(error) = sent {
        tracing::warn!(%error, "the download of a run was broken off");
        // The writer is dropped without its remaining bytes. A client that is gone does not read the error either.
        let _unread = to.blocking_send(Err(error));
        drop(out.into_parts());
    }
}

/// All files of a run that has ended, as a tar archive with the SHA-256 of each file.
///
/// The last file is `SHA256SUMS`: `sha256sum -c` compares the unpacked files with what was recorded.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/files.tar", tag = "results", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The folder of the run", body = Vec<u8>, content_type = "application/x-tar"),
        (status = 409, description = "The run is under way", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Other runs are being downloaded", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::http) async fn run_files(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    let Ok(slot) = app.downloading.clone().try_acquire_owned() else {
        let detail = format!("{DOWNLOADS} downloads of runs are under way; repeat the request when one of them has ended");
        return Err(Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail).come_back());
    };
    let name = id.clone();
    let files = read(&app, move |store| store.run_files(&name)).await?.ok_or_else(|| unknown_run(&id))?;
    let (parts, received) = mpsc::channel(PARTS);
    tokio::task::spawn_blocking(move || {
        let _slot = slot;
        send(&files, &parts);
    });
    let body = stream::unfold(received, |mut received| async move { received.recv().await.map(|part| (part, received)) });
    let headers = [
        (header::CONTENT_TYPE, "application/x-tar".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{id}.tar\"")),
    ];
    Ok((headers, Body::from_stream(body)).into_response())
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct After {
    /// Id of the last event of the answer before; 0 or left out, from the beginning.
    #[serde(default)]
    #[param(required = false)]
    after: u64,
}

/// The events of a run, oldest first, without those of single views. One answer has at most 1000 of them.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/events", tag = "results", params(("run_id" = String, Path), After),
    responses(
        (status = 200, description = "The next events", body = RunEvents),
        (status = 304, description = "The client has it"),
        (status = 503, description = "The index cannot be read", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::http) async fn events(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    query: Result<Query<After>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path(id), Query(After { after })) = (path?, query?);
    let name = id.clone();
    let found = read(&app, move |store| {
        // The events of a run outlive its folder.
        let known = store.run(&name)?.is_some() || store.was_accepted(&name)?;
        // One more event shows whether there is another answer.
        if known { store.events_of(&name, after, EVENTS + 1).map(Some) } else { Ok(None) }
    });
    let mut found = found.await?.ok_or_else(|| unknown_run(&id))?;
    let more = found.len() > EVENTS;
    found.truncate(EVENTS);
    let next = found.last().filter(|_| more).map(|event| event.id);
    Ok(json(&headers, &RunEvents { events: found.iter().map(api::Event::from).collect(), next }))
}
