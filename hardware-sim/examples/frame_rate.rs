//! Measures the frame rate from an emulated rig to libaravis over loopback, in free run and with software triggers, and the processor
//! time: `cargo run --release -p hardware-sim --example frame_rate`.

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{Buffer, BufferStatus, Camera, GvDevice, GvStream, GvStreamOption, GvStreamSocketBuffer};
use hardware_sim::{Rig, RigSettings, TestCard};
use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SPAN: Duration = Duration::from_secs(5);

fn main() -> Result<(), Box<dyn Error>> {
    let rig = Rig::start(RigSettings::default(), Arc::new(TestCard::new(1024, 1024)))?;
    let camera = Camera::new(Some(&rig.camera_address().to_string()))?;
    let device = camera.device().ok_or("no device")?;
    device.downcast_ref::<GvDevice>().ok_or("no GigE device")?.set_stream_options(GvStreamOption::PACKET_SOCKET_DISABLED);
    camera.set_exposure_time(1000.0)?;
    for source in ["Freerun", "Software"] {
        camera.set_trigger(source)?;
        let stream = camera.create_stream()?;
        let gv = stream.downcast_ref::<GvStream>().ok_or("no GigE stream")?;
        gv.set_socket_buffer(GvStreamSocketBuffer::Fixed);
        gv.set_socket_buffer_size(4 << 20);
        for _ in 0..16 {
            stream.push_buffer(Buffer::new_allocate(camera.payload()? as usize));
        }
        camera.start_acquisition()?;
        let (begin, mut whole, mut broken) = (Instant::now(), 0u32, 0u32);
        while begin.elapsed() < SPAN {
            if source == "Software" {
                camera.software_trigger()?;
            }
            let Some(buffer) = stream.timeout_pop_buffer(1_000_000) else {
                broken += 1;
                continue;
            };
            if buffer.status() == BufferStatus::Success {
                whole += 1;
            } else {
                broken += 1;
            }
            stream.push_buffer(buffer);
        }
        let rate = f64::from(whole) / begin.elapsed().as_secs_f64();
        camera.stop_acquisition()?;
        let (resent, missing) = gv.statistics();
        println!("{source}: {rate:.1} frames/s, {whole} whole, {broken} not, {resent} packets resent, {missing} missing");
    }
    Ok(())
}
