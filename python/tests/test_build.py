"""The module names the sources that it was built from."""

import re
import subprocess

import pytest
from conftest import ROOT, Turn

import carved


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no checkout: the commit is CARVED_COMMIT or unknown")
def test_the_commit_is_one_of_this_checkout(ellipsoid: Turn) -> None:
    version, commit, dirty = carved.build
    assert version == carved.__version__
    assert re.fullmatch("[0-9a-f]{40}", commit), carved.build
    subprocess.run(["git", "cat-file", "-e", f"{commit}^{{commit}}"], cwd=ROOT, check=True)
    assert isinstance(dirty, bool)
    found = carved.measure(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, kind="silhouettes", voxel_um=28)
    assert found.software == carved.build
