//! Access control in front of every route, also of routes that do not exist.
//!
//! ```text
//! request ─> Host in the list? ─> changes something: same origin? ─> token, if one is set ─> route
//!               403 wrong_host            403 wrong_origin                401 unauthorized, 403 read_only
//! ```
//! The `Host` list stops DNS rebinding, in which the name of a hostile page resolves to this machine, so that `Origin` and `Host` agree.
//! The origin check stops requests that a browser sends for pages of other sites.

use super::AppState;
use super::problem::Problem;
use crate::config::Guard;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::sync::Arc;
use subtle::ConstantTimeEq;

pub(super) async fn check(State(app): State<AppState>, request: Request, next: Next) -> Response {
    checked(&app.guard, request, next).await
}

/// As [`check`], for a server without the daemon's state.
pub(super) async fn check_guard(State(guard): State<Arc<Guard>>, request: Request, next: Next) -> Response {
    checked(&guard, request, next).await
}

async fn checked(guard: &Guard, request: Request, next: Next) -> Response {
    let refused = host(&guard.hosts, &request).and_then(|asked| origin(&request, &asked)).and_then(|()| token(guard, &request));
    match refused {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// The single value of a header. `None` if it is missing or repeated, since a repeated header may be an attack.
fn single<'h>(headers: &'h HeaderMap, name: &header::HeaderName) -> Option<&'h str> {
    let mut values = headers.get_all(name).iter();
    let first = values.next()?.to_str().ok()?;
    if values.next().is_some() { None } else { Some(first) }
}

fn host(allowed: &BTreeSet<String>, request: &Request) -> Result<Authority, Problem> {
    let wrong = |found: &str| {
        let allowed = allowed.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let detail = format!("this instrument is not {found:?}; it answers to {allowed} (allowed_hosts in [http] adds names)");
        Problem::new(StatusCode::FORBIDDEN, "wrong_host", detail)
    };
    let named = single(request.headers(), &header::HOST).ok_or_else(|| wrong(""))?;
    let authority: Authority = named.parse().map_err(|_| wrong(named))?;
    // A request line with a full URL has its own host, which would take precedence over the header.
    for asked in [Some(&authority), request.uri().authority()].into_iter().flatten() {
        if asked.as_str().contains('@') || !allowed.contains(&asked.host().to_ascii_lowercase()) {
            return Err(wrong(asked.as_str()));
        }
    }
    Ok(authority)
}

pub(super) fn changes_something(method: &Method) -> bool {
    !matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS | Method::TRACE)
}

fn origin(request: &Request, asked: &Authority) -> Result<(), Problem> {
    if !changes_something(request.method()) {
        return Ok(());
    }
    let headers = request.headers();
    let foreign = |found: &str| {
        let detail = format!("a page of {found:?} may not command this instrument; use its own page at {asked:?}", asked = asked.as_str());
        Err(Problem::new(StatusCode::FORBIDDEN, "wrong_origin", detail))
    };
    if headers.contains_key(header::ORIGIN) {
        let found = single(headers, &header::ORIGIN).unwrap_or_default();
        let own = found
            .split_once("://")
            .is_some_and(|(scheme, rest)| matches!(scheme, "http" | "https") && rest.eq_ignore_ascii_case(asked.as_str()));
        if !own {
            return foreign(found);
        }
    }
    match headers.get("sec-fetch-site").map(|v| v.to_str().unwrap_or_default()) {
        None | Some("same-origin" | "none") => Ok(()),
        Some(site) => foreign(site),
    }
}

/// The page's files, the contract and the two probes contain nothing about the instrument. A browser must be able to load the page before
/// the user can give it the token.
pub(super) fn is_open(path: &str) -> bool {
    !(path == "/metrics" || path == "/v1" || path.starts_with("/v1/"))
}

fn token(guard: &Guard, request: &Request) -> Result<(), Problem> {
    let Some(wanted) = guard.token.as_deref() else { return Ok(()) };
    if is_open(request.uri().path()) && !changes_something(request.method()) {
        return Ok(());
    }
    let shown = single(request.headers(), &header::AUTHORIZATION).and_then(|value| {
        let (scheme, token) = value.split_once(' ')?;
        scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
    });
    match shown {
        Some(shown) if same(shown, wanted) => Ok(()),
        Some(shown) if guard.read_token.as_deref().is_some_and(|read| same(shown, read)) => {
            if !changes_something(request.method()) {
                return Ok(());
            }
            let detail = "this token only reads; use the instrument's token to command it";
            Err(Problem::new(StatusCode::FORBIDDEN, "read_only", detail))
        }
        Some(_) => Err(unauthorized("the bearer token is not this instrument's")),
        None => Err(unauthorized("send the instrument's token as `Authorization: Bearer TOKEN`")),
    }
}

fn unauthorized(detail: &str) -> Problem {
    Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", detail)
}

/// Compares digests over their whole length, so that the duration reveals nothing about the tokens.
fn same(shown: &str, wanted: &str) -> bool {
    Sha256::digest(shown).as_slice().ct_eq(Sha256::digest(wanted).as_slice()).into()
}
