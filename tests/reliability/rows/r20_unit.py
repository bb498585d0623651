"""R20: the exposure of the unit by systemd-analyze. The package on a booted systemd is tested by `make deb-test`."""

from __future__ import annotations

import re
import shutil
import subprocess

from ..kit.row import CannotRun, Context, Observed, Row


def run(context: Context) -> Observed:
    """Asks systemd-analyze for the exposure of the unit."""
    if shutil.which("systemd-analyze") is None:
        raise CannotRun("systemd-analyze is not installed: scripts/install-deps test")
    unit = context.work / "carved.service"
    text = (context.source / "systemd/carved.service").read_text()
    if context.control:
        text = re.sub(r"(?m)^(Protect|Restrict|Private|SystemCall|Capability|IPAddress|NoNew|Device).*\n", "", text)
    unit.write_text(text)
    done = subprocess.run(["systemd-analyze", "security", "--no-pager", "--offline=true", unit], capture_output=True, text=True)
    found = re.search(r"Overall exposure level for \S+: ([\d.]+)", done.stdout)
    observed = Observed(
        "`systemd-analyze security --offline=true systemd/carved.service`; install, watchdog kill, recovery, upgrade and "
        "removal on a booted systemd: `make deb-test`"
    )
    observed.not_judged.append("a booted systemd: `make deb-test`")
    observed.at_most("exposure", float(found[1]) if found else None, 1.5, "of 10")
    return observed


ROW = Row(
    "R20",
    "unit and package",
    "exposure at most 1.5; watchdog kill and recovery seen on a booted systemd",
    (1, 1, 1),
    "unit",
    "the lines that harden the unit are removed",
    r"^exposure .* the goal is",
    run,
)
