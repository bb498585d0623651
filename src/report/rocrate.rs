//! `ro-crate-metadata.json` of a run: the profile Process Run Crate 0.5 on RO-Crate 1.1.
//!
//! ```text
//! ./ (Dataset) ──┬─ hasPart ── run.json, events.jsonl, A01/, A01.attempt-1/ ── their files, each with its SHA-256
//!                └─ mentions ── #measure-A01 (CreateAction) ──┬─ object ──── the frames of A01, the method
//!                                                             ├─ instrument ─ carved, with version and commit
//!                                                             ├─ agent ────── the operator
//!                                                             └─ result ───── measurement.json, mesh.ply, model.glb, pictures
//! ```
//! Every file that is there is listed, except the receipts of copies: a copy of the run has others. Raw frames may have been pruned. Of a
//! packed copy `A01.tar` stands for the files of A01: it is object and result of the action.

use crate::tables::{method_hash, ontology};
use carved_records::{Mode, SpecimenKind};
pub use carved_store::CRATE as FILE;
use carved_store::{RecordingFiles, RunContents, Software, StoreError, StoredRun, StoredWell};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

/// What a measurement makes of the frames, beside the profiles.
const RESULTS: [&str; 7] = ["measurement.json", "mesh.ply", "model.glb", "lateral.png", "lateral.tif", "dorsal.png", "dorsal.tif"];

const PROFILE: &str = "https://w3id.org/ro/wfrun/process/0.5";
const CRATE: &str = "https://w3id.org/ro/crate/1.1";

/// What the run does not know of itself.
#[derive(Debug, Clone, Default)]
pub struct Given {
    /// ORCID of the operator, as an address.
    pub orcid: Option<String>,
    /// Address of the licence of the data.
    pub license: Option<String>,
}

/// The metadata of a run's folder, and the files that should be there: those that its checksums list and no receipt of a copy has.
///
/// # Errors
/// A file that is there and cannot be read, or was altered.
pub fn metadata(run: &StoredRun, given: &Given) -> Result<(Value, Vec<PathBuf>), StoreError> {
    let record = run.record();
    let mut graph = Graph::new(run, given);
    let RunContents { mut files, missing } = RunContents::of(run.folder())?;
    files.remove(Path::new(FILE));
    for (name, sha256) in &files {
        graph.file(name, sha256)?;
    }
    for planned in &record.plan.plate_map {
        let well = run.well(planned)?;
        if well.recording.is_some() {
            graph.well(&well, &files);
        }
    }
    Ok((graph.finished(record.ended.as_deref().unwrap_or(&record.started)), missing))
}

struct Graph<'r> {
    run: &'r StoredRun,
    given: &'r Given,
    agent: String,
    entities: Vec<Value>,
    parts: Vec<Value>,
    actions: Vec<Value>,
    /// Contextual entities that several wells share, by id.
    shared: Vec<String>,
}

fn id(id: &str) -> Value {
    json!({ "@id": id })
}

impl<'r> Graph<'r> {
    fn new(run: &'r StoredRun, given: &'r Given) -> Self {
        let agent = given.orcid.clone().unwrap_or_else(|| "#operator".to_owned());
        let person = json!({"@id": agent, "@type": "Person", "name": run.record().plan.operator});
        Self { run, given, agent, entities: vec![person], parts: Vec::new(), actions: Vec::new(), shared: Vec::new() }
    }

    /// A file of the crate. `name` is its path in the run's folder.
    fn file(&mut self, name: &Path, sha256: &str) -> Result<(), StoreError> {
        let path = self.run.folder().join(name);
        let size = std::fs::metadata(&path).map_err(StoreError::io("look at", &path))?.len();
        let part = id(&address(name));
        self.entities.push(json!({
            "@id": part["@id"], "@type": "File", "name": name.display().to_string(), "contentSize": size.to_string(),
            "encodingFormat": media_type(name), "sha256": sha256,
        }));
        self.parts.push(part);
        Ok(())
    }

    /// An entity that is described once.
    fn once(&mut self, entity: Value) -> Value {
        let name = entity["@id"].as_str().unwrap_or_default().to_owned();
        if !self.shared.contains(&name) {
            self.shared.push(name.clone());
            self.entities.push(entity);
        }
        id(&name)
    }

    fn software(&mut self, recording: &Value) -> Value {
        let software = serde_json::from_value(recording["software"].clone()).unwrap_or_else(|_| self.run.record().software.clone());
        let Software { version, commit, .. } = &software;
        self.once(json!({
            "@id": format!("#carved-{version}-{commit}"), "@type": "SoftwareApplication", "name": "carved",
            "softwareVersion": software.words(),
            "description": "Measures zebrafish larvae in 3D while they turn in the capillary of a VAST BioImager",
        }))
    }

    fn method(&mut self, recording: &Value) -> Value {
        let hash = method_hash(&recording["method"]);
        let name = recording["method_name"].as_str().unwrap_or_default();
        let mut method = json!({
            "@id": format!("#method-{hash}"), "@type": "CreativeWork", "name": format!("Method {name}"), "sha256": hash,
            "text": recording["method"].to_string(), "encodingFormat": "application/json",
        });
        if let Some(version) = recording["method"]["version"].as_str() {
            method["version"] = version.into();
        }
        self.once(method)
    }

    fn rig(&mut self, recording: &Value) {
        let text = |key: &str| recording["rig"][key].as_str().unwrap_or("not known");
        let name = text("name");
        let description = format!("Camera {}, rotation axis {}", text("camera_identity"), text("rotation_identity"));
        let mut rig = json!({"@id": format!("#rig-{name}"), "@type": "IndividualProduct", "name": name, "description": description});
        if let Some(uuid) = recording["instrument"]["uuid"].as_str() {
            rig["identifier"] = uuid.into();
        }
        if let Some(serial) = recording["instrument"]["serial"].as_str() {
            rig["serialNumber"] = serial.into();
        }
        let rig = self.once(rig);
        if !self.actions.contains(&rig) {
            self.actions.push(rig);
        }
    }

