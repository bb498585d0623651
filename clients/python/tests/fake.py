"""A daemon whose answers the test chooses, and pauses that take no time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import httpx

from carved_client import CarvedClient


class Fake:
    """Gives the answers in order, the last one repeatedly. Records the requests and the pauses."""

    def __init__(self, answers: Sequence[object], **options: Any) -> None:
        self.answers = list(answers)
        self.requests: list[httpx.Request] = []
        self.pauses: list[float] = []
        self.client = CarvedClient(
            "http://instrument", transport=httpx.MockTransport(self._answer), sleep=self.pauses.append, **options
        )

    def _answer(self, request: httpx.Request) -> httpx.Response:
        self.requests.append(request)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        assert isinstance(answer, httpx.Response)
        return answer


def problem(status: int, code: str, **more: Any) -> httpx.Response:
    headers = {"content-type": "application/problem+json"}
    if "retry_after" in more:
        headers["retry-after"] = str(more.pop("retry_after"))
    body = {"type": f"urn:carved:problem:{code}", "title": "T", "status": status, "detail": "d", "code": code}
    return httpx.Response(
        status, headers=headers, json={**body, "scheduler_action": "retry", "fault_seq": None, **more}
    )


def ok(**body: Any) -> httpx.Response:
    return httpx.Response(200, json=body)


def status_body(**changes: Any) -> dict[str, Any]:
    body: dict[str, Any] = {
        "schema": "carved.status/1",
        "revision": 7,
        "boot_id": "b",
        "server_time": "2026-01-01T00:00:00Z",
        "uptime_s": 1.5,
        "version": "0.1.0",
        "mode": "simulated",
        "ready": True,
        "not_ready_reason": None,
        "state": "Idle",
        "doing": "Waiting for a run.",
        "pending": {"hold": False, "stop": False, "abort": False},
        "plate": {"barcode": None, "present": False, "removable": False, "needs": None},
        "run": None,
        "specimen": None,
        "hardware": {},
        "calibration": None,
        "faults": [],
    }
    return {**body, **changes}
