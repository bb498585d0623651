//! Writes frames and truth masks of a specimen as PNG files, for inspection by eye.
//!
//! `render_frames OUT_DIR WHAT [SEED] [ANGLE_DEG...]`. WHAT is larva3, larva4, larva5, bead, empty or an OBJ file.

use hardware_sim::scene::{Exposure, Mesh, Placement, Scene, SceneSettings, Specimen};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(out), Some(what)) = (args.next(), args.next()) else {
        return Err("render_frames OUT_DIR larva3|larva4|larva5|bead|empty|FILE.obj [SEED] [ANGLE_DEG...]".into());
    };
    let seed: u64 = args.next().map(|s| s.parse()).transpose()?.unwrap_or(1);
    let mut angles_deg = args.map(|a| a.parse::<f64>()).collect::<Result<Vec<_>, _>>()?;
    if angles_deg.is_empty() {
        angles_deg = vec![0.0, 45.0, 90.0];
    }
    let out = PathBuf::from(out);
    std::fs::create_dir_all(&out)?;
    let scene = Scene::new(SceneSettings::default());
    scene.load(specimen(&what, seed)?.map(|s| s.placed(Placement { rests_on_wall: true, ..Placement::default() })))?;
    println!("{:#?}", scene.truth());
    let name = Path::new(&what).file_stem().and_then(|s| s.to_str()).unwrap_or("frame").to_owned();
    for (number, angle_deg) in angles_deg.into_iter().enumerate() {
        let start = Instant::now();
        let frame = scene.render(&Exposure { angle_rad: angle_deg.to_radians(), number: number as u64 });
        let rendered = start.elapsed();
        let start = Instant::now();
        let mask = scene.truth_mask(angle_deg.to_radians());
        println!("{angle_deg} deg: frame {rendered:.1?}, mask {:.1?}", start.elapsed());
        let to = |kind: &str| out.join(format!("{name}_{seed}_{angle_deg:03}_{kind}.png"));
        image::save_buffer(to("frame"), &frame.data, frame.width, frame.height, image::ColorType::Rgb8)?;
        image::save_buffer(to("mask"), &mask.data, mask.width, mask.height, image::ColorType::L8)?;
    }
    Ok(())
}

fn specimen(what: &str, seed: u64) -> Result<Option<Specimen>, Box<dyn std::error::Error>> {
    Ok(match what {
        "empty" => None,
        "bead" => Some(Specimen::bead(500.0)?),
        "larva3" => Some(Specimen::larva(3, seed)?),
        "larva4" => Some(Specimen::larva(4, seed)?),
        "larva5" => Some(Specimen::larva(5, seed)?),
        file => Some(Specimen::mesh(Mesh::from_obj_file(Path::new(file))?.laid_along_x(700.0))),
    })
}
