//! A study file for the `BioImage` Archive: the groups of REMBI under the keys of the archive's own model (`bia-rembi-models`, REMBI 1.5).
//!
//! ```text
//!  plate map ── biosamples, one per strain      recordings ── image_acquisitions, one per setting of rig and method
//!  run       ── study_components                methods    ── image_analyses
//!  to_fill_in: what a run does not know, by the place in the file, such as the title of the study
//! ```

use super::methods::Methods;
use crate::tables::ontology;
use carved_records::{ConcentrationUnit, Control, Mode, PlannedWell, SpecimenKind};
use carved_store::{StoreError, StoredRun};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Version of REMBI whose keys are written.
const VERSION: &str = "1.5";

/// Where to fill in what a run does not know, what belongs there, and whether the archive's model requires it.
const STUDY: [(&str, &str, bool); 10] = [
    ("study.title", "a title of 25 characters or more", true),
    ("study.description", "what was done and why, 25 characters or more; an abstract, for example", true),
    ("study.private_until_date", "the day until which the submission stays private, as 2027-01-31", true),
    ("study.authors", "a list; each with last_name, first_name and affiliation (name and address, or name and url of its ROR)", true),
    ("study.license", "the licence: name and url", false),
    ("study.funding", "funding_statement, and grant_references with identifier and funder", false),
    ("study.publications", "a list; each with title, and authors, doi, year and pubmed_id", false),
    ("study.links", "a list; each with link_url, link_type and link_description", false),
    ("specimens.0.sample_preparation", "anaesthetic, medium, age at treatment, and how the larvae were brought into the plate", true),
    ("specimens.0.growth_protocol", "medium, temperature, light cycle and density", false),
];

/// Why there is no study file.
#[derive(Debug, thiserror::Error)]
pub enum RembiError {
    /// Rendered frames.
    #[error("the run {run} is simulated: it has no biological sample, and the BioImage Archive takes no such data. Name runs of larvae")]
    Simulated {
        /// The run.
        run: String,
    },
    /// Beads alone.
    #[error("no larva of these runs was recorded, so there is no biological sample. Name runs of larvae")]
    NoLarva,
    /// A file of a run.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The study file of runs.
///
/// # Errors
/// A simulated run, no recorded larva, and a file that is there and cannot be read, or was altered.
pub fn study(runs: &[StoredRun]) -> Result<Value, RembiError> {
    let mut samples: BTreeMap<Option<String>, Sample> = BTreeMap::new();
    let mut settings = BTreeSet::new();
    let (mut components, mut analyses) = (Vec::new(), Vec::new());
    for run in runs {
        let record = run.record();
        if record.mode == Mode::Simulated {
            return Err(RembiError::Simulated { run: record.id.clone() });
        }
        let (mut larvae, mut beads) = (0, 0);
        for planned in &record.plan.plate_map {
            let well = run.well(planned)?;
            let Some(recording) = well.recording else { continue };
            if planned.specimen == SpecimenKind::Larva {
                larvae += 1;
                samples.entry(planned.strain.clone()).or_default().add(planned);
            } else {
                beads += 1;
            }
            settings.insert(Setting::of(&recording, record.mode));
        }
        components.push(json!({
            "name": record.id,
            "description": format!(
                "Views of zebrafish larvae ({larvae}) and beads ({beads}) of plate {}, each turned about the axis of a capillary, with outlines, \
                 surface models and a table of volumes, areas and lengths",
                record.plan.plate_barcode
            ),
            "rembi_version": VERSION,
        }));
        analyses.push(json!({ "analysis_overview": Methods::of(run).paragraph }));
    }
    if samples.is_empty() {
        return Err(RembiError::NoLarva);
    }
    let mut missing: Vec<Value> = STUDY.iter().map(|&(at, what, required)| to_fill_in(at, what, required)).collect();
    for (number, setting) in settings.iter().enumerate().filter(|(_, setting)| setting.instrument.is_none()) {
        let from = format!("make and model of the instrument that took the imported pictures of rig {}", setting.rig);
        missing.push(to_fill_in(&format!("image_acquisitions.{number}.imaging_instrument"), &from, true));
    }
    Ok(json!({
        "study": {"keywords": ["zebrafish", "larva", "morphometry", "3D reconstruction"], "rembi_version": VERSION},
        "study_components": components,
        "biosamples": samples.iter().map(|(strain, sample)| sample.described(strain.as_deref())).collect::<Vec<_>>(),
        "specimens": [{}],
        "image_acquisitions": settings.iter().map(Setting::described).collect::<Vec<_>>(),
        "image_analyses": analyses,
        "to_fill_in": missing,
    }))
}

fn to_fill_in(at: &str, what: &str, required: bool) -> Value {
    json!({"at": at, "what": what, "required": required})
}

/// The larvae of a strain: each value of the plate map once.
#[derive(Default)]
struct Sample {
    ages: BTreeSet<String>,
    treatments: BTreeSet<String>,
    compounds: BTreeSet<Option<String>>,
    doses: BTreeSet<String>,
    other: BTreeSet<Option<String>>,
}

impl Sample {
    fn add(&mut self, well: &PlannedWell) {
        let unit = well.concentration_unit.map(ConcentrationUnit::symbol).unwrap_or_default();
        let dose = well.concentration.map(|value| format!(" {value} {unit}").trim_end().to_owned()).unwrap_or_default();
        self.ages.insert(well.dpf.map_or_else(|| "age not stated".into(), |dpf| format!("{dpf} dpf")));
        let control = match well.control {
            Some(Control::Negative) => " (negative control)",
            Some(Control::Positive) => " (positive control)",
            None => "",
        };
        self.treatments.extend(well.compound.as_ref().map(|compound| format!("{compound}{dose}{control}")));
        self.treatments.extend(well.treatment.clone());
        self.compounds.insert(well.compound.clone());
        self.doses.insert(dose);
        self.other.insert(well.treatment.clone());
    }

