"""B2: a data folder that is damaged in many ways before the daemon starts on it.

The folder has a finished run and one that a kill ended in the middle of a turn. The daemon goes on, or refuses to start with the
cause; it never panics, hangs, numbers an event twice, or changes a file of the finished run.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..kit.daemon import Daemon, DaemonError, free_port, panics, plan
from ..kit.disk import tree
from ..kit.row import Context, Observed, Row

Damage = Callable[[Path], object]


def _base(context: Context) -> Path:
    base = context.work / "base"
    with Daemon(context.binary, base, free_port(), "--time-scale", "10", log=context.work / "base.log") as daemon:
        daemon.start("done", plan(1, "bead"))
        daemon.wait_ended("done")
        daemon.start("open", plan(4, "bead"))
        daemon.wait("A02 in mid-turn", lambda s: s["specimen"] and s["specimen"]["well"] == "A02" and s["specimen"]["view"] > 6, 300, 0.02)
        daemon.kill()
    return base


def _write(path: str, content: bytes) -> Damage:
    return lambda data: (data / path).write_bytes(content)


def _append(path: str, content: bytes) -> Damage:
    def damage(data: Path) -> None:
        with open(data / path, "ab") as file:
            file.write(content)

    return damage


def _cut(path: str, length: int) -> Damage:
    return lambda data: os.truncate(data / path, length if length >= 0 else (data / path).stat().st_size + length)


def _unlink(*paths: str) -> Damage:
    def damage(data: Path) -> None:
        for path in paths:
            (data / path).unlink(missing_ok=True)

    return damage


def _edit(path: str, change: Callable[[Any], Any]) -> Damage:
    def damage(data: Path) -> None:
        value = json.loads((data / path).read_text())
        change(value)
        (data / path).write_text(json.dumps(value))

    return damage


def _line(number: int, change: Callable[[Any], Any]) -> Damage:
    def damage(data: Path) -> None:
        lines = (data / "events.jsonl").read_text().splitlines()
        value = json.loads(lines[number])
        change(value)
        lines[number] = json.dumps(value)
        (data / "events.jsonl").write_text("\n".join(lines) + "\n")

    return damage


def _garbage_line(data: Path) -> None:
    lines = (data / "events.jsonl").read_text().splitlines()
    lines[5] = "garbage"
    (data / "events.jsonl").write_text("\n".join(lines) + "\n")


def _folder_instead(path: str) -> Damage:
    def damage(data: Path) -> None:
        (data / path).unlink(missing_ok=True)
        (data / path).mkdir()

    return damage


def _file_instead(path: str) -> Damage:
    def damage(data: Path) -> None:
        shutil.rmtree(data / path)
        (data / path).write_text("x")

    return damage


def _strange_names(data: Path) -> None:
    (data / "runs/loop").symlink_to("loop")
    (data / "runs/file").write_text("x")
    (data / "runs/\u00fc\u9b5a x").mkdir()
    os.mkdir(os.fsencode(data / "runs") + b"/\xff\xfe")
    (data / "runs/.hidden").mkdir()
    os.mkfifo(data / "runs/pipe")


def _pipe_as_record(data: Path) -> None:
    (data / "runs/third").mkdir()
    os.mkfifo(data / "runs/third/run.json")


def _two_open_runs(data: Path) -> None:
    shutil.copytree(data / "runs/open", data / "runs/open2")
    _edit("runs/open2/run.json", lambda j: j.update(id="open2"))(data)


def _sql(*statements: str) -> Damage:
    def damage(data: Path) -> None:
        connection = sqlite3.connect(data / "index.sqlite")
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()

    return damage


_INDEX = ("index.sqlite", "index.sqlite-wal", "index.sqlite-shm")


def _junk_index(data: Path) -> None:
    _unlink(*_INDEX)(data)
    (data / _INDEX[0]).write_bytes(bytes((i * 31) % 253 for i in range(8192)))


def damages() -> dict[str, Damage]:
    """All damages by name."""
    run, recording = "runs/open/run.json", "runs/open/A02/recording.json"

    def other_well(j: Any) -> None:
        j["wells"][1].update(well="../x")
        j["plan"]["plate_map"][1].update(well="../x")

    return {
        "nothing": lambda data: None,
        "journal: torn last line": _append("events.jsonl", b'{"id": 99'),
        "journal: last line cut": _cut("events.jsonl", -5),
        "journal: empty": _write("events.jsonl", b""),
        "journal: gone": _unlink("events.jsonl"),
        "journal: a folder": _folder_instead("events.jsonl"),
        "journal: zeros at the end": _append("events.jsonl", b"\0" * 4096),
        "journal: garbage at the end": _append("events.jsonl", bytes(range(128, 256)) * 32),
        "journal: a line in the middle is garbage": _garbage_line,
        "journal: last number is 2^64-1": _line(-1, lambda j: j.update(id=2**64 - 1)),
        "journal: last number is 2^63": _line(-1, lambda j: j.update(id=2**63)),
        "journal: a number twice": _line(-1, lambda j: j.update(id=3)),
        "journal: number is text": _line(-1, lambda j: j.update(id="x")),
        "journal: time is nonsense": _line(-1, lambda j: j.update(time="yesterday")),
        "journal: unknown kind": _line(-1, lambda j: j.update(kind="x.y", data=[1])),
        "open run: its journal is gone": _unlink("runs/open/events.jsonl"),
        "open run: its journal is garbage": _write("runs/open/events.jsonl", b"garbage\n" * 20),
        "open run: record empty": _write(run, b""),
        "open run: record cut": _cut(run, 300),
        "open run: record of a newer schema": _edit(run, lambda j: j.update(schema="carved.run/9")),
        "open run: name leads out": _edit(run, lambda j: j.update(id="../../evil")),
        "open run: name of another run": _edit(run, lambda j: j.update(id="done")),
        "open run: no wells": _edit(run, lambda j: j.update(wells=[])),
        "open run: a well leads out": _edit(run, other_well),
        "open run: method with a voxel of 0": _edit(run, lambda j: j["method"].update(voxel_um=0)),
        "open run: method with a voxel of 1e-3": _edit(run, lambda j: j["method"].update(voxel_um=1e-3)),
        "open run: unknown method": _edit(run, lambda j: j["plan"].update(method="gone")),
        "open run: wells of another plan": _edit(run, lambda j: j["wells"].pop()),
        "open well: record empty": _write(recording, b""),
        "open well: record cut": _cut(recording, 400),
        "open well: record gone": _unlink(recording),
        "open well: accepted with few views": _edit(recording, lambda j: j.update(accepted=True)),
        "open well: a file": _file_instead("runs/open/A02"),
        "open well: frames is a file": _file_instead("runs/open/A02/frames"),
        "open well: attempt 1 is there": lambda data: shutil.copytree(data / "runs/open/A02", data / "runs/open/A02.attempt-1"),
        "open well: attempt 2^32-1 is there": lambda data: (data / "runs/open/A02.attempt-4294967295").mkdir(),
        "finished well: measurement cut": _cut("runs/open/A01/measurement.json", 100),
        "finished well: gone": lambda data: shutil.rmtree(data / "runs/open/A01"),
        "finished run: record is a folder": _folder_instead("runs/done/run.json"),
        "runs: link, file, other letters, pipe": _strange_names,
        "runs: a record that is a pipe": _pipe_as_record,
        "runs: two open ones": _two_open_runs,
        "index: of a newer version": _sql("PRAGMA user_version=999"),
        "index: junk": _junk_index,
        "index: gone": _unlink(*_INDEX),
        "index: a folder": lambda data: None,
        "index: its log is junk": _write("index.sqlite-wal", bytes(range(256)) * 160),
        "index: tables dropped": _sql("DROP TABLE events", "DROP TABLE specimens"),
        "instrument: damaged": _write("instrument.json", b'{"schema": "carved.instrumenu/1"}'),
        "queue: damaged": _write("queue.json", b"{"),
        "lock: a folder": _folder_instead("lock"),
        "lock: junk": _write("lock", b"\0" * 9999),
    }


def _start(context: Context, data: Path, log: Path) -> tuple[str, list[str]]:
    """Starts on the folder, looks and ends. What happened, and what must not happen."""
    wrong = []
    try:
        daemon = Daemon(context.binary, data, free_port(), "--time-scale", "10", log=log, wait_s=40)
    except DaemonError as error:
        said = str(error)
        # A refusal says what is wrong, on the last line.
        return f"refuses: {said[-120:]}", ["it neither starts nor ends"] if "not ready" in said else []
    with daemon:
        try:
            status = daemon.wait_started()
            end = time.monotonic() + 3
            while time.monotonic() < end:
                status = daemon.status()
                run = status["run"]
                if run is None or run["outcome"] or (status["state"] == "Held" and not run["goes_on_by_itself"]):
                    break
                time.sleep(0.1)
            listed = daemon.http("GET", "/v1/runs")
            # Without an index the runs cannot be listed, and the status says so.
            if listed.status != 200 and not (listed.status == 503 and daemon.status()["hardware"]["index_trouble"]):
                wrong.append(f"the runs are answered by {listed.status}")
            told = f"{status['state']}, run {status['run'] and status['run']['id']}"
        except (DaemonError, OSError) as error:
            return "starts", [f"{error}"]
        code, took = daemon.end(patience_s=20)
        if code != 0:
            wrong.append(f"exit code {code} after {took:.1f} s")
    return told, wrong


def run(context: Context) -> Observed:
    """Starts the daemon on `count` of the damaged folders, evenly chosen."""
    observed, base = Observed(""), _base(context)
    every = list(damages().items())
    size = min(context.count, len(every))
    refused = 0
    for n in range(size):
        name, damage = every[n * len(every) // size]
        data, log = context.work / "data", context.work / f"case{n}.log"
        shutil.rmtree(data, ignore_errors=True)
        shutil.copytree(base, data)
        damage(data)
        before = {path: digest for path, digest in tree(data / "runs/done").items()}
        told, wrong = _start(context, data, log)
        refused += told.startswith("refuses")
        if context.control:
            for path in (data / "runs/done").glob("*/measurement.json"):
                path.write_text("{}")
        wrong += panics(log)
        after = tree(data / "runs/done")
        wrong += [f"it changed {path} of the finished run" for path, digest in before.items() if after.get(path) != digest]
        numbers = [] if (data / "events.jsonl").is_dir() else _numbers(data)
        if numbers != sorted(set(numbers)) and name not in ("journal: a number twice",):
            wrong.append("events have the same number or fall")
        observed.misses += [f"{name}: {what}" for what in wrong]
        context.say(f"{name}: {told}{' MISS ' + str(wrong) if wrong else ''}")
    observed.done = f"{size} of {len(every)} damages of a folder with a finished and an interrupted run, a start on each"
    observed.figures.append(f"{size - refused} starts went on, {refused} were refused with the cause")
    return observed


def _numbers(data: Path) -> list[int]:
    found = []
    raw = (data / "events.jsonl").read_bytes() if (data / "events.jsonl").exists() else b""
    for line in raw.splitlines():
        try:
            number = json.loads(line)["id"]
        except (ValueError, KeyError, TypeError):
            continue
        if isinstance(number, int):
            found.append(number)
    return found


ROW = Row(
    "B2",
    "a damaged data folder at a start",
    "0 panics, 0 hangs; goes on or refuses with the cause; no event number twice; no file of a finished run changed",
    (3, 50, 50),
    "damages",
    "a file of the finished run is changed after the start",
    r"it changed .*measurement.json of the finished run$",
    run,
)
