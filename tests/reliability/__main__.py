"""Runs rows of the reliability table: `python3 -m tests.reliability --binary target/release/carved --write R13 R19`."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
import traceback
from datetime import date
from pathlib import Path

from .kit.daemon import DaemonError
from .kit.row import SCALES, CannotRun, Context, Observed, Row, machine
from .report import Results
from .rows import ROWS

SOURCE = Path(__file__).resolve().parents[2]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", metavar="ROW", help="rows such as R13 (default: all)")
    parser.add_argument("--binary", type=Path, default=SOURCE / "target/release/carved", help="the program under test")
    parser.add_argument("--scale", choices=SCALES, default="default", help="size of each row")
    parser.add_argument("--count", type=int, help="size of the rows, in place of the scale's")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random moments and faults")
    parser.add_argument("--control", action="store_true", help="break what each row names: every row must report that miss")
    parser.add_argument("--write", action="store_true", help="write docs/reliability.md and docs/reliability/")
    parser.add_argument("--keep", action="store_true", help="keep the work folder")
    parser.add_argument("--work", type=Path, help="folder for data and logs (default: a temporary one)")
    parser.add_argument("--list", action="store_true", help="list the rows and their sizes")
    return parser.parse_args()


def _run(row: Row, context: Context) -> Observed:
    shutil.rmtree(context.work, ignore_errors=True)
    context.work.mkdir(parents=True)
    try:
        return row.run(context)
    except DaemonError as error:
        if context.control:
            # What was broken was not reached, so this shows nothing.
            raise CannotRun(str(error)[:500]) from error
        return Observed("the row broke off", misses=[str(error)[:500]])


def main() -> int:
    """Runs the rows. The exit code is 1 if a row missed its goal, or, with `--control`, if one did not report the miss that its break
    causes. A miss that the row's note explains is reported, and the exit code stays 0.
    """
    arguments = _arguments()
    unknown = set(arguments.rows) - {row.id for row in ROWS}
    if unknown:
        print(f"there is no row {', '.join(sorted(unknown))}; the rows are {', '.join(row.id for row in ROWS)}", file=sys.stderr)
        return 2
    chosen = [row for row in ROWS if not arguments.rows or row.id in arguments.rows]
    if arguments.list:
        for row in chosen:
            sizes = ", ".join(f"{scale} {size}" for scale, size in zip(SCALES, row.sizes, strict=True))
            print(f"{row.id:4} {row.fault} ({row.unit}: {sizes})")
        return 0
    binary = arguments.binary.resolve()
    if not binary.is_file():
        print(f"{binary} is missing: `make build`, or name another with --binary", file=sys.stderr)
        return 2
    work = arguments.work or Path(tempfile.mkdtemp(prefix="carved-qa-"))
    results, wrong = Results(SOURCE / "docs/reliability", SOURCE / "docs/reliability.md", ROWS), []
    for row in chosen:
        scale = "short" if arguments.control else arguments.scale
        count = arguments.count or row.sizes[SCALES.index(scale)]
        context = Context(binary, SOURCE, work.resolve() / row.id, count, arguments.control)
        context.random.seed(f"{row.id} {arguments.seed}")
        print(f"{row.id}: {row.fault} ({count} of {row.sizes[2]} {row.unit}){' CONTROL' if arguments.control else ''}", flush=True)
        began, on = time.monotonic(), machine()
        try:
            observed = _run(row, context)
        except CannotRun as reason:
            print(f"{row.id}: cannot run: {reason}", flush=True)
            wrong.append(row.id)
            continue
        except Exception:
            # Not the daemon's: nothing is written.
            traceback.print_exc()
            wrong.append(row.id)
            continue
        seconds = time.monotonic() - began
        for figure in observed.figures:
            print(f"  {figure}")
        for part in observed.not_judged:
            print(f"  NOT JUDGED {part}")
        for miss in observed.misses[:20]:
            print(f"  MISS {miss}")
        if arguments.control:
            good = bool(row.control_misses(observed))
            verdict = "reported what was broken" if good else f"did not report what was broken ({row.control_miss})"
        else:
            good = not row.unexplained(observed)
            verdict = ("missed, as its note says" if good else "missed") if observed.misses else "met"
        if not good:
            wrong.append(row.id)
        print(f"{row.id}: {verdict} after {seconds:.0f} s", flush=True)
        if arguments.write:
            if arguments.control:
                results.take_control(row, observed, observed.program or context.version, date.today())
            else:
                program = observed.program or context.version
                results.take(row, observed, program, count, seconds, date.today(), on, context.work / "soak.svg")
    if arguments.keep or wrong:
        print(f"data and logs: {work}")
    else:
        shutil.rmtree(work, ignore_errors=True)
    meant = "did not report what was broken or could not run" if arguments.control else "missed the goal or could not run"
    print(f"{len(chosen)} rows, {len(wrong)} {meant}: {', '.join(wrong)}" if wrong else f"{len(chosen)} rows, all as they must be")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
