"""Inputs that the repository ships or makes: silhouettes of solids of known volume, and frames drawn from them."""

import json
import os
import pathlib
import subprocess
from typing import Any, NamedTuple

import make_frames
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import carved

ROOT = pathlib.Path(__file__).resolve().parents[2]
SILHOUETTES = ROOT / "tests" / "independent"


class Turn(NamedTuple):
    """Views of one turn."""

    folder: pathlib.Path
    views: npt.NDArray[np.uint8]
    angles: npt.NDArray[np.float64]
    camera: carved.Camera
    names: list[str]


def pictures(folder: pathlib.Path) -> Turn:
    files = sorted(folder.glob("view_*.png"))
    camera, angles = carved.Camera.read(folder / "camera.json")
    assert angles is not None
    return Turn(folder, np.stack([np.asarray(Image.open(file)) for file in files]), angles, camera, [file.name for file in files])


def run(*args: str | os.PathLike[str]) -> str:
    """What the command prints."""
    return subprocess.run([os.environ["CARVED_BIN"], *args], check=True, capture_output=True, text=True).stdout


def truth(solid: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((SILHOUETTES / solid / "truth.json").read_text())
    return found


@pytest.fixture(scope="session")
def ellipsoid() -> Turn:
    return pictures(SILHOUETTES / "ellipsoid")


@pytest.fixture(scope="session")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Turn:
    folder = tmp_path_factory.mktemp("frames")
    make_frames.make(SILHOUETTES / "ellipsoid", folder)
    return pictures(folder)


@pytest.fixture(scope="session")
def recording(frames: Turn, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    out = tmp_path_factory.mktemp("recording") / "A01"
    run("import", frames.folder, "--cameras", frames.folder / "camera.json", "--out", out, "--voxel", "14")
    return out
