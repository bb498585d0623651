"""Frames and silhouettes of a turn to numbers and a model."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from . import _arrays, _native
from ._build import Build, build
from ._camera import Camera
from ._errors import InputError
from ._segment import Method as SegmentMethod
from ._segment import Profile, settings_json

if TYPE_CHECKING:
    import pandas as pd

Progress = Callable[[int, int], object]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
Angles = Sequence[float] | npt.NDArray[np.float64]
Views = npt.ArrayLike | Sequence[npt.ArrayLike] | Sequence[Profile]


@dataclasses.dataclass(frozen=True, eq=False)
class Volume:
    """Voxels in the smallest box around them, with a border of one empty voxel.

    Attributes:
        inside: bool `(x, y, z)`, Fortran order.
        origin_um: `(x, y, z)` of the centre of voxel `[0, 0, 0]`, in the unit of the cameras (um).
        voxel_um: edge of a voxel, in that unit.
    """

    inside: npt.NDArray[np.bool_]
    origin_um: tuple[float, float, float]
    voxel_um: float


class Model:
    """A surface and the voxels inside it, with the report of the command that gives the same numbers.

    Attributes:
        vertices: float64 `(vertices, 3)`, um.
        triangles: uint32 `(triangles, 3)`, indices in `vertices`, counter-clockwise seen from outside.
        report: the numbers. The keys are those of carved's files (docs/files.md), with their units.
        json: the text of `report`, byte for byte as the command writes it.
        warnings: reasons to doubt the numbers, in words.
    """

    def __init__(self, found: _native.Numbers) -> None:
        self._found = found
        self.vertices: npt.NDArray[np.float64] = found.vertices
        self.triangles: npt.NDArray[np.uint32] = found.triangles
        self.json: str = found.json
        self.report: dict[str, Any] = json.loads(found.json)
        self.warnings: list[str] = list(found.doubts)

    def volume(self) -> Volume | None:
        """The voxels that were counted. `None` for an empty capillary."""
        voxels = self._found.voxels()
        if voxels is None:
            return None
        zyx, (x, y, z), edge = voxels
        if self._found.mirrored:
            zyx, x = zyx[:, :, ::-1], -(x + (zyx.shape[2] - 1) * edge)
        return Volume(zyx.view(np.bool_).transpose(2, 1, 0), (x, y, z), edge)

    @property
    def _numbers(self) -> dict[str, Any]:
        found: dict[str, Any] = self.report.get("measurement", self.report)
        return found

    def _number(self, key: str) -> float | None:
        # Without a unit the keys have none either.
        value = self._numbers.get(key, self._numbers.get(key.rsplit("_um", 1)[0]))
        return None if value is None else float(value)

    @property
    def software(self) -> Build:
        """What computed the numbers: this module. `report` has no version, so that equal numbers are equal bytes."""
        return build

    @property
    def flags(self) -> list[str]:
        """What a reader must know of the numbers (docs/quality.md), for example `few_views`."""
        return [str(flag) for flag in self.report["flags"]]

    @property
    def volume_um3(self) -> float:
        """Volume by the estimator that is trusted, um^3."""
        return self._number("volume_um3") or 0.0

    @property
    def area_um2(self) -> float:
        """Surface area by the estimator that is trusted, um^2."""
        return self._number("area_um2") or 0.0

    @property
    def length_um(self) -> float | None:
        """Extent along the capillary, um. `None` for an empty capillary."""
        return self._number("length_um")

    def __repr__(self) -> str:
        flags = ", ".join(self.flags) or "no flags"
        return f"<carved.{type(self).__name__}: {self.volume_um3:.6g} um^3, {self.area_um2:.6g} um^2, {flags}>"


# Names of the tables' columns (docs/tables.md), and where their numbers are in the report of a measurement.
COLUMNS = {
    "estimator": "measurement.estimator",
    "estimator_fallback": "measurement.fallback",
    "volume_um3": "measurement.volume_um3",
    "volume_sd_um3": "measurement.volume_sd_um3",
    "area_um2": "measurement.area_um2",
    "area_sd_um2": "measurement.area_sd_um2",
    "shape_estimator": "shape.estimator",
    "body_length_um": "shape.body.length_um",
    "extent_along_um": "measurement.length_um",
    "diameter_um": "measurement.diameter_um",
    "sphere_rms_um": "measurement.sphere_rms_um",
    "aspect_ratio": "measurement.aspect_ratio",
    "sphericity": "shape.solid.sphericity",
    "bending_total_deg": "shape.body.bending.total_deg",
    "max_curvature_per_mm": "shape.body.bending.max_curvature_per_mm",
    "eye_volume_um3": "eyes.mean_volume_um3",
    "eye_volume_sd_um3": "eyes.mean_volume_sd_um3",
    "eye_distance_um": "eyes.distance_um",
    "eye_distance_sd_um": "eyes.distance_sd_um",
    "eye_axis_angle_deg": "eyes.axis_angle_deg",
    "bladder_state": "bladder.state",
    "bladder_probability": "bladder.probability",
    "bladder_volume_um3": "bladder.volume_um3",
    "bladder_volume_sd_um3": "bladder.volume_sd_um3",
    "bladder_length_um": "bladder.length_um",
    "bladder_length_sd_um": "bladder.length_sd_um",
    "support_volume_um3": "measurement.estimators.support.volume_um3",
    "support_area_um2": "measurement.estimators.support.area_um2",
    "voxel_volume_um3": "measurement.estimators.voxel.volume_um3",
    "voxel_area_um2": "measurement.estimators.voxel.area_um2",
    "field_volume_um3": "measurement.field_volume_um3",
    "field_area_um2": "measurement.field_area_um2",
}


class Hull(Model):
    """The voxels that the silhouettes leave, and their surface. The camera is used as it is, and no standard deviation is known."""


class Measurement(Model):
    """Volume, area and shape of a specimen with their standard deviations."""

    @property
    def volume_sd_um3(self) -> float | None:
        """Standard deviation of the volume, um^3. `None` where the voxels alone give the volume."""
        return self._number("volume_sd_um3")

    @property
    def area_sd_um2(self) -> float | None:
        """Standard deviation of the area, um^2. `None` where the voxels alone give the area."""
        return self._number("area_sd_um2")

    @property
    def diameter_um(self) -> float | None:
        """Diameter of the sphere nearest to the surface, um. `None` unless a bead is measured."""
        return self._number("diameter_um")

    @property
    def estimator(self) -> str:
        """The estimator that is trusted: `support` or `voxel`."""
        return str(self._numbers["estimator"])

    def to_dict(self) -> dict[str, float | int | str | bool | None]:
        """One flat row: numbers and flags by the names of the columns of `carved export table` (docs/tables.md).

        What the measurement does not have is `None`. `software_version` and `software_commit` are those of this module.
        """
        row: dict[str, float | int | str | bool | None] = {"flags": ";".join(self.flags), "flag_count": len(self.flags)}
        for column, path in COLUMNS.items():
            value: Any = self.report if "measurement" in self.report else {"measurement": self.report, "shape": self.report.get("shape")}
            for key in path.split("."):
                value = value.get(key) if isinstance(value, dict) else None
            row[column] = value
        row.update(software_version=build.version, software_commit=build.commit, software_dirty=build.dirty)
        return row

    def to_series(self, name: str | None = None) -> pd.Series[Any]:
        """The same row as a pandas Series. `pd.DataFrame([m.to_series("A01"), ...])` is a table. pandas must be installed.

        Args:
            name: name of the series, which becomes the label of its row.
        """
        import pandas as pd

        return pd.Series(self.to_dict(), name=name, dtype=object)


def measure(
    views: Views,
    angles: Angles,
    camera: Camera,
    *,
    kind: Literal["frames", "silhouettes"] | None = None,
    voxel_um: float = 6.93,
    epsilon: float = 0.05,
    box_um: Box | None = None,
    bead: bool = False,
    calibrate: bool = True,
    closure: npt.ArrayLike | None = None,
    empty: npt.ArrayLike | None = None,
    bayer: _arrays.Bayer | bool | None = None,
    segmentation: SegmentMethod | None = None,
    settings: Mapping[str, Any] | None = None,
    method: Mapping[str, Any] | None = None,
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Measurement:
    """Measure a specimen from the views of one turn.

    Frames are segmented and measured as `carved measure` does. Silhouettes are measured as `carved reconstruct` does: the same bytes.

    Args:
        views: frames, uint8 or uint16 `(views, height, width)` or `(views, height, width, 3)`; or silhouettes, bool or uint8 coverage
            `(views, height, width)` with 255 inside, or profiles of `segment`. A sequence of arrays will do, and so does all of which
            numpy makes an array (xarray, pandas, lists). Counts of 8, 10, 12 and 14 bits in uint16 are recognised by the largest one.
        angles: angle of the capillary in each view, rad, `(views,)`.
        camera: the camera of the rig.
        kind: `"frames"` or `"silhouettes"`. It must be given for grey uint8 pictures, which may be either.
        voxel_um: edge of a voxel, um.
        epsilon: share of the views that may miss a voxel, below 0.5.
        box_um: corners `((x, y, z), (x, y, z))` of the box that holds the specimen, um. Default: 5000 x 1000 x 1000 um around
            the origin.
        bead: fit a sphere.
        calibrate: find axis, roll and the other parameters that the turn shows, before measuring.
        closure: the frame at 360 deg, which is compared with the first one. Frames only.
        empty: frame of the empty capillary. Frames only.
        bayer: grey frames are Bayer mosaics: `"rggb"`, `"grbg"`, `"gbrg"` or `"bggr"`, the first four pixels row by row. `True` is
            `"rggb"`. Frames only.
        segmentation: `"hybrid"` (default) or `"level-set"`. Frames only.
        settings: keys of a method's `segment` table. Frames only.
        method: more keys of a method (docs/configuration.md), for example `{"quality": {...}}`. Frames only.
        names: names of the views in the report. Silhouettes only.
        progress: called with `(done, total)` in this thread after each step. An exception that it raises ends the work.

    Returns:
        The measurement. For frames, `report` has the keys of `measurement.json`; for silhouettes, those of `carved reconstruct`.

    Raises:
        TypeError: a dtype is wrong.
        InputError: a shape, a length or a value is wrong.
        MeasureError: the views give no numbers.
    """
    if kind is None:
        kind = _kind(views)
    if kind == "frames":
        return _frames(
            views,
            angles,
            camera,
            voxel_um,
            epsilon,
            box_um,
            bead,
            calibrate,
            closure,
            empty,
            bayer,
            segmentation,
            settings,
            method,
            progress,
        )
    if kind != "silhouettes":
        raise InputError(f"kind: found {kind!r}, expected 'frames' or 'silhouettes'")
    of_frames = {
        "closure": closure,
        "empty": empty,
        "segmentation": segmentation,
        "settings": settings,
        "method": method,
        "bayer": bayer or None,
    }
    for name, value in of_frames.items():
        if value is not None:
            raise InputError(f"{name}: silhouettes have none; it is an option of frames")
    masks = _silhouettes("views", views)
    found = _native.measure_silhouettes(
        masks,
        _arrays.names(names, len(masks)),
        _arrays.angles(angles, len(masks)),
        camera.to_json(),
        None,
        _options(box_um, voxel_um, "um", bead, calibrate, epsilon),
        progress,
    )
    return Measurement(found)


def carve(
    silhouettes: Views,
    projections: npt.NDArray[np.float64],
    *,
    voxel: float | None = None,
    box: Box | None = None,
    epsilon: float = 0.05,
    unit: Literal["um", "none"] = "um",
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Hull:
    """Carve the hull of silhouettes of any cameras, as `carved reconstruct` does with matrices. The cameras are not calibrated.

    Args:
        silhouettes: bool or uint8 coverage `(views, height, width)` with 255 inside, or profiles of `segment`.
        projections: float64 `(views, 3, 4)`, `(u w, v w, w) = P (x, y, z, 1)`. `Camera.projections` makes them of angles.
        voxel: edge of a voxel in the unit of the projections. Default: 6.93 um; without a unit, 15 million voxels in the box.
        box: corners `((x, y, z), (x, y, z))` of the box to carve. Default: 5000 x 1000 x 1000 um around the origin; without a
            unit, what the silhouettes' bounding rectangles have in common.
        epsilon: share of the views that may miss a voxel, below 0.5.
        unit: `"um"`, or `"none"` for a world of any other unit. The report then has no unit in its keys.
        names: names of the views in the report.
        progress: called with `(done, total)` in this thread after each step. An exception that it raises ends the work.

    Returns:
        The hull: mesh, and voxels by `Hull.volume()`.

    Raises:
        TypeError: a dtype is wrong.
        InputError: a shape, a length or a value is wrong.
        MeasureError: no voxel is left.
    """
    masks = _silhouettes("silhouettes", silhouettes)
    matrices = np.asarray(projections)
    if matrices.dtype.kind not in "fiu":
        raise TypeError(f"projections: the dtype is {matrices.dtype}, expected float64")
    if matrices.shape != (len(masks), 3, 4):
        raise InputError(f"projections: the shape is {matrices.shape}, expected ({len(masks)}, 3, 4): one matrix per view")
    if unit not in ("um", "none"):
        raise InputError(f"unit: found {unit!r}, expected 'um' or 'none'")
    found = _native.measure_silhouettes(
        masks,
        _arrays.names(names, len(masks)),
        [],
        None,
        np.ascontiguousarray(matrices, dtype=np.float64),
        _options(box, voxel, unit, False, False, epsilon),
        progress,
    )
    return Hull(found)


def _kind(views: Views) -> Literal["frames", "silhouettes"]:
    first = _arrays.items("views", views)[0]
    if isinstance(first, Profile):
        return "silhouettes"
    array = _arrays.array("views[0]", first)
    if array.dtype == np.bool_:
        return "silhouettes"
    if array.ndim == 3 or array.dtype == np.uint16:
        return "frames"
    raise InputError("kind: grey pictures may be frames or silhouettes; give kind='frames' or kind='silhouettes'")


def _silhouettes(name: str, views: Views) -> list[npt.NDArray[np.uint8]]:
    found = _arrays.items(name, views)
    return _arrays.silhouettes(name, [view.mask if isinstance(view, Profile) else view for view in found])


def _box(box: Box | None) -> dict[str, list[float]] | None:
    if box is None:
        return None
    corners = np.asarray(box, dtype=np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise InputError(f"box: found {box!r}, expected two corners ((x, y, z), (x, y, z)) of finite numbers")
    return {"min": corners[0].tolist(), "max": corners[1].tolist()}


def _finite(name: str, value: float) -> float:
    found = float(value)
    if not np.isfinite(found):
        raise InputError(f"{name}: found {value}, expected a finite number")
    return found


def _options(box: Box | None, voxel: float | None, unit: str, bead: bool, calibrate: bool, epsilon: float) -> str:
    return json.dumps(
        {
            "bounds": _box(box),
            "voxel": None if voxel is None else _finite("voxel", voxel),
            "unit": unit,
            "sphere": bool(bead),
            "calibrate": bool(calibrate),
            "epsilon": _finite("epsilon", epsilon),
            "surface": {},
        }
    )


def _frames(
    views: Views,
    angles: Angles,
    camera: Camera,
    voxel_um: float,
    epsilon: float,
    box_um: Box | None,
    bead: bool,
    calibrate: bool,
    closure: npt.ArrayLike | None,
    empty: npt.ArrayLike | None,
    bayer: _arrays.Bayer | bool | None,
    segmentation: SegmentMethod | None,
    settings: Mapping[str, Any] | None,
    method: Mapping[str, Any] | None,
    progress: Progress | None,
) -> Measurement:
    frames = _arrays.pictures("views", views)
    mosaic = _arrays.bayer(bayer, frames[0])
    more = dict(method or {})
    keys: dict[str, Any] = {
        **more,
        "asd": len(frames),
        "order": "sequential",
        "epsilon": _finite("epsilon", epsilon),
        "voxel_um": _finite("voxel_um", voxel_um),
        "segment": {**more.get("segment", {}), **settings_json(segmentation, settings)},
        "calibration": {**more.get("calibration", {}), **({} if calibrate else {"enabled": False})},
    }
    keys.pop("early_stop", None)
    if box_um is not None:
        keys["box_um"] = _box(box_um)
    others: list[_arrays.Counts | None] = []
    for name, frame in (("closure", closure), ("empty", empty)):
        other = None if frame is None else _arrays.picture(name, frame)
        if other is not None and other.shape != frames[0].shape:
            raise InputError(f"{name}: the shape is {other.shape}, expected {frames[0].shape} as the frames")
        others.append(other)
    in_eight = iter(_arrays.eight_bits([*frames, *(other for other in others if other is not None)]))
    in_bytes = [next(in_eight) for _ in frames]
    of_closure, of_empty = (None if other is None else next(in_eight) for other in others)
    found = _native.measure_frames(
        in_bytes,
        mosaic,
        _arrays.angles(angles, len(frames)),
        of_closure,
        of_empty,
        camera.to_json(),
        json.dumps(keys),
        bool(bead),
        progress,
    )
    return Measurement(found)
