"""MADSci, PyLabRobot and SiLA 2, each by its own package, on one daemon with an emulated rig."""

from __future__ import annotations

import asyncio
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import httpx
import pytest
from madsci.client.node.rest_node_client import RestNodeClient
from madsci.common.types.action_types import ActionRequest
from madsci.common.types.workflow_types import WorkflowDefinition
from pylabrobot.machines import Machine
from pylabrobot.machines.backend import MachineBackend
from pylabrobot.resources import Coordinate, Resource, cor_96_wellplate_360uL_Fb
from pylabrobot.resources.barcode import Barcode
from rig import PATIENCE_S, Daemon, starter
from sila2.client import SilaClient
from sila2.framework import CommandExecutionStatus, DefinedExecutionError, ValidationError

from carved_client import CarvedClient, PlannedWell, ProblemError, TimedOut
from carved_client.integrations.pylabrobot import CarvedBackend, LarvaScanner, MeasurementFailed

T = TypeVar("T")
SOURCES = Path(__file__).parents[1] / "src"
BEAD_AND_EMPTY = "well,specimen,dpf\nA1,bead,\nA02,larva,5\n"
BEADS = "well,specimen\nA01,bead\nA03,bead\nA04,bead\n"


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    with starter(tmp_path_factory.mktemp("integrations")) as start:
        daemon = start("--no-demo", "--empty", "A02")
        daemon.ready().close()
        yield daemon


@pytest.fixture
def carved(daemon: Daemon) -> Iterator[CarvedClient]:
    """The instrument, ready for a run. Afterwards no fault stands and no run is under way, also if a test fails."""
    with daemon.ready() as client:
        yield client
        status = client.status()
        if status.run is not None and status.run.outcome is None:
            print(f"still under way: {status}")
            client.abort(status.run.id)
            status = client.wait_for_outcome(status.run.id, PATIENCE_S)
        for fault in status.faults:
            if not fault.ends_by_itself:
                client.acknowledge(fault.seq)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A home folder of its own. MADSci also reads the command line, which is that of pytest here."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder))
        patch.setattr(sys, "argv", sys.argv[:1])
        patch.chdir(folder)
        yield folder


def started(home: Path, module: str, *arguments: str) -> subprocess.Popen[str]:
    """A module of this package, as a user starts it."""
    environment = {**os.environ, "PYTHONPATH": str(SOURCES), "HOME": str(home)}
    command = [sys.executable, "-m", f"carved_client.integrations.{module}", *arguments]
    with (home / f"{module}.stderr").open("w") as errors:
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment, cwd=home)


def ended(process: subprocess.Popen[str]) -> None:
    process.terminate()
    assert process.stdout is not None
    process.stdout.close()
    process.wait(PATIENCE_S)


def wait_for(read: Callable[[], T], done: Callable[[T], bool], process: subprocess.Popen[str]) -> T:
    until = time.monotonic() + PATIENCE_S
    while not done(value := read()):
        assert process.poll() is None
        assert time.monotonic() < until, f"last seen: {value}"
        time.sleep(0.05)
    return value


def in_a_turn(carved: CarvedClient) -> None:
    """Returns when the capillary turns."""
    carved.wait_for(lambda s: s.specimen is not None and s.specimen.phase == "revolve", "a turn", PATIENCE_S)


