"""carved as a MADSci node: the REST routes of a MADSci workcell, with the standard library alone.

    POST /action/measure_plate {"args": {...}} ──> action_id      the run's name is the action's id
    POST /action/measure_plate/ID/start        ──> running
    GET  /action/ID/status  /action/ID/result  ──> the state of the run, read from the instrument each time
    POST /admin/safety_stop | pause | resume | cancel | reset
    GET  /status  /state  /info

The node stores no outcomes. After a restart of the node or of the instrument the end of an action is still that of the
instrument. Run it: `python madsci_node.py http://127.0.0.1:8420 2000`
"""

from __future__ import annotations

import json
import sys
import uuid
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from carved_client import CarvedClient, CarvedError, ProblemError, RunPlan, Status
from carved_client.decode import decode

#: The status of an action for the outcome of a run. An unknown outcome is never a success.
ENDS = {"succeeded": "succeeded", "partial": "succeeded", "aborted": "cancelled"}
PAUSED = {"Holding", "Held", "Suspending", "Suspended"}


class CarvedNode:
    """Actions and admin commands of one instrument."""

    ACTIONS = ("measure_plate",)
    ADMIN = ("safety_stop", "pause", "resume", "cancel", "reset")

    def __init__(self, client: CarvedClient, name: str = "carved") -> None:
        self.client, self.name = client, name
        self.created: dict[str, RunPlan] = {}

    def info(self) -> dict[str, Any]:
        arguments = {"plan": {"type": "object", "required": True, "description": "the body of PUT /v1/runs/{run_id}"}}
        actions = {name: {"name": name, "args": arguments, "blocking": True} for name in self.ACTIONS}
        return {
            "node_name": self.name,
            "module_name": "carved",
            "module_version": self.client.status().version,
            "capabilities": {"get_info": True, "get_state": True, "get_status": True, "admin_commands": self.ADMIN},
            "actions": actions,
        }

    def status(self) -> dict[str, Any]:
        try:
            status = self.client.status()
        except CarvedError as error:
            return {"ready": False, "disconnected": True, "errors": [{"message": str(error)}]}
        busy = status.run is not None and status.run.outcome is None
        return {
            "ready": status.ready,
            "busy": busy,
            "running_actions": [status.run.id] if status.run is not None and busy else [],
            "paused": status.state in PAUSED,
            "stopped": any(fault.code == "emergency_stop" for fault in status.faults),
            "errored": any(fault.operator_required for fault in status.faults),
            "disconnected": False,
            "errors": [{"error_type": fault.code, "message": fault.message} for fault in status.faults],
            "description": status.doing,
        }

    def state(self) -> dict[str, Any]:
        status = self.client.status()
        specimen = None if status.specimen is None else vars(status.specimen)
        return {"state": status.state, "doing": status.doing, "plate": vars(status.plate), "specimen": specimen}

    def create(self, action: str, arguments: dict[str, Any]) -> dict[str, Any]:
        if action not in self.ACTIONS:
            raise KeyError(action)
        action_id = uuid.uuid4().hex
        self.created[action_id] = decode(RunPlan, arguments["plan"])
        return {"action_id": action_id, "status": "not_started"}

    def start(self, action_id: str) -> dict[str, Any]:
        try:
            self.client.put_run(action_id, self.created[action_id])
        except ProblemError as error:
            return self._result(action_id, "failed", [f"{error.problem.code}: {error.problem.detail}"])
        return self.result(action_id)

    def result(self, action_id: str) -> dict[str, Any]:
        status = self.client.status()
        run = status.run_named(action_id)
        if run is not None and run.outcome is None:
            return self._result(action_id, "paused" if status.state in PAUSED else "running")
        try:
            # The run has ended. The store has it, also if the status shows another run by now.
            stored = self.client.run(action_id)
        except ProblemError as error:
            if error.problem.code != "unknown_run":
                raise
            return self._result(action_id, "not_started" if action_id in self.created else "unknown")
        outcome = stored["outcome"]
        kept = ("outcome", "reason", "volume_um3")
        wells = {well["well"]: {key: well[key] for key in kept} for well in stored["results"]}
        end = ENDS.get(outcome, "failed") if outcome else "paused"
        return self._result(action_id, end, _why(status, outcome, end), {"outcome": outcome, "wells": wells})

    @staticmethod
    def _result(action_id: str, status: str, errors: list[str] | None = None, data: object = None) -> dict[str, Any]:
        told = [{"message": message} for message in errors or []]
        return {"action_id": action_id, "status": status, "errors": told, "json_result": data}

    def admin(self, command: str) -> dict[str, Any]:
        if command not in self.ADMIN:
            raise KeyError(command)
        run = self.client.status().run if command != "safety_stop" else None
        if command == "safety_stop":
            self.client.emergency_stop()
        elif command == "reset":
            for fault in self.client.status().faults:
                self.client.acknowledge(fault.seq)
        elif run is not None and run.outcome is None:
            {"pause": self.client.hold, "resume": self.client.unhold, "cancel": self.client.abort}[command](run.id)
        return {"success": True, "errors": []}


def _why(status: Status, outcome: str | None, end: str) -> list[str]:
    if outcome is None or end == "succeeded":
        return []
    return [f"the run ended as {outcome}", *(fault.message for fault in status.faults)]


def server(node: CarvedNode, port: int) -> ThreadingHTTPServer:
    """Serves a node on loopback. Port 0 selects a free port."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            match self.path.strip("/").split("/"):
                case ["status"]:
                    self._answer(node.status)
                case ["state"]:
                    self._answer(node.state)
                case ["info"]:
                    self._answer(node.info)
                case ["action", action_id, "result"]:
                    self._answer(lambda: node.result(action_id))
                case ["action", action_id, "status"]:
                    self._answer(lambda: node.result(action_id)["status"])
                case _:
                    self.send_error(404)

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers.get("content-length", 0)))
            match self.path.strip("/").split("/"):
                case ["action", action]:
                    self._answer(lambda: node.create(action, json.loads(body)["args"]))
                case ["action", _, action_id, "start"]:
                    self._answer(lambda: node.start(action_id))
                case ["admin", command]:
                    self._answer(lambda: node.admin(command))
                case _:
                    self.send_error(404)

        def _answer(self, make: Any) -> None:
            try:
                code, answer = 200, make()
            except KeyError as unknown:
                code, answer = 404, {"detail": f"there is no {unknown}"}
            except (CarvedError, ValueError) as error:
                code, answer = 502, {"detail": str(error)}
            told = json.dumps(answer).encode()
            self.send_response(code)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(told)))
            self.end_headers()
            self.wfile.write(told)

        def log_message(self, format: str, *arguments: object) -> None: ...

    return ThreadingHTTPServer(("127.0.0.1", port), Handler)


if __name__ == "__main__":
    url, port = sys.argv[1], int(sys.argv[2])
    server(CarvedNode(CarvedClient(url)), port).serve_forever()
