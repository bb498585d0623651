//! Bytes from the host: the receive buffer, and the line that is gathered from it.
//!
//! ```text
//!   bytes ──► receive buffer (128 or 1024 bytes) ──► line (80 bytes) ──► the main loop
//!              └── more: dropped without a message    └── more: Overflow
//! ```

use std::collections::VecDeque;

/// A line has 80 bytes, one of them for the terminator.
const LINE_BYTES: usize = 80 - 1;

/// The line was too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Overflow;

pub(super) struct Input {
    received: VecDeque<u8>,
    capacity: usize,
    line: LineBuffer,
}

impl Input {
    /// An empty receive buffer for `capacity` bytes.
    pub fn new(capacity: usize) -> Self {
        Self { received: VecDeque::new(), capacity, line: LineBuffer::default() }
    }

    /// Puts a byte into the receive buffer. Returns `false` if there is no room, and drops the byte.
    pub fn receive(&mut self, byte: u8) -> bool {
        let has_room = self.received.len() < self.capacity;
        if has_room {
            self.received.push_back(byte);
        }
        has_room
    }

    /// Free bytes of the receive buffer.
    pub fn free(&self) -> usize {
        self.capacity - self.received.len()
    }

    pub fn is_empty(&self) -> bool {
        self.received.is_empty()
    }

    /// Reads one byte of the receive buffer. Returns a line at its terminator.
    pub fn read_byte(&mut self) -> Option<Result<Vec<u8>, Overflow>> {
        let byte = self.received.pop_front()?;
        self.line.push(byte)
    }

    /// Drops all bytes.
    pub fn clear(&mut self) {
        *self = Self::new(self.capacity);
    }
}

/// Gathers a line as the firmware does: it drops white space and comments, and makes letters upper case.
#[derive(Default)]
struct LineBuffer {
    bytes: Vec<u8>,
    overflow: bool,
    comment: Comment,
}

#[derive(Default, PartialEq)]
enum Comment {
    #[default]
    None,
    Parenthesis,
    Semicolon,
}

impl LineBuffer {
    fn push(&mut self, byte: u8) -> Option<Result<Vec<u8>, Overflow>> {
        if matches!(byte, b'\n' | b'\r') {
            let done = std::mem::take(self);
            return Some(if done.overflow { Err(Overflow) } else { Ok(done.bytes) });
        }
        match (&self.comment, byte) {
            (Comment::Parenthesis, b')') => self.comment = Comment::None,
            (Comment::Parenthesis | Comment::Semicolon, _) | (_, ..=b' ' | b'/') => {}
            (_, b'(') => self.comment = Comment::Parenthesis,
            (_, b';') => self.comment = Comment::Semicolon,
            _ if self.bytes.len() >= LINE_BYTES => self.overflow = true,
            _ => self.bytes.push(byte.to_ascii_uppercase()),
        }
        None
    }
}
