"""R13: a run beside a crowd that polls the status, compared with runs without it before and after."""

from __future__ import annotations

import http.client
import signal
import threading
import time
from dataclasses import dataclass, field

from ..kit import crowd
from ..kit.daemon import Daemon, free_port, panics, plan
from ..kit.disk import read_json
from ..kit.row import Context, Observed, Row, percentile

_HZ = 10.0
_WELLS = 4


@dataclass
class _Probe(threading.Thread):
    """One client apart from the crowd, on a connection of its own: the status every 20 ms."""

    port: int
    latencies: list[float] = field(default_factory=list)
    failed: int = 0
    ended: bool = False

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    def __hash__(self) -> int:
        return id(self)

    def run(self) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        while not self.ended:
            began = time.monotonic()
            try:
                connection.request("GET", "/v1/status")
                answer = connection.getresponse()
                answer.read()
                self.failed += answer.status != 200
                self.latencies.append(time.monotonic() - began)
            except (OSError, http.client.HTTPException):
                self.failed += 1
                connection.close()
            time.sleep(max(0.0, 0.02 - (time.monotonic() - began)))


@dataclass
class _Measured:
    steps_ms: list[float]
    frames: int
    peak_mb: float
    status_ms: list[float]
    failed: int
    polls: int = 0
    lost_polls: int = 0


def _measure(context: Context, daemon: Daemon, run_id: str, clients: int) -> _Measured:
    seconds = 40 if context.count < 100 else 120
    load = crowd.start(daemon.port, clients, _HZ, seconds) if clients else None
    if load:
        time.sleep(2)
    probe = _Probe(daemon.port)
    probe.start()
    daemon.start(run_id, plan(_WELLS, "bead"))
    peak, end = daemon.usage().rss_mb, time.monotonic() + 600
    while daemon.status()["run"]["outcome"] is None and time.monotonic() < end:
        peak = max(peak, daemon.usage().rss_mb)
        if context.control and clients:
            daemon.process.send_signal(signal.SIGSTOP)
            time.sleep(0.4)
            daemon.process.send_signal(signal.SIGCONT)
        time.sleep(0.3)
    status = daemon.wait_ended(run_id, 60)
    probe.ended = True
    probe.join()
    steps, frames = [], 0
    for result in status["run"]["results"]:
        ledger = read_json(daemon.data / "runs" / run_id / result["well"] / "recording.json")["ledger"]
        frames += len(ledger)
        steps += [entry["moved_ms"] + entry["settle_ms"] + entry["grab_ms"] for entry in ledger]
    measured = _Measured(steps, frames, peak, [1000 * s for s in probe.latencies], probe.failed)
    if load:
        found = crowd.result(load)
        measured.polls = found["answers"]
        measured.lost_polls = found["errors"] + sum(n for code, n in found["codes"].items() if code not in ("200", "304"))
    return measured


def run(context: Context) -> Observed:
    """Measures beads without the crowd, with it, and without it again."""
    log = context.work / "daemon.log"
    observed = Observed("", machine_load=True)
    with Daemon(context.binary, context.work / "data", free_port(), "--time-scale", "4", log=log) as daemon:
        _measure(context, daemon, "warm", 0)
        quiet = [_measure(context, daemon, "quiet1", 0)]
        loaded = _measure(context, daemon, "crowd", context.count)
        quiet.append(_measure(context, daemon, "quiet2", 0))
        daemon.end()
    observed.misses += panics(log)
    expected = 22 * _WELLS
    for name, measured in (("quiet", quiet[0]), ("crowd", loaded)):
        observed.expect(measured.frames == expected, f"{name}: {measured.frames} frames, not {expected}")
    observed.expect(not loaded.failed and not loaded.lost_polls, f"{loaded.failed + loaded.lost_polls} polls failed")
    observed.done = (
        f"{context.count} clients at {_HZ:g} Hz with ETag ({loaded.polls} polls) beside {_WELLS} beads; the same before and after "
        "without them"
    )
    before = percentile(quiet[0].steps_ms + quiet[1].steps_ms, 0.99) or 0
    after = percentile(loaded.steps_ms, 0.99) or 0
    observed.figures.append(f"{expected - loaded.frames} frames lost")
    observed.figures.append(f"step p99 {before:.0f} ms without, {after:.0f} ms with the crowd")
    observed.at_most("step p99 longer by", 100 * (after / before - 1), 5, "%")
    observed.at_most("status p99 of a client beside the crowd", percentile(loaded.status_ms, 0.99), 50, "ms")
    observed.at_most("peak memory higher by", loaded.peak_mb - max(m.peak_mb for m in quiet), 32, "MB")
    return observed


ROW = Row(
    "R13",
    "1000 pollers at 10 Hz during a run",
    "0 frames lost, step time p99 +5 % at most, status p99 under 50 ms, memory +32 MB at most",
    (20, 1000, 1000),
    "clients",
    "the daemon is stopped (SIGSTOP) for 0.4 s again and again while the crowd is there",
    r"^step p99 longer by .* the goal is",
    run,
    note="the daemon, its emulated rig and the crowd share the two cores. With the crowd at nice 19, the step was 40 % "
    "longer too. With the server's threads at nice 5, it was 33 % longer, but the status took 149 ms and an emergency "
    "stop 52 ms (p99 both), so all threads keep one priority.",
)
