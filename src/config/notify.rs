//! Where notices are sent.

use super::private::{self, PrivateFileError};
use axum::http::Uri;
use carved_core::range::{Range, Ranged, in_schema};
use carved_core::ranges;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// The certificates that the system trusts, by Debian's package ca-certificates.
const SYSTEM_CERTIFICATES: &str = "/etc/ssl/certs/ca-certificates.crt";
/// Minimum length of the secret of signatures.
const SECRET_BYTES: usize = 16;

/// The `[notify]` table of a configuration.
#[derive(Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub struct NotifySettings {
    /// Address that gets a POST request for each notice, such as `https://ntfy.sh/TOPIC`.
    #[serde(default)]
    pub url: Option<String>,
    /// File with the address, instead of `url`, if the address is a secret, as that of Slack; readable by the daemon alone (mode 0600).
    #[serde(default)]
    pub url_file: Option<PathBuf>,
    /// Address of the instrument's page as people reach it, such as `http://vast-1.lab:8420/`. Notices link to it. If it is left out, they
    /// have no link.
    #[serde(default)]
    pub page_url: Option<String>,
    /// The form of the body.
    #[serde(default)]
    pub format: NotifyFormat,
    /// File with the secret of the signature (HMAC-SHA256) that each request carries; readable by the daemon alone (mode 0600). If it is
    /// left out, requests are not signed.
    #[serde(default)]
    pub secret_file: Option<PathBuf>,
    /// File with the bearer token that the receiver asks for; readable by the daemon alone (mode 0600).
    #[serde(default)]
    pub token_file: Option<PathBuf>,
    /// File with the certificates (PEM) that an https receiver may have. If it is left out, these are the certificates of the system.
    #[serde(default)]
    pub ca_file: Option<PathBuf>,
    /// Time that the receiver has for its answer.
    #[serde(default = "timeout_s")]
    #[schemars(extend("x-level" = "expert"))]
    pub timeout_s: f64,
}

fn timeout_s() -> f64 {
    10.0
}

/// The form of the body of a notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NotifyFormat {
    /// Everything that carved knows, as JSON.
    #[default]
    Json,
    /// The JSON of ntfy. The last part of the address is the topic.
    Ntfy,
    /// The JSON of an incoming webhook of Slack, which Mattermost and others take too.
    Slack,
}

impl Ranged for NotifySettings {
    const RANGES: &'static [Range<Self>] = ranges![timeout_s: 0.1, 60.0, "s";];
}

/// The address may be a secret.
impl fmt::Debug for NotifySettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NotifySettings").field("format", &self.format).finish_non_exhaustive()
    }
}

/// Why notices cannot be sent with these settings.
#[derive(Debug, thiserror::Error)]
pub enum NotifySettingsError {
    #[error("notify: expected one of url and url_file")]
    OneAddress,
    #[error("notify.{key}: {expected}. The address is not repeated here, because it may be a secret")]
    Address { key: &'static str, expected: &'static str },
    #[error("notify.{key}: {source}")]
    File { key: &'static str, source: PrivateFileError },
    #[error(
        "notify.secret_file: the secret has {found} characters, at least {SECRET_BYTES} are needed. Make one with `openssl rand -hex 32`"
    )]
    Secret { found: usize },
    #[error("notify.token_file: expected a token of printable characters without blanks")]
    Token,
    #[error("notify.ca_file: cannot read {}: {why}. Install the package ca-certificates, or name a file of certificates", path.display())]
    Certificates { path: PathBuf, why: std::io::Error },
    #[error("notify.url: this carved was built without TLS (feature `tls`); only http addresses can be used")]
    NoTls,
}

/// A receiver with its secrets.
#[derive(Clone)]
pub struct Receiver {
    pub url: Uri,
    /// Address of the instrument's page.
    pub page: Option<Uri>,
    pub format: NotifyFormat,
    pub secret: Option<String>,
    pub token: Option<String>,
    /// Certificates in PEM that an https receiver may have. `None` for http.
    pub certificates: Option<Vec<u8>>,
    pub timeout: Duration,
}

impl Receiver {
    /// The address as it may be shown: without its path, which may be a secret.
    pub fn shown(&self) -> String {
        let port = self.url.port().map(|port| format!(":{port}"));
        format!("{}://{}{}", self.url.scheme_str().unwrap_or_default(), self.url.host().unwrap_or_default(), port.unwrap_or_default())
    }
}

