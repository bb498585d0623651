//! Starts an emulated rig and prints its serial port and camera address. It runs until its input ends.
//!
//! ```sh
//! cargo run -p hardware-sim --example rig                  # a test card; then `arv-tool-0.8 -a 127.0.0.2 features`
//! cargo run -p hardware-sim --example rig -- LINK 500 10   # a bead of 500 um, ten times faster, port at the link LINK
//! ```

use hardware_sim::scene::{Scene, SceneSettings, Specimen};
use hardware_sim::{Rig, RigSettings, Sight, TestCard};
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (settings, sight): (_, Arc<dyn Sight>) = match &args[..] {
        [] => (RigSettings::default(), Arc::new(TestCard::new(1024, 1024))),
        [link, diameter_um, time_scale] => {
            let scene = Scene::new(SceneSettings::default());
            scene.load(Some(Specimen::bead(diameter_um.parse()?)?))?;
            (RigSettings { serial_link: Some(link.into()), time_scale: time_scale.parse()?, ..RigSettings::default() }, Arc::new(scene))
        }
        _ => return Err("arguments: LINK DIAMETER_UM TIME_SCALE, or none".into()),
    };
    let rig = Rig::start(settings, sight)?;
    println!("motor {}  camera {} (serial {})", rig.serial_path().display(), rig.camera_address(), rig.camera_serial());
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
    Ok(())
}
