//! The paper's tables, for comparison.

use serde::Deserialize;
use std::collections::BTreeMap;

const TABLES: &str = include_str!("guo2017.json");

/// Means and standard deviations, one per sampling density or per ASD.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Row {
    #[serde(alias = "measured_mean")]
    pub mean: Vec<f64>,
    #[serde(alias = "measured_sd")]
    pub sd: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Published {
    pub source: String,
    pub sampling_density_um: Vec<f64>,
    pub asd: Vec<usize>,
    /// Rows by ASD.
    #[serde(rename = "table1_bead_diameter_um")]
    pub diameter_um: BTreeMap<usize, Row>,
    #[serde(rename = "table2_bead_volume_1e7_um3")]
    pub volume_1e7_um3: BTreeMap<usize, Row>,
    #[serde(rename = "table3_bead_area_1e5_um2")]
    pub area_1e5_um2: BTreeMap<usize, Row>,
    /// Rows by dpf, columns by ASD.
    #[serde(rename = "table5_larva_area_1e6_um2")]
    pub larva_area_1e6_um2: BTreeMap<u8, Row>,
}

impl Published {
    /// Reads the built-in tables.
    ///
    /// # Errors
    /// None for the built-in tables.
    pub fn read() -> Result<Self, serde_json::Error> {
        serde_json::from_str(TABLES)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_table_has_a_number_for_each_asd_and_sampling_density() {
        let p = Published::read().unwrap();
        assert_eq!((p.asd.len(), p.sampling_density_um.len()), (8, 7));
        for table in [&p.diameter_um, &p.volume_1e7_um3, &p.area_1e5_um2] {
            assert!(p.asd.iter().all(|asd| table[asd].mean.len() == 7 && table[asd].sd.len() == 7));
        }
        assert!([3, 4, 5].iter().all(|dpf| p.larva_area_1e6_um2[dpf].mean.len() == 8));
        // One corner of each table.
        assert!((p.diameter_um[&84].mean[6] - 498.05).abs() < 1e-9 && (p.volume_1e7_um3[&4].mean[0] - 7.073).abs() < 1e-9);
        assert!((p.area_1e5_um2[&21].sd[1] - 0.802).abs() < 1e-9 && (p.larva_area_1e6_um2[&5].mean[7] - 3.55).abs() < 1e-9);
    }
}
