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
pub const EVENTS: &str = "events.jsonl";

/// Number of bytes per read, backwards from the end.
const CHUNK: usize = 64 * 1024;

/// Most bytes of the last lines that are read. 2000 events take about 1 MB.
const LONGEST: usize = 64 << 20;

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
        if path.symlink_metadata().is_err() {
            disk::create(path, b"").map_err(io("create"))?;
        }
        let file = carved_files::open_own(path, OpenOptions::new().read(true).append(true)).map_err(io("open"))?;
        durable::sync_folder(durable::folder_of(path))?;
        let length = file.metadata().map_err(io("look at"))?.len();
        let mut lines = Self { file, path: path.to_owned(), good_bytes: length };
        lines.good_bytes = lines.end_of_last_line()?;
        if lines.good_bytes < length {
            disk::cut(&lines.file, path, lines.good_bytes).map_err(io("cut the torn last line of"))?;
        }
        Ok(lines)
    }

    pub fn good_bytes(&self) -> u64 {
        self.good_bytes
    }

    /// The bytes of the file from its end to its beginning, chunk by chunk with the position of each, until `take` has enough.
    fn backwards(&self, mut take: impl FnMut(u64, Vec<u8>) -> bool) -> Result<(), StoreError> {
        let mut start = self.good_bytes;
        while start > 0 {
            let size = CHUNK.min(usize::try_from(start).unwrap_or(CHUNK));
            start -= size as u64;
            let mut chunk = vec![0; size];
            self.file.read_exact_at(&mut chunk, start).map_err(StoreError::io("read", &self.path))?;
            if !take(start, chunk) {
                break;
            }
        }
        Ok(())
    }

    /// Length up to the last line feed. Memory does not grow with what is behind it.
    fn end_of_last_line(&self) -> Result<u64, StoreError> {
        let mut end = 0;
        self.backwards(|start, chunk| {
            let found = chunk.iter().rposition(|&b| b == b'\n');
            end = found.map_or(0, |at| start + at as u64 + 1);
            found.is_none()
        })?;
        Ok(end)
    }

    /// The last `count` lines, oldest first, without line feeds: as many of them as [`LONGEST`] bytes hold.
    pub fn tail(&self, count: usize) -> Result<Vec<Vec<u8>>, StoreError> {
        // One line feed more than lines, because the first chunk begins inside a line.
        let (mut first, mut feeds, mut bytes, mut chunks) = (self.good_bytes, 0, 0, Vec::new());
        self.backwards(|start, chunk| {
            first = start;
            feeds += chunk.split(|&b| b == b'\n').count() - 1;
            bytes += chunk.len();
            chunks.push(chunk);
            feeds <= count + 1 && bytes < LONGEST
        })?;
        chunks.reverse();
        let text = chunks.concat();
        let mut lines: Vec<&[u8]> = text.split(|&b| b == b'\n').collect();
        if first > 0 {
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

    /// Each byte is read once: the whole end would otherwise be copied and searched again for every chunk.
    #[test]
    fn a_torn_line_of_any_length_is_cut_off_and_each_byte_of_it_is_read_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lines");
        std::fs::write(&path, "one\n").unwrap();
        OpenOptions::new().write(true).open(&path).unwrap().set_len(200_000_000).unwrap();
        let lines = Lines::open(&path).unwrap();
        assert_eq!((lines.good_bytes(), lines.tail(5).unwrap()), (4, vec![b"one".to_vec()]));
        // A whole line that is as long is read up to a bound.
        let mut file = OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(2 * LONGEST as u64).unwrap();
        std::io::Seek::seek(&mut file, std::io::SeekFrom::End(0)).unwrap();
        std::io::Write::write_all(&mut file, b"\nlast\n").unwrap();
        assert_eq!(Lines::open(&path).unwrap().tail(5).unwrap(), vec![b"last".to_vec()]);
    }

    #[test]
    fn a_file_of_lines_is_no_link_and_no_pipe() {
        let dir = tempfile::tempdir().unwrap();
        let (pipe, dangling) = (dir.path().join("pipe"), dir.path().join("dangling"));
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        std::os::unix::fs::symlink(dir.path().join("elsewhere"), &dangling).unwrap();
        for (path, what) in [(&pipe, "a pipe"), (&dangling, "a link")] {
            let error = Lines::open(path).err().unwrap().to_string();
            assert!(error.contains(what), "{error}");
        }
        assert!(!dir.path().join("elsewhere").exists());
    }
}
