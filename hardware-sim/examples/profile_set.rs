//! Writes the profiles of a phantom with their ground truth, to evaluate a calibration or a measurement.
//!
//! `profile_set OUT KIND SEED ASD [options]`. KIND is bead, ellipsoid, capsule, larva or finned. It writes:
//!
//! ```text
//!   view_000.png ...   8-bit coverage, inside = 128 or more
//!   camera.json        what a rig knows: nominal psi, planned angles (rad)
//!   truth.json         true psi and angles, shift of each view, volume and area of body and ideal hull, the disturbances
//! ```
//! Options: `--drift` (errors of camera, angles, shifts and edges), `--slip 1.02` (true angle over planned angle), `--fault NAME`
//! (blank, leak, jump, moved or clipped; it may be repeated), `--descending`, `--uneven` (steps of 0.6 to 1.4), `--ky 1.333` (scale
//! across over scale along the capillary), `--empty` (no specimen).

use hardware_sim::analytic::{Disturbance, Fault, Phantom, Pose, View, coverage};
use hardware_sim::scene::{Camera, Truth};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::error::Error;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

type Failure = Box<dyn Error + Send + Sync>;

const USAGE: &str = "profile_set OUT KIND SEED ASD [--drift] [--slip RHO] [--fault blank|leak|jump|moved|clipped]... [--descending] \
                     [--uneven] [--ky RATIO] [--empty]; KIND is bead, ellipsoid, capsule, larva or finned";
/// Inner radius of the capillary, um. A profile can leak as far as this.
const BORE_RADIUS_UM: f64 = 325.0;

struct Options {
    out: PathBuf,
    kind: String,
    seed: u64,
    asd: usize,
    slip: f64,
    faults: Vec<String>,
    ky_over_kx: f64,
    /// The given options of [`FLAGS`].
    flags: Vec<String>,
}

const FLAGS: [&str; 4] = ["--drift", "--descending", "--uneven", "--empty"];

impl Options {
    fn has(&self, flag: &str) -> bool {
        self.flags.iter().any(|given| given == flag)
    }
}

fn main() -> Result<(), Failure> {
    let options = options(std::env::args().skip(1))?;
    let nominal = Camera::default();
    let nominal = Camera { ky_px_per_um: options.ky_over_kx * nominal.kx_px_per_um, ..nominal };
    let planned_rad = plan(&options);
    let phantom = phantom(&options.kind, options.seed)?.placed(Pose::seeded(options.seed));
    let disturbance = disturbance(&options, &nominal)?;
    let mut views = phantom.views(&nominal, &planned_rad, &disturbance);
    if options.has("--empty") {
        for view in &mut views {
            view.outline.clear();
        }
    }
    std::fs::create_dir_all(&options.out)?;
    views.par_iter().enumerate().try_for_each(|(i, view)| write_view(&options.out, i, view, &nominal))?;
    write_json(&options.out.join("camera.json"), &camera_json(&nominal, &planned_rad))?;
    write_json(&options.out.join("truth.json"), &truth_json(&options, &nominal, &phantom, &disturbance, &views))
}

fn options(mut words: impl Iterator<Item = String>) -> Result<Options, Failure> {
    let mut next = |what: &str| words.next().ok_or_else(|| format!("{what} is missing: {USAGE}"));
    let (out, kind) = (PathBuf::from(next("OUT")?), next("KIND")?);
    let (seed, asd) = (next("SEED")?, next("ASD")?);
    let seed = seed.parse().map_err(|_| format!("SEED reads {seed:?}, expected a whole number: {USAGE}"))?;
    let asd = asd.parse().ok().filter(|&n| n > 0).ok_or_else(|| format!("ASD reads {asd:?}, expected a whole number above 0: {USAGE}"))?;
    let mut options = Options { out, kind, seed, asd, slip: 1.0, faults: Vec::new(), ky_over_kx: 1.0, flags: Vec::new() };
    while let Some(option) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{option} lacks its value: {USAGE}"));
        let ratio = |word: String| {
            word.parse().ok().filter(|r: &f64| r.is_finite() && *r > 0.0).ok_or_else(|| format!("{word:?} is no ratio above 0: {USAGE}"))
        };
        match option.as_str() {
            flag if FLAGS.contains(&flag) => options.flags.push(option),
            "--slip" => options.slip = ratio(value()?)?,
            "--ky" => options.ky_over_kx = ratio(value()?)?,
            "--fault" => options.faults.push(value()?),
            _ => return Err(format!("{option:?} is no option: {USAGE}").into()),
        }
    }
    Ok(options)
}

/// Typical sizes: beads of about 500 um, larvae of 3, 4 and 5 dpf in turn.
fn phantom(kind: &str, seed: u64) -> Result<Phantom, Failure> {
    // Two numbers from 0 to 1 that depend on the seed: fractional parts of multiples of the golden ratio and of the root of 2.
    let share = |ratio: f64| (seed as f64 * ratio).fract();
    let (a, b) = (share(0.618_033_988_749_895), share(0.414_213_562_373_095));
    let dpf = 3 + (seed % 3) as u8;
    Ok(match kind {
        "bead" => Phantom::sphere(450.0 + 100.0 * a)?,
        "ellipsoid" => Phantom::ellipsoid([800.0 + 1000.0 * a, 180.0 + 80.0 * b, 130.0 + 100.0 * a])?,
        "capsule" => Phantom::capsule(1500.0 + 2000.0 * a, 200.0 + 250.0 * b)?,
        "larva" => Phantom::larva(dpf, seed)?,
        "finned" => Phantom::finned(dpf, seed)?,
        _ => return Err(format!("{kind:?} is no kind: {USAGE}").into()),
    })
}

