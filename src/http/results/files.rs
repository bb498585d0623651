//! Files of a specimen. The recorded hash of a file is its tag, so that a repeated request does not read the file.

use super::{Attempt, read, unknown_specimen};
use crate::http::conditional;
use crate::http::problem::Problem;
use crate::http::{App, AppState};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use carved_store::SpecimenFile;

async fn stored(
    app: &App,
    (run, well): (String, String),
    attempt: u32,
    file: SpecimenFile,
    content_type: &'static str,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let (r, w) = (run.clone(), well.clone());
    let found = read(app, move |store| store.file(&r, &w, attempt, file)).await?.ok_or_else(|| unknown_specimen(&run, &well))?;
    // An unfinished recording has no checksums yet. The tag is then computed from the bytes.
    let known = found.sha256().map(|hash| format!("\"{}\"", &hash[..hash.len().min(32)]));
    let full = |bytes: Vec<u8>| ([(header::CONTENT_TYPE, content_type), (header::CACHE_CONTROL, "no-cache")], bytes).into_response();
    if let Some(tag) = &known {
        let unread = || StatusCode::OK.into_response();
        let answer = conditional::answer(headers, tag, unread);
        if answer.status() == StatusCode::NOT_MODIFIED {
            return Ok(answer);
        }
    }
    let bytes = read(app, move |_| found.read()).await?;
    let tag = known.unwrap_or_else(|| conditional::tag_of(&bytes));
    Ok(conditional::answer(headers, &tag, || full(bytes)))
}

/// Name of the detection frame among the views.
pub(super) const DETECTION: &str = "detection.png";

/// The number in `7.png`.
fn number(file: &str) -> Result<u32, Problem> {
    let number = file.strip_suffix(".png").filter(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit())).and_then(|n| n.parse().ok());
    number.ok_or_else(|| Problem::new(StatusCode::NOT_FOUND, "unknown_file", format!("{file:?} is no view; use 0.png, 1.png, ...")))
}

type Named = Result<Path<(String, String)>, PathRejection>;
type Numbered = Result<Path<(String, String, String)>, PathRejection>;
type Which = Result<Query<Attempt>, QueryRejection>;

/// The surface where the outlines put it, um, binary PLY.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/mesh.ply", tag = "results",
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `P24`"), Attempt),
    responses(
        (status = 200, description = "PLY", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn mesh(State(app): State<AppState>, path: Named, which: Which, headers: HeaderMap) -> Result<Response, Problem> {
    let (Path(of), Query(which)) = (path?, which?);
    stored(&app, of, which.attempt, SpecimenFile::Mesh, "application/octet-stream", &headers).await
}

/// The same surface in fewer triangles, um, to look at.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/mesh.glb", tag = "results",
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `P24`"), Attempt),
    responses(
        (status = 200, description = "Binary glTF", body = Vec<u8>, content_type = "model/gltf-binary"),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn model(
    State(app): State<AppState>,
    path: Named,
    which: Which,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path(of), Query(which)) = (path?, which?);
    stored(&app, of, which.attempt, SpecimenFile::Model, "model/gltf-binary", &headers).await
}

/// The raw frame of a view, as it came, or the one on which the well was judged.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/views/{view}", tag = "results",
    params(
        ("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `P24`"),
        ("view" = String, Path, description = "`0.png`, `1.png`, ...: the ledger's number; `detection.png`"), Attempt,
    ),
    responses(
        (status = 200, description = "PNG", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn view(
    State(app): State<AppState>,
    path: Numbered,
    which: Which,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path((run, well, file)), Query(which)) = (path?, which?);
    let wanted = if file == DETECTION { SpecimenFile::Detection } else { SpecimenFile::View(number(&file)?) };
    stored(&app, (run, well), which.attempt, wanted, "image/png", &headers).await
}

/// The mask that a view carved with.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/profiles/{view}", tag = "results",
    params(
        ("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `P24`"),
        ("view" = String, Path, description = "`0.png`, `1.png`, ...: the ledger's number"), Attempt,
    ),
    responses(
        (status = 200, description = "PNG", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn profile(
    State(app): State<AppState>,
    path: Numbered,
    which: Which,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path((run, well, file)), Query(which)) = (path?, which?);
    stored(&app, (run, well), which.attempt, SpecimenFile::Profile(number(&file)?), "image/png", &headers).await
}
