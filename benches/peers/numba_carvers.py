"""Carvers in numba: two that are timed, and slow, exact versions of the two rules to check the counts."""

import numba
import numpy as np

F = np.float32


@numba.njit(parallel=True, fastmath=True, cache=True)
def batch(hull, masks, matrices, origin, sd_um, allowed):
    """All views per voxel, until more than `allowed` have missed it. float32."""
    nx, ny, nz = hull.shape
    views, height, width = masks.shape
    for i in numba.prange(nx):
        x = origin[0] + (i + F(0.5)) * sd_um
        for j in range(ny):
            y = origin[1] + (j + F(0.5)) * sd_um
            for k in range(nz):
                z = origin[2] + (k + F(0.5)) * sd_um
                misses = 0
                for c in range(views):
                    p = matrices[c]
                    w = F(1) / (p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3])
                    u = int((p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) * w + F(0.5))
                    v = int((p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) * w + F(0.5))
                    if u < 0 or v < 0 or u >= width or v >= height or masks[c, v, u] == 0:
                        misses += 1
                        if misses > allowed:
                            break
                hull[i, j, k] = misses <= allowed


@numba.njit(parallel=True, fastmath=True, cache=True)
def add_view(votes, mask, p, origin, sd_um):
    """One view over the whole grid, with a vote per voxel that it covers. float32."""
    nx, ny, nz = votes.shape
    height, width = mask.shape
    for i in numba.prange(nx):
        x = origin[0] + (i + F(0.5)) * sd_um
        for j in range(ny):
            y = origin[1] + (j + F(0.5)) * sd_um
            a0 = p[0, 0] * x + p[0, 1] * y + p[0, 3]
            a1 = p[1, 0] * x + p[1, 1] * y + p[1, 3]
            a2 = p[2, 0] * x + p[2, 1] * y + p[2, 3]
            for k in range(nz):
                z = origin[2] + (k + F(0.5)) * sd_um
                w = F(1) / (a2 + p[2, 2] * z)
                u = int((a0 + p[0, 2] * z) * w + F(0.5))
                v = int((a1 + p[1, 2] * z) * w + F(0.5))
                if 0 <= u < width and 0 <= v < height:
                    votes[i, j, k] += mask[v, u]


@numba.njit(parallel=True, cache=True)
def centre_rule(hull, masks, matrices, origin, sd_um, allowed):
    """carved's definition: the centre, projected in float64, samples the nearest pixel. Outside the image counts as a miss."""
    nx, ny, nz = hull.shape
    views, height, width = masks.shape
    for i in numba.prange(nx):
        x = origin[0] + (i + 0.5) * sd_um
        for j in range(ny):
            y = origin[1] + (j + 0.5) * sd_um
            for k in range(nz):
                z = origin[2] + (k + 0.5) * sd_um
                misses = 0
                for c in range(views):
                    p = matrices[c]
                    w = p[2, 0] * x + ((p[2, 1] * y + p[2, 2] * z) + p[2, 3])
                    u = np.floor((p[0, 0] * x + ((p[0, 1] * y + p[0, 2] * z) + p[0, 3])) / w + 0.5)
                    v = np.floor((p[1, 0] * x + ((p[1, 1] * y + p[1, 2] * z) + p[1, 3])) / w + 0.5)
                    if w <= 0 or u < 0 or v < 0 or u >= width or v >= height or masks[c, int(v), int(u)] == 0:
                        misses += 1
                        if misses > allowed:
                            break
                hull[i, j, k] = misses <= allowed


@numba.njit(cache=True)
def touched(mask, u, v):
    """Whether bilinear sampling at (u, v) gives anything of the mask."""
    height, width = mask.shape
    if u < 0 or v < 0 or u > width - 1 or v > height - 1:
        return False
    ui, vi = min(int(u), width - 2), min(int(v), height - 2)
    a, b = u - ui, v - vi
    above = mask[vi, ui] * (1 - a) + mask[vi, ui + 1] * a
    below = mask[vi + 1, ui] * (1 - a) + mask[vi + 1, ui + 1] * a
    return above * (1 - b) + below * b > 0


@numba.njit(parallel=True, cache=True)
def corner_rule(hull, masks, matrices, origin, sd_um):
    """Open3D's rule: every view must touch at least one of the voxel's eight corners, each sampled bilinearly."""
    nx, ny, nz = hull.shape
    for i in numba.prange(nx):
        for j in range(ny):
            for k in range(nz):
                kept = True
                for c in range(masks.shape[0]):
                    p = matrices[c]
                    seen = False
                    for corner in range(8):
                        x = origin[0] + (i + (corner & 1)) * sd_um
                        y = origin[1] + (j + (corner >> 1 & 1)) * sd_um
                        z = origin[2] + (k + (corner >> 2)) * sd_um
                        w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                        u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w
                        v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w
                        if w > 0 and touched(masks[c], u, v):
                            seen = True
                            break
                    if not seen:
                        kept = False
                        break
                hull[i, j, k] = kept
