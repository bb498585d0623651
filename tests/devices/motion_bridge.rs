//! The driver of the VAST trigger bridge against an emulated VAST behind its bridge.
#![cfg(feature = "aravis")]

use crate::motion::{PATIENCE, SCALE, SPEED_DEG_PER_S, is_suspect, targets, true_steps, turn, until, with_camera};
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{VastBridge, VastBridgeSettings};
use carved_devices::{Capabilities, DeviceError, Position, RotationAxis};
use carved_records::ViewOrder;
use hardware_sim::bridge::{self, Knobs, ToSmaller};
use hardware_sim::{Controller, RigSettings};
use std::path::PathBuf;
use std::time::Duration;

struct Bench {
    folder: tempfile::TempDir,
    knobs: Knobs,
    speed_deg_per_s: f64,
    emulated: hardware_sim::Rig,
}

impl Bench {
    fn new() -> Self {
        Self::going(ToSmaller::Shortest, SPEED_DEG_PER_S)
    }

    /// Half a turn takes a second, in which a test can do something.
    fn slow() -> Self {
        Self::going(ToSmaller::Shortest, 0.1 * SPEED_DEG_PER_S)
    }

    fn going(to_smaller: ToSmaller, speed_deg_per_s: f64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let reading = bridge::Settings::reading(folder.path().join("external.txt"));
        let machine = bridge::Settings { to_smaller, speed_deg_per_s: speed_deg_per_s / SCALE, ..reading };
        let knobs = machine.knobs.clone();
        // Its device name may be that of another port once it is unplugged.
        let serial_link = Some(folder.path().join("bridge"));
        let emulated = crate::motion::rig(RigSettings { controller: Controller::Bridge(machine), serial_link, ..RigSettings::default() });
        Self { folder, knobs, speed_deg_per_s, emulated }
    }

    fn list(&self) -> PathBuf {
        self.folder.path().join("external.txt")
    }

    fn settings(&self) -> VastBridgeSettings {
        VastBridgeSettings {
            port: self.emulated.serial_path().to_str().unwrap().into(),
            baud: 115_200,
            list: self.list(),
            x_position_um: 0,
            tray_led: true,
            speed_deg_per_s: self.speed_deg_per_s,
            turn_margin_ms: 1000,
            first_arrival_timeout_ms: 20_000,
            answer_timeout_ms: 700,
            end_with_trigger: true,
        }
    }

    fn open(&self) -> VastBridge {
        VastBridge::open(self.settings(), crate::motion::per_revolution()).unwrap()
    }

    /// An axis at the first stop of the plan.
    fn standing(&self) -> VastBridge {
        let mut axis = self.open();
        self.take_up(&mut axis, ViewOrder::Sequential);
        axis
    }

    /// Announces a plan. A person loads its list if the driver asks for it.
    fn announce(&self, axis: &mut dyn RotationAxis, order: ViewOrder) {
        if let Err(asks) = axis.announce(&targets(order)) {
            assert!(matches!(asks, DeviceError::VastList { .. }), "{asks}");
            self.knobs.load_list();
            axis.announce(&targets(order)).unwrap();
        }
    }

    fn take_up(&self, axis: &mut dyn RotationAxis, order: ViewOrder) {
        self.announce(axis, order);
        self.knobs.take_up_specimen();
        axis.reference(&CancelToken::new()).unwrap();
    }
}

#[test]
fn a_revolution_through_the_list_shows_every_view_at_the_angle_of_its_ledger() {
    for to_smaller in [ToSmaller::Shortest, ToSmaller::Back] {
        let bench = Bench::going(to_smaller, SPEED_DEG_PER_S);
        let axis = bench.open();
        let expected = Capabilities {
            has_position: false,
            has_encoder: false,
            has_stall: false,
            can_stop: false,
            absolute: false,
            trigger_only: true,
            outside: false,
        };
        assert_eq!(axis.capabilities(), expected);
        assert!(axis.identity().contains("trigger pulse 50 ms"), "{}", axis.identity());
        let mut devices = with_camera(&bench.emulated, Box::new(axis));
        let mut last_epoch = 0;
        for order in [ViewOrder::Sequential, ViewOrder::CoarseToFine] {
            bench.take_up(&mut *devices.rotation, order);
            let ledger = turn(&bench.emulated, &mut devices, order);
            assert!(ledger.entries()[0].epoch > last_epoch, "every specimen begins an epoch");
            last_epoch = ledger.entries()[0].epoch;
            assert_eq!(ledger.closure().unwrap().achieved_steps, Steps(500));
            devices.rotation.let_go(&CancelToken::new()).unwrap();
            assert_eq!(devices.rotation.position(), Position::Unknown);
        }
    }
}

