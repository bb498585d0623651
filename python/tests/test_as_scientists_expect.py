"""Arrays of other libraries, frames of 16 bits, rows for pandas, and figures."""

import pathlib
import re
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import xarray as xr
from conftest import Turn, run
from PIL import Image

import carved


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_frames_of_16_bits_are_read_as_the_program_reads_their_files(frames: Turn, bits: int, tmp_path: pathlib.Path) -> None:
    random = np.random.default_rng(bits)
    counts = frames.views.astype(np.uint16) << (bits - 8)
    # The bits below the eight, which differ from pixel to pixel; and one pixel whose count needs all bits.
    counts |= random.integers(0, 1 << (bits - 8), counts.shape, dtype=np.uint16)
    counts[:, 0, 0] = (1 << bits) - 1
    folder = tmp_path / "frames"
    folder.mkdir()
    for name, view in zip(frames.names, counts, strict=True):
        Image.fromarray(view).save(folder / name)
    (folder / "camera.json").write_bytes((frames.folder / "camera.json").read_bytes())
    run("import", folder, "--cameras", folder / "camera.json", "--out", tmp_path / "A01", "--voxel", "20")
    stored = carved.read(tmp_path / "A01")
    expected = stored.measure().report
    quality = {"quality": stored.info["method"]["quality"]}
    found = carved.measure(counts, stored.angles, stored.camera, kind="frames", voxel_um=20, method=quality)
    assert found.report == {key: expected[key] for key in found.report}
    first = carved.segment(counts[0])
    assert first.json == carved.segment(stored.frames[0]).json
    # The kind follows from the dtype, and the order of the bytes does not matter.
    other = carved.measure(counts.astype(">u2"), stored.angles, stored.camera, voxel_um=20, method=quality)
    assert other.json == found.json


@pytest.mark.parametrize(("order", "red"), [("rggb", (0, 0)), ("grbg", (0, 1)), ("gbrg", (1, 0)), ("bggr", (1, 1))])
def test_mosaics_of_every_order_are_read_as_the_program_reads_their_files(
    frames: Turn, order: Any, red: tuple[int, int], tmp_path: pathlib.Path
) -> None:
    # The filters of the camera let through less red and more green.
    mosaics = frames.views.astype(np.float64)
    mosaics[:, red[0] :: 2, red[1] :: 2] *= 0.8
    for row, column in [(red[0], 1 - red[1]), (1 - red[0], red[1])]:
        mosaics[:, row::2, column::2] = np.minimum(mosaics[:, row::2, column::2] * 1.1, 250)
    views = mosaics.astype(np.uint8)
    folder = tmp_path / "frames"
    folder.mkdir()
    for name, view in zip(frames.names, views, strict=True):
        Image.fromarray(view).save(folder / name)
    run("import", folder, "--cameras", frames.folder / "camera.json", "--out", tmp_path / "A01", "--voxel", "20", f"--bayer={order}")
    stored = carved.read(tmp_path / "A01")
    assert stored.bayer == order
    expected = stored.measure().report
    quality = {"quality": stored.info["method"]["quality"]}
    found = carved.measure(views, stored.angles, stored.camera, kind="frames", voxel_um=20, method=quality, bayer=stored.bayer)
    assert found.report == {key: expected[key] for key in found.report}
    assert np.array_equal(np.asarray(stored.frames), views)
    assert carved.segment(views[0], bayer=order).json == carved.segment(stored.frames[0], bayer=stored.bayer).json
    other: Any = "grbg" if order in ("rggb", "bggr") else "rggb"
    with pytest.raises(carved.InputError, match=f"the green pixels of a mosaic {other} differ by"):
        carved.segment(views[0], bayer=other)


