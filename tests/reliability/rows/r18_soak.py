"""R18: larvae without end. Memory, descriptors, threads and time per well; every result against `carved measure`."""

from __future__ import annotations

import json
import subprocess
import time
from dataclasses import dataclass

from ..kit.daemon import WELLS, Daemon, free_port, panics, plan
from ..kit.disk import files_that_differ, journal
from ..kit.plot import Series, write_svg
from ..kit.row import Context, Observed, Row, percentile

_PLATE = 48
_SETTLED = 50
"""Memory is called flat from this larva on."""


@dataclass
class _Sample:
    larvae: int
    rss_mb: float
    descriptors: int
    threads: int
    seconds_per_well: float


def _soak(context: Context, daemon: Daemon) -> list[_Sample]:
    samples: list[_Sample] = []
    done, plate, last = 0, 0, time.monotonic()
    while done < context.count:
        plate += 1
        wells = min(_PLATE, context.count - done)
        daemon.start(f"k{plate:03d}", plan(wells))
        seen = 0
        while True:
            status = daemon.status()
            finished = sum(1 for result in status["run"]["results"] if result["outcome"])
            if finished > seen:
                usage, now = daemon.usage(), time.monotonic()
                if context.control:
                    # A leak of 20 MB per larva, as the judge would see it.
                    usage = type(usage)(usage.rss_mb + 20 * (done + finished), usage.threads, usage.descriptors)
                samples.append(_Sample(done + finished, usage.rss_mb, usage.descriptors, usage.threads, (now - last) / (finished - seen)))
                seen, last = finished, now
                if (done + finished) % 20 == 0:
                    context.say(f"{samples[-1]}")
            if status["run"]["outcome"] is not None:
                break
            time.sleep(0.1)
        done += wells
    return samples


def _median(samples: list[_Sample], key: str) -> float:
    return percentile([float(getattr(sample, key)) for sample in samples], 0.5) or 0.0


def _judge(samples: list[_Sample], observed: Observed, control: bool) -> None:
    """Memory and descriptors of the last fifth are those of the fifth after the larva from which they are flat."""
    enough = samples[-1].larvae >= 2 * _SETTLED
    settled = [s for s in samples if s.larvae > (_SETTLED if enough else samples[-1].larvae // 2)]
    fifth = max(1, len(settled) // 5)
    early, late = settled[:fifth], settled[-fifth:]
    growth = _median(late, "rss_mb") - _median(early, "rss_mb")
    larvae = max(1, late[len(late) // 2].larvae - early[len(early) // 2].larvae)
    observed.figures.append(
        f"memory {_median(early, 'rss_mb'):.0f} MB at larva {early[0].larvae}, {_median(late, 'rss_mb'):.0f} MB at larva {late[-1].larvae}"
    )
    if enough or control:
        observed.at_most("memory grew by", max(0.0, growth), max(16.0, 0.02 * larvae), "MB")
    else:
        observed.not_judged.append(f"flat memory: needs {2 * _SETTLED} larvae")
    observed.at_most("more descriptors by", max(0.0, _median(late, "descriptors") - _median(early, "descriptors")), 2, "descriptors")
    observed.at_most("more threads by", max(0.0, _median(late, "threads") - _median(early, "threads")), 2, "threads")
    observed.figures.append(
        f"time per well, median {_median(early, 'seconds_per_well'):.1f} s at first, {_median(late, 'seconds_per_well'):.1f} s at last"
    )


def _measure_again(context: Context, observed: Observed) -> int:
    identical = 0
    for run in sorted((context.work / "data/runs").iterdir()):
        done = subprocess.run([context.binary, "measure", run], capture_output=True, text=True)
        for line in done.stdout.splitlines():
            answer = json.loads(line)
            identical += answer.get("stored") == "identical"
            observed.expect(
                answer.get("stored") == "identical", f"{run.name}/{answer.get('well')}: {answer.get('stored')} {answer.get('error', '')}"
            )
    return identical


def run(context: Context) -> Observed:
    """Measures `count` larvae in plates of 48."""
    observed, log = Observed("", machine_load=True), context.work / "daemon.log"
    with Daemon(context.binary, context.work / "data", free_port(), "--time-scale", "10", log=log) as daemon:
        samples = _soak(context, daemon)
        daemon.end()
    _judge(samples, observed, context.control)
    expected = sum(1 for e in journal(context.work / "data/events.jsonl") if e["kind"] == "specimen.done")
    identical = _measure_again(context, observed)
    observed.expect(identical == expected == context.count, f"{identical} results identical of {expected} wells, {context.count} planned")
    for sums in (context.work / "data").glob("runs/*/*/SHA256SUMS"):
        differ = files_that_differ(sums.parent)
        observed.expect(not differ, f"{sums.parent}: {differ} differ from SHA256SUMS")
    observed.misses += panics(log)
    observed.done = (
        f"{context.count} simulated larvae in plates of {min(_PLATE, context.count)}; memory, descriptors and threads after each; all "
        "measured again from their recordings"
    )
    observed.figures.append(f"{identical} of {expected} results identical to the offline measurement")
    larvae = [float(s.larvae) for s in samples]
    write_svg(
        context.work / "soak.svg",
        "larvae measured",
        larvae,
        [
            Series("memory, MB", [s.rss_mb for s in samples]),
            Series("descriptors", [float(s.descriptors) for s in samples]),
            Series("threads", [float(s.threads) for s in samples]),
            Series("time per well, s", [s.seconds_per_well for s in samples]),
        ],
    )
    return observed


ROW = Row(
    "R18",
    "soak: 1000 simulated larvae",
    f"memory flat after the first {_SETTLED} (+16 MB, or 20 kB per larva, at most), descriptors and threads flat (+2), every "
    "result identical to the offline measurement of its recording",
    (4, 100, 1000),
    "larvae",
    "20 MB per larva are added to the memory that is read",
    r"^memory grew by .* the goal is",
    run,
)

assert len(WELLS) >= _PLATE
