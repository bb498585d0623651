"""A real daemon on the emulated rig, started as a user starts it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import pytest

from carved_client import CarvedClient, PlannedWell, RunPlan

REPOSITORY = Path(__file__).resolve().parents[3]
BINARY = Path(os.environ.get("CARVED_BIN", REPOSITORY / "target" / "debug" / "carved"))
#: Longer than anything takes here, even on a loaded machine. A hang then becomes a failure; nothing is timed with it.
PATIENCE_S = 240.0


def plan(*wells: str | PlannedWell, barcode: str = "P-1") -> RunPlan:
    mapped = tuple(PlannedWell(well, "bead") if isinstance(well, str) else well for well in wells)
    return RunPlan(plate_barcode=barcode, method="standard", operator="kim", plate_map=mapped)


class Daemon:
    """`carved simulate`, which can be killed and restarted with the same folder and port."""

    def __init__(self, folder: Path, *arguments: str, time_scale: int) -> None:
        self.folder = folder
        self.arguments = ("--small", "--time-scale", str(time_scale), *arguments)
        self.listen = "127.0.0.1:0"
        self.said = folder / "stdout"
        self.url = ""
        self.start()

    def start(self) -> None:
        command = [str(BINARY), "simulate", "--listen", self.listen, "--data", str(self.folder / "data")]
        command += self.arguments
        with self.said.open("wb") as said, (self.folder / "stderr").open("ab") as errors:
            environment = {**os.environ, "CARVED_LOG": "warn", "RUST_BACKTRACE": "0"}
            self.process = subprocess.Popen(command, stdout=said, stderr=errors, env=environment)
        until = time.monotonic() + PATIENCE_S
        while "http://" not in (text := self.said.read_text()):
            if self.process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"the daemon did not start: {(self.folder / 'stderr').read_text()}")
            time.sleep(0.02)
        self.url = text[text.index("http://") :].split()[0].rstrip("/")
        self.listen = self.url.removeprefix("http://")

    def kill(self) -> None:
        """Kills the process like a power cut: it closes nothing and reports nothing."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def ready(self) -> CarvedClient:
        """A client, once the instrument is ready for a run.

        A specimen that an aborted run has left, or that was being brought, is reported as out first.
        """
        client = CarvedClient(self.url)
        status = client.wait_for(lambda s: s.ready or s.plate.take_out is not None, "readiness", PATIENCE_S)
        if status.plate.take_out is not None and status.run is not None and status.run.outcome is not None:
            client.unloaded(status.run.id, status.plate.take_out)
        client.wait_for(lambda s: s.ready, "readiness", PATIENCE_S)
        return client


class Starter(Protocol):
    """Starts a daemon with the given arguments."""

    def __call__(self, *arguments: str, time_scale: int = 20) -> Daemon: ...


@contextmanager
def starter(folder: Path) -> Iterator[Starter]:
    """Starts daemons with their data in this folder, and ends them. Without a binary the test is skipped, or fails."""
    if not BINARY.is_file():
        reason = f"there is no daemon at {BINARY}: `cargo build --bin carved`, or set CARVED_BIN"
        if os.environ.get("CARVED_STRICT") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    started: list[Daemon] = []

    def start(*arguments: str, time_scale: int = 20) -> Daemon:
        data = folder / f"daemon-{len(started)}"
        data.mkdir()
        started.append(Daemon(data, *arguments, time_scale=time_scale))
        return started[-1]

    try:
        yield start
    finally:
        for daemon in started:
            daemon.end()
