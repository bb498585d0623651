//! The server's routes without a connection, for tests that feed them requests of any kind.

use super::pace::Peer;
use super::router;
use crate::config::HttpSettings;
use crate::session::replays::Replays;
use crate::session::{Driver, channel};
use axum::Router;
use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use carved_records::Mode;
use carved_store::{Claim, Store};
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;
use std::net::{IpAddr, Ipv4Addr};
use std::path::Path;
use tokio::runtime::Runtime;
use tokio::sync::watch;

/// Where the requests come from.
const PROXY: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

/// The routes of a daemon that has ended its driver: requests are read and checked, and none has an effect.
pub struct Requests {
    runtime: Runtime,
    service: TowerToHyperService<Router>,
}

impl Requests {
    /// Routes over the data folder `root`, which is made where it does not exist.
    ///
    /// # Errors
    /// The folder or a thread cannot be made.
    pub fn new(root: &Path) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (store, _, _) = Store::open(Claim::on(root)?)?;
        let (session, _, _) = channel(Driver::first_status(Mode::Simulated, String::new()), Vec::new());
        // The list of addresses that a proxy forwards is read, too.
        let settings = HttpSettings { trusted_proxies: vec![PROXY], ..HttpSettings::default() };
        // Streams and long polls end at once.
        let (_, closing) = watch::channel(true);
        let guard = settings.guard(settings.listen)?;
        let routes = router(session.clone(), Replays::new(session), store.reader(), &settings, guard, closing);
        Ok(Self { runtime, service: TowerToHyperService::new(routes) })
    }

    /// The status of the answer to a request: its method and address on the first line, a header on each further line, and the body after an
    /// empty line. `None` if this is no request of HTTP.
    pub fn answer(&self, bytes: &[u8]) -> Option<StatusCode> {
        let request = request(bytes)?;
        self.runtime.block_on(self.service.call(request)).ok().map(|answer| answer.status())
    }
}

fn request(bytes: &[u8]) -> Option<Request<Body>> {
    let end = bytes.windows(2).position(|two| two == b"\n\n").unwrap_or(bytes.len());
    let mut lines = bytes[..end].split(|byte| *byte == b'\n');
    let mut first = lines.next()?.splitn(2, |byte| *byte == b' ');
    let method = Method::from_bytes(first.next()?).ok()?;
    let mut request = Request::builder().method(method).uri(first.next()?);
    for line in lines {
        let colon = line.iter().position(|byte| *byte == b':')?;
        request = request.header(&line[..colon], line[colon + 1..].trim_ascii());
    }
    request.extension(Peer(PROXY)).body(Body::from(bytes.get(end + 2..).unwrap_or_default().to_vec())).ok()
}
