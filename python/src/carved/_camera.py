"""The camera of a rig."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arrays, _native
from ._errors import InputError


@dataclasses.dataclass(frozen=True)
class Camera:
    """The camera of a rig and the axis of its capillary, as in `camera.json`.

    World: x along the capillary, y and z across it, um, origin on the axis. At angle 0 the camera looks along z.
    Image: column u to the right, row v down, px, pixel centres at integers.

    Attributes:
        f: distance of the projection centre from the axis, um.
        kx: scale at the axis along the capillary, px/um.
        ky: scale at the axis across the capillary, px/um.
        ux: column of the principal point, px.
        uy: row of the principal point, px.
        width: width of the sensor, px.
        height: height of the sensor, px.
        s: skew, px/um.
        alpha: tilt of the capillary towards the camera, rad.
        gamma: roll of the capillary in the image, rad.
        phi: elevation of the projection centre, rad; nominally a quarter turn.
        glass: the tube that turns the rays, as in `camera.json`: `bore_radius_um`, `outer_radius_um`, and the refractive indices
            `inside`, `glass`, `outside`. `None`: rays are not turned.
    """

    f: float
    kx: float
    ky: float
    ux: float
    uy: float
    width: int
    height: int
    s: float = 0.0
    alpha: float = 0.0
    gamma: float = 0.0
    phi: float = math.pi / 2
    glass: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        for field in ("f", "kx", "ky", "ux", "uy", "s", "alpha", "gamma", "phi"):
            value = getattr(self, field)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
                raise TypeError(f"camera: {field} is a {type(value).__name__}, expected a number")
            if not math.isfinite(value) or (field in ("f", "kx", "ky") and value <= 0):
                above = " above 0" if field in ("f", "kx", "ky") else ""
                raise InputError(f"camera: {field} is {value}; it must be a finite number{above}")
            object.__setattr__(self, field, float(value))
        for field in ("width", "height"):
            value = getattr(self, field)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
                raise TypeError(f"camera: {field} is a {type(value).__name__}, expected a whole number of px")
            if not 1 <= value < 2**32:
                raise InputError(f"camera: {field} is {value} px; it must be at least 1")
            object.__setattr__(self, field, int(value))

        if self.glass is not None and not isinstance(self.glass, Mapping):
            raise TypeError(f"camera: glass is a {type(self.glass).__name__}, expected the numbers of the tube by name, or None")

    @classmethod
    def published(cls, width: int, height: int) -> Camera:
        """The camera of the published rig: 60 mm from the axis, 5.5 um per px, the axis in the middle of the sensor."""
        scale = 1.0 / 5.5
        return cls(60_000.0, scale, scale, (width - 1) / 2, (height - 1) / 2, width, height)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Camera:
        """The camera of a `camera.json` that was read. Keys of other things, such as `omega`, are left out."""
        fields = {field.name for field in dataclasses.fields(cls)}
        try:
            return cls(**{key: value for key, value in values.items() if key in fields})
        except TypeError as error:
            raise InputError(f"camera: {error}") from None

    @classmethod
    def read(cls, file: str | os.PathLike[str]) -> tuple[Camera, npt.NDArray[np.float64] | None]:
        """Read `camera.json`: the camera, and the angles `omega` in rad if the file has them."""
        with open(file, encoding="utf-8") as source:
            values = json.load(source)
        if not isinstance(values, dict):
            raise InputError(f"{os.fspath(file)}: found a {type(values).__name__}, expected an object with f, kx, ky, ux, uy")
        omega = values.get("omega")
        return cls.from_dict(values), None if omega is None else np.asarray(omega, dtype=np.float64)

    def to_json(self) -> str:
        """The text of `camera.json`, without angles."""
        found = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        if self.glass is None:
            del found["glass"]
        else:
            found["glass"] = dict(self.glass)
        return json.dumps(found)

    def projections(self, angles: Sequence[float] | npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The projection of each view, float64 `(views, 3, 4)`: `(u w, v w, w) = P (x, y, z, 1)`; u, v in px, w in um."""
        return _native.projections(self.to_json(), _arrays.angles(angles, len(angles)))
