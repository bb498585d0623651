//! The plan of a run, as a client sends it. The whole plan is checked before anything moves.

use crate::{ConcentrationUnit, PlateFormat, is_well};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The kind of specimen in a well, from the plate map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SpecimenKind {
    Larva,
    Bead,
}

/// Metadata that carved stores beside the wells and does not evaluate: a JSON object.
pub type Metadata = serde_json::Map<String, serde_json::Value>;

/// Body of `PUT /v1/runs/{run_id}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RunPlan {
    #[cfg_attr(feature = "schema", schema(pattern = "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}$"))]
    pub plate_barcode: String,
    /// Name of a method of the configuration.
    pub method: String,
    /// The version that the method must have. Without it any version is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method_version: Option<String>,
    #[cfg_attr(feature = "schema", schema(pattern = r"\S"))]
    pub operator: String,
    #[serde(default)]
    pub external_id: Option<String>,
    /// Number of wells of the plate: 6, 12, 24, 48, 96, 384 or 1536. Without it the plate is one that holds the wells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate_format: Option<u32>,
    /// The wells in the order in which they are visited.
    #[cfg_attr(feature = "schema", schema(min_items = 1))]
    pub plate_map: Vec<PlannedWell>,
    /// Metadata of the plate in the MIHCSME format. They are stored with the run and not evaluated.
    #[serde(default, skip_serializing_if = "Metadata::is_empty")]
    #[cfg_attr(feature = "schema", schema(value_type = Object))]
    pub metadata: Metadata,
}

/// Whether a well is a control.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Control {
    Positive,
    Negative,
}

/// A well of a plate map: its specimen and its treatment. carved uses `specimen` and `dpf`, and copies the rest into the results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct PlannedWell {
    /// `A01` to `AF48`.
    #[cfg_attr(feature = "schema", schema(pattern = "^([A-Z]|A[A-F])(0[1-9]|[1-3][0-9]|4[0-8])$"))]
    pub well: String,
    #[serde(default = "larva")]
    pub specimen: SpecimenKind,
    /// Days post fertilisation.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schema(minimum = 0, maximum = 30))]
    pub dpf: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(max_length = 200, pattern = r"\S"))]
    pub compound: Option<String>,
    /// In `concentration_unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(minimum = 0))]
    pub concentration: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub concentration_unit: Option<ConcentrationUnit>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(max_length = 200, pattern = r"\S"))]
    pub strain: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(max_length = 200, pattern = r"\S"))]
    pub treatment: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// Number of the replicate of a condition, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(minimum = 1))]
    pub replicate: Option<u32>,
}

impl PlannedWell {
    /// A well without further information.
    pub fn new(well: impl Into<String>, specimen: SpecimenKind, dpf: Option<f64>) -> Self {
        Self {
            well: well.into(),
            specimen,
            dpf,
            compound: None,
            concentration: None,
            concentration_unit: None,
            strain: None,
            treatment: None,
            control: None,
            replicate: None,
        }
    }

    /// Invalid fields, and what is wrong with each. The name of the well is checked with the whole plan.
    pub fn mistakes(&self) -> Vec<(&'static str, String)> {
        let mut found = Vec::new();
        if let Some(dpf) = self.dpf.filter(|d| !(0.0..=30.0).contains(d)) {
            found.push(("dpf", format!("{dpf} is not an age in days post fertilisation: 0 to 30")));
        }
        match (self.concentration, self.concentration_unit) {
            (Some(c), _) if !(c.is_finite() && c >= 0.0) => found.push(("concentration", format!("{c} is no concentration: 0 or more"))),
            (Some(c), None) => {
                let known = ConcentrationUnit::known();
                found.push(("concentration_unit", format!("the concentration {c} has no unit; the units are {known}")));
            }
            (None, Some(unit)) => found.push(("concentration", format!("there is a unit, {}, but no concentration", unit.symbol()))),
            _ => {}
        }
        if self.replicate == Some(0) {
            found.push(("replicate", "0 is no replicate: they count from 1".into()));
        }
        for (field, text) in [("compound", &self.compound), ("strain", &self.strain), ("treatment", &self.treatment)] {
            let Some(text) = text else { continue };
            if text.trim().is_empty() {
                found.push((field, "the text is empty; leave the field out".into()));
            } else if text.chars().count() > TEXT_LIMIT || text.chars().any(char::is_control) {
                found.push((field, format!("use at most {TEXT_LIMIT} characters of one line; these are {}", text.chars().count())));
            }
        }
        found
    }

