//! The contract. One list defines the routes and their descriptions, so that both always have the same entries.

use super::{
    AppState, access, docs, events, fault_codes, health, lease, live, methods, metrics, pace, page, plate, plate_maps, problem, queue,
    results, runs, safety, status, stored,
};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

#[derive(OpenApi)]
#[openapi(
    info(title = "carved", description = "The instrument as its plate-loader, its page and its operators' programs see it."),
    components(schemas(problem::Problem, carved_records::plate_map::MappedColumn))
)]
struct Contract;

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Contract::openapi())
        .routes(routes!(status::get))
        .routes(routes!(methods::get))
        .routes(routes!(runs::put))
        .routes(routes!(runs::hold))
        .routes(routes!(runs::unhold))
        .routes(routes!(runs::stop))
        .routes(routes!(runs::abort))
        .routes(routes!(runs::loaded))
        .routes(routes!(runs::skip))
        .routes(routes!(runs::redo))
        .routes(routes!(runs::note))
        .routes(routes!(lease::put, lease::get, lease::delete))
        .routes(routes!(safety::emergency_stop))
        .routes(routes!(safety::acknowledge))
        .routes(routes!(plate::handoff))
        .routes(routes!(plate::completed))
        .routes(routes!(plate::aborted))
        .routes(routes!(queue::order))
        .routes(routes!(queue::put, queue::get, queue::delete))
        .routes(routes!(queue::next))
        .routes(routes!(plate::preflight))
        .routes(routes!(events::get))
        .routes(routes!(fault_codes::get))
        .routes(routes!(plate_maps::check))
        .routes(routes!(plate_maps::columns))
        .routes(routes!(results::list))
        .routes(routes!(results::run))
        .routes(routes!(results::rest))
        .routes(routes!(results::report_of_run))
        .routes(routes!(results::bead_gates))
        .routes(routes!(results::events))
        .routes(routes!(results::run_files))
        .routes(routes!(results::replays))
        .routes(routes!(results::replay))
        .routes(routes!(results::specimen))
        .routes(routes!(results::mesh))
        .routes(routes!(results::model))
        .routes(routes!(results::coloured))
        .routes(routes!(results::standard))
        .routes(routes!(results::view))
        .routes(routes!(results::profile))
        .routes(routes!(results::tables::of_run))
        .routes(routes!(results::tables::shape_of_run))
        .routes(routes!(results::tables::groups_of_run))
        .routes(routes!(results::tables::of_runs))
        .routes(routes!(results::statistics::of_run))
        .routes(routes!(live::frame))
        .routes(routes!(live::profile))
        .routes(routes!(live::mesh))
        .routes(routes!(live::picture))
        .routes(routes!(health::live))
        .routes(routes!(health::ready))
        .routes(routes!(metrics::get))
        .routes(routes!(get))
        .routes(routes!(docs::get))
        .routes(routes!(page::docs))
        .routes(routes!(page::index))
}

/// This description.
#[utoipa::path(get, path = "/openapi.json", tag = "contract", responses((status = 200, description = "OpenAPI 3.1", body = Value, content_type = "application/json")))]
pub(super) async fn get(State(app): State<AppState>) -> Response {
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], app.contract.clone()).into_response()
}

/// Adds the answers of the layers, the body reader, the driver and the store to all operations. The answers that a handler declares itself
/// are kept.
pub(super) fn complete(contract: &utoipa::openapi::OpenApi) -> Value {
    let mut contract = serde_json::to_value(contract).unwrap_or_default();
    require_what_is_always_written(&mut contract);
    if let Some(schemas) = contract["components"]["schemas"].as_object_mut() {
        schemas.extend(stored::schemas());
    }
    contract["components"]["securitySchemes"] = json!({ "token": { "type": "http", "scheme": "bearer" } });
    for (path, item) in contract["paths"].as_object_mut().into_iter().flatten() {
        for (method, operation) in item.as_object_mut().into_iter().flatten() {
            let mut refusals = vec![("403", "The Host is not in the list, a page of another origin sent it, or the token only reads")];
            if !access::is_open(path) {
                operation["security"] = json!([{}, { "token": [] }]);
                refusals.push(("401", "The token that this instrument asks for is missing or wrong"));
            }
            let commands = matches!(method.as_str(), "put" | "post" | "delete");
            if commands && pace::counts(path) {
                refusals.push(("429", "Too many commands of one address; Retry-After says when the next is taken"));
            }
            if commands && lease::guards(path) {
                refusals.extend([
                    ("412", "The lease of the Carved-Lease token is over, or the command has an If-Match"),
                    ("423", "Another client has the lease: `lease` says who, and for how long"),
                ]);
            }
            if operation.get("requestBody").is_some() {
                refusals.extend([
                    ("400", "The body or the path is malformed"),
                    ("408", "The body did not arrive in time"),
                    ("413", "The body is too large"),
                    ("415", "The body is of a type that is not taken here"),
                    ("422", "Fields of the body are wrong: `errors` lists every one"),
                ]);
            }
            refusals.extend(by_kind(path, operation));
            for (status, description) in refusals {
                if operation["responses"].get(status).is_none() {
                    operation["responses"][status] = refusal(description);
                }
            }
        }
    }
    contract
}

/// serde writes every property of an answer, with `null` if there is no value. utoipa describes an `Option`, and a field with a default, as
/// a property that may be missing. A client would then have to handle both.
fn require_what_is_always_written(contract: &mut Value) {
    for (name, schema) in contract["components"]["schemas"].as_object_mut().into_iter().flatten() {
        // The schema of a request accepts no other properties, and states itself which ones are optional.
        let of_a_request = schema["additionalProperties"] == false;
        // In these types empty fields are omitted.
        if of_a_request || matches!(name.as_str(), "Problem" | "Mistake") {
            continue;
        }
        let Some(properties) = schema["properties"].as_object() else { continue };
        let always: Vec<String> = properties.keys().cloned().collect();
        schema["required"] = json!(always);
    }
}

/// Answers of the driver and the store: a command is written to the journal, a result is read from the disk.
fn by_kind(path: &str, operation: &Value) -> Vec<(&'static str, &'static str)> {
    let mut refusals = Vec::new();
    if operation["tags"][0] == "commands" && path != "/v1/lease" {
        refusals.extend([
            ("409", "The state does not accept it"),
            ("413", "A body larger than the command can need"),
            ("503", "The store, a device or the daemon cannot take it now"),
            ("507", "The disk is full"),
        ]);
        if path.starts_with("/v1/runs/{run_id}/") {
            refusals.push(("404", "No such run"));
        }
    } else if operation["tags"][0] == "results" && path.contains('{') {
        refusals.extend([
            ("400", "The path or the query is malformed"),
            ("404", "There is none"),
            ("500", "It is not what was recorded, or cannot be read"),
        ]);
    }
    refusals
}

fn refusal(description: &str) -> Value {
    let schema = json!({ "$ref": "#/components/schemas/Problem" });
    json!({ "description": description, "content": { problem::CONTENT_TYPE: { "schema": schema } } })
}
