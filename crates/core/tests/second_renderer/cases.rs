//! The scenes of the tests: specimens and instruments by seed.

use crate::dust::Dirt;
use crate::optics::Optics;
use crate::random::Random;
use crate::scene::{Glass, Lamp, Scene, Sensor, View};
use crate::shape::{Bladder, Fins, Material, Specimen};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Bead,
    Ellipsoid,
    Finned,
    Finless,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// 1024 x 200 px, as a VAST stores it.
    Crop,
    /// 1024 x 1024 px.
    Full,
}

/// An instrument and a specimen, both decided by the seed.
pub fn scene(kind: Kind, size: Size, dirt: Dirt, seed: u64) -> Scene {
    scene_with(kind, Bladder::Usual, size, dirt, seed)
}

/// The same with another swim bladder.
pub fn scene_with(kind: Kind, bladder: Bladder, size: Size, dirt: Dirt, seed: u64) -> Scene {
    let mut r = Random::new(seed.wrapping_mul(31) ^ 0xca5e);
    let px_um = r.uniform(5.4, 5.5);
    let bore_px = r.uniform(110.0, 140.0);
    let bore_um = bore_px / 2.0 * px_um;
    let (width, height) = match size {
        Size::Crop => (1024, 200),
        Size::Full => (1024, 1024),
    };
    let origin_px = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0 + r.uniform(-4.0, 4.0)];
    let view = View { width, height, px_um, origin_px, roll_rad: r.uniform(-0.006, 0.006) };
    let lamp =
        Lamp { grey: [222.0, 226.0, 213.0], slope: [r.uniform(-0.04, 0.04), r.uniform(-0.02, 0.02)], curvature: r.uniform(-0.05, 0.0) };
    // Four seeds in sequence have one wall of two lines and four strengths of fins.
    let quarter = (seed % 4) as usize;
    let glass = Glass {
        bore_um,
        line: r.uniform(0.5, 0.7),
        line_px: r.uniform(4.5, 6.5),
        outer: if quarter == 3 { r.uniform(0.3, 0.5) } else { 0.0 },
        apart_px: r.uniform(4.0, 6.0),
        bright: r.uniform(0.0, 0.06),
        shade: r.uniform(0.12, 0.25),
        fade_px: 3.4,
        bore_level: 0.96,
    };
    let optics = Optics {
        defocus_um: r.uniform(-40.0, 100.0),
        aperture_rad: r.uniform(0.07, 0.13),
        cone_rad: r.uniform(0.02, 0.04),
        disc_px: r.uniform(1.6, 2.2),
    };
    let step_um = view.step_um();
    let at = [r.uniform(-300.0, 300.0), 0.06 * bore_um * r.normal().clamp(-2.0, 2.0), 0.06 * bore_um * r.normal().clamp(-2.0, 2.0)];
    let specimen = match kind {
        Kind::Bead => {
            let radius_um = bore_um * r.uniform(0.4, 0.75);
            Specimen::ellipsoid(at, [radius_um; 3], [0.0; 2], Material::brown(r.uniform(0.001, 0.004), 0.05), step_um)
        }
        Kind::Ellipsoid => {
            let half_um = [r.uniform(500.0, 900.0), bore_um * r.uniform(0.5, 0.7), bore_um * r.uniform(0.35, 0.5)];
            let turns = [r.uniform(-0.06, 0.06), r.uniform(-0.06, 0.06)];
            Specimen::ellipsoid(at, half_um, turns, Material::brown(r.uniform(0.001, 0.004), 0.03), step_um)
        }
        Kind::Finned | Kind::Finless => {
            let fins = Fins { fold_per_um: 0.0015 * [1.3, 0.5, 2.0, 0.85][quarter], pectoral_per_um: [0.016, 0.008, 0.012, 0.02][quarter] };
            Specimen::larva(seed, (kind == Kind::Finned).then_some(fins), bladder, bore_um, step_um)
        }
    };
    let specks = dirt.specks(seed, [width, height], bore_um, px_um, Some(&specimen));
    Scene { view, lamp, glass, optics, sensor: Sensor { shot_grey: 2.4, read_grey: 0.7 }, specks, specimen: Some(specimen), seed }
}
