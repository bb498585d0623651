"""Runs the examples unchanged."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from madsci_node import CarvedNode, server
from pylabrobot_backend import CarvedBackend, LarvaScanner
from rig import PATIENCE_S, Daemon, plan

from carved_client import CarvedClient, Retry


def test_a_pylabrobot_protocol(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("--no-demo", "--empty", "A02")
    backend = CarvedBackend(daemon.url)
    scanner = LarvaScanner("scanner", backend)

    async def protocol() -> list[dict[str, Any]]:
        with pytest.raises(RuntimeError, match="setup has not finished"):
            await scanner.measure("P-1", {"A1": None})
        async with scanner:
            return await scanner.measure("P-1", {"A1": 4.0, "A2": 5.0})

    larva, empty = asyncio.run(protocol())
    assert (larva["well"], larva["outcome"]) == ("A1", "succeeded")
    assert larva["volume_um3"] == pytest.approx(2e8, rel=0.5)
    assert (empty["outcome"], empty["reason"], empty["volume_um3"]) == ("skipped", "empty", None)
    assert backend.serialize() == {
        "type": "CarvedBackend", "url": daemon.url, "method": "standard", "operator": "pylabrobot",
    }  # fmt: skip


@contextmanager
def workcell(client: CarvedClient) -> Iterator[httpx.Client]:
    """A node of an instrument, and the workcell that uses it."""
    with server(CarvedNode(client), 0) as node:
        serving = threading.Thread(target=node.serve_forever)
        serving.start()
        with httpx.Client(base_url=f"http://127.0.0.1:{node.server_port}", timeout=30.0) as http:
            yield http
        node.shutdown()
        serving.join()


def ended(http: httpx.Client, action_id: str) -> dict[str, Any]:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        result: dict[str, Any] = http.get(f"/action/{action_id}/result").json()
        if result["status"] not in {"running", "paused"}:
            return result
        time.sleep(0.1)
    raise AssertionError("the action did not end")


def test_a_madsci_workcell(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("--no-demo", "--empty", "A02")
    with daemon.ready() as client, workcell(client) as http:
        assert list(http.get("/info").json()["actions"]) == ["measure_plate"]
        assert http.get("/status").json()["ready"] is True
        arguments = {"args": {"plan": plan("A01", "A02").to_json()}}
        action = http.post("/action/measure_plate", json=arguments).json()["action_id"]
        assert http.get(f"/action/{action}/status").json() == "not_started"
        assert http.post(f"/action/measure_plate/{action}/start").json()["status"] == "running"
        assert http.get("/status").json()["running_actions"] == [action]
        result = ended(http, action)
        assert (result["status"], result["json_result"]["outcome"], result["errors"]) == ("succeeded", "succeeded", [])
        assert result["json_result"]["wells"]["A02"]["reason"] == "empty"
        first = action

        action = http.post("/action/measure_plate", json=arguments).json()["action_id"]
        http.post(f"/action/measure_plate/{action}/start")
        assert http.post("/admin/cancel").json()["success"] is True
        result = ended(http, action)
        assert (result["status"], result["errors"][0]["message"]) == ("cancelled", "the run ended as aborted")
        assert http.get(f"/action/{first}/result").json()["json_result"]["outcome"] == "succeeded", "behind another run"

        wrong = http.post("/action/measure_plate", json={"args": {"plan": plan().to_json()}}).json()["action_id"]
        refused = http.post(f"/action/measure_plate/{wrong}/start").json()
        assert (refused["status"], refused["errors"][0]["message"][:12]) == ("failed", "invalid_plan")
        assert http.get("/action/never/status").json() == "unknown"
        for path in ("/action/dance", "/admin/dance"):
            assert http.post(path, json={"args": {}}).status_code == 404


def test_a_madsci_node_without_its_instrument_says_so() -> None:
    client = CarvedClient("http://127.0.0.1:9", retry=Retry(attempts=1))
    with workcell(client) as http:
        status = http.get("/status").json()
        assert (status["ready"], status["disconnected"]) == (False, True)
        assert http.get("/action/x/result").status_code == 502