    /// Age of a larva, days post fertilisation. `None` for a bead, or if the age is unknown.
    pub fn age_of_larva(&self) -> Option<f64> {
        self.dpf.filter(|_| self.specimen == SpecimenKind::Larva)
    }
}

fn larva() -> SpecimenKind {
    SpecimenKind::Larva
}

/// A mistake in a plan, and its place.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldError {
    /// JSON pointer into the body, such as `/plate_map/3/well`.
    pub pointer: String,
    pub detail: String,
}

/// Maximum length of a name, which fits every file system and label.
const NAME_LIMIT: usize = 64;

/// Maximum length of a text that describes a well.
const TEXT_LIMIT: usize = 200;

/// Whether a name is safe in a path and a URL: letters, digits, `-`, `_` and `.`, not starting with a dot.
pub fn is_plain_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= NAME_LIMIT
        && !name.starts_with('.')
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.'))
}

/// What is wrong with a well that its plate does not have.
pub(crate) fn off_plate(well: &str, format: PlateFormat) -> String {
    format!("{well} is not on a plate of {} wells: A01 to {}", format.wells(), format.last_well())
}

/// A method that may have a version.
pub trait Versioned {
    /// The version in the configuration. `None` if it has none.
    fn version(&self) -> Option<&str>;
}

impl<T: Versioned> Versioned for &T {
    fn version(&self) -> Option<&str> {
        T::version(self)
    }
}

impl RunPlan {
    /// A plan with only the required fields.
    pub fn new(plate_barcode: &str, method: &str, operator: &str, plate_map: Vec<PlannedWell>) -> Self {
        Self {
            plate_barcode: plate_barcode.into(),
            method: method.into(),
            method_version: None,
            operator: operator.into(),
            external_id: None,
            plate_format: None,
            plate_map,
            metadata: Metadata::new(),
        }
    }

