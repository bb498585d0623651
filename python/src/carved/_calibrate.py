"""Axis, roll and the other parameters that one turn shows."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _arrays, _native
from ._camera import Camera
from ._errors import InputError
from ._measure import Angles, Views, _finite, _silhouettes


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """The camera and the angles that fit the silhouettes of a turn.

    Attributes:
        camera: the calibrated camera.
        angles: float64 `(views,)`, calibrated angle of each view that counts, rad.
        shifts_px: float64 `(views,)`, shift of each of these views down the image, px.
        report: what `carved calibrate specimen` prints.
        json: the text of `report`, byte for byte as the command prints it.
        warnings: reasons to doubt the calibration, in words.
    """

    camera: Camera
    angles: npt.NDArray[np.float64]
    shifts_px: npt.NDArray[np.float64]
    report: dict[str, Any]
    json: str
    warnings: list[str]


def calibrate(
    silhouettes: Views,
    angles: Angles,
    camera: Camera,
    *,
    objective: Literal["least-squares", "vrv", "coherence"] = "least-squares",
    free: Sequence[str] = (),
    epsilon: float = 0.0,
    voxel_um: float = 10.0,
    evaluations: int = 2000,
    names: Sequence[str] | None = None,
) -> Calibration:
    """Find the parameters of the camera that one turn shows, as `carved calibrate specimen` does.

    Args:
        silhouettes: bool or uint8 coverage `(views, height, width)` with 255 inside, or profiles of `segment`.
        angles: angle of the capillary in each view, rad, `(views,)`.
        camera: the camera as the rig knows it.
        objective: `"least-squares"` of the edges, or a search for the largest `"vrv"` (the volume that no view misses) or
            `"coherence"` (overlap with the hull).
        free: parameters that `"vrv"` and `"coherence"` may change, for example `["uy", "gamma=1"]`; a range in px or deg
            may follow. Default: uy and gamma.
        epsilon: share of the views that may miss a voxel, for `"vrv"`.
        voxel_um: edge of a voxel for `"vrv"`, um.
        evaluations: maximum number of evaluations of the objective.
        names: names of the views in the report.

    Raises:
        TypeError: a dtype is wrong.
        InputError: a shape, a length or a value is wrong.
        MeasureError: the silhouettes do not determine the parameters.
    """
    if objective not in ("least-squares", "vrv", "coherence"):
        raise InputError(f"objective: found {objective!r}, expected 'least-squares', 'vrv' or 'coherence'")
    if objective == "least-squares" and (free or epsilon):
        raise InputError("free and epsilon: least-squares has its own way; leave them out, or use 'vrv' or 'coherence'")
    if evaluations < 0:
        raise InputError(f"evaluations: found {evaluations}, expected a whole number from 0 on")
    masks = _silhouettes("silhouettes", silhouettes)
    report, psi, omega, shifts, doubts = _native.calibrate(
        masks,
        _arrays.names(names, len(masks)),
        _arrays.angles(angles, len(masks)),
        camera.to_json(),
        objective,
        list(free),
        _finite("epsilon", epsilon),
        _finite("voxel_um", voxel_um),
        evaluations,
    )
    return Calibration(Camera.from_dict(json.loads(psi)), np.array(omega), np.array(shifts), json.loads(report), report, doubts)