    /// The action that made the results of a well. `files` are those of the run.
    fn well(&mut self, stored: &StoredWell, files: &BTreeMap<PathBuf, String>) {
        let well = &stored.planned.well;
        let recording = stored.recording.clone().unwrap_or_default();
        let (mut frames, mut results) = (Vec::new(), Vec::new());
        let is_packed = matches!(stored.files, RecordingFiles::Pack(_));
        if is_packed {
            let pack = id(&format!("{well}.tar"));
            frames.push(pack.clone());
            results.extend(stored.measurement.is_some().then_some(pack));
        }
        for name in files.keys() {
            let Ok(own) = name.strip_prefix(well) else { continue };
            let file = id(&address(name));
            if own.starts_with("frames") || own.starts_with("second") {
                frames.push(file);
            } else if own.starts_with("profiles") || RESULTS.iter().any(|result| own == Path::new(result)) {
                results.push(file);
            }
        }
        self.rig(&recording);
        if results.is_empty() {
            return;
        }
        let (software, method) = (self.software(&recording), self.method(&recording));
        frames.push(method);
        let specimen = match stored.planned.specimen {
            SpecimenKind::Larva => "larva",
            SpecimenKind::Bead => "bead",
        };
        let name = format!("#measure-{well}");
        let mut action = json!({
            "@id": name, "@type": "CreateAction", "name": format!("Measurement of the {specimen} in well {well}"),
            "instrument": software, "agent": id(&self.agent), "object": frames, "result": results,
        });
        let started = recording["started"].as_str().and_then(|text| text.parse::<jiff::Timestamp>().ok());
        if let Some(started) = started {
            // Fractions of a second are not known to every reader.
            action["startTime"] = started.strftime("%Y-%m-%dT%H:%M:%SZ").to_string().into();
        }
        let reason = stored.status.as_ref().and_then(|status| status.reason.as_deref());
        let method = recording["method_name"].as_str().unwrap_or_default();
        let inside = if is_packed { format!(". {well}.tar has its frames, its surface and its numbers") } else { String::new() };
        action["description"] =
            reason.map_or_else(|| format!("A turn by the method {method}, and its surface and numbers{inside}"), str::to_owned).into();
        self.entities.push(action);
        self.actions.push(id(&name));
    }

    fn finished(mut self, published: &str) -> Value {
        let record = self.run.record();
        let word = match record.mode {
            Mode::Hardware => "",
            Mode::Simulated => "Simulated data, of no real larva. ",
            Mode::Imported => "Frames that were imported. ",
        };
        let license = match &self.given.license {
            Some(address) => self.once(json!({"@id": address, "@type": "CreativeWork", "name": address})),
            None => self.once(json!({
                "@id": "#license", "@type": "CreativeWork", "name": "No licence was stated",
                "description": "Ask the laboratory before you use these data.",
            })),
        };
        let mut root = json!({
            "@id": "./", "@type": "Dataset", "conformsTo": id(PROFILE), "name": format!("carved run {}", record.id),
            "description": format!("{word}Frames, outlines, surfaces and numbers of plate {}, method {}.", record.plan.plate_barcode, record.plan.method),
            "datePublished": published, "license": license, "author": id(&self.agent), "identifier": record.id,
            "hasPart": self.parts, "mentions": self.actions,
        });
        let terms = [(ontology::taxon as fn(&_) -> _, "Taxon"), (ontology::stage, "DefinedTerm"), (ontology::exposure, "DefinedTerm")];
        let mut about: Vec<Value> = Vec::new();
        for (term, kind) in terms.iter().filter(|_| record.mode != Mode::Simulated) {
            for term in record.plan.plate_map.iter().filter_map(term) {
                let address = format!("http://purl.obolibrary.org/obo/{}", term.id.replace(':', "_"));
                let term = self.once(json!({"@id": address, "@type": kind, "name": term.name, "identifier": term.id}));
                if !about.contains(&term) {
                    about.push(term);
                }
            }
        }
        if !about.is_empty() {
            root["about"] = about.into();
        }
        let mut graph = vec![
            json!({"@id": FILE, "@type": "CreativeWork", "conformsTo": id(CRATE), "about": id("./")}),
            root,
            json!({"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}),
        ];
        graph.append(&mut self.entities);
        json!({"@context": ["https://w3id.org/ro/crate/1.1/context", "https://w3id.org/ro/terms/workflow-run/context"], "@graph": graph})
    }
}

/// The address of a file in the crate: a relative URI (RFC 3986).
fn address(name: &Path) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte);
    name.as_os_str()
        .as_bytes()
        .iter()
        .map(|&byte| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

fn media_type(name: &Path) -> &'static str {
    match name.extension().and_then(|extension| extension.to_str()).unwrap_or_default() {
        "json" => "application/json",
        "jsonl" => "application/jsonl",
        "png" => "image/png",
        "tif" => "image/tiff",
        "glb" => "model/gltf-binary",
        "tar" => "application/x-tar",
        "ply" => "application/octet-stream",
        _ => "text/plain",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_of_a_file_is_a_relative_uri() {
        assert_eq!(address(Path::new("A01.attempt-1/frames/view_000.png")), "A01.attempt-1/frames/view_000.png");
        assert_eq!(address(Path::new("notes of kim, 50 %.txt")), "notes%20of%20kim%2C%2050%20%25.txt");
        assert_eq!(address(Path::new("\u{b5}m")), "%C2%B5m");
    }
}
