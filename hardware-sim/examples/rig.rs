//! Starts an emulated rig with a test card and prints its serial port and camera address. It runs until its input ends:
//! `cargo run -p hardware-sim --example rig`, then for instance `arv-tool-0.8 -a 127.0.0.2 features`.

use hardware_sim::{Rig, RigError, RigSettings, TestCard};
use std::sync::Arc;

fn main() -> Result<(), RigError> {
    let rig = Rig::start(RigSettings::default(), Arc::new(TestCard::new(1024, 1024)))?;
    println!("motor {}  camera {} (serial {})", rig.serial_path().display(), rig.camera_address(), rig.camera_serial());
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
    Ok(())
}
