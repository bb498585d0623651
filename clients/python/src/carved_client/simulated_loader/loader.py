"""A plate-loader as in the field, without hardware: it polls, repeats requests and makes mistakes.

    poll ── unreachable ──> next poll            (a daemon that is restarted comes back)
     ├─ the run does not exist ──> hand the plate over, preflight, PUT run or PUT plate/next
     ├─ the instrument needs a specimen out ──> take it out, report it
     ├─ the instrument needs a specimen ──> take the previous one out, bring this one, report it
     └─ the run has an outcome ──> empty the capillary, wait until the plate is removable, take it away ──> Report

Every status is checked against the rules that a scheduler relies on (`watch`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from random import Random
from typing import TypeVar

import httpx

from ..client import CarvedClient
from ..decode import decode
from ..errors import ProblemError, TimedOut, Unreachable
from ..models import RunStatus, Status
from ..plan import RunPlan
from ..transport import RETRIED, Retry
from ..watch import Misled, StatusWatch
from .line import BadLine, Mischief

T = TypeVar("T")

#: The barcode of a plate that is in no plan.
OTHER_BARCODE = "OTHER"


@dataclass(frozen=True)
class Habits:
    """The behaviour of this loader."""

    poll_s: float = 1.0
    timeout_s: float = 10.0
    seed: int = 1
    mischief: Mischief = field(default_factory=Mischief)
    #: Share of the wells for which it first reports a wrong well.
    wrong_well: float = 0.0
    #: Whether it first hands over a plate with another barcode.
    wrong_barcode: bool = False


@dataclass
class Report:
    """The result of a plate, as the loader saw it."""

    run: RunStatus
    polls: int
    unreachable: int
    boots: int
    #: Wells in the order in which their specimens were brought. A well that was measured again occurs twice.
    brought: list[str]
    #: Wrong reports that were refused, as they should be.
    refused: list[str]
    mischief: dict[str, int]


class PlateLoader:
    """Brings the specimens of one plate and takes them out again."""

    def __init__(
        self,
        base_url: str,
        habits: Habits | None = None,
        *,
        token: str | None = None,
        sleep: Callable[[float], None] = time.sleep,
        on_status: Callable[[Status], None] = lambda status: None,
    ) -> None:
        self.habits = habits or Habits()
        self.line = BadLine(httpx.HTTPTransport(), self.habits.mischief, self.habits.seed)
        self.client = CarvedClient(
            base_url,
            token=token,
            timeout_s=self.habits.timeout_s,
            # The loader polls again anyway, so its requests need few repeats.
            retry=Retry(attempts=3, first_pause_s=min(0.25, self.habits.poll_s), longest_retry_after_s=5.0),
            transport=self.line,
            sleep=sleep,
        )
        self.capillary: str | None = None
        self.watch = StatusWatch(in_capillary=lambda: self.capillary)
        self.unreachable = 0
        self.brought: list[str] = []
        self.refused: list[str] = []
        self._sleep = sleep
        self._on_status = on_status
        self._misnamed: set[str] = set()

    def run_plate(self, run_id: str, plan: RunPlan, timeout_s: float) -> Report:
        """Measures a plate. Ends when its run has an outcome, the capillary is empty and the plate is removable."""
        begin = partial(self.client.put_run, run_id, plan)
        return self._until(partial(self._poll, run_id, plan, begin), f"run {run_id}", timeout_s)

    def run_queue(self, timeout_s: float) -> list[Report]:
        """Measures the plates of the instrument's queue, the next one first, until it is empty."""
        reports: list[Report] = []
        until = time.monotonic() + timeout_s
        while True:
            queue = self._until(lambda: self.client.status().queue, "the queue", until - time.monotonic())
            if not queue:
                return reports
            run_id = queue[0].run
            queued = partial(self.client.queued, run_id)
            kept = self._until(queued, f"the plan of {run_id}", until - time.monotonic())
            plan = decode(RunPlan, kept)
            begin = partial(self._report_next, run_id, plan.plate_barcode)
            poll = partial(self._poll, run_id, plan, begin)
            reports.append(self._until(poll, f"run {run_id}", until - time.monotonic()))

    def _report_next(self, run_id: str, barcode: str) -> None:
        """Reports the plate that is in its place. With `wrong_barcode` it first reports another one."""
        if self.habits.wrong_barcode:
            self._refused(lambda: self.client.next_plate(OTHER_BARCODE), f"{OTHER_BARCODE} for {barcode}")
        begun = self.client.next_plate(barcode)
        if begun.run != run_id:
            raise Misled(f"plate {barcode} is that of run {run_id}, and {begun.run} began")

    def _until(self, step: Callable[[], T | None], what: str, timeout_s: float) -> T:
        """Repeats a step until it has a result."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            try:
                done = step()
            except Unreachable:
                self.unreachable += 1
                done = None
            except ProblemError as error:
                # The instrument refuses this for now. Its next status shows what it needs.
                if error.status not in RETRIED | {409}:
                    raise
                done = None
            if done is not None:
                return done
            self._sleep(self.habits.poll_s)
        raise TimedOut(f"{what} was not done after {timeout_s} s; last seen: {self.watch.last}")

    def _poll(self, run_id: str, plan: RunPlan, begin: Callable[[], object]) -> Report | None:
        status = self.client.status()
        run = status.run_named(run_id)
        if run is not None:
            self._look(run)
        self.watch.check(status)
        self._on_status(status)
        if run is None:
            self._start(status, plan, begin)
        elif run.outcome is not None:
            # A driven sampler leaves the specimen of an aborted run inside, or it is still on its way. A person takes
            # it out. Only a person sees that none comes.
            take_out = status.plate.take_out
            may_still_come = (
                status.specimen is not None and status.specimen.well == take_out and not status.specimen.in_capillary
            )
            if self.capillary is None and may_still_come:
                return None
            self.capillary = self.capillary or take_out
            if self.capillary is not None:
                self._take_out(run_id)
            elif not status.plate.present:
                return self._report(run)
            elif status.plate.removable:
                self._take_away(plan.plate_barcode)
        elif status.plate.needs is not None and status.specimen is not None:
            if status.specimen.in_capillary:
                self.capillary = self.capillary or status.specimen.well
                self._take_out(run_id)
            elif status.specimen.phase == "load":
                self._bring(run_id, plan, status.specimen.well)
        return None

    def _look(self, run: RunStatus) -> None:
        """If the instrument found the capillary empty, nothing of what was brought is in it."""
        for result in run.results:
            if result.well == self.capillary and result.reason == "empty":
                self.capillary = None

    def _start(self, status: Status, plan: RunPlan, begin: Callable[[], object]) -> None:
        plate = status.plate
        if not status.ready:
            return
        if plate.barcode is not None and not plate.present and plate.barcode != plan.plate_barcode:
            # The plate of a run without a handover.
            self._take_away(plate.barcode)
        elif not plate.present:
            first = OTHER_BARCODE if self.habits.wrong_barcode and not self.refused else plan.plate_barcode
            if self.client.handoff("load", first).needs is None:
                self.client.handoff_completed()
        elif plate.barcode != plan.plate_barcode and plate.barcode is not None:
            self._refused(begin, f"{plan.plate_barcode} for {plate.barcode}")
            self._take_away(plate.barcode)
        else:
            looked = self.client.preflight(plan)
            failed = [check for check in looked.checks if check.blocks and not check.passed]
            if looked.passed == bool(failed):
                raise Misled(f"the preflight says passed {looked.passed}, and of its checks {failed} failed")
            if looked.passed:
                begin()

    def _take_away(self, barcode: str) -> None:
        """Takes the plate away once nothing prevents it. With `wrong_barcode` it first names another plate."""
        if self.habits.wrong_barcode:
            other = f"{barcode}-{OTHER_BARCODE}"
            self._refused(lambda: self.client.handoff("unload", other), f"{other} for {barcode}")
        if self.client.handoff("unload", barcode).needs is None:
            self.client.handoff_completed()

    def _refused(self, say: Callable[[], object], wrong: str) -> None:
        """Sends a wrong report, which must be refused as a conflict."""
        try:
            say()
        except ProblemError as error:
            if error.status != 409:
                raise
            self.refused.append(f"{wrong}: {error.code}")
        else:
            raise Misled(f"the instrument took a wrong word: {wrong}")

    def _bring(self, run_id: str, plan: RunPlan, well: str) -> None:
        if self.capillary is not None and self.capillary != well:
            self._take_out(run_id)
        if well not in {planned.well for planned in plan.plate_map}:
            raise Misled(f"the instrument asks for {well}, which is not in the plate map")
        roll = Random(f"{self.habits.seed} wrong well {well}").random()
        if roll < self.habits.wrong_well and well not in self._misnamed:
            self._misnamed.add(well)
            self._say_wrongly(run_id, plan, well)
        if self.capillary != well:
            self.capillary = well
            self.brought.append(well)
        self.client.loaded(run_id, well)

    def _say_wrongly(self, run_id: str, plan: RunPlan, well: str) -> None:
        other = next((planned.well for planned in plan.plate_map if planned.well != well), "P24")
        self._refused(lambda: self.client.loaded(run_id, other), f"{other} for {well}")

    def _take_out(self, run_id: str) -> None:
        well, self.capillary = self.capillary, None
        if well is None:
            return
        try:
            self.client.unloaded(run_id, well)
        except (Unreachable, ProblemError):
            # The specimen is out, but the report has not arrived yet.
            self.capillary = well
            raise

    def _report(self, run: RunStatus) -> Report:
        return Report(
            run=run,
            polls=self.watch.seen,
            unreachable=self.unreachable,
            boots=self.watch.boots,
            brought=list(self.brought),
            refused=list(self.refused),
            mischief=dict(self.line.done),
        )
