//! `ro-crate-metadata.json` of a run: the profile Process Run Crate 0.5 on RO-Crate 1.1.
//!
//! ```text
//! ./ (Dataset) ──┬─ hasPart ── run.json, events.jsonl, A01/ ── its files, each with its SHA-256
//!                └─ mentions ── #measure-A01 (CreateAction) ──┬─ object ──── the frames of A01, the method
//!                                                             ├─ instrument ─ carved, with version and commit
//!                                                             ├─ agent ────── the operator
//!                                                             └─ result ───── measurement.json, mesh.ply, model.glb
//! ```
//! Only files that are there are listed: raw frames may have been pruned.

use crate::tables::{method_hash, ontology};
use carved_records::{Mode, SpecimenKind};
use carved_store::{Software, StoreError, StoredRun, StoredWell};
use serde_json::{Value, json};
use std::path::Path;

/// Name of the file, in the root of the crate.
pub const FILE: &str = "ro-crate-metadata.json";

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

/// The metadata of a run's folder.
///
/// # Errors
/// A file that is there and cannot be read, or was altered.
pub fn metadata(run: &StoredRun, given: &Given) -> Result<Value, StoreError> {
    let record = run.record();
    let mut graph = Graph::new(run, given);
    for name in ["run.json", "events.jsonl"] {
        graph.file(run.folder(), name, None);
    }
    for planned in &record.plan.plate_map {
        let well = run.well(planned)?;
        if well.recording.is_some() {
            graph.well(&well)?;
        }
    }
    Ok(graph.finished(record.ended.as_deref().unwrap_or(&record.started)))
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

    /// A file of the crate, if it is there. `folder` is the crate's root, `name` the path in it.
    fn file(&mut self, root: &Path, name: &str, sha256: Option<&str>) -> Option<Value> {
        let size = std::fs::metadata(root.join(name)).ok()?.len();
        let mut file =
            json!({"@id": name, "@type": "File", "name": name, "contentSize": size.to_string(), "encodingFormat": media_type(name)});
        if let Some(sha256) = sha256 {
            file["sha256"] = sha256.into();
        }
        self.entities.push(file);
        self.parts.push(id(name));
        Some(id(name))
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

    /// The files of a well, and the action that made its results.
    fn well(&mut self, stored: &StoredWell) -> Result<(), StoreError> {
        let well = &stored.planned.well;
        let recording = stored.recording.clone().unwrap_or_default();
        let (mut frames, mut results) = (Vec::new(), Vec::new());
        for (name, sha256) in stored.sums()? {
            let Some(file) = self.file(self.run.folder(), &format!("{well}/{name}"), Some(&sha256)) else { continue };
            if name.starts_with("frames/") || name.starts_with("second/") {
                frames.push(file);
            } else if matches!(name.as_str(), "measurement.json" | "mesh.ply" | "model.glb") || name.starts_with("profiles/") {
                results.push(file);
            }
        }
        self.rig(&recording);
        if results.is_empty() {
            return Ok(());
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
        action["description"] =
            reason.map_or_else(|| format!("A turn by the method {method}, and its surface and numbers"), str::to_owned).into();
        self.entities.push(action);
        self.actions.push(id(&name));
        Ok(())
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

fn media_type(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "json" => "application/json",
        "jsonl" => "application/jsonl",
        "png" => "image/png",
        "glb" => "model/gltf-binary",
        "ply" => "application/octet-stream",
        _ => "text/plain",
    }
}
