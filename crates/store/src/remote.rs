//! Recordings of copies in an object store, fetched to be read.
//!
//! ```text
//!  s3://BUCKET/PREFIX/RUN/archive.json ── the receipt: which files the copy has, and their hashes
//!                         A01.tar, or A01/recording.json ... ── FOLDER/RUN/A01.tar or A01, every hash compared
//! ```

use super::pack::{RecordingFiles, pack_of, recording_of};
use super::receipt::{RECEIPT, Receipt, SCHEMA};
use super::recording::MEASUREMENT;
use super::{Objects, StoreError, durable, schema, sums};
use carved_records::sha256_hex;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The addresses `s3://BUCKET/PREFIX/RUN/WELL` of what an address names: a copy of a run stands for its recordings with numbers, and one of a
/// recording, also `WELL.tar`, for itself.
///
/// # Errors
/// There is no complete copy of a run, it has no such recording, or the store cannot be reached.
pub fn recordings_at(objects: &dyn Objects, address: &str) -> Result<Vec<String>, StoreError> {
    let address = address.trim_end_matches('/');
    let wrong = |why: String| StoreError::Remote { address: address.to_owned(), why };
    if let Some(receipt) = receipt_at(objects, address)? {
        let measured: Vec<String> =
            recordings(&receipt).into_iter().filter(|name| receipt.files.contains_key(&Path::new(name).join(MEASUREMENT))).collect();
        if measured.is_empty() {
            return Err(wrong("no recording of this run was measured".into()));
        }
        return Ok(measured.into_iter().map(|name| format!("{address}/{name}")).collect());
    }
    let one = address.strip_suffix(".tar").unwrap_or(address);
    let receipt = run_of(one).map(|(run, name)| Ok(receipt_at(objects, run)?.map(|receipt| (receipt, name)))).transpose()?.flatten();
    let Some((receipt, name)) = receipt else {
        return Err(wrong(format!(
            "there is no {RECEIPT} of a copy. Expected a copy that `carved archive` completed, such as s3://BUCKET/PREFIX/RUN, or a recording \
             in it, s3://BUCKET/PREFIX/RUN/A01"
        )));
    };
    let known = recordings(&receipt);
    if known.contains(name) {
        return Ok(vec![one.to_owned()]);
    }
    Err(wrong(format!("the copy has no recording {name}; it has {}", known.into_iter().collect::<Vec<_>>().join(", "))))
}

/// Fetches a recording by its address, one of [`recordings_at`], into `folder/RUN`. Returns its folder there, or its pack. Each file is compared
/// with the receipt of the copy.
///
/// # Errors
/// A file is missing in the store or was altered, the store cannot be reached, or the file cannot be written.
pub fn fetch(objects: &dyn Objects, address: &str, folder: &Path) -> Result<PathBuf, StoreError> {
    let gone = |address: &str| StoreError::Vanished { path: address.into() };
    let (run, name) = run_of(address).ok_or_else(|| gone(address))?;
    let receipt = receipt_at(objects, run)?.ok_or_else(|| gone(run))?;
    let here = folder.join(&receipt.run).join(name);
    let get = |address: &str| objects.get(address)?.ok_or_else(|| gone(address));
    let files = || receipt.files.iter().filter_map(|(file, hash)| Some((file.strip_prefix(name).ok()?, hash)));
    let found = if receipt.packed.contains(name) {
        let pack = pack_of(&here);
        durable::create_folder(durable::folder_of(&pack))?;
        durable::write(&pack, &get(&format!("{address}.tar"))?)?;
        pack
    } else {
        for (file, _) in files() {
            let path = here.join(file);
            durable::create_folder(durable::folder_of(&path))?;
            durable::write(&path, &get(&format!("{address}/{}", file.display()))?)?;
        }
        here
    };
    let fetched = RecordingFiles::of(&found)?;
    for (file, hash) in files() {
        let inside = format!("{address}/{}", file.display());
        let bytes = fetched.read(&file.to_string_lossy())?.ok_or_else(|| gone(&inside))?;
        sums::same(Path::new(&inside), hash, &sha256_hex(&bytes))?;
    }
    Ok(found)
}

/// The run and the last part of the address of a recording.
fn run_of(address: &str) -> Option<(&str, &str)> {
    address.rsplit_once('/').filter(|(run, name)| !run.ends_with('/') && !name.is_empty())
}

fn receipt_at(objects: &dyn Objects, run: &str) -> Result<Option<Receipt>, StoreError> {
    let address = format!("{run}/{RECEIPT}");
    objects.get(&address)?.map(|text| schema::parse(Path::new(&address), &text, SCHEMA)).transpose()
}

/// The recordings that a copy has files of.
fn recordings(receipt: &Receipt) -> BTreeSet<String> {
    receipt.files.keys().filter_map(|name| recording_of(name)).map(str::to_owned).collect()
}
