//! Recordings, as `carved measure` reads them.

use super::arrays::{Memory, view};
use super::errors::{input, of_numbers, of_store, report};
use super::measured::{Numbers, file_text};
use super::task::{self, Steps};
use carved_offline::recording::{self, NumbersError};
use carved_records::{LedgerEntry, Method};
use carved_store::{MEASUREMENT, RecordingReader};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A recording: its folder, its `recording.json` or its pack.
#[pyclass(frozen)]
pub struct NativeRecording(RecordingReader);

#[pymethods]
impl NativeRecording {
    #[new]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| RecordingReader::open(&path)).map(Self).map_err(of_store)
    }

    /// `recording.json`.
    #[getter]
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(self.0.recording()).map_err(report)
    }

    /// The stored numbers, byte for byte.
    #[getter]
    fn stored(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let bytes = py.detach(|| self.0.files().read(MEASUREMENT)).map_err(of_store)?;
        bytes.map(|bytes| String::from_utf8(bytes).map_err(input)).transpose()
    }

    /// Number, angle (rad) and whether it is the closure view, of each view that counts.
    #[getter]
    fn views(&self) -> Vec<(u32, f64, bool)> {
        self.0.recording().ledger.counted().map(|e| (e.view, e.omega, e.closure)).collect()
    }

    /// The frame of a view, by its place in `views`.
    fn frame(&self, py: Python<'_>, place: usize) -> PyResult<Py<PyArrayDyn<u8>>> {
        let counted: Vec<&LedgerEntry> = self.0.recording().ledger.counted().collect();
        let entry = counted.get(place).ok_or_else(|| input(format!("there is no view {place}; the recording has {}", counted.len())))?;
        let frame = py.detach(|| self.0.frame(entry)).map_err(of_store)?;
        view(py, Memory::Frame(frame))
    }

    /// The picture of the empty capillary.
    #[getter]
    fn empty(&self, py: Python<'_>) -> PyResult<Option<Py<PyArrayDyn<u8>>>> {
        let frame = py.detach(|| self.0.empty_capillary()).map_err(of_store)?;
        frame.map(|frame| view(py, Memory::Frame(frame))).transpose()
    }

    /// The numbers, computed again.
    #[pyo3(signature = (asd, progress))]
    fn measure(&self, py: Python<'_>, asd: Option<u32>, progress: Option<Py<PyAny>>) -> PyResult<Numbers> {
        let recorded = &self.0.recording().method;
        let method = Method { asd: asd.unwrap_or(recorded.asd), ..recorded.clone() };
        let entries = recording::views(&self.0, &method).map_err(of_numbers)?;
        let work = |steps: &Steps| -> Result<_, NumbersError> {
            let found = recording::compute(&self.0, &method, &entries, |_, _| steps.step())?;
            steps.step()?;
            Ok(found)
        };
        let found = task::run(py, progress.as_ref(), entries.len() + 1, work)?.map_err(of_numbers)?;
        Numbers::new(py, file_text(&found.file)?, found.mesh, Some(found.hull))
    }
}
