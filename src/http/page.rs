//! The operator's page, which is embedded if it was built before the daemon. Otherwise a plain page explains how to build it.
//!
//! The build compresses text: `app.js.br` and `app.js.gz` instead of `app.js`. A client gets the smallest that it reads, and the unpacked
//! text if it reads neither. Browsers read br only from this machine and over https. Pages of the documentation are there as `.gz` alone.

use super::conditional;
use super::problem::Problem;
use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Redirect, Response};
use rust_embed::{EmbeddedFile, RustEmbed};
use std::io::Read;

/// Empty until the page is built, and always without the feature `page`. `build.rs` makes cargo look for it again.
#[derive(RustEmbed)]
#[cfg_attr(feature = "page", folder = "web/dist")]
#[cfg_attr(not(feature = "page"), folder = "web/none")]
#[allow_missing = true]
struct Dist;

const UNBUILT: &str = include_str!("unbuilt.html");
const UNBUILT_SETUP: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>carved setup</title><h1>carved setup is running</h1>\
    <p>This program was built without its pages. Build both with <code>make build</code>, or set up in the terminal: start \
    <code>carved setup</code> without <code>--listen</code>.</p></html>";

/// Scripts only from this server. Models and pictures are blobs if they are fetched with a token, and the plots set inline styles.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' blob:; style-src 'self' 'unsafe-inline'; \
                      object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The page of several instruments reads the status of other daemons.
const WALL: &str = "wall/";
const WALL_POLICY: &str = "default-src 'self'; connect-src http: https:; img-src data:; object-src 'none'; base-uri 'none'; \
                           form-action 'none'; frame-ancestors 'none'";

/// The operator's page.
#[utoipa::path(get, path = "/", tag = "page", responses((status = 200, description = "HTML", body = String, content_type = "text/html")))]
pub(super) async fn index(headers: HeaderMap) -> Response {
    match file(&headers, "index.html") {
        Some(answer) => answer,
        None => document("text/html; charset=utf-8", UNBUILT.into()),
    }
}

/// The first page of the documentation.
const DOCS: &str = "docs/index.html";

/// Where the documentation begins: its index, or the contract alone in a program that was built without its pages.
#[utoipa::path(get, path = "/docs", tag = "page", responses((status = 303, description = "The documentation, as HTML pages")))]
pub(super) async fn docs() -> Redirect {
    let is_built = Dist::get(&format!("{DOCS}.gz")).is_some();
    Redirect::to(if is_built { "/docs/index.html" } else { "/docs/api" })
}

/// The folder of the page of `carved setup`, which another server serves.
const SETUP: &str = "setup/";

/// The other files of the page. Other paths are unknown.
pub(super) async fn asset(method: Method, uri: Uri, headers: HeaderMap) -> Response {
    let reads = matches!(method, Method::GET | Method::HEAD);
    let path = uri.path().trim_start_matches('/');
    let is_public = !path.starts_with(SETUP) && !ENCODINGS.iter().any(|(_, ending)| path.ends_with(ending));
    if reads
        && is_public
        && let Some(answer) = file(&headers, path)
    {
        return answer;
    }
    let detail = format!("there is nothing at {}; /docs/api lists what there is", uri.path());
    Problem::new(StatusCode::NOT_FOUND, "unknown_route", detail).into_response()
}

/// The page of `carved setup` and its files.
pub async fn setup(method: Method, uri: Uri, headers: HeaderMap) -> Response {
    let reads = matches!(method, Method::GET | Method::HEAD);
    let path = uri.path().trim_start_matches('/');
    let answer = file(&headers, &format!("{SETUP}{}", if path.is_empty() { "index.html" } else { path }));
    match answer.filter(|_| reads) {
        Some(answer) => answer,
        None if path.is_empty() => document("text/html; charset=utf-8", UNBUILT_SETUP.into()),
        None => Problem::new(StatusCode::NOT_FOUND, "unknown_route", format!("there is nothing at {}", uri.path())).into_response(),
    }
}

/// Names of encodings with the endings of their files, the smallest files first.
const ENCODINGS: [(&str, &str); 2] = [("br", ".br"), ("gzip", ".gz")];

/// A file of the page in the best encoding that the client reads. Pictures are there as they are.
fn file(asked: &HeaderMap, path: &str) -> Option<Response> {
    let mime = mime_guess::from_path(path).first_or_octet_stream();
    let mime = mime.essence_str();
    let mut encoded = ENCODINGS.iter().filter(|(encoding, _)| accepts(asked, encoding));
    let encoded = encoded.find_map(|(encoding, ending)| Some((*encoding, Dist::get(&format!("{path}{ending}"))?)));
    let mut answer = match encoded {
        None => serve(asked, Dist::get(path).or_else(|| unpacked(path))?, mime),
        Some((encoding, file)) => {
            let mut answer = serve(asked, file, mime);
            answer.headers_mut().insert(header::CONTENT_ENCODING, HeaderValue::from_static(encoding));
            answer
        }
    };
    answer.headers_mut().insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    if path.starts_with(WALL) {
        answer.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(WALL_POLICY));
    }
    Some(answer)
}

/// The text of a file that is there compressed.
fn unpacked(path: &str) -> Option<EmbeddedFile> {
    let mut file = Dist::get(&format!("{path}.gz"))?;
    let mut text = Vec::new();
    flate2::read::GzDecoder::new(&*file.data).read_to_end(&mut text).ok()?;
    file.data = text.into();
    Some(file)
}

/// Whether `Accept-Encoding` names an encoding, and not with the weight 0.
fn accepts(asked: &HeaderMap, encoding: &str) -> bool {
    let lines = asked.get_all(header::ACCEPT_ENCODING).iter().filter_map(|v| v.to_str().ok());
    lines.flat_map(|line| line.split(',')).any(|one| {
        let mut parts = one.split(';').map(str::trim);
        let named = parts.next().is_some_and(|name| name.eq_ignore_ascii_case(encoding));
        let weight = parts.find_map(|part| part.strip_prefix("q=")?.parse::<f64>().ok());
        named && weight != Some(0.0)
    })
}

fn serve(asked: &HeaderMap, file: EmbeddedFile, mime: &str) -> Response {
    let tag = conditional::tag_of(&file.data);
    let text = mime.starts_with("text/") || mime == "application/json";
    let content_type = if text { format!("{mime}; charset=utf-8") } else { mime.to_owned() };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoding_is_used_only_where_the_client_names_it() {
        let accepted = |value: &'static str| {
            let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(value))]);
            ["br", "gzip"].map(|encoding| accepts(&headers, encoding))
        };
        assert_eq!(accepted("gzip, deflate, br, zstd"), [true, true]);
        assert_eq!(accepted("GZIP;q=0.5"), [false, true]);
        assert_eq!(accepted("br;q=0, gzip;q=1.0"), [false, true]);
        assert_eq!(accepted("identity"), [false, false]);
        assert_eq!(accepted("brotli"), [false, false]);
        assert!(!accepts(&HeaderMap::new(), "gzip"));
    }
}
