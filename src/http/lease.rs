//! A lease: while it lasts only one client commands the instrument, so that two schedulers do not control the same plate.
//!
//! ```text
//! PUT /v1/lease {token} ─> every command carries it as `Carved-Lease` ─> PUT again before ttl_s is over, or DELETE
//!                          without it: 423 with holder and time left │ with the token of an ended lease: 412
//! ```
//! Aborts and the emergency stop need no lease, because anyone who sees a problem must be able to stop the instrument. A lease is an
//! agreement between clients that may command. The right to command is the bearer token. The lease is kept in memory, uses the monotonic
//! clock, and ends with the daemon.

use super::AppState;
use super::access::changes_something;
use super::body::{self, Body};
use super::problem::{LeaseStatus, Problem};
use axum::Json;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// Header with the token of a lease.
pub(super) const HEADER: &str = "carved-lease";
/// Longest duration of a lease: the time after which the instrument is free again if its client has died.
const LONGEST_S: u32 = 3600;
/// Maximum length of a holder's name.
const NAME_LIMIT: usize = 64;

/// Body of `PUT /v1/lease`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct LeaseRequest {
    /// Who commands, for others to read: 1 to 64 characters.
    #[schema(max_length = 64, pattern = r"^[^\x00-\x1F\x7F-\x9F]*[^\s\x00-\x1F\x7F-\x9F][^\x00-\x1F\x7F-\x9F]*$")]
    holder: String,
    /// Seconds until it ends by itself, 1 to 3600; asking again begins them anew.
    #[schema(minimum = 1, maximum = 3600)]
    ttl_s: u32,
    /// The caller's own word for the lease, which nobody else can guess: 16 to 64 letters, digits, `-` and `_`. A request that is sent again
    /// because its answer was lost is then the holder's. Without it the token is made up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(pattern = "^[A-Za-z0-9_-]{16,64}$")]
    token: Option<String>,
}

/// Whether a token is hard to guess and valid in a header.
fn is_token(token: &str) -> bool {
    (16..=64).contains(&token.len()) && token.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
}

/// A lease as its holder gets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Lease {
    holder: String,
    /// Goes with every command, as the header `Carved-Lease`.
    token: String,
    expires_in_s: f64,
}

struct Held {
    holder: String,
    token: String,
    until: Instant,
}

#[derive(Debug, PartialEq)]
enum Refused {
    /// Another client has the lease.
    Locked { holder: String, left: Duration },
    /// The lease of the token has ended.
    Over,
}

/// The only lease. The caller gives the time.
#[derive(Default)]
pub(super) struct Desk(Mutex<Option<Held>>);

impl Desk {
    /// Runs `then` with the lease that is valid at `now`.
    fn at<T>(&self, now: Instant, then: impl FnOnce(&mut Option<Held>) -> T) -> T {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if held.as_ref().is_some_and(|h| h.until <= now) {
            *held = None;
        }
        then(&mut held)
    }

    fn locked(held: &Held, now: Instant) -> Refused {
        Refused::Locked { holder: held.holder.clone(), left: held.until - now }
    }

    /// Checks whether a command with this token may pass.
    fn admit(&self, now: Instant, shown: Option<&str>) -> Result<(), Refused> {
        self.at(now, |held| match (held, shown) {
            (None, None) => Ok(()),
            (None, Some(_)) => Err(Refused::Over),
            (Some(held), shown) if shown == Some(&held.token) => Ok(()),
            (Some(held), _) => Err(Self::locked(held, now)),
        })
    }

    /// Grants a new lease, with the caller's token or `fresh`, or renews the lease whose token was shown or named (`true`).
    fn grant(&self, now: Instant, asked: LeaseRequest, shown: Option<&str>, fresh: String) -> Result<(Lease, bool), Refused> {
        self.at(now, |held| {
            let named = asked.token.as_deref();
            let token = match held {
                None => asked.token.clone().unwrap_or(fresh),
                Some(held) if [shown, named].contains(&Some(&held.token)) => held.token.clone(),
                Some(held) => return Err(Self::locked(held, now)),
            };
            let ttl = Duration::from_secs(asked.ttl_s.into());
            let renewed = held.is_some();
            *held = Some(Held { holder: asked.holder.clone(), token: token.clone(), until: now + ttl });
            Ok((Lease { holder: asked.holder, token, expires_in_s: ttl.as_secs_f64() }, renewed))
        })
    }

    /// Ends the lease. A lease that has ended already is no error.
    fn release(&self, now: Instant, shown: Option<&str>) -> Result<(), Refused> {
        self.at(now, |held| match held {
            Some(other) if shown != Some(&other.token) => Err(Self::locked(other, now)),
            _ => {
                *held = None;
                Ok(())
            }
        })
    }

