//! HTTP requests to one daemon. Requests that may be repeated are repeated until the time limit, and `Retry-After` is honoured.

use crate::api::Status;
use crate::http::Problem;
use anyhow::{Context, bail};
use serde_json::Value;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use ureq::http::{Request, Response, StatusCode};

/// Address of the daemon and the credentials for it.
#[derive(Debug, clap::Args)]
pub struct Daemon {
    /// Address of the daemon.
    #[arg(long, default_value = "http://127.0.0.1:8420")]
    url: String,
    /// File with the daemon's bearer token, if the daemon requires one.
    #[arg(long)]
    token_file: Option<PathBuf>,
    /// Token of a lease that the caller holds (`PUT /v1/lease`).
    #[arg(long)]
    lease: Option<String>,
    /// Seconds for which a request is repeated if the daemon does not answer or asks for a later request.
    #[arg(long, default_value_t = 30)]
    patience_s: u16,
}

/// Why a request failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    #[error("{url} does not answer: {why}. Is the daemon running (`carved serve`, `carved simulate`), and --url right?")]
    Unreachable { url: String, why: ureq::Error },
    #[error("{} ({}, {})", .0.detail, .0.code, .0.status)]
    Refused(Box<Problem>),
    #[error("{url} answered {status} in a form that is not carved's; --url may lead to another program")]
    Strange { url: String, status: StatusCode },
}

pub struct Client {
    agent: ureq::Agent,
    url: String,
    authorization: Option<String>,
    lease: Option<String>,
    patience: Duration,
}

/// Duration of a long poll, s.
pub const POLL_S: u32 = 5;
const CONNECT: Duration = Duration::from_secs(5);
const ANSWER: Duration = Duration::from_secs(20);
/// Pauses between attempts, doubled from the first up to the last.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const LAST_PAUSE: Duration = Duration::from_secs(5);

/// Encodes a name as one segment of a path.
pub fn segment(name: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.' | b'~');
    name.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

impl Client {
    pub fn new(daemon: &Daemon) -> anyhow::Result<Self> {
        if !daemon.url.starts_with("http://") {
            bail!(
                "--url {:?} is not http://HOST:PORT; the daemon speaks plain HTTP (reach another machine's through an SSH tunnel)",
                daemon.url
            );
        }
        let token = daemon
            .token_file
            .as_ref()
            .map(|path| carved_files::read_to_string(path).with_context(|| format!("cannot read {}", path.display())));
        let agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_connect(Some(CONNECT))
            .timeout_global(Some(ANSWER))
            // A proxy of the environment is for the internet, not for an instrument on the local network.
            .proxy(None)
            .max_redirects(0)
            .build()
            .into();
        Ok(Self {
            agent,
            url: daemon.url.trim_end_matches('/').to_owned(),
            authorization: token.transpose()?.map(|token| format!("Bearer {}", token.trim())),
            lease: daemon.lease.clone(),
            patience: Duration::from_secs(daemon.patience_s.into()),
        })
    }

    fn once(&self, method: &str, path: &str, body: Option<&Value>) -> Result<Response<ureq::Body>, ureq::Error> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.url));
        for (name, value) in [("authorization", &self.authorization), ("carved-lease", &self.lease)] {
            if let Some(value) = value {
                request = request.header(name, value);
            }
        }
        match body {
            Some(body) => self.agent.run(request.header("content-type", "application/json").body(body.to_string())?),
            None if method == "GET" => self.agent.run(request.body(())?),
            None => self.agent.run(request.body(String::new())?),
        }
    }

    /// As [`Self::answer`], without the status of the answer.
    pub fn send(&self, method: &str, path: &str, body: Option<&Value>) -> Result<Value, Failure> {
        self.answer(method, path, body).map(|(_, value)| value)
    }

    /// Sends a request and returns the answer's status and JSON. Every request of this client may be repeated: commands lead towards a state, and the
    /// client chooses the name of a run.
    pub fn answer(&self, method: &str, path: &str, body: Option<&Value>) -> Result<(StatusCode, Value), Failure> {
        let until = Instant::now() + self.patience;
        let mut pause = FIRST_PAUSE;
        loop {
            let (failure, retry_after) = match self.once(method, path, body) {
                Err(why) => (Failure::Unreachable { url: self.url.clone(), why }, None),
                Ok(mut answer) => {
                    let status = answer.status();
                    let retry_after = answer
                        .headers()
                        .get("retry-after")
                        .and_then(|v| v.to_str().ok())
                        .and_then(|v| v.parse().ok())
                        .map(Duration::from_secs);
                    let text = answer.body_mut().read_to_string();
                    match text {
                        Err(why) => (Failure::Unreachable { url: self.url.clone(), why }, None),
                        Ok(text) => match judge(&self.url, status, &text) {
                            Ok(value) => return Ok((status, value)),
                            Err(failure) if matches!(status.as_u16(), 408 | 429 | 500 | 502 | 503 | 504) => (failure, retry_after),
                            Err(failure) => return Err(failure),
                        },
                    }
                }
            };
            let wait = retry_after.unwrap_or(pause);
            // A daemon may name a time that no clock of this computer reaches.
            if wait > until.saturating_duration_since(Instant::now()) {
                return Err(failure);
            }
            std::thread::sleep(wait);
            pause = (pause * 2).min(LAST_PAUSE);
        }
    }

    fn typed(&self, value: Value) -> anyhow::Result<Status> {
        serde_json::from_value(value)
            .with_context(|| format!("the status of {} is of another version of carved than this program's", self.url))
    }

    pub fn status(&self) -> anyhow::Result<Status> {
        self.typed(self.send("GET", "/v1/status", None)?)
    }

    /// Long-polls the status: returns it as soon as its revision is above `after`, or unchanged at the end of the poll.
    pub fn status_after(&self, after: u64) -> anyhow::Result<Status> {
        self.typed(self.send("GET", &format!("/v1/status?wait={POLL_S}&after={after}"), None)?)
    }
}

/// The JSON of an answer of the daemon at `url`, or why it refused.
pub(in crate::cli) fn judge(url: &str, status: StatusCode, text: &str) -> Result<Value, Failure> {
    let strange = || Failure::Strange { url: url.to_owned(), status };
    if status.is_success() {
        return serde_json::from_str(text).map_err(|_| strange());
    }
    let problem: Problem = serde_json::from_str(text).map_err(|_| strange())?;
    Err(Failure::Refused(Box::new(problem)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    #[test]
    fn a_pause_that_no_clock_reaches_is_not_waited_for() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let daemon = std::thread::spawn(move || {
            let (mut client, _) = listener.accept().unwrap();
            let mut head = Vec::new();
            while !head.ends_with(b"\r\n\r\n") {
                let mut byte = [0];
                client.read_exact(&mut byte).unwrap();
                head.extend(byte);
            }
            let answer = format!("HTTP/1.1 503 Service Unavailable\r\nRetry-After: {}\r\nContent-Length: 0\r\n\r\n", u64::MAX);
            client.write_all(answer.as_bytes()).unwrap();
        });
        let client = Client::new(&Daemon { url, token_file: None, lease: None, patience_s: 60 }).unwrap();
        assert!(matches!(client.send("GET", "/v1/status", None), Err(Failure::Strange { .. })));
        daemon.join().unwrap();
    }

    #[test]
    fn a_name_stays_one_segment() {
        assert_eq!(segment("P-1.a_2"), "P-1.a_2");
        assert_eq!(segment("../a b?"), "..%2Fa%20b%3F");
    }
}
