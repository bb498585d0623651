//! Files of a specimen. The recorded hash of a file is its tag, so that a repeated request does not read the file.

use super::{Attempt, read, unknown_specimen};
use crate::http::conditional;
use crate::http::problem::Problem;
use crate::http::{App, AppState};
use crate::session::numbers;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use carved_core::pipeline::standard::Aspect;
use carved_core::profile::Picture;
use carved_store::SpecimenFile;
use serde::Deserialize;
use utoipa::IntoParams;

/// Widths of a picture that can be asked for, px.
const WIDTHS: std::ops::RangeInclusive<u32> = 32..=8192;

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
    let known = found.sha256().map(|hash| format!("\"{}\"", tagged(hash)));
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

/// The part of a hash that a tag has. A damaged `SHA256SUMS` may hold any text in its place.
fn tagged(hash: &str) -> &str {
    hash.get(..32).unwrap_or(hash)
}

/// Name of the detection frame among the views.
pub(super) const DETECTION: &str = "detection.png";

/// The name of that frame without an ending.
const DETECTED: &str = "detection";

fn unknown_view(file: &str) -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "unknown_file", format!("{file:?} is no view; use 0.png, 1.png, ..."))
}

/// The number in `7`.
fn number(digits: &str) -> Option<u32> {
    Some(digits).filter(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))?.parse().ok()
}

/// A view for the page: JPEG, scaled down. Its tag is that of the frame with the width.
async fn shown(
    app: &App,
    (run, well): (String, String),
    Scaled { attempt, width }: Scaled,
    file: SpecimenFile,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    if let Some(width) = width.filter(|width| !WIDTHS.contains(width)) {
        let (least, most) = (WIDTHS.start(), WIDTHS.end());
        return Err(Problem::bad_request("bad_query", format!("width is {width}; use {least} to {most} px")));
    }
    let (r, w) = (run.clone(), well.clone());
    let found = read(app, move |store| Ok(store.pixel_format(&r, &w, attempt)?.zip(store.file(&r, &w, attempt, file)?)));
    let (format, file) = found.await?.ok_or_else(|| unknown_specimen(&run, &well))?;
    let known = file.sha256().map(|hash| format!("\"{}-{}\"", tagged(hash), width.unwrap_or(0)));
    if let Some(tag) = &known {
        let answer = conditional::answer(headers, tag, || StatusCode::OK.into_response());
        if answer.status() == StatusCode::NOT_MODIFIED {
            return Ok(answer);
        }
    }
    let shown = read(app, move |_| Ok(carved_pictures::jpeg(&Picture::from_frame(&file.decode(format)?), width))).await?;
    let bytes = shown.map_err(|error| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "store", error.to_string()))?;
    let tag = known.unwrap_or_else(|| conditional::tag_of(&bytes));
    let full = || ([(header::CONTENT_TYPE, "image/jpeg"), (header::CACHE_CONTROL, "no-cache")], bytes).into_response();
    Ok(conditional::answer(headers, &tag, full))
}

#[derive(Debug, Default, Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Scaled {
    /// An earlier attempt at the well, by its number; 0 or left out, the newest.
    #[serde(default)]
    #[param(required = false)]
    attempt: u32,
    /// Largest width of a `.jpg`, px; left out, that of the frame.
    #[param(minimum = 32, maximum = 8192)]
    width: Option<u32>,
}

type Named = Result<Path<(String, String)>, PathRejection>;
type Numbered = Result<Path<(String, String, String)>, PathRejection>;
type Which = Result<Query<Attempt>, QueryRejection>;

/// The surface where the outlines put it, um, binary PLY.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/mesh.ply", tag = "results",
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"), Attempt),
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
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"), Attempt),
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

/// A standard picture of a larva: its left side (`lateral`) or its back (`dorsal`), head to the left, at the scale of all larvae of the
/// method, and never mirrored. The `.png` has a scale bar below the picture.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/{picture}", tag = "results",
    params(
        ("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"),
        ("picture" = String, Path, description = "`lateral.png`, `lateral.tif`, `dorsal.png` or `dorsal.tif`"), Attempt,
    ),
    responses(
        (status = 200, description = "PNG or TIFF", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"))),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn standard(
    State(app): State<AppState>,
    path: Numbered,
    which: Which,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path((run, well, name)), Query(which)) = (path?, which?);
    let unknown = || {
        let detail = format!("{name:?} is no picture of a specimen; use lateral.png, lateral.tif, dorsal.png or dorsal.tif");
        Problem::new(StatusCode::NOT_FOUND, "unknown_file", detail)
    };
    let (aspect, ending) = name.split_once('.').ok_or_else(unknown)?;
    let aspect = Aspect::ALL.into_iter().find(|known| known.name() == aspect).ok_or_else(unknown)?;
    let (is_tiff, content_type) = match ending {
        "png" => (false, "image/png"),
        "tif" => (true, "image/tiff"),
        _ => return Err(unknown()),
    };
    stored(&app, (run, well), which.attempt, SpecimenFile::Standard { aspect, is_tiff }, content_type, &headers).await
}

