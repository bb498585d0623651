"""The instrument's state. Names, units and meanings are those of the contract (`/docs/api` on the daemon).

Four things are kept apart: the `state` of the instrument, the `phase` of a specimen, the `outcome` of a run or
specimen, and the `faults`. Values are typed as literals and not checked when read: a newer daemon may know more.
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
NextCommand = Literal["acknowledge", "unhold"]
VolumeWait = Literal["views", "computing", "slices"]
HandoffIntent = Literal["load", "unload"]
Control = Literal["positive", "negative"]
ConcentrationUnit = Literal[
    "M", "mM", "uM", "nM", "pM", "g/L", "mg/L", "ug/L", "ng/L", "mg/mL", "ug/mL", "ng/mL", "%", "% v/v", "% w/v", "ppm"
]  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A condition that is wrong now. It stays listed until it is over or acknowledged."""

    seq: int
    code: str
    category: str
    message: str
    recoverable: bool
    scheduler_action: SchedulerAction
    operator_required: bool
    since: str
    #: The meaning of its code, in plain words; ``message`` has the details of this case.
    meaning: str = ""
    what_to_do: str = ""
    #: True if it ends with its cause. Others end with their acknowledgement.
    ends_by_itself: bool = False


@dataclass(frozen=True)
class InstrumentIdentity:
    """Which instrument it is."""

    name: str = ""
    serial: str | None = None
    location: str | None = None
    #: It stays the same when the name or the place changes.
    uuid: str = ""


@dataclass(frozen=True)
class NoticesStatus:
    """Notices to people who are not at the instrument."""

    #: Address of the receiver without its path.
    receiver: str
    #: Why notices do not reach it; None if nothing is known to be wrong.
    trouble: str | None = None


@dataclass(frozen=True)
class Pending:
    """Accepted commands that are still under way."""

    hold: bool = False
    stop: bool = False
    abort: bool = False


@dataclass(frozen=True)
class Plate:
    """The plate in the instrument."""

    barcode: str | None
    present: bool
    #: True if no specimen is in the capillary and everything of this plate is on disk.
    removable: bool
    #: What the instrument needs from the loader, in words; None if nothing.
    needs: str | None
    #: The well whose specimen must be taken out of the capillary.
    take_out: str | None = None
    #: The well whose specimen must be brought, after another one was taken out if necessary.
    bring: str | None = None


@dataclass(frozen=True)
class WellCounts:
    """Disjoint counts: every well is in exactly one of them."""

    succeeded: int
    flagged: int
    failed: int
    skipped: int
    interrupted: int
    pending: int
    total: int


@dataclass(frozen=True)
class Eta:
    """Seconds until the end of the run: half of such runs have ended by `p50`, nine of ten by `p90`."""

    p50: float
    p90: float


@dataclass(frozen=True)
class PlaceStatus:
    """The comparison of one number with the reference larvae of its age; the fields are None if there are none."""

    #: The comparison in plain words, or why there is none.
    words: str
    #: What the larvae of the group have in common.
    group: str | None
    #: Number of larvae in the group.
    n: int | None
    #: Share of the group's larvae that are smaller, in percent.
    percentile: float | None
    #: Standard deviations above the mean of the group.
    z: float | None
    #: Differences and unknown conditions between the measurement and the group.
    mismatches: tuple[str, ...]


@dataclass(frozen=True)
class ReferenceStatus:
    """The comparison of a larva with reference larvae."""

    volume: PlaceStatus
    area: PlaceStatus
    #: Of the mean volume of both eyes; None unless both were found.
    eye_volume: PlaceStatus | None = None
    #: Of the distance between the eyes; None unless both were found.
    eye_distance: PlaceStatus | None = None


@dataclass(frozen=True)
class WellNote:
    """A person's remark on a well."""

    by: str
    time: str
    #: Statistics leave the well out. Its numbers stay.
    excluded: bool
    comment: str
    tags: tuple[str, ...] = ()


@dataclass(frozen=True)
class WellStatus:
    """One well of the run, with its result so far."""

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
    #: `support` (slices of the outlines) or `voxel` (as in the paper).
    estimator: str | None = None
    #: Volume and area of the surface that the page shows.
    field_volume_um3: float | None = None
    field_area_um2: float | None = None
    #: How far the edges of the median view lie from those of the calibrated model.
    residual_px: float | None = None
    #: Views that count, and views by the method.
    views: int | None = None
    views_planned: int | None = None
    #: Fluorescence in the second camera per volume: grey levels times px per nl.
    signal_per_nl: float | None = None
    reference: ReferenceStatus | None = None
    #: The newest remark of a person.
    note: WellNote | None = None


