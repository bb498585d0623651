"""R10: SIGTERM, SIGINT and SIGHUP at random moments, and second signals."""

from __future__ import annotations

import signal
import subprocess
import time

from ..kit.daemon import Daemon, free_port, panics, plan
from ..kit.disk import files_that_differ, journal, read_json
from ..kit.row import Context, Observed, Row, percentile
from ..kit.shim import Shim
from ..kit.sse import Listener

_JUDGED = 5
"""So many pairs of signals have a slowest one that does not depend on one stall of a busy machine."""

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def _check_record(context: Context, run_id: str, observed: Observed, name: str, orderly: bool) -> str | None:
    """Checks what the signal left on disk. Returns the run's outcome."""
    folder = context.work / "data/runs" / run_id
    record = read_json(folder / "run.json")
    if orderly:
        observed.expect(record["outcome"] is not None, f"{name}: the run has no outcome")
        for well in record["wells"]:
            observed.expect(well["outcome"] is not None, f"{name}: {well['well']} has no outcome")
    for sums in folder.glob("*/SHA256SUMS"):
        differ = files_that_differ(sums.parent)
        observed.expect(not differ, f"{name}: {differ} differ from SHA256SUMS")
    outcome: str | None = record["outcome"]
    return outcome


def run(context: Context) -> Observed:
    """Ends `count` daemons by a signal; every third gets a second one."""
    data, log, port = context.work / "data", context.work / "daemon.log", free_port()
    observed, moments, shim = Observed("", machine_load=True), set[str](), Shim(context.work)
    first: list[float] = []
    second: list[float] = []
    stopped: list[float] = []
    for n in range(context.count):
        with Daemon(context.binary, data, port, "--time-scale", "10", log=log, environment=shim.environment) as daemon:
            listener = Listener(port)
            run_id, sent = f"s{n:04d}", SIGNALS[n % 3]
            status = daemon.wait_started()
            if (open_run := status["run"]) and open_run["outcome"] is None:
                daemon.http("POST", f"/v1/runs/{open_run['id']}/abort")
                daemon.wait_ended(open_run["id"], 60)
            daemon.start(run_id, plan(2, "bead"))
            time.sleep(context.random.uniform(0, 9))
            status = daemon.status()
            moments.add((status["specimen"] or {}).get("phase") or status["state"])
            name = f"{sent.name} {n + 1} in {(status['specimen'] or {}).get('phase')}"
            twice = n % 3 == 2 and not context.control
            began, sent_ns = time.monotonic(), time.clock_gettime_ns(time.CLOCK_MONOTONIC)
            if context.control:
                daemon.process.send_signal(signal.SIGSTOP)
            daemon.process.send_signal(sent)
            try:
                if twice:
                    time.sleep(context.random.uniform(0, 0.1))
                    began = time.monotonic()
                    daemon.process.send_signal(SIGNALS[(n // 3) % 3])
                code: int | None = daemon.process.wait(12)
            except subprocess.TimeoutExpired:
                code = None
            took = time.monotonic() - began
            (second if twice else first).append(took)
            observed.expect(code is not None, f"{name}: still there after 12 s")
            if not twice:
                observed.expect(code in (0, None), f"{name}: exit code {code}")
        time.sleep(0.1)
        listener.end()
        written = {event["id"]: event for event in journal(data / "events.jsonl")}
        lost = [e["id"] for e in listener.events() if written.get(e["id"]) != e]
        observed.expect(not lost, f"{name}: acknowledged events are lost: {lost}")
        if not context.control:
            outcome = _check_record(context, run_id, observed, name, orderly=not twice)
            # A run that was over before the signal has no move to stop. A second signal may come before the stop.
            if outcome == "interrupted" and not twice:
                stops = shim.stops(sent_ns)
                observed.expect(bool(stops), f"{name}: the run was ended without a stop on the motor's wire")
                stopped += [(min(stops) - sent_ns) / 1e9] if stops else []
        context.say(f"{name}: {took:.2f} s, code {code}")
    observed.misses += panics(log)
    observed.done = (
        f"{len(first)} signals (SIGTERM, SIGINT, SIGHUP in turn) and {len(second)} pairs of signals in {', '.join(sorted(moments))}"
    )
    observed.at_most("controlled end, slowest", percentile(first, 1), 5, "s")
    if stopped:
        observed.figures.append(
            f"{len(stopped)} interrupted runs with a stop on the motor's wire, slowest {max(stopped):.2g} s after the signal"
        )
    elif not context.control and not observed.misses:
        observed.not_judged.append("a stop on the motor's wire: no single signal met a run")
    if len(second) >= _JUDGED:
        observed.at_most("after a second signal, slowest", percentile(second, 1), 1, "s")
    elif second:
        observed.not_judged.append(f"the time after a second signal: needs {_JUDGED} pairs of signals")
    return observed


ROW = Row(
    "R10",
    "SIGTERM, SIGINT, SIGHUP at random moments",
    "controlled stop (on the motor's wire), exit within 5 s, after a second signal within 1 s, nothing lost",
    (3, 18, 1000),
    "signals",
    "the process is stopped (SIGSTOP) before the signal",
    r"still there after 12 s$",
    run,
)
