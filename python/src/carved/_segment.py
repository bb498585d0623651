"""The outline of a specimen in one picture."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _arrays, _native
from ._errors import InputError

Method = Literal["hybrid", "level-set"]


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """The outline of the specimen in one picture. Pixel centres are at integers, u to the right, v down.

    Attributes:
        mask: uint8 `(height, width)`, 255 inside, 0 outside. Read-only, a view of the memory of the Rust code.
        outlines: closed outlines at sub-pixel positions, float64 `(points, 2)` each, `[u, v]` in px. Empty in an empty
            capillary.
        body: the same without the fins that only their border shows.
        contrast_sigma: for each outline, height of the step per point in standard deviations of a pixel's noise.
        error_px: for each outline, standard error of the position per point, px; infinite where no edge could be fitted.
        bounded: for each outline, bool per point: on a wall or on the border of the picture.
        report: area in px and px^2, detection, quality and walls, as `carved segment` writes them under `profile`.
        warnings: reasons to doubt the outline.
        json: the text of `report`.
    """

    mask: npt.NDArray[np.uint8]
    outlines: list[npt.NDArray[np.float64]]
    body: list[npt.NDArray[np.float64]]
    contrast_sigma: list[npt.NDArray[np.float64]]
    error_px: list[npt.NDArray[np.float64]]
    bounded: list[npt.NDArray[np.bool_]]
    report: dict[str, Any]
    warnings: list[str]
    json: str

    @property
    def kind(self) -> str:
        """What the picture shows: `larva`, `bead`, `two`, `bubble`, `debris` or `empty`."""
        return str(self.report["detection"]["kind"])

    @property
    def area_px2(self) -> float:
        """Area inside the outlines, px^2."""
        return float(self.report["area_px2"])

    def __repr__(self) -> str:
        return f"<carved.Profile: {self.kind}, {self.area_px2:.0f} px^2, {len(self.outlines)} outline(s)>"


def settings_json(method: Method | None, settings: Mapping[str, Any] | None) -> dict[str, Any]:
    """The keys of a method's `segment` table."""
    if method not in (None, "hybrid", "level-set"):
        raise InputError(f"method: found {method!r}, expected 'hybrid' or 'level-set'")
    found = dict(settings or {})
    if method is not None:
        found["method"] = method
    return found


def segment(
    image: npt.ArrayLike,
    *,
    method: Method | None = None,
    settings: Mapping[str, Any] | None = None,
    empty: npt.ArrayLike | None = None,
    bayer: _arrays.Bayer | bool | None = None,
) -> Profile:
    """Find the outline of the specimen in a picture of its capillary. Both walls must be in view.

    Args:
        image: uint8 or uint16, `(height, width)` for grey or `(height, width, 3)` for red, green, blue. Counts of 8, 10, 12 and 14 bits
            in uint16 are recognised by the largest one.
        method: `"hybrid"` (default) or `"level-set"`.
        settings: keys of a method's `segment` table (docs/configuration.md), for example `{"edge": {"blur_px": 1.5}}`. `faint_sure`
            is 2 here, because no other view tells a faint fin from dust; state 1 for the views of a turn.
        empty: picture of the empty capillary of the same shape. What it shows is not taken for the specimen.
        bayer: a grey image is a Bayer mosaic: `"rggb"`, `"grbg"`, `"gbrg"` or `"bggr"`, the first four pixels row by row. `True`
            is `"rggb"`.

    Returns:
        The profile. Its mask is empty where the capillary is empty.

    Raises:
        TypeError: an array is not uint8 or uint16.
        InputError: a shape or a setting is wrong.
        SegmentError: the picture gives no profile.
    """
    pixels = _arrays.picture("image", image)
    mosaic = _arrays.bayer(bayer, pixels)
    other = None if empty is None else _arrays.picture("empty", empty)
    if other is not None and other.shape != pixels.shape:
        raise InputError(f"empty: the shape is {other.shape}, expected {pixels.shape} as the image")
    in_eight = _arrays.eight_bits([pixels] if other is None else [pixels, other])
    found = _native.segment(in_eight[0], mosaic, json.dumps(settings_json(method, settings)), None if other is None else in_eight[1])
    warnings = []
    if found.blocks is not None:
        warnings.append(
            f"lossy compression left steps between its blocks {found.blocks:.1f} times those inside them: the outline may be wrong; "
            "save pictures without loss, or as JPEG of quality 95"
        )
    if found.mosaic is not None:
        warnings.append(
            f"this looks like a colour camera's mosaic: every second pixel differs from those beside it by {found.mosaic:.1f} grey "
            "values in the mean; use bayer=, or give the picture in colour"
        )
    return Profile(
        mask=found.mask,
        outlines=found.outlines,
        body=found.body,
        contrast_sigma=found.contrast,
        error_px=found.error_px,
        bounded=found.bounded,
        report=json.loads(found.json),
        warnings=warnings,
        json=found.json,
    )
