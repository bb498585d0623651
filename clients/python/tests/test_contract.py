"""The answers of the daemon agree with the served contract."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rig import PATIENCE_S, Daemon, plan

HERE = Path(__file__).parent
#: Paths whose requests would never end.
ENDLESS = ("/v1/events",)


@pytest.fixture
def served(start_daemon: Callable[..., Daemon]) -> Daemon:
    """A daemon with data: a run with a measured and an empty well."""
    daemon = start_daemon("--no-demo", "--empty", "A02")
    with daemon.ready() as client:
        client.put_run("made", plan("A01", "A02"))
        assert client.wait_for_outcome("made", PATIENCE_S).run_named("made") is not None
    return daemon


def test_every_answer_to_generated_requests_is_in_the_contract(served: Daemon, tmp_path: Path) -> None:
    command = [str(Path(sys.executable).parent / "st"), "--config-file", str(HERE / "schemathesis.toml"), "run"]
    command += [f"{served.url}/openapi.json", "--checks", "all", "--max-examples", "15", "--seed", "1", "--no-color"]
    command += ["--generation-database", "none", "--request-timeout", "35", "--max-time", "60"]
    command += [word for path in ENDLESS for word in ("--exclude-path", path)]
    environment = {**os.environ, "SCHEMATHESIS_HOOKS": "schemathesis_hooks", "PYTHONPATH": str(HERE)}
    found = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=environment
    )
    assert found.returncode == 0, found.stdout + found.stderr
    counted = re.search(r"Operations:\s+(\d+) selected / (\d+) total", found.stdout)
    assert counted is not None, found.stdout
    assert int(counted[1]) == int(counted[2]) - len(ENDLESS) > 20
