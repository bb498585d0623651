"""Follows docs/tutorial.md as written, in an empty folder, with the program that is named on the command line.

    python3 tests/docs/follow_tutorial.py target/release/carved [FOLDER]

Files are written where the page says "the file `NAME`". Every sh block is run by bash, and its output must have the lines of
the block that follows it. Only the address of the daemon, the search path and the time in a run's name differ from the page.
A FOLDER keeps the files. Takes some minutes and needs PyPI.

On a busy computer frames are taken again and have other noise, so the numbers differ from the page. A run that is held for
such frames is told to go on. `chrt -r 5 python3 ...` gives the daemon its time there.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE_URL = "http://127.0.0.1:8420"
PATIENCE_S = 900


def steps(text):
    """The blocks of the page in order, as (language, paragraph before it, text)."""
    found, before, block = [], "", None
    for line in text.splitlines():
        if line.startswith("```"):
            if block is None:
                block = (line[3:], [])
            else:
                found.append((block[0], before, "\n".join(block[1]) + "\n"))
                block, before = None, ""
        elif block is not None:
            block[1].append(line)
        elif line.strip():
            before += f" {line}"
        elif not line.strip() and before and not before.endswith("\n"):
            before += "\n"
    return found


class Daemon:
    """The emulated instrument. `lines` is what it has printed."""

    def __init__(self, program, folder):
        self.lines = []
        arguments = [program, "simulate", "--frames", "clean", "--listen", "127.0.0.1:0"]
        self.process = subprocess.Popen(arguments, cwd=folder, stdout=subprocess.PIPE, text=True)
        threading.Thread(target=self._read, daemon=True).start()
        self.wait_for("carved simulates")
        self.url = re.search(r"Page: (\S+)", self.lines[0])[1].rstrip("/")
        threading.Thread(target=self._go_on, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def _go_on(self):
        while self.process.poll() is None:
            try:
                with urllib.request.urlopen(f"{self.url}/v1/status", timeout=30) as answer:
                    run = json.load(answer)["run"]
                hold = run and run["hold"]
                if hold and hold["next_command"] == "unhold":
                    print(f"held: {hold['cause']}", flush=True)
                    request = urllib.request.Request(f"{self.url}/v1/runs/{run['id']}/unhold", method="POST")
                    urllib.request.urlopen(request, timeout=30).close()
            except OSError as error:  # the daemon has ended, or the run goes on already
                print(f"no command was sent: {error}", flush=True)
            time.sleep(1)

    def wait_for(self, beginning):
        """Wait until a printed line begins like this."""
        end = time.monotonic() + PATIENCE_S
        while not any(line.startswith(beginning) for line in self.lines):
            if self.process.poll() is not None or time.monotonic() > end:
                sys.exit(f"the daemon did not print {beginning!r}: {self.lines}")
            time.sleep(0.2)


def missing(expected, printed):
    """Lines of the page that were not printed."""

    def same(line):
        return re.sub(r"demo-\w+", "demo", line.rstrip())

    known = {same(line) for line in printed}
    return [line for line in map(same, expected.splitlines()) if line.strip() and line not in known]


def follow(program, folder):
    """Do every step of the page in this folder, and return the number of differences."""
    (folder / "clients").symlink_to(ROOT / "clients")
    path = f"{Path(program).parent}:{os.environ['PATH']}"
    daemon, printed, shown, wrong = None, [], "", 0
    try:
        for language, before, text in steps((ROOT / "docs/tutorial.md").read_text()):
            if language == "sh" and text.startswith("make run"):
                daemon, shown = Daemon(program, folder), text
                printed = daemon.lines
            elif language == "sh" and not text.startswith("export PATH"):
                command = text.replace(PAGE_URL, daemon.url).replace("carved run start", f"carved run start --url {daemon.url}")
                print(f"$ {text}", end="", flush=True)
                done = subprocess.run(
                    ["bash", "-ec", command],
                    cwd=folder,
                    env={**os.environ, "PATH": path, "CARVED_LOG": "warn", "MPLBACKEND": "agg"},
                    stdout=subprocess.PIPE,
                    text=True,
                    timeout=PATIENCE_S,
                    check=False,
                )
                printed, shown = done.stdout.splitlines(), text
                if done.returncode != 0:
                    wrong += 1
                    print(f"exit code {done.returncode}")
            elif language in ("csv", "python"):
                name = re.findall(r"the file\s+`([^`]+)`", before)[-1]
                (folder / name).write_text(text.replace(PAGE_URL, daemon.url))
            elif language == "":
                last = text.splitlines()[-1]
                if printed is daemon.lines:
                    daemon.wait_for(last[:16])
                lines = [line.replace(daemon.url, PAGE_URL) for line in printed]
                if differs := missing(text, lines):
                    wrong += 1
                    parts = (f"differs after {shown.strip()!r}; the page has", *differs, "printed was", *lines)
                    print("\n  ".join(parts), flush=True)
        for name in ("figure.png", "carved-data/runs/my-first-plate/A01/mesh.ply"):
            if not (folder / name).is_file():
                wrong += 1
                print(f"{name} was not made")
    finally:
        if daemon:
            daemon.process.terminate()
            daemon.process.wait()
    return wrong


def main():
    """Follow the page in a folder of its own, or in the empty one that is named."""
    program, *named = sys.argv[1:]
    with tempfile.TemporaryDirectory() as temporary:
        wrong = follow(str(Path(program).resolve()), Path(named[0] if named else temporary))
    print("the tutorial is as written" if wrong == 0 else f"{wrong} difference(s)")
    sys.exit(wrong != 0)


main()
