"""The simulated plate-loader with the emulated instrument: a plate over a bad line, and over power cuts."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from rig import PATIENCE_S, REPOSITORY, Daemon, plan

from carved_client import Status
from carved_client.simulated_loader import Habits, Mischief, PlateLoader

BY_LOADER = ("--sampler", "loader", "--no-demo")
BAD = Mischief(lost=0.05, cut=0.1, unanswered=0.1, twice=0.25)


def test_a_plate_over_a_bad_line(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(*BY_LOADER, "--empty", "A03")
    habits = Habits(poll_s=0.1, seed=7, mischief=BAD, wrong_well=1.0, wrong_barcode=True, timeout_s=5.0)
    report = PlateLoader(daemon.url, habits).run_plate("r1", plan("A01", "A02", "A03"), PATIENCE_S)
    assert [(w.well, w.outcome) for w in report.run.results] == [
        ("A01", "succeeded"),
        ("A02", "succeeded"),
        ("A03", "skipped"),
    ]
    assert (report.run.outcome, report.boots) == ("succeeded", 1)
    assert report.brought == ["A01", "A02", "A03"]
    # Another plate is put in first and a third one taken away; then the wrong wells; then another plate is taken away.
    assert [refused.rpartition(": ")[2] for refused in dict.fromkeys(report.refused)] == [
        "other_barcode",
        "other_barcode",
        "unexpected_well",
        "unexpected_well",
        "unexpected_well",
        "other_barcode",
    ]
    assert set(report.mischief) == {"lost", "cut", "unanswered", "twice"}


def test_the_plates_of_the_queue_over_a_bad_line(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(*BY_LOADER)
    habits = Habits(poll_s=0.1, seed=7, mischief=BAD, wrong_barcode=True, timeout_s=5.0)
    with daemon.ready() as client:
        for name in ("late", "early"):
            client.queue(name, dataclasses.replace(plan("A01"), plate_barcode=f"P-{name}"))
        client.order_queue(["early", "late"])
    reports = PlateLoader(daemon.url, habits).run_queue(PATIENCE_S)
    assert [(report.run.id, report.run.outcome) for report in reports] == [
        ("early", "succeeded"),
        ("late", "succeeded"),
    ]
    assert reports[-1].brought == ["A01", "A01"]
    assert "OTHER for P-early: other_plate_next" in reports[0].refused
    with daemon.ready() as client:
        assert client.status().queue == ()


def turning(well: str) -> Callable[[Status], bool]:
    return lambda s: s.specimen is not None and (s.specimen.well, s.specimen.phase) == (well, "revolve")


def test_a_plate_over_power_cuts(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(*BY_LOADER)
    cuts = [turning("A01"), turning("A02")]
    restarts: list[threading.Thread] = []

    def cut(status: Status) -> None:
        if cuts and cuts[0](status):
            cuts.pop(0)
            daemon.kill()
            restarts.append(threading.Thread(target=daemon.start))
            restarts[-1].start()

    loader = PlateLoader(daemon.url, Habits(poll_s=0.1, timeout_s=5.0), on_status=cut)
    report = loader.run_plate("r1", plan("A01", "A02"), PATIENCE_S)
    for restart in restarts:
        restart.join()
    assert [(w.well, w.outcome) for w in report.run.results] == [("A01", "succeeded"), ("A02", "succeeded")]
    assert (report.run.outcome, report.boots, cuts) == ("succeeded", 3, [])
    # The interrupted specimen is measured again, the finished one is not.
    assert report.brought == ["A01", "A01", "A02", "A02"]
    folders = sorted(folder.name for folder in (daemon.folder / "data/runs/r1").iterdir() if folder.is_dir())
    assert folders == ["A01", "A01.attempt-1", "A02", "A02.attempt-1"]


def test_the_loader_as_a_program(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon(*BY_LOADER)
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(plan("A01").to_json()))
    command = [sys.executable, "-m", "carved_client.simulated_loader", str(file), "--url", daemon.url]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / "clients/python/src")}
    told = subprocess.run(
        [*command, "--poll", "0.1"], env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert told.returncode == 0, told.stderr
    assert "Run plate: succeeded. 1 succeeded" in told.stdout
