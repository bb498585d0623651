//! A warm segmenter works in the memory it has: counted by the allocator of this program, which is why it stands alone.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it
#![allow(unsafe_code)] // an allocator cannot be written without

use carved::frame::{PixelFormat, RawFrame};
use carved::profile::{EdgePoint, Picture, Profile, SegmentSettings, Segmenter};
use hardware_sim::scene::{Exposure, Placement, Scene, SceneSettings, Specimen};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    /// Calls and bytes asked for, and bytes held, of this thread: what the test harness and other threads do is not counted.
    static COUNTED: Cell<Counted> = const { Cell::new(Counted { calls: 0, bytes: 0, held: 0 }) };
}

#[derive(Debug, Clone, Copy, Default)]
struct Counted {
    calls: usize,
    bytes: usize,
    held: isize,
}

fn count(asked: usize, freed: usize) {
    // A thread that ends has no counter any more.
    let _ = COUNTED.try_with(|counted| {
        let now = counted.get();
        counted.set(Counted {
            calls: now.calls + usize::from(asked > 0),
            bytes: now.bytes + asked,
            held: now.held + asked as isize - freed as isize,
        });
    });
}

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(0, layout.size());
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size, layout.size());
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn counted<T>(work: impl FnOnce() -> T) -> (T, Counted) {
    let before = COUNTED.get();
    let result = work();
    let now = COUNTED.get();
    (result, Counted { calls: now.calls - before.calls, bytes: now.bytes - before.bytes, held: now.held - before.held })
}

fn pictures() -> Vec<Picture> {
    let scene = Scene::new(SceneSettings::default());
    scene.load(Some(Specimen::larva(4, 7).unwrap().placed(Placement::default()))).unwrap();
    let picture = |number: u64| {
        let rgb = scene.render(&Exposure { angle_rad: 1.3 * number as f64, number });
        Picture::from_frame(&RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8()).unwrap())
    };
    (0..4).map(picture).collect()
}

/// What a frame may ask for beside what it hands out: as much as one and a half masks of 1024 x 1024. One buffer of a number
/// per pixel of the bore more, 118 x 1024 x 4 bytes, passes that.
const BESIDE_BYTES: usize = 3 << 19;
const BESIDE_CALLS: usize = 1000;

/// Bytes of the vectors in a profile, by the sizes of what they hold.
fn handed_out(profile: &Profile) -> usize {
    let vertices: usize = profile.edge.iter().map(|p| p.vertices.len()).sum();
    profile.mask.data().len() + vertices * (size_of::<[f64; 2]>() + size_of::<EdgePoint>())
}

/// What else a frame asks for, and gives back before the next: the detection's grid, labels, depths and table of labels, the
/// walls' votes, kernels, and the bookkeeping of the mean shift's threads. Counted: 1.34 MB in 829 calls beside a result of
/// 1.08 MB, nearly all of which is the mask.
#[test]
fn a_warm_segmenter_asks_for_little_more_than_it_hands_out_and_keeps_nothing() {
    let (pictures, settings) = (pictures(), SegmentSettings::default());
    let mut segmenter = Segmenter::default();
    // Twice through all: models of every blur that these frames have are made, buffers are as large as any needs.
    for picture in pictures.iter().chain(&pictures) {
        segmenter.segment(picture, &settings, None).unwrap();
    }
    for (n, picture) in pictures.iter().cycle().take(20).enumerate() {
        let (profile, counted) = counted(|| segmenter.segment(picture, &settings, None).unwrap());
        let out = handed_out(&profile);
        println!("frame {n}: {counted:?}, handed out {out} bytes");
        // Vectors that are grown by doubling hold at most twice what is in them.
        let slack = profile.edge.iter().map(|p| p.vertices.len()).sum::<usize>() * (size_of::<[f64; 2]>() + size_of::<EdgePoint>());
        assert!(counted.held <= (out + slack + 4096) as isize, "frame {n}: {} bytes are kept, {out} handed out", counted.held);
        assert!(counted.held >= out as isize, "frame {n}: {} bytes for a result of {out}", counted.held);
        assert!(counted.bytes <= out + slack + BESIDE_BYTES, "frame {n}: {} bytes beside the result", counted.bytes - out);
        assert!(counted.calls <= BESIDE_CALLS, "frame {n}: {} calls", counted.calls);
    }
}
