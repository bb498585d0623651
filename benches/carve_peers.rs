//! Carved's side of the comparison with its peers: `cargo bench --bench carve_peers -- FOLDER`.
//!
//! FOLDER holds `clean`, `rolled` and `ragged`, each with `views.json` (a list `views` of `P`, 3 x 4, and `file`) and the silhouettes.
//! Times are medians of repeated runs, including the construction of the carver, and are printed as lines that start with `@`.

use carved_core::carver::{Carver, Leaves, ResidualVolume, Runs};
use carved_core::geometry::{BoxUm, Projection, VoxelGrid};
use carved_core::profile::Mask;
use carved_core::surface::{Fairing, Occupancy, extract, fair};
use std::path::Path;
use std::time::Instant;

type Views = Vec<(Mask, Projection)>;
const REPEATS: usize = 9;

fn read(folder: &Path) -> Result<Views, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(folder.join("views.json"))?;
    let json: serde_json::Value = serde_json::from_str(&text)?;
    let views = json["views"].as_array().ok_or("views.json: `views` is no list")?;
    views
        .iter()
        .map(|view| {
            let rows: [[f64; 4]; 3] = serde_json::from_value(view["P"].clone())?;
            let file = view["file"].as_str().ok_or("views.json: a view has no `file`")?;
            let picture = image::open(folder.join(file))?.into_luma8();
            let (width, height) = picture.dimensions();
            Ok((Mask::from_coverage(width as usize, height as usize, picture.into_raw())?, Projection::from_matrix(rows)?))
        })
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn timed<T>(mut run: impl FnMut() -> T) -> (f64, T) {
    let mut last = run();
    let seconds = (0..REPEATS)
        .map(|_| {
            let began = Instant::now();
            last = run();
            began.elapsed().as_secs_f64()
        })
        .collect();
    (median(seconds), last)
}

fn grid(size: f64) -> VoxelGrid {
    VoxelGrid::new(BoxUm::PAPER, size).unwrap_or_else(|e| panic!("{e}"))
}

fn carve(views: &Views, size: f64, mut each: impl FnMut(usize, f64)) -> Carver {
    let mut carver = Carver::new(grid(size), views.len(), 0.05).unwrap_or_else(|e| panic!("{e}"));
    for (n, (mask, projection)) in views.iter().enumerate() {
        let began = Instant::now();
        carver.observe(mask, projection, Leaves::default()).unwrap_or_else(|e| panic!("{e}"));
        each(n, began.elapsed().as_secs_f64());
    }
    carver
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Some(folder) = std::env::args().skip(1).find(|a| !a.starts_with('-')) else {
        println!("skipped: no folder of views was given (benches/peers makes one)");
        return Ok(());
    };
    let folder = Path::new(&folder);
    for variant in ["clean", "rolled", "ragged"] {
        if !folder.join(variant).join("views.json").exists() {
            println!("skipped: {variant} is not in {}", folder.display());
            continue;
        }
        let views = read(&folder.join(variant))?;
        if views.len() != 84 {
            return Err(format!("{variant}: {} views, 84 are needed", views.len()).into());
        }
        for size in [6.93, 5.5] {
            for count in [21, 84] {
                let some: Views = views.iter().step_by(views.len() / count).cloned().collect();
                let mut times = vec![Vec::new(); some.len()];
                let (seconds, carver) = timed(|| carve(&some, size, |n, t| times[n].push(t)));
                println!("@ carve sd={size} views={count} variant={variant} seconds={seconds:.6} voxels={}", carver.live_voxels());
                let each: Vec<f64> = times.into_iter().map(median).collect();
                let worst = each.iter().fold(0.0f64, |a, b| a.max(*b));
                println!(
                    "@ view sd={size} views={count} variant={variant} median={:.6} worst={worst:.6} first={:.6}",
                    median(each.clone()),
                    each[0]
                );
                if count == 84 {
                    let megabytes = carver.bytes() as f64 / 1e6;
                    println!("@ memory sd={size} views={count} variant={variant} megabytes={megabytes:.1}");
                }
            }
        }
        if variant != "clean" {
            continue;
        }
        let carver = carve(&views, 5.5, |_, _| {});
        let (seconds, mesh) = timed(|| extract(&Occupancy(&carver)));
        println!("@ surface sd=5.5 seconds={seconds:.6} triangles={}", mesh.triangles.len());
        let (seconds, faired) = timed(|| fair(&mesh, Fairing { lambda: 0.8, iterations: 10 }));
        println!("@ fairing iterations=10 seconds={seconds:.6} vertices={}", faired?.vertices.len());
        let some: Vec<(Runs, Projection)> =
            views.iter().step_by(4).map(|(mask, p)| Ok((Runs::new(mask)?, *p))).collect::<Result<_, carved_core::carver::CarveError>>()?;
        for size in [17.1, 10.0] {
            let mut residual = ResidualVolume::new(grid(size), 0.0)?;
            let (seconds, voxels) = timed(|| residual.count(some.iter().map(|(runs, p)| (runs, *p))));
            println!("@ vrv views=21 sd={size} seconds={seconds:.6} voxels={}", voxels?);
        }
        for millions in [1.0f64, 10.0, 30.0, 100.0, 240.0, 1000.0] {
            let size = (5e9 / (millions * 1e6)).cbrt();
            let mut times = Vec::new();
            let carver = carve(&views, size, |_, t| times.push(t));
            println!(
                "@ scale voxels={} median={:.6} total={:.6} megabytes={:.1}",
                carver.grid().len(),
                median(times.clone()),
                times.iter().sum::<f64>(),
                carver.bytes() as f64 / 1e6
            );
        }
    }
    Ok(())
}
