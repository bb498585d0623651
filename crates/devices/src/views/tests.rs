//! The doors on a folder that a script writes into while they wait.

use super::*;
use carved_core::frame::{PixelFormat, RawFrame};
use std::cell::{Cell, RefCell};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Instant, SystemTime};

type Action = Box<dyn FnOnce()>;

thread_local! {
    static TIME: Cell<Duration> = const { Cell::new(Duration::ZERO) };
    static SCRIPT: RefCell<Vec<(Duration, Action)>> = const { RefCell::new(Vec::new()) };
}
static START: LazyLock<Instant> = LazyLock::new(Instant::now);

/// Time passes only in pauses, and the script acts in it.
const CLOCK: Clock = Clock { now: || *START + TIME.get(), pause };

fn pause(time: Duration) {
    TIME.set(TIME.get() + time);
    let is_due = |at: &Duration| *at <= TIME.get();
    loop {
        let next = SCRIPT.with_borrow_mut(|script| script.iter().position(|(at, _)| is_due(at)).map(|i| script.remove(i)));
        let Some((_, action)) = next else { break };
        action();
    }
}

/// At this second the other program does this.
fn at(second: u64, action: impl FnOnce() + 'static) {
    SCRIPT.with_borrow_mut(|script| script.push((Duration::from_secs(second), Box::new(action))));
}

const KIND: PictureKind = PictureKind { width: 2, height: 2, format: PixelFormat::Mono8 };
const STOPS: [Steps; 4] = [Steps(0), Steps(125), Steps(250), Steps(375)];

/// A picture is its four pixels, or any other number of bytes that is no picture.
fn decode(path: &Path) -> Result<RawFrame, String> {
    let bytes = fs::read(path).map_err(|e| e.to_string())?;
    let width = if bytes.len() == 8 { 4 } else { 2 };
    RawFrame::new(width, 2, PixelFormat::Mono8, bytes).map_err(|e| e.to_string())
}

struct Rig {
    folder: tempfile::TempDir,
    axis: FolderAxis,
    camera: FolderCamera,
    sampler: FolderSampler,
}

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let settings: FolderSettings = toml::from_str(&format!(
            "folder = \"{}/{{plate}}\"\npixel_format = \"Mono8\"\npoll_ms = 500\nquiet_ms = 2000\nnext_picture_s = 60\nend_after_s = 600\n",
            folder.path().display()
        ))
        .unwrap();
        let (axis, camera, sampler) = doors(settings, KIND, Box::new(decode), CLOCK).unwrap();
        Self { folder, axis, camera, sampler }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("P1").join(name)
    }

    /// Stores a picture at a second of the other computer's clock.
    fn store(&self, name: &str, second: u64, pixels: &[u8]) {
        write(&self.path(name), second, pixels);
    }

    fn store_well(&self, well: &str, from_second: u64) {
        for view in 1..=4 {
            self.store(&format!("W_{well}_1_{view}.png"), from_second + view, &[view as u8; 4]);
        }
    }

    fn next(&mut self, wells: &[&str]) -> Result<NextWell, DeviceError> {
        let wells: Vec<Expected> = wells.iter().map(|well| expected(well)).collect();
        self.sampler.next_well(&Upcoming { run: "r", plate: "P1", wells: &wells }, &|| false)
    }

    /// The first pixels of the views of a well, as a run takes them.
    fn turn(&mut self, well: &'static str) -> Result<Vec<u8>, DeviceError> {
        self.sampler.load(&mut crate::testing::FakeAxis::new(), expected(well), &CancelToken::new()).unwrap().unwrap();
        self.again()
    }

    fn again(&mut self) -> Result<Vec<u8>, DeviceError> {
        self.axis.reference(&CancelToken::new())?;
        let mut pixels = vec![self.camera.grab(Duration::ZERO)?.frame.bytes()[0]];
        self.axis.announce(&STOPS)?;
        for stop in STOPS {
            self.axis.move_to(stop)?;
            pixels.push(self.camera.grab(Duration::ZERO)?.frame.bytes()[0]);
        }
        Ok(pixels)
    }
}

fn expected(well: &str) -> Expected<'_> {
    Expected { well, bead: false, dpf: None, asked_before: false }
}

fn write(path: &Path, second: u64, pixels: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, pixels).unwrap();
    File::open(path).unwrap().set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(second)).unwrap();
}

fn views_error<T: std::fmt::Debug>(result: Result<T, DeviceError>) -> ViewsError {
    match result.unwrap_err() {
        DeviceError::Views(error) => error,
        other => panic!("{other}"),
    }
}

