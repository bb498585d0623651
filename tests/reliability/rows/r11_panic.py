"""R11: a panic in any thread of the daemon, and a daemon that hangs, under a supervisor that does what systemd does.

The preloaded shim makes one thread's reading of the monotonic clock fail, which Rust answers with a panic. The supervisor
speaks sd_notify: it kills a daemon whose watchdog pings stop, and starts it again one second after a failure, as the unit says.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ..kit.daemon import Daemon, DaemonError, Status, free_port, panics, plan
from ..kit.disk import read_json
from ..kit.row import Context, Observed, Row
from ..kit.shim import Shim

_WATCHDOG_S = 5.0
_RESTART_S = 1.0
_IDLE_S = 1.0
"""A thread that does not read the clock for so long is left alone."""
_THREADS_TRIED = 6


class Supervisor:
    """Starts the daemon as `systemd/carved.service` says, and starts it again."""

    def __init__(self, context: Context, shim: Shim) -> None:
        self._context, self._shim, self._port = context, shim, free_port()
        self.log = context.work / "daemon.log"
        self._path = context.work / "notify"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._path))
        self.ended_ns = 0
        """When the newest daemon that ended was seen to have ended, by the monotonic clock."""
        self.hung = False
        """Whether that daemon was killed by the watchdog."""
        self.daemon = self._start()

    def _start(self) -> Daemon:
        environment = {
            **self._shim.environment,
            "NOTIFY_SOCKET": str(self._path),
            "WATCHDOG_USEC": str(int(_WATCHDOG_S * 1e6)),
        }
        self.pinged = time.monotonic()
        self.ready = False
        self.ready_at: float | None = None
        data = self._context.work / "data"
        return Daemon(self._context.binary, data, self._port, "--time-scale", "10", log=self.log, environment=environment, wait_s=None)

    def _said(self) -> Iterator[str]:
        """What the daemon has said, from now on for 0.1 s if it is silent."""
        with contextlib.suppress(TimeoutError, BlockingIOError):
            self._socket.settimeout(0.1)
            while True:
                yield self._socket.recv(4096).decode()
                self._socket.settimeout(0)

    def turn(self) -> bool:
        """Reads what the daemon says, and ends and starts it where the unit does. Whether it was started again."""
        # All of it: the queue of such a socket is short, and what does not fit is lost.
        for said in self._said():
            if "READY=1" in said and not self.ready:
                self.ready, self.ready_at = True, time.monotonic()
            if "WATCHDOG=1" in said or "READY=1" in said:
                self.pinged = time.monotonic()
        hangs = self.ready and time.monotonic() - self.pinged > _WATCHDOG_S
        if hangs:
            self.daemon.kill()
        if self.daemon.process.poll() is None or self.daemon.process.returncode == 0:
            return False
        if self._context.control:
            return False
        self.ended_ns, self.hung = time.clock_gettime_ns(time.CLOCK_MONOTONIC), hangs
        time.sleep(_RESTART_S)
        self.daemon = self._start()
        return True

    def follow(self, run: str, until: Callable[[Status], bool], patience_s: float) -> Status | None:
        """The first status of the run for which `until` holds. Meanwhile the daemon is started again where it ends."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            self.turn()
            try:
                status = self.daemon.status(1)
                if not self.ready or status["run"] is None or status["run"]["id"] != run:
                    continue
                if until(status):
                    return status
                if status["state"] == "Held" and not status["run"]["goes_on_by_itself"]:
                    # A panic that the daemon outlives is `internal_error`, which a person acknowledges.
                    self.daemon.continue_run()
            except (OSError, DaemonError):
                continue
        return None

    def start_run(self, run: str) -> Status | None:
        """Starts a run and waits for its first views, or for its end: a daemon that an earlier panic has left without a thread may be
        restarted meanwhile.
        """
        end = time.monotonic() + 60
        while time.monotonic() < end:
            self.turn()
            try:
                if self.ready and self.daemon.status(1)["ready"]:
                    self.daemon.start(run, plan(2, "bead"))
                    return self.follow(run, lambda s: _views(s) > 0 or s["run"]["outcome"] is not None, 90)
            except (OSError, DaemonError):
                continue
        return None

    def end(self) -> None:
        """Ends the daemon."""
        self.daemon.end()
        self._socket.close()


def _views(status: Status) -> int:
    """Views of the specimen under way."""
    return int((status["specimen"] or {}).get("view", 0))


def _place(status: Status) -> tuple[str | None, int]:
    return (status["specimen"] or {}).get("well"), _views(status)


def _moved_on(place: tuple[str | None, int]) -> Callable[[Status], bool]:
    return lambda s: s["run"]["outcome"] is not None or (_views(s) > 0 and _place(s) != place)


def _threads(pid: int) -> dict[int, str]:
    """The daemon's own threads. Those of the emulated rig are not the product, and Aravis' are not written in Rust."""
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            name = (task / "comm").read_text().strip()
        except OSError:
            continue
        if not name.startswith(("sim-", "arv_", "gmain", "gdbus")):
            found[int(task.name)] = "main" if int(task.name) == pid else name
    return found


