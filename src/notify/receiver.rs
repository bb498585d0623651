//! One delivery: a signed POST request, and what the answer means.

use super::Notice;
use crate::config::{NotifyFormat, Receiver};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;
use ureq::http::StatusCode;

/// The time of the signature, s since 1970.
const TIMESTAMP: &str = "Carved-Timestamp";
/// HMAC-SHA256 of the timestamp, a full stop and the body.
const SIGNATURE: &str = "Carved-Signature";
/// The `id` of the notice, for receivers whose format has no place for it.
const ID: &str = "Carved-Notice";

/// Why a notice was not delivered. No text contains the path of the address, which may be a secret.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum Undelivered {
    /// Another attempt may succeed.
    #[error("{0}")]
    Unreachable(String),
    #[error("it answered {status}")]
    Busy { status: u16, retry_after: Option<Duration> },
    /// Another attempt will not succeed.
    #[error("it refused the notice with {status}: {}", meaning(*status))]
    Refused { status: u16 },
}

fn meaning(status: u16) -> &'static str {
    match status {
        300..=399 => "it names another address; put that one into the configuration",
        401 | 403 => "check token_file and secret_file",
        404 | 410 => "check the path of the address",
        _ => "check address and format",
    }
}

impl Undelivered {
    pub(super) fn is_final(&self) -> bool {
        matches!(self, Self::Refused { .. })
    }

    /// The pause that the receiver asks for.
    pub(super) fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Busy { retry_after, .. } => *retry_after,
            _ => None,
        }
    }
}

/// A receiver, ready for requests.
pub struct Agent {
    http: ureq::Agent,
    receiver: Receiver,
    /// The address of requests.
    url: String,
    topic: String,
    /// The address of the instrument's page.
    page: Option<String>,
}

impl Agent {
    /// Nothing is sent yet.
    ///
    /// # Errors
    /// The certificates of an https receiver cannot be used.
    pub fn new(receiver: Receiver) -> anyhow::Result<Self> {
        let config = ureq::Agent::config_builder().http_status_as_error(false).max_redirects(0).max_idle_connections(0);
        #[cfg(feature = "tls")]
        let config = match &receiver.certificates {
            Some(pem) => config.tls_config(tls(pem)?),
            None => config,
        };
        let (url, topic) = match receiver.format {
            NotifyFormat::Ntfy => of_ntfy(&receiver.url.to_string()),
            NotifyFormat::Json | NotifyFormat::Slack => (receiver.url.to_string(), String::new()),
        };
        let page = receiver.page.as_ref().map(ToString::to_string);
        Ok(Self { http: config.build().into(), receiver, url, topic, page })
    }

    /// The receiver's address without its path.
    pub fn shown(&self) -> String {
        self.receiver.shown()
    }

    /// The time that the receiver has for its answer.
    pub fn timeout(&self) -> Duration {
        self.receiver.timeout
    }

    /// Sends a notice once.
    ///
    /// # Errors
    /// The receiver did not take it.
    pub fn deliver(&self, notice: &Notice, within: Duration) -> Result<StatusCode, Undelivered> {
        let body = notice.body(self.receiver.format, &self.topic, self.page.as_deref()).to_string();
        let mut request = self.http.post(&self.url).config().timeout_global(Some(within.max(Duration::from_millis(1)))).build();
        request = request.content_type("application/json").header(ID, &notice.id);
        if let Some(secret) = &self.receiver.secret {
            let timestamp = jiff::Timestamp::now().as_second();
            request = request.header(TIMESTAMP, timestamp.to_string()).header(SIGNATURE, signature(secret, timestamp, &body));
        }
        if let Some(token) = &self.receiver.token {
            request = request.header("Authorization", format!("Bearer {token}"));
        }
        let answer = request.send(body.as_bytes()).map_err(|error| Undelivered::Unreachable(plainly(&error)))?;
        let status = answer.status();
        let retry_after = answer.headers().get("Retry-After").and_then(|value| value.to_str().ok()?.parse().ok().map(Duration::from_secs));
        match status.as_u16() {
            200..=299 => Ok(status),
            408 | 425 | 429 | 500..=599 => Err(Undelivered::Busy { status: status.as_u16(), retry_after }),
            status => Err(Undelivered::Refused { status }),
        }
    }

