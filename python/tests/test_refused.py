"""Wrong input is an exception that says what was found and what is expected."""

import dataclasses
import pathlib
import shutil
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Turn

import carved

BLANK = np.zeros((3, 160, 512), np.uint8)


def of(turn: Turn, **more: Any) -> Callable[..., carved.Measurement]:
    def call(views: Any = turn.views, angles: Any = turn.angles, camera: Any = turn.camera) -> carved.Measurement:
        return carved.measure(views, angles, camera, **{"kind": "silhouettes", "voxel_um": 20, **more})

    return call


@pytest.mark.parametrize(
    ("views", "angles", "error", "said"),
    [
        ([np.zeros((4, 5), np.float64)], [0.0], TypeError, r"views\[0\]: the dtype is float64, expected bool, or uint8"),
        (np.zeros((4, 5), np.uint8), [0.0], carved.InputError, r"the shape is \(4, 5\), expected \(views, height, width\)"),
        (np.zeros((2, 4, 5, 3), np.uint8), [0.0, 1.0], carved.InputError, r"views\[0\]: the shape is \(4, 5, 3\)"),
        ([], [], carved.InputError, "found 0 views"),
        (7, [], TypeError, "found int"),
        (["x"], [0.0], TypeError, r"views\[0\]: found str"),
        (np.zeros((1, 0, 5), np.uint8), [0.0], carved.InputError, "expected at least one pixel"),
        (BLANK, [0.0, 1.0], carved.InputError, "found 2 angles for 3 views"),
        (BLANK, [0.0, float("nan"), 1.0], carved.InputError, "found nan for view 1"),
        (BLANK, [0.0, float("inf"), 1.0], carved.InputError, "found inf for view 1"),
        (BLANK, [0.0, 120.0, 240.0], carved.InputError, r"found 120 for view 1 .* numpy.radians\(angles\) converts degrees"),
        (BLANK, ["a", "b", "c"], TypeError, "expected one list of numbers"),
        ([BLANK[0], BLANK[1, :-1], BLANK[2]], [0.0, 1.0, 2.0], carved.InputError, r"views\[1\]: the shape is \(159, 512\)"),
        (np.ones((1, 160, 512), np.uint8), [0.0], carved.InputError, "the largest value is 1, expected 255"),
        (np.zeros((3, 20, 30), np.uint8), [0.0, 1.0, 2.0], carved.InputError, "30 x 20 px, but the camera gives the sensor as 512 x 160"),
    ],
)
def test_views_and_angles(ellipsoid: Turn, views: Any, angles: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        of(ellipsoid)(views, angles)


def test_too_few_views(ellipsoid: Turn) -> None:
    with pytest.raises(carved.MeasureError, match="1 of 1 views show something; 4 are needed"):
        of(ellipsoid)(ellipsoid.views[:1], ellipsoid.angles[:1])
    with pytest.raises(carved.MeasureError, match="directions"):
        of(ellipsoid)(ellipsoid.views, np.zeros(24))


def test_an_empty_capillary_has_no_volume(ellipsoid: Turn) -> None:
    found = of(ellipsoid)(np.zeros_like(ellipsoid.views))
    assert (found.volume_um3, found.flags, found.volume(), len(found.vertices)) == (0.0, ["empty"], None, 0)


@pytest.mark.parametrize(
    ("more", "error", "said"),
    [
        ({"voxel_um": 0}, carved.InputError, "voxel size is 0"),
        ({"voxel_um": float("nan")}, carved.InputError, "voxel: found nan"),
        ({"voxel_um": 1e-3}, carved.InputError, "voxels of size 0.001"),
        ({"epsilon": 1}, carved.InputError, "epsilon is 1"),
        ({"box_um": ((0, 0, 0), (0, 1, 1))}, carved.InputError, "on axis x it runs from 0 to 0"),
        ({"box_um": ((0, 0), (1, 1))}, carved.InputError, "expected two corners"),
        ({"names": ["a"]}, carved.InputError, "names: found 1 for 24 views"),
        ({"kind": "pictures"}, carved.InputError, "expected 'frames' or 'silhouettes'"),
        ({"kind": None}, carved.InputError, "grey pictures may be frames or silhouettes"),
        ({"closure": BLANK[0]}, carved.InputError, "closure: silhouettes have none"),
        ({"progress": 3}, TypeError, "not callable"),
    ],
)
def test_options(ellipsoid: Turn, more: dict[str, Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        of(ellipsoid, **more)()


def test_frames(frames: Turn) -> None:
    measure = of(frames, kind="frames")
    with pytest.raises(carved.MeasureError, match="0 of 3 views gave a profile"):
        measure(frames.views[:3] * 0 + 200, frames.angles[:3])
    with pytest.raises(carved.InputError, match="asd = 1; expected"):
        measure(frames.views[:1], frames.angles[:1])
    with pytest.raises(carved.InputError, match="the frame is 510 x 160 px, the rig's camera 512 x 160 px"):
        measure(frames.views[:, :, :-2])
    with pytest.raises(carved.InputError, match="the picture is in colour"):
        of(frames, kind="frames", bayer=True)(np.repeat(frames.views[..., None], 3, axis=3))
    with pytest.raises(carved.InputError, match="bayer: found 'rgbg', expected True or one of rggb, grbg, gbrg, bggr"):
        of(frames, kind="frames", bayer="rgbg")()
    with pytest.raises(carved.InputError, match="unknown field `nonsense`"):
        of(frames, kind="frames", settings={"nonsense": 1})()
    with pytest.raises(carved.InputError, match="closure: the shape is"):
        of(frames, kind="frames", closure=frames.views[0, 2:])()


def test_pictures(frames: Turn) -> None:
    with pytest.raises(carved.SegmentError, match="black"):
        carved.segment(np.zeros((160, 512), np.uint8))
    with pytest.raises(carved.SegmentError, match="at least"):
        carved.segment(np.zeros((1, 1), np.uint8))
    with pytest.raises(TypeError, match="the dtype is uint32, expected uint8 or uint16"):
        carved.segment(frames.views[0].astype(np.uint32))
    with pytest.raises(TypeError, match="the dtypes are uint8 and uint16"):
        carved.segment(frames.views[0].astype(np.uint16), empty=frames.views[0])
    with pytest.raises(carved.InputError, match="expected rows of one length"):
        carved.segment([[1, 2], [3]])
    with pytest.raises(TypeError, match="image: found dict, expected an array"):
        carved.segment({})  # type: ignore[arg-type]
    with pytest.raises(carved.InputError, match=r"expected \(height, width\)"):
        carved.segment(np.zeros((4, 4, 4), np.uint8))
    with pytest.raises(carved.InputError, match=r"edge\.blur_px"):
        carved.segment(frames.views[0], settings={"edge": {"blur_px": -1}})
    with pytest.raises(carved.InputError, match="expected 'hybrid' or 'level-set'"):
        carved.segment(frames.views[0], method="best")  # type: ignore[arg-type]
    with pytest.raises(carved.InputError, match="empty: the shape is"):
        carved.segment(frames.views[0], empty=frames.views[0, 1:])


def test_projections(ellipsoid: Turn) -> None:
    with pytest.raises(carved.InputError, match=r"expected \(24, 3, 4\)"):
        carved.carve(ellipsoid.views, np.zeros((2, 3, 4)))
    with pytest.raises(carved.InputError, match=r"matrix 0 \(counted from 0\): projection: the left 3 x 3 part has determinant 0"):
        carved.carve(ellipsoid.views, np.zeros((24, 3, 4)))
    matrices = ellipsoid.camera.projections(ellipsoid.angles)
    with pytest.raises(carved.InputError, match="row 1, column 2 is NaN"):
        carved.carve(ellipsoid.views, np.where(np.arange(12).reshape(3, 4) == 6, np.nan, matrices))
    with pytest.raises(carved.InputError, match="no box was given"):
        carved.carve(np.zeros_like(ellipsoid.views), matrices, unit="none")


def test_cameras(ellipsoid: Turn) -> None:
    with pytest.raises(carved.InputError, match="kx is -1; it must be a finite number above 0"):
        dataclasses.replace(ellipsoid.camera, kx=-1)
    with pytest.raises(carved.InputError, match="uy is nan"):
        dataclasses.replace(ellipsoid.camera, uy=float("nan"))
    with pytest.raises(carved.InputError, match="missing"):
        carved.Camera.from_dict({"f": 6e4})


def test_calibrations(ellipsoid: Turn) -> None:
    with pytest.raises(carved.InputError, match="least-squares has its own way"):
        carved.calibrate(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, free=["uy"])
    with pytest.raises(carved.InputError, match="tilt"):
        carved.calibrate(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, objective="vrv", free=["tilt"])
    with pytest.raises(carved.InputError, match="nothing is left to search"):
        carved.calibrate(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, objective="vrv", free=["kx"])
    with pytest.raises(carved.MeasureError, match="all 24 silhouettes are blank"):
        carved.calibrate(np.zeros_like(ellipsoid.views), ellipsoid.angles, ellipsoid.camera)


def test_recordings(recording: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with pytest.raises(carved.RecordingError, match="nothing"):
        carved.read(tmp_path / "nothing")
    opened = carved.read(recording)
    with pytest.raises(carved.InputError, match="Possible numbers: 3, 4, 6, 8, 12, 24"):
        opened.measure(5)
    with pytest.raises(IndexError):
        opened.frames[24]
    copy = tmp_path / "A01"
    shutil.copytree(recording, copy)
    (copy / "frames" / "view_003.png").unlink()
    with pytest.raises(carved.RecordingError, match="view_003"):
        carved.read(copy).measure()
