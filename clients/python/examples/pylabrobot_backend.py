"""carved as a PyLabRobot machine: a front end for protocols, and a backend for the instrument.

    async with LarvaScanner("scanner", CarvedBackend("http://127.0.0.1:8420")) as scanner:
        results = await scanner.measure("P-001", {"A1": 4.0, "A2": 5.0})

PyLabRobot's own `MachineBackend` is the base class if it is installed. Nothing else of PyLabRobot is needed.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any

from carved_client import CarvedClient, PlannedWell, RunPlan

if TYPE_CHECKING:
    from abc import ABC as MachineBackend
else:
    try:
        from pylabrobot.machines.backend import MachineBackend
    except ImportError:
        MachineBackend = ABC


class LarvaScannerBackend(MachineBackend):
    """The functions of any instrument that measures larvae well by well."""

    @abstractmethod
    async def setup(self) -> None:
        """Connects, and waits until the instrument is ready for a run."""

    @abstractmethod
    async def stop(self) -> None:
        """Ends the current work and closes the connection; `setup` may be called again."""

    @abstractmethod
    async def measure(self, run_id: str, barcode: str, wells: Mapping[str, float | None]) -> list[dict[str, Any]]:
        """Measures wells, whose age in dpf may be given. Returns one dictionary per well."""


class CarvedBackend(LarvaScannerBackend):
    """Speaks to a carved daemon. Its calls block, so they run in threads beside the event loop."""

    def __init__(
        self, url: str, *, token: str | None = None, method: str = "standard", operator: str = "pylabrobot"
    ) -> None:
        super().__init__()
        self.url, self.method, self.operator = url, method, operator
        self._token = token
        self._client: CarvedClient | None = None
        self._run: str | None = None

    @property
    def client(self) -> CarvedClient:
        if self._client is None:
            raise RuntimeError("the setup has not finished: call setup() first")
        return self._client

    async def setup(self) -> None:
        self._client = CarvedClient(self.url, token=self._token)
        await asyncio.to_thread(self.client.wait_for, lambda status: status.ready, "readiness", 60.0)

    async def stop(self) -> None:
        if self._run is not None:
            await asyncio.to_thread(self.client.abort, self._run)
        self.client.close()
        self._client = self._run = None

    async def measure(self, run_id: str, barcode: str, wells: Mapping[str, float | None]) -> list[dict[str, Any]]:
        planned = tuple(PlannedWell(_two_digits(well), dpf=dpf) for well, dpf in wells.items())
        plan = RunPlan(plate_barcode=barcode, method=self.method, operator=self.operator, plate_map=planned)
        self._run = run_id
        await asyncio.to_thread(self.client.put_run, run_id, plan)
        status = await asyncio.to_thread(self.client.wait_for_outcome, run_id)
        self._run = None
        run = status.run_named(run_id)
        assert run is not None  # that is what was waited for
        if run.outcome not in {"succeeded", "partial"}:
            raise RuntimeError(f"run {run_id} ended as {run.outcome}: {'; '.join(f.message for f in status.faults)}")
        names = dict(zip((p.well for p in planned), wells, strict=True))
        return [
            {
                "well": names[result.well],
                "outcome": result.outcome,
                "reason": result.reason,
                "flags": list(result.flags),
                "volume_um3": result.volume_um3,
                "volume_sd_um3": result.volume_sd_um3,
                "area_um2": result.area_um2,
            }
            for result in run.results
        ]

    def serialize(self) -> dict[str, Any]:
        """The settings for a deck file. The token is not included."""
        return {"type": type(self).__name__, "url": self.url, "method": self.method, "operator": self.operator}


class LarvaScanner:
    """The front end, which is the same for every backend."""

    def __init__(self, name: str, backend: LarvaScannerBackend) -> None:
        self.name, self.backend = name, backend
        self.setup_finished = False
        self._runs = 0

    async def setup(self) -> None:
        await self.backend.setup()
        self.setup_finished = True

    async def stop(self) -> None:
        await self.backend.stop()
        self.setup_finished = False

    async def __aenter__(self) -> LarvaScanner:
        await self.setup()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.stop()

    async def measure(self, barcode: str, wells: Mapping[str, float | None]) -> list[dict[str, Any]]:
        if not self.setup_finished:
            raise RuntimeError("the setup has not finished: call setup() first")
        self._runs += 1
        return await self.backend.measure(f"{self.name}-{barcode}-{self._runs}", barcode, wells)


def _two_digits(well: str) -> str:
    """Converts PyLabRobot's `A1` to carved's `A01`."""
    return f"{well[0]}{int(well[1:]):02d}"
