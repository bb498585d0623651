//! One acquisition and its stream.

use super::AravisSettings;
use crate::{DeviceError, StreamCounters};
use aravis::glib::prelude::Cast;
use aravis::prelude::*;
use aravis::{GvDevice, GvStream, GvStreamOption, GvStreamPacketResend, GvStreamSocketBuffer};
use std::time::{Duration, Instant};

/// Buffers of a stream: one is filled at a time, the others hold late and repeated frames until the next drain.
const BUFFERS: usize = 8;

pub(super) struct Armed {
    stream: aravis::Stream,
    pub last_frame_id: Option<u64>,
    /// Triggers whose frames have not come; counted where the camera has no clock to tell a late frame by.
    pub owed: u32,
}

impl Armed {
    /// A new stream, and its acquisition begun.
    pub fn start(camera: &aravis::Camera, settings: &AravisSettings) -> Result<Self, DeviceError> {
        if let Some(gv) = camera.device().as_ref().and_then(|d| d.downcast_ref::<GvDevice>()) {
            let packets = if settings.packet_socket { GvStreamOption::NONE } else { GvStreamOption::PACKET_SOCKET_DISABLED };
            gv.set_stream_options(packets);
        }
        let stream = camera.create_stream().map_err(|e| super::refused("a stream", &e))?;
        if let Some(gv) = stream.downcast_ref::<GvStream>() {
            gv.set_socket_buffer(GvStreamSocketBuffer::Fixed);
            // Checked with the settings: it fits.
            gv.set_socket_buffer_size(settings.socket_buffer_bytes as i32);
            gv.set_packet_resend(if settings.resend { GvStreamPacketResend::Always } else { GvStreamPacketResend::Never });
        }
        for _ in 0..BUFFERS {
            stream.push_buffer(aravis::Buffer::new_allocate(settings.frame_bytes()));
        }
        camera.start_acquisition().map_err(|e| super::refused("AcquisitionStart", &e))?;
        Ok(Self { stream, last_frame_id: None, owed: 0 })
    }

    pub fn pop(&self, wait: Duration) -> Option<aravis::Buffer> {
        self.stream.timeout_pop_buffer(wait.as_micros() as u64)
    }

    pub fn give_back(&self, buffer: aravis::Buffer) {
        self.stream.push_buffer(buffer);
    }

    /// Waits for the frames of earlier triggers and forgets them, then empties the queue.
    pub fn drop_what_is_owed(&mut self, until: Instant) {
        while self.owed > 0
            && let Some(late) = self.pop(until.saturating_duration_since(Instant::now()))
        {
            self.owed -= 1;
            self.give_back(late);
        }
        self.owed = 0;
        while let Some(stale) = self.stream.try_pop_buffer() {
            self.give_back(stale);
        }
    }

    pub fn counters(&self) -> StreamCounters {
        let (completed, failed, underrun) = self.stream.statistics();
        let (resent_packets, missing_packets) = self.stream.downcast_ref::<GvStream>().map(GvStream::statistics).unwrap_or_default();
        let ignored_packets = self.stream.info_uint64_by_name("n_ignored_packets");
        StreamCounters { completed, failed, underrun, resent_packets, missing_packets, ignored_packets }
    }
}