class Node:
    """A MADSci node, and a workcell's client of it."""

    def __init__(self, daemon: Daemon, home: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            url = f"http://127.0.0.1:{free.getsockname()[1]}"
        self.process = started(home, "madsci", "--carved_url", daemon.url, "--node_url", url)
        self.client = RestNodeClient(url)
        self.map = home / "map.csv"
        wait_for(self._initialized, bool, self.process)

    def _initialized(self) -> bool:
        try:
            return not self.client.get_status().initializing
        except httpx.TransportError:
            return False

    def measure(self, plate_map: str, *, wait: bool = True) -> Any:
        self.map.write_text(plate_map)
        arguments = {"plate_barcode": "P-1", "operator": "kim"}
        request = ActionRequest(action_name="measure_plate", args=arguments, files={"plate_map": str(self.map)})
        started = self.client.send_action(request, await_result=False)
        return self._ended(started) if wait else started

    def act(self, name: str, **arguments: Any) -> Any:
        return self._ended(self.client.send_action(ActionRequest(action_name=name, args=arguments), await_result=False))

    def _ended(self, started: Any) -> Any:
        """The result of an action. `send_action` leaves out the errors of an action that fails after it has begun."""
        return self.client.await_action_result(started.action_id, timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def node(daemon: Daemon, home: Path) -> Iterator[Node]:
    node = Node(daemon, home)
    yield node
    ended(node.process)


@pytest.fixture(scope="module")
def sila_process(daemon: Daemon, home: Path) -> Iterator[subprocess.Popen[str]]:
    process = started(home, "sila", "--carved", daemon.url, "--listen", "127.0.0.1:0", "--no-discovery")
    yield process
    ended(process)


@pytest.fixture(scope="module")
def sila(sila_process: subprocess.Popen[str], home: Path) -> Iterator[SilaClient]:
    """An encrypted client that trusts the server by its certificate alone."""
    assert sila_process.stdout is not None
    address = re.search(r"127\.0\.0\.1:(\d+), clients trust (.*)", said := sila_process.stdout.readline())
    assert address is not None, said + (home / "sila.stderr").read_text()
    client = SilaClient("127.0.0.1", int(address[1]), root_certs=Path(address[2].strip()).read_bytes())
    yield client
    client.close()


def test_the_workflow_of_the_guide_is_one(home: Path) -> None:
    guide = (SOURCES.parents[2] / "docs" / "integrations.md").read_text()
    [workflow] = [block for block in re.findall(r"```yaml\n(.*?)```", guide, re.DOTALL) if "steps:" in block]
    (home / "workflow.yaml").write_text(workflow)
    steps = WorkflowDefinition.from_yaml(home / "workflow.yaml").steps
    assert [step.action for step in steps].count("measure_plate") == 1
    assert {step.node for step in steps} == {"carved_1"}


def test_a_madsci_workcell_measures_a_plate(node: Node, carved: CarvedClient) -> None:
    info = node.client.get_info()
    assert set(info.actions) == {"measure_plate", "prepare_handover", "complete_handover", "cancel_handover"}
    assert set(info.actions["measure_plate"].args) == {"plate_barcode", "method", "operator"}
    assert info.actions["measure_plate"].files["plate_map"].required
    commands = {"safety_stop", "pause", "resume", "cancel", "reset"}
    assert commands <= {command.value for command in info.capabilities.admin_commands}

    assert node.act("prepare_handover", intent="load", plate_barcode="P-1").status == "succeeded"
    assert node.act("complete_handover").status == "succeeded"
    result = node.measure(BEAD_AND_EMPTY)
    assert (result.status, result.errors) == ("succeeded", [])
    assert result.json_result["outcome"] == "succeeded"
    bead, empty = result.json_result["wells"]
    assert bead["diameter_um"] == pytest.approx(500.0, rel=0.01)
    assert (empty["well"], empty["outcome"], empty["reason"]) == ("A02", "skipped", "empty")
    assert carved.run(result.action_id)["plan"]["operator"] == "kim", "the run has the name of the action"
    assert any(result.action_id in str(entry) for entry in node.client.get_log().values())
    state = node.client.get_state()
    assert (state["plate"]["barcode"], state["instrument"]["name"]) == ("P-1", carved.status().instrument.name)

    wrong = node.measure("well,dpf\nA1,old\n")
    assert (wrong.status, wrong.errors[0].error_type) == ("failed", "invalid_plate_map")
    assert "line 2, dpf" in wrong.errors[0].message
    assert node.client.get_status().ready, "a mistake of the caller is no error of the node"
    refused = node.act("prepare_handover", intent="load", plate_barcode="P-2")
    assert (refused.status, refused.errors[0].error_type) == ("failed", "other_barcode")


def test_a_madsci_workcell_pauses_stops_and_resets(node: Node, carved: CarvedClient) -> None:
    def status() -> Any:
        return node.client.get_status()

    refused = node.client.send_admin_command("pause")
    assert (refused.success, refused.errors[0].message) == (False, "no run is under way")
    action = node.measure(BEADS, wait=False).action_id
    in_a_turn(carved)
    assert status().busy
    assert node.client.send_admin_command("pause").success
    assert status().paused
    wait_for(lambda: node.client.get_action_status(action), lambda s: s == "paused", node.process)
    carved.wait_for(lambda s: s.state == "Held", "the hold", PATIENCE_S)
    assert node.client.send_admin_command("resume").success
    wait_for(lambda: node.client.get_action_status(action), lambda s: s == "running", node.process)
    assert not status().paused

    in_a_turn(carved)
    assert node.client.send_admin_command("safety_stop").success
    result = node.client.await_action_result(action, timeout=PATIENCE_S)
    assert (result.status, result.json_result["wells"][0]["outcome"]) == ("cancelled", "succeeded")
    assert "emergency stop" in result.errors[0].message
    assert (status().stopped, status().ready, status().errors[0].error_type) == (True, False, "emergency_stop")
    assert node.measure(BEADS).status == "not_ready"
    assert node.client.send_admin_command("reset").success
    assert (status().stopped, status().ready) == (False, True)

    action = node.measure(BEADS, wait=False).action_id
    wait_for(lambda: carved.status().run_named(action), lambda run: run is not None, node.process)
    assert node.client.send_admin_command("cancel").success
    assert node.client.await_action_result(action, timeout=PATIENCE_S).errors[0].error_type == "aborted"


def test_a_pylabrobot_protocol(daemon: Daemon, carved: CarvedClient) -> None:
    backend = CarvedBackend(daemon.url)
    scanner = LarvaScanner("scanner", backend, 300.0, 400.0, 200.0, child_location=Coordinate(10.0, 20.0, 30.0))
    assert isinstance(scanner, Machine)
    assert isinstance(backend, MachineBackend)
    plate = cor_96_wellplate_360uL_Fb("plate")
    plate.barcode = Barcode("P-1", "Code 39", "front")
    again = Resource.deserialize(scanner.serialize())
    assert isinstance(again, LarvaScanner)
    assert again.serialize() == scanner.serialize()

    async def protocol() -> list[dict[str, Any]]:
        with pytest.raises(RuntimeError, match="setup has not finished"):
            await scanner.measure({"A1": None}, barcode="P-1")
        async with scanner:
            with pytest.raises(RuntimeError, match="does not expect a plate"):
                scanner.check_can_drop_resource_here(plate)
            async with scanner.handover("load", "P-1"):
                scanner.check_can_drop_resource_here(plate)
                scanner.assign_child_resource(plate)
            results: list[dict[str, Any]] = await scanner.measure(
                {"A1": PlannedWell("A01", "bead"), "A2": 5.0}, run_id="plr"
            )
            assert await scanner.measure({"A1": PlannedWell("A01", "bead"), "A2": 5.0}, run_id="plr") == results

            with pytest.raises(ProblemError, match="other_barcode"):
                await scanner.measure({"A1": 5.0}, barcode="P-2")
            beads = {"A1": PlannedWell("A01", "bead"), "A3": PlannedWell("A03", "bead")}
            measuring = asyncio.create_task(scanner.measure(beads, run_id="aborted"))
            await asyncio.to_thread(in_a_turn, carved)
            with pytest.raises(TimedOut, match="may not be moved"):
                await backend.prepare_handover("unload", "P-1", 0.1)
            await scanner.hold()
            await asyncio.to_thread(carved.wait_for, lambda s: s.state == "Held", "the hold", PATIENCE_S)
            await scanner.unhold()
            await asyncio.to_thread(in_a_turn, carved)
            await scanner.abort()
            with pytest.raises(MeasurementFailed, match="ended as aborted") as failed:
                await measuring
            first = failed.value.results[0]
            assert (first["well"], first["outcome"]) == ("A1", "succeeded")

            # Whoever leaves the block in the middle of a run leaves no run behind.
            measuring = asyncio.create_task(scanner.measure(beads, run_id="left"))
            await asyncio.to_thread(carved.wait_for, lambda s: s.run_named("left") is not None, "the run", PATIENCE_S)
        measuring.cancel()
        return results

    bead, empty = asyncio.run(protocol())
    assert (bead["well"], bead["outcome"], bead["diameter_um"]) == ("A1", "succeeded", pytest.approx(500.0, rel=0.01))
    assert (empty["well"], empty["outcome"], empty["reason"], empty["volume_um3"]) == ("A2", "skipped", "empty", None)
    left = carved.wait_for_outcome("left", PATIENCE_S).run
    assert left is not None
    assert left.outcome == "aborted"


def error_of(call: Callable[[], object]) -> str:
    """The identifier of the defined execution error that a call raises."""
    with pytest.raises(DefinedExecutionError) as raised:
        call()
    return str(raised.value).split(":")[0]


def done(execution: Any, process: subprocess.Popen[str]) -> Any:
    wait_for(lambda: execution.done, bool, process)
    return execution


def test_a_sila_client_measures_a_plate(
    sila: SilaClient, sila_process: subprocess.Popen[str], carved: CarvedClient
) -> None:
    assert sila.SiLAService.ServerType.get() == "Carved"
    measurement: Any = sila.PlateMeasurement  # type: ignore[attr-defined]
    execution = measurement.MeasurePlate("sila", "P-1", BEAD_AND_EMPTY, "standard", "kim")
    reports = list(execution.subscribe_to_intermediate_responses())
    assert "revolve" in {report.Phase for report in reports}
    assert [report.WellsDone for report in reports] == sorted(report.WellsDone for report in reports)
    assert done(execution, sila_process).status is CommandExecutionStatus.finishedSuccessfully
    answer = execution.get_responses()
    assert answer.Outcome == "succeeded"
    bead, empty = answer.Wells
    diameter = next(q for q in bead.Quantities if q.Name == "Diameter")
    assert (diameter.Value, diameter.Unit) == (pytest.approx(500.0, rel=0.01), "um")
    assert (empty.Well, empty.Outcome, empty.Reason, empty.Quantities) == ("A02", "skipped", "empty", [])
    assert tuple(measurement.GetResults("sila")) == tuple(answer)

    assert error_of(lambda: measurement.GetResults("never")) == "UnknownRun"
    with pytest.raises(ValidationError):
        measurement.GetResults("no name/")
    mistakes = {
        "InvalidPlan": ("sila-2", "P-1", "well,dpf\nZ99,old\n", "standard", "kim"),
        "RunRefused": ("sila", "P-1", BEADS, "standard", "kim"),
    }
    for code, arguments in mistakes.items():
        execution = measurement.MeasurePlate(*arguments)
        assert error_of(done(execution, sila_process).get_responses) == code


def test_a_sila_client_controls_a_run(
    sila: SilaClient, sila_process: subprocess.Popen[str], carved: CarvedClient
) -> None:
    measurement: Any = sila.PlateMeasurement  # type: ignore[attr-defined]
    control: Any = sila.RunControl  # type: ignore[attr-defined]
    handover: Any = sila.PlateHandover  # type: ignore[attr-defined]
    with sila.InstrumentStatus.Status.subscribe() as statuses:  # type: ignore[attr-defined]
        first = next(statuses)
        assert (first.Ready, first.Instrument) == (True, carved.status().instrument.name)
        assert error_of(control.HoldRun) == "NoRunUnderWay"
        execution = measurement.MeasurePlate("stopped", "P-1", BEADS, "standard", "kim")
        in_a_turn(carved)
        waiting = handover.PrepareHandover("unload", "P-1", 0.1)
        assert error_of(done(waiting, sila_process).get_responses) == "PlateNeeded"
        control.HoldRun()
        assert next(s for s in statuses if s.State == "Held").RunName == "stopped"
        # The first report with a reason can still be of "Holding".
        assert next(r for r in execution.subscribe_to_intermediate_responses() if r.State == "Held").HoldReason
        control.ResumeRun()
        in_a_turn(carved)
        control.EmergencyStop()
        assert error_of(done(execution, sila_process).get_responses) == "RunAborted"
        assert measurement.GetResults("stopped").Wells[0].Outcome == "succeeded"
        stopped = next(s for s in statuses if s.EmergencyStopped and s.RunOutcome)
        assert (stopped.RunOutcome, stopped.Ready) == ("aborted", False)
        fault = stopped.Faults[0]
        assert (fault.Code, fault.SchedulerAction) == ("emergency_stop", "escalate_operator")
        control.AcknowledgeFault(fault.Number)
        assert next(s for s in statuses if s.Ready).Faults == []
        done(handover.PrepareHandover("unload", "P-1", 60.0), sila_process).get_responses()
        handover.CompleteHandover()
        assert error_of(handover.CancelHandover) == "HandoverRefused"


def test_a_lost_and_found_instrument(
    daemon: Daemon, node: Node, sila: SilaClient, sila_process: subprocess.Popen[str]
) -> None:
    with sila.InstrumentStatus.Status.subscribe() as statuses:  # type: ignore[attr-defined]
        daemon.kill()
        status = node.client.get_status()
        assert (status.disconnected, status.ready) == (True, False)
        assert not next(s for s in statuses if not s.Connected).Ready
        daemon.start()
        daemon.ready().close()
        assert next(s for s in statuses if s.Connected and s.Ready).State
    assert node.client.get_status().ready
    recalled = node.client.get_action_result("sila")
    assert (recalled.status, recalled.json_result["outcome"]) == ("succeeded", "succeeded"), "a run of another process"
    assert node.client.get_action_status("never") == "unknown"
