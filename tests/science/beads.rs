//! Recordings of beads with known numbers, without frames.

use carved::config::Config;
use carved_core::frame::PixelFormat;
use carved_core::units::Sense;
use carved_records::{Mode, PlannedWell, SpecimenKind};
use carved_store::{Recording, RigRecord};
use serde_json::json;
use std::path::{Path, PathBuf};

/// The recording of a bead: day of November 2026, diameter in um, length over width, uy in px.
pub struct Bead(pub u32, pub f64, pub f64, pub f64);

fn record(folder: &Path, rig: &str, bead: &Bead) {
    let &Bead(day, diameter_um, aspect, uy_px) = bead;
    let config = Config::parse(include_str!("../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
    let rig = RigRecord {
        name: rig.into(),
        camera: config.optics.clone(),
        pixel_format: PixelFormat::BayerRG8,
        empty_capillary_sha256: None,
        steps_per_revolution: config.steps_per_revolution,
        sense: Sense::default(),
        rotation_identity: String::new(),
        camera_identity: String::new(),
        camera_features: std::collections::BTreeMap::default(),
        second: None,
    };
    let mut psi = config.optics.clone();
    (psi.uy, psi.gamma) = (uy_px, 1e-4 * uy_px);
    let well = PlannedWell::new(folder.file_name().unwrap().to_str().unwrap(), SpecimenKind::Bead, None);
    let mut recording = Recording::new("r", well, Mode::Simulated, rig, "standard", config.methods["standard"].clone());
    recording.started = format!("2026-11-{day:02}T09:00:00Z");
    let view = |bore_um: f64| {
        json!({"index": 0, "omega": 0.0, "used": true, "reason": null, "area_px": 1,
               "walls": {"bore_um": bore_um, "shift_px": 0.0, "tilt_deg": 0.0}})
    };
    let measurement = json!({
        "mode": "simulated",
        "measurement": {
            "voxels": 1, "voxel_size_um": 10.0, "views": 2, "planned_views": 2, "epsilon": 0.05, "estimator": "voxel", "fallback": null,
            "volume_um3": 1.0, "mesh_volume_um3": 1.0, "fairing_volume_loss": 0.0, "area_um2": 1.0,
            "estimators": {"voxel": {"volume_um3": 1.0, "area_um2": 1.0}, "support": null}, "unfaired_area_um2": 1.0,
            "area_method": {"operator": "umbrella", "lambda": 0.8, "iterations": 10}, "field_volume_um3": 1.0, "field_area_um2": 1.0,
            "centroid_um": [0.0, 0.0, 0.0], "extent_um": [1.0, 1.0, 1.0], "length_um": 1.0, "sphere": null,
            "diameter_um": diameter_um, "sphere_rms_um": 0.7, "aspect_ratio": aspect,
        },
        "views": [view(diameter_um + 149.0), view(diameter_um + 151.0)],
        "closure": null,
        "calibration": {"psi": psi, "uy_sd_px": 0.02, "gamma_sd_rad": 1e-5, "alpha_sd_rad": 1e-2, "rho": 1.0, "rho_sd": 1e-4,
                        "residual_sd_um": 1.0, "passes": 4, "converged": true, "moved": null},
        "flags": [],
    });
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("recording.json"), serde_json::to_vec(&recording).unwrap()).unwrap();
    std::fs::write(folder.join("measurement.json"), measurement.to_string()).unwrap();
}

/// A run of beads in the wells A01, A02, ...
pub fn run(under: &Path, name: &str, rig: &str, beads: &[Bead]) -> PathBuf {
    let run = under.join(name);
    for (i, bead) in beads.iter().enumerate() {
        record(&run.join(format!("A{:02}", i + 1)), rig, bead);
    }
    std::fs::write(run.join("run.json"), "{}").unwrap();
    run
}
