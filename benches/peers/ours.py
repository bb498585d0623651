"""carved's own times, from its bench programs."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def bench(name, *arguments):
    """The output of `cargo bench --bench NAME -- ARGUMENTS`, or None if there is no such program."""
    if not (ROOT / "benches" / f"{name}.rs").exists():
        print(f"benches/{name}.rs is not there: carved's own times are not measured", flush=True)
        return ""
    command = ["cargo", "bench", "--quiet", "--locked", "--bench", name, "--", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


class Said:
    """The lines `@ KIND key=value ...` of a bench program."""

    def __init__(self, text):
        self.lines = []
        for line in re.findall(r"^@ (.*)$", text, re.M):
            kind, *pairs = line.split()
            self.lines.append((kind, dict(pair.split("=", 1) for pair in pairs)))

    def get(self, kind, key, **like):
        """The number under `key` in the line of this kind whose other values match `like`, or None."""
        for found, values in self.lines:
            if found == kind and key in values and all(same(values.get(k), v) for k, v in like.items()):
                return float(values[key])
        return None


def same(found, wanted):
    """Compares values as numbers if possible, so that 84 equals 84.0, else as text."""
    try:
        return float(found) == float(wanted)
    except (TypeError, ValueError):
        return found == wanted
