//! A profile of carved compared with the truth of its frame.

use crate::scene::Frame;
use crate::truth::{mask, outlines};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Polygon, Profile};

/// Larger distances count as this one, px.
const FARTHEST_PX: f64 = 8.0;
/// With fewer pixels of fin than this there is no result for the fins.
const FIN_PX: usize = 150;
/// What is found further than this from the specimen is false, px.
const NEAR_PX: isize = 2;

#[derive(Debug, Clone, Copy)]
pub struct Judged {
    pub iou: f64,
    /// Mean distance of the found outline from the true one, px, positive outside. `None` without an outline.
    pub signed_px: Option<f64>,
    /// Share of the fins that was found. `None` where next to nothing of them shows beside the body.
    pub fins: Option<f64>,
    /// Pixels found that lie more than 2 px beside the specimen.
    pub false_px: usize,
}

/// The frame as carved takes it.
pub fn raw_frame(frame: &Frame, format: PixelFormat) -> RawFrame {
    let bytes = match format {
        PixelFormat::RGB8Packed => frame.rgb(),
        _ => frame.mosaic.clone(),
    };
    RawFrame::new(frame.width as u32, frame.height as u32, format, bytes).unwrap()
}

pub fn judge(profile: &Profile, frame: &Frame) -> Judged {
    let (truth, body) = (mask(frame, &frame.covered), mask(frame, &frame.body));
    let distances = distances(profile, frame);
    let pixels = || (0..frame.height).flat_map(|v| (0..frame.width).map(move |u| (u, v)));
    let fins = pixels().filter(|&(u, v)| truth.get(u, v) && !body.get(u, v));
    let (all, found) = fins.fold((0, 0), |(all, found), (u, v)| (all + 1, found + usize::from(profile.mask.get(u, v))));
    let is_near = |u: usize, v: usize| {
        let offsets = (-NEAR_PX..=NEAR_PX).flat_map(|dv| (-NEAR_PX..=NEAR_PX).map(move |du| (du, dv)));
        let mut near = offsets.filter(|(du, dv)| du * du + dv * dv <= NEAR_PX * NEAR_PX);
        near.any(|(du, dv)| truth.covers(u as f64 + du as f64, v as f64 + dv as f64))
    };
    Judged {
        iou: profile.mask.iou(&truth),
        signed_px: (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64),
        fins: (all >= FIN_PX).then(|| found as f64 / all as f64),
        false_px: pixels().filter(|&(u, v)| profile.mask.get(u, v) && !is_near(u, v)).count(),
    }
}

/// Signed distances (px) of all vertices from the true outline.
fn distances(profile: &Profile, frame: &Frame) -> Vec<f64> {
    let reach = FARTHEST_PX as usize + 2;
    // The sides of the true outline by the column in which they begin. They are shorter than two pixels.
    let mut sides = vec![Vec::new(); frame.width];
    for Polygon { vertices } in outlines(frame) {
        for (i, &a) in vertices.iter().enumerate() {
            sides[a[0] as usize].push((a, vertices[(i + 1) % vertices.len()]));
        }
    }
    let coverage = |u: f64, v: f64| {
        let at = |u: f64, v: f64| {
            let (u, v) = (u.clamp(0.0, frame.width as f64 - 1.0) as usize, v.clamp(0.0, frame.height as f64 - 1.0) as usize);
            f64::from(frame.covered[v * frame.width + u])
        };
        let (u0, v0) = (u.floor(), v.floor());
        let upper = at(u0, v0) + (u - u0) * (at(u0 + 1.0, v0) - at(u0, v0));
        let lower = at(u0, v0 + 1.0) + (u - u0) * (at(u0 + 1.0, v0 + 1.0) - at(u0, v0 + 1.0));
        upper + (v - v0) * (lower - upper)
    };
    let vertices = profile.edge.iter().flat_map(|polygon| &polygon.vertices);
    let distance = |&[u, v]: &[f64; 2]| {
        let column = u.max(0.0) as usize;
        let near = sides[column.saturating_sub(reach).min(frame.width)..(column + reach).min(frame.width)].iter().flatten();
        let distance = near.map(|side| from_side([u, v], *side)).fold(FARTHEST_PX, f64::min);
        if coverage(u, v) >= 0.5 { -distance } else { distance }
    };
    vertices.map(distance).collect()
}

fn from_side(p: [f64; 2], (a, b): ([f64; 2], [f64; 2])) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = along[0] * along[0] + along[1] * along[1];
    let part = if length2 > 0.0 { ((along[0] * to[0] + along[1] * to[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - part * along[0]).hypot(to[1] - part * along[1])
}
