//! The settings of the server, and the checks before its port is opened.

use super::private::{self, PrivateFileError};
use carved_core::range::{OutOfRange, Range, Ranged, in_schema};
use carved_core::ranges;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

/// The `[http]` table of a configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(transform = in_schema::<Self>)]
#[serde(default, deny_unknown_fields)]
pub struct HttpSettings {
    /// Address to listen on. Outside loopback a `token_file` is mandatory.
    pub listen: SocketAddr,
    /// Host names under which clients may address the instrument, besides the loopback names and the address it listens on.
    pub allowed_hosts: Vec<String>,
    /// File with the bearer token that every client must send; readable by the daemon alone (mode 0600). Write the whole path: a
    /// relative one begins in the working directory of the daemon.
    pub token_file: Option<PathBuf>,
    /// File with a second token, with which a client reads and commands nothing; as `token_file`. It is for displays on a wall.
    pub read_token_file: Option<PathBuf>,
    /// Origins of pages that may read the status of this instrument in a browser, as `"http://10.0.0.5:8420"`: the address at which the
    /// page of several instruments is opened. They command nothing.
    pub wall_origins: Vec<String>,
    /// Addresses of reverse proxies before this daemon, as `"127.0.0.1"`. What they forward counts as sent by the client that they name last in
    /// `X-Forwarded-For`: in the events of a run, and for the rate of commands. Without an entry the header is not read, because any client can
    /// write it.
    pub trusted_proxies: Vec<IpAddr>,
    /// Deadline for the head of a request, ms. A client that reads nothing of its answer for so long is cut too.
    #[schemars(extend("x-level" = "expert"))]
    pub head_timeout_ms: u64,
    /// Deadline for the body of a request, ms.
    #[schemars(extend("x-level" = "expert"))]
    pub body_timeout_ms: u64,
    /// Maximum number of simultaneous connections. More connections wait until one is free. At most half of them may be event streams and
    /// long polls.
    #[schemars(extend("x-level" = "expert"))]
    pub max_connections: usize,
    /// Commands that one address may send per minute on average. Reading is not counted.
    #[schemars(extend("x-level" = "expert"))]
    pub commands_per_minute: u32,
    /// Commands that one address may send at once after a pause.
    #[schemars(extend("x-level" = "expert"))]
    pub command_burst: u32,
    /// Time for open requests to end after a shutdown request, ms.
    #[schemars(extend("x-level" = "expert"))]
    pub drain_ms: u64,
}

impl Default for HttpSettings {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 8420)),
            allowed_hosts: Vec::new(),
            token_file: None,
            read_token_file: None,
            wall_origins: Vec::new(),
            trusted_proxies: Vec::new(),
            // Schedulers back off to one poll in 5 s, and the same timer limits the pause between two requests of a connection. The value
            // is therefore above 5 s, and below the 10 s after which a slow client must be dropped.
            head_timeout_ms: 8_000,
            body_timeout_ms: 8_000,
            // 1000 polling clients and 2000 slow ones leave connections for the operator.
            max_connections: 4_096,
            // A loader sends a few commands per well, each of which takes seconds. A page sends one per click.
            commands_per_minute: 600,
            command_burst: 100,
            // The whole daemon must end within 5 s.
            drain_ms: 2_000,
        }
    }
}

/// Minimum length of a token: a shorter one could be guessed.
const TOKEN_BYTES: usize = 32;

/// Why nothing can be served with these settings.
#[derive(Debug, thiserror::Error)]
pub enum HttpSettingsError {
    #[error(
        "http: refuses to listen on {listen}, which other machines reach, without a bearer token. Listen on 127.0.0.1, or make one \
         (`openssl rand -hex 32 > token; chmod 600 token`) and name it as token_file in [http] (`carved setup`: with --token-file)"
    )]
    TokenMandatory { listen: SocketAddr },
    #[error("http: token_file: {0}")]
    TokenFile(PrivateFileError),
    #[error(
        "http: the token in {} has {found} characters, at least {TOKEN_BYTES} printable ones without blanks are needed. Make one with `openssl rand -hex 32`",
        path.display()
    )]
    TokenWeak { path: PathBuf, found: usize },
    #[error("http: {name:?} in allowed_hosts is not a bare host name; write it without scheme, port or path")]
    AllowedHost { name: String },
    #[error("http: read_token_file: without token_file everybody may command; make a token for commands first, and name it as token_file")]
    ReadTokenAlone,
    #[error("http: read_token_file: it has the token of token_file, with which everything can be commanded; make another one")]
    SameTokens,
    #[error("http: {found:?} in wall_origins is no origin; write scheme, host and port without a path, as \"http://10.0.0.5:8420\"")]
    WallOrigin { found: String },
    #[error("http.{0}")]
    Number(OutOfRange),
}

