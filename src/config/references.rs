//! Reference larvae from TOML: the built-in ones of the paper, or a lab's own files.

use carved_core::measure::references::{Breach, References};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The references of the paper, from `config/references/`.
const EMBEDDED: [(&str, &str); 2] = [
    ("guo2017-fixed.toml (built in)", include_str!("../../config/references/guo2017-fixed.toml")),
    ("guo2017-living.toml (built in)", include_str!("../../config/references/guo2017-living.toml")),
];

#[derive(Debug, thiserror::Error)]
pub enum ReferencesError {
    #[error("{}: cannot read the references: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: {source}", path.display())]
    Syntax { path: PathBuf, source: Box<toml::de::Error> },
    #[error("{}: {} value(s) cannot be used: {}", path.display(), breaches.len(), list(breaches))]
    Breaches { path: PathBuf, breaches: Vec<Breach> },
}

fn list(breaches: &[Breach]) -> String {
    breaches.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// The reference larvae of the paper.
pub fn embedded() -> Result<Arc<[References]>, ReferencesError> {
    EMBEDDED.iter().map(|(name, text)| parse(text, Path::new(name))).collect()
}

pub fn load(path: &Path) -> Result<References, ReferencesError> {
    let text = carved_files::read_to_string(path).map_err(|source| ReferencesError::Read { path: path.to_owned(), source })?;
    parse(&text, path)
}

/// Parses and checks references. `path` names the source in errors.
///
/// # Errors
/// Another form, or values that cannot be used.
pub fn parse(text: &str, path: &Path) -> Result<References, ReferencesError> {
    let found: References = toml::from_str(text).map_err(|e| ReferencesError::Syntax { path: path.to_owned(), source: Box::new(e) })?;
    let breaches = found.check();
    if breaches.is_empty() { Ok(found) } else { Err(ReferencesError::Breaches { path: path.to_owned(), breaches }) }
}
