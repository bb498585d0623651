"""A run that ended while nobody could ask or while a specimen was on its way, and a lease whose answer was lost."""

from __future__ import annotations

import json
from typing import Any

import httpx
import pytest
from fake import Fake, ok, problem, status_body
from rig import plan

from carved_client import ProblemError, Retry, TimedOut
from carved_client.simulated_loader import PlateLoader

COUNTS = ("succeeded", "flagged", "failed", "skipped", "interrupted", "pending")


def run_body(name: str, outcome: str | None) -> dict[str, Any]:
    ended = outcome is not None
    return {
        "id": name, "external_id": None, "method": "m", "operator": "o", "started": "t",
        "ended": "t" if ended else None,
        "outcome": outcome, "wells": dict.fromkeys(COUNTS, 0) | {"succeeded" if ended else "pending": 1, "total": 1},
        "results": [{"well": "A01", "specimen": "larva", "outcome": "succeeded" if ended else None}],
    }  # fmt: skip


@pytest.mark.parametrize("shown", [None, run_body("next", None)])
def test_a_run_that_ended_in_a_restart_is_read_from_what_is_kept(shown: dict[str, Any] | None) -> None:
    fake = Fake(
        [
            ok(**status_body(run=run_body("mine", None))),
            httpx.ConnectError("restarting"),
            ok(**status_body(boot_id="c", revision=3, run=shown)),
            ok(**run_body("mine", "partial"), plate_barcode="P-1"),
        ],
        retry=Retry(attempts=1),
    )
    status = fake.client.wait_for_outcome("mine")
    assert status.run is not None
    assert (status.boot_id, status.run.id, status.run.outcome) == ("c", "mine", "partial")
    assert [r.url.path for r in fake.requests] == ["/v1/status"] * 3 + ["/v1/runs/mine"]


def test_a_run_that_is_kept_open_or_not_known_is_waited_for() -> None:
    answers = [
        ok(**status_body(revision=1)),
        problem(404, "unknown_run"),
        ok(**status_body(revision=2)),
        httpx.ConnectError("gone"),
        ok(**status_body(revision=3)),
        ok(**run_body("mine", None)),
        ok(**status_body(revision=4, run=run_body("mine", "succeeded"))),
    ]
    status = Fake(answers, retry=Retry(attempts=1)).client.wait_for_outcome("mine")
    assert status.revision == 4
    never = Fake([ok(**status_body(revision=1)), problem(404, "unknown_run"), ok(**status_body(revision=1))])
    with pytest.raises(TimedOut, match="the outcome of run mine"):
        never.client.wait_for_outcome("mine", 0.05)


def test_a_refusal_to_read_a_run_is_raised() -> None:
    with pytest.raises(ProblemError, match="unauthorized"):
        Fake([ok(**status_body()), problem(401, "unauthorized")]).client.wait_for_outcome("mine")


def test_a_lease_whose_answer_was_lost_is_asked_for_again_under_the_same_token() -> None:
    fake = Fake([httpx.ReadTimeout("late"), ok(token="given", holder="h", expires_in_s=60.0), ok()])
    with fake.client.lease("loader 1"):
        pass
    asked = [json.loads(r.read()) for r in fake.requests if r.method == "PUT"]
    assert len(asked) == 2
    assert asked[0] == asked[1]
    assert (asked[0]["holder"], len(asked[0]["token"])) == ("loader 1", 32)
    assert fake.requests[-1].headers["carved-lease"] == "given"
    other = Fake([ok(token="x", holder="h", expires_in_s=60.0), ok()])
    with other.client.lease("loader 1"):
        pass
    assert json.loads(other.requests[0].read())["token"] != asked[0]["token"]


@pytest.mark.parametrize(("inside", "reported"), [(True, ["/v1/runs/mine/wells/A01"]), (False, [])])
def test_the_loader_leaves_a_specimen_that_may_still_come_to_a_person(inside: bool, reported: list[str]) -> None:
    specimen = {"well": "A01", "in_capillary": inside, "phase": "load", "view": 0, "views_planned": 21}
    plate = {"barcode": "P-1", "present": True, "removable": False, "needs": "take it out", "take_out": "A01"}
    ended = run_body("mine", "aborted")
    body = status_body(state="Aborted", ready=False, not_ready_reason="n", run=ended, specimen=specimen, plate=plate)
    fake = Fake([ok(**body), ok(revision=8)])
    loader = PlateLoader("http://instrument")
    loader.client = fake.client
    assert loader._poll("mine", plan("A01"), lambda: None) is None
    assert [request.url.path for request in fake.requests if request.method != "GET"] == reported
