"""The source distribution and its wheel: built, installed from its file, and imported without the checkout."""

import os
import subprocess
import sys
import tarfile
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest

CLIENT = Path(__file__).parent.parent
ROOT = CLIENT.parent.parent
LICENCES = ("LICENSE-APACHE", "LICENSE-MIT")
OFFLINE = ("NewConnectionError", "ConnectTimeoutError", "NameResolutionError", "Network is unreachable")


def pip(*args: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True)


def from_pypi(*args: str | Path) -> None:
    said = pip(*args, "--retries", "2")
    if said.returncode and os.environ.get("CARVED_STRICT") != "1" and any(sign in said.stderr for sign in OFFLINE):
        pytest.skip("PyPI cannot be reached")
    assert said.returncode == 0, said.stderr


def test_the_source_distribution_and_its_wheel_are_complete(tmp_path: Path) -> None:
    # The build backend comes from PyPI.
    backend = tmp_path / "backend"
    from_pypi("install", "--quiet", "--target", backend, "hatchling>=1.27")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "sdist", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=CLIENT, env={**os.environ, "PYTHONPATH": str(backend)}, check=True, capture_output=True)
    (source,) = tmp_path.glob("carved_client-*.tar.gz")
    with tarfile.open(source) as archive:
        files = {member.name.partition("/")[2]: member for member in archive.getmembers()}
        for name in LICENCES:
            text = archive.extractfile(files[name]) if files[name].isfile() else None
            assert text is not None, f"{name} is no file"
            assert text.read() == (ROOT / name).read_bytes()
    from_pypi("wheel", "--no-deps", "--wheel-dir", tmp_path, source)
    (wheel,) = tmp_path.glob("carved_client-*.whl")
    site = tmp_path / "site"
    installed = pip("install", "--no-index", "--no-deps", "--target", site, wheel)
    assert installed.returncode == 0, installed.stderr

    (info,) = site.glob("carved_client-*.dist-info")
    metadata = PathDistribution(info).metadata
    assert metadata["Author"] == "The carved contributors"
    assert "zebrafish" in metadata["Keywords"]
    assert metadata.get_all("Project-URL")
    assert metadata.get_all("License-File") == list(LICENCES)
    for name in LICENCES:
        assert (info / "licenses" / name).read_bytes() == (ROOT / name).read_bytes()
    code = "import carved_client, sys; print(carved_client.__file__, carved_client.CarvedClient.__name__)"
    env = {**os.environ, "PYTHONPATH": str(site)}
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, env=env, check=True
    ).stdout
    assert said.split() == [str(site / "carved_client/__init__.py"), "CarvedClient"]
    assert (site / "carved_client/py.typed").is_file()