    /// The holder of the lease with this token.
    fn holder(&self, now: Instant, shown: Option<&str>) -> Option<String> {
        self.at(now, |held| held.as_ref().filter(|held| shown == Some(held.token.as_str())).map(|held| held.holder.clone()))
    }

    fn status(&self, now: Instant) -> LeaseStatus {
        self.at(now, |held| {
            let left = |h: &Held| LeaseStatus { holder: Some(h.holder.clone()), expires_in_s: Some((h.until - now).as_secs_f64()) };
            held.as_ref().map(left).unwrap_or_default()
        })
    }
}

fn shown(headers: &HeaderMap) -> Option<&str> {
    // A header that is not text cannot be a token, and is refused like a wrong one.
    headers.get(HEADER).map(|token| token.to_str().unwrap_or_default())
}

/// The holder of the lease whose token these headers show.
pub(super) fn holder(app: &AppState, headers: &HeaderMap) -> Option<String> {
    app.lease.holder(Instant::now(), shown(headers))
}

fn refusal(refused: Refused) -> Problem {
    match refused {
        Refused::Locked { holder, left } => {
            let seconds = left.as_secs_f64();
            let detail = format!(
                "{holder:?} commands this instrument for another {seconds:.0} s; ask again then, or let it give the lease back. \
                 An abort and the emergency stop pass"
            );
            let left = LeaseStatus { holder: Some(holder), expires_in_s: Some(seconds) };
            Problem { lease: Some(left), ..Problem::new(StatusCode::LOCKED, "locked", detail).come_back_after(left_s(seconds)) }
        }
        Refused::Over => {
            let detail = "the lease of this Carved-Lease token is over (or the daemon was started again): ask for a new one, \
                          PUT /v1/lease, and look at the status before going on";
            Problem::new(StatusCode::PRECONDITION_FAILED, "lease_over", detail)
        }
    }
}

/// Seconds, rounded up to whole ones.
fn left_s(seconds: f64) -> u32 {
    (seconds.ceil() as u32).max(1)
}

/// Commands that need no lease.
const ALWAYS: [&str; 5] = ["/v1/emergency-stop", "/v1/runs/{run_id}/abort", "/v1/lease", "/v1/plate-maps/check", "/v1/plate-maps/columns"];

/// Whether a route needs the lease.
pub(super) fn guards(route: &str) -> bool {
    route.starts_with("/v1/") && !ALWAYS.contains(&route)
}

/// Passes the commands of the lease's holder, and all commands if there is no lease.
pub(super) async fn check(State(app): State<AppState>, request: Request, next: Next) -> Response {
    let guarded = request.extensions().get::<MatchedPath>().is_some_and(|route| guards(route.as_str()));
    if guarded
        && changes_something(request.method())
        && let Err(refused) = app.lease.admit(Instant::now(), shown(request.headers()))
    {
        return refusal(refused).into_response();
    }
    next.run(request).await
}

