"""What the instrument says of itself. Names, units and meanings are those of the contract (`/docs` on the daemon).

Four things are never mixed into one word: the `state` of the instrument, the `phase` of a specimen, the `outcome` of
what has ended, and the `faults`. Words are typed as literals and not checked when read: a newer daemon may know more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

State = Literal[
    "Stopped", "Idle", "Starting", "Execute", "Holding", "Held", "Unholding", "Suspending", "Suspended",
    "Unsuspending", "Completing", "Complete", "Stopping", "Aborting", "Aborted", "Clearing", "Resetting",
]  # fmt: skip
Phase = Literal["load", "detect", "position", "revolve", "reconstruct", "measure", "eject", "wash"]
RunOutcome = Literal["succeeded", "partial", "failed", "aborted", "interrupted"]
SpecimenOutcome = Literal["succeeded", "failed", "aborted", "interrupted", "skipped"]
SchedulerAction = Literal[
    "retry", "skip_well", "reject_plate", "abort_plate", "pause_instrument", "escalate_operator"
]  # fmt: skip
Mode = Literal["hardware", "simulated", "imported"]
SpecimenKind = Literal["larva", "bead"]
HandoffIntent = Literal["load", "unload"]
Control = Literal["positive", "negative"]
ConcentrationUnit = Literal[
    "M", "mM", "uM", "nM", "pM", "g/L", "mg/L", "ug/L", "ng/L", "mg/mL", "ug/mL", "ng/mL", "%", "% v/v", "% w/v", "ppm"
]  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """Something that is wrong now; it stays listed until it is over or acknowledged."""

    seq: int
    code: str
    category: str
    message: str
    recoverable: bool
    scheduler_action: SchedulerAction
    operator_required: bool
    since: str
    #: What its code means, in plain words; ``message`` has what was found this time.
    meaning: str = ""
    what_to_do: str = ""


@dataclass(frozen=True)
class Pending:
    """Commands that were accepted and are still under way."""

    hold: bool = False
    stop: bool = False
    abort: bool = False


@dataclass(frozen=True)
class Plate:
    """The plate in the instrument."""

    barcode: str | None
    present: bool
    #: No specimen in the capillary and everything of this plate on disk.
    removable: bool
    #: What the instrument waits for from the loader, in words, if anything.
    needs: str | None
    #: The well whose specimen is to be taken out of the capillary.
    take_out: str | None = None
    #: The well whose specimen is to be brought, after what is to be taken out.
    bring: str | None = None


@dataclass(frozen=True)
class WellCounts:
    """Disjoint counts: every well is in exactly one."""

    succeeded: int
    flagged: int
    failed: int
    skipped: int
    interrupted: int
    pending: int
    total: int


@dataclass(frozen=True)
class Eta:
    """Seconds until the run is done: half of such runs are done by `p50`, nine of ten by `p90`."""

    p50: float
    p90: float


@dataclass(frozen=True)
class WellStatus:
    """One well of the run, as far as it has come."""

    well: str
    specimen: SpecimenKind
    dpf: float | None = None
    outcome: SpecimenOutcome | None = None
    reason: str | None = None
    flags: tuple[str, ...] = ()
    volume_um3: float | None = None
    volume_sd_um3: float | None = None
    area_um2: float | None = None
    area_sd_um2: float | None = None
    diameter_um: float | None = None


@dataclass(frozen=True)
class Hold:
    """Why a run is held."""

    #: A fault's code, `operator`, or `restart` of the daemon.
    code: str
    #: The same in plain words; it may be over by now.
    cause: str
    #: How often it has held the run since a well was finished, this time included.
    times: int
    #: The one thing to do next; None where the run goes on without it.
    next_action: str | None = None


@dataclass(frozen=True)
class RunStatus:
    """The run under way, or the last one until the next starts."""

    id: str
    method: str
    operator: str
    wells: WellCounts
    results: tuple[WellStatus, ...]
    started: str
    external_id: str | None = None
    ended: str | None = None
    eta_s: Eta | None = None
    outcome: RunOutcome | None = None
    held_by_operator: bool = False
    goes_on_by_itself: bool = False
    #: None where the run is not held.
    hold: Hold | None = None


@dataclass(frozen=True)
class SpecimenStatus:
    """The specimen that is under way."""

    well: str
    in_capillary: bool
    phase: Phase
    view: int
    views_planned: int
    volume_um3: float | None = None
    volume_sd_um3: float | None = None
    volume_views: int | None = None
    converged: bool | None = None


@dataclass(frozen=True)
class Status:
    """`GET /v1/status`: one snapshot."""

    schema: str
    revision: int
    boot_id: str
    server_time: str
    uptime_s: float
    version: str
    mode: Mode
    ready: bool
    not_ready_reason: str | None
    state: State
    doing: str
    pending: Pending
    plate: Plate
    run: RunStatus | None
    specimen: SpecimenStatus | None
    #: Axes, camera, disk: as the daemon says it.
    hardware: dict[str, Any]
    faults: tuple[Fault, ...] = ()

    def run_named(self, run_id: str) -> RunStatus | None:
        """The run, where it is the one that the status shows."""
        return self.run if self.run is not None and self.run.id == run_id else None


@dataclass(frozen=True)
class Acknowledged:
    """A command was taken; the status from this revision on shows what became of it."""

    revision: int
    run: str | None = None


@dataclass(frozen=True)
class HandoffNeeds:
    """What an announced handover of a plate waits for; with `needs` null the plate may be moved now."""

    intent: HandoffIntent
    barcode: str
    needs: str | None


@dataclass(frozen=True)
class Check:
    """One thing that a run needs."""

    code: str
    passed: bool
    #: Whether a run would be refused or fail; else its numbers are flagged or lack something.
    blocks: bool
    detail: str
    what_to_do: str | None = None


@dataclass(frozen=True)
class Preflight:
    """Everything that a run of a plan would meet now."""

    #: Nothing that blocks has failed.
    passed: bool
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Event:
    """One line of the instrument's journal. Ids rise by one and last across restarts."""

    id: int
    time: str
    kind: str
    run: str | None = None
    well: str | None = None
    data: Any = field(default=None)


@dataclass(frozen=True)
class Resync:
    """The gap is too old to be replayed: read the status anew and go on."""

    boot_id: str
    revision: int
