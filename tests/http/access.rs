//! Access control. The routes are read from the served contract, so that none is forgotten.

use crate::rig::{PLAN, Rig, settings};
use crate::wire::{PATIENCE, exchange};
use carved::config::{HttpSettings, HttpSettingsError};
use carved::http::{HttpError, serve};
use carved::session::channel;
use carved_store::StoreReader;
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;

/// Every operation of the contract, with its parameters filled in.
fn operations(rig: &Rig) -> Vec<(String, String)> {
    let paths = rig.contract()["paths"].as_object().unwrap();
    let fill = |path: &String| path.replace("{run_id}", "r").replace("{well}", "A01").replace("{view}", "0.png").replace("{seq}", "1");
    paths.iter().flat_map(|(p, item)| item.as_object().unwrap().keys().map(move |m| (m.to_uppercase(), fill(p)))).collect()
}

fn mutating(rig: &Rig) -> Vec<(String, String)> {
    let all: Vec<_> = operations(rig).into_iter().filter(|(method, _)| method != "GET").collect();
    assert!(all.len() >= 3, "{all:?}");
    all
}

const JSON: (&str, &str) = ("Content-Type", "application/json");

/// A file that only this process reads.
fn private(text: &str) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o600)).unwrap();
    file.write_all(text.as_bytes()).unwrap();
    file
}

#[test]
fn the_token_of_a_wall_reads_and_commands_nothing() {
    let (token, read) = (private(&"k".repeat(32)), private(&"r".repeat(32)));
    let tokens = HttpSettings { token_file: Some(token.path().into()), read_token_file: Some(read.path().into()), ..settings() };
    let rig = Rig::with(tokens, Vec::new());
    let bearer = format!("Bearer {}", "r".repeat(32));
    assert_eq!(rig.send("GET", "/v1/status", &[("Authorization", &bearer)], "").status, 200);
    assert_eq!(rig.send("GET", "/v1/status", &[("Authorization", "Bearer rrr")], "").status, 401);
    for (method, path) in mutating(&rig) {
        let answer = rig.send(&method, &path, &[JSON, ("Authorization", &bearer)], PLAN);
        assert_eq!((answer.status, answer.problem().as_str()), (403, "read_only"), "{method} {path}");
    }
    assert_eq!(*rig.commands.lock().unwrap(), [""; 0]);
}

#[test]
fn the_status_alone_is_read_by_pages_of_the_listed_origins_alone() {
    let rig = Rig::with(HttpSettings { wall_origins: vec!["http://wall:8420".into()], ..settings() }, Vec::new());
    let allowed = |method: &str, path: &str, origin: &str| {
        let answer = crate::wire::exchange(
            rig.address,
            format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nOrigin: {origin}\r\nAccess-Control-Request-Method: GET\r\n\r\n")
                .as_bytes(),
        );
        answer.header("access-control-allow-origin").map(str::to_owned)
    };
    for method in ["GET", "OPTIONS"] {
        assert_eq!(allowed(method, "/v1/status", "http://wall:8420").as_deref(), Some("http://wall:8420"), "{method}");
        assert_eq!(allowed(method, "/v1/status", "http://evil.example"), None, "{method}");
        assert_eq!(allowed(method, "/v1/runs", "http://wall:8420"), None, "{method}");
    }
    let answer = rig.send("POST", "/v1/emergency-stop", &[("Origin", "http://wall:8420")], "");
    assert_eq!((answer.status, answer.problem().as_str()), (403, "wrong_origin"), "it reads only");
    let closed = Rig::start();
    let answer = closed.send("GET", "/v1/status", &[("Origin", "http://wall:8420")], "");
    assert_eq!(answer.header("access-control-allow-origin"), None);
}

