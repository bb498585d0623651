"""The plan of a run: the body of `PUT /v1/runs/{run_id}`."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from .models import ConcentrationUnit, Control, SpecimenKind


@dataclass(frozen=True)
class PlannedWell:
    """The plate map's entry for a well; `A01` to `AF48`."""

    well: str
    specimen: SpecimenKind = "larva"
    dpf: float | None = None
    compound: str | None = None
    concentration: float | None = None
    concentration_unit: ConcentrationUnit | None = None
    strain: str | None = None
    treatment: str | None = None
    control: Control | None = None
    replicate: int | None = None


@dataclass(frozen=True)
class RunPlan:
    """The whole plan of a run, with the wells in the order of measurement."""

    plate_barcode: str
    method: str
    operator: str
    plate_map: tuple[PlannedWell, ...]
    external_id: str | None = None
    #: The version that the method must have; any if None.
    method_version: str | None = None
    #: Number of wells of the plate: 6, 12, 24, 48, 96, 384 or 1536. If None, the plate is one that holds the wells.
    plate_format: int | None = None
    #: The lab's own data about the plate, in MIHCSME's form. They are stored with the run and not interpreted.
    metadata: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The body for the daemon, without the values that are None."""
        plan: dict[str, Any] = _known(dataclasses.asdict(self))
        plan["plate_map"] = [_known(well) for well in plan["plate_map"]]
        if not self.metadata:
            del plan["metadata"]
        return plan


@dataclass(frozen=True)
class PlateMap:
    """A plate map that the daemon has read from a file. Its wells and metadata can be used in a plan."""

    plate_map: tuple[PlannedWell, ...]
    metadata: dict[str, Any] = field(default_factory=dict)
    #: Entries that were interpreted, and not taken literally.
    notes: tuple[str, ...] = ()
    #: Number of wells of the plate, if the file names it.
    plate_format: int | None = None
    #: What a person confirms before a run, by choosing the plate: a single well makes it larger, and may be a misprint.
    confirm: str | None = None

    def plan(self, plate_barcode: str, method: str, operator: str, *, external_id: str | None = None) -> RunPlan:
        """The plan of a run of these wells, with everything that the file says about the plate."""
        return RunPlan(
            plate_barcode=plate_barcode,
            method=method,
            operator=operator,
            plate_map=self.plate_map,
            external_id=external_id,
            plate_format=self.plate_format,
            metadata=self.metadata,
        )


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if value is not None}