impl NotifySettings {
    /// Reads the secrets.
    ///
    /// # Errors
    /// The first setting that prevents sending.
    pub fn receiver(&self) -> Result<Receiver, NotifySettingsError> {
        let secret_of = |key, path: &Option<PathBuf>| {
            path.as_deref().map(private::read).transpose().map_err(|source| NotifySettingsError::File { key, source })
        };
        let (key, url) = match (&self.url, secret_of("url_file", &self.url_file)?) {
            (Some(url), None) => ("url", url.clone()),
            (None, Some(url)) => ("url_file", url),
            _ => return Err(NotifySettingsError::OneAddress),
        };
        let url = address(&url, self.format).map_err(|expected| NotifySettingsError::Address { key, expected })?;
        let page = self.page_url.as_deref().map(|url| address(url, NotifyFormat::Json)).transpose();
        let page = page.map_err(|expected| NotifySettingsError::Address { key: "page_url", expected })?;
        let secret = secret_of("secret_file", &self.secret_file)?;
        if let Some(found) = secret.as_ref().map(String::len).filter(|found| *found < SECRET_BYTES) {
            return Err(NotifySettingsError::Secret { found });
        }
        let token = secret_of("token_file", &self.token_file)?;
        if token.as_ref().is_some_and(|token| token.is_empty() || !token.bytes().all(|b| b.is_ascii_graphic())) {
            return Err(NotifySettingsError::Token);
        }
        let certificates = if url.scheme_str() == Some("https") { Some(self.certificates()?) } else { None };
        Ok(Receiver { url, page, format: self.format, secret, token, certificates, timeout: Duration::from_secs_f64(self.timeout_s) })
    }

    fn certificates(&self) -> Result<Vec<u8>, NotifySettingsError> {
        if !cfg!(feature = "tls") {
            return Err(NotifySettingsError::NoTls);
        }
        let path = self.ca_file.clone().unwrap_or_else(|| SYSTEM_CERTIFICATES.into());
        carved_files::read(&path).map_err(|why| NotifySettingsError::Certificates { path, why })
    }
}

/// Reads an address.
///
/// # Errors
/// What was expected.
fn address(text: &str, format: NotifyFormat) -> Result<Uri, &'static str> {
    let uri: Uri = text.parse().map_err(|_| "expected an address such as https://HOST/PATH")?;
    if !matches!(uri.scheme_str(), Some("http" | "https")) || uri.host().is_none_or(str::is_empty) {
        return Err("expected an address such as https://HOST/PATH");
    }
    if uri.authority().is_some_and(|authority| authority.as_str().contains('@')) {
        return Err("expected an address without a name and a password before the host; put a token into token_file");
    }
    if format == NotifyFormat::Ntfy && uri.path().trim_matches('/').is_empty() {
        return Err("expected an address that ends with the topic of ntfy, such as https://ntfy.sh/TOPIC");
    }
    Ok(uri)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> NotifySettings {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn an_address_that_cannot_be_used_is_refused_and_not_repeated() {
        for wrong in ["hooks.slack.com/services/T0SECRET", "ftp://h/T0SECRET", "http://kim:T0SECRET@h/", "http:///T0SECRET", "not T0SECRET"]
        {
            let error = of(&format!("url = {wrong:?}")).receiver().err().unwrap();
            assert!(matches!(error, NotifySettingsError::Address { key: "url", .. }), "{wrong}: {error}");
            assert!(!error.to_string().contains("T0SECRET"), "{error}");
        }
        assert!(of("url = \"http://h/\"\nformat = \"ntfy\"").receiver().is_err(), "no topic");
        for wrong in ["", "url = \"http://h/\"\nurl_file = \"/dev/null\"", "url = \"http://h/\"\npage_url = \"vast-1.lab\""] {
            assert!(of(wrong).receiver().is_err(), "{wrong}");
        }
        let settings = of("url = \"http://h:81/services/T0SECRET\"\nformat = \"slack\"");
        assert_eq!(settings.receiver().unwrap().shown(), "http://h:81");
        assert!(!format!("{settings:?}").contains("T0SECRET"));
    }

    #[test]
    fn secrets_come_from_private_files() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str, mode| {
            let path = dir.path().join(name);
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            path.display().to_string()
        };
        let key = "k".repeat(SECRET_BYTES);
        let with = |path: &str| of(&format!("url = \"http://h/\"\nsecret_file = {path:?}")).receiver();
        assert_eq!(with(&file("good", &format!("{key}\n"), 0o600)).unwrap().secret.unwrap(), key, "the line's end is no part of it");
        assert!(matches!(with(&file("open", &key, 0o644)), Err(NotifySettingsError::File { key: "secret_file", .. })));
        assert!(matches!(with(&file("short", "k", 0o600)), Err(NotifySettingsError::Secret { found: 1 })));
        assert!(matches!(with("/nonexistent"), Err(NotifySettingsError::File { .. })));
        let url = file("url", "http://hooks/services/x\n", 0o600);
        assert_eq!(of(&format!("url_file = {url:?}")).receiver().unwrap().url, "http://hooks/services/x");
    }
}
