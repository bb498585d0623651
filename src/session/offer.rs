//! The configured methods in short, as a run may name them.

use crate::api::MethodOffer;
use carved_records::{Method, Versioned};

impl MethodOffer {
    pub fn new(name: &str, method: &Method) -> Self {
        Self {
            name: name.to_owned(),
            version: method.version.clone(),
            asd: method.asd,
            order: method.order,
            epsilon: method.epsilon,
            voxel_um: method.voxel_um,
        }
    }
}

impl Versioned for MethodOffer {
    fn version(&self) -> Option<&str> {
        self.version.as_deref()
    }
}
