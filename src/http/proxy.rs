//! The client behind a reverse proxy.
//!
//! ```text
//! browser 10.0.0.9 ──> proxy 127.0.0.1 ──> daemon        X-Forwarded-For: 10.0.0.9
//! ```
//! Without `trusted_proxies` the header is not read: any client can write it.

use super::pace::Peer;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName};
use axum::middleware::Next;
use axum::response::Response;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// Replaces the address of a trusted proxy by that of its client.
pub(super) async fn look_through(State(trusted): State<Arc<[IpAddr]>>, mut request: Request, next: Next) -> Response {
    if let Some(Peer(peer)) = request.extensions().get::<Peer>().copied() {
        let client = client_of(peer, &trusted, request.headers());
        request.extensions_mut().insert(Peer(client));
    }
    next.run(request).await
}

/// Each proxy appends the address of its own client, so the list is read from its end, and only as far as trusted proxies wrote it. What
/// is no address ends the reading: the last proxy is then all that is known.
fn client_of(peer: IpAddr, trusted: &[IpAddr], headers: &HeaderMap) -> IpAddr {
    let lines: Vec<&str> = headers.get_all(FORWARDED_FOR).iter().map(|line| line.to_str().unwrap_or_default()).collect();
    let mut forwarded = lines.iter().flat_map(|line| line.split(',')).rev();
    let mut client = peer;
    while trusted.contains(&client) {
        let Some(before) = forwarded.next().and_then(address) else { break };
        client = before;
    }
    client
}

/// An address, with or without a port and brackets.
fn address(text: &str) -> Option<IpAddr> {
    let text = text.trim();
    let bare = text.trim_start_matches('[').trim_end_matches(']');
    let found = bare.parse::<IpAddr>().or_else(|_| text.parse::<SocketAddr>().map(|with_port| with_port.ip()));
    found.ok().map(|ip| ip.to_canonical())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn the_list_is_believed_as_far_as_trusted_proxies_wrote_it() {
        let client = |peer: &str, lines: &[&'static str]| {
            let headers = lines.iter().map(|line| (FORWARDED_FOR, HeaderValue::from_static(line))).collect();
            client_of(ip(peer), &[ip("127.0.0.1"), ip("10.0.0.2")], &headers)
        };
        assert_eq!(client("127.0.0.1", &["10.0.0.9"]), ip("10.0.0.9"));
        assert_eq!(client("127.0.0.1", &["10.0.0.9, 10.0.0.2"]), ip("10.0.0.9"), "two proxies");
        assert_eq!(client("127.0.0.1", &["10.0.0.9", "10.0.0.2"]), ip("10.0.0.9"), "two headers are one list");
        assert_eq!(client("127.0.0.1", &["6.6.6.6, 10.0.0.9"]), ip("10.0.0.9"), "the first one is what the client itself wrote");
        assert_eq!(client("10.0.0.9", &["127.0.0.1"]), ip("10.0.0.9"), "a client that is no proxy is not believed");
        for nothing in [&[][..], &[""], &["unknown"], &["10.0.0.9, _hidden"], &["10.0.0.999"]] {
            assert_eq!(client("127.0.0.1", nothing), ip("127.0.0.1"), "{nothing:?}");
        }
        assert_eq!(client("127.0.0.1", &["[2001:db8::7]:4711"]), ip("2001:db8::7"));
        assert_eq!(client("127.0.0.1", &["[2001:db8::7]"]), ip("2001:db8::7"));
        assert_eq!(client("127.0.0.1", &["::ffff:10.0.0.9"]), ip("10.0.0.9"));
        assert_eq!(client("127.0.0.1", &["10.0.0.9:51234"]), ip("10.0.0.9"));
    }
}
