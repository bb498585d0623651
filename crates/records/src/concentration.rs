//! Units of concentration in plate maps. HTTP bodies and results use one spelling. Files may use common variants.

use serde::{Deserialize, Serialize};

/// A unit as the lab wrote it. `ug/mL` and `mg/L` are the same amount, but are not converted into each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
pub enum ConcentrationUnit {
    #[serde(rename = "M")]
    Molar,
    #[serde(rename = "mM")]
    Millimolar,
    #[serde(rename = "uM")]
    Micromolar,
    #[serde(rename = "nM")]
    Nanomolar,
    #[serde(rename = "pM")]
    Picomolar,
    #[serde(rename = "g/L")]
    GramPerLitre,
    #[serde(rename = "mg/L")]
    MilligramPerLitre,
    #[serde(rename = "ug/L")]
    MicrogramPerLitre,
    #[serde(rename = "ng/L")]
    NanogramPerLitre,
    #[serde(rename = "mg/mL")]
    MilligramPerMillilitre,
    #[serde(rename = "ug/mL")]
    MicrogramPerMillilitre,
    #[serde(rename = "ng/mL")]
    NanogramPerMillilitre,
    #[serde(rename = "%")]
    Percent,
    #[serde(rename = "% v/v")]
    PercentByVolume,
    #[serde(rename = "% w/v")]
    PercentWeightByVolume,
    #[serde(rename = "ppm")]
    PartsPerMillion,
}

impl ConcentrationUnit {
    pub const ALL: [Self; 16] = [
        Self::Molar,
        Self::Millimolar,
        Self::Micromolar,
        Self::Nanomolar,
        Self::Picomolar,
        Self::GramPerLitre,
        Self::MilligramPerLitre,
        Self::MicrogramPerLitre,
        Self::NanogramPerLitre,
        Self::MilligramPerMillilitre,
        Self::MicrogramPerMillilitre,
        Self::NanogramPerMillilitre,
        Self::Percent,
        Self::PercentByVolume,
        Self::PercentWeightByVolume,
        Self::PartsPerMillion,
    ];

    /// The spelling in HTTP bodies and results.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Molar => "M",
            Self::Millimolar => "mM",
            Self::Micromolar => "uM",
            Self::Nanomolar => "nM",
            Self::Picomolar => "pM",
            Self::GramPerLitre => "g/L",
            Self::MilligramPerLitre => "mg/L",
            Self::MicrogramPerLitre => "ug/L",
            Self::NanogramPerLitre => "ng/L",
            Self::MilligramPerMillilitre => "mg/mL",
            Self::MicrogramPerMillilitre => "ug/mL",
            Self::NanogramPerMillilitre => "ng/mL",
            Self::Percent => "%",
            Self::PercentByVolume => "% v/v",
            Self::PercentWeightByVolume => "% w/v",
            Self::PartsPerMillion => "ppm",
        }
    }

    /// Reads a unit from a file: with either micro sign, `l` for litre, `mol/L` for `M`, and any blanks and brackets. The case matters only
    /// before `M` (`mM` is not `MM`). `None` if the unit is unknown.
    pub fn from_file(written: &str) -> Option<Self> {
        let meant = |c: char| if matches!(c, 'µ' | 'μ') { 'u' } else { c };
        let plain: String = written.chars().filter(|c| !c.is_whitespace() && !matches!(c, '(' | ')')).map(meant).collect();
        let molar = ["mol/L", "mol/l"].iter().find_map(|end| plain.strip_suffix(end)).map(|prefix| format!("{prefix}M"));
        let plain = molar.unwrap_or(plain);
        Self::ALL.into_iter().find(|unit| {
            let symbol: String = unit.symbol().split(' ').collect();
            if symbol.ends_with('M') { symbol == plain } else { symbol.eq_ignore_ascii_case(&plain) }
        })
    }

    /// All symbols, for an error message.
    pub fn known() -> String {
        Self::ALL.map(Self::symbol).join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_symbol_is_the_word_of_the_wire_and_of_files() {
        for unit in ConcentrationUnit::ALL {
            assert_eq!(serde_json::to_value(unit).unwrap(), unit.symbol());
            assert_eq!(ConcentrationUnit::from_file(unit.symbol()), Some(unit));
        }
    }

    #[test]
    fn units_are_read_as_people_write_them() {
        use ConcentrationUnit as U;
        for (written, unit) in [
            ("µM", U::Micromolar),
            ("μM", U::Micromolar),
            (" nM ", U::Nanomolar),
            ("µmol/L", U::Micromolar),
            ("mol/l", U::Molar),
            ("µg/ml", U::MicrogramPerMillilitre),
            ("MG/L", U::MilligramPerLitre),
            ("%(v/v)", U::PercentByVolume),
            ("% (w/v)", U::PercentWeightByVolume),
        ] {
            assert_eq!(U::from_file(written), Some(unit), "{written}");
        }
        // A wrong case can hide an error by a factor of 1000. Ambiguous units are refused.
        for wrong in ["", "m", "um", "MM", "UM", "uMol", "ol/L", "xmol/L", "furlong", "mg"] {
            assert_eq!(U::from_file(wrong), None, "{wrong}");
        }
    }
}