#[test]
fn only_the_next_stop_of_the_list_can_be_moved_to_and_the_refusal_says_both() {
    let bench = Bench::new();
    let mut axis = bench.standing();
    let stops = targets(ViewOrder::Sequential);
    let refusal = axis.move_to(stops[2]).unwrap_err();
    assert!(matches!(refusal, DeviceError::NotNext { target, next: Some(next) } if (target, next) == (stops[2], stops[1])), "{refusal}");
    assert_eq!(axis.move_to(stops[0]).unwrap().steps, stops[0], "where it stands it need not be moved to");
    assert_eq!(axis.move_to(stops[1]).unwrap().steps, stops[1]);
    assert!(matches!(axis.move_to(stops[0]), Err(DeviceError::NotNext { .. })), "it does not turn back");
    assert!((true_steps(&bench.emulated) - stops[1].0 as f64).abs() < 1e-6);
    assert_eq!(axis.position(), Position::Referenced { steps: stops[1], epoch: 1 });
}

/// Sets a fault and makes the next move. Checks that the move fails as expected, that no further trigger follows, and that the axis can be
/// recovered.
fn fails(fault: impl FnOnce(&Bench), as_it_should: impl Fn(&DeviceError) -> bool) {
    fails_on(&Bench::new(), fault, as_it_should);
}

fn fails_on(bench: &Bench, fault: impl FnOnce(&Bench), as_it_should: impl Fn(&DeviceError) -> bool) {
    let mut axis = bench.standing();
    let stops = targets(ViewOrder::Sequential);
    fault(bench);
    // A duplicated arrival shows at the next request.
    let error = stops[1..3].iter().find_map(|stop| axis.move_to(*stop).err()).unwrap();
    assert!(as_it_should(&error), "{error:?}");
    assert!(is_suspect(&axis), "{:?}", axis.position());
    assert!(matches!(axis.move_to(stops[1]), Err(DeviceError::Suspect { .. })), "a suspect axis refuses to move");
    let turned = true_steps(&bench.emulated);
    assert!(turned < stops[1].0 as f64 + 1e-6, "{turned} steps: a trigger was repeated");
    if bench.emulated.serial_path().exists() {
        bench.take_up(&mut axis, ViewOrder::Sequential);
        assert_eq!(axis.move_to(stops[1]).unwrap().steps, stops[1]);
        assert!((true_steps(&bench.emulated) - stops[1].0 as f64).abs() < 1e-6);
    }
}

fn silent_on(error: &DeviceError, word: &str) -> bool {
    matches!(error, DeviceError::Silent { request, .. } if request.contains(word))
}

fn late(error: &DeviceError) -> bool {
    matches!(error, DeviceError::Late { what, .. } if what.contains("R1"))
}

fn out_of_step(error: &DeviceError, word: &str) -> bool {
    matches!(error, DeviceError::OutOfStep { why } if why.contains(word))
}

#[test]
fn a_trigger_that_is_lost_or_not_acknowledged_is_never_repeated() {
    fails(|b| b.knobs.lose_requests(1), |e| silent_on(e, "TT"));
    // In this case VAST turns nevertheless.
    fails(|b| b.emulated.faults().serial().drop_answers(1), |e| out_of_step(e, "before the trigger was acknowledged"));
    fails(|b| b.emulated.faults().serial().rewrite_next(b"OK", b"O\xcb"), |e| out_of_step(e, "before the trigger was acknowledged"));
}

#[test]
fn an_arrival_that_does_not_come_in_time_is_missed_by_name() {
    fails(|b| b.knobs.miss_triggers(1), late);
    fails(|b| b.knobs.delay_arrivals(1, 20 * PATIENCE), late);
    fails(|b| b.emulated.faults().serial().rewrite_next(b"R1", b"R2"), late);
}

#[test]
fn an_arrival_too_many_or_too_soon_is_not_believed() {
    fails(|b| b.knobs.double_arrivals(1), |e| out_of_step(e, "no trigger explains"));
    // What the computer reads too late cannot be told from an arrival in time.
    fails_on(&Bench::going(ToSmaller::Shortest, 0.05 * SPEED_DEG_PER_S), |b| b.knobs.stray_arrivals(1), |e| out_of_step(e, "at least"));
    fails(|b| b.emulated.faults().serial().stray_to_host(b"R1\n"), |e| out_of_step(e, "before the trigger was acknowledged"));
}

