"""A plate of 96 wells without an operator, on the emulated rig. The daemon is killed twice, the camera is lost once.

    python examples/overnight.py --carved ../../target/release/carved --data /tmp/overnight

Larvae of 3, 4 and 5 dpf, four beads, six empty wells, and four wells that differ from the plate map: two larvae, a
bubble, debris, a larva half out of the picture. The plate-loader polls at 1 Hz on a line that loses, cuts and doubles
requests. Afterwards every well is checked: its outcome against its contents, files against their SHA-256, numbers
against `carved measure`, volumes against the phantoms' ideal hulls. The exit code is 1 if any check fails.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from carved_client import PlannedWell, RunPlan
from carved_client.models import Status
from carved_client.simulated_loader.line import Mischief
from carved_client.simulated_loader.loader import Habits, PlateLoader, Report

RUN = "overnight"
EMPTY = ["A07", "B03", "C11", "E05", "F09", "H12"]
SURPRISES = {"B08": "two", "D02": "bubble", "E10": "debris", "G04": "clipped"}
BEADS = ["A01", "A12", "H01", "H11"]
#: The expected reason of each skipped well.
SKIPPED = {**dict.fromkeys(EMPTY, "empty"), "B08": "two", "D02": "bubble", "E10": "debris"}


def wells(count: int) -> list[str]:
    """The first `count` wells, row by row."""
    return [f"{row}{column:02}" for row in "ABCDEFGH" for column in range(1, 13)][:count]


def plate_map(count: int) -> tuple[PlannedWell, ...]:
    """Rows A to C with 3 dpf, D to F with 4, G and H with 5, and beads in the corners of the plate."""
    ages = {"A": 3, "B": 3, "C": 3, "D": 4, "E": 4, "F": 4, "G": 5, "H": 5}
    return tuple(
        PlannedWell(well, "bead")
        if well in BEADS
        else PlannedWell(well, "larva", ages[well[0]], compound="DMSO", control="negative")
        for well in wells(count)
    )


class Rig:
    """`carved simulate` under a supervisor that restarts it when it dies, as systemd does."""

    def __init__(self, carved: str, data: Path, time_scale: float, listen: str) -> None:
        self.command = [
            carved,
            "simulate",
            "--no-demo",
            "--sampler",
            "loader",
            "--listen",
            listen,
            "--data",
            str(data / "data"),
        ]
        self.command += ["--time-scale", str(time_scale), "--empty", ",".join(EMPTY)]
        self.command += ["--holds", ",".join(f"{well}={what}" for well, what in SURPRISES.items())]
        self.log = (data / "daemon.log").open("ab")
        self.starts = 0
        self.ending = False
        #: The index of a start of the daemon, and after how many seconds and for how many the camera's cable is
        #: disconnected.
        self.camera_out: tuple[int, tuple[float, float]] = (-1, (0.0, 0.0))
        self.process = self._start()
        threading.Thread(target=self._supervise, daemon=True).start()

    def _start(self) -> subprocess.Popen[bytes]:
        life, (after, lasting) = self.camera_out
        extra = ["--camera-out", f"{after},{lasting}"] if life == self.starts else []
        self.starts += 1
        return subprocess.Popen([*self.command, *extra], stdout=self.log, stderr=self.log)

    def _supervise(self) -> None:
        while not self.ending:
            self.process.wait()
            time.sleep(1.0)
            if not self.ending:
                self.process = self._start()

    def end(self) -> None:
        self.ending = True
        self.process.terminate()
        self.process.wait(timeout=60)


def killer(rig: Rig, progress: dict[str, Any], moments: list[float], said: list[str]) -> None:
    """Kills the daemon with -9 when this share of the wells is done, at a random moment."""
    for share in moments:
        while progress.get("share", 0.0) < share:
            time.sleep(0.05)
        time.sleep(random.Random(share).uniform(0.0, 6.0))
        doing = progress.get("doing")
        rig.process.kill()
        said.append(f"kill -9 after {progress['share']:.0%} of the wells, while: {doing}")


def account(report: Report, run: Path, carved: str) -> list[str]:
    """Everything that differs from the expected result, in words."""
    wrong: list[str] = []
    for result in report.run.results:
        expected = ("skipped", SKIPPED[result.well]) if result.well in SKIPPED else ("succeeded", None)
        if (result.outcome, result.reason) != expected and result.well != "G04":
            wrong.append(
                f"{result.well} ended {result.outcome} ({result.reason}), not {expected}; flags {result.flags}"
            )
        if result.well == "G04" and not (
            result.outcome == "skipped" or any("clip" in f or "edge" in f for f in result.flags)
        ):
            wrong.append(
                f"G04 is cut by the picture and nothing says so: {result.outcome}, {result.reason}, {result.flags}"
            )
    unfinished = ("interrupted", "aborted")
    wrong += [
        f"{result.well} ended {result.outcome} and has no SHA256SUMS"
        for result in report.run.results
        if result.outcome not in unfinished and not (run / result.well / "SHA256SUMS").exists()
    ]
    folders = sorted(f for f in run.iterdir() if (f / "SHA256SUMS").exists())
    for folder in folders:
        sums = subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=folder, capture_output=True, text=True)
        if sums.returncode != 0:
            wrong.append(f"{folder.name}: {sums.stdout}{sums.stderr}")
    measured = [run / r.well for r in report.run.results if r.outcome == "succeeded"]
    offline = subprocess.run([carved, "measure", *map(str, measured)], capture_output=True, text=True)
    same = offline.stdout.count("identical") + offline.stderr.count("identical")
    if offline.returncode != 0 or same < len(measured):
        wrong.append(
            f"offline: {same} of {len(measured)} identical, exit code {offline.returncode}: {offline.stderr[-400:]}"
        )
    return wrong


def against_truth(report: Report, run: Path) -> dict[str, list[float]]:
    """Volume compared with the ideal hull, percent, per kind of specimen; flagged specimens separately."""
    found: dict[str, list[float]] = {}
    for result in report.run.results:
        if result.volume_um3 is None:
            continue
        truth = json.loads((run / result.well / "recording.json").read_text()).get("truth") or {}
        if "hull_volume_um3" not in truth:
            continue
        kind = "bead" if result.specimen == "bead" else f"{result.dpf:g} dpf"
        kind += ", flagged" if result.flags else ""
        found.setdefault(kind, []).append((result.volume_um3 / truth["hull_volume_um3"] - 1.0) * 100.0)
    return found


def times(report: Report, run: Path) -> dict[str, list[float]]:
    """Seconds per phase over all measured wells, and the program's own time."""
    found: dict[str, list[float]] = {}
    for result in report.run.results:
        file = run / result.well / "timings.json"
        if result.outcome != "succeeded" or not file.exists():
            continue
        timings = json.loads(file.read_text())
        for phase, seconds in {**timings["phases_s"], "devices": timings["devices_s"], "own": timings["own_s"]}.items():
            found.setdefault(phase, []).append(seconds)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--carved", default="carved")
    parser.add_argument("--data", type=Path, required=True, help="a new folder")
    parser.add_argument("--wells", type=int, default=96)
    parser.add_argument("--time-scale", type=float, default=10.0, help="of motor and shutter")
    parser.add_argument("--listen", default="127.0.0.1:8439")
    parser.add_argument("--seed", type=int, default=1, help="of moments and mischief")
    given = parser.parse_args()
    given.data.mkdir(parents=True)

    chance = random.Random(given.seed)
    moments = sorted(chance.uniform(0.1, 0.85) for _ in range(2))
    rig = Rig(given.carved, given.data, given.time_scale, given.listen)
    # Between the two deaths, for longer than the ten seconds for which a run waits for its camera.
    rig.camera_out = (1, (chance.uniform(15.0, 40.0), 30.0))
    progress: dict[str, Any] = {}
    seen_faults: set[str] = set()

    def follow(status: Status) -> None:
        run = status.run_named(RUN)
        progress["doing"] = status.doing
        if run is not None:
            progress["share"] = 1.0 - run.wells.pending / run.wells.total
        seen_faults.update(f.code for f in status.faults)

    said: list[str] = []
    threading.Thread(target=killer, args=(rig, progress, moments, said), daemon=True).start()
    mischief = Mischief(0.01, 0.01, 0.01, 0.01)
    loader = PlateLoader(
        f"http://{given.listen}",
        Habits(seed=given.seed, mischief=mischief, wrong_well=0.05, wrong_barcode=True),
        on_status=follow,
    )
    began = time.monotonic()
    try:
        report = loader.run_plate(RUN, RunPlan("NIGHT-1", "standard", "night", plate_map(given.wells)), 3 * 3600.0)
        took = time.monotonic() - began
    finally:
        rig.end()
    run = given.data / "data" / "runs" / RUN
    counts = report.run.wells
    print(
        f"Simulated. {given.wells} wells in {took / 60:.1f} min, time scale {given.time_scale:g}; outcome {report.run.outcome}: {counts}"
    )
    print(f"{report.boots} lives of the daemon; " + "; ".join(said) + f"; faults seen: {sorted(seen_faults)}")
    print(
        f"{report.polls} polls, {report.unreachable} without an answer; mischief {report.mischief}; refused {len(report.refused)}"
    )
    again = [w for w in sorted(set(report.brought)) if report.brought.count(w) > 1]
    print(f"brought again: {again}")
    for phase, seconds in sorted(times(report, run).items()):
        ordered = sorted(seconds)
        print(
            f"  {phase:12} median {statistics.median(ordered):6.2f} s, p95 {ordered[int(0.95 * (len(ordered) - 1))]:6.2f} s"
        )
    for kind, errors in sorted(against_truth(report, run).items()):
        print(
            f"  volume of {kind}: {statistics.mean(errors):+.2f} % of the ideal hull, sd {statistics.pstdev(errors):.2f}, n {len(errors)}"
        )
    wrong = account(report, run, given.carved)
    print("\n".join(wrong) if wrong else "every well is accounted for")
    return 1 if wrong or counts.pending or len(said) != 2 else 0


if __name__ == "__main__":
    sys.exit(main())
