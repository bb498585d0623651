//! Settings of the drivers for the emulated controllers.

use carved_devices::rotation::{AxisLetter, Dialect, GrblSettings, Port, Reference};
use hardware_sim::Rig;

/// The serial port of a rig.
pub fn serial_port(rig: &Rig) -> Port {
    Port::Path(rig.serial_path().to_str().unwrap().into())
}

/// The defaults of the emulated firmware: 100 steps per unit, 500 units/min, 20 units/s^2.
pub fn grbl(port: Port, reference: Reference) -> GrblSettings {
    GrblSettings {
        port,
        baud: 115_200,
        axis: AxisLetter::X,
        steps_per_unit: [100, 1],
        max_rate_units_per_min: 500.0,
        acceleration_units_per_s2: 20.0,
        reference,
        dialect: Dialect::Auto,
        answer_timeout_ms: 2000,
        homing_timeout_ms: 60_000,
        outputs: std::collections::BTreeMap::new(),
    }
}
