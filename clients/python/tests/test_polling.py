"""Polls, long polls and the journal, with a daemon that stops and restarts."""

from __future__ import annotations

from itertools import islice

import httpx
import pytest
from fake import Fake, ok, problem, status_body

from carved_client import Event, Hold, MalformedAnswer, ProblemError, Resync, Retry, TimedOut

ONCE = Retry(attempts=1)


def tagged(revision: int, boot: str = "b") -> httpx.Response:
    return httpx.Response(
        200, json=status_body(revision=revision, boot_id=boot), headers={"etag": f'"{boot}-{revision}"'}
    )


def test_polls_back_off_while_nothing_changes_and_start_anew_with_a_change() -> None:
    fake = Fake([tagged(1), *[httpx.Response(304)] * 6, tagged(2), httpx.Response(304), tagged(3)])
    assert [s.revision for s in islice(fake.client.poll(), 3)] == [1, 2, 3]
    assert fake.pauses == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 0.25, 0.5]
    assert "if-none-match" not in fake.requests[0].headers
    assert fake.requests[-1].headers["if-none-match"] == '"b-2"'


def test_polls_outlive_a_daemon_that_is_away_but_not_a_refusal() -> None:
    away = [httpx.ConnectError("refused"), problem(503, "starting", retry_after=5), httpx.ReadTimeout("late")]
    fake = Fake([tagged(9), *away, tagged(1, "c"), problem(401, "unauthorized")], retry=ONCE)
    polled = fake.client.poll()
    assert [(s.boot_id, s.revision) for s in islice(polled, 2)] == [("b", 9), ("c", 1)]
    with pytest.raises(ProblemError, match="unauthorized"):
        next(polled)


def test_long_polls_ask_for_what_comes_after_and_after_a_restart_for_anything() -> None:
    answers = [tagged(41), tagged(41), tagged(42), httpx.ConnectError("gone"), tagged(42, "c"), tagged(43, "c")]
    fake = Fake(answers, retry=ONCE)
    found = [(s.boot_id, s.revision) for s in islice(fake.client.follow(), 4)]
    assert found == [("b", 41), ("b", 42), ("c", 42), ("c", 43)]
    assert [r.url.params["after"] for r in fake.requests] == ["0", "41", "41", "42", "0", "42"]


def test_what_never_comes_about_times_out_and_says_what_was_seen() -> None:
    fake = Fake([tagged(1)])
    with pytest.raises(TimedOut, match=r"waited 0\.05 s for a miracle; last seen: state Idle"):
        fake.client.wait_for(lambda s: False, "a miracle", 0.05)


def stream(*lines: str) -> httpx.Response:
    return httpx.Response(200, text="\n".join(lines), headers={"content-type": "text/event-stream"})


def event(number: int) -> str:
    return (
        f'id: {number}\ndata: {{"id": {number}, "time": "t", "kind": "k", "run": null, "well": null, "data": null}}\n'
    )


def test_the_journal_is_taken_up_again_after_the_last_event_seen() -> None:
    answers = [
        stream(": carved", "retry: 2000", "", event(5), event(6), "id: 7", 'data: {"cut'),
        httpx.ConnectError("gone"),
        problem(503, "starting"),
        stream(event(7), 'event: resync\ndata: {"boot_id": "c", "revision": 1}\n', event(90), ""),
    ]
    fake = Fake(answers)
    found = list(islice(fake.client.events(4), 5))
    assert [e.id if isinstance(e, Event) else e for e in found] == [5, 6, 7, Resync("c", 1), 90]
    assert [r.headers["last-event-id"] for r in fake.requests] == ["4", "6", "6", "6"]
    assert fake.pauses == [2.0, 4.0, 5.0]


def test_a_journal_with_too_many_readers_is_asked_for_again_after_the_pause_that_the_daemon_asks_for() -> None:
    fake = Fake([problem(503, "busy", retry_after=5), stream(event(5), "")])
    assert next(iter(fake.client.events(4))) == Event(5, "t", "k", None, None, None)
    assert fake.pauses == [5.0]


def test_the_journal_is_not_asked_for_again_where_it_is_refused() -> None:
    fake = Fake([problem(401, "unauthorized")])
    with pytest.raises(ProblemError, match="unauthorized"):
        next(fake.client.events())
    assert len(fake.requests) == 1


def test_a_newer_daemon_may_say_more_and_an_answer_that_lacks_something_is_named() -> None:
    fake = Fake([ok(**status_body(state="Dreaming", novelty={"x": 1}))])
    assert str(fake.client.status().state) == "Dreaming"
    less = status_body()
    del less["boot_id"]
    with pytest.raises(MalformedAnswer, match="/boot_id is missing"):
        Fake([ok(**less)]).client.status()
    with pytest.raises(MalformedAnswer, match="/revision: expected int, found '7'"):
        Fake([ok(**status_body(revision="7"))]).client.status()
    with pytest.raises(MalformedAnswer, match="not JSON"):
        Fake([httpx.Response(200, text="busy")]).client.status()


def test_a_held_run_says_why_how_often_and_what_to_do() -> None:
    counts = dict.fromkeys(["succeeded", "flagged", "failed", "skipped", "interrupted", "pending", "total"], 0)
    run = {"id": "r", "method": "m", "operator": "o", "started": "t", "wells": counts, "results": []}
    hold = {
        "code": "rotation_lost",
        "cause": "The axis does not answer.",
        "times": 4,
        "next_action": "Check its cable.",
    }
    held = Fake([ok(**status_body(state="Held", run={**run, "hold": hold}))]).client.status()
    assert held.run is not None
    assert held.run.hold == Hold("rotation_lost", "The axis does not answer.", 4, "Check its cable.")
    for without in ({}, {"hold": None}):
        status = Fake([ok(**status_body(state="Execute", run={**run, **without}))]).client.status()
        assert status.run is not None
        assert status.run.hold is None
