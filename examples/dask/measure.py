"""Measures the recordings of many runs again on a Dask cluster, and makes one table of them: docs/bulk.md.

    python measure.py --runs runs.txt --out again [--shards 16] [--method FILE] [--carved carved] [--scheduler tcp://HOST:8786]

runs.txt has the folder of a run per line (DATA/runs/RUN). Without --scheduler the processors of this computer are used. The folders and
the program must be on a disk that all workers see. Start it again after an interruption or a change: what is done is left out.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from dask.distributed import Client, as_completed

# Some recordings could not be measured; to repeat the command does not help.
SOME_FAILED = 3


def measure(command: list[str]) -> tuple[int, str, str]:
    """Runs one shard, on a worker. Returns the exit code, the line of JSON, and what the command said."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, SOME_FAILED):
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}")
    return done.returncode, done.stdout, done.stderr


def main() -> int:
    """Measures, then writes the table. The exit code is 3 if some recordings could not be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--shards", type=int, default=16)
    parser.add_argument("--method", type=Path)
    parser.add_argument("--carved", default="carved")
    parser.add_argument("--scheduler")
    args = parser.parse_args()
    runs = [line.strip() for line in args.runs.read_text().splitlines() if line.strip()]
    numbers = args.out.absolute() / "numbers"
    method = [] if args.method is None else ["--method", str(args.method.absolute())]
    # A worker has as many processors as Dask gives it threads; each shard is one task of one thread.
    commands = [
        [args.carved, "measure", "--out", str(numbers), "--shard", f"{k}/{args.shards}", "--jobs", "1", *method, *runs]
        for k in range(1, args.shards + 1)
    ]
    worst, measured, processor_s = 0, 0, 0.0
    with Client(args.scheduler) if args.scheduler else Client(dashboard_address=None) as client:
        # Not pure: the same command measures what has changed.
        for future in as_completed(client.map(measure, commands, pure=False, retries=2)):
            code, line, said = future.result()
            summary = json.loads(line)
            worst = max(worst, code)
            measured += summary["measured"]
            processor_s += summary["processor_s"] or 0.0
            if code:
                print(said, file=sys.stderr, end="")
    table = args.out / "table.csv"
    subprocess.run([args.carved, "export", "table", *runs, "--measurements", str(numbers), "--out", str(table)], check=True)
    plates = measured / 96 / (processor_s / 3600) if processor_s else None
    print(json.dumps({"measured": measured, "processor_s": processor_s, "plates_per_core_hour": plates, "table": str(table)}))
    return worst


if __name__ == "__main__":
    sys.exit(main())
