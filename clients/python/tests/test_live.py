"""The client against a real daemon whose sampler fills the capillary by itself."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from rig import PATIENCE_S, Daemon, plan

from carved_client import CarvedClient, Event, PlannedWell, ProblemError, Resync, TimedOut
from carved_client.watch import StatusWatch


def test_a_plate_from_its_plan_to_its_numbers(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("--no-demo", "--empty", "A02")
    wells = (PlannedWell("A01", "bead"), PlannedWell("A02", dpf=4.0, compound="DMSO", control="negative"))
    with daemon.ready() as client:
        before = client.status().revision
        assert client.put_run("r1", plan(*wells)).run == "r1"
        assert client.put_run("r1", plan(*wells)).run == "r1"
        with pytest.raises(ProblemError, match="other_plan") as other:
            client.put_run("r1", plan("A01"))
        assert (other.value.status, other.value.problem.scheduler_action) == (409, "escalate_operator")

        watch, polled = StatusWatch(), threading.Thread(target=_poll_to_the_end, args=(CarvedClient(daemon.url),))
        polled.start()
        for status in client.follow(PATIENCE_S):
            watch.check(status)
            run = status.run_named("r1")
            if run is not None and run.outcome is not None:
                break
        polled.join(PATIENCE_S)
        assert not polled.is_alive()
        assert run is not None
        assert (run.outcome, run.wells.succeeded, run.wells.skipped) == ("succeeded", 1, 1)
        bead, empty = run.results
        assert bead.diameter_um == pytest.approx(500.0, rel=0.01)
        assert (empty.outcome, empty.reason) == ("skipped", "empty")
        assert watch.seen > 20
        assert client.newer_status(before, 25.0).plate.removable

        told = client.events(0)
        first = next(told)
        assert isinstance(first, Event | Resync)
        kinds = [first.kind] if isinstance(first, Event) else []
        while "run.ended" not in kinds:
            event = next(told)
            assert isinstance(event, Event)
            kinds.append(event.kind)
        assert kinds.count("specimen.done") == 2


def _poll_to_the_end(client: CarvedClient) -> None:
    """A second reader with ETags sees the same end."""
    for status in client.poll(PATIENCE_S):
        if status.run is not None and status.run.outcome == "succeeded":
            return
    raise AssertionError("the end was not seen")


def test_an_abort_in_the_middle_of_a_specimen(start_daemon: Callable[..., Daemon]) -> None:
    with start_daemon("--no-demo", time_scale=1).ready() as client:
        client.put_run("r1", plan("A01", "A02"))
        client.wait_for(lambda s: s.specimen is not None and s.specimen.phase == "revolve", "a turn", PATIENCE_S)
        client.abort("r1")
        status = client.wait_for_outcome("r1", PATIENCE_S)
        assert status.run is not None
        assert (status.run.outcome, status.run.wells.interrupted) == ("aborted", 2)
        assert client.abort("r1").revision >= status.revision
        with pytest.raises(ProblemError, match="unknown_run"):
            client.abort("r2")
        with pytest.raises(TimedOut, match="the outcome of run r2"):
            client.wait_for_outcome("r2", 0.2)


def test_one_client_at_a_time_and_what_a_plan_may_say(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("--no-demo")
    with daemon.ready() as loader, CarvedClient(daemon.url) as other:
        assert [method["name"] for method in other.methods()] == ["standard"]
        assert "camera_lost" in str(other.fault_codes())
        with loader.lease("loader 1", ttl_s=30):
            with pytest.raises(ProblemError, match="locked") as locked:
                other.put_run("r1", plan("A01"))
            assert locked.value.problem.lease is not None
            assert locked.value.problem.lease.holder == "loader 1"
            # The request passes the lease, and its plan is read.
            with pytest.raises(ProblemError, match="invalid_plan"):
                loader.put_run("r1", plan())
        with pytest.raises(ProblemError, match="invalid_plan"):
            other.put_run("r1", plan())

        csv = "well,dpf,compound,concentration,concentration_unit\nA1,4,DMSO,0.5,%\nB02,5,MG132,10,uM\n"
        read = other.check_plate_map(csv)
        assert [(w.well, w.dpf, w.compound, w.concentration_unit) for w in read.plate_map] == [
            ("A01", 4.0, "DMSO", "%"),
            ("B02", 5.0, "MG132", "uM"),
        ]
        with pytest.raises(ProblemError, match="invalid_plate_map") as wrong:
            other.check_plate_map(csv.replace("B02", "Z99").replace("A1,4", "A1,old"))
        assert {mistake.line for mistake in wrong.value.problem.errors} == {2, 3}
