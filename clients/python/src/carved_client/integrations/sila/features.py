"""The implementations of the SiLA features. Their parameters have the identifiers of the feature definitions.

definition (XML) ──Feature.from_definition──> commands and properties <── functions of a class of this module
"""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import AsyncIterator, Callable
from importlib import resources
from typing import Any, TypeVar, cast

from sila.server import (
    CommandExecution,
    Feature,
    ObservableCommand,
    ObservableProperty,
    SiLAError,
    UnobservableCommand,
    UnobservableProperty,
)

from ...client import CarvedClient
from ...decode import decode
from ...errors import CarvedError, ProblemError, TimedOut
from ...models import Fault, RunStatus, Status, WellStatus
from .. import instrument
from .feed import Shown, StatusFeed

T = TypeVar("T")
Answer = dict[str, Any]


class Implementation:
    """A feature whose handlers are the methods that are named in its definition, in lower case with underscores."""

    #: The identifier of the feature, which is also the beginning of its file's name.
    identifier: str

    def __init__(self, client: CarvedClient, feed: StatusFeed) -> None:
        self.client, self.feed = client, feed
        definition = resources.files(__package__).joinpath(f"{self.identifier}-v1_0.sila.xml")
        factories = {
            "observable_command_factory": ObservableCommand,
            "unobservable_command_factory": UnobservableCommand,
            "observable_property_factory": ObservableProperty,
            "unobservable_property_factory": UnobservableProperty,
        }
        self.feature: Feature = Feature.from_definition(definition.read_text(encoding="utf-8"), factories)
        for handler in [*self.feature.commands.values(), *self.feature.properties.values()]:
            # The factories above made the handlers of the server, which have a function.
            cast(ObservableCommand, handler).function = getattr(self, _snake(handler.identifier))

    def error(self, identifier: str, message: str) -> SiLAError:
        """A defined execution error of this feature."""
        return self.feature.errors[identifier](message)

    async def ask(self, call: Callable[..., T], *arguments: Any, refused: str, **keywords: Any) -> T:
        """Calls the daemon in a thread. A refusal becomes the error `refused`, a missing answer its own."""
        try:
            return await asyncio.to_thread(call, *arguments, **keywords)
        except ProblemError as error:
            raise self.error(refused, instrument.refusal(error)) from error
        except CarvedError as error:
            raise self.error("InstrumentUnreachable", str(error)) from error


class PlateMeasurement(Implementation):
    """Runs plates and returns their results."""

    identifier = "PlateMeasurement"

    async def measure_plate(
        self,
        *,
        RunName: str,
        PlateBarcode: str,
        PlateMap: str,
        Method: str,
        Operator: str,
        command_execution: CommandExecution[Any],
        **_: Any,
    ) -> Answer:
        """Starts the run and reports it until it has ended."""
        wells = await self.ask(self.client.check_plate_map, PlateMap, refused="InvalidPlan")
        plan = wells.plan(PlateBarcode, Method, Operator)
        try:
            await asyncio.to_thread(self.client.put_run, RunName, plan)
        except CarvedError as error:
            raise self._refused(error) from error
        reported: Answer = {}
        async for shown in self.feed.changes():
            if not shown.connected or shown.status is None:
                continue
            status = await self.ask(self.client.with_run, shown.status, RunName, refused="RunRefused")
            run = status.run_named(RunName)
            if run is not None and run.outcome is not None:
                return self._ended(status, run)
            if run is not None and (report := _report(status, run)) != reported:
                reported = report
                left = None if run.eta_s is None else datetime.timedelta(seconds=run.eta_s.p50)
                progress = report["WellsDone"] / report["WellsTotal"]
                command_execution.update_execution_info(progress=progress, remaining_time=left)
                command_execution.send_intermediate_responses(report)
        raise AssertionError("the feed has no end")

    def _refused(self, error: CarvedError) -> SiLAError:
        if not isinstance(error, ProblemError):
            return self.error("InstrumentUnreachable", str(error))
        invalid = error.status == 422
        return self.error("InvalidPlan" if invalid else "RunRefused", instrument.refusal(error))

    def _ended(self, status: Status, run: RunStatus) -> Answer:
        if run.outcome in instrument.USABLE:
            return _results(run)
        aborted = run.outcome == "aborted"
        raise self.error("RunAborted" if aborted else "RunFailed", instrument.why_ended(status, run))

    async def get_results(self, *, RunName: str, **_: Any) -> Answer:
        """Reads a stored run."""
        stored = await self.ask(self.client.run, RunName, refused="UnknownRun")
        return _results(decode(RunStatus, stored))


