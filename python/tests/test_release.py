"""What goes to PyPI, and when `python/release` refuses to build or upload it."""

import importlib.metadata
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile

from conftest import ROOT

LICENCES = ("LICENSE-APACHE", "LICENSE-MIT")


def test_the_source_distribution_has_all_that_its_build_scripts_read(tmp_path: pathlib.Path) -> None:
    maturin = pathlib.Path(sys.executable).with_name("maturin")
    subprocess.run([maturin, "sdist", "--out", tmp_path], cwd=ROOT / "python", check=True, capture_output=True)
    (file,) = tmp_path.glob("carved-*.tar.gz")
    with tarfile.open(file) as archive:
        members = {member.name.partition("/")[2]: member for member in archive.getmembers()}
        names = set(members)
        for name in LICENCES:
            text = archive.extractfile(members[name]) if members[name].isfile() else None
            assert text is not None, f"{name} is no file"
            assert text.read() == (ROOT / name).read_bytes()
    assert {"PKG-INFO", "pyproject.toml", "Cargo.lock", "src/carved/_plot.py", "src/carved/py.typed", "python/native/lib.rs"} <= names
    crates = {name.rpartition("/")[0] for name in names if name.endswith("/Cargo.toml")}
    assert {"crates/core", "crates/offline", "crates/records", "crates/store", "python"} <= crates
    # A build script is compiled with the files that it names.
    scripts = [crate for crate in crates if f"{crate}/build.rs" in names]
    assert scripts == ["python"]
    for name in re.findall(r'#\[path = "(.*?)"\]', (ROOT / "python" / "build.rs").read_text()):
        assert f"python/{name}" in names, name


def test_the_wheel_has_the_licences() -> None:
    installed = importlib.metadata.distribution("carved")
    assert installed.metadata.get_all("License-File") == list(LICENCES)
    found = {pathlib.Path(file).name: file.read_text() for file in installed.files or [] if file.parent.name == "licenses"}
    assert found == {name: (ROOT / name).read_text() for name in LICENCES}


def release(folder: pathlib.Path, *options: str, token: str = "") -> subprocess.CompletedProcess[str]:
    """Runs a copy of the script in a repository of its own, without network: it must end before it installs anything."""
    python = folder / "python"
    python.mkdir()
    shutil.copy(ROOT / "python" / "release", python)
    author = ["-c", "user.name=kim", "-c", "user.email=kim@example.org"]
    for command in (["init"], ["add", "."], ["commit", "--no-gpg-sign", "-m", "The script"]):
        subprocess.run(["git", *author, *command], cwd=folder, check=True, capture_output=True)
    (folder / "new.txt").write_text("not committed")
    # Should it go on all the same, pip finds no package and twine is not there.
    environment = {**os.environ, "TWINE_PASSWORD": token, "PIP_NO_INDEX": "1"}
    said = subprocess.run([python / "release", *options], env=environment, capture_output=True, text=True)
    assert [path.name for path in python.iterdir()] == ["release"], "it has built something"
    return said


def test_release_refuses_an_option_that_it_does_not_know(tmp_path: pathlib.Path) -> None:
    said = release(tmp_path, "--publish", token="pypi-x")
    assert (said.returncode, said.stdout) == (2, "")
    assert "python/release --upload" in said.stderr


def test_release_uploads_nothing_without_a_token(tmp_path: pathlib.Path) -> None:
    said = release(tmp_path, "--upload")
    assert (said.returncode, said.stdout) == (1, "")
    assert "TWINE_PASSWORD has no token" in said.stderr
    assert "https://pypi.org/manage/account/token" in said.stderr


def test_release_uploads_no_changes_that_are_not_committed(tmp_path: pathlib.Path) -> None:
    said = release(tmp_path, "--upload", token="pypi-x")
    assert (said.returncode, said.stdout) == (1, "")
    assert "commit or remove the changes first: git status" in said.stderr
