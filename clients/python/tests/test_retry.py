"""Which requests are repeated, when, and which never are."""

from __future__ import annotations

import httpx
import pytest
from fake import Fake, ok, problem

from carved_client import ProblemError, Retry, Unreachable
from carved_client.transport import Transport

ACKNOWLEDGED = {"run": "r", "revision": 3}


@pytest.mark.parametrize("status", [429, 500, 502, 503, 504])
def test_every_command_is_sent_again_until_it_is_taken(status: int) -> None:
    busy = problem(status, "busy")
    for command in ("hold", "unhold", "stop", "abort"):
        fake = Fake([busy, busy, ok(**ACKNOWLEDGED)])
        assert getattr(fake.client, command)("r").revision == 3
        assert [(r.method, r.url.path) for r in fake.requests] == [("POST", f"/v1/runs/r/{command}")] * 3
        assert fake.pauses == [0.25, 0.5]


def test_a_lost_connection_is_backed_off_from_and_at_last_given_up() -> None:
    fake = Fake([httpx.ReadTimeout("late")])
    with pytest.raises(Unreachable, match="GET /v1/status: ReadTimeout"):
        fake.client.status()
    assert len(fake.requests) == 8
    assert fake.pauses == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0]


def test_the_same_body_is_sent_each_time() -> None:
    fake = Fake([httpx.ConnectError("no"), ok(**ACKNOWLEDGED)])
    fake.client.loaded("r", "A01")
    assert [r.read() for r in fake.requests] == [b'{"loaded": true}'] * 2


def test_retry_after_is_honoured_and_never_shortens_the_back_off() -> None:
    fake = Fake([problem(503, "x", retry_after=3), problem(503, "x", retry_after=0), ok(**ACKNOWLEDGED)])
    fake.client.abort("r")
    assert fake.pauses == [3.0, 0.5]


def test_a_pause_that_is_asked_for_and_too_long_is_not_sat_out() -> None:
    fake = Fake([problem(503, "maintenance", retry_after=3600)])
    with pytest.raises(ProblemError, match="maintenance"):
        fake.client.abort("r")
    assert (len(fake.requests), fake.pauses) == (1, [])


@pytest.mark.parametrize("status", [400, 401, 403, 404, 409, 413, 415, 422, 423, 507])
def test_a_refusal_is_raised_at_once_with_all_that_it_says(status: int) -> None:
    errors = [{"pointer": "/operator", "detail": "empty"}]
    fake = Fake([problem(status, "no", errors=errors, accepted_in=["Idle"], fault_seq=4, new_key=1)])
    with pytest.raises(ProblemError) as caught:
        fake.client.put_run("r", {})
    told = caught.value.problem
    assert (told.status, told.code, told.fault_seq, told.accepted_in) == (status, "no", 4, ("Idle",))
    assert told.errors[0].pointer == "/operator"
    assert len(fake.requests) == 1


def test_a_post_that_nobody_called_idempotent_is_sent_once() -> None:
    asked: list[str] = []

    def refuse(request: httpx.Request) -> httpx.Response:
        asked.append(request.method)
        return problem(503, "busy")

    transport = Transport("http://instrument", transport=httpx.MockTransport(refuse), sleep=lambda s: None)
    with pytest.raises(ProblemError):
        transport.request("POST", "/other")
    with pytest.raises(ProblemError):
        transport.request("DELETE", "/other", retry=Retry(attempts=2))
    assert asked == ["POST", "DELETE", "DELETE"]


def test_an_emergency_stop_is_not_kept_waiting() -> None:
    fake = Fake([httpx.ConnectTimeout("lost"), problem(503, "x", retry_after=5), ok(**ACKNOWLEDGED)])
    fake.client.emergency_stop()
    assert sum(fake.pauses) < 0.2
    assert fake.requests[0].extensions["timeout"]["read"] == 2.0


def test_requests_time_out_after_ten_seconds_and_long_polls_later() -> None:
    fake = Fake([httpx.ConnectError("no")], retry=Retry(attempts=1))
    for ask in (fake.client.status, lambda: fake.client.newer_status(1, 25.0)):
        with pytest.raises(Unreachable):
            ask()
    assert [r.extensions["timeout"]["read"] for r in fake.requests] == [10.0, 35.0]


def test_a_page_of_a_proxy_is_not_mistaken_for_the_instrument() -> None:
    fake = Fake([httpx.Response(404, text="<html>lost?</html>")])
    with pytest.raises(ProblemError, match=r"foreign_answer.*lost\?"):
        fake.client.status()


def test_names_do_not_lead_to_another_path() -> None:
    fake = Fake([ok(**ACKNOWLEDGED)])
    fake.client.abort("../../v1/emergency-stop?x")
    assert fake.requests[0].url.raw_path == b"/v1/runs/..%2F..%2Fv1%2Femergency-stop%3Fx/abort"


def test_the_token_goes_with_every_request() -> None:
    fake = Fake([ok(**ACKNOWLEDGED)], token="secret")
    fake.client.abort("r")
    assert fake.requests[0].headers["authorization"] == "Bearer secret"