class RunControl(Implementation):
    """Commands for the run that is under way."""

    identifier = "RunControl"

    async def hold_run(self, **_: Any) -> Answer:
        """Holds the run."""
        return await self._control(self.client.hold)

    async def resume_run(self, **_: Any) -> Answer:
        """Continues the run."""
        return await self._control(self.client.unhold)

    async def stop_run(self, **_: Any) -> Answer:
        """Ends the run after its current specimen."""
        return await self._control(self.client.stop)

    async def abort_run(self, **_: Any) -> Answer:
        """Ends the run."""
        return await self._control(self.client.abort)

    async def emergency_stop(self, **_: Any) -> Answer:
        """Stops the motors. The daemon never refuses this."""
        await self.ask(self.client.emergency_stop, refused="InstrumentUnreachable")
        return {}

    async def acknowledge_fault(self, *, FaultNumber: int, **_: Any) -> Answer:
        """Acknowledges a fault."""
        await self.ask(self.client.acknowledge, FaultNumber, refused="CommandRefused")
        return {}

    async def _control(self, command: Callable[[str], object]) -> Answer:
        run = (await self.ask(self.client.status, refused="CommandRefused")).run
        if run is None or run.outcome is not None:
            raise self.error("NoRunUnderWay", "There is no run under way.")
        await self.ask(command, run.id, refused="CommandRefused")
        return {}


class InstrumentStatus(Implementation):
    """The status as a property."""

    identifier = "InstrumentStatus"

    async def status(self, **_: Any) -> AsyncIterator[Answer]:
        """Yields every change."""
        async for shown in self.feed.changes():
            yield {"Status": _status(shown)}


class PlateHandover(Implementation):
    """The agreement when a plate may be moved."""

    identifier = "PlateHandover"

    async def prepare_handover(self, *, Intent: Any, PlateBarcode: str, Timeout: float, **_: Any) -> Answer:
        """Ends when the plate may be moved."""
        call = instrument.await_handover
        try:
            await self.ask(call, self.client, Intent, PlateBarcode, Timeout, refused="HandoverRefused")
        except SiLAError as error:
            if isinstance(error.__cause__, TimedOut):
                raise self.error("PlateNeeded", str(error.__cause__)) from error
            raise
        return {}

    async def complete_handover(self, **_: Any) -> Answer:
        """The plate has been moved."""
        await self.ask(self.client.handoff_completed, refused="HandoverRefused")
        return {}

    async def cancel_handover(self, **_: Any) -> Answer:
        """The plate will not be moved."""
        await self.ask(self.client.handoff_aborted, refused="HandoverRefused")
        return {}


FEATURES: tuple[type[Implementation], ...] = (PlateMeasurement, RunControl, InstrumentStatus, PlateHandover)


def _snake(identifier: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in identifier).removeprefix("_")


def _report(status: Status, run: RunStatus) -> Answer:
    specimen = status.specimen
    return {
        "State": status.state,
        "Activity": status.doing,
        "Well": "" if specimen is None else specimen.well,
        "Phase": "" if specimen is None else specimen.phase,
        "WellsDone": run.wells.total - run.wells.pending,
        "WellsTotal": run.wells.total,
        "HoldReason": instrument.why_held(run) if status.state in instrument.HELD else "",
    }


def _results(run: RunStatus) -> Answer:
    return {"Outcome": run.outcome or "running", "Wells": [_well(well) for well in run.results]}


def _well(well: WellStatus) -> Answer:
    quantities = (
        ("Volume", well.volume_um3, "um3"),
        ("VolumeStandardDeviation", well.volume_sd_um3, "um3"),
        ("Area", well.area_um2, "um2"),
        ("AreaStandardDeviation", well.area_sd_um2, "um2"),
        ("Diameter", well.diameter_um, "um"),
    )
    return {
        "Well": well.well,
        "Specimen": well.specimen,
        "Outcome": well.outcome or "pending",
        "Reason": well.reason or "",
        "Flags": list(well.flags),
        "Quantities": [{"Name": n, "Value": v, "Unit": unit} for n, v, unit in quantities if v is not None],
    }


def _status(shown: Shown) -> Answer:
    status = shown.status
    run = None if status is None else status.run
    return {
        "Connected": shown.connected,
        "State": "" if status is None else status.state,
        "Ready": shown.connected and status is not None and status.ready,
        "NotReadyReason": "" if status is None else status.not_ready_reason or "",
        "Activity": "" if status is None else status.doing,
        "Mode": "" if status is None else status.mode,
        "Instrument": "" if status is None else status.instrument.name,
        "RunName": "" if run is None else run.id,
        "RunOutcome": "" if run is None else run.outcome or "",
        "PlateBarcode": "" if status is None else status.plate.barcode or "",
        "PlateRemovable": shown.connected and status is not None and status.plate.removable,
        "Needs": "" if status is None else status.plate.needs or "",
        "EmergencyStopped": status is not None and instrument.emergency_stopped(status),
        "Faults": [] if status is None else [_fault(fault) for fault in status.faults],
    }


def _fault(fault: Fault) -> Answer:
    return {
        "Number": fault.seq,
        "Code": fault.code,
        "Message": fault.message,
        "WhatToDo": fault.what_to_do,
        "SchedulerAction": fault.scheduler_action,
        "OperatorRequired": fault.operator_required,
        "EndsByItself": fault.ends_by_itself,
    }
