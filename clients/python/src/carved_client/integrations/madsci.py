"""carved as a MADSci node: `python -m carved_client.integrations.madsci --carved_url http://127.0.0.1:8420`.

Workcell Manager ──REST──> CarvedNode (madsci-node-module) ──HTTP──> carved

    measure_plate                      PUT run (its name is the action's id), then the status until it has ended
    prepare_handover                   PUT handoff until nothing is needed: then an arm may move the plate
    complete_handover, cancel_handover the end of the handover
    pause, resume, cancel              hold, unhold, abort of the run under way
    safety_stop, reset                 emergency stop, acknowledgement of the faults

The result of an action that this process did not start is read from the instrument, so a restarted node still knows it.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Literal, cast

from madsci.common.types.action_types import ActionRequest, ActionResult, ActionStatus
from madsci.common.types.admin_command_types import AdminCommandResponse
from madsci.common.types.base_types import Error
from madsci.common.types.node_types import NodeStatus, RestNodeConfig
from madsci.node_module import RestNode, action
from pydantic import AnyUrl, Field

from ..client import CarvedClient
from ..errors import CarvedError, ProblemError
from ..models import RunStatus, Status
from . import instrument


class CarvedNodeConfig(RestNodeConfig):
    """Settings of the node: options (`--carved_url`), variables (`NODE_CARVED_URL`) or `node.settings.yaml`."""

    carved_url: AnyUrl = Field(default=AnyUrl("http://127.0.0.1:8420"), description="The address of the carved daemon.")
    #: The path, not the token: `GET /info` shows the configuration to everybody.
    carved_token_file: Path | None = Field(default=None, description="The file with the token of the carved daemon.")
    # A rate limit would refuse a safety stop after a hundred requests in a minute.
    enable_rate_limiting: bool = False
    uvicorn_kwargs: dict[str, Any] = Field(default_factory=lambda: {"limit_concurrency": 100})


class CarvedNode(RestNode):
    """One instrument."""

    config_model = CarvedNodeConfig
    config: CarvedNodeConfig
    module_version: ClassVar[str] = "1.0.0"

    def __init__(self, node_config: CarvedNodeConfig | None = None) -> None:
        config = node_config or CarvedNodeConfig()
        config.module_version = config.module_version or self.module_version
        super().__init__(config)
        # For commands, and for the status, whose answer must not wait for repeats.
        self._carved = self._connect(quick=False)
        self._quick = self._connect(quick=True)
        self._started: set[str] = set()

    def _connect(self, *, quick: bool) -> CarvedClient:
        return instrument.connect(str(self.config.carved_url), self.config.carved_token_file, quick=quick)

    # Actions

    @action
    def measure_plate(
        self,
        plate_barcode: str,
        plate_map: Path,
        method: str = "standard",
        operator: str = "madsci",
        action: ActionRequest | None = None,
    ) -> dict[str, Any]:
        """Measures the plate that is in the instrument.

        plate_barcode: the barcode of the plate
        plate_map: a file that says what is in each well, CSV or JSON (docs/plate-map.md)
        method: the name of a method of the instrument
        operator: who is responsible for the run
        """
        assert action is not None  # RestNode gives the request to a parameter of this name
        run_id = action.action_id
        self._started.add(run_id)
        try:
            kind: Literal["text/csv", "application/json"]
            kind = "application/json" if plate_map.suffix.lower() == ".json" else "text/csv"
            wells = self._carved.check_plate_map(plate_map.read_text(encoding="utf-8-sig"), kind)
            plan = wells.plan(plate_barcode, method, operator)
            self._carved.put_run(run_id, plan)
            reported = None
            for status in self._carved.follow_run(run_id):
                run = status.run_named(run_id)
                if run is None:
                    continue
                result = _result(run_id, status, run)
                if (shown := (result.status, run.wells)) != reported:
                    reported = shown
                    if result.status.is_terminal:
                        return _declared(result)
                    self._extend_action_history(result)
            raise CarvedError(f"the status of run {run_id} ended before the run")
        except CarvedError as error:
            return _declared(_failed(run_id, error))

    @action
    def prepare_handover(
        self,
        intent: Literal["load", "unload"],
        plate_barcode: str,
        timeout_s: float = 60.0,
        action: ActionRequest | None = None,
    ) -> dict[str, Any]:
        """Announces that a plate is put in or taken away, and succeeds when an arm may move it.

        intent: load or unload
        plate_barcode: the barcode of the plate
        timeout_s: how long to wait until the plate may be moved
        """
        assert action is not None
        return self._command(action, lambda: instrument.await_handover(self._carved, intent, plate_barcode, timeout_s))

    @action
    def complete_handover(self, action: ActionRequest | None = None) -> dict[str, Any]:
        """Says that the arm has moved the plate and left the instrument."""
        assert action is not None
        return self._command(action, self._carved.handoff_completed)

    @action
    def cancel_handover(self, action: ActionRequest | None = None) -> dict[str, Any]:
        """Says that the announced plate will not be moved."""
        assert action is not None
        return self._command(action, self._carved.handoff_aborted)

    @staticmethod
    def _command(request: ActionRequest, command: Callable[[], object]) -> dict[str, Any]:
        try:
            command()
        except CarvedError as error:
            return _declared(_failed(request.action_id, error))
        return _declared(request.succeeded())

    # Administration

    def safety_stop(self) -> AdminCommandResponse:
        """Stops the motors. Nothing runs until the faults are acknowledged."""
        return self._administer(self._carved.emergency_stop)

    def pause(self) -> AdminCommandResponse:
        """Holds the run after the current specimen."""
        return self._control(self._carved.hold)

    def resume(self) -> AdminCommandResponse:
        """Continues a held run."""
        return self._control(self._carved.unhold)

    def cancel(self) -> AdminCommandResponse:
        """Aborts the run. The motors stop first."""
        return self._control(self._carved.abort)

    def reset(self) -> AdminCommandResponse:
        """Acknowledges every fault that does not end by itself, also an emergency stop."""

        def acknowledge() -> None:
            for fault in self._carved.status().faults:
                if not fault.ends_by_itself:
                    self._carved.acknowledge(fault.seq)

        return self._administer(acknowledge)

    def _control(self, command: Callable[[str], object]) -> AdminCommandResponse:
        def control() -> None:
            run = self._carved.status().run
            if run is None or run.outcome is not None:
                raise CarvedError("no run is under way")
            command(run.id)

        return self._administer(control)

    def _administer(self, command: Callable[[], object]) -> AdminCommandResponse:
        try:
            command()
        except CarvedError as error:
            return AdminCommandResponse(success=False, errors=[_error(error)])
        self.status_handler()
        return AdminCommandResponse(success=True)

    # Status and results

    def status_handler(self) -> None:
        """Sets the node's status to that of the instrument."""
        shown = self.node_status
        try:
            status = self._quick.status()
        except CarvedError as error:
            shown.disconnected, shown.errors = True, [_error(error)]
            return
        run = _running(status)
        shown.disconnected = False
        shown.stopped = instrument.emergency_stopped(status)
        shown.errored = any(f.operator_required and f.code != "emergency_stop" for f in status.faults)
        shown.paused = run is not None and status.state in instrument.HELD
        # A node that is busy takes no action. An open handover makes the instrument not ready, and must be completed.
        shown.busy = run is not None
        shown.errors = [Error(message=instrument.advice(f), error_type=f.code) for f in status.faults]

    def state_handler(self) -> None:
        """Sets the node's state to the instrument's own words, its plate, run and specimen."""
        try:
            status = self._quick.status()
        except CarvedError:
            return
        self.node_state = {
            "state": status.state,
            "doing": status.doing,
            "not_ready_reason": status.not_ready_reason,
            "mode": status.mode,
            "instrument": vars(status.instrument),
            "plate": vars(status.plate),
            "run": None if status.run is None else {"id": status.run.id, "wells": vars(status.run.wells)},
            "specimen": None
            if status.specimen is None
            else {"well": status.specimen.well, "phase": status.specimen.phase},
        }

    def get_status(self) -> NodeStatus:
        """The status as it is now, and not as it was at the last update."""
        self.status_handler()
        return super().get_status()

    def get_state(self) -> dict[str, Any]:
        """The state as it is now, and not as it was at the last update."""
        self.state_handler()
        state: dict[str, Any] = super().get_state()
        return state

    def start_action(self, _action_name: str, action_id: str) -> dict[str, Any]:
        """Starts an action if the instrument is ready for it now."""
        self.status_handler()
        started: dict[str, Any] = super().start_action(_action_name, action_id)
        return started

    def get_action_status(self, action_id: str) -> ActionStatus:
        """The status of an action, also if an earlier process of this node started it."""
        self._recall(action_id)
        return super().get_action_status(action_id)

    def get_action_result_dict(self, action_id: str) -> dict[str, Any]:
        """The result of an action, also if an earlier process of this node started it."""
        self._recall(action_id)
        result: dict[str, Any] = super().get_action_result_dict(action_id)
        return result

    def _recall(self, action_id: str) -> None:
        """Reads an action that this process does not know from the run of its name."""
        known = self.action_history.get(action_id)
        if action_id in self._started or (known is not None and known[-1].status.is_terminal):
            return
        try:
            status = self._quick.with_run(self._quick.status(), action_id)
        except CarvedError:
            return
        if (run := status.run_named(action_id)) is not None:
            self.action_history[action_id] = [_result(action_id, status, run)]


