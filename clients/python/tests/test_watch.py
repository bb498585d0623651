"""Breaks each rule of the watch once."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from fake import status_body

from carved_client import Status
from carved_client.decode import decode
from carved_client.watch import Misled, StatusWatch

COUNTS = ("succeeded", "flagged", "failed", "skipped", "interrupted", "pending")


def well(name: str, outcome: str | None = None, **more: Any) -> dict[str, Any]:
    return {"well": name, "specimen": "larva", "outcome": outcome, "flags": [], **more}


def running(**changes: Any) -> dict[str, Any]:
    run = {
        "id": "r", "external_id": None, "method": "m", "operator": "o", "started": "t", "ended": None, "eta_s": None,
        "outcome": None,
        "wells": dict.fromkeys(COUNTS, 0) | {"pending": 1, "succeeded": 1, "total": 2},
        "results": [well("A01", "succeeded", volume_um3=1.0), well("A02")],
    }  # fmt: skip
    busy = {"state": "Execute", "ready": False, "not_ready_reason": "a run is under way", "run": run}
    return status_body(**{**busy, **changes})


def changed(body: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    body = copy.deepcopy(body)
    *way, last = path.split("/")
    at: Any = body
    for step in way:
        at = at[int(step)] if step.isdecimal() else at[step]
    at[last] = value
    return body


def check(*bodies: dict[str, Any], capillary: str | None = None) -> None:
    watch = StatusWatch(in_capillary=lambda: capillary)
    for body in bodies:
        watch.check(decode(Status, body))


ALONE = {
    "schema": (status_body(schema="other/1"), "its schema"),
    "idle between two wells": (running(state="Idle"), "state Idle while a run is under way"),
    "complete between two wells": (running(state="Complete"), "state Complete while a run is under way"),
    "ready while aborted": (running(state="Aborted", ready=True, not_ready_reason=None), "has no outcome"),
    "ready while busy": (running(ready=True, not_ready_reason=None), "ready in state Execute"),
    "ready with a reason": (status_body(not_ready_reason="starting"), "ready in state Idle, reason 'starting'"),
    "not ready without one": (status_body(ready=False), "not ready, and no reason"),
    "a sum": (changed(running(), "run/wells/total", 3), "counts"),
    "a word": (changed(running(), "run/results/0/outcome", "skipped"), "counts"),
    "a flag": (changed(running(), "run/results/0/flags", ["moved"]), "counts"),
    "an end without an outcome": (changed(running(), "run/ended", "t"), "outcome None, ended t"),
    "an outcome too early": (
        running(run={**running()["run"], "outcome": "succeeded", "ended": "t"}, state="Execute"),
        "succeeded with 1 wells pending",
    ),
    "removable in a run": (changed(running(), "plate/removable", True), "called removable with a run under way"),
    "removable with a specimen": (
        status_body(
            plate={"barcode": "P", "present": True, "removable": True, "needs": None},
            specimen={"well": "A01", "in_capillary": True, "phase": "eject", "view": 0, "views_planned": 21},
        ),
        "or a specimen in the capillary",
    ),
}


@pytest.mark.parametrize("name", ALONE)
def test_a_status_that_misleads_by_itself(name: str) -> None:
    body, told = ALONE[name]
    with pytest.raises(Misled, match=told):
        check(body)


def later(**changes: Any) -> dict[str, Any]:
    return running(revision=8, **changes)


SEQUENCE = {
    "revision": (running(revision=6), "revision 7 went back to 6"),
    "uptime": (later(uptime_s=0.5), "uptime"),
    "one revision": (running(doing="Something else."), "two different statuses have revision 7"),
    "a number": (changed(later(), "run/results/0/volume_um3", 2.0), "well A01 had ended"),
    "other wells": (changed(later(), "run/results/1/well", "A03"), "the run's wells became others"),
    "no run": (later(run=None), "shows no run instead"),
    "another run": (changed(later(), "run/id", "s"), "shows s instead"),
    "no run, ready": (
        status_body(boot_id="c", revision=1),
        "run r had no outcome and the status shows no run instead",
    ),
}


@pytest.mark.parametrize("name", SEQUENCE)
def test_a_status_that_misleads_by_the_one_before(name: str) -> None:
    body, told = SEQUENCE[name]
    check(running())
    check(body)
    with pytest.raises(Misled, match=told):
        check(running(), body)


def test_an_outcome_stays() -> None:
    ended = running(state="Complete", ready=True, not_ready_reason=None)
    ended["run"] |= {
        "outcome": "partial",
        "ended": "t",
        "results": [running()["run"]["results"][0], well("A02", "failed")],
    }
    ended["run"]["wells"] |= {"pending": 0, "failed": 1}
    check(running(), later(), ended | {"revision": 9})
    with pytest.raises(Misled, match="the outcome partial became succeeded"):
        check(ended, changed(ended | {"revision": 8}, "run/outcome", "succeeded"))


def test_removable_while_the_loader_knows_better() -> None:
    removable = status_body(plate={"barcode": "P", "present": True, "removable": True, "needs": None})
    check(removable)
    with pytest.raises(Misled, match="while the specimen of A01 is in the capillary"):
        check(removable, capillary="A01")


def test_a_restart_in_the_middle_of_a_run_misleads_nobody() -> None:
    starting = status_body(boot_id="c", revision=1, ready=False, not_ready_reason="starting", uptime_s=0.0)
    watch = StatusWatch()
    for body in (running(), starting, running(boot_id="c", revision=2)):
        watch.check(decode(Status, body))
    assert (watch.seen, watch.boots) == (3, 2)
