//! The served description of the API, the page, and the headers of every answer.

use crate::rig::Rig;
use crate::strict;
use serde_json::Value;
use std::io::Read;

fn references(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            found.extend(fields.get("$ref").and_then(Value::as_str).map(str::to_owned));
            fields.values().for_each(|v| references(v, found));
        }
        Value::Array(items) => items.iter().for_each(|v| references(v, found)),
        _ => {}
    }
}

#[test]
fn the_contract_names_every_route_and_leads_nowhere_into_the_void() {
    let rig = Rig::start();
    let contract = rig.contract();
    assert!(contract["openapi"].as_str().unwrap().starts_with("3.1"));
    let routes: Vec<String> = contract["paths"]
        .as_object()
        .unwrap()
        .iter()
        .flat_map(|(path, item)| item.as_object().unwrap().keys().map(move |method| format!("{method} {path}")))
        .collect();
    let mut expected = vec![
        "delete /v1/lease",
        "delete /v1/queue/{run_id}",
        "get /",
        "get /docs",
        "get /docs/api",
        "get /livez",
        "get /metrics",
        "get /openapi.json",
        "get /readyz",
        "get /v1/events",
        "get /v1/fault-codes",
        "get /v1/lease",
        "get /v1/live/frame.jpg",
        "get /v1/live/mesh.glb",
        "get /v1/live/profile.png",
        "get /v1/methods",
        "get /v1/queue/{run_id}",
        "get /v1/runs",
        "get /v1/runs/{run_id}",
        "get /v1/runs/{run_id}/events",
        "get /v1/runs/{run_id}/files.tar",
        "get /v1/runs/{run_id}/groups.csv",
        "get /v1/runs/{run_id}/replays",
        "get /v1/runs/{run_id}/report.html",
        "get /v1/runs/{run_id}/shape.csv",
        "get /v1/runs/{run_id}/statistics",
        "get /v1/runs/{run_id}/table.csv",
        "get /v1/runs/{run_id}/specimens/{well}",
        "get /v1/runs/{run_id}/specimens/{well}/coloured.glb",
        "get /v1/runs/{run_id}/specimens/{well}/mesh.glb",
        "get /v1/runs/{run_id}/specimens/{well}/mesh.ply",
        "get /v1/runs/{run_id}/specimens/{well}/profiles/{view}",
        "get /v1/runs/{run_id}/specimens/{well}/{picture}",
        "get /v1/runs/{run_id}/specimens/{well}/views/{view}",
        "get /v1/status",
        "get /v1/table.csv",
        "get /v1/bead-gates",
        "post /v1/emergency-stop",
        "post /v1/faults/{seq}/acknowledge",
        "post /v1/live/picture",
        "post /v1/plate-maps/check",
        "post /v1/plate-maps/columns",
        "post /v1/preflight",
        "post /v1/runs/{run_id}/abort",
        "post /v1/runs/{run_id}/hold",
        "post /v1/runs/{run_id}/stop",
        "post /v1/runs/{run_id}/unhold",
        "put /v1/lease",
        "put /v1/plate/handoff",
        "put /v1/plate/handoff/aborted",
        "put /v1/plate/handoff/completed",
        "put /v1/plate/next",
        "put /v1/queue",
        "put /v1/queue/{run_id}",
        "put /v1/runs/{run_id}",
        "put /v1/runs/{run_id}/replays/{name}",
        "put /v1/runs/{run_id}/wells/{well}",
        "put /v1/runs/{run_id}/wells/{well}/note",
        "put /v1/runs/{run_id}/wells/{well}/redo",
        "put /v1/runs/{run_id}/wells/{well}/skip",
        "get /v1/runs/{run_id}/rest",
    ];
    expected.sort_unstable();
    let mut routes: Vec<&str> = routes.iter().map(String::as_str).collect();
    routes.sort_unstable();
    assert_eq!(routes, expected);

    let mut found = Vec::new();
    references(contract, &mut found);
    assert!(found.len() > 20);
    for reference in found {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(contract.pointer(pointer).is_some(), "{reference} leads nowhere");
    }
    let place = contract["components"]["schemas"]["WellStatus"]["properties"]["reference"].to_string();
    assert!(place.contains("#/components/schemas/ReferenceStatus"), "{place}");
    let put = &contract["paths"]["/v1/runs/{run_id}"]["put"];
    assert_eq!(put["requestBody"]["content"]["application/json"]["schema"]["$ref"], "#/components/schemas/RunPlan");
    assert_eq!(contract["components"]["schemas"]["RunPlan"]["additionalProperties"], false);
    for status in ["400", "401", "403", "409", "413", "415", "422", "503"] {
        let schema = &put["responses"][status]["content"]["application/problem+json"]["schema"]["$ref"];
        assert_eq!(schema, "#/components/schemas/Problem", "{status}");
    }
}

