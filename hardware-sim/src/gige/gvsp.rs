//! The packets of one frame in the stream protocol.
//!
//! ```text
//!   packet 0         leader: timestamp, format, geometry
//!   packets 1..=n    payload; all are full except the last one
//!   packet n + 1     trailer
//! ```
//! Each packet begins with status(2), block id(2), kind(1), packet id(3).

use crate::sight::WireFormat;

/// Bytes of the IP, UDP and stream headers. The negotiated packet size includes them.
pub(super) const OVERHEAD: usize = 20 + 8 + HEADER;
const HEADER: usize = 8;
const IMAGE: u16 = 1;

/// One frame, from which any packet can be made again for a resend.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub id: u16,
    pub timestamp_ns: u64,
    pub format: WireFormat,
    pub width: u32,
    pub height: u32,
    pub offset: (u32, u32),
    /// Negotiated size of a packet with its headers, bytes.
    pub packet_size: usize,
    /// A fault: the second half of the payload is never sent, also on a resend.
    pub cut: bool,
    pub bytes: Vec<u8>,
}

impl Block {
    fn payload_size(&self) -> usize {
        self.packet_size.saturating_sub(OVERHEAD).max(1)
    }

    /// Id of the last packet, which is the trailer.
    pub fn last_packet(&self) -> u32 {
        self.bytes.len().div_ceil(self.payload_size()) as u32 + 1
    }

    /// The packet with this id. `None` beyond the trailer and for the part that is cut.
    pub fn packet(&self, id: u32) -> Option<Vec<u8>> {
        let last = self.last_packet();
        if id > last || (self.cut && id > last / 2 && id < last) {
            return None;
        }
        let (kind, content): (u8, std::borrow::Cow<[u8]>) = if id == 0 {
            (1, self.leader().into())
        } else if id == last {
            (2, self.trailer().into())
        } else {
            let size = self.payload_size();
            let from = (id as usize - 1) * size;
            (3, self.bytes[from..(from + size).min(self.bytes.len())].into())
        };
        let mut packet = Vec::with_capacity(HEADER + content.len());
        packet.extend_from_slice(&[0, 0]);
        packet.extend_from_slice(&self.id.to_be_bytes());
        packet.extend_from_slice(&((u32::from(kind) << 24) | id).to_be_bytes());
        packet.extend_from_slice(&content);
        Some(packet)
    }

    fn leader(&self) -> Vec<u8> {
        let mut leader = vec![0, 0];
        leader.extend_from_slice(&IMAGE.to_be_bytes());
        leader.extend_from_slice(&self.timestamp_ns.to_be_bytes());
        for word in [self.format.code(), self.width, self.height, self.offset.0, self.offset.1, 0] {
            leader.extend_from_slice(&word.to_be_bytes());
        }
        leader
    }

    fn trailer(&self) -> Vec<u8> {
        let mut trailer = vec![0, 0];
        trailer.extend_from_slice(&IMAGE.to_be_bytes());
        trailer.extend_from_slice(&self.height.to_be_bytes());
        trailer
    }
}

/// The block id after `id`: 16 bits, without 0.
pub(super) fn next_block(id: u16) -> u16 {
    id.checked_add(1).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_cut_and_fits_together_again() {
        let bytes: Vec<u8> = (0..10_000u32).map(|i| (i % 251) as u8).collect();
        let block = Block {
            id: 7,
            timestamp_ns: 0x0102_0304_0506_0708,
            format: WireFormat::Plain(crate::sight::PixelFormat::Mono8),
            width: 100,
            height: 100,
            offset: (4, 6),
            packet_size: 1500,
            cut: false,
            bytes: bytes.clone(),
        };
        // 1464 bytes fit into a packet of 1500 bytes: six full packets and a rest of 1216 bytes.
        assert_eq!(block.last_packet(), 8);
        let leader = block.packet(0).unwrap();
        assert_eq!(leader[..12], [0, 0, 0, 7, 1, 0, 0, 0, 0, 0, 0, 1]);
        assert_eq!(leader.len(), 8 + 36);
        let joined: Vec<u8> = (1..8).flat_map(|id| block.packet(id).unwrap()[8..].to_vec()).collect();
        assert_eq!(joined, bytes);
        assert_eq!(block.packet(1).unwrap().len() + 28, 1500);
        assert_eq!(block.packet(8).unwrap(), [0, 0, 0, 7, 2, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 100]);
        assert!(block.packet(9).is_none());
        let cut = Block { cut: true, ..block };
        assert_eq!((0..9).filter(|id| cut.packet(*id).is_some()).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 8]);
    }

    #[test]
    fn block_ids_skip_zero() {
        assert_eq!((next_block(1), next_block(u16::MAX)), (2, 1));
    }
}
