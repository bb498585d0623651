//! What a client asks for: the whole plan of a run, checked before anything moves.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use utoipa::ToSchema;

/// What the plate map says is in a well.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpecimenKind {
    Larva,
    Bead,
}

/// Body of `PUT /v1/runs/{run_id}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RunPlan {
    pub plate_barcode: String,
    /// Name of a method of the configuration.
    pub method: String,
    pub operator: String,
    #[serde(default)]
    pub external_id: Option<String>,
    /// The wells in the order in which they are visited.
    pub plate_map: Vec<PlannedWell>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedWell {
    /// `A01` to `P24`.
    pub well: String,
    #[serde(default = "larva")]
    pub specimen: SpecimenKind,
    /// Days post fertilisation.
    #[serde(default)]
    pub dpf: Option<f64>,
}

impl PlannedWell {
    /// Days post fertilisation of a larva, where they are known.
    pub fn age_of_larva(&self) -> Option<f64> {
        self.dpf.filter(|_| self.specimen == SpecimenKind::Larva)
    }
}

fn larva() -> SpecimenKind {
    SpecimenKind::Larva
}

/// One thing wrong with a plan, and where.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FieldError {
    /// JSON pointer into the body, as `/plate_map/3/well`.
    pub pointer: String,
    pub detail: String,
}

/// Longest name that fits every file system and label.
const NAME_LIMIT: usize = 64;

/// Whether a name may stand in a path and a URL: letters, digits, `-`, `_` and `.`, not first a dot.
pub fn is_plain_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= NAME_LIMIT
        && !name.starts_with('.')
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.'))
}

/// Whether a name is a well's, of plates of 384 at most: `A01` to `P24`.
pub fn is_well(name: &str) -> bool {
    let b = name.as_bytes();
    b.len() == 3
        && (b'A'..=b'P').contains(&b[0])
        && b[1..].iter().all(u8::is_ascii_digit)
        && (1..=24).contains(&(u32::from(b[1] - b'0') * 10 + u32::from(b[2] - b'0')))
}

impl RunPlan {
    /// Everything that is wrong with the plan, not the first thing only. `methods` are the configuration's.
    ///
    /// # Errors
    /// The list, when it is not empty.
    pub fn check<M>(&self, methods: &BTreeMap<String, M>) -> Result<(), Vec<FieldError>> {
        let mut errors = Vec::new();
        let mut wrong = |pointer: String, detail: String| errors.push(FieldError { pointer, detail });
        let plain = "use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'";
        if !is_plain_name(&self.plate_barcode) {
            wrong("/plate_barcode".into(), format!("{:?} is not a barcode: {plain}", self.plate_barcode));
        }
        if self.operator.trim().is_empty() {
            wrong("/operator".into(), "the operator's name is empty".into());
        }
        if !methods.contains_key(&self.method) {
            let known = methods.keys().cloned().collect::<Vec<_>>().join(", ");
            wrong("/method".into(), format!("{:?} is not a method of this instrument; it has: {known}", self.method));
        }
        if self.plate_map.is_empty() {
            wrong("/plate_map".into(), "the plate map names no well".into());
        }
        let mut seen = BTreeSet::new();
        for (i, w) in self.plate_map.iter().enumerate() {
            if !is_well(&w.well) {
                wrong(format!("/plate_map/{i}/well"), format!("{:?} is not a well: A01 to P24", w.well));
            } else if !seen.insert(&w.well) {
                wrong(format!("/plate_map/{i}/well"), format!("{} stands in the plate map twice", w.well));
            }
            if let Some(dpf) = w.dpf.filter(|d| !(0.0..=30.0).contains(d)) {
                wrong(format!("/plate_map/{i}/dpf"), format!("{dpf} is not an age in days post fertilisation: 0 to 30"));
            }
        }
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn methods() -> BTreeMap<String, u8> {
        BTreeMap::from([("standard".into(), 0)])
    }

    #[test]
    fn every_mistake_is_listed_with_its_place() {
        let plan: RunPlan = serde_json::from_str(
            r#"{"plate_barcode": "../x", "method": "fast", "operator": " ",
                "plate_map": [{"well": "A01"}, {"well": "A1"}, {"well": "A01"}, {"well": "Q01"}, {"well": "P25", "dpf": -1}]}"#,
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
    fn a_sound_plan_passes_and_unknown_keys_do_not() {
        let ok = r#"{"plate_barcode": "P-1", "method": "standard", "operator": "kim", "plate_map": [{"well": "P24", "specimen": "bead"}]}"#;
        serde_json::from_str::<RunPlan>(ok).unwrap().check(&methods()).unwrap();
        assert!(serde_json::from_str::<RunPlan>(&ok.replace("operator", "operater")).is_err());
    }
}
