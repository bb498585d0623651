"""R1: kill -9 at random moments. Everything that was heard by SSE is held against the dead disk."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

from ..kit.daemon import Daemon, DaemonError, Status, free_port, panics, plan
from ..kit.disk import files_that_differ, journal, pixels_sha256, read_json, sha256
from ..kit.row import Context, Observed, Row, percentile
from ..kit.sse import Event, Listener

WELLS = 8


class DeadDisk:
    """Holds what was heard against what a killed daemon left."""

    def __init__(self, data: Path, listener: Listener, observed: Observed) -> None:
        self.data, self.listener, self.observed = data, listener, observed
        self.events_checked = self.views_checked = 0
        self._journal_was = b""
        self._done: dict[tuple[str, str], str] = {}
        self._frames: dict[tuple[Path, int], str] = {}

    def check(self, when: str) -> None:
        """Checks everything after one kill."""
        heard = self.listener.events()
        self._check_journal(heard, when)
        self._check_views(heard, when)
        self._check_finished(heard, when)

    def _check_journal(self, heard: list[Event], when: str) -> None:
        path = self.data / "events.jsonl"
        raw = path.read_bytes()
        self.observed.expect(raw.startswith(self._journal_was), f"{when}: events.jsonl was rewritten")
        self._journal_was = raw[: raw.rfind(b"\n") + 1]
        written = journal(path)
        numbers = [event["id"] for event in written]
        self.observed.expect(numbers == list(range(1, len(numbers) + 1)), f"{when}: the numbers of the events have gaps or repeat")
        of_run: dict[str, dict[int, Event]] = {}
        by_id = {event["id"]: event for event in written}
        for event in heard:
            self.events_checked += 1
            number, run = event["id"], event.get("run")
            self.observed.expect(
                by_id.get(number) == event, f"{when}: event {number} ({event['kind']}) was heard and is not in the journal"
            )
            if run and event["kind"] != "view.taken":
                if run not in of_run:
                    of_run[run] = {e["id"]: e for e in journal(self.data / "runs" / run / "events.jsonl")}
                self.observed.expect(of_run[run].get(number) == event, f"{when}: event {number} is not in the journal of its run")

    def _check_views(self, heard: list[Event], when: str) -> None:
        """Views of specimens without a result are in the ledger, with the pixels that the ledger names."""
        taken: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for event in heard:
            key = (event.get("run") or "", event.get("well") or "")
            kind, data = event["kind"], event["data"] or {}
            begins = kind == "specimen.phase" and data.get("phase") in ("load", "position")
            if begins or kind in ("specimen.tried_again", "specimen.done"):
                taken.pop(key, None)
            elif kind == "view.taken":
                taken.setdefault(key, []).append(data)
        for (run, well), views in taken.items():
            folder = self.data / "runs" / run / well
            if not (folder / "recording.json").exists():
                self.observed.misses.append(f"{when}: {len(views)} views of {run}/{well} were heard, no recording.json")
                continue
            ledger = {(e["view"], e["closure"], e["achieved_steps"]): e for e in read_json(folder / "recording.json")["ledger"]}
            for view in views:
                self.views_checked += 1
                entry = ledger.get((view["index"], view["closure"], view["achieved_steps"]))
                name = f"{run}/{well} view {view['index']}"
                if entry is None:
                    self.observed.misses.append(f"{when}: {name} was heard and is not in the ledger")
                elif not entry.get("retake"):
                    frame = folder / "frames" / ("closure.png" if view["closure"] else f"view_{view['index']:03d}.png")
                    self.observed.expect(self._pixels(frame) == entry["sha256"], f"{when}: {name} has other pixels than its ledger says")

    def _pixels(self, frame: Path) -> str | None:
        if not frame.exists():
            return None
        key = (frame, frame.stat().st_mtime_ns)
        if key not in self._frames:
            self._frames[key] = pixels_sha256(frame)
        return self._frames[key]

    def _check_finished(self, heard: list[Event], when: str) -> None:
        """Finished specimens stay as they are, bit for bit."""
        for event in heard:
            if event["kind"] != "specimen.done" or event["data"].get("outcome") not in ("succeeded", "flagged"):
                continue
            key = (event["run"], event["well"])
            folder = self.data / "runs" / key[0] / key[1]
            if not (folder / "SHA256SUMS").exists():
                # The sums of a well are written beside the next specimen. The next start writes them if a kill comes first.
                self.observed.expect(key not in self._done, f"{when}: {key} has lost its SHA256SUMS")
                continue
            sums = sha256(folder / "SHA256SUMS")
            first_time = key not in self._done
            self.observed.expect(self._done.setdefault(key, sums) == sums, f"{when}: SHA256SUMS of {key} have changed")
            if first_time:
                self._differs(folder, when)

    def _differs(self, folder: Path, when: str) -> None:
        differ = files_that_differ(folder)
        self.observed.expect(not differ, f"{when}: {differ} in {folder.name} differ from SHA256SUMS")

    def check_end(self, lives: list[float]) -> int:
        """Checks all recordings at the end. Returns how many there are."""
        for run, well in self._done:
            self._differs(self.data / "runs" / run / well, "at the end")
        recordings = sorted(self.data.glob("runs/*/*/recording.json"))
        for path in recordings:
            recording, name = read_json(path), f"{path.parts[-3]}/{path.parts[-2]}"
            epochs = {entry["epoch"] for entry in recording["ledger"]}
            self.observed.expect(len(epochs) <= 1, f"{name} mixes views of {len(epochs)} references")
            written = [frame.stat().st_mtime for frame in path.parent.glob("frames/view_*.png")]
            of_life = {sum(began <= at for began in lives) for at in written}
            self.observed.expect(len(of_life) <= 1, f"{name} mixes frames of {len(of_life)} lives of the daemon")
        return len(recordings)


def _resume(daemon: Daemon, number: int) -> int:
    """Continues the open run, or starts the next one. Returns the number of the newest run."""
    status = daemon.wait_started()
    run = status["run"]
    if run is None or run["outcome"] is not None:
        number += 1
        daemon.start(f"r{number:03d}", plan(WELLS, "mixed"))
    elif status["state"] == "Held" and not run["goes_on_by_itself"]:
        daemon.continue_run()
    return number


def _wait_moment(context: Context, daemon: Daemon) -> Status:
    """A random moment. Two of three are in a turn, where most is written; the others are anywhere."""
    if context.random.random() < 2 / 3:
        view = context.random.randrange(22)
        with contextlib.suppress(DaemonError):
            daemon.wait("view", lambda s: (s["specimen"] or {}).get("view", 0) >= view and s["specimen"]["phase"] == "revolve", 60, 0.02)
        time.sleep(context.random.uniform(0, 0.3))
    else:
        time.sleep(context.random.uniform(0, 15))
    return daemon.status()


def _check_order(heard: list[Event], observed: Observed) -> None:
    """Each well is done once, in the order of the plan."""
    done: dict[str, list[str]] = {}
    for event in heard:
        if event["kind"] == "specimen.done":
            done.setdefault(event["run"], []).append(event["well"])
    planned = [entry["well"] for entry in plan(WELLS)["plate_map"]]
    for run, wells in done.items():
        observed.expect(wells == planned[: len(wells)], f"{run}: wells were done in the order {wells}")


def _check_wells_done(daemon: Daemon, heard: list[Event], observed: Observed, when: str) -> None:
    status = daemon.wait_started()
    run = status["run"]
    if run is None:
        return
    outcomes = {result["well"]: result["outcome"] for result in run["results"]}
    for event in heard:
        if event["kind"] == "specimen.done" and event["run"] == run["id"]:
            observed.expect(outcomes.get(event["well"]) is not None, f"{when}: the result of {event['well']} is lost")


def run(context: Context) -> Observed:
    """Kills the daemon `count` times, then lets it finish."""
    observed = Observed("")
    data, log, port = context.work / "data", context.work / "daemon.log", free_port()
    listener = Listener(port)
    disk = DeadDisk(data, listener, observed)
    lives: list[float] = []
    ready: list[float] = []
    phases: dict[str, int] = {}
    number = kills = 0

    def life() -> Daemon:
        lives.append(time.time())
        return Daemon(context.binary, data, port, "--time-scale", "10", log=log)

    while kills < context.count:
        when = f"kill {kills + 1}"
        daemon = life()
        ready.append(daemon.ready_s or 0)
        if kills and context.random.random() < 0.1:
            phase = "start"
        else:
            _check_wells_done(daemon, listener.events(), observed, when)
            number = _resume(daemon, number)
            status = _wait_moment(context, daemon)
            phase = (status["specimen"] or {}).get("phase") or status["state"]
        phases[phase] = phases.get(phase, 0) + 1
        daemon.kill()
        kills += 1
        # What is in the sockets' buffers was acknowledged too.
        time.sleep(0.2)
        if context.control:
            text = (data / "events.jsonl").read_bytes()
            (data / "events.jsonl").write_bytes(text[: text[:-1].rfind(b"\n") + 1])
        disk.check(when)
        context.say(f"{when} in {phase}: {disk.events_checked} events, {disk.views_checked} views checked, {len(observed.misses)} misses")
        if context.control:
            break
    if not context.control:
        with life() as daemon:
            _check_wells_done(daemon, listener.events(), observed, "last start")
            number = _resume(daemon, number)
            daemon.wait_ended_over_faults(f"r{number:03d}", 900)
            # The sums of the last well are written after the end of the run.
            daemon.end()
        disk.check("at the end")
        recordings = disk.check_end(lives)
        attempts = len(list(data.glob("runs/*/*.attempt-*")))
        observed.figures += [f"{recordings} recordings, of which {attempts} attempts that a kill or a fault ended"]
    _check_order(listener.events(), observed)
    observed.expect(disk.events_checked > 0, "no event was heard")
    observed.expect(not listener.conflicts, f"events were sent twice with other contents: {listener.conflicts[:5]}")
    for line in panics(log):
        observed.misses.append(line)
    listener.end()
    where = ", ".join(f"{phase} {n}" for phase, n in sorted(phases.items()))
    observed.done = f"{kills} kills in {number} runs of {WELLS} wells; in {where}"
    observed.figures.insert(
        0, f"{disk.events_checked} comparisons of heard events and {disk.views_checked} of heard views with the dead disk"
    )
    slowest = percentile(ready, 1)
    observed.figures.append(f"ready again after at most {slowest:.1f} s" if slowest else "")
    return observed


ROW = Row(
    "R1",
    "kill -9 at random points of a run",
    "0 acknowledged views lost; the specimen under way is begun again and views of two lives are never mixed; the plate goes on at "
    "the right well; finished specimens stay bit-identical",
    (2, 25, 1000),
    "kills",
    "after a kill, the last line of the journal is removed",
    r"was heard and is not in the journal$",
    run,
)