#[test]
fn views_are_taken_as_they_come_and_only_when_they_are_complete() {
    let mut rig = Rig::new();
    // The fourth picture grows for a minute and a half, with pauses that are longer than the time of quiet.
    for (second, name, pixels) in [
        (1, "W_A02_1_1.png", &[1; 4][..]),
        (5, "W_A02_1_2.png", &[2; 4]),
        (9, "W_A02_1_3.png", &[3; 4]),
        (10, "W_A02_1_4.png", &[4; 1]),
        (50, "W_A02_1_4.png", &[4; 2]),
        (90, "W_A02_1_4.png", &[4; 4]),
        (91, "W_A02_1_4.png.tmp", &[9; 4]),
    ] {
        let (path, pixels) = (rig.path(name), pixels.to_vec());
        at(second, move || write(&path, second, &pixels));
    }
    assert_eq!(rig.next(&["A01", "A02"]).unwrap(), NextWell::At(1));
    assert_eq!(rig.turn("A02").unwrap(), [1, 1, 2, 3, 4]);
    assert!(TIME.get() >= Duration::from_secs(92), "{:?}: the last picture is quiet at 92 s at the earliest", TIME.get());
}

#[test]
fn a_file_that_was_reserved_and_is_not_written_to_its_end_is_not_taken() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.store("W_A01_1_3.png", 3, &[3, 3, 0, 0]);
    let path = rig.path("W_A01_1_3.png");
    at(15, move || write(&path, 15, &[3; 4]));
    assert_eq!(rig.next(&["A01"]).unwrap(), NextWell::At(0));
    assert_eq!(rig.turn("A01").unwrap(), [1, 1, 2, 3, 4]);
    // A black picture is complete: the light is off, which is another fault.
    rig.store_well("A02", 100);
    rig.store("W_A02_1_1.png", 101, &[0; 4]);
    rig.next(&["A02"]).unwrap();
    assert_eq!(rig.turn("A02").unwrap()[0], 0);
}

/// The phase of the first picture has a shorter deadline than the wait for a picture, and its error would name no picture.
#[test]
fn a_damaged_picture_that_later_ones_follow_is_told_soon_and_the_last_one_is_waited_for() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.store("W_A01_1_1.png", 2, &[1; 3]);
    rig.next(&["A01"]).unwrap();
    let began = TIME.get();
    let error = views_error(rig.turn("A01"));
    assert!(
        matches!(&error, ViewsError::Unusable { path, why } if path.ends_with("W_A01_1_1.png") && why.contains("W_A01_1_2.png")),
        "{error}"
    );
    let took = TIME.get().saturating_sub(began);
    assert!(error.is_of_one_well() && took <= Duration::from_secs(21), "{took:?}");
    // Nothing came after it, so it may still be written. It was noticed when the well was looked for.
    rig.store_well("A02", 100);
    rig.store("W_A02_1_4.png", 104, &[4; 3]);
    rig.next(&["A02"]).unwrap();
    let began = TIME.get();
    let error = views_error(rig.turn("A02"));
    assert!(matches!(&error, ViewsError::Unusable { path, .. } if path.ends_with("W_A02_1_4.png")), "{error}");
    let took = TIME.get().saturating_sub(began);
    assert!(took >= Duration::from_secs(50), "{took:?}");
}

#[test]
fn the_same_pixels_written_again_change_nothing_and_others_begin_the_turn_again() {
    let mut rig = Rig::new();
    for (second, name, value) in
        [(1, "W_A01_1_1.png", 1), (3, "W_A01_1_2.png", 2), (20, "W_A01_1_1.png", 1), (30, "W_A01_1_3.png", 3), (31, "W_A01_1_2.png", 7)]
    {
        let path = rig.path(name);
        at(second, move || write(&path, second, &[value; 4]));
    }
    let path = rig.path("W_A01_1_4.png");
    at(40, move || write(&path, 40, &[4; 4]));
    rig.next(&["A01"]).unwrap();
    let error = views_error(rig.turn("A01"));
    assert!(matches!(&error, ViewsError::Replaced { path } if path.ends_with("W_A01_1_2.png")), "{error}");
    assert!(error.may_be_tried_again() && error.is_of_one_well());
    assert_eq!(rig.again().unwrap(), [1, 1, 7, 3, 4]);
}

/// After the last view nothing is waited for that would notice it.
#[test]
fn the_last_picture_is_looked_at_again_too() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    fs::remove_file(rig.path("W_A01_1_4.png")).unwrap();
    let path = rig.path("W_A01_1_4.png");
    // The picture is quiet for long enough to be read before its program writes it again.
    for (second, value) in [(10, 4), (13, 9)] {
        let path = path.clone();
        at(second, move || write(&path, second, &[value; 4]));
    }
    rig.next(&["A01"]).unwrap();
    let error = views_error(rig.turn("A01"));
    assert!(matches!(&error, ViewsError::Replaced { path } if path.ends_with("W_A01_1_4.png")), "{error}");
    assert_eq!(rig.again().unwrap(), [1, 1, 2, 3, 9]);
}