#[test]
fn no_attack_reaches_the_driver_on_any_mutating_route() {
    let rig = Rig::start();
    let port = rig.address.port();
    let own = rig.address.to_string();
    let attacks: Vec<(&str, Vec<(&str, String)>)> = vec![
        ("wrong_host", vec![("Host", "evil.example".into())]),
        // DNS rebinding: the name of the hostile page resolves to this machine, so Host and Origin agree.
        ("wrong_host", vec![("Host", format!("evil.example:{port}")), ("Origin", format!("http://evil.example:{port}"))]),
        ("wrong_host", vec![("Host", format!("localhost.evil.example:{port}"))]),
        ("wrong_host", vec![("Host", "localhost@evil.example".into())]),
        ("wrong_host", vec![("Host", format!("evil@localhost:{port}"))]),
        ("wrong_host", vec![("Host", "localhost".into()), ("Host", "evil.example".into())]),
        ("wrong_host", vec![("Host", String::new())]),
        ("wrong_host", vec![("Host", "[::1".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", "http://evil.example".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", "null".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", String::new())]),
        // A page of another program on this machine has another origin.
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", "http://127.0.0.1:1".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", format!("ftp://{own}"))]),
        ("wrong_origin", vec![("Host", own.clone()), ("Origin", format!("http://{own}")), ("Origin", "http://evil.example".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Sec-Fetch-Site", "cross-site".into())]),
        ("wrong_origin", vec![("Host", own.clone()), ("Sec-Fetch-Site", "same-site".into())]),
    ];
    for (method, path) in mutating(&rig) {
        for (code, attack) in &attacks {
            let mut headers: Vec<(&str, &str)> = attack.iter().map(|(name, value)| (*name, value.as_str())).collect();
            headers.push(JSON);
            let answer = rig.send(&method, &path, &headers, PLAN);
            assert_eq!((answer.status, answer.problem().as_str()), (403, *code), "{method} {path} {attack:?}");
        }
    }
    assert!(rig.commands.lock().unwrap().is_empty(), "an attack reached the driver");
}

#[test]
fn the_host_list_stands_in_front_of_everything() {
    let rig = Rig::start();
    let unknown = [("GET".to_owned(), "/nowhere".to_owned()), ("DELETE".to_owned(), "/v1/status".to_owned())];
    for (method, path) in operations(&rig).into_iter().chain(unknown) {
        let answer = rig.send(&method, &path, &[("Host", "evil.example")], "");
        assert_eq!((answer.status, answer.problem().as_str()), (403, "wrong_host"), "{method} {path}");
    }
    let absolute = exchange(rig.address, b"GET http://evil.example/v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert_eq!(absolute.problem(), "wrong_host");
    let none = exchange(rig.address, b"GET /v1/status HTTP/1.0\r\n\r\n");
    assert_eq!(none.problem(), "wrong_host");
}

#[test]
fn the_names_of_this_machine_and_of_the_list_are_answered() {
    let rig = Rig::with(HttpSettings { allowed_hosts: vec!["carved.lab".into()], ..settings() }, Vec::new());
    for host in ["localhost", "LOCALHOST:8420", "127.0.0.1", "[::1]:99", "carved.lab", "Carved.Lab:443"] {
        assert_eq!(rig.send("GET", "/v1/status", &[("Host", host)], "").status, 200, "{host}");
    }
    let page = [("Host", "carved.lab"), ("Origin", "https://carved.lab"), ("Sec-Fetch-Site", "same-origin"), JSON];
    assert_eq!(rig.send("PUT", "/v1/runs/r", &page, PLAN).status, 201);
}

fn with_token(token: &str) -> (Rig, tempfile::NamedTempFile) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o600)).unwrap();
    writeln!(file, "{token}").unwrap();
    (Rig::with(HttpSettings { token_file: Some(file.path().into()), ..settings() }, Vec::new()), file)
}

#[test]
fn a_token_is_asked_for_wherever_the_contract_says_so() {
    let token = "0123456789abcdef0123456789abcdef";
    let (rig, _file) = with_token(token);
    let wrong = [
        String::new(),
        format!("Bearer {}", &token[..31]),
        format!("Bearer {token}0"),
        format!("Bearer {}", token.to_uppercase()),
        format!("Basic {token}"),
        token.to_owned(),
        "Bearer ".to_owned(),
    ];
    let mut asked = 0;
    for (method, path) in operations(&rig) {
        let pattern = path
            .replace("/runs/r", "/runs/{run_id}")
            .replace("/queue/r", "/queue/{run_id}")
            .replace("/A01", "/{well}")
            .replace("/0.png", "/{view}");
        let pattern = pattern.replace("/faults/1", "/faults/{seq}");
        let secured = rig.contract()["paths"][&pattern][method.to_lowercase()].get("security").is_some();
        if !secured {
            let status = rig.send(&method, &path, &[], "").status;
            assert!(method == "GET" && [200, 303].contains(&status), "{method} {path}: {status}");
            continue;
        }
        asked += 1;
        for value in &wrong {
            let headers = if value.is_empty() { vec![JSON] } else { vec![JSON, ("Authorization", value.as_str())] };
            let answer = rig.send(&method, &path, &headers, PLAN);
            assert_eq!((answer.status, answer.problem().as_str()), (401, "unauthorized"), "{method} {path} {value:?}");
            assert_eq!(answer.header("www-authenticate"), Some("Bearer"));
        }
        if path != "/v1/events" {
            let right = format!("bearer {token}");
            let answer = rig.send(&method, &path, &[JSON, ("Authorization", &right)], PLAN);
            assert_ne!(answer.status, 401, "{method} {path}");
        }
    }
    assert!(asked >= 9, "{asked}");
    assert!(mutating(&rig).iter().all(|(_, path)| path.starts_with("/v1/")), "what changes something stands under /v1");
    assert_eq!(rig.send("POST", "/", &[], "").status, 401, "an unknown command is asked for a token too");
}

#[test]
fn refuses_to_serve_other_machines_without_a_token() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let open = std::net::TcpListener::bind(SocketAddr::from(([0, 0, 0, 0], 0))).unwrap();
    let (session, _mailbox, _driver) = channel(crate::rig::status(), Vec::new());
    let serving = serve(open, session, StoreReader::new("nowhere".as_ref()), settings(), std::future::pending());
    let refused = runtime.block_on(async { tokio::time::timeout(PATIENCE, serving).await }).expect("it serves");
    assert!(matches!(refused, Err(HttpError::Settings(HttpSettingsError::TokenMandatory { .. }))), "{refused:?}");
}