#[test]
fn an_answer_requires_what_is_always_written_and_a_request_what_must_be_sent() {
    let rig = Rig::start();
    let schemas = &rig.contract()["components"]["schemas"];
    let required = |name: &str| {
        let required = schemas[name]["required"].as_array().unwrap();
        required.iter().map(|field| field.as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let status = rig.get("/v1/status").json();
    let written: Vec<String> = status.as_object().unwrap().keys().cloned().collect();
    assert_eq!(required("Status"), written);
    assert_eq!(required("RotationStatus"), status["hardware"]["rotation"].as_object().unwrap().keys().cloned().collect::<Vec<_>>());
    assert_eq!(required("PlannedWell"), ["well"]);
    assert_eq!(required("Mistake"), ["detail"]);
}

#[test]
fn unknown_routes_and_methods_are_problems() {
    let rig = Rig::start();
    for path in ["/nowhere", "/v1", "/v1/", "/v1/status/", "/v2/status", "/../Cargo.toml", "/%2e%2e/Cargo.toml", "//", "/v1/runs/r/fold"] {
        for method in ["GET", "PUT", "POST", "DELETE"] {
            let answer = rig.send(method, path, &[], "");
            assert_eq!((answer.status, answer.problem().as_str()), (404, "unknown_route"), "{method} {path}");
        }
    }
    let wrong = rig.send("DELETE", "/v1/runs/r", &[], "");
    assert_eq!((wrong.header("allow"), wrong.problem().as_str()), (Some("PUT,GET,HEAD"), "method_not_allowed"));
    assert_eq!(wrong.status, 405);
    assert_eq!(rig.send("POST", "/v1/status", &[], "").header("allow"), Some("GET,HEAD"));
}

#[test]
fn the_description_is_readable_without_a_script_or_a_network() {
    let rig = Rig::start();
    let docs = rig.get("/docs/api");
    assert_eq!(docs.header("content-type"), Some("text/html; charset=utf-8"));
    let text = docs.text();
    for path in rig.contract()["paths"].as_object().unwrap().keys() {
        assert!(text.contains(path.as_str()), "{path}");
    }
    assert!(!text.contains("<script") && !text.contains("http://") && !text.contains("https://"));
    assert!(docs.header("content-security-policy").unwrap().starts_with("default-src 'none'"));
}

/// The page and the documentation are served to clients with and without gzip, and its links to pages and
/// pictures lead somewhere.
#[test]
fn the_documentation_is_served_without_a_network() {
    let rig = Rig::start();
    let first = rig.get("/docs");
    assert_eq!(first.status, 303);
    let slash = rig.get("/docs/");
    assert_eq!((slash.status, slash.header("location")), (303, first.header("location")));
    if !std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("web/dist/docs").is_dir() {
        assert_eq!(first.header("location"), Some("/docs/api"));
        return strict::cannot_run("the pages are not built: make web");
    }
    assert_eq!(first.header("location"), Some("/docs/index.html"));
    let mut seen = std::collections::BTreeSet::from(["index.html".to_owned()]);
    let mut waiting: Vec<String> = seen.iter().cloned().collect();
    while let Some(name) = waiting.pop() {
        let answer = rig.get(&format!("/docs/{name}"));
        assert_eq!(answer.status, 200, "{name}");
        let Some(text) = name.strip_suffix(".html").map(|_| answer.text()) else { continue };
        assert_eq!(answer.header("content-type"), Some("text/html; charset=utf-8"), "{name}");
        assert!(answer.header("content-security-policy").unwrap().contains("default-src 'self'"), "{name}");
        for link in ["href=\"", "src=\""].iter().flat_map(|attribute| text.split(attribute).skip(1)) {
            let link = link.split(['"', '#']).next().unwrap();
            let is_of_docs = !link.is_empty() && !link.starts_with('/') && !link.contains(':');
            if is_of_docs && seen.insert(link.to_owned()) {
                waiting.push(link.to_owned());
            }
        }
    }
    assert!(seen.contains("tutorial.html") && seen.contains("page.png") && seen.contains("docs.css"), "{seen:?}");
    for path in ["/", "/app.js", "/docs/index.html"] {
        let packed = rig.send("GET", path, &[("Accept-Encoding", "gzip")], "");
        assert_eq!((packed.status, packed.header("content-encoding")), (200, Some("gzip")), "{path}");
        let plain = rig.get(path);
        assert_eq!((plain.header("content-encoding"), plain.header("content-type")), (None, packed.header("content-type")), "{path}");
        let mut unpacked = Vec::new();
        flate2::read::GzDecoder::new(&packed.body[..]).read_to_end(&mut unpacked).unwrap();
        assert_eq!((unpacked, plain.body.is_empty()), (plain.body, false), "{path}");
    }
    assert_eq!(rig.get("/docs/index.html.gz").status, 404);
}

#[test]
fn the_page_is_served_with_a_policy_and_every_answer_with_its_headers() {
    let rig = Rig::start();
    let page = rig.get("/");
    assert_eq!((page.status, page.header("content-type")), (200, Some("text/html; charset=utf-8")));
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'self'") && policy.contains("frame-ancestors 'none'"), "{policy}");
    for answer in [page, rig.get("/v1/status"), rig.get("/nowhere"), rig.send("GET", "/", &[("Host", "evil.example")], "")] {
        assert_eq!(answer.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(answer.header("cross-origin-resource-policy"), Some("same-origin"));
        assert!(answer.header("cache-control").is_some());
        assert_eq!(answer.header("access-control-allow-origin"), None);
    }
}

#[test]
fn every_code_of_a_fault_is_reported_with_what_to_do() {
    let codes = Rig::start().get("/v1/fault-codes").json();
    assert!(codes.as_array().unwrap().len() > 10);
    let lost = codes.as_array().unwrap().iter().find(|c| c["code"] == "camera_lost").unwrap();
    assert_eq!((&lost["category"], &lost["scheduler_action"]), (&"camera".into(), &"pause_instrument".into()));
    assert!(lost["what_to_do"].as_str().unwrap().contains("cable"), "{lost}");
}