/// Planned angles over one revolution, from 0.
fn plan(options: &Options) -> Vec<f64> {
    let step_rad = TAU / options.asd as f64;
    let sense = if options.has("--descending") { -1.0 } else { 1.0 };
    (0..options.asd)
        .map(|i| {
            // Up to a fifth of a step early or late. The first angle is exact.
            let off = if options.has("--uneven") { 0.2 * (2.4 * i as f64 * (1.0 + (options.seed % 7) as f64)).sin() } else { 0.0 };
            sense * step_rad * (i as f64 + off)
        })
        .collect()
}

fn disturbance(options: &Options, nominal: &Camera) -> Result<Disturbance, Failure> {
    let base = if options.has("--drift") {
        Disturbance::drift(options.seed)
    } else {
        Disturbance { seed: options.seed, ..Disturbance::default() }
    };
    let middle = options.asd / 2;
    let fault = |name: &String| {
        Ok(match name.as_str() {
            "blank" => Fault::Blank { view: options.asd / 3 },
            "leak" => Fault::Leak { view: options.asd / 4, at_u_px: nominal.ux_px - 20.0, width_px: 70.0, bore_radius_um: BORE_RADIUS_UM },
            "jump" => Fault::Jump { view: middle, u_px: 2.0, v_px: -6.0 },
            "moved" => Fault::Moved { from: middle, by: Pose { x_um: 110.0, y_um: 30.0, z_um: -20.0, roll_rad: 0.3 } },
            "clipped" => Fault::Clipped { beyond_um: 300.0 },
            _ => return Err(Failure::from(format!("{name:?} is no fault: {USAGE}"))),
        })
    };
    Ok(Disturbance { rho: options.slip, faults: options.faults.iter().map(fault).collect::<Result<_, _>>()?, ..base })
}

fn write_view(out: &Path, number: usize, view: &View, camera: &Camera) -> Result<(), Failure> {
    let image = coverage(&view.outline, camera.width, camera.height);
    let file = out.join(format!("view_{number:03}.png"));
    Ok(image::save_buffer(file, &image.data, image.width, image.height, image::ColorType::L8)?)
}

fn write_json(file: &Path, value: &Value) -> Result<(), Failure> {
    Ok(std::fs::write(file, serde_json::to_vec_pretty(value)?)?)
}

fn psi(camera: &Camera, omega_rad: &[f64]) -> Map<String, Value> {
    let Camera { f_um, kx_px_per_um, ky_px_per_um, ux_px, uy_px, skew, alpha_rad, gamma_rad, phi_rad, .. } = camera;
    let names = ["f", "kx", "ky", "ux", "uy", "s", "alpha", "gamma", "phi"];
    let values = [f_um, kx_px_per_um, ky_px_per_um, ux_px, uy_px, skew, alpha_rad, gamma_rad, phi_rad];
    let mut psi: Map<_, _> = names.iter().zip(values).map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
    psi.insert("omega".to_owned(), json!(omega_rad));
    psi
}

fn camera_json(nominal: &Camera, planned_rad: &[f64]) -> Value {
    let mut camera = psi(nominal, planned_rad);
    camera.extend([
        ("width".to_owned(), json!(nominal.width)),
        ("height".to_owned(), json!(nominal.height)),
        ("views".to_owned(), json!(planned_rad.len())),
        ("pixel_convention".to_owned(), json!("pixel centres at integer coordinates")),
        (
            "model".to_owned(),
            json!("x~ = K [ RY(alpha) RZ(gamma) RX(omega_i) X + f (0,cos phi,sin phi) ], K=[[f kx,s,ux],[0,f ky,uy],[0,0,1]], um"),
        ),
    ]);
    Value::Object(camera)
}

fn truth_json(options: &Options, nominal: &Camera, phantom: &Phantom, disturbance: &Disturbance, views: &[View]) -> Value {
    let omega: Vec<f64> = views.iter().map(|view| view.true_omega_rad).collect();
    let case = options.out.file_name().map(|name| name.to_string_lossy().into_owned());
    let mut truth = json!({
        "case": case,
        "kind": if options.has("--empty") { "empty" } else { &options.kind },
        "psi": psi(&disturbance.camera(nominal), &omega),
        "dy": views.iter().map(|view| view.dy_px).collect::<Vec<_>>(),
        "um_per_px": 1.0 / nominal.kx_px_per_um,
        "disturbance": disturbance,
    });
    if options.has("--empty") {
        truth["volume"] = json!(0.0);
        truth["area"] = json!(0.0);
    } else {
        let Truth { volume_um3, area_um2, hull_volume_um3, hull_area_um2, diameter_um, .. } = phantom.truth();
        truth["volume"] = json!(volume_um3);
        truth["area"] = json!(area_um2);
        truth["hull_volume"] = json!(hull_volume_um3);
        truth["hull_area"] = json!(hull_area_um2);
        truth["tolerance"] = tolerance(options);
        truth["bbox_um"] = json!(phantom.bounds_um());
        if let Some(diameter_um) = diameter_um {
            truth["diameter"] = json!(diameter_um);
        }
    }
    truth
}

/// The required accuracy of a measurement with drift as the only disturbance, percent.
fn tolerance(options: &Options) -> Value {
    match options.kind.as_str() {
        "finned" => json!({ "hull_vol_pct": if options.asd >= 28 { 1.5 } else { 2.0 }, "hull_area_pct": 2.0 }),
        "larva" => json!({ "vol_pct": if options.asd >= 42 { 0.5 } else { 1.0 }, "area_pct": 0.7 }),
        _ => json!({ "vol_pct": 0.3, "area_pct": 0.4 }),
    }
}
