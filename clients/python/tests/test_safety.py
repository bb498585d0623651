"""Hold, stop, abort and emergency stop by the client."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from rig import PATIENCE_S, Daemon, plan

from carved_client import Event, ProblemError, Status


def turning(status: Status) -> bool:
    return status.specimen is not None and status.specimen.phase == "revolve"


def test_a_run_is_held_let_go_on_and_stopped(start_daemon: Callable[..., Daemon]) -> None:
    with start_daemon("--no-demo", time_scale=5).ready() as client:
        looked = client.preflight(plan("A01", "A02", "A03"))
        assert looked.passed
        assert all(check.passed or not check.blocks for check in looked.checks)
        client.put_run("r1", plan("A01", "A02", "A03"))
        client.wait_for(turning, "a turn", PATIENCE_S)
        client.hold("r1", by="Kim & Lee")
        client.hold("r1")
        held = client.wait_for(lambda s: s.state == "Held", "the hold", PATIENCE_S)
        assert held.run is not None
        asked = next(e for e in client.events(0) if isinstance(e, Event) and e.kind == "run.hold_requested")
        assert asked.data["by"] == "Kim & Lee"
        assert (held.run.outcome, held.run.wells.succeeded, held.run.wells.pending) == (None, 1, 2)
        client.unhold("r1")
        client.wait_for(lambda s: turning(s) and s.specimen is not None and s.specimen.well == "A02", "A02", PATIENCE_S)
        client.stop("r1")
        stopped = client.wait_for_outcome("r1", PATIENCE_S).run_named("r1")
        assert stopped is not None
        assert (stopped.outcome, stopped.wells.succeeded, stopped.wells.interrupted) == ("partial", 2, 1)
        assert client.stop("r1").revision > 0


def test_an_emergency_stop_latches_until_it_is_acknowledged(start_daemon: Callable[..., Daemon]) -> None:
    with start_daemon("--no-demo", time_scale=1).ready() as client:
        client.put_run("r1", plan("A01"))
        client.wait_for(turning, "a turn", PATIENCE_S)
        client.emergency_stop(by="Kim")
        client.emergency_stop()
        status = client.wait_for_outcome("r1", PATIENCE_S)
        assert status.run is not None
        assert status.run.outcome == "aborted"
        status = client.wait_for(lambda s: bool(s.faults), "the fault", PATIENCE_S)
        (fault,) = status.faults
        assert (fault.code, fault.operator_required, status.ready) == ("emergency_stop", True, False)
        assert "Pressed by Kim (the instrument's computer)." in fault.message
        with pytest.raises(ProblemError) as refused:
            client.put_run("r2", plan("A01"))
        assert refused.value.problem.fault_seq == fault.seq
        client.acknowledge(fault.seq)
        client.acknowledge(fault.seq)
        assert client.wait_for(lambda s: s.ready, "readiness", PATIENCE_S).faults == ()
        with pytest.raises(ProblemError, match="unknown_fault"):
            client.acknowledge(fault.seq + 7)
