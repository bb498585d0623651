"""docs/performance.md: a section per part, each rewritten by its own run and left alone by the others'."""

import os
import platform
import re
import time
from importlib.metadata import version
from pathlib import Path

from ours import ROOT

PAGE = ROOT / "docs" / "performance.md"
HEAD = """# Performance

Written by `benches/peers/run.sh`, section by section; [benches/peers](../benches/peers/README.md) says what is timed and how. All tools of a
section ran one after the other on the machine it names. **Times belong to that machine, ratios travel.** The goals are for a quiet machine.
"""
PARTS = ("segmentation", "carve", "instructions")
# The machine's load before the run, and what it may be for the machine to be called quiet.
LOAD = os.getloadavg()[0]
QUIET = LOAD <= 0.3


def processor():
    models = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}"


def today():
    return time.strftime("%Y-%m-%d")


def setting(packages):
    """The lines that say where, when and with what a section was measured."""
    lines = [f"{processor()}. {today()}. Load before the run: {LOAD:.2f}."]
    if not QUIET:
        lines.append("**Other work ran on the machine: times are too long, ratios are rough, and nothing is said about the goals.**")
    lines.append("Python " + platform.python_version() + ", " + ", ".join(f"{p} {version(p)}" for p in packages) + ".")
    return lines


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *("| " + " | ".join(row) + " |" for row in rows), ""]


def ms(seconds):
    if seconds is None:
        return "not measured"
    return f"{seconds:.2f} s" if seconds >= 1 else f"{seconds * 1e3:.0f} ms" if seconds >= 0.1 else f"{seconds * 1e3:.3g} ms"


def ratio(theirs, own, goal):
    """How many times as long as carved a peer takes, and beside it the goal."""
    if own is None:
        return ["not measured", f"{goal}"]
    return [times(theirs, own), f"{goal}" + verdict(theirs / own >= goal)]


def times(theirs, own):
    return "not measured" if own is None else f"{theirs / own:.1f}"


def at_most(found, goal, show):
    return f"at most {show(goal)}" + ("" if found is None else verdict(found <= goal))


def verdict(met):
    """Only a quiet machine can tell."""
    return "" if not QUIET else ": met" if met else ": missed"


def write(part, lines):
    """Puts a section into the page, in the place of an older one."""
    text = "\n".join(lines).strip()
    old = PAGE.read_text() if PAGE.exists() else ""
    sections = dict(re.findall(r"<!-- (\w+) -->\n(.*?)\n<!-- end -->", old, re.S))
    sections[part] = text
    body = [f"<!-- {p} -->\n{sections[p]}\n<!-- end -->\n" for p in PARTS if p in sections]
    PAGE.write_text(HEAD + "\n" + "\n".join(body))
    print("\n" + text + f"\n\nwritten to {PAGE.relative_to(ROOT)}", flush=True)
