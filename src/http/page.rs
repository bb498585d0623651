//! The operator's page, which is embedded if it was built before the daemon. Otherwise a plain page explains how to build it.

use super::conditional;
use super::problem::Problem;
use axum::body::Body;
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

/// Empty until the page is built. `build.rs` makes cargo look for it again.
#[derive(RustEmbed)]
#[folder = "web/dist"]
#[allow_missing = true]
struct Dist;

const UNBUILT: &str = include_str!("unbuilt.html");

/// Scripts only from this server. Models and pictures are blobs if they are fetched with a token, and the plots set inline styles.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' blob:; style-src 'self' 'unsafe-inline'; \
                      object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The operator's page.
#[utoipa::path(get, path = "/", tag = "page", responses((status = 200, description = "HTML", body = String, content_type = "text/html")))]
pub(super) async fn index(headers: HeaderMap) -> Response {
    match Dist::get("index.html") {
        Some(file) => serve(&headers, file),
        None => document("text/html; charset=utf-8", UNBUILT.into()),
    }
}

/// The other files of the page. Other paths are unknown.
pub(super) async fn asset(method: Method, uri: Uri, headers: HeaderMap) -> Response {
    let reads = matches!(method, Method::GET | Method::HEAD);
    if let Some(file) = Dist::get(uri.path().trim_start_matches('/')).filter(|_| reads) {
        return serve(&headers, file);
    }
    let detail = format!("there is nothing at {}; /docs lists what there is", uri.path());
    Problem::new(StatusCode::NOT_FOUND, "unknown_route", detail).into_response()
}

fn serve(asked: &HeaderMap, file: EmbeddedFile) -> Response {
    let tag = conditional::tag_of(&file.data);
    let mime = file.metadata.mimetype().to_owned();
    let text = mime.starts_with("text/") || mime == "application/json";
    let content_type = if text { format!("{mime}; charset=utf-8") } else { mime };
    // A browser also takes the policy from a 304, so a 304 must carry it too.
    guarded(conditional::answer(asked, &tag, || ([(header::CONTENT_TYPE, content_type)], file.data.into_owned()).into_response()))
}

fn document(content_type: &str, body: Body) -> Response {
    guarded(([(header::CONTENT_TYPE, content_type)], body).into_response())
}

/// File names do not change between builds, so the browser asks each time and usually gets 304.
fn guarded(response: Response) -> Response {
    ([(header::CACHE_CONTROL, "no-cache"), (header::CONTENT_SECURITY_POLICY, POLICY)], response).into_response()
}