    fn described(&self, strain: Option<&str>) -> Value {
        let ages = self.ages.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let varied = [
            ("age", self.ages.len()),
            ("compound", self.compounds.len()),
            ("concentration", self.doses.len()),
            ("treatment", self.other.len()),
        ];
        let taxon = ontology::ZEBRAFISH;
        json!({
            "organism": {
                "scientific_name": taxon.name,
                "common_name": "zebrafish",
                "ncbi_taxon": format!("http://purl.obolibrary.org/obo/{}", taxon.id.replace(':', "_")),
            },
            "biological_entity": format!("whole zebrafish larva, {ages}"),
            "intrinsic_variables": strain.into_iter().collect::<Vec<_>>(),
            "extrinsic_variables": self.treatments,
            "experimental_variables": varied.iter().filter(|(_, values)| *values > 1).map(|(name, _)| name).collect::<Vec<_>>(),
        })
    }
}

/// How pictures were taken.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Setting {
    rig: String,
    /// `None` of imported pictures.
    instrument: Option<String>,
    parameters: String,
}

impl Setting {
    fn of(recording: &Value, mode: Mode) -> Self {
        let rig = &recording["rig"];
        let text = |key: &str| rig[key].as_str().unwrap_or("not known").to_owned();
        let um = |key: &str| rig["camera"][key].as_f64().map_or_else(|| "?".into(), |per_um| format!("{:.4}", 1.0 / per_um));
        let features = rig["camera_features"].as_object().into_iter().flatten();
        let features: String = features.map(|(name, value)| format!("; {name} {}", value.as_str().unwrap_or_default())).collect();
        let parameters = format!(
            "{} views over one turn of the specimen; {} x {} px of {} x {} um at the axis of rotation; {}{features}",
            recording["method"]["asd"],
            rig["camera"]["width"],
            rig["camera"]["height"],
            um("kx"),
            um("ky"),
            text("pixel_format"),
        );
        let instrument = (mode == Mode::Hardware).then(|| {
            format!(
                "VAST BioImager, rig {}; camera {}; motion controller {}",
                text("name"),
                text("camera_identity"),
                text("rotation_identity")
            )
        });
        Self { rig: text("name"), instrument, parameters }
    }

    fn described(&self) -> Value {
        let mut found = json!({
            "imaging_method": {
                "value": "bright-field microscopy",
                "ontology_name": "Biological Imaging Methods Ontology (FBbi)",
                "ontology_id": "http://purl.obolibrary.org/obo/FBbi_00000243",
            },
            "image_acquisition_parameters": self.parameters,
        });
        if let Some(instrument) = &self.instrument {
            found["imaging_instrument"] = json!(instrument);
        }
        found
    }
}
