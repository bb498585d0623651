"""R4 and R7: the cable of the axis and of the camera is pulled in mid-run and comes back."""

from __future__ import annotations

import re
import time
from datetime import datetime

from ..kit.daemon import Daemon, DaemonError, free_port, panics, plan
from ..kit.disk import journal, read_json
from ..kit.row import Context, Observed, Row
from ..kit.rust_tests import Tests, run_tests

_CHANGE = re.compile(r"^(\S+Z)\s+WARN .*a cable of the emulated rig.*out=(true|false)")
_FIRST_S = 6.0
_AXIS_TESTS = Tests("-p carved --test devices", ("pulled_at_any_byte", "a_silent_controller_is", "a_silent_module_is"))
_CAMERA_TESTS = Tests("-p carved --test devices", ("stolen_control", "a_deaf_trigger_is_repeated_and_given_up"))


def _seconds(stamp: str) -> float:
    return datetime.fromisoformat(re.sub(r"(\.\d{6})\d*Z$", r"\1+00:00", stamp)).timestamp()


def _changes(daemon: Daemon) -> list[tuple[float, bool]]:
    plain = re.sub(r"\x1b\[[0-9;]*m", "", daemon.log.read_text(errors="replace"))
    found = (_CHANGE.match(line) for line in plain.splitlines())
    return [(_seconds(match[1]), match[2] == "true") for match in found if match]


def _pull(context: Context, option: str, n: int, out_s: float, device: str, observed: Observed) -> tuple[float | None, float | None]:
    """One life with one pulled cable. Seconds from the pull to the first notice, and from the return to the next view."""
    at = _FIRST_S + context.random.uniform(0, 6)
    data, log = context.work / f"data{n}", context.work / f"daemon{n}.log"
    options = () if context.control else (option, f"{at:.2f},{out_s:g}")
    name = f"{option} {at:.1f},{out_s:g}"
    noticed = None
    with Daemon(context.binary, data, free_port(), "--time-scale", "10", *options, log=log) as daemon:
        daemon.start("a", plan(1 if context.control else 12, "bead"))
        deadline = time.monotonic() + 900
        while time.monotonic() < deadline:
            status = daemon.status()
            gone = status["faults"] or not status["hardware"][device]["connected"]
            if noticed is None and gone and any(out for _, out in _changes(daemon)):
                noticed = _seconds(status["server_time"])
            if status["run"]["outcome"] is not None:
                break
            if (
                status["state"] == "Held"
                and not status["run"]["goes_on_by_itself"]
                and _changes(daemon)[-1:]
                and not _changes(daemon)[-1][1]
                and status["hardware"][device]["connected"]
            ):
                daemon.continue_run()
            time.sleep(0.02)
        try:
            status = daemon.wait_ended("a", 60)
            outcomes = [result["outcome"] for result in status["run"]["results"]]
            observed.expect(all(o in ("succeeded", "flagged") for o in outcomes), f"{name}: the wells ended as {outcomes}")
        except DaemonError as error:
            observed.misses.append(f"{name}: {error}")
        changes = _changes(daemon)
        daemon.end()
    observed.misses += panics(log)
    for path in data.glob("runs/a/*/recording.json"):
        epochs = {entry["epoch"] for entry in read_json(path)["ledger"]}
        observed.expect(len(epochs) <= 1, f"{name}: {path.parent.name} mixes views of {len(epochs)} references")
    pulled = next((when for when, out in changes if out), None)
    back = next((when for when, out in changes if not out), None)
    if pulled is None or back is None:
        observed.misses.append(f"{name}: no cable was pulled")
        return None, None
    views = [_seconds(e["time"]) for e in journal(data / "events.jsonl") if e["kind"] == "view.taken"]
    again = min((when for when in views if when > back), default=None)
    raised = [_seconds(e["time"]) for e in journal(data / "events.jsonl") if e["kind"] == "fault.raised"]
    first = min((when for when in [*raised, *([noticed] if noticed else [])] if when >= pulled), default=None)
    context.say(f"{name}: noticed {first and first - pulled}, next view {again and again - back}")
    return first and first - pulled, again and again - back


def _add_tests(context: Context, tests: Tests, observed: Observed) -> None:
    """Runs the tests that hold the other part of the goal. A control breaks the cable's part."""
    if not context.control:
        held = run_tests(context, [tests], "")
        observed.add(held)
        observed.program = f"{context.version}; {held.program}"


def run_axis(context: Context) -> Observed:
    """Pulls the axis' cable in `count` runs."""
    observed = Observed(
        f"{context.count} runs of 12 beads, the serial cable out for 3 s at a random moment; at each byte, and a silent controller: "
        f"{_AXIS_TESTS.named()}",
        machine_load=True,
    )
    pulls = [_pull(context, "--axis-out", n, 3, "rotation", observed) for n in range(context.count)]
    noticed = [first for first, _ in pulls if first is not None]
    observed.at_most("fault after the hang-up, slowest", max(noticed, default=None), 0.1, "s")
    if noticed:
        observed.figures.append(f"fastest {min(noticed):.2f} s")
    resumed = [again for _, again in pulls if again is not None]
    if resumed:
        observed.figures.append(f"next view at most {max(resumed):.1f} s after the cable was back, from a new reference")
    observed.not_judged.append("1 s on silence: the tests show that a silent controller is named and not believed, not after which time")
    _add_tests(context, _AXIS_TESTS, observed)
    return observed


def run_camera(context: Context) -> Observed:
    """Pulls the camera's cable in `count` runs."""
    observed = Observed(
        f"{context.count} runs of 12 beads, the camera's cable out for 3 s at a random moment; stolen control and a silent camera: "
        f"{_CAMERA_TESTS.named()}",
        machine_load=True,
    )
    pulls = [_pull(context, "--camera-out", n, 3, "camera", observed) for n in range(context.count)]
    noticed = [first for first, _ in pulls if first is not None]
    observed.at_most("noticed after the pull, slowest", max(noticed, default=None), 1.5, "s")
    resumed = [again for _, again in pulls if again is not None]
    observed.at_most("next view after the cable was back, slowest", max(resumed, default=None), 10, "s")
    _add_tests(context, _CAMERA_TESTS, observed)
    return observed


R4 = Row(
    "R4",
    "serial unplug at any byte of a command",
    "fault within 100 ms on hang-up, 1 s on silence; no motion until re-referenced; the specimen is begun again",
    (1, 3, 100),
    "unplugs",
    "the cable is not pulled",
    "no cable was pulled$",
    run_axis,
    "during a run the daemon asks the kernel every 50 ms whether the controller has hung up, shows it in the status and ends the phase. "
    "The fault follows once the numbers in progress are on disk. Between runs the devices are checked once a second.",
)

R7 = Row(
    "R7",
    "camera control stolen, cable pulled, camera silent",
    "a pull, a stolen control and a silent camera are named; a pull is seen within 1.5 s; connects again by itself within 10 s; the "
    "view is grabbed again",
    (1, 3, 100),
    "pulls",
    "the cable is not pulled",
    "no cable was pulled$",
    run_camera,
)
