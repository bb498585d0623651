"""R3: a disk that is full, and one that fails, at random changes of files, by the preloaded shim.

In the runs at random changes the emulated motor is ten times faster than a real one, and few writes fail during a move. So the journal
alone also fails at a slow motor: the event of a view is written while the motor moves to the next one.
"""

from __future__ import annotations

import errno
import time

from ..kit.daemon import Daemon, DaemonError, free_port, panics, plan
from ..kit.disk import files_that_differ, journal, read_json
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
            return time.monotonic() - shim.first_failure_ns / 1e9, faults, status["plate"]["removable"]
        if status["run"]["outcome"] is not None and not shim.failed:
            break
        time.sleep(0.01)
    return None, [fault["code"] for fault in daemon.status()["faults"]], False


def _stop_in_a_move(daemon: Daemon, shim: Shim, name: str, view: int, observed: Observed) -> float | None:
    """Fills the disk at the event of this view. Milliseconds from the failed write to the stop, or None if the motor stood then."""
    daemon.start(name, plan(1, "bead"))
    daemon.wait(f"view {view}", lambda s: (s["specimen"] or {}).get("view", 0) >= view, 300, 0.01)
    shim.fail(errno.ENOSPC, 0, -1)
    after, faults, _ = _held(daemon, shim)
    failed_at = shim.first_failure_ns
    moved_at = shim.last_move(failed_at)
    stops = shim.stops(failed_at)
    shim.heal()
    daemon.wait("end of the fault", lambda s: s["state"] != "Held" and not s["faults"], 40)
    daemon.http("POST", f"/v1/runs/{name}/abort")
    daemon.wait_ended(name, 120)
    observed.expect(after is not None, f"{name}: {shim.failed} writes failed and the run was not held: {faults}")
    recordings = daemon.data.glob(f"runs/{name}/A01*/recording.json")
    moves_ms = [entry["moved_ms"] for path in recordings for entry in read_json(path)["ledger"][1:]]
    if moved_at is None or not moves_ms or (failed_at - moved_at) / 1e6 > min(moves_ms):
        return None
    into_ms = (failed_at - moved_at) / 1e6
    observed.expect(bool(stops), f"{name}: a write failed {into_ms:.0f} ms into a move, and no stop came on the motor's wire")
    return (min(stops) - failed_at) / 1e6 if stops else None


def _stops(context: Context, observed: Observed) -> None:
    """Lets the journal alone fail in mid-turn of a slow motor, and expects the stop on its wire."""
    data, log = context.work / "slow", context.work / "slow.log"
    shim, runs = Shim(context.work, "slow", under=data / "events.jsonl"), max(1, context.count // 3)
    with Daemon(context.binary, data, free_port(), "--time-scale", "0.5", log=log, environment=shim.environment) as daemon:
        found = [_stop_in_a_move(daemon, shim, f"m{n:03d}", context.random.randrange(2, 12), observed) for n in range(runs)]
        daemon.end()
    observed.misses += panics(log)
    stopped = [ms for ms in found if ms is not None]
    context.say(f"stops after {found} ms")
    if stopped:
        observed.figures.append(f"in {len(stopped)} of {runs} further runs the journal failed during a move")
        observed.at_most("from that failed write to the stop on the motor's wire, slowest", max(stopped), 1000, "ms")
    elif not observed.misses:
        observed.not_judged.append("motors stopped: no write failed during a move")


def run(context: Context) -> Observed:
    """Lets the disk fail in `count` runs, alternately full and with EIO, and heals it."""
    data, log = context.work / "data", context.work / "daemon.log"
    observed, held_s, resumed_s, failed = Observed("", machine_load=True), [], [], 0
    shim = Shim(context.work, under=data)
    with Daemon(context.binary, data, free_port(), "--time-scale", "10", log=log, environment=shim.environment) as daemon:
        listener = Listener(daemon.port)
        for n in range(context.count):
            code = (errno.ENOSPC, errno.EIO)[n % 2]
            name = f"run {n + 1}, {errno.errorcode[code]}"
            daemon.start(f"e{n:03d}", plan(1, "bead"))
            daemon.wait_phase(("position", "detect", "revolve"))
            time.sleep(context.random.uniform(0, 2))
            shim.fail(code, context.random.randrange(20), -1)
            after, faults, removable = _held(daemon, shim)
            failed += shim.failed
            if after is None:
                observed.expect(not shim.failed, f"{name}: {shim.failed} writes failed and the run was not held")
            else:
                held_s.append(after)
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
    observed.done = (
        f"{context.count} runs of a bead; ENOSPC and EIO in turn, from a random change of a file on, until the run is held; the "
        "journal alone full in mid-turn of a motor at half speed"
    )
    observed.at_most("from the first failed write to the hold, slowest", max(held_s, default=None), 1, "s")
    observed.figures += [
        f"{len(held_s)} holds after {failed} failed operations",
        f"{len(listener.heard)} acknowledged events, all on disk",
    ]
    if resumed_s:
        observed.figures.append(f"went on at most {max(resumed_s):.1f} s after the disk was well again")
    if not context.control:
        _stops(context, observed)
    return observed


ROW = Row(
    "R3",
    "disk full, EIO at each write",
    "Held + fault within 1 s, motors stopped, goes on by itself once the disk is well; nothing acknowledged is lost",
    (1, 6, 100),
    "runs",
    "the disk is never healed",
    r"no end of the fault within",
    run,
)