def _declared(result: ActionResult) -> dict[str, Any]:
    """The result of an action. Its annotation is the type of `json_result`, while RestNode takes an ActionResult."""
    return cast(dict[str, Any], result)


def _running(status: Status) -> RunStatus | None:
    return status.run if status.run is not None and status.run.outcome is None else None


def _result(action_id: str, status: Status, run: RunStatus) -> ActionResult:
    """The state of a run as that of its action. An unknown outcome is never a success."""
    errors: list[Error] = []
    if run.outcome is None:
        held = status.state in instrument.HELD
        state = ActionStatus.PAUSED if held else ActionStatus.RUNNING
        if held:
            errors = [Error(message=instrument.why_held(run), error_type=run.hold.code if run.hold else None)]
    elif run.outcome in instrument.USABLE:
        state = ActionStatus.SUCCEEDED
    else:
        state = ActionStatus.CANCELLED if run.outcome == "aborted" else ActionStatus.FAILED
        errors = [Error(message=instrument.why_ended(status, run), error_type=run.outcome)]
    told = {
        "run": run.id,
        "outcome": run.outcome,
        "mode": status.mode,
        "instrument": status.instrument.name,
        "wells": instrument.rows(run),
    }
    return ActionResult(action_id=action_id, status=state, errors=errors, json_result=told)


def _error(error: CarvedError) -> Error:
    code = error.code if isinstance(error, ProblemError) else type(error).__name__
    return Error(message=instrument.refusal(error), error_type=code)


def _failed(action_id: str, error: CarvedError) -> ActionResult:
    return ActionResult(action_id=action_id, status=ActionStatus.FAILED, errors=[_error(error)])


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv):
        print(__doc__)
        sys.exit()
    CarvedNode().start_node()
