//! Distance of a profile from the truth of its frame.
//!
//! ```text
//!      __________ truth    overlap: of masks.   edge: distance of each found vertex from the true outline, + outside
//!    _/  _______ \_        fins: what the true outline has outside that of the body, and how much of it is in the mask
//!   |___/ found \__|
//! ```

use carved_core::profile::{Annotation, Mask, Profile};
use hardware_sim::scene::Outline;
use hardware_sim::scene::frame_set::Rendered;

/// Larger distances count as this one, px.
const FARTHEST_PX: f64 = 8.0;
/// With fewer pixels of fin than this there is no result for the fins.
const FIN_PX: usize = 300;

#[derive(Debug, Clone, Copy)]
pub struct Judged {
    pub iou: f64,
    /// Mean distance of the found outline from the true one, px, positive outside. `None` without an outline.
    pub signed_px: Option<f64>,
    /// Share of the found outline that is within a pixel of the true one. The part on the border of the picture is not counted.
    pub within_share: f64,
    /// Found share of the specimen outside its body (its fins). `None` if there is next to nothing outside.
    pub fins: Option<f64>,
    /// Pixels of the profile more than 2 px outside the truth, and those of the largest connected piece of them.
    pub false_px: usize,
    pub largest_hump_px: usize,
}

pub fn judge(profile: &Profile, truth: &Rendered) -> Judged {
    let (width, height) = (truth.truth.width as usize, truth.truth.height as usize);
    let mask = Mask::from_coverage(width, height, truth.truth.data.clone()).unwrap();
    let distances = distances(profile, truth);
    let n = distances.len() as f64;
    let compared = Annotation::from_mask(mask.clone()).compare(&profile.mask, &profile.edge).unwrap();
    Judged {
        iou: profile.mask.iou(&mask),
        signed_px: (n > 0.0).then(|| distances.iter().sum::<f64>() / n),
        within_share: distances.iter().filter(|d| d.abs() <= 1.0).count() as f64 / n.max(1.0),
        fins: fins(&profile.mask, &mask, &truth.body_edge),
        false_px: compared.false_px,
        largest_hump_px: compared.largest_hump_px,
    }
}

/// Signed distances of all vertices from the nearest point of the true outline, without those on the border of the picture.
fn distances(profile: &Profile, truth: &Rendered) -> Vec<f64> {
    let (width, height) = (truth.truth.width as usize, truth.truth.height as usize);
    // The sides of the true outline by the column in which they begin. They are shorter than a pixel.
    let mut sides = vec![Vec::new(); width + 2];
    for outline in &truth.edge {
        for (k, &a) in outline.iter().enumerate() {
            sides[(a[0] + 1.0).max(0.0) as usize].push((a, outline[(k + 1) % outline.len()]));
        }
    }
    let inside = |[u, v]: [f64; 2]| {
        let coverage = |u: usize, v: usize| f64::from(truth.truth.data[v.min(height - 1) * width + u.min(width - 1)]);
        let (u, v) = (u.max(0.0), v.max(0.0));
        let (u0, v0, fu, fv) = (u as usize, v as usize, u.fract(), v.fract());
        let upper = coverage(u0, v0) * (1.0 - fu) + coverage(u0 + 1, v0) * fu;
        let lower = coverage(u0, v0 + 1) * (1.0 - fu) + coverage(u0 + 1, v0 + 1) * fu;
        upper * (1.0 - fv) + lower * fv >= 127.5
    };
    let off_border = |p: &&[f64; 2]| p[0] >= 1.0 && p[0] <= width as f64 - 2.0;
    let vertices = profile.edge.iter().flat_map(|polygon| &polygon.vertices);
    vertices
        .filter(off_border)
        .map(|&p| {
            let column = (p[0] + 1.0) as usize;
            let reach = FARTHEST_PX as usize + 2;
            let near = sides[column.saturating_sub(reach)..(column + reach).min(width + 2)].iter().flatten();
            let distance = near.map(|&(a, b)| from_side(p, a, b)).fold(FARTHEST_PX, f64::min);
            if inside(p) { -distance } else { distance }
        })
        .collect()
}

fn from_side(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = along[0] * along[0] + along[1] * along[1];
    let part = if length2 > 0.0 { ((along[0] * to[0] + along[1] * to[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - part * along[0]).hypot(to[1] - part * along[1])
}

fn fins(found: &Mask, truth: &Mask, body: &[Outline]) -> Option<f64> {
    let (mut all, mut seen) = (0usize, 0usize);
    for v in 0..truth.height() {
        // The crossings of the body's outline with the row, from left to right. Between the first and the second is inside, and so on.
        let mut crossings: Vec<f64> = Vec::new();
        for outline in body {
            for (k, a) in outline.iter().enumerate() {
                let b = outline[(k + 1) % outline.len()];
                let row = v as f64;
                if (a[1] <= row) != (b[1] <= row) {
                    crossings.push(a[0] + (row - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                }
            }
        }
        crossings.sort_by(f64::total_cmp);
        for u in (0..truth.width()).filter(|&u| truth.get(u, v)) {
            if crossings.partition_point(|c| *c <= u as f64) % 2 == 0 {
                all += 1;
                seen += usize::from(found.get(u, v));
            }
        }
    }
    (all >= FIN_PX).then(|| seen as f64 / all as f64)
}
