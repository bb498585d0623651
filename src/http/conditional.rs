//! Entity tags: a client that already has the newest answer gets 304 without a body. Commands with a condition are refused.

use super::access::changes_something;
use super::lease;
use super::problem::Problem;
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use carved_records::sha256_hex;

/// A tag derived from the content: half of its SHA-256. It is the same in every version of the daemon.
pub(super) fn tag_of(content: &[u8]) -> String {
    format!("\"{}\"", &sha256_hex(content)[..32])
}

/// 304 if the client's `If-None-Match` names `tag`, else `full`. Both answers carry the tag.
pub(super) fn answer(asked: &HeaderMap, tag: &str, full: impl FnOnce() -> Response) -> Response {
    let mut response = if known(asked, tag) { StatusCode::NOT_MODIFIED.into_response() } else { full() };
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// The weak comparison of RFC 9110, which ignores `W/` at the front.
fn known(asked: &HeaderMap, tag: &str) -> bool {
    let lines = asked.get_all(header::IF_NONE_MATCH).iter().filter_map(|v| v.to_str().ok());
    lines.flat_map(|line| line.split(',')).map(str::trim).any(|one| one == "*" || one.strip_prefix("W/").unwrap_or(one) == tag)
}

/// Refuses commands with `If-Match` or `If-Unmodified-Since`. Commands have no tag, and a client would take an ignored condition for a
/// fulfilled one. A plan needs no condition: another plan under the same name is refused anyway.
pub(super) async fn check(request: Request, next: Next) -> Response {
    let headers = request.headers();
    let conditional = headers.contains_key(header::IF_MATCH) || headers.contains_key(header::IF_UNMODIFIED_SINCE);
    let guarded = request.extensions().get::<MatchedPath>().is_some_and(|route| lease::guards(route.as_str()));
    if conditional && guarded && changes_something(request.method()) {
        let detail = "nothing that is commanded here has a tag or a date to hold a condition against; send the command without If-Match";
        return Problem::new(StatusCode::PRECONDITION_FAILED, "no_condition", detail).into_response();
    }
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_half_of_the_sha_256() {
        // printf abc | sha256sum
        assert_eq!(tag_of(b"abc"), "\"ba7816bf8f01cfea414140de5dae2223\"");
    }

    #[test]
    fn tags_are_compared_as_a_list_and_weakly() {
        let status = |asked: &'static str| {
            let headers = HeaderMap::from_iter([(header::IF_NONE_MATCH, HeaderValue::from_static(asked))]);
            answer(&headers, "\"b-7\"", || StatusCode::OK.into_response()).status().as_u16()
        };
        for same in ["\"b-7\"", "W/\"b-7\"", "\"b-6\", \"b-7\"", "*"] {
            assert_eq!(status(same), 304, "{same}");
        }
        for other in ["\"b-6\"", "b-7", "", "\"b-77\""] {
            assert_eq!(status(other), 200, "{other}");
        }
    }
}
