"""A finished run of one specimen, made once and copied for each row that damages it."""

from __future__ import annotations

import shutil
from pathlib import Path

from .daemon import Daemon, free_port, plan
from .row import Context


def recorded_run(context: Context, kind: str = "bead") -> Path:
    """A copy of the folder of a finished run with the well A01, below the row's work folder."""
    made = context.work.parent / f"recorded-{kind}"
    if not (made / "runs/recorded/run.json").exists():
        shutil.rmtree(made, ignore_errors=True)
        with Daemon(context.binary, made, free_port(), "--time-scale", "10", log=context.work.parent / f"recorded-{kind}.log") as daemon:
            daemon.start("recorded", plan(1, kind))
            daemon.wait_ended("recorded")
            daemon.end()
    copy = context.work / "recorded/runs/recorded"
    shutil.rmtree(copy.parent.parent, ignore_errors=True)
    shutil.copytree(made / "runs/recorded", copy)
    return copy
