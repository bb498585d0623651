//! Tests of the limits of a method in a whole configuration.

use carved_records::Method;

const SHIPPED: &str = include_str!("../../config/simulated.toml");

#[test]
fn a_prior_of_nothing_is_refused_with_its_range() {
    let text = SHIPPED.replacen("[methods.standard]\n", "[methods.standard]\ncalibration = { alpha_sd_deg = 0 }\n", 1);
    let refused = crate::config::Config::parse(&text, std::path::Path::new("x.toml")).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("methods.standard.calibration.alpha_sd_deg = 0; expected 0.001 to 1 deg"), "{refused}");
}

#[test]
fn a_version_is_a_word_or_a_number_and_is_recorded() {
    let method = |line: &str| -> Result<Method, toml::de::Error> {
        toml::from_str(&format!("{line}\nasd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 10.0\n"))
    };
    let version = |line: &str| method(line).unwrap().version;
    assert_eq!((version("version = 3"), version("version = \"b-2\""), version("")), (Some("3".into()), Some("b-2".into()), None));
    assert!(method("version = [1]").is_err());
    let recorded = serde_json::to_string(&method("version = 3").unwrap()).unwrap();
    assert!(recorded.contains("\"version\":\"3\""), "{recorded}");
    assert_eq!(serde_json::from_str::<Method>(&recorded).unwrap().version.as_deref(), Some("3"));
}

#[test]
fn a_sequential_turn_does_not_end_early_and_limits_have_ranges() {
    let config = |change: &str| {
        let text = SHIPPED.replacen("[methods.standard]\n", &format!("[methods.standard]\n{change}\n"), 1);
        crate::config::Config::parse(&text, std::path::Path::new("x.toml")).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(config("quality = { residual_px = 2.0 }"), Ok(()));
    let refused = config("early_stop = { enabled = true, min_views = 2 }").unwrap_err();
    assert!(refused.contains("early_stop.enabled = true, with order = \"sequential\"") && refused.contains("min_views = 2"), "{refused}");
    let refused = config("quality = { closure_turn_deg = -1.0, gate = { beads_least = 2 } }").unwrap_err();
    assert!(refused.contains("quality.closure_turn_deg = -1") && refused.contains("quality.gate.beads_least = 2"), "{refused}");
}
