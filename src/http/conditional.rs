//! Entity tags: who has the newest already gets 304 and no body.

use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::hash::{DefaultHasher, Hash, Hasher};

/// A tag made of the content itself.
pub(super) fn tag_of(content: &[u8]) -> String {
    let mut hasher = DefaultHasher::new();
    content.hash(&mut hasher);
    format!("\"{:016x}\"", hasher.finish())
}

/// 304 where the client's `If-None-Match` names `tag`, else `full`; both carry the tag.
pub(super) fn answer(asked: &HeaderMap, tag: &str, full: impl FnOnce() -> Response) -> Response {
    let mut response = if known(asked, tag) { StatusCode::NOT_MODIFIED.into_response() } else { full() };
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// The weak comparison of RFC 9110: `W/` in front makes no difference.
fn known(asked: &HeaderMap, tag: &str) -> bool {
    let lines = asked.get_all(header::IF_NONE_MATCH).iter().filter_map(|v| v.to_str().ok());
    lines.flat_map(|line| line.split(',')).map(str::trim).any(|one| one == "*" || one.strip_prefix("W/").unwrap_or(one) == tag)
}

#[cfg(test)]
mod tests {
    use super::*;

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
