"""Draws frames of a turn in a capillary from silhouettes: `make_frames.py SILHOUETTES OUT`.

The silhouettes are those of `tests/independent`, whose solids have a known volume. A frame shows the light through the capillary, its two
walls, the specimen, and noise. `OUT` gets one PNG per view and `camera.json`.
"""

import json
import pathlib
import shutil
import sys

import numpy as np
import numpy.typing as npt
from PIL import Image

LIGHT, GLASS, DARK = 190.0, 90.0, 0.35
"""Grey value of the light, of the dark lines of the glass, and the share of the light that passes the specimen."""
NOISE = 1.5
"""Standard deviation of a pixel's noise, grey values."""


def wall(rows: npt.NDArray[np.float64], outer: float, inner: float) -> npt.NDArray[np.float64]:
    """Darkness of one wall of the capillary by row, 0 to 1: two dark lines, the outer and the inner surface of the glass."""
    lines: npt.NDArray[np.float64] = np.exp(-(((rows - outer) / 3.0) ** 2)) + 0.8 * np.exp(-(((rows - inner) / 3.0) ** 2))
    return lines


def frame(coverage: npt.NDArray[np.float64], random: np.random.Generator) -> npt.NDArray[np.uint8]:
    """A frame of a specimen that covers these shares of the pixels, uint8 `(height, width)`."""
    height, _ = coverage.shape
    rows = np.arange(height, dtype=float)
    margin = 0.06 * height
    walls = wall(rows, margin, 2 * margin) + wall(rows, height - 1 - margin, height - 1 - 2 * margin)
    light = LIGHT - (LIGHT - GLASS) * np.clip(walls, 0, 1)
    seen = light[:, None] * (1 - (1 - DARK) * coverage)
    return np.clip(seen + random.normal(0, NOISE, coverage.shape), 0, 255).round().astype(np.uint8)


def make(silhouettes: pathlib.Path, out: pathlib.Path) -> None:
    """Draw a frame for each silhouette."""
    out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    for file in sorted(silhouettes.glob("view_*.png")):
        coverage = np.asarray(Image.open(file).convert("L"), dtype=float) / 255
        Image.fromarray(frame(coverage, random)).save(out / file.name)
    shutil.copy(silhouettes / "camera.json", out / "camera.json")
    print(json.dumps({"frames": len(list(out.glob("view_*.png"))), "folder": str(out)}))


if __name__ == "__main__":
    make(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
