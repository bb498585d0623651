//! An append-only file of lines. Lines that were appended and kept are complete. The rest of a torn line is cut off.
//!
//! ```text
//! line\nline\nline\n│li          open: cut after the last complete line
//!                   └ good_bytes
//! ```

use super::{StoreError, disk, durable};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// The journal of a data folder, and the events of a run in its folder.
pub(super) const EVENTS: &str = "events.jsonl";

/// Number of bytes per read, backwards from the end.
const CHUNK: usize = 64 * 1024;

pub(super) struct Lines {
    file: File,
    path: PathBuf,
    /// Length up to which every line is complete, synced and kept.
    good_bytes: u64,
}

impl Lines {
    /// Opens or creates the file. A torn last line is cut off, because it was never acknowledged.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let io = |what| StoreError::io(what, path);
        if !path.exists() {
            disk::create(path, b"").map_err(io("create"))?;
        }
        std::fs::metadata(path).and_then(|found| carved_files::check(found.file_type())).map_err(io("open"))?;
        let file = OpenOptions::new().read(true).append(true).open(path).map_err(io("open"))?;
        durable::sync_folder(durable::folder_of(path))?;
        let length = file.metadata().map_err(io("look at"))?.len();
        let mut lines = Self { file, path: path.to_owned(), good_bytes: length };
        let (start, end) = lines.last_chunk(|text| text.contains(&b'\n'))?;
        lines.good_bytes = end.iter().rposition(|&b| b == b'\n').map_or(0, |at| start + at as u64 + 1);
        if lines.good_bytes < length {
            disk::cut(&lines.file, path, lines.good_bytes).map_err(io("cut the torn last line of"))?;
        }
        Ok(lines)
    }

    pub fn good_bytes(&self) -> u64 {
        self.good_bytes
    }

    /// The end of the file: the smallest number of chunks that is `enough`, and its position.
    fn last_chunk(&self, enough: impl Fn(&[u8]) -> bool) -> Result<(u64, Vec<u8>), StoreError> {
        let (mut start, mut text) = (self.good_bytes, Vec::new());
        while start > 0 && !enough(&text) {
            let size = CHUNK.min(start as usize);
            start -= size as u64;
            let mut front = vec![0; size];
            self.file.read_exact_at(&mut front, start).map_err(StoreError::io("read", &self.path))?;
            front.append(&mut text);
            text = front;
        }
        Ok((start, text))
    }

    /// The last `count` lines, oldest first, without line feeds.
    pub fn tail(&self, count: usize) -> Result<Vec<Vec<u8>>, StoreError> {
        // One line feed more than lines, because the first chunk begins inside a line.
        let (start, text) = self.last_chunk(|text| text.split(|&b| b == b'\n').count() > count + 1)?;
        let mut lines: Vec<&[u8]> = text.split(|&b| b == b'\n').collect();
        if start > 0 {
            lines.remove(0);
        }
        lines.retain(|line| !line.is_empty());
        let skip = lines.len().saturating_sub(count);
        Ok(lines[skip..].iter().map(|line| line.to_vec()).collect())
    }

    /// Writes a line (with its line feed), and syncs it with all lines before it. The line counts once it is kept. Otherwise the next line
    /// overwrites it.
    pub fn append(&mut self, line: &[u8]) -> Result<(), StoreError> {
        self.append_unsynced(line)?;
        disk::sync(&self.file, &self.path).map_err(StoreError::io("sync", &self.path))
    }

    /// Writes a line that a power loss may remove.
    pub fn append_unsynced(&mut self, line: &[u8]) -> Result<(), StoreError> {
        let io = |what| StoreError::io(what, &self.path);
        // After a failed write there may be a torn line behind the last good one.
        if self.file.metadata().map_err(io("look at"))?.len() != self.good_bytes {
            disk::cut(&self.file, &self.path, self.good_bytes).map_err(io("cut the torn last line of"))?;
        }
        disk::append(&mut self.file, &self.path, line).map_err(io("append to"))
    }

    /// Removes what was written and not kept. An error is ignored, because the next append does the same.
    pub fn drop_rest(&mut self) {
        let _the_next_append_does_it = disk::cut(&self.file, &self.path, self.good_bytes);
    }

    pub fn keep(&mut self, line: &[u8]) {
        self.good_bytes += line.len() as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Longer than a chunk, so that lines cross its border.
    #[test]
    fn the_tail_is_the_last_lines_whatever_their_length() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lines");
        let all: Vec<String> = (0..400).map(|i| format!("{i}-{}", "x".repeat(i * 7 % 900))).collect();
        std::fs::write(&path, all.iter().map(|l| format!("{l}\n")).collect::<String>() + "torn").unwrap();
        let lines = Lines::open(&path).unwrap();
        assert!(lines.good_bytes() > 2 * CHUNK as u64);
        for count in [0, 1, 7, 250, 399, 400, 4000] {
            let tail: Vec<String> = lines.tail(count).unwrap().into_iter().map(|l| String::from_utf8(l).unwrap()).collect();
            assert_eq!(tail, all[400 - count.min(400)..], "{count}");
        }
        assert!(!std::fs::read_to_string(&path).unwrap().ends_with("torn"));
        std::fs::write(&path, "x".repeat(3 * CHUNK)).unwrap();
        assert_eq!(Lines::open(&path).unwrap().good_bytes(), 0, "one torn line of three chunks");
    }
}
