"""The instrument's commands and queries, as Python calls.

Every command leads towards a state and may be repeated: a repeat gets the same answer as the first. All commands are
therefore retried, also the POSTs. A plate of the queue is an exception: once it is removed or has begun, a repeat
finds nothing to remove (404). `docs/loader.md` describes the contract.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal
from urllib.parse import quote

import httpx

from . import polling, sse
from .decode import decode
from .errors import MalformedAnswer, ProblemError, Unreachable
from .lease import Lease
from .models import Acknowledged, Event, HandoffIntent, HandoffNeeds, Preflight, Resync, RunStatus, Status
from .plan import PlateMap, RunPlan
from .results import Results
from .transport import AT_ONCE, RETRIED, Retry, Transport

#: Longest wait of a long poll at the daemon, s.
LONGEST_WAIT_S = 30.0


class CarvedClient(Results):
    """One instrument. Safe to use from several threads, as an emergency stop must be."""

    def __init__(
        self,
        base_url: str = "http://127.0.0.1:8420",
        *,
        token: str | None = None,
        timeout_s: float = 10.0,
        retry: Retry | None = None,
        transport: httpx.BaseTransport | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(
            Transport(base_url, token=token, timeout_s=timeout_s, retry=retry, transport=transport, sleep=sleep)
        )

    def __enter__(self) -> CarvedClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._transport.close()

    # The state of the instrument

    def status(self) -> Status:
        """The newest snapshot."""
        return decode(Status, self._json("GET", "/v1/status"))

    def newer_status(self, after: int, wait_s: float = 25.0) -> Status:
        """The first snapshot whose revision differs from `after`, or the newest one after `wait_s`."""
        wait_s = min(wait_s, LONGEST_WAIT_S)
        params = {"wait": wait_s, "after": after}
        timeout_s = wait_s + self._transport.timeout_s
        return decode(Status, self._json("GET", "/v1/status", params=params, timeout_s=timeout_s))

    def status_unless(self, etag: str | None) -> tuple[Status | None, str | None]:
        """The newest snapshot and its `ETag`. The snapshot is None if `etag` is its tag."""
        response = self._transport.request("GET", "/v1/status", headers={"if-none-match": etag} if etag else None)
        status = None if response.status_code == httpx.codes.NOT_MODIFIED else decode(Status, _parsed(response))
        return status, response.headers.get("etag", etag)

    def poll(self, timeout_s: float | None = None) -> Iterator[Status]:
        """Yields every change that polls of 0.25 s to 5 s see. Continues over restarts of the daemon."""
        return polling.poll(self.status_unless, self._transport.sleep, timeout_s)

    def follow(self, timeout_s: float | None = None) -> Iterator[Status]:
        """Yields every change as it happens, by long polls. Continues over restarts of the daemon."""
        return polling.follow(self.newer_status, self._transport.sleep, timeout_s)

    def wait_for(self, done: Callable[[Status], bool], what: str, timeout_s: float | None = None) -> Status:
        """Follows the status until `done` returns true. `what` describes the condition in the timeout error."""
        return polling.first(self.follow(timeout_s), done, what, timeout_s)

    def follow_run(self, run_id: str, timeout_s: float | None = None) -> Iterator[Status]:
        """Yields every change of the status until the run has ended. The last status has its outcome.

        Each status shows this run (see `with_run`), if the daemon knows it.
        """
        for status in self.follow(timeout_s):
            status = self.with_run(status, run_id)
            yield status
            run = status.run_named(run_id)
            if run is not None and run.outcome is not None:
                return

    def wait_for_outcome(self, run_id: str, timeout_s: float | None = None) -> Status:
        """Waits until the run has ended. Its `outcome` is the result. An unknown end is not one."""

        def ended(status: Status) -> bool:
            run = status.run_named(run_id)
            return run is not None and run.outcome is not None

        return polling.first(self.follow_run(run_id, timeout_s), ended, f"the outcome of run {run_id}", timeout_s)

    def with_run(self, status: Status, run_id: str) -> Status:
        """The status with this run in it, if the daemon knows the run.

        If the status shows another run, or none, the stored run is read: it may have ended while nobody could ask,
        during a restart of the daemon.
        """
        if status.run_named(run_id) is not None:
            return status
        try:
            kept = self.run(run_id)
        except Unreachable:
            return status
        except ProblemError as error:
            if error.status in RETRIED or error.status == httpx.codes.NOT_FOUND:
                return status
            raise
        return replace(status, run=decode(RunStatus, kept))

    def events(self, last_event_id: int | None = None) -> Iterator[Event | Resync]:
        """Yields the journal as it is written, starting after `last_event_id`. Reconnects after an interruption."""
        return sse.events(self._transport, last_event_id)

    def methods(self) -> list[dict[str, Any]]:
        """The methods that a plan may name."""
        offered = self._object("GET", "/v1/methods")["methods"]
        return decode(list[dict[str, Any]], offered)

    def fault_codes(self) -> object:
        """Every fault code with its category, the scheduler's reaction and the operator's action."""
        return self._json("GET", "/v1/fault-codes")

    # Runs

    def put_run(self, run_id: str, plan: RunPlan | Mapping[str, Any]) -> Acknowledged:
        """Registers a run under your own name for it, and starts it. A repeat of the same plan changes nothing."""
        body = plan.to_json() if isinstance(plan, RunPlan) else dict(plan)
        return self._command("PUT", f"/v1/runs/{_name(run_id)}", body)

    # The queue of plates

    def queue(self, run_id: str, plan: RunPlan | Mapping[str, Any]) -> Acknowledged:
        """Queues a plate as the last one, or changes the plan of the one that waits for this run."""
        body = plan.to_json() if isinstance(plan, RunPlan) else dict(plan)
        return self._command("PUT", f"/v1/queue/{_name(run_id)}", body)

    def queued(self, run_id: str) -> dict[str, Any]:
        """The plan of a queued plate."""
        return decode(dict[str, Any], self._json("GET", f"/v1/queue/{_name(run_id)}"))

    def unqueue(self, run_id: str) -> Acknowledged:
        """Takes a plate out of the queue. `not_queued` is the answer if it has begun or is out already."""
        return self._command("DELETE", f"/v1/queue/{_name(run_id)}")

    def order_queue(self, run_ids: Iterable[str]) -> Acknowledged:
        """Puts the queue into this order. It names every queued run once."""
        return self._command("PUT", "/v1/queue", {"runs": list(run_ids)})

    def next_plate(self, barcode: str) -> Acknowledged:
        """Reports the plate that is in its place, by the barcode that was read from it.

        If it is the next one of the queue, its run begins; `run` is its name. Any other barcode is refused
        (`other_plate_next`), and nothing changes.
        """
        return self._command("PUT", "/v1/plate/next", {"barcode": barcode})

    # The course of a run. `by` is the name of the person who asks, for the event log.

    def hold(self, run_id: str, by: str | None = None) -> Acknowledged:
        """Holds the run after the current specimen."""
        return self._steer(f"/v1/runs/{_name(run_id)}/hold", by)

    def unhold(self, run_id: str, by: str | None = None) -> Acknowledged:
        """Continues a held run."""
        return self._steer(f"/v1/runs/{_name(run_id)}/unhold", by)

    def stop(self, run_id: str, by: str | None = None) -> Acknowledged:
        """Ends the run after the current specimen."""
        return self._steer(f"/v1/runs/{_name(run_id)}/stop", by)

    def abort(self, run_id: str, by: str | None = None) -> Acknowledged:
        """Ends the run now. The motors stop first."""
        return self._steer(f"/v1/runs/{_name(run_id)}/abort", by)

    def rest_of(self, run_id: str, wells: Iterable[str] = ()) -> dict[str, Any]:
        """The plan of the wells that a run has left without numbers, or of these wells. Send it by `put_run`."""
        params = {"wells": ",".join(wells)}
        rest = self._json("GET", f"/v1/runs/{_name(run_id)}/rest", params={k: v for k, v in params.items() if v})
        return decode(dict[str, Any], rest)

    def skip(self, run_id: str, well: str, by: str, reason: str) -> Acknowledged:
        """Leaves a well out of a held run, for this person and reason."""
        return self._about(run_id, well, "skip", {"by": by, "reason": reason})

    def redo(self, run_id: str, well: str, by: str, reason: str) -> Acknowledged:
        """Has a well of a held run measured again when it continues. The first attempt is kept."""
        return self._about(run_id, well, "redo", {"by": by, "reason": reason})

    def note(
        self,
        run_id: str,
        well: str,
        by: str,
        comment: str = "",
        *,
        excluded: bool = False,
        tags: Iterable[str] = (),
    ) -> Acknowledged:
        """Writes a person's remark on a well, also of a run that has ended. `excluded` leaves it out of statistics."""
        body = {"by": by, "comment": comment, "excluded": excluded, "tags": list(tags)}
        return self._about(run_id, well, "note", body)

    def _about(self, run_id: str, well: str, what: str, body: Mapping[str, Any]) -> Acknowledged:
        return self._command("PUT", f"/v1/runs/{_name(run_id)}/wells/{_name(well)}/{what}", body)

    def emergency_stop(self, by: str | None = None) -> Acknowledged:
        """Stops the motors, then everything else. It is repeated at once, many times, until it arrives.

        `by` is the name of the person who stops, for the event log.
        """
        params = {} if by is None else {"by": by}
        body = self._json("POST", "/v1/emergency-stop", params=params, idempotent=True, timeout_s=2.0, retry=AT_ONCE)
        return decode(Acknowledged, body)

    def acknowledge(self, fault_seq: int, by: str | None = None) -> Acknowledged:
        """Acknowledges this fault for an operator. `by` is the operator's name."""
        return self._steer(f"/v1/faults/{fault_seq}/acknowledge", by)

    def check_plate_map(
        self,
        text: str,
        kind: Literal["text/csv", "application/json"] = "text/csv",
        plate: str | None = None,
        plate_format: int | None = None,
        columns: Iterable[Mapping[str, Any]] | None = None,
    ) -> PlateMap:
        """Reads a plate map in a lab's own format. `ProblemError.problem.errors` lists every mistake with its line.

        `plate` names one of several plates of a MIHCSME file. `plate_format` is the number of wells of the plate: a
        well that is not on it is a mistake. `columns` says what the columns of a foreign CSV are, as
        `propose_columns` answers and you correct it: `heading`, `column` and `unit` of each.
        """
        chosen: dict[str, Any] = {"plate": plate, "plate_format": plate_format}
        if columns is not None:
            named = [{key: column.get(key) for key in ("heading", "column", "unit")} for column in columns]
            chosen["columns"] = json.dumps(named)
        body = self._json(
            "POST",
            "/v1/plate-maps/check",
            content=(text.encode(), kind),
            params={name: value for name, value in chosen.items() if value is not None},
            idempotent=True,
        )
        return decode(PlateMap, body)

    def propose_columns(self, text: str) -> list[dict[str, Any]]:
        """What the columns of a foreign CSV seem to be. Nothing is read by it: correct it, then `check_plate_map`."""
        content = (text.encode(), "text/csv")
        answer = self._json("POST", "/v1/plate-maps/columns", content=content, idempotent=True)
        return decode(list[dict[str, Any]], decode(dict[str, Any], answer)["columns"])

    def lease(self, holder: str, ttl_s: int = 60) -> Lease:
        """Holds a lease, so that only this client commands, until the block ends: `with client.lease("loader 1"):`."""
        return Lease(self._transport, holder, ttl_s)

    # Reports of the plate-loader

    def loaded(self, run_id: str, well: str) -> Acknowledged:
        """Reports that the specimen of this well is in the capillary."""
        return self._command("PUT", f"/v1/runs/{_name(run_id)}/wells/{_name(well)}", {"loaded": True})

    def unloaded(self, run_id: str, well: str) -> Acknowledged:
        """Reports that the specimen of this well has been taken out of the capillary."""
        return self._command("PUT", f"/v1/runs/{_name(run_id)}/wells/{_name(well)}", {"loaded": False})

    def handoff(self, intent: HandoffIntent, barcode: str) -> HandoffNeeds:
        """Announces that a plate will be put in or taken away. Repeat until `needs` is None, then move the plate."""
        body = {"intent": intent, "barcode": barcode}
        return decode(HandoffNeeds, self._json("PUT", "/v1/plate/handoff", body=body))

    def handoff_completed(self) -> Acknowledged:
        """Reports that the announced plate has been moved."""
        return self._command("PUT", "/v1/plate/handoff/completed")

    def handoff_aborted(self) -> Acknowledged:
        """Reports that the announced plate will not be moved."""
        return self._command("PUT", "/v1/plate/handoff/aborted")

    def preflight(self, plan: RunPlan) -> Preflight:
        """Checks all preconditions of a run of this plan, not only up to the first failure. Nothing moves."""
        return decode(Preflight, self._json("POST", "/v1/preflight", body=plan.to_json(), idempotent=True))

    def _command(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> Acknowledged:
        return decode(Acknowledged, self._json(method, path, body=body, idempotent=True))

    def _steer(self, path: str, by: str | None) -> Acknowledged:
        params = {} if by is None else {"by": by}
        return decode(Acknowledged, self._json("POST", path, params=params, idempotent=True))

    def _object(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> dict[str, Any]:
        return decode(dict[str, Any], self._json(method, path, body=body, idempotent=True))

    def _json(self, method: str, path: str, **options: Any) -> object:
        return _parsed(self._transport.request(method, path, **options))


def _name(name: str) -> str:
    """Quotes a name for a path, so that it cannot lead to another path."""
    return quote(name, safe="")


def _parsed(response: httpx.Response) -> object:
    try:
        parsed: object = response.json()
    except ValueError as error:
        raise MalformedAnswer(f"{response.request.url}: not JSON: {response.text[:200]!r}") from error
    return parsed
