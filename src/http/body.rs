//! Request bodies: limited in size and time, JSON according to their content type, and refused with a list of all wrong fields.
//!
//! serde decides whether a body is valid. If it refuses, the published schema of the same type is walked to report everything that is
//! wrong, not only serde's first error.

use super::AppState;
use super::problem::Problem;
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, StatusCode, header};
use carved_records::FieldError;
use carved_records::plate_map::Format;
use futures::StreamExt;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::Segment;
use utoipa::ToSchema;

/// Size limit of a body, bytes.
pub(super) const SMALL: usize = 64 * 1024;
/// Size limit of bodies with a plate map, bytes.
pub(super) const PLATE_MAP: usize = 1024 * 1024;

/// A JSON body of at most `LIMIT` bytes.
pub(super) struct Body<T, const LIMIT: usize>(pub T);

impl<T: DeserializeOwned + ToSchema, const LIMIT: usize> FromRequest<AppState> for Body<T, LIMIT> {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &AppState) -> Result<Self, Problem> {
        let found = content_type(request.headers());
        if media(&found) != "application/json" {
            let detail = format!("the body's content type is {found:?}; send application/json");
            return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "not_json", detail));
        }
        let body = whole(request, LIMIT, app).await?;
        parse(&body, &app.schemas).map(Self).map_err(Problem::of_a_plate)
    }
}

/// The file of a plate map: the only body that need not be JSON.
pub(super) struct PlateMapFile {
    pub bytes: Vec<u8>,
    pub format: Format,
}

impl PlateMapFile {
    /// Only a CSV has columns that may be named.
    pub fn must_be_csv(&self) -> Result<(), Problem> {
        match self.format {
            Format::Csv => Ok(()),
            Format::Json => {
                let detail = "a JSON file has no columns to be named; send text/csv";
                Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "not_a_plate_map", detail))
            }
        }
    }
}

impl FromRequest<AppState> for PlateMapFile {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &AppState) -> Result<Self, Problem> {
        let found = content_type(request.headers());
        let format = match media(&found).as_str() {
            "text/csv" | "text/tab-separated-values" => Format::Csv,
            "application/json" => Format::Json,
            _ => {
                let detail = format!("the body's content type is {found:?}; send text/csv or application/json");
                return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "not_a_plate_map", detail));
            }
        };
        Ok(Self { bytes: whole(request, PLATE_MAP, app).await?, format })
    }
}

fn content_type(headers: &HeaderMap) -> String {
    headers.get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or_default().to_owned()
}

/// A content type without its parameters.
fn media(content_type: &str) -> String {
    content_type.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

/// Reads the whole body, limited in size and time.
async fn whole(request: Request, limit: usize, app: &AppState) -> Result<Vec<u8>, Problem> {
    within(request.headers(), limit)?;
    tokio::time::timeout(app.body_timeout, read(request, limit))
        .await
        .map_err(|_| Problem::new(StatusCode::REQUEST_TIMEOUT, "slow_body", "the body did not arrive in time").come_back())?
}

fn too_large(limit: usize) -> Problem {
    Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "too_large", format!("the body is larger than {limit} bytes"))
}

/// Refuses a body by its announced length before any of it is read.
pub(super) fn within(headers: &HeaderMap, limit: usize) -> Result<(), Problem> {
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|v| v.to_str().ok()).and_then(|v| v.parse::<u64>().ok());
    if announced.is_some_and(|length| length > limit as u64) { Err(too_large(limit)) } else { Ok(()) }
}

async fn read(request: Request, limit: usize) -> Result<Vec<u8>, Problem> {
    let mut stream = request.into_body().into_data_stream();
    let mut bytes = Vec::new();
    while let Some(chunk) = stream.next().await {
        let chunk = chunk.map_err(|why| Problem::bad_request("broken_body", format!("the body broke off: {why}")))?;
        if bytes.len() + chunk.len() > limit {
            return Err(too_large(limit));
        }
        bytes.extend_from_slice(&chunk);
    }
    Ok(bytes)
}