def test_all_that_numpy_makes_an_array_of_will_do(ellipsoid: Turn, frames: Turn) -> None:
    expected = carved.segment(frames.views[0]).json
    kinds: list[Any] = [
        xr.DataArray(frames.views[0], dims=("v", "u")),
        pd.DataFrame(frames.views[0].astype(int)),
        Image.fromarray(frames.views[0]),
        frames.views[0].tolist(),
    ]
    assert [carved.segment(kind).json for kind in kinds] == [expected] * len(kinds)
    masks = xr.DataArray(ellipsoid.views, dims=("view", "v", "u"))
    angles = pd.Series(ellipsoid.angles)
    found = carved.measure(masks, angles, ellipsoid.camera, kind="silhouettes", voxel_um=20)  # type: ignore[arg-type]
    same = carved.measure(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, kind="silhouettes", voxel_um=20)
    assert found.json == same.json
    of_bools = carved.measure(masks > 127, ellipsoid.angles, ellipsoid.camera, voxel_um=20)
    assert of_bools.volume_um3 == pytest.approx(same.volume_um3, rel=0.02)


def test_frames_of_a_recording_are_a_sequence_beside_its_angles(recording: pathlib.Path, frames: Turn) -> None:
    opened = carved.read(recording)
    assert len(opened.frames) == len(opened.angles) == len(opened) == 24
    assert np.array_equal(np.asarray(opened.frames), frames.views)
    assert np.array_equal(opened.frames[-1], frames.views[-1])
    assert [len(opened.frames[::5]), len(list(opened.frames[3:5]))] == [5, 2]
    assert not opened.frames[0].flags.writeable
    direct = carved.measure(opened.frames, opened.angles, opened.camera, kind="frames", voxel_um=20)
    assert direct.json == carved.measure(frames.views, opened.angles, opened.camera, kind="frames", voxel_um=20).json


def test_the_camera_of_a_recording_keeps_its_glass(frames: Turn) -> None:
    glass = {"bore_radius_um": 400.0, "outer_radius_um": 500.0, "inside": 1.333, "glass": 1.473, "outside": 1.333}
    camera = carved.Camera.from_dict({"f": 6e4, "kx": 0.18, "ky": 0.18, "ux": 256, "uy": 80, "width": 512, "height": 160, "glass": glass})
    assert camera.glass == glass
    plain = carved.Camera.from_dict({"f": 6e4, "kx": 0.18, "ky": 0.18, "ux": 256, "uy": 80, "width": 512, "height": 160})

    def volume(camera: carved.Camera) -> float:
        return carved.measure(frames.views, frames.angles, camera, kind="frames", voxel_um=20).volume_um3

    assert volume(camera) != volume(plain)
    with pytest.raises(TypeError, match="glass is a float"):
        carved.Camera(6e4, 0.18, 0.18, 256, 80, 512, 160, glass=1.4)  # type: ignore[arg-type]


def test_a_measurement_is_a_row_with_the_names_of_the_columns(frames: Turn, ellipsoid: Turn) -> None:
    found = carved.measure(frames.views, frames.angles, frames.camera, kind="frames", voxel_um=20)
    row = found.to_dict()
    columns = set(re.findall(r"^\| `(\w+)` \|", run("export", "columns"), re.MULTILINE))
    assert len(columns) > 50
    assert set(row) <= columns, set(row) - columns
    assert row["volume_um3"] == found.volume_um3
    assert (row["estimator"], row["shape_estimator"]) == (found.estimator, "field")
    assert row["body_length_um"] == found.report["shape"]["body"]["length_um"]
    assert (row["flag_count"], row["software_version"]) == (len(found.flags), carved.__version__)
    # The body in these frames has no eyes and no swim bladder.
    missing = {key for key, value in row.items() if value is None and not key.startswith(("eye_", "bladder_"))}
    assert missing <= {"estimator_fallback", "diameter_um", "sphere_rms_um", "aspect_ratio", "software_dirty"}, missing
    series = found.to_series("A01")
    table = pd.DataFrame([series])
    assert table.loc["A01", "volume_um3"] == found.volume_um3
    silhouettes = carved.measure(ellipsoid.views > 127, ellipsoid.angles, ellipsoid.camera, voxel_um=20)
    assert silhouettes.to_dict().keys() == row.keys()
    assert silhouettes.to_dict()["volume_um3"] == silhouettes.volume_um3


