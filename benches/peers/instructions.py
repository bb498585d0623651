"""Instructions of carved's hot paths, counted by callgrind: the count is the same on a busy machine as on a quiet one.

    python instructions.py PHANTOM_FOLDER
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import report
from ours import ROOT

# Name of the count; function at which callgrind starts and stops; input besides the phantom's folder; SD, um.
PATHS = [
    ("carving 84 views, SD 6.93, clean", "carve", "clean", 6.93),
    ("carving 84 views, SD 5.5, clean", "carve", "clean", 5.5),
    ("carving 84 views, SD 6.93, rolled", "carve", "rolled", 6.93),
    ("carving 84 views, SD 6.93, ragged", "carve", "ragged", 6.93),
    ("iso-surface, SD 5.5", "surface", "clean", 5.5),
    ("fairing it, 10 iterations", "fairing", "clean", 5.5),
    ("segmenting a frame of the phantom", "segment", "rgb/000.png", 5.5),
]


def program():
    """Builds the bench program and returns its path."""
    command = ["cargo", "bench", "--quiet", "--locked", "--no-run", "--bench", "instructions", "--message-format=json"]
    told = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    built = [m for m in map(json.loads, told.splitlines()) if m.get("executable") and m["target"]["name"] == "instructions"]
    return built[-1]["executable"]


def count(executable, path, source, sd_um):
    callgrind = ["valgrind", "--tool=callgrind", "--collect-atstart=no", f"--toggle-collect=*hot_{path}*", "--callgrind-out-file=/dev/null"]
    ran = subprocess.run([*callgrind, executable, source, path, "--sd", str(sd_um)], check=False, capture_output=True, text=True)
    found = re.search(r"Collected : (\d+)", ran.stderr)
    if ran.returncode != 0 or not found or int(found[1]) == 0:
        sys.exit(f"callgrind counted nothing in hot_{path} (exit code {ran.returncode}):\n{ran.stderr[-2000:]}")
    return int(found[1])


def main(folder):
    executable = program()
    rows = []
    for name, path, source, sd_um in PATHS:
        rows.append([name, f"{count(executable, path, folder.resolve() / source, sd_um) / 1e6:.1f}"])
        print(rows[-1], flush=True)
    valgrind = subprocess.run(["valgrind", "--version"], check=True, capture_output=True, text=True).stdout.strip()
    rust = subprocess.run(["rustc", "--version"], check=True, capture_output=True, text=True).stdout.strip()
    report.write(report.PAGE, "instructions", [
        "## Instructions",
        "",
        f"{report.processor()}. {report.today()}. {valgrind}, {rust}, bench profile, one thread.",
        "The numbers are the instructions read (Ir) within the function alone. They do not depend on other work of the machine,",
        "so a change of one per cent is a change of the program. They are not times: the effects of vector instructions, caches",
        "and threads are not included.",
        "",
        *report.table(["hot path", "10^6 instructions"], rows),
    ])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
