"""R19: emergency stops in mid-turn beside a crowd, from the request to the byte on the motor's wire."""

from __future__ import annotations

import http.client
import signal
import subprocess
import time

from ..kit import crowd
from ..kit.daemon import Daemon, free_port, panics, plan
from ..kit.row import Context, Observed, Row, percentile
from ..kit.shim import Shim

_CLIENTS, _HZ = 1000, 10.0
_JUDGED = 10
"""So many stops have the crowd beside them, and times that are worth a percentile."""


def _stop(daemon: Daemon, shim: Shim, suspend: bool) -> tuple[float | None, float]:
    """Milliseconds from the request to the stop on the wire, if one was written, and to the answer."""
    connection = http.client.HTTPConnection("127.0.0.1", daemon.port, timeout=30)
    connection.connect()
    if suspend:
        daemon.process.send_signal(signal.SIGSTOP)
    sent = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    connection.request("POST", "/v1/emergency-stop")
    if suspend:
        time.sleep(0.3)
        daemon.process.send_signal(signal.SIGCONT)
    connection.getresponse().read()
    answered = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    connection.close()
    end = time.monotonic() + 2
    while not (stops := shim.stops(sent)) and time.monotonic() < end:
        time.sleep(0.01)
    return ((min(stops) - sent) / 1e6 if stops else None), (answered - sent) / 1e6


def _latched(daemon: Daemon, run_id: str, when: str, observed: Observed) -> None:
    """Neither a new run nor the continuation of the old one clears the stop."""
    started = daemon.http("PUT", f"/v1/runs/{run_id}x", plan(1, "bead")).status
    observed.expect(started not in (200, 201), f"{run_id}: a run started {when}")
    continued = daemon.http("POST", f"/v1/runs/{run_id}/unhold").status
    observed.expect(continued >= 400, f"{run_id}: unhold was answered by {continued} {when}")
    codes = [fault["code"] for fault in daemon.status()["faults"]]
    observed.expect("emergency_stop" in codes, f"{run_id}: the faults are {codes} {when}")


def run(context: Context) -> Observed:
    """Presses the emergency stop in `count` runs."""
    observed, log, shim = Observed("", machine_load=True), context.work / "daemon.log", Shim(context.work)
    clients = _CLIENTS if context.count >= _JUDGED else 50
    wire, answers, without, load = [], [], 0, None
    data, port = context.work / "data", free_port()

    def life() -> Daemon:
        return Daemon(context.binary, data, port, "--time-scale", "2", log=log, environment=shim.environment)

    with life() as daemon:
        for n in range(context.count):
            if load is None or load.poll() is not None:
                load = crowd.start(daemon.port, clients, _HZ, 60)
                time.sleep(2)
            run_id = f"e{n:03d}"
            daemon.start(run_id, plan(1, "bead"))
            daemon.wait_phase(("position", "revolve"))
            time.sleep(context.random.uniform(0, 1.5))
            on_wire, answered = _stop(daemon, shim, context.control)
            answers.append(answered)
            if on_wire is None:
                without += 1
            else:
                wire.append(on_wire)
            status = daemon.wait_ended(run_id, 60)
            observed.expect(status["run"]["outcome"] == "aborted", f"{run_id} ended as {status['run']['outcome']}")
            _latched(daemon, run_id, "while the stop was latched", observed)
            if n < context.count - 1:
                daemon.acknowledge()
            context.say(f"stop {n + 1}: wire {on_wire} ms, answer {answered:.1f} ms")
        if load is not None:
            load.terminate()
            try:
                load.communicate(timeout=10)
            except subprocess.TimeoutExpired:
                load.kill()
        daemon.end()
    with life() as daemon:
        daemon.wait_started()
        _latched(daemon, run_id, "after a restart, with the stop latched before it", observed)
        daemon.acknowledge()
        daemon.start("after", plan(1, "bead"))
        daemon.http("POST", "/v1/runs/after/abort")
        daemon.wait_ended("after", 60)
        daemon.end()
    observed.misses += panics(log)
    observed.expect(without == 0, f"{without} stops without a stop byte on the wire")
    observed.done = f"{context.count} emergency stops in mid-turn beside {clients} clients at {_HZ:g} Hz"
    if context.count >= _JUDGED or context.control:
        observed.at_most("request to the byte on the wire, p99", percentile(wire, 0.99), 50, "ms")
        middle = percentile(wire, 0.5)
        observed.figures.append(f"p50 {middle:.1f} ms; answer p99 {percentile(answers, 0.99):.1f} ms" if middle else "")
    else:
        observed.not_judged.append(f"the time to the wire: needs {_JUDGED} stops")
    observed.figures.append("each stop stayed latched over a new run and an unhold, the last one over a restart, until it was acknowledged")
    return observed


ROW = Row(
    "R19",
    "emergency stop under R13's load",
    "stop on the wire within 50 ms p99; latching; cleared only by an acknowledgement, not by a new run, an unhold or a restart",
    (2, 30, 1000),
    "stops",
    "the daemon is stopped (SIGSTOP) for 0.3 s at each request",
    r"^request to the byte on the wire, p99 .* the goal is",
    run,
)