def _panic(supervisor: Supervisor, shim: Shim, context: Context, n: int) -> tuple[str, bool]:
    """Lets a thread panic. Its name, and whether it did: a thread that does not read the clock cannot be reached."""
    threads = _threads(supervisor.daemon.pid)
    # Each name in turn, so that the single driver is hit as often as the many workers.
    names = sorted(set(threads.values()))
    name = names[n % len(names)]
    called = [thread for thread, of_name in threads.items() if of_name == name]
    context.random.shuffle(called)
    for thread in called[:_THREADS_TRIED]:
        shim.panic(thread)
        end = time.monotonic() + _IDLE_S
        while shim.panic_is_due and time.monotonic() < end:
            supervisor.turn()
        if not shim.panic_is_due:
            return name, True
        shim.panic(0)
    return name, False


def _is_safe(supervisor: Supervisor, shim: Shim, began: int, name: str, observed: Observed) -> bool:
    """Whether a daemon that ended by a panic stopped the motor before its end. The next daemon resets the controller anyway."""
    stopped = any(at <= supervisor.ended_ns for at in shim.stops(began))
    observed.expect(stopped, f"panic in {name}: the daemon ended without a stop on the motor's wire")
    return stopped


def run(context: Context) -> Observed:
    """Lets `count` threads panic, one run each, and hangs the whole daemon once."""
    observed, shim = Observed("", machine_load=True), Shim(context.work)
    supervisor = Supervisor(context, shim)
    names: list[str] = []
    back_s: list[float] = []
    serves_s: list[float] = []
    survived = stops = aborts = hangs = idle = tries = 0
    hang = False
    while not hang:
        hang, tries = len(names) >= context.count or tries >= 3 * context.count, tries + 1
        run_id, told = f"p{tries:03d}", len(panics(supervisor.log))
        status = supervisor.start_run(run_id)
        if status is None:
            observed.misses.append(f"{run_id} could not be started")
            break
        if status["run"]["outcome"] is not None and tries <= 4 * context.count:
            hang = False
            continue
        began, pid, place = time.clock_gettime_ns(time.CLOCK_MONOTONIC), supervisor.daemon.pid, _place(status)
        if hang:
            name, panicked = "the whole process", True
            os.kill(pid, signal.SIGSTOP)
        else:
            name, panicked = _panic(supervisor, shim, context, tries)
        what = f"{'hang of' if hang else 'panic in'} {name}"
        if panicked:
            names.append(name)
            status = supervisor.follow(run_id, _moved_on(place), 90)
            took = (time.clock_gettime_ns(time.CLOCK_MONOTONIC) - began) / 1e9
            if status is None:
                observed.misses.append(f"{what}: no view and no end within 90 s")
                break
            if supervisor.daemon.pid != pid:
                back_s.append(took)
                if supervisor.ready_at is not None:
                    serves_s.append(supervisor.ready_at - began / 1e9)
        else:
            idle += 1
        status = supervisor.follow(run_id, lambda s: s["run"]["outcome"] is not None, 200)
        outcomes = [result["outcome"] for result in status["run"]["results"]] if status else ["no end within 200 s"]
        observed.expect(all(outcome in ("succeeded", "flagged") for outcome in outcomes), f"{what}: the wells ended as {outcomes}")
        if not panicked:
            continue
        # A panic that takes the runtime down ends the process after a while, in which views may come.
        restarted, by_rust = supervisor.daemon.pid != pid, len(panics(supervisor.log)) > told
        how = ("restarted by the watchdog" if supervisor.hung else "restarted") if restarted else "it went on"
        context.say(f"{what}: took the next view after {took:.1f} s, {how}, a panic of Rust: {by_rust}")
        if not restarted:
            survived += 1
        elif supervisor.hung:
            hangs += not hang
        elif by_rust:
            stops += _is_safe(supervisor, shim, began, name, observed)
        else:
            aborts += 1
    supervisor.end()
    for path in (context.work / "data").glob("runs/*/*/recording.json"):
        epochs = {entry["epoch"] for entry in read_json(path)["ledger"]}
        observed.expect(len(epochs) <= 1, f"{path.parent}: views of {len(epochs)} references in one recording")
    told = len(panics(supervisor.log))
    observed.expect(context.control or told + aborts > 0, "no thread panicked")
    if not context.control:
        observed.not_judged.append("motors safe after an abort or a hang: `carved halt` of the unit does it, `make deb-test`")
        if not stops and not observed.misses:
            observed.not_judged.append("motors safe after a panic: no panic ended the daemon")
    observed.done = (
        f"{len(names) - hang} panics, each in mid-turn, in threads called {', '.join(sorted(set(names) - {'the whole process'}))}, and a "
        "hang of the whole process (SIGSTOP), under a supervisor that speaks sd_notify; on a booted systemd: `make deb-test`"
    )
    # GLib, of which Aravis is made, ends the process where Rust would panic.
    observed.figures += [
        f"{told} panics of Rust and {aborts} aborts of GLib; {stops} times the daemon ended itself after a stop on the motor's wire, "
        f"{hangs} times the watchdog ended it, {survived} times it went on",
        f"in {idle} further runs the chosen threads did not read the clock, so they did not panic",
    ]
    if serves_s:
        observed.figures.append(f"from the panic or hang to a daemon that serves again, slowest {max(serves_s):.1f} s")
    observed.at_most("from the panic or hang to the next view after a restart, slowest", max(back_s, default=None), 10 + _WATCHDOG_S, "s")
    return observed


ROW = Row(
    "R11",
    "panic in any task",
    "motors stopped before a daemon that panicked ends, watchdog restart, resume within 10 s (a hang is seen 5 s later, by the watchdog)",
    (1, 6, 100),
    "panics",
    "the supervisor starts nothing again",
    r"no view and no end within",
    run,
)
