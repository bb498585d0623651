//! The operator's page, embedded where it was built before the daemon; else a plain page that says how to build it.

use super::conditional;
use super::problem::Problem;
use axum::body::Body;
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

/// Absent as long as the page is not built; `build.rs` has cargo look again when it is.
#[derive(RustEmbed)]
#[folder = "web/dist"]
#[allow_missing = true]
struct Dist;

const UNBUILT: &str = include_str!("unbuilt.html");

/// Scripts from here alone. Models and pictures reach the page as blobs when they are fetched with a token, and the plots
/// set their styles in place.
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

/// The page's other files; whatever is not one of them is unknown.
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
    // A browser takes over the policy of a 304 as well, so that one must carry the page's too.
    guarded(conditional::answer(asked, &tag, || ([(header::CONTENT_TYPE, content_type)], file.data.into_owned()).into_response()))
}

fn document(content_type: &str, body: Body) -> Response {
    guarded(([(header::CONTENT_TYPE, content_type)], body).into_response())
}

/// The names of the files stay the same from build to build, so the browser asks each time and mostly gets 304.
fn guarded(response: Response) -> Response {
    ([(header::CACHE_CONTROL, "no-cache"), (header::CONTENT_SECURITY_POLICY, POLICY)], response).into_response()
}