#[test]
fn a_view_that_the_other_program_has_left_out_ends_its_well_and_one_that_may_still_come_holds_the_run() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    fs::remove_file(rig.path("W_A01_1_3.png")).unwrap();
    rig.next(&["A01", "A02"]).unwrap();
    let error = views_error(rig.turn("A01"));
    assert!(matches!(&error, ViewsError::Late { view: 3, waited_s: 60, .. }) && !error.is_of_one_well(), "{error}");
    // The operator lets the run go on, and the other program too, with the next well.
    rig.store_well("A02", 100);
    let error = views_error(rig.again());
    assert!(matches!(&error, ViewsError::Missing { view: 3, next } if next == "well A02") && error.is_of_one_well(), "{error}");
    assert_eq!(rig.next(&["A02"]).unwrap(), NextWell::At(0));
    assert_eq!(rig.turn("A02").unwrap(), [1, 1, 2, 3, 4]);
}

#[test]
fn another_fish_is_not_measured_and_two_pictures_of_a_view_are_reported() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.store("W_A01_2_1.png", 10, &[9; 4]);
    rig.next(&["A01"]).unwrap();
    assert_eq!(rig.turn("A01").unwrap(), [1, 1, 2, 3, 4]);
    rig.store("again/W_A01_1_2.png", 20, &[8; 4]);
    let error = views_error(rig.again());
    assert!(error.to_string().contains("view 2 of well A01 is also in") && error.is_of_one_well(), "{error}");
}

#[test]
fn a_picture_of_another_size_is_reported_with_both_sizes() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.store("W_A01_1_2.png", 2, &[2; 8]);
    rig.next(&["A01"]).unwrap();
    let error = views_error(rig.turn("A01"));
    assert!(error.to_string().contains("4 x 2 px Mono8; expected 2 x 2 px Mono8") && !error.is_of_one_well(), "{error}");
}

#[test]
fn wells_come_in_the_order_of_their_pictures_until_none_has_come_for_long_enough() {
    let mut rig = Rig::new();
    rig.store_well("B01", 50);
    rig.store_well("A01", 100);
    assert_eq!(rig.next(&["A01", "A02", "B01"]).unwrap(), NextWell::At(2));
    assert_eq!(rig.next(&["A01", "A02"]).unwrap(), NextWell::At(0));
    let before = TIME.get();
    assert_eq!(rig.next(&["A02"]).unwrap(), NextWell::NoMore);
    assert_eq!(TIME.get(), before + Duration::from_secs(600));
    let ended = rig.sampler.next_well(&Upcoming { run: "r", plate: "P1", wells: &[expected("A02")] }, &|| true).unwrap();
    assert_eq!(ended, NextWell::Cancelled);
}

#[test]
fn pictures_from_before_a_run_are_reported_once_and_a_run_that_continues_takes_them() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.sampler.begin_run();
    let error = views_error(rig.next(&["A01"]));
    assert!(matches!(&error, ViewsError::Earlier { count: 4, .. }), "{error}");
    assert_eq!(rig.next(&["A01"]).unwrap(), NextWell::At(0));
}

#[test]
fn a_folder_that_is_gone_is_lost_until_it_is_back() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.next(&["A01"]).unwrap();
    let (here, away) = (rig.folder.path().to_owned(), rig.folder.path().with_extension("away"));
    fs::rename(&here, &away).unwrap();
    let error = views_error(rig.axis.check());
    assert!(matches!(&error, ViewsError::FolderLost { path, .. } if *path == here), "{error}");
    assert!(matches!(views_error(rig.turn("A01")), ViewsError::FolderLost { .. }));
    fs::rename(&away, &here).unwrap();
    rig.axis.check().unwrap();
    assert_eq!(rig.again().unwrap(), [1, 1, 2, 3, 4]);
}

#[test]
fn a_stop_ends_the_wait_and_the_next_reference_releases_it() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    fs::remove_file(rig.path("W_A01_1_4.png")).unwrap();
    rig.next(&["A01"]).unwrap();
    let stop = rig.axis.stop_handle();
    at(TIME.get().as_secs() + 10, move || stop.stop());
    assert!(matches!(rig.turn("A01").unwrap_err(), DeviceError::Suspect { .. }));
    assert!(matches!(rig.axis.position(), Position::Suspect { .. }));
    assert!(matches!(rig.axis.move_to(Steps(0)), Err(DeviceError::NotReferenced)));
    rig.store("W_A01_1_4.png", 20, &[4; 4]);
    assert_eq!(rig.again().unwrap(), [1, 1, 2, 3, 4]);
    // A stop cancels the work, then stops the axis. It may come while the reference begins.
    let cancelled = CancelToken::new();
    cancelled.cancel();
    assert!(rig.axis.reference(&cancelled).is_err());
    rig.axis.stop_handle().stop();
    assert!(matches!(rig.axis.position(), Position::Suspect { .. }), "the stop is lost");
}

#[test]
fn nothing_is_taken_while_no_well_is_read() {
    let mut rig = Rig::new();
    rig.store_well("A01", 1);
    rig.axis.reference(&CancelToken::new()).unwrap();
    assert!(matches!(views_error(rig.camera.grab(Duration::ZERO)), ViewsError::NoWell));
}
