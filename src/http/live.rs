//! `GET /v1/live/...`: the newest frame, its profile and the growing model, as encoded by the driver.
//!
//! ```text
//! 200, 304 ── Carved-Run, Carved-Well, Carved-Views: the specimen of the picture, and the number of views
//! 204      ── no picture: no frame was taken yet, or no profile was found. This is not an error of the client
//! ```

use super::problem::Problem;
use super::runs::refused;
use super::{AppState, conditional};
use crate::session::{Live, Shown};
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// Shares the encoded picture as a body without a copy.
struct Shared(Arc<Vec<u8>>);

impl AsRef<[u8]> for Shared {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

/// One of the pictures, from the same snapshot as the headers that describe it.
fn newest(app: &AppState, headers: &HeaderMap, pick: impl FnOnce(Live) -> Option<Arc<Vec<u8>>>, content_type: &'static str) -> Response {
    let live = app.session.live();
    let shown = live.shown.clone();
    let mut response = match pick(live) {
        None => StatusCode::NO_CONTENT.into_response(),
        Some(content) => {
            let tag = conditional::tag_of(&content);
            let full = || ([(header::CONTENT_TYPE, content_type)], Body::from(Bytes::from_owner(Shared(content)))).into_response();
            conditional::answer(headers, &tag, full)
        }
    };
    if let Some(Shown { run, well, views }) = shown {
        for (name, value) in [("carved-run", run), ("carved-well", well), ("carved-views", views.to_string())] {
            if let Ok(value) = HeaderValue::from_str(&value) {
                response.headers_mut().insert(name, value);
            }
        }
    }
    response
}

/// The newest frame, in colour.
#[utoipa::path(get, path = "/v1/live/frame.jpg", tag = "live", responses(
    (status = 200, description = "JPEG", body = Vec<u8>, content_type = "image/jpeg", headers(
        ("Carved-Run" = String, description = "The run that it is of"),
        ("Carved-Well" = String, description = "The well that it is of"),
        ("Carved-Views" = u32, description = "How many views of that specimen had been taken: 0 is its detection"),
    )),
    (status = 204, description = "There is none"),
    (status = 304, description = "The client has it; the same headers"),
))]
pub(super) async fn frame(State(app): State<AppState>, headers: HeaderMap) -> Response {
    newest(&app, &headers, |live| live.frame_jpg, "image/jpeg")
}

/// The newest frame's profile, to be drawn over it.
#[utoipa::path(get, path = "/v1/live/profile.png", tag = "live", responses(
    (status = 200, description = "PNG of the frame's size, transparent but for the edge", body = Vec<u8>, content_type = "image/png", headers(
        ("Carved-Run" = String, description = "The run that it is of"),
        ("Carved-Well" = String, description = "The well that it is of"),
        ("Carved-Views" = u32, description = "How many views of that specimen had been taken: 0 is its detection"),
    )),
    (status = 204, description = "There is none"),
    (status = 304, description = "The client has it; the same headers"),
))]
pub(super) async fn profile(State(app): State<AppState>, headers: HeaderMap) -> Response {
    newest(&app, &headers, |live| live.profile_png, "image/png")
}

/// The model as far as it has been carved, then the finished one in fewer triangles, in um.
#[utoipa::path(get, path = "/v1/live/mesh.glb", tag = "live", responses(
    (status = 200, description = "Binary glTF", body = Vec<u8>, content_type = "model/gltf-binary", headers(
        ("Carved-Run" = String, description = "The run that it is of"),
        ("Carved-Well" = String, description = "The well that it is of"),
        ("Carved-Views" = u32, description = "How many views of that specimen had been taken: 0 is its detection"),
    )),
    (status = 204, description = "There is none"),
    (status = 304, description = "The client has it; the same headers"),
))]
pub(super) async fn mesh(State(app): State<AppState>, headers: HeaderMap) -> Response {
    newest(&app, &headers, |live| live.mesh_glb, "model/gltf-binary")
}

/// Takes a picture with the light on, while no run is under way. Nothing moves.
///
/// It is for focus, dust and loading. Whoever wants to follow asks again and again. Pictures are taken one at a time, and the next command,
/// as the start of a run, ends the wait for one.
#[utoipa::path(post, path = "/v1/live/picture", tag = "live", responses(
    (status = 200, description = "JPEG", body = Vec<u8>, content_type = "image/jpeg"),
    (status = 409, description = "A run is under way, a fault waits for a person, or the instrument is being checked", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "The camera sends none, another command came first, or too many clients wait", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn picture(State(app): State<AppState>) -> Result<Response, Problem> {
    // One at a time, so that a command has one picture before it at most. Who waits takes no place from the event streams.
    let _turn = app.picturing.lock().await;
    let _slot = app.staying.take()?;
    let taken = app.session.picture().await.map_err(|refusal| refused(&app, refusal))?;
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], Body::from(Bytes::from_owner(Shared(taken)))).into_response())
}
