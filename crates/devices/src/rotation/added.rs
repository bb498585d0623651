//! Drivers that a test adds to the registry while it runs. No release build has this.

use super::driver::{Driver, Entry, entry};
use serde_json::Value;
use std::sync::{Arc, Mutex, PoisonError};

/// Reads the keys of `[rotation]`, without `driver`.
pub type Read = fn(&Value) -> Result<Arc<dyn Driver>, String>;

static ADDED: Mutex<Vec<(&'static Entry, Read)>> = Mutex::new(Vec::new());

/// Adds a driver to the registry, unless one of its name is there.
pub fn add(added: &'static Entry, read: Read) {
    if entry(added.name).is_none() {
        ADDED.lock().unwrap_or_else(PoisonError::into_inner).push((added, read));
    }
}

fn all() -> Vec<(&'static Entry, Read)> {
    ADDED.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

pub(super) fn entries() -> impl Iterator<Item = &'static Entry> {
    all().into_iter().map(|(entry, _)| entry)
}

/// The settings of an added driver.
#[derive(Debug, Clone)]
pub struct Added {
    entry: &'static Entry,
    read: Read,
    keys: Value,
    settings: Arc<dyn Driver>,
}

impl Added {
    pub(super) fn read(name: &str, keys: Value) -> Result<Self, String> {
        let found = all().into_iter().find(|(entry, _)| entry.name == name);
        let (entry, read) = found.ok_or_else(|| format!("the driver {name:?} was not added"))?;
        Ok(Self { entry, read, settings: read(&keys)?, keys })
    }

    pub(super) fn entry(&self) -> &'static Entry {
        self.entry
    }

    pub(super) fn settings(&self) -> &dyn Driver {
        &*self.settings
    }

    /// Clones share their settings, so a change begins with settings that are read again.
    pub(super) fn settings_mut(&mut self) -> Option<&mut (dyn Driver + 'static)> {
        self.settings = (self.read)(&self.keys).ok()?;
        Arc::get_mut(&mut self.settings)
    }
}
