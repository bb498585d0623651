"""The module gives the bytes of the commands."""

import json
import pathlib
import re
import tarfile

import numpy as np
import pytest
from conftest import SILHOUETTES, Turn, pictures, run, truth

import carved


def without_files(text: str) -> str:
    """The report of `carved reconstruct` without what only a command has: the file of the mesh, and times."""
    text = re.sub(r'  "mesh": "[^"]*",\n', "", text)
    return re.sub(r'  "timing_ms": \{[^}]*\},\n', "", text).rstrip("\n")


def test_silhouettes_as_carved_reconstruct(ellipsoid: Turn, tmp_path: pathlib.Path) -> None:
    camera, out = ellipsoid.folder / "camera.json", tmp_path / "m.ply"
    said = run("reconstruct", "--views", ellipsoid.folder, "--cameras", camera, "--voxel", "14", "--out", out)
    found = carved.measure(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, kind="silhouettes", voxel_um=14, names=ellipsoid.names)
    assert found.json == without_files(said)
    assert len(found.vertices) == int(re.search(rb"element vertex (\d+)", out.read_bytes())[1])  # type: ignore[index]
    # Within two standard deviations: scale and edges of these silhouettes are exact.
    assert found.volume_sd_um3 is not None
    assert abs(found.volume_um3 - truth("ellipsoid")["solid"]["volume_um3"]) < 2 * found.volume_sd_um3


def test_matrices_as_carved_reconstruct(ellipsoid: Turn, tmp_path: pathlib.Path) -> None:
    cameras, out = ellipsoid.folder / "cameras.txt", tmp_path / "m.ply"
    said = run("reconstruct", "--views", ellipsoid.folder, "--cameras", cameras, "--voxel", "14", "--out", out)
    matrices = np.loadtxt(ellipsoid.folder / "cameras.txt").reshape(-1, 3, 4)
    found = carved.carve(ellipsoid.views, matrices, voxel=14, names=ellipsoid.names)
    assert found.json == without_files(said)


def test_calibration_as_carved_calibrate(ellipsoid: Turn) -> None:
    said = run("calibrate", "specimen", "--views", ellipsoid.folder, "--cameras", ellipsoid.folder / "camera.json")
    found = carved.calibrate(ellipsoid.views, ellipsoid.angles, ellipsoid.camera, names=ellipsoid.names)
    assert found.json == said.rstrip("\n")
    assert abs(found.camera.uy - truth("ellipsoid")["axis"]["uy"]) < 0.05


def test_a_recording_as_carved_measure(recording: pathlib.Path, frames: Turn, tmp_path: pathlib.Path) -> None:
    run("measure", recording, "--out", tmp_path)
    expected = next(tmp_path.rglob("measurement.json")).read_text()
    opened = carved.read(recording)
    found = opened.measure()
    assert found.json == expected
    # The same frames without a recording.
    direct = carved.measure(
        frames.views, opened.angles, opened.camera, kind="frames", voxel_um=14, method={"quality": opened.info["method"]["quality"]}
    )
    record = json.loads(expected)
    assert direct.report == {key: record[key] for key in direct.report}
    assert np.array_equal(direct.vertices, found.vertices)
    line = json.loads(run("measure", "--asd", "12", recording))
    assert json.loads(opened.measure(12).json)["measurement"] == line["measurement"]


def test_a_packed_recording_is_read_as_its_folder(recording: pathlib.Path) -> None:
    pack = recording.parent / "packed" / "A01.tar"
    pack.parent.mkdir(exist_ok=True)
    with tarfile.open(pack, "w") as archive:
        for file in sorted(file for file in recording.rglob("*") if file.is_file()):
            archive.add(file, arcname=f"A01/{file.relative_to(recording)}")
    assert np.array_equal(carved.read(pack).frames[3], carved.read(recording).frames[3])


def test_a_profile_as_carved_segment(frames: Turn, tmp_path: pathlib.Path) -> None:
    run("segment", "--out", tmp_path, frames.folder / frames.names[0])
    expected = json.loads((tmp_path / "view_00.json").read_text())
    profile = carved.segment(frames.views[0])
    assert profile.report == expected["profile"]
    edge = json.loads((tmp_path / "view_00.edge.json").read_text())
    assert np.allclose(profile.outlines[0], edge["polygons"][0]["vertices"], atol=5.1e-5)


@pytest.mark.parametrize("solid", ["finned", "tapered"])
def test_each_shipped_set_is_measured(solid: str) -> None:
    turn = pictures(SILHOUETTES / solid)
    found = carved.measure(turn.views > 127, turn.angles, turn.camera, voxel_um=20)
    assert found.estimator in ("support", "voxel")
    assert found.volume_um3 > 0
