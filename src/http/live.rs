//! `GET /v1/live/...`: the newest frame, its profile and the growing model, as the driver encoded them.

use super::problem::Problem;
use super::{AppState, conditional};
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// Lets a body share the encoded picture instead of copying it.
struct Shared(Arc<Vec<u8>>);

impl AsRef<[u8]> for Shared {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

fn newest(headers: &HeaderMap, content: Option<Arc<Vec<u8>>>, what: &str, content_type: &'static str) -> Result<Response, Problem> {
    let none_yet = || Problem::new(StatusCode::NOT_FOUND, "none_yet", format!("there is no {what} yet")).come_back();
    let content = content.ok_or_else(none_yet)?;
    let tag = conditional::tag_of(&content);
    let full = || ([(header::CONTENT_TYPE, content_type)], Body::from(Bytes::from_owner(Shared(content)))).into_response();
    Ok(conditional::answer(headers, &tag, full))
}

/// The newest frame, in colour.
#[utoipa::path(get, path = "/v1/live/frame.jpg", tag = "live", responses(
    (status = 200, description = "JPEG", body = Vec<u8>, content_type = "image/jpeg"),
    (status = 304, description = "The client has it"),
    (status = 404, description = "There is none yet", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn frame(State(app): State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    newest(&headers, app.session.live().frame_jpg, "frame", "image/jpeg")
}

/// The newest frame's profile, to be drawn over it.
#[utoipa::path(get, path = "/v1/live/profile.png", tag = "live", responses(
    (status = 200, description = "PNG of the frame's size, transparent but for the edge", body = Vec<u8>, content_type = "image/png"),
    (status = 304, description = "The client has it"),
    (status = 404, description = "There is none yet", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn profile(State(app): State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    newest(&headers, app.session.live().profile_png, "profile", "image/png")
}

/// The model as far as it has been carved, then the finished one in fewer triangles, in um.
#[utoipa::path(get, path = "/v1/live/mesh.glb", tag = "live", responses(
    (status = 200, description = "Binary glTF", body = Vec<u8>, content_type = "model/gltf-binary"),
    (status = 304, description = "The client has it"),
    (status = 404, description = "There is none yet", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn mesh(State(app): State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    newest(&headers, app.session.live().mesh_glb, "model", "model/gltf-binary")
}