/// Takes the lease, or begins its time anew.
///
/// The holder renews by sending its token, as `Carved-Lease` or in the body. With a token of your own in the body the same request may be
/// sent any number of times.
#[utoipa::path(
    put, path = "/v1/lease", tag = "commands", request_body = LeaseRequest,
    params(("Carved-Lease" = Option<String>, Header, description = "Token of the lease that is renewed")),
    responses(
        (status = 201, description = "The lease is the caller's", body = Lease),
        (status = 200, description = "Its time begins anew", body = Lease),
        (status = 423, description = "Another client has it: `lease` says who, and for how long", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn put(
    State(app): State<AppState>,
    headers: HeaderMap,
    Body(asked): Body<LeaseRequest, { body::SMALL }>,
) -> Result<(StatusCode, Json<Lease>), Problem> {
    let mut wrong = Vec::new();
    if asked.holder.trim().is_empty() || asked.holder.chars().count() > NAME_LIMIT || asked.holder.chars().any(char::is_control) {
        wrong.push(body::wrong("/holder", format!("use 1 to {NAME_LIMIT} characters on one line")));
    }
    if !(1..=LONGEST_S).contains(&asked.ttl_s) {
        wrong.push(body::wrong("/ttl_s", format!("{} is out of range: 1 to {LONGEST_S} s", asked.ttl_s)));
    }
    if asked.token.as_deref().is_some_and(|token| !is_token(token)) {
        wrong.push(body::wrong("/token", "use 16 to 64 letters, digits, '-' and '_', or leave it out".into()));
    }
    if !wrong.is_empty() {
        return Err(Problem::unprocessable("invalid_lease", wrong));
    }
    let token = fresh_token()?;
    let (lease, renewed) = app.lease.grant(Instant::now(), asked, shown(&headers), token).map_err(refusal)?;
    Ok((if renewed { StatusCode::OK } else { StatusCode::CREATED }, Json(lease)))
}

fn fresh_token() -> Result<String, Problem> {
    let word = || {
        getrandom::u64().map_err(|why| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "no_random", format!("no token can be made: {why}")))
    };
    Ok(format!("{:016x}{:016x}", word()?, word()?))
}

/// Who commands now.
#[utoipa::path(get, path = "/v1/lease", tag = "status", responses((status = 200, description = "The holder, if any", body = LeaseStatus)))]
pub(super) async fn get(State(app): State<AppState>) -> Json<LeaseStatus> {
    Json(app.lease.status(Instant::now()))
}

/// Gives the lease back. A repeat answers the same.
#[utoipa::path(
    delete, path = "/v1/lease", tag = "commands",
    params(("Carved-Lease" = Option<String>, Header, description = "Token of the lease")),
    responses(
        (status = 204, description = "Nobody has it"),
        (status = 423, description = "Another client has it", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn delete(State(app): State<AppState>, headers: HeaderMap) -> Result<StatusCode, Problem> {
    app.lease.release(Instant::now(), shown(&headers)).map_err(refusal)?;
    Ok(StatusCode::NO_CONTENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(holder: &str, ttl_s: u32) -> LeaseRequest {
        LeaseRequest { holder: holder.into(), ttl_s, token: None }
    }

    #[test]
    fn a_lease_whose_answer_was_lost_is_had_by_asking_again() {
        let (desk, start) = (Desk::default(), Instant::now());
        let after = |s| start + Duration::from_secs(s);
        let named = |holder: &str, token: &str| LeaseRequest { token: Some(token.into()), ..ask(holder, 10) };
        let (lease, renewed) = desk.grant(start, named("loader", "mine"), None, "t1".into()).unwrap();
        assert_eq!((lease.token.as_str(), renewed), ("mine", false));
        let (again, renewed) = desk.grant(after(4), named("loader", "mine"), None, "t2".into()).unwrap();
        assert_eq!((again.token.as_str(), renewed), ("mine", true));
        assert!(desk.grant(after(5), named("other", "theirs"), None, "t3".into()).is_err());
        assert_eq!(desk.admit(after(13), Some("mine")), Ok(()), "its time began anew at 4 s");
        // A token of an ended lease must not bypass the present holder.
        desk.grant(after(15), named("other", "theirs"), None, "t4".into()).unwrap();
        assert!(desk.grant(after(16), named("loader", "mine"), None, "t5".into()).is_err());
        assert!(is_token("0123456789abcdef") && !is_token("0123456789abcde") && !is_token("0123456789abcde\n"));
    }

    #[test]
    fn one_client_commands_until_its_time_is_over() {
        let (desk, start) = (Desk::default(), Instant::now());
        let after = |s| start + Duration::from_secs(s);
        assert_eq!(desk.admit(start, None), Ok(()));
        let (lease, renewed) = desk.grant(start, ask("loader", 10), None, "t1".into()).unwrap();
        assert_eq!((lease.token.as_str(), renewed), ("t1", false));
        assert_eq!(desk.admit(after(9), Some("t1")), Ok(()));
        let locked = Err(Refused::Locked { holder: "loader".into(), left: Duration::from_secs(4) });
        assert_eq!(desk.admit(after(6), None), locked);
        assert_eq!(desk.admit(after(6), Some("t0")), locked);
        assert!(desk.grant(after(6), ask("loader", 10), None, "t2".into()).is_err(), "a name is no token");
        assert!(desk.release(after(6), None).is_err());
        assert!(desk.grant(after(6), ask("loader", 10), Some("t1"), "t2".into()).unwrap().1);
        assert_eq!(desk.admit(after(15), Some("t1")), Ok(()), "renewed at 6 s for 10 s");
        assert_eq!(desk.admit(after(16), Some("t1")), Err(Refused::Over));
        assert_eq!(desk.admit(after(16), None), Ok(()));
        let (next, _) = desk.grant(after(17), ask("other", 10), Some("t1"), "t3".into()).unwrap();
        assert_eq!(next.token, "t3", "a token is not used twice");
        assert!(matches!(desk.admit(after(18), Some("t1")), Err(Refused::Locked { .. })));
        desk.release(after(18), Some("t3")).unwrap();
        desk.release(after(18), Some("t3")).unwrap();
        assert_eq!(desk.status(after(18)), LeaseStatus::default());
    }
}
