"""`carved-plate-loader [PLAN.json]`: measures the plate of a plan as its loader, and reports the result.

Without a plan it measures the plates of the instrument's queue, one after another.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from ..decode import decode
from ..models import Status
from ..plan import RunPlan
from .line import Mischief
from .loader import Habits, PlateLoader


def main(arguments: list[str] | None = None) -> int:
    """Runs one plate, or the queue. The exit code is 0 if each run succeeded or was partial."""
    parser = argparse.ArgumentParser(prog="carved-plate-loader", description=__doc__)
    parser.add_argument(
        "plan",
        type=Path,
        nargs="?",
        help="the run's plan as JSON: the body of PUT /v1/runs/{run_id}; default: the queue",
    )
    parser.add_argument("--url", default="http://127.0.0.1:8420")
    parser.add_argument("--run", default="plate", help="the run's id")
    parser.add_argument("--poll", type=float, default=1.0, metavar="S", help="seconds between two polls")
    parser.add_argument(
        "--timeout", type=float, default=4 * 3600.0, metavar="S", help="for the plate, or the whole queue"
    )
    parser.add_argument("--seed", type=int, default=1, help="of all that goes wrong")
    parser.add_argument(
        "--mischief",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="of requests lost, cut, unanswered and sent twice, each",
    )
    given = parser.parse_args(arguments)
    share = given.mischief
    habits = Habits(
        poll_s=given.poll,
        seed=given.seed,
        mischief=Mischief(share, share, share, share),
        wrong_well=share,
        wrong_barcode=share > 0.0,
    )
    said: list[str] = []

    def tell(status: Status) -> None:
        if said[-1:] != [status.doing]:
            said[:] = [status.doing]
            print(status.doing, flush=True)

    loader = PlateLoader(given.url, habits, on_status=tell)
    if given.plan is None:
        reports = loader.run_queue(given.timeout)
    else:
        reports = [loader.run_plate(given.run, decode(RunPlan, json.loads(given.plan.read_text())), given.timeout)]
    for report in reports:
        counts = report.run.wells
        print(
            f"Run {report.run.id}: {report.run.outcome}. {counts.succeeded} succeeded, {counts.flagged} flagged, "
            f"{counts.failed} failed, {counts.skipped} skipped, {counts.interrupted} interrupted of {counts.total}; "
            f"{report.polls} polls, {report.boots - 1} restarts, mischief {report.mischief}, refused {report.refused}"
        )
    return 0 if all(report.run.outcome in {"succeeded", "partial"} for report in reports) else 1


if __name__ == "__main__":
    sys.exit(main())
