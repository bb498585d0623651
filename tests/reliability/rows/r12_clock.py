"""R12: the wall clock jumps by an hour or a day, forwards and back, by the preloaded shim."""

from __future__ import annotations

import time

from ..kit.daemon import Daemon, free_port, panics, plan
from ..kit.disk import journal, read_json
from ..kit.row import Context, Observed, Row
from ..kit.shim import Shim

_HOUR_S, _DAY_S = 3600, 86_400


def run(context: Context) -> Observed:
    """Lets the wall clock jump `count` times while wells are measured."""
    data, log = context.work / "data", context.work / "daemon.log"
    observed, shim = Observed(""), Shim(context.work)
    offset, jumps, runs = 0.0, 0, 0
    jump = shim.monotonic_clock if context.control else shim.wall_clock
    with Daemon(context.binary, data, free_port(), "--time-scale", "10", log=log, environment=shim.environment) as daemon:
        began, uptime = time.monotonic(), daemon.status()["uptime_s"]
        while jumps < context.count:
            runs += 1
            daemon.start(f"c{runs}", plan(3, "bead"))
            while daemon.status()["run"]["outcome"] is None:
                if jumps < context.count:
                    # Only a monotonic clock that goes back is beyond every operating system, so the control jumps forwards.
                    step = context.random.choice([_HOUR_S, -_HOUR_S, _DAY_S, -_DAY_S])
                    offset += abs(step) if context.control else step
                    jump(offset)
                    jumps += 1
                time.sleep(context.random.uniform(0.3, 1.5))
                status = daemon.status()
                faults = [fault["code"] for fault in status["faults"]]
                observed.expect(not faults, f"after jump {jumps}: {faults}")
                if faults:
                    daemon.http("POST", f"/v1/runs/c{runs}/abort")
                    daemon.wait_ended(f"c{runs}", 60)
                    jumps = context.count
            status = daemon.status()
            outcomes = [result["outcome"] for result in status["run"]["results"]]
            observed.expect(all(outcome == "succeeded" for outcome in outcomes), f"run {runs}: the wells ended as {outcomes}")
        _check_lease_and_poll(daemon, jump, offset + _DAY_S, observed)
        elapsed, status = time.monotonic() - began, daemon.status()
        error = abs(status["uptime_s"] - uptime - elapsed)
        observed.expect(error < 2, f"uptime_s is wrong by {error:.1f} s")
        daemon.end()
    numbers = [event["id"] for event in journal(data / "events.jsonl")]
    observed.expect(numbers == list(range(1, len(numbers) + 1)), "the numbers of the events have gaps or repeat")
    longest = _longest_duration_s(context, elapsed, observed)
    observed.misses += panics(log)
    observed.done = f"{jumps} jumps of the wall clock by an hour or a day, forwards and back, in {runs} runs of 3 beads"
    observed.figures += [
        "no fault, all wells succeeded" if not observed.misses else "see the misses",
        f"longest recorded duration {longest:.1f} s in a test of {elapsed:.0f} s",
    ]
    return observed


def _check_lease_and_poll(daemon: Daemon, jump: object, offset: float, observed: Observed) -> None:
    """A lease and a long poll do not end because the wall clock jumps."""
    taken = daemon.http("PUT", "/v1/lease", {"holder": "clock", "ttl_s": 60})
    observed.expect(taken.status in (200, 201), f"a lease was refused: {taken.status}")
    assert callable(jump)
    jump(offset)
    lease = daemon.http("GET", "/v1/lease")
    observed.expect(b"clock" in lease.body, f"the jump ended a lease of 60 s: {lease.body[:200]!r}")
    began = time.monotonic()
    revision = daemon.status()["revision"]
    answer = daemon.http("GET", f"/v1/status?wait=2&after={revision}")
    took = time.monotonic() - began
    # A state that changed meanwhile answers a long poll earlier.
    changed = answer.json()["revision"] != revision
    observed.expect(took < 8 and (changed or took > 1.5), f"a long poll of 2 s took {took:.2f} s")


def _longest_duration_s(context: Context, elapsed: float, observed: Observed) -> float:
    """No recorded duration is negative or longer than the test."""
    durations = []
    for path in (context.work / "data").glob("runs/*/*/recording.json"):
        for entry in read_json(path)["ledger"]:
            durations += [entry[key] / 1000 for key in ("moved_ms", "settle_ms", "grab_ms")]
    for path in (context.work / "data").glob("runs/*/*/timings.json"):
        durations += list(read_json(path)["phases_s"].values())
    observed.expect(bool(durations), "no duration was recorded")
    wrong = [d for d in durations if not 0 <= d <= elapsed]
    observed.expect(not wrong, f"durations that cannot be: {wrong[:5]}")
    return max(durations, default=0)


ROW = Row(
    "R12",
    "the wall clock jumps by an hour or a day",
    "no timeout fires; elapsed times come from the monotonic clock",
    (3, 12, 100),
    "jumps",
    "the monotonic clock jumps too",
    r"^after jump \d+: \[",
    run,
)