impl Ranged for HttpSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        head_timeout_ms: 10.0, 600_000.0, "ms";
        body_timeout_ms: 10.0, 600_000.0, "ms";
        drain_ms: 0.0, 600_000.0, "ms";
        commands_per_minute: 1.0, 60_000.0, "commands";
        command_burst: 1.0, 10_000.0, "commands";
        max_connections: 1.0, 65_536.0, "connections";
    ];
}

impl HttpSettings {
    /// All breaches except numbers out of range. The port is not opened.
    pub(super) fn check(&self) -> Vec<HttpSettingsError> {
        let hosts = self.allowed_hosts.iter().filter_map(|name| bare(name).err());
        let origins = self.wall_origins.iter().filter_map(|origin| bare_origin(origin).err());
        self.tokens(self.listen).err().into_iter().chain(hosts).chain(origins).collect()
    }

    /// The token that clients of a listener at `local` must send, and that with which they only read. `None` if no token is required.
    fn tokens(&self, local: SocketAddr) -> Result<(Option<String>, Option<String>), HttpSettingsError> {
        let token = self.token_file.clone().map(read_token).transpose()?;
        if token.is_none() && !local.ip().is_loopback() {
            return Err(HttpSettingsError::TokenMandatory { listen: local });
        }
        let read = self.read_token_file.clone().map(read_token).transpose()?;
        match (&token, &read) {
            (None, Some(_)) => Err(HttpSettingsError::ReadTokenAlone),
            (Some(token), Some(read)) if token == read => Err(HttpSettingsError::SameTokens),
            _ => Ok((token, read)),
        }
    }

    /// The access rules, checked for a listener at `local`.
    ///
    /// # Errors
    /// The first setting that prevents serving.
    pub fn guard(&self, local: SocketAddr) -> Result<Guard, HttpSettingsError> {
        if let Some(breach) = self.outside().into_iter().next() {
            return Err(HttpSettingsError::Number(breach));
        }
        let (token, read_token) = self.tokens(local)?;
        self.wall_origins.iter().try_for_each(|origin| bare_origin(origin))?;
        let mut hosts: BTreeSet<String> = ["localhost", "127.0.0.1", "[::1]"].map(String::from).into();
        if !local.ip().is_unspecified() {
            hosts.insert(host_of(local.ip()));
        }
        for name in &self.allowed_hosts {
            bare(name)?;
            hosts.insert(name.to_ascii_lowercase());
        }
        Ok(Guard { hosts, token, read_token })
    }

    /// Time that a client has to send a request's body.
    pub fn body_timeout(&self) -> Duration {
        Duration::from_millis(self.body_timeout_ms)
    }
}

/// The accepted hosts, and the required token.
#[derive(Debug, Clone)]
pub struct Guard {
    pub hosts: BTreeSet<String>,
    pub token: Option<String>,
    /// The token of clients that only read.
    pub read_token: Option<String>,
}

/// An address in the format of a `Host` header.
fn host_of(ip: IpAddr) -> String {
    match ip {
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    }
}

/// Refuses a host name with a scheme, port, path or wildcard.
fn bare(name: &str) -> Result<(), HttpSettingsError> {
    let authority = name.parse::<axum::http::uri::Authority>();
    let bare = authority.is_ok_and(|a| a.host() == name && a.port().is_none() && !name.contains('*'));
    if bare { Ok(()) } else { Err(HttpSettingsError::AllowedHost { name: name.to_owned() }) }
}

/// Refuses an origin that no browser sends, and a wildcard.
fn bare_origin(origin: &str) -> Result<(), HttpSettingsError> {
    let host = origin.split_once("://").filter(|(scheme, _)| matches!(*scheme, "http" | "https")).map(|(_, rest)| rest);
    let is_bare = host.is_some_and(|host| {
        let authority = host.parse::<axum::http::uri::Authority>();
        authority.is_ok_and(|a| a.as_str() == host && !host.contains(['*', '@']) && !host.chars().any(char::is_uppercase))
    });
    if is_bare { Ok(()) } else { Err(HttpSettingsError::WallOrigin { found: origin.to_owned() }) }
}

