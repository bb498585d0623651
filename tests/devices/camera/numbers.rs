//! The number of lost frames and the time per frame, over many frames:
//! `CARVED_FRAMES=10000 cargo test --test devices camera::numbers -- --nocapture`.

use super::bench::Bench;
use std::time::Instant;

#[test]
fn no_frame_of_many_is_lost() {
    let frames: u32 = std::env::var("CARVED_FRAMES").ok().and_then(|n| n.parse().ok()).unwrap_or(500);
    let mut bench = Bench::armed();
    let (mut triggers, mut trigger_ms, mut all_ms) = (0, 0.0, 0.0);
    for _ in 0..frames {
        let began = Instant::now();
        let grabbed = bench.take();
        all_ms += began.elapsed().as_secs_f64() * 1e3;
        triggers += grabbed.attempts;
        trigger_ms += grabbed.trigger_ms;
    }
    let n = f64::from(frames);
    println!(
        "{frames} frames, {triggers} triggers, per frame {:.3} ms of trigger in {:.3} ms; {:?}",
        trigger_ms / n,
        all_ms / n,
        bench.camera.counters()
    );
    assert_eq!(triggers, frames, "frames that had to be triggered again");
    let counters = bench.camera.counters();
    assert_eq!((counters.failed, counters.missing_packets, counters.ignored_packets), (0, 0, 0), "{counters:?}");
}
