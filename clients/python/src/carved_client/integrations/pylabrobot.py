"""carved as a PyLabRobot machine that holds a plate.

scanner = LarvaScanner("scanner", CarvedBackend("http://127.0.0.1:8420"))
async with scanner:
    async with scanner.handover("load", "P-001"):
        await arm.move_resource(plate, scanner)
    results = await scanner.measure({"A1": 4.0, "A2": 5.0}, barcode="P-001")
"""

from __future__ import annotations

import asyncio
import contextlib
import uuid
from abc import ABCMeta, abstractmethod
from collections.abc import AsyncIterator, Mapping
from typing import Any

from pylabrobot.machines import Machine, need_setup_finished
from pylabrobot.machines.backend import MachineBackend
from pylabrobot.resources import Coordinate, Plate, Resource, ResourceHolder

from ..client import CarvedClient
from ..errors import CarvedError, ProblemError
from ..models import HandoffIntent, RunStatus, Status
from ..plan import PlannedWell, RunPlan
from . import instrument

#: What is in a well: its age in dpf, None if the age is unknown, or a whole entry of the plate map.
Specimen = float | None | PlannedWell


class MeasurementFailed(Exception):
    """The run did not end as wished. `results` has the wells that were measured before."""

    def __init__(self, message: str, results: list[dict[str, Any]]) -> None:
        super().__init__(message)
        self.results = results


class LarvaScannerBackend(MachineBackend, metaclass=ABCMeta):
    """The functions of any instrument that measures larvae well by well."""

    @abstractmethod
    async def measure(self, run_id: str, barcode: str, wells: Mapping[str, Specimen]) -> list[dict[str, Any]]:
        """Measures the wells of a plate. Returns one dictionary per well."""

    @abstractmethod
    async def prepare_handover(self, intent: HandoffIntent, barcode: str, timeout_s: float) -> None:
        """Returns when the plate may be moved."""

    @abstractmethod
    async def end_handover(self, *, moved: bool) -> None:
        """Says whether the plate was moved, after the arm has left the instrument."""

    @abstractmethod
    async def hold(self) -> None:
        """Holds the current run after its current specimen."""

    @abstractmethod
    async def unhold(self) -> None:
        """Continues the current run."""

    @abstractmethod
    async def abort(self) -> None:
        """Ends the current run now."""

    @abstractmethod
    async def emergency_stop(self) -> None:
        """Stops the motors at once. Nothing runs until a person has acknowledged it."""


class CarvedBackend(LarvaScannerBackend):
    """Speaks to a carved daemon. Its calls block, so they run in threads beside the event loop."""

    def __init__(
        self, url: str, *, token_file: str | None = None, method: str = "standard", operator: str = "pylabrobot"
    ) -> None:
        super().__init__()
        self.url, self.token_file, self.method, self.operator = url, token_file, method, operator
        self._client: CarvedClient | None = None
        self._run: str | None = None

    @property
    def client(self) -> CarvedClient:
        """The client, between `setup` and `stop`."""
        if self._client is None:
            raise RuntimeError("the setup has not finished: call setup() first")
        return self._client

    async def setup(self, timeout_s: float = 60.0) -> None:
        """Connects, and waits until the instrument is ready for a run."""
        client = instrument.connect(self.url, self.token_file)
        try:
            await asyncio.to_thread(client.wait_for, lambda status: status.ready, "readiness", timeout_s)
        except BaseException:
            client.close()
            raise
        self._client = client

    async def stop(self) -> None:
        """Aborts the current run and closes the connection. `setup` may be called again."""
        try:
            if self._run is not None:
                await self.abort()
        except ProblemError as error:
            # A run that has ended, or never began, need not be ended.
            if error.code not in {"run_ended", "unknown_run"}:
                raise
        finally:
            self.client.close()
            self._client = self._run = None

    async def measure(self, run_id: str, barcode: str, wells: Mapping[str, Specimen]) -> list[dict[str, Any]]:
        planned = tuple(_planned(well, specimen) for well, specimen in wells.items())
        plan = RunPlan(plate_barcode=barcode, method=self.method, operator=self.operator, plate_map=planned)
        self._run = run_id
        await asyncio.to_thread(self.client.put_run, run_id, plan)
        status, run = await asyncio.to_thread(self._outcome, run_id)
        self._run = None
        names = dict(zip((p.well for p in planned), wells, strict=True))
        results = [{**row, "well": names[row["well"]]} for row in instrument.rows(run)]
        if run.outcome not in instrument.USABLE:
            raise MeasurementFailed(instrument.why_ended(status, run), results)
        return results

    def _outcome(self, run_id: str) -> tuple[Status, RunStatus]:
        status = self.client.wait_for_outcome(run_id)
        run = status.run_named(run_id)
        assert run is not None  # that is what was waited for
        return status, run

    async def prepare_handover(self, intent: HandoffIntent, barcode: str, timeout_s: float) -> None:
        await asyncio.to_thread(instrument.await_handover, self.client, intent, barcode, timeout_s)

    async def end_handover(self, *, moved: bool) -> None:
        await asyncio.to_thread(self.client.handoff_completed if moved else self.client.handoff_aborted)

    async def hold(self) -> None:
        await asyncio.to_thread(self.client.hold, self._current())

    async def unhold(self) -> None:
        await asyncio.to_thread(self.client.unhold, self._current())

    async def abort(self) -> None:
        await asyncio.to_thread(self.client.abort, self._current())

    async def emergency_stop(self) -> None:
        await asyncio.to_thread(self.client.emergency_stop)

    def _current(self) -> str:
        if self._run is None:
            raise RuntimeError("no run is under way")
        return self._run

    def serialize(self) -> dict[str, Any]:
        """The settings for a deck file, with the path of the token and not the token."""
        settings = {"url": self.url, "token_file": self.token_file, "method": self.method, "operator": self.operator}
        return {**super().serialize(), **settings}