fn parse<T: DeserializeOwned + ToSchema>(bytes: &[u8], schemas: &Value) -> Result<T, Problem> {
    // An editor of Windows begins a file with a byte order mark. A plate map may have it too.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let refusal = match serde_path_to_error::deserialize(&mut serde_json::Deserializer::from_slice(bytes)) {
        Ok(value) => {
            // Text behind the value is an error.
            return match serde_json::from_slice::<serde::de::IgnoredAny>(bytes) {
                Ok(_) => Ok(value),
                Err(why) => Err(malformed(&why)),
            };
        }
        Err(refusal) => refusal,
    };
    let value: Value = serde_json::from_slice(bytes).map_err(|why| malformed(&why))?;
    let mut errors = Vec::new();
    explain(&schemas[T::name().as_ref()], schemas, &value, &mut String::new(), &mut errors);
    if errors.is_empty() {
        let pointer = refusal.path().iter().fold(String::new(), |pointer, segment| match segment {
            Segment::Seq { index } => format!("{pointer}/{index}"),
            Segment::Map { key } | Segment::Enum { variant: key } => format!("{pointer}/{}", escape(key)),
            Segment::Unknown => pointer,
        });
        errors.push(FieldError { pointer, detail: refusal.into_inner().to_string() });
    }
    Err(Problem::unprocessable("invalid_body", errors))
}

/// An error of a field whose type is right and whose value is wrong.
pub(super) fn wrong(pointer: &str, detail: String) -> FieldError {
    FieldError { pointer: pointer.to_owned(), detail }
}

fn malformed(why: &serde_json::Error) -> Problem {
    Problem::bad_request("malformed_json", format!("the body is not JSON: {why}"))
}

/// A key as part of a JSON pointer (RFC 6901).
fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

/// Compares `value` with `schema` and lists every mismatch.
fn explain(schema: &Value, schemas: &Value, value: &Value, at: &mut String, errors: &mut Vec<FieldError>) {
    if let Some(name) = schema["$ref"].as_str().and_then(|r| r.rsplit('/').next()) {
        return explain(&schemas[name], schemas, value, at, errors);
    }
    let mut wrong = |at: &str, detail: String| errors.push(FieldError { pointer: at.to_owned(), detail });
    if let Some(choices) = schema["oneOf"].as_array() {
        // `null` or another type: a value that is not null is compared with the other type.
        let nullable = choices.iter().any(|c| c["type"] == "null");
        if let Some(choice) = choices.iter().find(|c| c["type"] != "null" && !(nullable && value.is_null())) {
            explain(choice, schemas, value, at, errors);
        }
        return;
    }
    if let Some(words) = schema["enum"].as_array() {
        if !words.contains(value) {
            wrong(at, format!("{value} is none of {}", words.iter().map(Value::to_string).collect::<Vec<_>>().join(", ")));
        }
        return;
    }
    if !type_fits(&schema["type"], value) {
        wrong(at, format!("expected {}, found {}", words(&schema["type"]), kind(value)));
        return;
    }
    match value {
        Value::Object(fields) => explain_fields(schema, schemas, fields, at, errors),
        Value::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                descend(&i.to_string(), at, |at| explain(&schema["items"], schemas, item, at, errors));
            }
        }
        _ => {}
    }
}

fn explain_fields(schema: &Value, schemas: &Value, fields: &serde_json::Map<String, Value>, at: &mut String, errors: &mut Vec<FieldError>) {
    for (key, value) in fields {
        descend(key, at, |at| match schema["properties"].get(key) {
            Some(property) => explain(property, schemas, value, at, errors),
            None if schema["additionalProperties"] == false => {
                let known = schema["properties"].as_object().map(|p| p.keys().cloned().collect::<Vec<_>>().join(", "));
                let detail = format!("unknown field; the known ones are {}", known.unwrap_or_default());
                errors.push(FieldError { pointer: at.clone(), detail });
            }
            None => {}
        });
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if !fields.contains_key(key) {
            descend(key, at, |at| errors.push(FieldError { pointer: at.clone(), detail: "this field is missing".into() }));
        }
    }
}