@dataclass(frozen=True)
class Hold:
    """Why a run is held."""

    #: A fault's code, `operator`, `restart` of the daemon, or `fault` if an early journal does not say which.
    code: str
    #: The cause in plain words. It may be over by now.
    cause: str
    #: How often it has held the run since a well was last finished, including this time.
    times: int
    #: The next action of the operator; None if the run continues without one.
    next_action: str | None = None
    #: The command of that action; None while a cause stands that no command ends.
    next_command: NextCommand | None = None
    #: The fault that the action is about.
    fault_seq: int | None = None
    #: When the run tries again by itself, RFC 3339; None if it does not, or as soon as the cause is over.
    next_try: str | None = None


@dataclass(frozen=True)
class RunStatus:
    """The current run, or the last one until the next starts."""

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
    #: None if the run is not held.
    hold: Hold | None = None


@dataclass(frozen=True)
class VolumeEstimate:
    """The volume as it was estimated after some views."""

    views: int
    volume_um3: float
    volume_sd_um3: float | None = None


@dataclass(frozen=True)
class SpecimenStatus:
    """The current specimen."""

    well: str
    in_capillary: bool
    phase: Phase
    view: int
    views_planned: int
    volume_um3: float | None = None
    volume_sd_um3: float | None = None
    volume_views: int | None = None
    converged: bool | None = None
    #: Why `volume_um3` is None.
    volume_wait: VolumeWait | None = None
    #: Every `volume_um3` of this turn, the oldest first.
    estimates: tuple[VolumeEstimate, ...] = ()
    #: Volume of the live hull after each view, the oldest first: of few views too large, and no estimate.
    hull_volumes_um3: tuple[float, ...] = ()


@dataclass(frozen=True)
class GateStatus:
    """The newest bead gate of the rig."""

    id: str
    #: `passed`, `no_history` (passed, with too few earlier gates to detect a change), `failed` or `too_few_beads`.
    verdict: str
    #: True if it passed and has not expired.
    stands: bool
    #: For the operator, with the next action.
    summary: str
    #: All results, with what to do.
    words: tuple[str, ...]
    #: Time of the recording of its last bead, and the age at which it expires.
    measured: str
    max_age_s: float


@dataclass(frozen=True)
class CalibrationStatus:
    """The newest calibration of the rig."""

    id: str
    #: `beads` or `scale`; `gate` if the rig has no calibration and only a bead gate.
    kind: str
    valid: bool
    measured: str
    age_s: float
    max_age_s: float
    #: Deviation of the mean diameter of the beads from the nominal one; None for a scale.
    bead_bias_percent: float | None
    gate: GateStatus | None


@dataclass(frozen=True)
class QueuedPlate:
    """A plate that waits for its turn."""

    #: Name of the run that it will be.
    run: str
    plate_barcode: str
    method: str
    operator: str
    #: Number of wells of its plan.
    wells: int
    #: Why it cannot begin as it is; None if nothing is known.
    trouble: str | None = None


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
    #: Axes, camera and disk, in the format of the daemon.
    hardware: dict[str, Any]
    faults: tuple[Fault, ...] = ()
    #: The plates that wait for their turn, the next one first.
    queue: tuple[QueuedPlate, ...] = ()
    instrument: InstrumentIdentity = InstrumentIdentity()
    #: None if the configuration names no receiver.
    notices: NoticesStatus | None = None
    #: None if the rig has neither a calibration nor a bead gate.
    calibration: CalibrationStatus | None = None

    def run_named(self, run_id: str) -> RunStatus | None:
        """The run, if the status shows it."""
        return self.run if self.run is not None and self.run.id == run_id else None


@dataclass(frozen=True)
class Acknowledged:
    """A command was accepted; the status from this revision on shows its effect."""

    revision: int
    run: str | None = None


@dataclass(frozen=True)
class HandoffNeeds:
    """What an announced handover of a plate needs. The plate may be moved once `needs` is None."""

    intent: HandoffIntent
    barcode: str
    needs: str | None


@dataclass(frozen=True)
class Check:
    """One precondition of a run."""

    code: str
    passed: bool
    #: True if a failure prevents the run; else its numbers would be flagged or incomplete.
    blocks: bool
    detail: str
    what_to_do: str | None = None


@dataclass(frozen=True)
class Preflight:
    """Every precondition of a run of a plan, as it is now."""

    #: True if nothing that blocks has failed.
    passed: bool
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Event:
    """One line of the instrument's journal. Ids rise by one, also over restarts."""

    id: int
    time: str
    kind: str
    run: str | None = None
    well: str | None = None
    data: Any = field(default=None)


@dataclass(frozen=True)
class Resync:
    """The missed events are too old to be sent again: read the status and continue."""

    boot_id: str
    revision: int
