//! `GET /docs/api`: the contract as one HTML page without scripts, for labs without internet access.

use super::AppState;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::Value;
use std::fmt::Write;

const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'";
const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1c2430}\
code,pre{font-family:ui-monospace,monospace}pre{background:#f3f5f8;padding:.75rem;overflow:auto}\
h2{margin-top:2rem;border-top:1px solid #d5dbe3;padding-top:1rem;font-size:1.1rem}table{border-collapse:collapse}\
td{padding:.15rem .75rem .15rem 0;vertical-align:top}";

/// The contract as a page.
#[utoipa::path(get, path = "/docs/api", tag = "contract", responses((status = 200, description = "HTML", body = String, content_type = "text/html")))]
pub(super) async fn get(State(app): State<AppState>) -> Response {
    let headers = [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CONTENT_SECURITY_POLICY, POLICY)];
    (headers, app.docs.clone()).into_response()
}

pub(super) fn render(contract: &Value) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>carved: HTTP contract</title><style>{STYLE}</style>\
         <h1>HTTP contract</h1><p>{}</p><p>For programs: <a href=\"/openapi.json\"><code>/openapi.json</code></a>.</p>",
        text(&contract["info"]["description"])
    );
    for (path, item) in contract["paths"].as_object().into_iter().flatten() {
        for (method, operation) in item.as_object().into_iter().flatten() {
            // Writing to a String cannot fail.
            let _infallible = render_operation(&mut page, path, method, operation);
        }
    }
    page.push_str("<h2>Types</h2>");
    for (name, schema) in contract["components"]["schemas"].as_object().into_iter().flatten() {
        let shown = serde_json::to_string_pretty(schema).unwrap_or_default();
        let _infallible = write!(page, "<h3 id=\"{0}\"><code>{0}</code></h3><pre>{1}</pre>", escape(name), escape(&shown));
    }
    page
}

fn render_operation(page: &mut String, path: &str, method: &str, operation: &Value) -> std::fmt::Result {
    write!(page, "<h2><code>{} {}</code></h2>", escape(&method.to_uppercase()), escape(path))?;
    write!(page, "<p>{}</p><p>{}</p>", text(&operation["summary"]), text(&operation["description"]))?;
    page.push_str("<table>");
    for parameter in operation["parameters"].as_array().into_iter().flatten() {
        let (name, place) = (text(&parameter["name"]), text(&parameter["in"]));
        write!(page, "<tr><td><code>{name}</code><td>{place}: {}", text(&parameter["description"]))?;
    }
    if let Some(body) = operation.get("requestBody") {
        write!(page, "<tr><td>body<td>{}", types(body))?;
    }
    for (status, response) in operation["responses"].as_object().into_iter().flatten() {
        write!(page, "<tr><td><code>{}</code><td>{} {}", escape(status), text(&response["description"]), types(response))?;
    }
    page.push_str("</table>");
    Ok(())
}

/// The content types of a body, with links to its schema.
fn types(body: &Value) -> String {
    let one = |(kind, content): (&String, &Value)| {
        let name = content["schema"]["$ref"].as_str().and_then(|r| r.rsplit('/').next()).map(escape);
        let link = name.map(|name| format!(" <a href=\"#{name}\"><code>{name}</code></a>")).unwrap_or_default();
        format!("(<code>{}</code>{link})", escape(kind))
    };
    body["content"].as_object().into_iter().flatten().map(one).collect()
}

fn text(value: &Value) -> String {
    escape(value.as_str().unwrap_or_default())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