/// The surface with the colours of the frames at its corners, um, to look at. It is made at each request, from the stored frames.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/coloured.glb", tag = "results",
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "Binary glTF", body = Vec<u8>, content_type = "model/gltf-binary"),
        (status = 304, description = "The client has it"),
        (status = 404, description = "No surface with numbers is stored", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::http) async fn coloured(State(app): State<AppState>, path: Named, headers: HeaderMap) -> Result<Response, Problem> {
    let Path((run, well)) = path?;
    let (r, w) = (run.clone(), well.clone());
    let found = read(&app, move |store| Ok(store.recording(&r, &w)?.zip(store.file(&r, &w, 0, SpecimenFile::Mesh)?)));
    let (reader, mesh) = found.await?.ok_or_else(|| unknown_specimen(&run, &well))?;
    // The frames are of the same closed recording as the surface.
    let tag = mesh.sha256().map(|hash| format!("\"{}-coloured\"", tagged(hash)));
    let tag = tag.ok_or_else(|| unknown_specimen(&run, &well))?;
    let answer = conditional::answer(&headers, &tag, || StatusCode::OK.into_response());
    if answer.status() == StatusCode::NOT_MODIFIED {
        return Ok(answer);
    }
    let glb = read(&app, move |_| numbers::coloured(&reader)).await?.ok_or_else(|| unknown_specimen(&run, &well))?;
    let full = || ([(header::CONTENT_TYPE, "model/gltf-binary"), (header::CACHE_CONTROL, "no-cache")], glb).into_response();
    Ok(conditional::answer(&headers, &tag, full))
}

/// The frame of a view, or the one on which the well was judged: `.png` as it came, `.jpg` in colour and scaled down, to look at.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/views/{view}", tag = "results",
    params(
        ("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"),
        ("view" = String, Path, description = "`0.png`, `1.png`, ...: the ledger's number; `detection.png`; or with `.jpg`"), Scaled,
    ),
    responses(
        (status = 200, description = "PNG or JPEG", content((Vec<u8> = "image/png"), (Vec<u8> = "image/jpeg"))),
        (status = 304, description = "The client has it"),
    )
)]
pub(in crate::http) async fn view(
    State(app): State<AppState>,
    path: Numbered,
    which: Result<Query<Scaled>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path((run, well, file)), Query(which)) = (path?, which?);
    let (name, ending) = file.rsplit_once('.').ok_or_else(|| unknown_view(&file))?;
    let wanted = if name == DETECTED { Some(SpecimenFile::Detection) } else { number(name).map(SpecimenFile::View) };
    let wanted = wanted.ok_or_else(|| unknown_view(&file))?;
    match (ending, which.width) {
        ("jpg", _) => shown(&app, (run, well), which, wanted, &headers).await,
        ("png", None) => stored(&app, (run, well), which.attempt, wanted, "image/png", &headers).await,
        ("png", Some(_)) => Err(Problem::bad_request("bad_query", "a .png is the raw frame and has no width; use .jpg")),
        _ => Err(unknown_view(&file)),
    }
}

/// The mask that a view carved with.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}/profiles/{view}", tag = "results",
    params(
        ("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"),
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
    let view = file.strip_suffix(".png").and_then(number).ok_or_else(|| unknown_view(&file))?;
    stored(&app, (run, well), which.attempt, SpecimenFile::Profile(view), "image/png", &headers).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_made_of_whatever_a_damaged_file_has_in_place_of_a_hash() {
        assert_eq!(tagged(&"0".repeat(64)), "0".repeat(32));
        let damaged = format!("{}é{}", "0".repeat(31), "0".repeat(31));
        assert_eq!((tagged(&damaged), tagged("short")), (damaged.as_str(), "short"));
    }
}
