//! A warm segmenter and a warm count of the residual volume allocate nothing beyond their results. A counting global allocator measures
//! this, so these tests have a program of their own.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it
#![allow(unsafe_code)] // a global allocator needs unsafe code

use carved_core::carver::{ResidualVolume, Runs};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
use carved_core::profile::{EdgePoint, Mask, Picture, Polygon, Profile, SegmentSettings, Segmenter};
use hardware_sim::scene::{Exposure, Placement, Scene, SceneSettings, Specimen};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    /// Calls, bytes requested and bytes held by this thread. Other threads and the test harness are not counted.
    static COUNTED: Cell<Counted> = const { Cell::new(Counted { calls: 0, bytes: 0, held: 0 }) };
}

#[derive(Debug, Clone, Copy, Default)]
struct Counted {
    calls: usize,
    bytes: usize,
    held: isize,
}

fn count(asked: usize, freed: usize) {
    // A thread that is ending may have dropped its counter already.
    let _ = COUNTED.try_with(|counted| {
        let now = counted.get();
        counted.set(Counted {
            calls: now.calls + usize::from(asked > 0),
            bytes: now.bytes + asked,
            held: now.held + asked as isize - freed as isize,
        });
    });
}

// SAFETY: every call is forwarded unchanged to the system allocator.
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

/// Allocations that a frame may make beside its result: a list of one outline reserves room for four, and the thread pool allocates its job
/// queue in blocks of 31.
const BESIDE_BYTES: usize = 1024;
const BESIDE_CALLS: usize = 1;

/// Total size in bytes and number of the vectors in a profile: the mask, the lists of outlines with and without fins, the list of the
/// points of the former, and the contents of these.
fn handed_out(profile: &Profile) -> (usize, usize) {
    let vertices = |outlines: &[Polygon]| outlines.iter().map(|p| p.vertices.len()).sum::<usize>();
    let (edge, body) = (vertices(&profile.edge), vertices(&profile.body));
    let lists = profile.edge.len() * (size_of::<Polygon>() + size_of::<Vec<EdgePoint>>()) + profile.body.len() * size_of::<Polygon>();
    let bytes = profile.mask.data().len() + lists + (edge + body) * size_of::<[f64; 2]>() + edge * size_of::<EdgePoint>();
    let vectors = |outlines: &[Polygon], each: usize| if outlines.is_empty() { 0 } else { each * (1 + outlines.len()) };
    (bytes, 1 + vectors(&profile.edge, 2) + vectors(&profile.body, 1))
}

#[test]
fn a_warm_segmenter_asks_for_what_it_hands_out_and_keeps_nothing() {
    let (pictures, settings) = (pictures(), SegmentSettings::default());
    let mut segmenter = Segmenter::default();
    // Two passes over all pictures fill the caches: a model for every blur in these frames, and buffers of the largest size.
    for picture in pictures.iter().chain(&pictures) {
        segmenter.segment(picture, &settings, None).unwrap();
    }
    for (n, picture) in pictures.iter().cycle().take(20).enumerate() {
        let (profile, counted) = counted(|| segmenter.segment(picture, &settings, None).unwrap());
        let (out, vectors) = handed_out(&profile);
        println!("frame {n}: {counted:?}, handed out {out} bytes in {vectors} vectors");
        assert!((out..=out + BESIDE_BYTES).contains(&counted.bytes), "frame {n}: {} bytes for a result of {out}", counted.bytes);
        assert!((vectors..=vectors + BESIDE_CALLS).contains(&counted.calls), "frame {n}: {} calls", counted.calls);
        assert!(counted.held <= (out + BESIDE_BYTES) as isize, "frame {n}: {} bytes are kept, {out} handed out", counted.held);
    }
}

/// Calibration counts the residual volume thousands of times. Upright and rolled cameras take different code paths.
#[test]
fn a_warm_count_of_the_residual_volume_asks_for_nothing() {
    let mut mask = Mask::empty(256, 256);
    for (u, v) in (40..200).flat_map(|u| (100..160).map(move |v| (u, v))) {
        // A ragged edge gives rows with many runs.
        mask.set(u, v, v > 103 || u % 3 == 0);
    }
    let runs = Runs::new(&mask).unwrap();
    let grid = VoxelGrid::new(BoxUm { min: [-1000.0, -400.0, -400.0], max: [1000.0, 400.0, 400.0] }, 10.0).unwrap();
    let phi = std::f64::consts::FRAC_PI_2;
    let camera = |gamma: f64| Camera {
        f: 60_000.0,
        kx: 0.1,
        ky: 0.1,
        ux: 127.5,
        uy: 130.0,
        s: 0.0,
        alpha: 0.0,
        gamma,
        phi,
        width: 256,
        height: 256,
        glass: None,
    };
    // The work must run on this thread, because only its calls are counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().unwrap();
    pool.install(|| {
        let mut residual = ResidualVolume::new(grid, 0.0).unwrap();
        let mut count = |gamma: f64| {
            let views = (0..21).map(|view| (&runs, camera(gamma).projection(f64::from(view) * 0.3)));
            residual.count(views).unwrap()
        };
        let warm = [0.0, 0.03].map(&mut count);
        for (gamma, voxels) in [0.0, 0.03].into_iter().zip(warm) {
            let (found, counted) = counted(|| count(gamma));
            assert_eq!(found, voxels);
            assert!(found > 10_000, "{found} voxels: nothing to count");
            assert_eq!((counted.calls, counted.held), (0, 0), "gamma {gamma}: {counted:?}");
        }
    });
}