    /// Checks the whole plan. `methods` are those of the configuration.
    ///
    /// # Errors
    /// All mistakes, not only the first one.
    pub fn check<M: Versioned>(&self, methods: &BTreeMap<String, M>) -> Result<(), Vec<FieldError>> {
        let mut errors = Vec::new();
        let mut wrong = |pointer: String, detail: String| errors.push(FieldError { pointer, detail });
        let plain = "use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'";
        if !is_plain_name(&self.plate_barcode) {
            wrong("/plate_barcode".into(), format!("{:?} is not a barcode: {plain}", self.plate_barcode));
        }
        if self.operator.trim().is_empty() {
            wrong("/operator".into(), "the operator's name is empty".into());
        }
        match (methods.get(&self.method), &self.method_version) {
            (None, _) => {
                let known = methods.keys().cloned().collect::<Vec<_>>().join(", ");
                wrong("/method".into(), format!("{:?} is not a method of this instrument; it has: {known}", self.method));
            }
            (Some(method), Some(asked)) if method.version() != Some(asked) => {
                let found = method.version().map_or_else(|| "has no version".to_owned(), |found| format!("is of version {found:?}"));
                wrong("/method_version".into(), format!("{asked:?} is asked for; {:?} of this instrument {found}", self.method));
            }
            _ => {}
        }
        if self.plate_map.is_empty() {
            wrong("/plate_map".into(), "the plate map names no well".into());
        }
        let format = self.plate_format.and_then(|wells| {
            let found = PlateFormat::of_wells(wells);
            if found.is_none() {
                wrong("/plate_format".into(), format!("no plate of {wells} wells is known; the formats are {}", PlateFormat::known()));
            }
            found
        });
        let mut seen = BTreeSet::new();
        for (i, w) in self.plate_map.iter().enumerate() {
            if !is_well(&w.well) {
                wrong(format!("/plate_map/{i}/well"), format!("{:?} is not a well: A01 to AF48", w.well));
            } else if let Some(format) = format.filter(|format| !format.holds(&w.well)) {
                wrong(format!("/plate_map/{i}/well"), off_plate(&w.well, format));
            } else if !seen.insert(&w.well) {
                wrong(format!("/plate_map/{i}/well"), format!("{} stands in the plate map twice", w.well));
            }
            for (field, detail) in w.mistakes() {
                wrong(format!("/plate_map/{i}/{field}"), detail);
            }
        }
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Version(Option<&'static str>);

    impl Versioned for Version {
        fn version(&self) -> Option<&str> {
            self.0
        }
    }

    fn methods() -> BTreeMap<String, Version> {
        BTreeMap::from([("standard".into(), Version(Some("2"))), ("quick".into(), Version(None))])
    }

    #[test]
    fn a_method_of_another_version_is_refused() {
        let check = |method: &str, version: Option<&str>| {
            let plan = RunPlan::new("P", method, "kim", vec![PlannedWell::new("A01", SpecimenKind::Bead, None)]);
            RunPlan { method_version: version.map(str::to_owned), ..plan }.check(&methods())
        };
        for (method, version) in [("standard", None), ("standard", Some("2")), ("quick", None)] {
            check(method, version).unwrap();
        }
        for (method, version) in [("standard", Some("1")), ("standard", Some("")), ("quick", Some("1"))] {
            assert_eq!(check(method, version).unwrap_err()[0].pointer, "/method_version", "{method} {version:?}");
        }
    }

    #[test]
    fn every_mistake_is_listed_with_its_place() {
        let plan: RunPlan = serde_json::from_str(
            r#"{"plate_barcode": "../x", "method": "fast", "operator": " ",
                "plate_map": [{"well": "A01"}, {"well": "A1"}, {"well": "A01"}, {"well": "AG01"}, {"well": "P49", "dpf": -1}]}"#,
        )
        .unwrap();
        let pointers: Vec<_> = plan.check(&methods()).unwrap_err().into_iter().map(|e| e.pointer).collect();
        let expected = [
            "/plate_barcode",
            "/operator",
            "/method",
            "/plate_map/1/well",
            "/plate_map/2/well",
            "/plate_map/3/well",
            "/plate_map/4/well",
            "/plate_map/4/dpf",
        ];
        assert_eq!(pointers, expected);
    }

    #[test]
    fn a_well_must_be_on_the_plate_that_the_plan_names() {
        let of = |format: Option<u32>| {
            let wells = ["A01", "D06", "AF48"].map(|well| PlannedWell::new(well, SpecimenKind::Larva, None));
            let plan = RunPlan { plate_format: format, ..RunPlan::new("P", "quick", "kim", wells.to_vec()) };
            plan.check(&methods()).map_or_else(|errors| errors.into_iter().map(|e| (e.pointer, e.detail)).collect(), |()| Vec::new())
        };
        assert_eq!(of(None), []);
        assert_eq!(of(Some(1536)), []);
        let off = |well: &str, at: usize| (format!("/plate_map/{at}/well"), format!("{well} is not on a plate of 24 wells: A01 to D06"));
        assert_eq!(of(Some(24)), [off("AF48", 2)]);
        let unknown = "no plate of 95 wells is known; the formats are 6, 12, 24, 48, 96, 384, 1536";
        assert_eq!(of(Some(95)), [("/plate_format".to_owned(), unknown.to_owned())]);
    }

    #[test]
    fn a_plan_without_a_format_is_written_as_before() {
        let plan = RunPlan::new("P", "quick", "kim", vec![PlannedWell::new("A01", SpecimenKind::Bead, None)]);
        assert!(!serde_json::to_string(&plan).unwrap().contains("plate_format"));
    }

    #[test]
    fn conditions_that_cannot_be_are_named() {
        let found = |fields: &str| {
            let well: PlannedWell = serde_json::from_str(&format!(r#"{{"well": "A01", {fields}}}"#)).unwrap();
            well.mistakes().into_iter().map(|(field, _)| field).collect::<Vec<_>>()
        };
        for (fields, wrong) in [
            (r#""concentration": 3"#, vec!["concentration_unit"]),
            (r#""concentration_unit": "uM""#, vec!["concentration"]),
            (r#""concentration": -1, "concentration_unit": "uM""#, vec!["concentration"]),
            (r#""replicate": 0, "dpf": 31"#, vec!["dpf", "replicate"]),
            (r#""compound": " ", "strain": "a\nb""#, vec!["compound", "strain"]),
            (r#""concentration": 0, "concentration_unit": "% v/v", "compound": "DMSO", "control": "negative", "replicate": 1"#, vec![]),
        ] {
            assert_eq!(found(fields), wrong, "{fields}");
        }
    }

    #[test]
    fn a_sound_plan_passes_and_unknown_keys_do_not() {
        let ok = r#"{"plate_barcode": "P-1", "method": "standard", "operator": "kim", "plate_map": [{"well": "P24", "specimen": "bead"}]}"#;
        serde_json::from_str::<RunPlan>(ok).unwrap().check(&methods()).unwrap();
        assert!(serde_json::from_str::<RunPlan>(&ok.replace("operator", "operater")).is_err());
    }
}