    /// Connects to the receiver and sends nothing.
    ///
    /// # Errors
    /// Nothing answers at its address.
    pub(super) fn probe(&self) -> Result<(), Undelivered> {
        let url = &self.receiver.url;
        let port = url.port_u16().unwrap_or(if url.scheme_str() == Some("https") { 443 } else { 80 });
        let host = url.host().unwrap_or_default().trim_matches(['[', ']']);
        let addresses = (host, port).to_socket_addrs().map_err(|e| Undelivered::Unreachable(format!("its name is not known: {e}")))?;
        let mut last = Undelivered::Unreachable("its name has no address".into());
        for address in addresses {
            match TcpStream::connect_timeout(&address, self.receiver.timeout) {
                Ok(_) => return Ok(()),
                Err(e) => last = Undelivered::Unreachable(format!("nothing answers there: {e}")),
            }
        }
        Err(last)
    }
}

/// `sha256=` and the HMAC-SHA256 of `TIMESTAMP.BODY` in hexadecimal digits.
fn signature(secret: &str, timestamp: i64, body: &str) -> String {
    // HMAC takes keys of any length.
    let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(secret.as_bytes()) else { return String::new() };
    mac.update(format!("{timestamp}.{body}").as_bytes());
    let digits: String = mac.finalize().into_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
    format!("sha256={digits}")
}

/// The root of a server of ntfy, and the topic.
fn of_ntfy(url: &str) -> (String, String) {
    let url = url.trim_end_matches('/');
    url.rsplit_once('/').map_or_else(|| (url.to_owned(), String::new()), |(root, topic)| (format!("{root}/"), topic.to_owned()))
}

/// The error without the address.
fn plainly(error: &ureq::Error) -> String {
    match error {
        ureq::Error::Timeout(_) => "it did not answer in time".into(),
        ureq::Error::HostNotFound => "its name is not known".into(),
        ureq::Error::ConnectionFailed => "nothing answers there".into(),
        // rustls reports a certificate that is not trusted in this way.
        ureq::Error::Io(e) if e.kind() == ErrorKind::InvalidData => format!("no secure connection: {e}"),
        ureq::Error::Io(e) => format!("the connection failed: {e}"),
        ureq::Error::ConnectProxyFailed(_) | ureq::Error::InvalidProxyUrl => "the proxy of the environment does not connect".into(),
        _ => "it did not answer as an HTTP server does".into(),
    }
}

/// Trusts these certificates (PEM).
#[cfg(feature = "tls")]
fn tls(pem: &[u8]) -> anyhow::Result<ureq::tls::TlsConfig> {
    use ureq::tls::{PemItem, RootCerts, TlsConfig, TlsProvider, parse_pem};
    let certificates: Vec<_> = parse_pem(pem)
        .filter_map(|item| match item {
            Ok(PemItem::Certificate(certificate)) => Some(certificate),
            _ => None,
        })
        .collect();
    anyhow::ensure!(!certificates.is_empty(), "notify: the file of certificates holds none; expected PEM");
    let provider = std::sync::Arc::new(rustls::crypto::ring::default_provider());
    let config = TlsConfig::builder().provider(TlsProvider::Rustls).root_certs(RootCerts::new_with_certs(&certificates));
    Ok(config.unversioned_rustls_crypto_provider(provider).build())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signature_covers_time_and_body() {
        // printf '1700000000.{"a":1}' | openssl dgst -sha256 -hmac 'a secret of the lab'
        let expected = "sha256=514ba19969c344750bd309d5b277487196d252288f7f40c2459ce6fc297df7ec";
        assert_eq!(signature("a secret of the lab", 1_700_000_000, "{\"a\":1}"), expected);
        assert_ne!(signature("a secret of the lab", 1_700_000_001, "{\"a\":1}"), expected);
    }

    #[test]
    fn the_last_part_of_an_address_of_ntfy_is_the_topic() {
        for (url, root, topic) in [("https://ntfy.sh/lab", "https://ntfy.sh/", "lab"), ("http://h:80/n/lab/", "http://h:80/n/", "lab")] {
            assert_eq!(of_ntfy(url), (root.to_owned(), topic.to_owned()));
        }
    }
}
