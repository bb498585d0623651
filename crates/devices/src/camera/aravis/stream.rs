//! One acquisition and its stream.

use super::{AravisSettings, socket};
use crate::{DeviceError, StreamCounters};
use aravis::glib::prelude::Cast;
use aravis::prelude::*;
use aravis::{GvDevice, GvStream, GvStreamOption, GvStreamPacketResend, GvStreamSocketBuffer};
use std::time::{Duration, Instant};

/// Number of buffers of a stream with triggers. One is filled at a time. The others hold late and repeated frames until they are drained.
pub(super) const BUFFERS: u32 = 8;

/// A running acquisition.
pub(super) struct Armed {
    stream: aravis::Stream,
    pub last_frame_id: Option<u64>,
    /// Number of triggers whose frames have not come. It is needed without a camera clock, which would identify late frames.
    pub outstanding: u32,
}

impl Armed {
    /// Creates a new stream with this many buffers and starts its acquisition.
    pub fn start(camera: &aravis::Camera, settings: &AravisSettings, buffers: u32) -> Result<Self, DeviceError> {
        if let Some(gv) = camera.device().as_ref().and_then(|d| d.downcast_ref::<GvDevice>()) {
            let packets = if settings.packet_socket { GvStreamOption::NONE } else { GvStreamOption::PACKET_SOCKET_DISABLED };
            gv.set_stream_options(packets);
        }
        let stream = camera.create_stream().map_err(|e| super::refused("a stream", &e))?;
        if let (Some(device), Some(gv)) = (camera.device().and_then(|d| d.downcast().ok()), stream.downcast_ref::<GvStream>()) {
            let bytes = settings.socket_buffer_bytes as usize;
            if let Err(why) = socket::prepare(&device, gv.port(), bytes) {
                tracing::warn!(%why, "the stream's socket keeps its small buffer until the first packet, and takes packets of any sender");
            }
        }
        if let Some(gv) = stream.downcast_ref::<GvStream>() {
            gv.set_socket_buffer(GvStreamSocketBuffer::Fixed);
            // `AravisSettings::check` ensures that it fits.
            gv.set_socket_buffer_size(settings.socket_buffer_bytes as i32);
            gv.set_packet_resend(if settings.resend { GvStreamPacketResend::Always } else { GvStreamPacketResend::Never });
        }
        for _ in 0..buffers {
            stream.push_buffer(aravis::Buffer::new_allocate(settings.frame_bytes()));
        }
        camera.start_acquisition().map_err(|e| super::refused("AcquisitionStart", &e))?;
        Ok(Self { stream, last_frame_id: None, outstanding: 0 })
    }

    pub fn pop(&self, wait: Duration) -> Option<aravis::Buffer> {
        self.stream.timeout_pop_buffer(wait.as_micros() as u64)
    }

    pub fn give_back(&self, buffer: aravis::Buffer) {
        self.stream.push_buffer(buffer);
    }

    /// Waits for the frames of earlier triggers and drops them, then empties the queue.
    pub fn drop_outstanding(&mut self, until: Instant) {
        while self.outstanding > 0
            && let Some(late) = self.pop(until.saturating_duration_since(Instant::now()))
        {
            self.outstanding -= 1;
            self.give_back(late);
        }
        self.outstanding = 0;
        while let Some(stale) = self.stream.try_pop_buffer() {
            self.give_back(stale);
        }
    }

    #[cfg(test)]
    pub fn port(&self) -> u16 {
        self.stream.downcast_ref::<GvStream>().map(GvStream::port).unwrap_or_default()
    }

    pub fn counters(&self) -> StreamCounters {
        let (completed, failed, underrun) = self.stream.statistics();
        let (resent_packets, missing_packets) = self.stream.downcast_ref::<GvStream>().map(GvStream::statistics).unwrap_or_default();
        let ignored_packets = self.stream.info_uint64_by_name("n_ignored_packets");
        StreamCounters { completed, failed, underrun, resent_packets, missing_packets, ignored_packets }
    }
}