class LarvaScanner(ResourceHolder, Machine):
    """The front end, which is the same for every backend. A plate can be assigned to it as to any resource holder."""

    def __init__(
        self,
        name: str,
        backend: LarvaScannerBackend,
        size_x: float = 0.0,
        size_y: float = 0.0,
        size_z: float = 0.0,
        child_location: Coordinate | None = None,
        category: str = "larva_scanner",
        **resource: Any,
    ) -> None:
        ResourceHolder.__init__(
            self,
            name=name,
            size_x=size_x,
            size_y=size_y,
            size_z=size_z,
            child_location=child_location or Coordinate.zero(),
            category=category,
            **resource,
        )
        Machine.__init__(self, backend=backend)
        self.backend: LarvaScannerBackend = backend
        self._announced: HandoffIntent | None = None

    @need_setup_finished
    async def measure(
        self, wells: Mapping[str, Specimen], *, barcode: str | None = None, run_id: str | None = None
    ) -> list[dict[str, Any]]:
        """Measures the wells of the plate, in this order. Returns one dictionary per well.

        Args:
          wells: what is in each well: the age in dpf, None, or a `PlannedWell`.
          barcode: that of the plate; by default that of the plate which is assigned to the scanner.
          run_id: your name for the run; by default a new one. A name that was used before returns its results, if the
            plan is the same.

        Raises:
          MeasurementFailed: if the run failed or was aborted.
          ProblemError: if the instrument refuses the plan.
        """
        return await self.backend.measure(run_id or f"pylabrobot-{uuid.uuid4().hex}", barcode or self._barcode(), wells)

    @contextlib.asynccontextmanager
    async def handover(
        self, intent: HandoffIntent, barcode: str | None = None, timeout_s: float = 60.0
    ) -> AsyncIterator[None]:
        """In the block the plate may be put in or taken away. An error in the block calls the handover off.

        Raises:
          TimedOut: if the instrument still needs something after `timeout_s`.
        """
        if not self.setup_finished:
            raise RuntimeError("the setup has not finished: call setup() first")
        await self.backend.prepare_handover(intent, barcode or self._barcode(), timeout_s)
        self._announced = intent
        try:
            yield
        except BaseException:
            self._announced = None
            await self.backend.end_handover(moved=False)
            raise
        self._announced = None
        await self.backend.end_handover(moved=True)

    def check_can_drop_resource_here(self, resource: Resource, *, reassign: bool = True) -> None:
        """Refuses a plate that no handover has announced."""
        super().check_can_drop_resource_here(resource, reassign=reassign)
        if self._announced != "load":
            raise RuntimeError(f"{self.name} does not expect a plate: move it inside `async with handover('load')`")

    @need_setup_finished
    async def hold(self) -> None:
        """Holds the current run after its current specimen. `measure` goes on waiting."""
        await self.backend.hold()

    @need_setup_finished
    async def unhold(self) -> None:
        """Continues a held run."""
        await self.backend.unhold()

    @need_setup_finished
    async def abort(self) -> None:
        """Ends the current run now. The motors stop first, and `measure` raises `MeasurementFailed`."""
        await self.backend.abort()

    @need_setup_finished
    async def emergency_stop(self) -> None:
        """Stops the motors at once. Nothing runs until a person has acknowledged it at the instrument."""
        await self.backend.emergency_stop()

    def serialize(self) -> dict[str, Any]:
        """The resource and its backend, as of every machine that is a resource."""
        return {**ResourceHolder.serialize(self), **Machine.serialize(self)}

    def _barcode(self) -> str:
        plate = self.resource
        if not isinstance(plate, Plate) or plate.barcode is None:
            raise CarvedError(f"{self.name} holds no plate with a barcode: name the barcode")
        return str(plate.barcode.data)


def _planned(well: str, specimen: Specimen) -> PlannedWell:
    if isinstance(specimen, PlannedWell):
        return specimen
    # PyLabRobot writes A1, carved A01.
    row = well.rstrip("0123456789")
    return PlannedWell(f"{row}{well[len(row) :]:0>2}", dpf=specimen)
