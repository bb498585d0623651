//! Notices over real HTTP: signatures, retries, order, receivers that refuse or never answer, TLS, and `carved notify test`.

use crate::common::receiver::{Receiver, Reply};
use crate::common::{carved, configured_text, stderr, until};
use carved::api::{Mode, RunOutcome, RunStatus, State, Status, WellCounts};
use carved::config::NotifySettings;
use carved::notify::{Counts, Notices};
use carved::session::Driver;
use sha2::{Digest, Sha256};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

const SECRET: &str = "a secret of the lab, told to nobody";

fn notices(url: &str, more: &str) -> Notices {
    let settings: NotifySettings = toml::from_str(&format!("url = {url:?}\n{more}")).unwrap();
    Notices::start(settings.receiver().unwrap()).unwrap()
}

fn secret_file(folder: &Path) -> String {
    let path = folder.join("secret");
    std::fs::write(&path, format!("{SECRET}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
    format!("secret_file = {:?}", path.display().to_string())
}

/// A run in this state.
fn run(state: State, outcome: Option<RunOutcome>) -> Status {
    let run = RunStatus {
        id: "r1".into(),
        external_id: None,
        method: "standard".into(),
        operator: "kim".into(),
        wells: WellCounts::default(),
        results: Vec::new(),
        started: String::new(),
        ended: None,
        eta_s: None,
        outcome,
        held_by_operator: false,
        goes_on_by_itself: false,
        hold: None,
    };
    Status { state, run: Some(run), mode: Mode::Hardware, ..Driver::first_status(carved_records::Mode::Hardware, "boot".into()) }
}

/// Shows a run that is held, goes on and is held again, this many times.
fn hold(notices: &Notices, times: usize) {
    for _ in 0..times {
        notices.see(&run(State::Execute, None));
        notices.see(&run(State::Held, None));
    }
}

/// HMAC-SHA256 by its definition (RFC 2104), apart from the code under test.
fn hmac(secret: &[u8], text: &[u8]) -> String {
    let mut key = [0u8; 64];
    key[..secret.len()].copy_from_slice(secret);
    let padded = |pad: u8| key.map(|byte| byte ^ pad);
    let inner = Sha256::digest([&padded(0x36)[..], text].concat());
    Sha256::digest([&padded(0x5c)[..], &inner[..]].concat()).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn notices_are_signed_and_come_in_their_order_also_after_failures() {
    let dir = tempfile::tempdir().unwrap();
    let receiver = Receiver::start(&[Reply::Status(500), Reply::Never, Reply::Status(200)]);
    let notices = notices(&format!("{}/hook", receiver.url), &format!("timeout_s = 3.0\n{}", secret_file(dir.path())));
    hold(&notices, 1);
    notices.see(&run(State::Complete, Some(RunOutcome::Partial)));
    let received = receiver.wait(4);
    let told: Vec<(String, String)> =
        received.iter().map(|r| (r.headers["carved-notice"].clone(), r.json()["event"].as_str().unwrap().to_owned())).collect();
    let of = |id: &str, event: &str| (id.to_owned(), event.to_owned());
    let [held, ended] = [of("boot-1", "run.held"), of("boot-2", "run.ended")];
    assert_eq!(told, [held.clone(), held.clone(), held, ended]);
    for request in &received {
        let (timestamp, body) = (&request.headers["carved-timestamp"], &request.body);
        let expected = hmac(SECRET.as_bytes(), format!("{timestamp}.{body}").as_bytes());
        assert_eq!(request.headers["carved-signature"], format!("sha256={expected}"));
        assert_eq!((request.path.as_str(), request.headers["content-type"].as_str()), ("/hook", "application/json"));
    }
    until("the deliveries to be counted", || notices.counts().delivered == 2);
    assert_eq!(notices.counts(), Counts { delivered: 2, failed_attempts: 2, ..Counts::default() });
    assert_eq!(notices.status().trouble, None, "a delivery ends the trouble");
}

#[test]
fn a_receiver_that_refuses_costs_its_notice_only_and_is_reported() {
    let receiver = Receiver::start(&[Reply::Status(404), Reply::Status(200)]);
    let notices = notices(&format!("{}/T0SECRET", receiver.url), "format = \"slack\"");
    hold(&notices, 1);
    until("the refusal", || notices.counts().dropped == 1);
    let trouble = notices.status().trouble.unwrap();
    assert!(trouble.contains(&receiver.url) && trouble.contains("404") && !trouble.contains("T0SECRET"), "{trouble}");
    hold(&notices, 1);
    until("the next notice", || notices.counts().delivered == 1);
    assert_eq!(receiver.received().len(), 2, "a refusal is final");
    assert_eq!(notices.status().trouble, None);
}

#[test]
fn a_receiver_that_never_answers_holds_nothing_up_and_fills_no_memory() {
    let receiver = Receiver::start(&[Reply::Never]);
    let notices = notices(&receiver.url, "timeout_s = 0.3");
    hold(&notices, 250);
    until("the failure", || notices.counts().is_failing);
    let Counts { delivered, dropped, waiting, .. } = notices.counts();
    assert_eq!((delivered, dropped + waiting as u64), (0, 250));
    assert!((100..=101).contains(&waiting), "{waiting}");
    assert!(notices.status().trouble.unwrap().contains("did not answer in time"));
    notices.close(Duration::from_millis(50));
}

#[test]
fn a_receiver_that_is_not_there_is_known_before_the_first_notice() {
    let nobody = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let notices = notices(&format!("http://{nobody}/"), "");
    until("the report", || notices.status().trouble.is_some_and(|trouble| trouble.contains("nothing answers there")));
    assert_eq!(notices.counts(), Counts { is_failing: true, ..Counts::default() });
}

#[cfg(feature = "tls")]
#[test]
fn an_https_receiver_is_trusted_by_its_certificate_only() {
    use rustls::pki_types::pem::PemObject;
    use rustls::pki_types::{CertificateDer, PrivateKeyDer};
    use std::sync::Arc;
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/commands/data");
    let chain = vec![CertificateDer::from_pem_file(data.join("receiver.pem")).unwrap()];
    let key = PrivateKeyDer::from_pem_file(data.join("receiver.key")).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let server = rustls::ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let server = Arc::new(server.with_no_client_auth().with_single_cert(chain, key).unwrap());
    let receiver = Receiver::with(&[Reply::Status(200)], move |stream| {
        Box::new(rustls::StreamOwned::new(rustls::ServerConnection::new(server.clone()).unwrap(), stream))
    });
    let url = receiver.url.replace("http://127.0.0.1", "https://localhost");
    let of = |file: &str| notices(&url, &format!("ca_file = {:?}", data.join(file).display().to_string()));
    let trusting = of("authority.pem");
    hold(&trusting, 1);
    until("the notice", || trusting.counts().delivered == 1);
    assert_eq!(receiver.received()[0].json()["event"], "run.held");
    // A certificate that no authority of this file has signed.
    let other = of("other-authority.pem");
    hold(&other, 1);
    until("the refusal", || other.counts().is_failing);
    let trouble = other.status().trouble.unwrap();
    assert!(trouble.contains("no secure connection"), "{trouble}");
    assert_eq!(receiver.received().len(), 1);
}

/// The command with the most talkative log, and nothing of it betrays a secret.
#[test]
fn a_test_notice_is_sent_and_no_secret_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("rig.toml");
    let command = |url: &str| {
        let page = "page_url = \"http://vast-1.lab:8420\"";
        let table = format!("[notify]\nurl = {url:?}\nformat = \"ntfy\"\n{page}\n{}\n\n[store]", secret_file(dir.path()));
        std::fs::write(&config, configured_text("vast-grbl.toml").replace("[store]", &table)).unwrap();
        let mut command = carved();
        command.env("CARVED_LOG", "trace").args(["notify", "test", "--config"]).arg(&config).output().unwrap()
    };
    let receiver = Receiver::start(&[Reply::Status(200), Reply::Status(403)]);
    let url = format!("{}/T0SECRET", receiver.url);
    let taken = command(&url);
    assert!(taken.status.success(), "{}", stderr(&taken));
    let body = receiver.received()[0].json();
    assert_eq!((&body["topic"], receiver.received()[0].path.as_str()), (&"T0SECRET".into(), "/"), "{body}");
    assert_eq!(body["click"], "http://vast-1.lab:8420/", "{body}");
    let refused = command(&url);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("403") && stderr(&refused).contains(&receiver.url), "{}", stderr(&refused));
    for output in [taken, refused] {
        let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
        assert!(!said.contains("T0SECRET") && !said.contains(SECRET), "{said}");
    }
    std::fs::write(&config, configured_text("vast-grbl.toml")).unwrap();
    let none = carved().args(["notify", "test", "--config"]).arg(&config).output().unwrap();
    assert!(!none.status.success() && stderr(&none).contains("[notify]"), "{}", stderr(&none));
}
