"""Checks every status against the rules that a scheduler relies on, and against the previous status.

A misled scheduler hands a plate over too early or never. Each rule prevents such an accident.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from .models import RunStatus, Status

#: States in which a run is neither under way nor held: between two wells they would look like «finished».
AT_REST = frozenset({"Idle", "Complete", "Stopped", "Aborted"})


class Misled(AssertionError):
    """The instrument broke a rule that a scheduler relies on."""


@dataclass
class StatusWatch:
    """Call it with every status in order. It raises `Misled` at the first broken rule."""

    #: The well whose specimen the loader knows to be in the capillary; called for each status.
    in_capillary: Callable[[], str | None] = lambda: None
    seen: int = 0
    boots: int = 0
    last: Status | None = None

    def check(self, status: Status) -> None:
        """Raises `Misled` if a rule is broken."""
        last = self.last
        self.seen += 1
        self.boots += last is None or last.boot_id != status.boot_id
        for rule in (self._alone, self._capillary):
            self._require(status, rule(status))
        if last is not None:
            self._require(status, _sequence(last, status))
            if last.run is not None and status.run is not None and last.run.id == status.run.id:
                self._require(status, _same_run(last.run, status.run))
            elif last.run is not None and last.run.outcome is None:
                self._require(status, _lost_run(last, last.run, status))
        self.last = status

    @staticmethod
    def _require(status: Status, broken: str | None) -> None:
        if broken is not None:
            raise Misled(f"{broken}; revision {status.revision} of boot {status.boot_id}: {status}")

    def _alone(self, status: Status) -> str | None:
        run, plate = status.run, status.plate
        active = run is not None and run.outcome is None
        if not status.schema.startswith("carved.status/"):
            return f"its schema is {status.schema!r}"
        if active and status.state in AT_REST and status.ready:
            return f"state {status.state}, ready, while run {run.id if run else ''} has no outcome"
        if active and status.state in {"Idle", "Complete"}:
            return f"state {status.state} while a run is under way"
        if status.ready and (status.state not in AT_REST or status.not_ready_reason is not None):
            return f"ready in state {status.state}, reason {status.not_ready_reason!r}"
        if not status.ready and status.not_ready_reason is None:
            return "not ready, and no reason"
        if plate.removable and (active or (status.specimen is not None and status.specimen.in_capillary)):
            return "the plate is called removable with a run under way or a specimen in the capillary"
        if len({fault.seq for fault in status.faults}) != len(status.faults):
            return "two faults have one number"
        return None if run is None else _counts(run)

    def _capillary(self, status: Status) -> str | None:
        held = self.in_capillary()
        if status.plate.removable and held is not None:
            return f"the plate is called removable while the specimen of {held} is in the capillary"
        return None


def _counts(run: RunStatus) -> str | None:
    """The counts are disjoint, add up to the total, and agree with the results."""
    n = run.wells
    found = {"succeeded": 0, "flagged": 0, "failed": 0, "skipped": 0, "interrupted": 0, "pending": 0}
    for well in run.results:
        word: str = well.outcome or "pending"
        if word == "succeeded" and well.flags:
            word = "flagged"
        found["interrupted" if word == "aborted" else word] += 1
    told = {name: getattr(n, name) for name in found}
    if told != found or sum(told.values()) != n.total or len(run.results) != n.total:
        return f"counts {told} of {n.total}, results {found} of {len(run.results)}"
    if (run.outcome is None) != (run.ended is None):
        return f"outcome {run.outcome}, ended {run.ended}"
    if run.outcome is not None and n.pending:
        return f"outcome {run.outcome} with {n.pending} wells pending"
    return None


def _sequence(last: Status, now: Status) -> str | None:
    if last.boot_id != now.boot_id:
        return None
    if now.revision < last.revision:
        return f"revision {last.revision} went back to {now.revision}"
    if now.uptime_s < last.uptime_s:
        return f"uptime {last.uptime_s} s went back to {now.uptime_s} s in one boot"
    if now.revision == last.revision and _timeless(now) != _timeless(last):
        return f"two different statuses have revision {now.revision}: {last}"
    return None


def _timeless(status: Status) -> Status:
    """The status without the fields that change without a new revision."""
    return replace(status, server_time="", uptime_s=0.0, hardware={})


def _same_run(last: RunStatus, now: RunStatus) -> str | None:
    """A finished result never changes, also over restarts. Only an interrupted one may be repeated."""
    if last.outcome is not None and now.outcome != last.outcome:
        return f"the outcome {last.outcome} became {now.outcome}"
    if [w.well for w in last.results] != [w.well for w in now.results]:
        return f"the run's wells became others: {[w.well for w in now.results]}"
    for before, after in zip(last.results, now.results, strict=True):
        if before.outcome in {"succeeded", "skipped", "failed"} and before != after:
            return f"well {before.well} had ended as {before} and became {after}"
    return None


def _lost_run(last: Status, run: RunStatus, now: Status) -> str | None:
    """A run without an outcome may be missing only while a restarted daemon is not ready yet."""
    if now.run is None and not now.ready and now.boot_id != last.boot_id:
        return None
    return f"run {run.id} had no outcome and the status shows {now.run.id if now.run else 'no run'} instead"
