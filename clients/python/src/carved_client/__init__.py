"""Typed client of carved, an instrument that measures zebrafish larvae in 3D.

>>> from carved_client import CarvedClient, PlannedWell, RunPlan
>>> carved = CarvedClient("http://127.0.0.1:8420")
>>> carved.status().state
'Idle'
"""

from .client import CarvedClient
from .errors import CarvedError, LeaseStatus, MalformedAnswer, Mistake, Problem, ProblemError, TimedOut, Unreachable
from .lease import Lease
from .models import (
    Acknowledged,
    CalibrationStatus,
    Eta,
    Event,
    Fault,
    GateStatus,
    Hold,
    InstrumentIdentity,
    NoticesStatus,
    Pending,
    PlaceStatus,
    Plate,
    ReferenceStatus,
    Resync,
    RunStatus,
    SpecimenStatus,
    Status,
    WellCounts,
    WellNote,
    WellStatus,
)
from .plan import PlannedWell, PlateMap, RunPlan
from .transport import Retry

__all__ = [
    "Acknowledged",
    "CalibrationStatus",
    "CarvedClient",
    "CarvedError",
    "Eta",
    "Event",
    "Fault",
    "GateStatus",
    "Hold",
    "InstrumentIdentity",
    "Lease",
    "LeaseStatus",
    "MalformedAnswer",
    "Mistake",
    "NoticesStatus",
    "Pending",
    "PlaceStatus",
    "PlannedWell",
    "Plate",
    "PlateMap",
    "Problem",
    "ProblemError",
    "ReferenceStatus",
    "Resync",
    "Retry",
    "RunPlan",
    "RunStatus",
    "SpecimenStatus",
    "Status",
    "TimedOut",
    "Unreachable",
    "WellCounts",
    "WellNote",
    "WellStatus",
]
