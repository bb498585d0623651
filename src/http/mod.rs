//! The HTTP server for the plate-loader, the operator's page, the CLI and Prometheus.
//!
//! ```text
//! TCP ─> accept loop (serve) ─> count ─> headers ─> access ─> pace ─> lease ─> route ─> SessionHandle ─> driver
//!        slots, head timeout     metrics            Host,              status, runs, events,          │
//!        joined at the end                          Origin,            live, health, page       <─────┘ snapshots
//!                                                   token
//! ```
//! Nothing here touches hardware. Only `results` and old events read the disk, on threads of their own. Reads come from the session's
//! snapshots. Commands go to its mailbox and are answered after the driver has handled them. Every error is a [`Problem`]. The contract is
//! generated from the handlers and served as `/openapi.json`.

#![allow(clippy::result_large_err, reason = "a problem is made once per refused request and goes straight out")]

mod access;
mod body;
mod conditional;
mod docs;
mod events;
mod fault_codes;
mod health;
mod lease;
mod linger;
mod live;
mod methods;
mod metrics;
mod openapi;
mod pace;
mod page;
#[cfg(feature = "testing")]
pub mod parsers;
mod plate;
mod plate_maps;
mod problem;
mod proxy;
mod queue;
mod results;
mod runs;
mod safety;
mod serve;
mod status;
mod stay;
mod stored;

pub use page::setup as setup_page;
pub use problem::Problem;
pub use serve::{HttpError, bind, serve, serve_routes};

use crate::config::{Guard, HttpSettings};
use crate::session::SessionHandle;
use crate::session::replays::Replays;
use axum::body::Bytes;
use axum::extract::Request;
use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::Response;
use axum::routing::get;
use axum::{Router, http::Uri};
use carved_store::StoreReader;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, watch};
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;
use tower_http::cors::{AllowOrigin, CorsLayer};

/// The state that all handlers share.
struct App {
    session: SessionHandle,
    /// Wells that are measured again.
    replays: Arc<Replays>,
    reader: StoreReader,
    /// Slots for requests that read the disk.
    reading: Semaphore,
    /// Slots for downloads of runs.
    downloading: Arc<Semaphore>,
    /// Whose turn it is to take a picture at rest.
    picturing: tokio::sync::Mutex<()>,
    /// Slots for answers that stay open.
    staying: stay::Stay,
    guard: Guard,
    body_timeout: Duration,
    /// The schemas of the contract by name, for the explanation of wrong bodies.
    schemas: serde_json::Value,
    contract: Bytes,
    docs: Bytes,
    requests: metrics::Requests,
    lease: lease::Desk,
    pace: pace::Pace,
    /// Becomes true when the server must end. Streams and long polls then end.
    closing: watch::Receiver<bool>,
}

type AppState = Arc<App>;

/// Resolves when the server must end.
async fn closed(mut closing: watch::Receiver<bool>) {
    // An error means that the server itself was dropped, which is also an end.
    let _ended = closing.wait_for(|closing| *closing).await;
}

fn router(
    session: SessionHandle,
    replays: Arc<Replays>,
    reader: StoreReader,
    settings: &HttpSettings,
    guard: Guard,
    closing: watch::Receiver<bool>,
) -> Router {
    let (routes, contract) = openapi::routes().split_for_parts();
    let contract = openapi::complete(&contract);
    let app = Arc::new(App {
        session,
        replays,
        reader,
        reading: Semaphore::new(results::AT_A_TIME),
        downloading: Arc::new(Semaphore::new(results::DOWNLOADS)),
        picturing: tokio::sync::Mutex::default(),
        staying: stay::Stay::new(settings.max_connections),
        guard,
        body_timeout: settings.body_timeout(),
        schemas: contract["components"]["schemas"].clone(),
        docs: docs::render(&contract).into(),
        contract: contract.to_string().into(),
        requests: metrics::Requests::default(),
        lease: lease::Desk::default(),
        pace: pace::Pace::new(settings.commands_per_minute, settings.command_burst),
        closing,
    });
    let routes = routes
        .route("/docs/", get(page::docs))
        .fallback(page::asset)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(from_fn(conditional::check))
        .layer(from_fn_with_state(app.clone(), lease::check))
        .layer(from_fn_with_state(app.clone(), pace::check))
        .layer(from_fn_with_state(app.clone(), access::check))
        .layer(from_fn(secure_headers))
        .layer(from_fn_with_state(app.clone(), metrics::count));
    let routes = if settings.wall_origins.is_empty() { routes } else { routes.layer(walls(&settings.wall_origins)) };
    let proxies: Arc<[IpAddr]> = settings.trusted_proxies.as_slice().into();
    let routes = if proxies.is_empty() { routes } else { routes.layer(from_fn_with_state(proxies, proxy::look_through)) };
    routes.layer(CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(is_json)).with_state(app)
}

/// The status may be read by the page of several instruments, which another daemon serves. A browser asks first, without a token.
fn walls(origins: &[String]) -> CorsLayer {
    let origins = origins.to_vec();
    let may_read = move |origin: &HeaderValue, request: &axum::http::request::Parts| {
        request.uri.path() == "/v1/status" && origins.iter().any(|listed| listed.as_bytes() == origin.as_bytes())
    };
    CorsLayer::new().allow_origin(AllowOrigin::predicate(may_read)).allow_methods([Method::GET]).allow_headers([header::AUTHORIZATION])
}

/// Whether an answer is compressed for a client that takes it: the status of a plate of 1536 wells has half a MB. Pictures and models are
/// compressed already, and an event must not wait in a buffer.
fn is_json(_: StatusCode, _: axum::http::Version, headers: &HeaderMap, _: &axum::http::Extensions) -> bool {
    headers.get(header::CONTENT_TYPE).is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"))
}

/// Puts the access rules and the headers of the daemon before other routes. A token protects what is below `/v1/`.
pub fn guarded(routes: Router, guard: Guard) -> Router {
    routes.layer(from_fn_with_state(Arc::new(guard), access::check_guard)).layer(from_fn(secure_headers))
}

async fn method_not_allowed(method: Method, uri: Uri) -> Problem {
    let detail = format!("{} does not take {method}; the Allow header lists what it takes", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "method_not_allowed", detail)
}

/// Adds headers to every answer unless its handler has set them: no caching, no framing, and no guessing of the type.
async fn secure_headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let defaults: [(HeaderName, &str); 6] = [
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in defaults {
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}