#[test]
fn two_arrivals_for_one_specimen_are_one_too_many() {
    let bench = Bench::new();
    let mut axis = bench.open();
    bench.announce(&mut axis, ViewOrder::Sequential);
    bench.emulated.faults().serial().stray_to_host(b"R1\nR1\n");
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(out_of_step(&error, "2 arrivals"), "{error}");
    bench.take_up(&mut axis, ViewOrder::Sequential);
}

#[test]
fn every_error_of_the_bridge_is_reported_by_its_number() {
    for number in 0..=3 {
        fails(
            |b| b.knobs.answer_with_error(number),
            |e| matches!(e, DeviceError::Alarm { what, .. } if what.contains(&format!("E{number}"))),
        );
    }
}

#[test]
fn a_bridge_that_is_reset_while_vast_turns_or_rests_waits_for_a_person() {
    let bench = Bench::slow();
    let mut axis = bench.open();
    bench.take_up(&mut axis, ViewOrder::CoarseToFine);
    let half_a_turn = targets(ViewOrder::CoarseToFine)[1];
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(half_a_turn));
        until("the shaft turns", || true_steps(&bench.emulated) > 1.0);
        bench.emulated.faults().reboot_controller();
        let error = moving.join().unwrap().unwrap_err();
        assert!(is_a_persons_reset(&error), "{error}");
    });
    assert!(is_suspect(&axis));
    until("VAST ends its step", || (true_steps(&bench.emulated) - half_a_turn.0 as f64).abs() < 1e-6);

    let bench = Bench::new();
    let mut axis = bench.open();
    bench.take_up(&mut axis, ViewOrder::CoarseToFine);
    axis.check().unwrap();
    bench.emulated.faults().reboot_controller();
    let mut found = Ok(());
    until("the reset to be seen", || {
        found = axis.check();
        found.is_err()
    });
    let error = found.unwrap_err();
    assert!(is_a_persons_reset(&error), "{error}");
    assert!(is_suspect(&axis));
}

fn is_a_persons_reset(error: &DeviceError) -> bool {
    matches!(error, DeviceError::Intervention { what, .. } if what.contains("not by carved"))
}

#[test]
fn a_pulled_cable_is_reported_and_leaves_vast_where_its_step_ends() {
    fails(|b| b.emulated.faults().unplug_serial(), |e| matches!(e, DeviceError::Gone { .. }));
}

#[test]
fn a_late_answer_to_the_greeting_is_no_ok_to_a_trigger() {
    let bench = Bench::new();
    let mut axis = bench.open();
    bench.announce(&mut axis, ViewOrder::Sequential);
    // After 700 ms the driver asks again. The bridge then answers twice.
    bench.emulated.faults().serial().delay_answer_after(0, Duration::from_secs(1));
    bench.knobs.take_up_specimen();
    axis.reference(&CancelToken::new()).unwrap();
    let stop = targets(ViewOrder::Sequential)[1];
    assert_eq!(axis.move_to(stop).unwrap().steps, stop);
}

#[test]
fn split_and_merged_lines_and_noise_between_them_cost_nothing() {
    let bench = Bench::new();
    let axis = bench.open();
    bench.emulated.faults().serial().split_answers(true);
    let mut devices = with_camera(&bench.emulated, Box::new(axis));
    bench.take_up(&mut *devices.rotation, ViewOrder::Sequential);
    // A lost line end merges the acknowledgement and the arrival into one line.
    bench.knobs.lose_line_ends(1);
    bench.emulated.faults().serial().stray_to_host(b"\xfe\x00?\n");
    turn(&bench.emulated, &mut devices, ViewOrder::Sequential);
}

#[test]
fn a_stop_ends_the_triggers_and_vast_ends_its_step() {
    let bench = Bench::slow();
    let mut axis = bench.open();
    bench.take_up(&mut axis, ViewOrder::CoarseToFine);
    let half_a_turn = targets(ViewOrder::CoarseToFine)[1];
    let stop = axis.stop_handle();
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| axis.move_to(half_a_turn));
        until("the shaft turns", || true_steps(&bench.emulated) > 1.0);
        stop.stop();
        let error = moving.join().unwrap().unwrap_err();
        assert!(matches!(error, DeviceError::Stopped), "{error}");
    });
    assert!(is_suspect(&axis));
    until("VAST ends its step", || (true_steps(&bench.emulated) - half_a_turn.0 as f64).abs() < 1e-6);
    let cancelled = CancelToken::new();
    cancelled.cancel();
    bench.announce(&mut axis, ViewOrder::Sequential);
    assert!(matches!(axis.reference(&cancelled), Err(DeviceError::Stopped)), "who stops for good stays stopped");
    bench.take_up(&mut axis, ViewOrder::Sequential);
    assert_eq!(axis.move_to(targets(ViewOrder::Sequential)[1]).unwrap().epoch, axis_epoch(&axis));
}

