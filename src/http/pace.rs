//! Limits the rate of commands per client with one token bucket per address and one token per command. Reading is not counted. Aborts and
//! emergency stops are never delayed.
//!
//! The crate `governor` is not used: it brings a concurrent map, a clock and timers in place of the twenty lines of [`Pace`].

use super::AppState;
use super::access::changes_something;
use super::problem::Problem;
use axum::extract::{MatchedPath, Request, State};
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// The address of the client of a connection.
#[derive(Debug, Clone, Copy)]
pub(super) struct Peer(pub IpAddr);

/// Number of remembered addresses, above which those with a full bucket are forgotten.
const REMEMBERED: usize = 1024;

struct Bucket {
    tokens: f64,
    filled: Instant,
}

/// The buckets of all clients that have sent commands recently.
pub(super) struct Pace {
    per_s: f64,
    burst: f64,
    buckets: Mutex<HashMap<IpAddr, Bucket>>,
}

impl Pace {
    pub(super) fn new(per_minute: u32, burst: u32) -> Self {
        Self { per_s: f64::from(per_minute) / 60.0, burst: f64::from(burst), buckets: Mutex::default() }
    }

    fn filled(&self, bucket: &Bucket, now: Instant) -> f64 {
        (bucket.tokens + now.duration_since(bucket.filled).as_secs_f64() * self.per_s).min(self.burst)
    }

    /// Takes a token, or returns the seconds until there is one.
    fn take(&self, now: Instant, client: IpAddr) -> Result<(), u32> {
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if buckets.len() >= REMEMBERED {
            buckets.retain(|_, bucket| self.filled(bucket, now) < self.burst);
        }
        let bucket = buckets.entry(client).or_insert(Bucket { tokens: self.burst, filled: now });
        let tokens = self.filled(bucket, now);
        let enough = tokens >= 1.0;
        *bucket = Bucket { tokens: if enough { tokens - 1.0 } else { tokens }, filled: now };
        if enough { Ok(()) } else { Err((((1.0 - tokens) / self.per_s).ceil() as u32).max(1)) }
    }
}

/// Commands that are never delayed.
const ALWAYS: [&str; 2] = ["/v1/emergency-stop", "/v1/runs/{run_id}/abort"];

/// Whether a route's commands are counted.
pub(super) fn counts(route: &str) -> bool {
    route.starts_with("/v1/") && !ALWAYS.contains(&route)
}

pub(super) async fn check(State(app): State<AppState>, request: Request, next: Next) -> Response {
    let counted = request.extensions().get::<MatchedPath>().is_some_and(|route| counts(route.as_str()));
    let client = request.extensions().get::<Peer>().map(|peer| peer.0);
    if let Some(client) = client.filter(|_| counted && changes_something(request.method()))
        && let Err(seconds) = app.pace.take(Instant::now(), client)
    {
        let detail =
            format!("too many commands from {client}; the next is taken in {seconds} s. Follow the status instead of repeating commands");
        return Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_commands", detail).come_back_after(seconds).into_response();
    }
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_burst_passes_and_then_one_command_per_refill() {
        let (pace, start) = (Pace::new(30, 3), Instant::now());
        let (a, b): (IpAddr, IpAddr) = ([127, 0, 0, 1].into(), [10, 0, 0, 7].into());
        let after = |ms| start + Duration::from_millis(ms);
        for _burst in 0..3 {
            assert_eq!(pace.take(start, a), Ok(()));
        }
        assert_eq!(pace.take(start, a), Err(2), "30 per minute is one in 2 s");
        assert_eq!(pace.take(start, b), Ok(()), "another client has a bucket of its own");
        assert_eq!(pace.take(after(1500), a), Err(1));
        assert_eq!(pace.take(after(2000), a), Ok(()));
        assert_eq!(pace.take(after(2000), a), Err(2));
        let later = after(3_600_000);
        for _burst in 0..3 {
            assert_eq!(pace.take(later, a), Ok(()));
        }
        assert!(pace.take(later, a).is_err(), "a long rest saves up no more than the burst");
    }

    #[test]
    fn clients_that_rest_are_forgotten() {
        let (pace, start) = (Pace::new(60, 2), Instant::now());
        for n in 0..REMEMBERED as u32 {
            assert_eq!(pace.take(start, std::net::Ipv4Addr::from(n).into()), Ok(()));
        }
        pace.take(start + Duration::from_secs(10), [192, 168, 0, 1].into()).unwrap();
        assert_eq!(pace.buckets.lock().unwrap().len(), 1);
    }
}
