//! Mutations of an input: changed, removed, repeated and inserted bytes, pieces of other inputs, numbers at the limits.

/// Texts that parsers treat in a way of their own.
const WORDS: [&[u8]; 22] = [
    b"",
    b"\0",
    b"-1",
    b"0",
    b"NaN",
    b"inf",
    b"-inf",
    b"1e999",
    b"-0",
    b"18446744073709551616",
    b"9223372036854775808",
    b"4294967296",
    b"\"",
    b"\\ud800",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\r\n",
    b",",
    b";",
    b"[[[[[[[[",
    b"{",
    b"]",
];

/// An endless sequence, the same for the same seed.
pub struct Mutations<'a> {
    state: u64,
    content: &'a [u8],
    others: &'a [&'a [u8]],
}

impl<'a> Mutations<'a> {
    pub fn new(seed: u64, content: &'a [u8], others: &'a [&'a [u8]]) -> Self {
        Self { state: seed, content, others }
    }

    /// The generator `SplitMix64`.
    fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next_u64() % end.max(1) as u64) as usize
    }

    /// A range of at most 64 bytes.
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length + 1);
        start..(start + self.below(64)).min(length)
    }

    fn mutate(&mut self, input: &mut Vec<u8>) {
        let range = self.range(input.len());
        match self.below(7) {
            0 if !input.is_empty() => {
                let (at, bit) = (self.below(input.len()), self.below(8));
                input[at] ^= 1 << bit;
            }
            1 if !input.is_empty() => {
                let at = self.below(input.len());
                input[at] = self.next_u64() as u8;
            }
            2 => drop(input.drain(range)),
            3 => {
                let piece = input[range.clone()].to_vec();
                drop(input.splice(range.end..range.end, piece));
            }
            4 => input.truncate(range.start),
            5 => {
                let other = self.others[self.below(self.others.len())];
                let piece = self.range(other.len());
                drop(input.splice(range, other[piece].iter().copied()));
            }
            _ => {
                let word = WORDS[self.below(WORDS.len())];
                drop(input.splice(range, word.iter().copied()));
            }
        }
    }
}

impl Iterator for Mutations<'_> {
    type Item = Vec<u8>;

    fn next(&mut self) -> Option<Vec<u8>> {
        let mut input = self.content.to_vec();
        for _ in 0..=self.below(4) {
            self.mutate(&mut input);
        }
        Some(input)
    }
}