fn read_token(path: PathBuf) -> Result<String, HttpSettingsError> {
    let token = private::read(&path).map_err(HttpSettingsError::TokenFile)?;
    if token.len() < TOKEN_BYTES || !token.bytes().all(|b| b.is_ascii_graphic()) {
        return Err(HttpSettingsError::TokenWeak { path, found: token.len() });
    }
    Ok(token)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;

    fn token_file(text: &str, mode: u32) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        file.as_file().set_permissions(std::fs::Permissions::from_mode(mode)).unwrap();
        file
    }

    #[test]
    fn may_listen_off_loopback_only_with_a_token() {
        let open = HttpSettings { listen: SocketAddr::from(([0, 0, 0, 0], 0)), ..HttpSettings::default() };
        let error = open.guard(open.listen).unwrap_err();
        assert!(matches!(error, HttpSettingsError::TokenMandatory { .. }));
        assert!(error.to_string().contains("token_file"), "{error}");
        let file = token_file(&"k".repeat(32), 0o600);
        HttpSettings { token_file: Some(file.path().into()), ..open.clone() }.guard(open.listen).unwrap();
        HttpSettings::default().guard(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
    }

    #[test]
    fn a_token_that_others_can_read_or_guess_is_refused() {
        let with = |file: &tempfile::NamedTempFile| HttpSettings { token_file: Some(file.path().into()), ..HttpSettings::default() };
        let local = SocketAddr::from(([127, 0, 0, 1], 1));
        let exposed = token_file(&"k".repeat(32), 0o640);
        assert!(matches!(with(&exposed).guard(local), Err(HttpSettingsError::TokenFile(PrivateFileError::Exposed { mode: 0o640, .. }))));
        for weak in ["", "short", &format!("{} {}", "k".repeat(20), "k".repeat(20))] {
            let file = token_file(weak, 0o600);
            assert!(matches!(with(&file).guard(local), Err(HttpSettingsError::TokenWeak { .. })), "{weak:?}");
        }
        let both = |read: &tempfile::NamedTempFile| {
            let token = token_file(&"k".repeat(32), 0o600);
            HttpSettings { token_file: Some(token.path().into()), read_token_file: Some(read.path().into()), ..HttpSettings::default() }
                .guard(local)
        };
        assert!(matches!(both(&token_file(&"k".repeat(32), 0o600)), Err(HttpSettingsError::SameTokens)));
        assert_eq!(both(&token_file(&"r".repeat(32), 0o600)).unwrap().read_token.unwrap(), "r".repeat(32));
        let alone = token_file(&"r".repeat(32), 0o600);
        let alone = HttpSettings { read_token_file: Some(alone.path().into()), ..HttpSettings::default() };
        assert!(matches!(alone.guard(local), Err(HttpSettingsError::ReadTokenAlone)));
        for wrong in ["*", "http://*", "10.0.0.5:8420", "http://wall/", "ftp://wall", "http://a@wall", "http://Wall"] {
            let settings = HttpSettings { wall_origins: vec![wrong.into()], ..HttpSettings::default() };
            assert!(matches!(settings.guard(local), Err(HttpSettingsError::WallOrigin { .. })), "{wrong}");
        }
        let gone = HttpSettings { token_file: Some("/nonexistent/token".into()), ..HttpSettings::default() };
        assert!(gone.guard(local).unwrap_err().to_string().contains("/nonexistent/token"));
        let good = token_file(&format!("{}\n", "k".repeat(32)), 0o600);
        assert_eq!(with(&good).guard(local).unwrap().token.unwrap(), "k".repeat(32), "the line's end is no part of it");
    }

    #[test]
    fn allowed_hosts_are_bare_names() {
        let with = |name: &str| {
            let settings = HttpSettings { allowed_hosts: vec![name.into()], ..HttpSettings::default() };
            settings.guard(SocketAddr::from(([127, 0, 0, 1], 1)))
        };
        assert!(with("Carved.lab").unwrap().hosts.contains("carved.lab"));
        for wrong in ["http://carved.lab", "carved.lab:80", "carved.lab/", "", "*", "a b", "me@carved.lab"] {
            assert!(with(wrong).is_err(), "{wrong}");
        }
    }
}