def inked(figure: Any) -> npt.NDArray[np.uint8]:
    figure.canvas.draw()
    pixels: npt.NDArray[np.uint8] = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    plt.close(figure)
    return pixels


def has(pixels: npt.NDArray[np.uint8], colour: tuple[int, int, int]) -> bool:
    return bool((np.abs(pixels.astype(int) - colour).max(axis=2) < 40).any())


ORANGE = (255, 127, 14)


def test_views_are_drawn_with_their_outlines(recording: pathlib.Path, frames: Turn) -> None:
    figure = carved.plot_views(carved.read(recording), most=4)
    titles = [place.get_title() for place in figure.axes if place.get_title()]
    assert [title.split(",")[0] for title in titles] == ["view 0", "view 6", "view 12", "view 18"]
    lines = [place.get_lines() for place in figure.axes if place.get_title()]
    drawn = np.asarray(lines[0][0].get_xydata())
    outline = carved.segment(frames.views[0]).outlines[0]
    assert np.allclose(drawn[:-1], outline)
    assert has(inked(figure), ORANGE)
    plain = carved.plot_views(frames.views.astype(np.uint16) << 4, most=40, outlines=False)
    assert len([place for place in plain.axes if place.get_title()]) == 24
    assert not has(inked(plain), ORANGE)
    with pytest.raises(carved.InputError, match="expected 1 or more"):
        carved.plot_views(frames.views, most=0)


def test_a_model_is_drawn_with_its_size(ellipsoid: Turn) -> None:
    hull = carved.carve(ellipsoid.views, ellipsoid.camera.projections(ellipsoid.angles), voxel=20)
    figure = carved.plot_model(hull)
    seen, above = figure.axes[:2]
    picture = np.asarray(seen.get_images()[0].get_array())
    volume = hull.volume()
    assert volume is not None
    assert picture.sum() * 20**2 == pytest.approx(volume.inside.sum() * 20**3)
    left, right, bottom, top = seen.get_images()[0].get_extent()
    assert (right - left) / 20 == pytest.approx(volume.inside.shape[0])
    assert bottom > top, "y points down, as in the picture"
    assert above.get_ylabel() == "z, um"
    assert inked(figure).std() > 10
    empty = carved.measure(np.zeros_like(ellipsoid.views), ellipsoid.angles, ellipsoid.camera, kind="silhouettes")
    with pytest.raises(carved.InputError, match="the capillary was empty"):
        carved.plot_model(empty)


def test_a_plate_is_drawn_with_its_wells_and_flags() -> None:
    table = pd.DataFrame(
        {"run": "P-1", "well": ["A01", "B03", "H12"], "volume_um3": [1e8, 2e8, None], "flags": [None, "moved;residual", "moved"]}
    )
    figure = carved.plot_plate(table)
    grid: Any = np.ma.filled(np.ma.asarray(figure.axes[0].get_images()[0].get_array(), dtype=float), np.nan)
    assert grid.shape == (8, 12)
    assert (grid[0, 0], grid[1, 2]) == (1e8, 2e8)
    assert np.isnan(grid).sum() == 94
    assert len(figure.axes[0].patches) == 1
    assert has(inked(figure), ORANGE)
    larger = carved.plot_plate({"A01": 1.0, "P24": 2.0})
    assert np.ma.asarray(larger.axes[0].get_images()[0].get_array()).shape == (16, 24)
    largest = carved.plot_plate({"AF48": 2.0})
    assert np.ma.asarray(largest.axes[0].get_images()[0].get_array()).shape == (32, 48)
    plt.close("all")
    for wrong, said in [
        (table.drop(columns="well"), "no column 'well'"),
        (table.assign(run=["a", "b", "b"]), "2 runs, expected one"),
        (table.assign(well="A01"), "A01 has several rows"),
        (table.assign(volume_um3=None), "no well has a number"),
        (table.assign(volume_um3="large"), "holds no numbers"),
        ({"A00": 1.0}, "'A00' is no well"),
        ({"AG01": 1.0}, "on no plate"),
    ]:
        with pytest.raises(carved.InputError, match=said):
            carved.plot_plate(wrong)  # type: ignore[arg-type]
