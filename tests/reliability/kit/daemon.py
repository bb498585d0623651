"""One life of the daemon under test, on the emulated rig or by a configuration."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import http

Status = dict[str, Any]


class DaemonError(Exception):
    """The daemon did not start, ended, or did not become what was waited for."""


@dataclass(frozen=True)
class Usage:
    """What the process uses."""

    rss_mb: float
    threads: int
    descriptors: int


def free_port() -> int:
    """A port that nobody listens on, outside the range from which the kernel takes ports of clients."""
    for port in range(20000 + os.getpid() % 9000, 32000):
        with socket.socket() as s:
            try:
                s.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise DaemonError("no free port between 20000 and 32000")


class Daemon:
    """`carved simulate` without its demo plate, or the command `command`."""

    def __init__(
        self,
        binary: Path,
        data: Path,
        port: int,
        *options: str,
        log: Path,
        environment: dict[str, str] | None = None,
        command: Sequence[str | Path] | None = None,
        token: str | None = None,
        wait_s: float | None = 90,
    ) -> None:
        self.port, self.data, self.log, self.token = port, data, log, token
        # The simulation leaves A04 empty unless it is told otherwise.
        simulate: list[str | Path] = [
            binary,
            "simulate",
            "--no-demo",
            "--empty",
            "P24",
            "--listen",
            f"127.0.0.1:{port}",
            "--data",
            data,
            *options,
        ]
        self.started = time.monotonic()
        with open(log, "ab") as out:
            self.process = subprocess.Popen(
                list(command) if command else simulate,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                env={**os.environ, "CARVED_LOG": "info", **(environment or {})},
            )
        self.ready_s: float | None = None
        if wait_s is not None:
            self.wait_ready(wait_s)

    @property
    def pid(self) -> int:
        """The id of the process."""
        return self.process.pid

    def wait_ready(self, patience_s: float) -> Status:
        """Waits for the first status."""
        while time.monotonic() - self.started < patience_s:
            if self.process.poll() is not None:
                raise DaemonError(f"the daemon ended with {self.process.returncode}: {self.last_lines()}")
            try:
                answer = self.http("GET", "/v1/status", timeout=5)
                if answer.status == 200:
                    self.ready_s = time.monotonic() - self.started
                    status: Status = answer.json()
                    return status
            except OSError:
                pass
            time.sleep(0.02)
        self.kill()
        raise DaemonError(f"the daemon was not ready within {patience_s} s: {self.last_lines()}")

    def http(
        self,
        method: str,
        path: str,
        body: object = None,
        headers: dict[str, str] | None = None,
        timeout: float = 20,
    ) -> http.Answer:
        """Sends one request, with the token if there is one."""
        sent = dict(headers or {})
        if self.token:
            sent.setdefault("Authorization", f"Bearer {self.token}")
        return http.request(self.port, method, path, body, sent, timeout)

    def status(self, timeout: float = 20) -> Status:
        """The status."""
        status: Status = self.http("GET", "/v1/status", timeout=timeout).json()
        return status

    def start(self, run: str, plan: dict[str, Any], patience_s: float = 60) -> None:
        """Starts a run. A refusal that asks to come back later is repeated."""
        end = time.monotonic() + patience_s
        while True:
            answer = self.http("PUT", f"/v1/runs/{run}", plan)
            if answer.status in (200, 201):
                return
            if answer.status not in (409, 429, 503) or time.monotonic() > end:
                raise DaemonError(f"{run} was refused: {answer.status} {answer.body.decode(errors='replace')[:300]}")
            time.sleep(0.2)

    def wait(self, what: str, test: Callable[[Status], Any], patience_s: float = 300, every_s: float = 0.05) -> Status:
        """Waits for a status for which `test` is true."""
        end = time.monotonic() + patience_s
        while True:
            status = self.status()
            if test(status):
                return status
            if time.monotonic() > end:
                faults = [f["code"] for f in status["faults"]]
                raise DaemonError(f"no {what} within {patience_s} s: {status['state']}, {status['doing']} {faults}")
            time.sleep(every_s)

    def wait_started(self) -> Status:
        """Waits until the daemon has taken up what it found on disk."""
        return self.wait("end of the start", lambda s: s["not_ready_reason"] != "starting", 60, 0.02)

    def wait_ended(self, run: str, patience_s: float = 600) -> Status:
        """Waits for the outcome of a run."""
        return self.wait(
            f"end of {run}",
            lambda s: s["run"] and s["run"]["id"] == run and s["run"]["outcome"] is not None,
            patience_s,
        )

    def wait_ended_over_faults(self, run: str, patience_s: float = 600) -> Status:
        """Waits for the outcome of a run, and continues it where a fault holds it."""
        end = time.monotonic() + patience_s
        while True:
            status = self.wait(
                f"end or hold of {run}", lambda s: s["run"] and (s["run"]["outcome"] is not None or s["state"] == "Held"), patience_s
            )
            if status["run"]["outcome"] is not None:
                return status
            if time.monotonic() > end:
                raise DaemonError(f"{run} is held again and again: {status['doing']}")
            if not status["run"]["goes_on_by_itself"]:
                self.continue_run()
            time.sleep(0.2)

    def wait_phase(self, phases: Sequence[str], patience_s: float = 120) -> Status:
        """Waits until a specimen is in one of these phases."""
        return self.wait(f"phase {phases}", lambda s: (s["specimen"] or {}).get("phase") in phases, patience_s, 0.02)

    def acknowledge(self) -> None:
        """Acknowledges all faults."""
        for fault in self.status()["faults"]:
            self.http("POST", f"/v1/faults/{fault['seq']}/acknowledge")

    def continue_run(self) -> None:
        """Acknowledges all faults and continues the run that is held."""
        status = self.status()
        for fault in status["faults"]:
            self.http("POST", f"/v1/faults/{fault['seq']}/acknowledge")
        self.http("POST", f"/v1/runs/{status['run']['id']}/unhold")

    def usage(self) -> Usage:
        """Memory, threads and descriptors of the process."""
        fields = dict(line.split(":", 1) for line in Path(f"/proc/{self.pid}/status").read_text().splitlines() if ":" in line)
        return Usage(
            int(fields["VmRSS"].split()[0]) / 1024,
            int(fields["Threads"]),
            len(os.listdir(f"/proc/{self.pid}/fd")),
        )

    def end(self, with_signal: signal.Signals = signal.SIGTERM, patience_s: float = 30) -> tuple[int | None, float]:
        """Sends a signal. Returns the exit code, or None if the process had to be killed, and the seconds it took."""
        sent = time.monotonic()
        if self.process.poll() is None:
            self.process.send_signal(with_signal)
        try:
            code: int | None = self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.kill()
            code = None
        return code, time.monotonic() - sent

    def kill(self) -> None:
        """Kills the process and waits for its end."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()

    def last_lines(self, count: int = 3) -> str:
        """The end of the log."""
        lines = self.log.read_text(errors="replace").splitlines()
        return " / ".join(lines[-count:])[-400:]

    def panics(self) -> list[str]:
        """Lines of the log that tell of a panic."""
        return panics(self.log)

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


def panics(log: Path) -> list[str]:
    """Lines of a log that tell of a panic."""
    return [line[:300] for line in log.read_text(errors="replace").splitlines() if "panicked at" in line]


WELLS = [f"{row}{column:02d}" for row in "ABCDEFGH" for column in range(1, 13)]


def plan(wells: int, kind: str = "larva", barcode: str = "P-1") -> dict[str, Any]:
    """A plan with larvae, with beads, or with both in turn (`mixed`)."""
    larva: dict[str, object] = {"specimen": "larva", "dpf": 4}
    bead: dict[str, object] = {"specimen": "bead"}
    kinds = {"larva": [larva], "bead": [bead], "mixed": [larva, bead]}[kind]
    return {
        "plate_barcode": barcode,
        "method": "standard",
        "operator": "reliability",
        "plate_map": [{"well": well, **kinds[n % len(kinds)]} for n, well in enumerate(WELLS[:wells])],
    }
