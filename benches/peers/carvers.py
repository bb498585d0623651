"""The carvers with which carved is compared. Each returns its median time and the number of voxels that it keeps."""

import statistics
import time

import numpy as np

import numba_carvers
from phantom_views import budget, grid, load
from timing import median_s

EPSILON = 0.05
# Size of a slab along x with which numpy's temporary arrays stay in the cache.
SLAB = 16


def numpy_tuned(folder, sd_um):
    """float32. The parts of y and z are computed once per view, and the grid is processed in slabs along x."""
    told, masks, matrices = load(folder)
    counts, origin = grid(told, sd_um)
    width, allowed = told["width"], budget(EPSILON, len(masks))
    x, y, z = ((o + (np.arange(n) + 0.5) * sd_um).astype(np.float32) for o, n in zip(origin, counts))
    matrices = matrices.astype(np.float32)

    def carve():
        votes = np.zeros(counts, np.uint8)
        for p, mask in zip(matrices, masks):
            a, b, c = (r[1] * y[:, None] + r[2] * z[None, :] + r[3] for r in p)
            pixels = mask.ravel()
            for first in range(0, counts[0], SLAB):
                slab = x[first : first + SLAB, None, None]
                w = 1 / (p[2, 0] * slab + c)
                u = ((p[0, 0] * slab + a) * w + 0.5).astype(np.int32)
                v = ((p[1, 0] * slab + b) * w + 0.5).astype(np.int32)
                votes[first : first + SLAB] += pixels.take(v * width + u, mode="clip")
        return int((votes >= len(masks) - allowed).sum())

    return median_s(carve, 3, warm=False)


def numba_inputs(folder, sd_um, views=None):
    told, masks, matrices = load(folder, views)
    counts, origin = grid(told, sd_um)
    return counts, masks, matrices.astype(np.float32), origin.astype(np.float32), np.float32(sd_um)


def numba_batch(folder, sd_um, views=None, epsilon=EPSILON):
    counts, masks, matrices, origin, sd = numba_inputs(folder, sd_um, views)
    hull = np.zeros(counts, np.uint8)
    allowed = budget(epsilon, len(masks))
    seconds, _ = median_s(lambda: numba_carvers.batch(hull, masks, matrices, origin, sd, allowed), 5)
    return seconds, int(hull.sum())


def numba_incremental(folder, sd_um):
    """Also returns the median and the worst time of one view."""
    counts, masks, matrices, origin, sd = numba_inputs(folder, sd_um)
    least = len(masks) - budget(EPSILON, len(masks))
    per_view = []

    def carve():
        votes = np.zeros(counts, np.uint8)
        for mask, p in zip(masks, matrices):
            began = time.perf_counter()
            numba_carvers.add_view(votes, mask, p, origin, sd)
            per_view.append(time.perf_counter() - began)
        return int((votes >= least).sum())

    carve()
    per_view.clear()
    seconds, count = median_s(carve, 3, warm=False)
    return seconds, count, statistics.median(per_view), max(per_view)


def open3d_silhouettes(folder, sd_um):
    """Runs once, because it takes long. The dense grid and the carving are both timed."""
    import open3d

    told, masks, _ = load(folder)
    counts, origin = grid(told, sd_um)
    k, (width, height) = np.array(told["K"]), (told["width"], told["height"])
    camera = open3d.camera.PinholeCameraParameters()
    camera.intrinsic = open3d.camera.PinholeCameraIntrinsic(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2])

    def carve():
        sides = (n * sd_um for n in counts)
        voxels = open3d.geometry.VoxelGrid.create_dense(origin, np.ones(3), sd_um, *sides)
        for view, mask in zip(told["views"], masks):
            extrinsic = np.eye(4)
            extrinsic[:3, :3], extrinsic[:3, 3] = view["R"], view["t"]
            camera.extrinsic = extrinsic
            voxels.carve_silhouette(open3d.geometry.Image(mask.astype(np.float32)), camera, False)
        return len(voxels.get_voxels())

    return median_s(carve, 1, warm=False)


def centre_count(folder, sd_um, keep_as=None, views=None, epsilon=EPSILON):
    """Number of voxels that the definition keeps. `keep_as` stores them for the surfaces."""
    told, masks, matrices = load(folder, views)
    counts, origin = grid(told, sd_um)
    hull = np.zeros(counts, np.uint8)
    numba_carvers.centre_rule(hull, masks, matrices, origin, sd_um, budget(epsilon, len(masks)))
    if keep_as is not None:
        np.save(keep_as, hull)
    return int(hull.sum())


def corner_count(folder, sd_um):
    """Number of voxels that Open3D's rule keeps."""
    told, masks, matrices = load(folder)
    counts, origin = grid(told, sd_um)
    hull = np.zeros(counts, np.uint8)
    numba_carvers.corner_rule(hull, masks, matrices, origin, sd_um)
    return int(hull.sum())
