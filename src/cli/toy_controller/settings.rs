//! The `[rotation]` table of the toy.

use super::driver::Toy;
use carved_core::range::{OutOfRange, Range, Ranged};
use carved_core::ranges;
use carved_core::units::StepsPerRevolution;
use carved_devices::rotation::{Driver, Port, TranslationSettings};
use carved_devices::{DeviceError, RotationAxis};
use serde::Deserialize;
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToySettings {
    pub port: Port,
    pub baud: u32,
    pub answer_timeout_ms: u32,
}

impl Ranged for ToySettings {
    const RANGES: &'static [Range<Self>] = ranges![
        baud: 300.0, 4_000_000.0, "baud";
        answer_timeout_ms: 1.0, 10_000.0, "ms";
    ];
}

pub fn read(keys: &serde_json::Value) -> Result<Arc<dyn Driver>, String> {
    let settings = ToySettings::deserialize(keys).map_err(|error| error.to_string())?;
    Ok(Arc::new(settings))
}

impl Driver for ToySettings {
    fn out_of_range(&self) -> Vec<OutOfRange> {
        self.outside()
    }

    fn check_on(&self, _: StepsPerRevolution) -> Result<(), DeviceError> {
        Ok(())
    }

    fn open(&self, _: StepsPerRevolution, _: Option<TranslationSettings>) -> Result<Box<dyn RotationAxis>, DeviceError> {
        Ok(Box::new(Toy::open(self)?))
    }

    fn serial(&self) -> Option<(&Port, u32)> {
        Some((&self.port, self.baud))
    }

    fn connect_to(&mut self, address: String) {
        self.port = Port::Path(address);
    }
}
