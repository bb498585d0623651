//! The sensor: photon noise, read noise and eight bits.

use super::Optics;
use crate::scene::seeded::{mixed, normal_of};
use rayon::prelude::*;

/// The digital frame. Each pixel and colour has its own noise, from the seed and the exposure number.
pub fn exposed(light: &[[f32; 3]], width: usize, optics: &Optics, number: u64) -> Vec<u8> {
    let key = mixed(optics.noise_seed ^ mixed(number));
    let photon = if optics.full_well_electrons > 0.0 { (255.0 / optics.full_well_electrons) as f32 } else { 0.0 };
    let read = (optics.read_noise * optics.read_noise) as f32;
    let quiet = photon == 0.0 && read == 0.0;
    let mut data = vec![0u8; light.len() * 3];
    data.par_chunks_mut(width * 3).zip(light.par_chunks(width)).enumerate().for_each(|(v, (bytes, row))| {
        let first = (v * width * 3) as u64;
        for (i, byte) in bytes.iter_mut().enumerate() {
            let level = row[i / 3][i % 3];
            let noise =
                if quiet { 0.0 } else { (level.max(0.0) * photon + read).sqrt() * normal_of(mixed(key.wrapping_add(first + i as u64))) };
            *byte = (level + noise).round().clamp(0.0, 255.0) as u8;
        }
    });
    data
}