fn descend(key: &str, at: &mut String, inside: impl FnOnce(&mut String)) {
    let length = at.len();
    at.push('/');
    at.push_str(&escape(key));
    inside(at);
    at.truncate(length);
}

fn type_fits(wanted: &Value, value: &Value) -> bool {
    match wanted {
        Value::Array(any) => any.iter().any(|one| type_fits(one, value)),
        Value::String(name) => match name.as_str() {
            "integer" => value.is_i64() || value.is_u64(),
            name => name == kind(value),
        },
        _ => true,
    }
}

fn words(wanted: &Value) -> String {
    match wanted {
        Value::Array(any) => any.iter().map(words).collect::<Vec<_>>().join(" or "),
        other => other.as_str().unwrap_or("something else").to_owned(),
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::{PlannedWell, RunPlan, SpecimenKind};
    use serde_json::json;
    use utoipa::PartialSchema;

    fn schemas() -> Value {
        json!({ "RunPlan": RunPlan::schema(), "PlannedWell": PlannedWell::schema(), "SpecimenKind": SpecimenKind::schema() })
    }

    fn refuse(body: &str) -> Problem {
        parse::<RunPlan>(body.as_bytes(), &schemas()).unwrap_err()
    }

    const SOUND: &str = r#"{"plate_barcode": "P", "method": "m", "operator": "o", "plate_map": [{"well": "A01"}]}"#;

    #[test]
    fn every_wrong_field_is_named() {
        let body = r#"{"plate_barcode": 7, "methud": "m", "operator": null, "external_id": [],
                       "plate_map": [{"well": "A01", "specimen": "worm"}, {"dpf": "3"}, 4, {"well": "B01", "a/b": 1}]}"#;
        let problem = refuse(body);
        assert_eq!((problem.status, problem.code.as_str()), (422, "invalid_body"));
        let mut pointers: Vec<_> = problem.errors.iter().map(|e| e.pointer.as_deref().unwrap()).collect();
        pointers.sort_unstable();
        let expected = [
            "/external_id",
            "/method",
            "/methud",
            "/operator",
            "/plate_barcode",
            "/plate_map/0/specimen",
            "/plate_map/1/dpf",
            "/plate_map/1/well",
            "/plate_map/2",
            "/plate_map/3/a~1b",
        ];
        assert_eq!(pointers, expected);
    }

    #[test]
    fn what_only_serde_sees_is_named_with_its_place() {
        let twice = refuse(&SOUND.replace(r#""well": "A01""#, r#""well": "A01", "well": "A02""#));
        assert_eq!(twice.errors.len(), 1);
        assert!(twice.errors[0].pointer.as_deref().unwrap().starts_with("/plate_map/0"), "{:?}", twice.errors);
        assert!(twice.errors[0].detail.contains("duplicate"), "{:?}", twice.errors);
    }

    #[test]
    fn what_is_not_json_is_malformed() {
        for body in ["", "{", "nonsense", r#"{"operator": }"#, &format!("{SOUND} x"), "\u{0}"] {
            assert_eq!(refuse(body).status, 400, "{body:?}");
        }
        parse::<RunPlan>(SOUND.as_bytes(), &schemas()).unwrap();
        parse::<RunPlan>(format!("\u{feff}{SOUND}").as_bytes(), &schemas()).unwrap();
        assert_eq!(refuse("[]").errors[0].pointer.as_deref(), Some(""));
        let nothing = SOUND.replace(r#""operator": "o""#, r#""operator": "o", "external_id": null"#);
        parse::<RunPlan>(nothing.as_bytes(), &schemas()).unwrap();
    }
}
