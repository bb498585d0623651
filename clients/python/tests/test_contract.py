"""The served contract: what the daemon answers is in it, and this package's types are its types."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import httpx
import pytest
from rig import PATIENCE_S, Daemon, plan

from carved_client import PlannedWell, PlateMap, Problem, RunPlan, Status, models

HERE = Path(__file__).parent
#: Paths that a generated request would never come back from.
ENDLESS = ("/v1/events",)


@pytest.fixture
def served(start_daemon: Callable[..., Daemon]) -> Daemon:
    """A daemon that has something to tell: a run with a measured and an empty well."""
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


def fields_of(hint: Any) -> set[type]:
    """All dataclasses that a type is made of."""
    found = {hint} if dataclasses.is_dataclass(hint) and isinstance(hint, type) else set()
    parts = get_type_hints(hint).values() if found else get_args(hint)
    return found.union(*(fields_of(part) for part in parts)) if parts else found


def test_the_types_of_this_package_are_those_of_the_contract(served: Daemon) -> None:
    schemas = httpx.get(f"{served.url}/openapi.json").json()["components"]["schemas"]
    checked = 0
    roots = (Status, RunPlan, PlateMap, Problem, models.Preflight, models.HandoffNeeds, models.Event)
    for cls in {models.Acknowledged}.union(*map(fields_of, roots)):
        schema = schemas[cls.__name__]
        for field in dataclasses.fields(cls):
            assert field.name in schema["properties"], f"{cls.__name__}.{field.name} is not served"
            checked += 1
        known = {field.name for field in dataclasses.fields(cls)}
        if cls in (RunPlan, PlannedWell):
            assert known == set(schema["properties"]), f"{cls.__name__} lacks what a plan may say"
    assert checked > 80
    words = "State Phase RunOutcome SpecimenOutcome SchedulerAction Mode SpecimenKind Control HandoffIntent"
    for name in words.split():
        alias = getattr(models, name)
        assert get_origin(alias) is Literal
        assert set(get_args(alias)) == set(schemas[name]["enum"]), name
