"""docs/performance.md, with one section per part. Each run rewrites only the section of its part.

Times measured beside other work go to target/performance.md instead: such work slows threaded tools most, so that even the
ratios are wrong, and in carved's favour.
"""

import os
import platform
import re
import time
from importlib.metadata import version
from pathlib import Path

from ours import ROOT

PAGE = ROOT / "docs" / "performance.md"
HEAD = """# Performance

`benches/peers/run.sh` writes this page section by section. [benches/peers](../benches/peers/README.md) explains what is
timed and how. All tools of a section ran one after the other on the machine that the section names. **The times are
valid for that machine only. The ratios are similar on other machines.** The goals are for a quiet machine.
"""
PARTS = ("segmentation", "carve", "instructions")
BUSY_PAGE = ROOT / "target" / "performance.md"
# Number of cores that other work may use on a quiet machine, and how long this is observed, s.
QUIET_CORES, WATCHED_S = 0.2, 3


def processor():
    models = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}"


def today():
    return time.strftime("%Y-%m-%d")


class Machine:
    """The state of the machine before the run, while this process was idle."""

    def __init__(self):
        before = busy_s()
        time.sleep(WATCHED_S)
        self.others_cores = (busy_s() - before) / WATCHED_S
        self.quiet = self.others_cores <= QUIET_CORES
        if not self.quiet:
            print(f"Other work takes {self.others_cores:.2f} cores: what is measured goes to {BUSY_PAGE.relative_to(ROOT)}", flush=True)

    def lines(self, packages):
        """The machine, date and versions of a section."""
        busy = [] if self.quiet else ["**Other work ran on the machine: times are too long, ratios wrong, and nothing is said about the goals.**"]
        versions = ", ".join(f"{p} {version(p)}" for p in packages)
        return [
            f"{processor()}. {today()}. Other work before the run: {self.others_cores:.2f} cores.",
            *busy,
            f"Python {platform.python_version()}, {versions}.",
        ]

    def page(self):
        return PAGE if self.quiet else BUSY_PAGE

    def ratio(self, theirs, own, goal):
        """The ratio of a peer's time to carved's, with the goal."""
        if own is None:
            return ["not measured", f"{goal}"]
        return [times(theirs, own), f"{goal}" + self.verdict(theirs / own >= goal)]

    def at_most(self, found, goal, show):
        return f"at most {show(goal)}" + ("" if found is None else self.verdict(found <= goal))

    def verdict(self, met):
        """Only a quiet machine can judge a goal."""
        return "" if not self.quiet else ": met" if met else ": missed"


def busy_s():
    """Processor time of everything on this machine. Idle and waiting are excluded, and guests, which are counted twice."""
    user, nice, system, _, _, irq, softirq, steal, *_ = map(int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:])
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *("| " + " | ".join(row) + " |" for row in rows), ""]


def ms(seconds):
    if seconds is None:
        return "not measured"
    return f"{seconds:.2f} s" if seconds >= 1 else f"{seconds * 1e3:.0f} ms" if seconds >= 0.1 else f"{seconds * 1e3:.3g} ms"


def times(theirs, own):
    return "not measured" if own is None else f"{theirs / own:.1f}"


def write(page, part, lines):
    """Puts a section into a page and replaces the older one."""
    text = "\n".join(lines).strip()
    old = page.read_text() if page.exists() else ""
    sections = dict(re.findall(r"<!-- (\w+) -->\n(.*?)\n<!-- end -->", old, re.S))
    sections[part] = text
    body = [f"<!-- {p} -->\n{sections[p]}\n<!-- end -->\n" for p in PARTS if p in sections]
    page.write_text(HEAD + "\n" + "\n".join(body))
    print("\n" + text + f"\n\nwritten to {page.relative_to(ROOT)}", flush=True)
