"""What every integration tells its scheduler, from the instrument's status: results, reasons and faults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..client import CarvedClient
from ..errors import CarvedError, ProblemError, TimedOut
from ..models import Fault, HandoffIntent, RunStatus, Status
from ..transport import Retry

#: States of a run that waits for somebody to let it continue.
HELD = frozenset({"Holding", "Held"})
#: Outcomes of which the wells that were measured can be used. Any other outcome, also an unknown one, is a failure.
USABLE = frozenset({"succeeded", "partial"})


def connect(url: str, token_file: str | Path | None = None, *, quick: bool = False) -> CarvedClient:
    """A client of the daemon, with the token in a file. A quick one gives up at the first lost request."""
    token = None if token_file is None else Path(token_file).expanduser().read_text().strip()
    if quick:
        return CarvedClient(url, token=token, timeout_s=3.0, retry=Retry(attempts=1))
    return CarvedClient(url, token=token)


def rows(run: RunStatus) -> list[dict[str, Any]]:
    """One dictionary per well, in the order of the plan. A value that was not measured is None."""
    return [
        {
            "well": well.well,
            "specimen": well.specimen,
            "outcome": well.outcome,
            "reason": well.reason,
            "flags": list(well.flags),
            "volume_um3": well.volume_um3,
            "volume_sd_um3": well.volume_sd_um3,
            "area_um2": well.area_um2,
            "area_sd_um2": well.area_sd_um2,
            "diameter_um": well.diameter_um,
        }
        for well in run.results
    ]


def emergency_stopped(status: Status) -> bool:
    """Whether an emergency stop has not been acknowledged yet."""
    return any(fault.code == "emergency_stop" for fault in status.faults)


def advice(fault: Fault) -> str:
    """What is wrong, and what a person does."""
    return f"{fault.message} {fault.what_to_do}".strip()


def why_held(run: RunStatus) -> str:
    """Why the run waits, and what lets it continue."""
    if run.hold is None:
        return "The run is held."
    return f"{run.hold.cause} {run.hold.next_action or 'The run continues by itself.'}"


def why_ended(status: Status, run: RunStatus) -> str:
    """Why a run did not end as wished."""
    return " ".join([f"Run {run.id} ended as {run.outcome}.", *(advice(fault) for fault in status.faults)])


def refusal(error: CarvedError) -> str:
    """Why the instrument refused a request, with every mistake of a plan, or why there was no answer."""
    return f"{error.code}: {error.problem.detail}" if isinstance(error, ProblemError) else str(error)


def await_handover(client: CarvedClient, intent: HandoffIntent, barcode: str, timeout_s: float) -> None:
    """Announces that a plate is put in or taken away, and returns when it may be moved.

    After `timeout_s` the announcement is withdrawn and `TimedOut` says what the instrument still needs.
    """
    needs = client.handoff(intent, barcode).needs
    try:
        for _ in client.follow(timeout_s) if needs is not None else ():
            needs = client.handoff(intent, barcode).needs
            if needs is None:
                break
        else:
            if needs is not None:
                raise TimedOut(
                    f"the plate {barcode} may not be moved after {timeout_s} s: the instrument needs {needs}"
                )
    except BaseException:
        client.handoff_aborted()
        raise
