"""What goes to PyPI."""

import pathlib
import re
import subprocess
import sys
import tarfile

from conftest import ROOT


def test_the_source_distribution_has_all_that_its_build_scripts_read(tmp_path: pathlib.Path) -> None:
    maturin = pathlib.Path(sys.executable).with_name("maturin")
    subprocess.run([maturin, "sdist", "--out", tmp_path], cwd=ROOT / "python", check=True, capture_output=True)
    (file,) = tmp_path.glob("carved-*.tar.gz")
    with tarfile.open(file) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"PKG-INFO", "pyproject.toml", "Cargo.lock", "src/carved/_plot.py", "src/carved/py.typed", "python/native/lib.rs"} <= names
    crates = {name.rpartition("/")[0] for name in names if name.endswith("/Cargo.toml")}
    assert {"crates/core", "crates/offline", "crates/records", "crates/store", "python"} <= crates
    # A build script is compiled with the files that it names.
    scripts = [crate for crate in crates if f"{crate}/build.rs" in names]
    assert scripts == ["python"]
    for name in re.findall(r'#\[path = "(.*?)"\]', (ROOT / "python" / "build.rs").read_text()):
        assert f"python/{name}" in names, name
