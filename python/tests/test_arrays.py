"""Memory, threads, progress and exceptions."""

import sys
import threading

import numpy as np
import pytest
from conftest import Turn

import carved


def test_masks_show_the_memory_of_the_profile(frames: Turn) -> None:
    profile = carved.segment(frames.views[0])
    assert profile.mask.base is not None
    assert not profile.mask.flags.owndata
    assert not profile.mask.flags.writeable
    with pytest.raises(ValueError, match="WRITEABLE"):
        profile.mask.flags.writeable = True
    assert set(np.unique(profile.mask)) == {0, 255}
    kept = profile.mask
    before = kept.copy()
    del profile
    assert np.array_equal(kept, before)


def test_meshes_and_voxels_are_moved_into_arrays(ellipsoid: Turn) -> None:
    found = carved.carve(ellipsoid.views, ellipsoid.camera.projections(ellipsoid.angles), voxel=20)
    # numpy does not own this memory: it is that which Rust has filled.
    assert not found.vertices.flags.owndata
    assert found.vertices.flags.c_contiguous
    assert found.vertices.dtype == np.float64
    assert found.triangles.dtype == np.uint32
    assert found.triangles.max() < len(found.vertices)
    volume = found.volume()
    assert volume is not None
    assert volume.inside.dtype == np.bool_
    assert not volume.inside.flags.owndata
    assert volume.inside.flags.f_contiguous
    assert volume.inside.sum() == found.report["voxels"]
    # The axes are those of the world: the body lies along x, and the centres of the voxels are inside of the mesh's extent.
    places = np.argwhere(volume.inside) * volume.voxel_um + np.array(volume.origin_um)
    assert np.allclose(places.mean(axis=0), found.report["centroid_um"], atol=volume.voxel_um)
    assert (places.min(axis=0) >= found.vertices.min(axis=0) - volume.voxel_um).all()
    assert (places.max(axis=0) <= found.vertices.max(axis=0) + volume.voxel_um).all()


def test_voxels_of_a_mirrored_world_are_in_that_world(ellipsoid: Turn) -> None:
    matrices = ellipsoid.camera.projections(ellipsoid.angles)
    moved = matrices.copy()
    # The body lies 100 um further along x.
    moved[:, :, 3] -= 100 * moved[:, :, 0]
    box = ((-900.0, -400.0, -400.0), (1100.0, 400.0, 400.0))
    plain = carved.carve(ellipsoid.views, moved, voxel=20, box=box)
    mirror = moved.copy()
    mirror[:, :, 0] *= -1
    mirrored = carved.carve(ellipsoid.views, mirror, voxel=20, box=((-1100.0, -400.0, -400.0), (900.0, 400.0, 400.0)))
    assert mirrored.report["mirrored_world"]
    of_plain, of_mirrored = plain.volume(), mirrored.volume()
    assert of_plain is not None
    assert of_mirrored is not None
    assert np.array_equal(of_plain.inside[::-1], of_mirrored.inside)
    last = of_plain.origin_um[0] + (of_plain.inside.shape[0] - 1) * of_plain.voxel_um
    assert of_mirrored.origin_um[0] == pytest.approx(-last)


def test_a_strided_view_is_measured_as_its_copy(frames: Turn) -> None:
    wide = np.repeat(frames.views[0], 2, axis=1)[:, ::2]
    assert not wide.flags.c_contiguous
    assert carved.segment(wide).json == carved.segment(frames.views[0]).json


def test_the_gil_is_free_while_rust_works(frames: Turn) -> None:
    # This thread counts only while the other one, which never returns to Python, works in Rust.
    begun, counted, done = threading.Event(), 0, threading.Event()

    def work() -> None:
        begun.set()
        carved.segment(frames.views[0])
        done.set()

    interval = sys.getswitchinterval()
    # No thread is made to give the GIL up: only a release lets this one go on.
    sys.setswitchinterval(1e6)
    try:
        thread = threading.Thread(target=work)
        thread.start()
        begun.wait()
        # `wait` has the GIL again: the other thread has released it in Rust, or is done.
        while not done.is_set():
            counted += 1
            done.wait(0.0001)
        thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert counted > 0


def test_progress_counts_to_the_end(frames: Turn, ellipsoid: Turn) -> None:
    for turn, kind, steps in ((frames, "frames", 25), (ellipsoid, "silhouettes", 26)):
        seen: list[tuple[int, int]] = []
        carved.measure(
            turn.views, turn.angles, turn.camera, kind=kind, voxel_um=20,  # type: ignore[arg-type]
            progress=lambda done, total, seen=seen: seen.append((done, total)),  # type: ignore[misc]
        )  # fmt: skip
        assert seen == [(done, steps) for done in range(1, steps + 1)]


@pytest.mark.parametrize("error", [RuntimeError("enough"), KeyboardInterrupt()])
def test_an_exception_of_the_callback_ends_the_work(frames: Turn, error: BaseException) -> None:
    calls = []

    def progress(done: int, total: int) -> None:
        calls.append(done)
        raise error

    with pytest.raises(type(error)) as caught:
        carved.measure(frames.views, frames.angles, frames.camera, kind="frames", voxel_um=20, progress=progress)
    assert caught.value is error
    assert calls == [1]
