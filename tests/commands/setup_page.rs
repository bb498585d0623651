//! The server of `carved setup --listen`: who may answer, what is refused, and how it ends. The page itself is tested in a browser.
#![cfg(feature = "aravis")]

use crate::common::{PATIENCE, carved, stderr};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

struct SetUp {
    child: Child,
    /// Kept open: what is printed has a reader.
    _out: BufReader<std::process::ChildStdout>,
    url: String,
    dir: tempfile::TempDir,
}

/// `carved setup` on an emulated rig, with a page.
fn command(dir: &tempfile::TempDir, listen: &str, more: &[&str]) -> Command {
    let mut command = carved();
    command.args(["setup", "--simulate", "--listen", listen, "--out"]).arg(dir.path().join("rig.toml")).args(more);
    command
}

impl SetUp {
    fn start(more: impl FnOnce(&tempfile::TempDir) -> Vec<String>) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let more = more(&dir);
        let more: Vec<&str> = more.iter().map(String::as_str).collect();
        let mut child = command(&dir, "127.0.0.1:0", &more).stdout(Stdio::piped()).spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let at = line.find("http://").unwrap_or_else(|| panic!("no address in {line:?}"));
        let url = line[at..].split_whitespace().next().unwrap().to_owned();
        Self { child, _out: out, url, dir }
    }

    /// The code and the answer to a request with these headers. `null` for an answer that is no JSON.
    fn ask(&self, path: &str, body: &Value, headers: &[(&str, &str)]) -> (u16, Value) {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE)).build().into();
        let url = format!("{}{path}", self.url);
        let mut answer = if body.is_null() {
            headers.iter().fold(agent.get(url), |request, (name, value)| request.header(*name, *value)).call().unwrap()
        } else {
            headers.iter().fold(agent.post(url), |request, (name, value)| request.header(*name, *value)).send_json(body).unwrap()
        };
        (answer.status().as_u16(), answer.body_mut().read_json().unwrap_or_default())
    }

    fn view(&self) -> Value {
        self.ask("/v1/setup", &Value::Null, &[]).1
    }

    /// Waits for a question whose number is above `above`. Gives its number.
    fn question(&self, id: &str, above: u64) -> u64 {
        let began = std::time::Instant::now();
        let mut view = self.view();
        while view["question"]["id"] != id || view["question"]["number"].as_u64().is_none_or(|number| number <= above) {
            assert!(began.elapsed() < PATIENCE, "waited in vain for {id}: {view}");
            view = self.ask(&format!("/v1/setup?after={}", view["revision"]), &Value::Null, &[]).1;
        }
        view["question"]["number"].as_u64().unwrap()
    }

    fn answer(&self, number: u64, answer: &str) -> (u16, Value) {
        self.ask("/v1/setup/answer", &json!({"number": number, "answer": answer}), &[])
    }
}

impl Drop for SetUp {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn an_answer_belongs_to_the_question_that_is_asked() {
    let mut setup = SetUp::start(|_| Vec::new());
    let first = setup.question("name", 0);
    assert_eq!(setup.ask("/v1/setup/picture.jpg", &Value::Null, &[]).0, 404);
    let (code, problem) = setup.answer(first, " ");
    assert_eq!((code, problem["code"].as_str()), (422, Some("refused")), "{problem}");
    // The refused question is asked again, under another number, before the refusal is told: the next answer is not late.
    let second = setup.view()["question"]["number"].as_u64().unwrap();
    assert_eq!(second, first + 1);
    assert_eq!(setup.answer(first, "late").0, 409);
    assert_eq!(setup.answer(second, "bench").0, 204);
    let port = setup.question("controller", 0);
    assert_eq!(setup.answer(second, "a second click").0, 409);
    assert_eq!(setup.view()["answers"], json!([{"title": "Name of the instrument", "answer": "bench"}]));
    for body in [json!({"number": port}), json!({"number": port, "answer": "x", "more": 1}), json!([])] {
        let (code, problem) = setup.ask("/v1/setup/answer", &body, &[]);
        assert_eq!((code, problem["code"].as_str()), (422, Some("not_an_answer")), "{problem}");
    }
    let (code, view) = setup.ask("/v1/setup/stop", &json!({}), &[]);
    assert_eq!((code, view["ended"]["is_done"].as_bool()), (200, Some(false)), "{view}");
    assert!(!setup.child.wait().unwrap().success());
    assert!(setup.dir.path().join("rig.setup.json").exists(), "the answers are kept");
}

#[test]
fn other_sites_and_other_machines_cannot_answer() {
    let setup = SetUp::start(|_| Vec::new());
    setup.question("name", 0);
    let foreign = [("origin", "http://elsewhere.example")];
    assert_eq!(setup.ask("/v1/setup/stop", &json!({}), &foreign).1["code"], "wrong_origin");
    assert_eq!(setup.ask("/v1/setup", &Value::Null, &[("host", "elsewhere.example")]).1["code"], "wrong_host");
    assert!(setup.view()["ended"].is_null(), "the set-up goes on");
    let dir = tempfile::tempdir().unwrap();
    let refused = command(&dir, "0.0.0.0:0", &[]).output().unwrap();
    assert!(!refused.status.success() && stderr(&refused).contains("without a bearer token"), "{}", stderr(&refused));
}

#[test]
fn a_token_protects_everything_but_the_page() {
    let token = "0123456789abcdef0123456789abcdef";
    let setup = SetUp::start(|dir| {
        use std::os::unix::fs::PermissionsExt;
        let file = dir.path().join("token");
        std::fs::write(&file, token).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        vec!["--token-file".into(), file.display().to_string()]
    });
    assert_eq!(setup.ask("/", &Value::Null, &[]).0, 200);
    assert_eq!(setup.ask("/app.js", &Value::Null, &[]).0, 404, "the operator's page is not served here");
    for path in ["/v1/setup", "/v1/setup/picture.jpg"] {
        assert_eq!(setup.ask(path, &Value::Null, &[]).0, 401, "{path}");
    }
    assert_eq!(setup.ask("/v1/setup/stop", &json!({}), &[]).0, 401);
    let bearer = format!("Bearer {token}");
    assert_eq!(setup.ask("/v1/setup", &Value::Null, &[("authorization", &bearer)]).0, 200);
}
