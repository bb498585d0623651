"""What a run is asked to do: the body of `PUT /v1/runs/{run_id}`."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from .models import ConcentrationUnit, Control, SpecimenKind


@dataclass(frozen=True)
class PlannedWell:
    """What the plate map says of a well; `A01` to `P24`."""

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
    """A run's whole plan; wells in the order in which they are visited."""

    plate_barcode: str
    method: str
    operator: str
    plate_map: tuple[PlannedWell, ...]
    external_id: str | None = None
    #: The version that the method must have; any where it is left out.
    method_version: str | None = None
    #: What the lab keeps with the plate, as MIHCSME has it; stored with the run and not read.
    metadata: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As the daemon reads it; what is not known is left out."""
        plan: dict[str, Any] = _known(dataclasses.asdict(self))
        plan["plate_map"] = [_known(well) for well in plan["plate_map"]]
        if not self.metadata:
            del plan["metadata"]
        return plan


@dataclass(frozen=True)
class PlateMap:
    """A plate map as the daemon reads it out of a file; its wells and metadata are those of a plan."""

    plate_map: tuple[PlannedWell, ...]
    metadata: dict[str, Any] = field(default_factory=dict)
    #: What was read otherwise than it stands in the file.
    notes: tuple[str, ...] = ()


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if value is not None}
