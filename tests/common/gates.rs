//! Bead gates of seven days.

use carved_core::quality::gate::{BeadGate, BeadMeasured, GateSettings};
use carved_records::Mode;
use carved_store::Software;
use carved_store::gates::{self, GateFile, MeasuredGate};
use std::path::Path;

/// Keeps gates of 1 to 7 January 2026 in a folder of calibrations. The beads of the last day are 20 um larger.
pub fn keep(folder: &Path) {
    let settings = GateSettings::default();
    let mut history = Vec::new();
    for day in 1..=7u32 {
        let off = if day == 7 { 20.0 } else { f64::from(day % 2) };
        let beads: Vec<BeadMeasured> = (0..3u32)
            .map(|i| BeadMeasured {
                bead: format!("A0{i}"),
                diameter_um: 500.0 + off + f64::from(i),
                aspect_ratio: 1.0,
                sphere_rms_um: 0.5,
                residual_px: None,
                uy_px: Some(511.5),
                gamma_deg: Some(0.25),
            })
            .collect();
        let gate = BeadGate::of(&beads, &history, &settings).unwrap();
        history.push(gate.numbers.clone());
        let measured: jiff::Timestamp = format!("2026-01-{day:02}T08:00:00Z").parse().unwrap();
        let found = MeasuredGate {
            rig: "rig".into(),
            mode: Mode::Simulated,
            measured,
            recordings: Vec::new(),
            passed_over: Vec::new(),
            method: "m".into(),
            method_version: None,
            settings,
            begins_history: false,
            gate,
        };
        let file = GateFile { schema: gates::SCHEMA.into(), id: format!("{day:012}"), software: Software::this(), date: measured, found };
        gates::keep(folder, &file).unwrap();
    }
}