fn axis_epoch(axis: &dyn RotationAxis) -> u32 {
    match axis.position() {
        Position::Referenced { epoch, .. } => epoch,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_specimen_that_is_not_wanted_is_let_go_through_the_rest_of_the_list() {
    let bench = Bench::new();
    let mut axis = bench.standing();
    axis.let_go(&CancelToken::new()).unwrap();
    assert!((true_steps(&bench.emulated) - 500.0).abs() < 1e-6, "VAST came to its list's end");
    bench.take_up(&mut axis, ViewOrder::Sequential);
    assert_eq!(axis_epoch(&axis), 2);
}

#[test]
fn vast_never_goes_by_another_list_than_the_one_that_was_announced() {
    let bench = Bench::new();
    let mut axis = bench.open();
    let unannounced = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(out_of_step(&unannounced, "no list"), "{unannounced}");
    bench.announce(&mut axis, ViewOrder::Sequential);
    let written = std::fs::read_to_string(bench.list()).unwrap();
    assert!(written.contains("\t30,24\t") && written.ends_with("\t0,00\t1\t1\tno\ton\r\n"), "{written}");

    // VAST takes up a specimen with one list. Another list is then announced.
    bench.knobs.take_up_specimen();
    let mut orders = [ViewOrder::CoarseToFine, ViewOrder::Sequential].into_iter().cycle();
    until("the refusal of a list that comes too late", || {
        let before = std::fs::read(bench.list()).unwrap();
        let late = axis.announce(&targets(orders.next().unwrap())).unwrap_err();
        if matches!(late, DeviceError::VastList { .. }) {
            return false;
        }
        assert!(out_of_step(&late, "by another"), "{late}");
        assert_eq!(std::fs::read(bench.list()).unwrap(), before, "a list that VAST goes by is not changed");
        true
    });

    std::fs::remove_file(bench.list()).unwrap();
    std::fs::create_dir(bench.list()).unwrap();
    let unwritten = axis.announce(&targets(ViewOrder::Sequential)).unwrap_err();
    assert!(matches!(unwritten, DeviceError::List { .. }) && unwritten.to_string().contains("external.txt"), "{unwritten}");
}

#[test]
fn a_specimen_that_vast_never_brings_is_not_waited_for_without_end() {
    let bench = Bench::new();
    let settings = VastBridgeSettings { first_arrival_timeout_ms: 100, ..bench.settings() };
    let mut axis = VastBridge::open(settings, crate::motion::per_revolution()).unwrap();
    // Whoever lets the run go on without loading the list gets a VAST that does nothing with a specimen.
    assert!(axis.announce(&targets(ViewOrder::Sequential)).is_err());
    axis.announce(&targets(ViewOrder::Sequential)).unwrap();
    bench.knobs.take_up_specimen();
    let error = axis.reference(&CancelToken::new()).unwrap_err();
    assert!(late(&error) && error.to_string().contains("100 ms"), "{error}");
    assert!(matches!(axis.move_to(Steps(0)), Err(DeviceError::Suspect { .. })));
}

#[test]
fn a_person_loads_every_new_list_and_is_asked_once() {
    let bench = Bench::new();
    let mut axis = bench.open();
    let asks = |axis: &mut VastBridge, order| match axis.announce(&targets(order)) {
        Err(DeviceError::VastList { path }) => {
            assert_eq!(path, bench.list());
            true
        }
        other => {
            other.unwrap();
            false
        }
    };
    assert!(asks(&mut axis, ViewOrder::Sequential));
    bench.knobs.load_list();
    bench.take_up(&mut axis, ViewOrder::Sequential);
    axis.let_go(&CancelToken::new()).unwrap();
    assert!(!asks(&mut axis, ViewOrder::Sequential), "it is loaded");
    assert!(asks(&mut axis, ViewOrder::CoarseToFine) && !asks(&mut axis, ViewOrder::CoarseToFine));
    std::fs::write(bench.list(), "no\t0\t3,60\t1\t1\tno\ton\r\n").unwrap();
    assert!(asks(&mut axis, ViewOrder::CoarseToFine), "somebody has written another list there");
    drop(axis);
    assert!(asks(&mut bench.open(), ViewOrder::CoarseToFine), "after a restart nobody knows what VAST has loaded");
}
