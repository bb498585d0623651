"""R3: a disk that is full, and one that fails, at random changes of files, by the preloaded shim."""

from __future__ import annotations

import errno
import time

from ..kit.daemon import Daemon, DaemonError, free_port, panics, plan
from ..kit.disk import files_that_differ, journal
from ..kit.row import Context, Observed, Row
from ..kit.shim import Shim
from ..kit.sse import Listener

_FAULTS = {errno.ENOSPC: "disk_full", errno.EIO: "store_failed"}


def _held(daemon: Daemon, shim: Shim) -> tuple[float | None, list[str], bool]:
    """Waits for the hold. Seconds from the first failed write to the hold, the faults, and whether the plate is removable."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        status = daemon.status()
        faults = [fault["code"] for fault in status["faults"]]
        if status["state"] == "Held" and faults and shim.failed:
            return time.monotonic() - shim.first_failure_s, faults, status["plate"]["removable"]
        if status["run"]["outcome"] is not None and not shim.failed:
            break
        time.sleep(0.01)
    return None, [fault["code"] for fault in daemon.status()["faults"]], False


def run(context: Context) -> Observed:
    """Lets the disk fail in `count` runs, alternately full and with EIO, and heals it."""
    data, log = context.work / "data", context.work / "daemon.log"
    observed, held_s, resumed_s, failed, stops = Observed("", machine_load=True), [], [], 0, 0
    shim = Shim(context.work, under=data)
    with Daemon(context.binary, data, free_port(), "--time-scale", "10", log=log, environment=shim.environment) as daemon:
        listener = Listener(daemon.port)
        for n in range(context.count):
            code = (errno.ENOSPC, errno.EIO)[n % 2]
            name = f"run {n + 1}, {errno.errorcode[code]}"
            daemon.start(f"e{n:03d}", plan(1, "bead"))
            daemon.wait_phase(("position", "detect", "revolve"))
            time.sleep(context.random.uniform(0, 2))
            since = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
            shim.fail(code, context.random.randrange(20), -1)
            after, faults, removable = _held(daemon, shim)
            failed += shim.failed
            if after is None:
                observed.expect(not shim.failed, f"{name}: {shim.failed} writes failed and the run was not held")
            else:
                held_s.append(after)
                stops += bool(shim.stops(since))
                observed.expect(_FAULTS[code] in faults, f"{name}: the faults are {faults}, not {_FAULTS[code]}")
                observed.expect(not removable, f"{name}: the plate is called removable")
            if not context.control:
                shim.heal()
            healed = time.monotonic()
            try:
                daemon.wait("end of the fault", lambda s: s["state"] != "Held" and not s["faults"], 40)
                resumed_s.append(time.monotonic() - healed)
                status = daemon.wait_ended(f"e{n:03d}", 120)
            except DaemonError as error:
                observed.misses.append(f"{name}: {error}")
                break
            outcomes = [result["outcome"] for result in status["run"]["results"]]
            observed.expect(outcomes == ["succeeded"], f"{name}: the well ended as {outcomes}")
            context.say(f"{name}: held after {after} s, went on after {resumed_s[-1]:.1f} s")
        if not context.control:
            daemon.end()
    listener.end()
    written = {event["id"]: event for event in journal(data / "events.jsonl")}
    lost = [event["id"] for event in listener.events() if written.get(event["id"]) != event]
    observed.expect(not lost, f"{len(lost)} acknowledged events are not in the journal: {lost[:5]}")
    observed.expect(sorted(written) == list(range(1, len(written) + 1)), "the numbers of the events have gaps")
    for sums in data.glob("runs/*/*/SHA256SUMS"):
        differ = files_that_differ(sums.parent)
        observed.expect(not differ, f"{sums.parent}: {differ} differ from SHA256SUMS")
    observed.misses += panics(log)
    observed.done = f"{context.count} runs of a bead; ENOSPC and EIO in turn, from a random change of a file on, until the run is held"
    observed.at_most("from the first failed write to the hold, slowest", max(held_s, default=None), 1, "s")
    observed.figures += [
        f"{len(held_s)} holds after {failed} failed operations, {stops} of them with a stop on the motor's wire (the others had no "
        "move under way)",
        f"{len(listener.heard)} acknowledged events, all on disk",
    ]
    if resumed_s:
        observed.figures.append(f"went on at most {max(resumed_s):.1f} s after the disk was well again")
    return observed


ROW = Row(
    "R3",
    "disk full, EIO at each write",
    "Held + fault within 1 s, motors stopped, goes on by itself once the disk is well; nothing acknowledged is lost",
    (1, 6, 100),
    "runs",
    "the disk is never healed",
    run,
)
