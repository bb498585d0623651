"""A larva phantom, seen by 84 views: the input for all carvers.

    FOLDER/clean/sil/NNN.png   silhouettes, 1024 x 1024, 0 or 255      views.json   P (3 x 4), R, t of every view
    FOLDER/rolled/...          the same solid, its axis rolled by 2 deg in the picture
    FOLDER/ragged/...          the clean silhouettes with a rough edge, IoU about 0.945 with the clean ones
    FOLDER/rgb/NNN.png         every 12th clean view as a colour frame: light, glass walls, absorption, noise

World: um, x along the capillary, y down, z away from the camera, origin in the middle of the box. View i turns the solid by
360 deg * i / 84 about x. P = K [Rz(gamma) Rx(omega) | (0, 0, D)]; pixel centres at integers.

    python phantom.py FOLDER
"""

import json
import sys
from pathlib import Path

import numba
import numpy as np
from PIL import Image
from scipy import ndimage

VIEWS, SIDE_PX = 84, 1024
DISTANCE_UM, UM_PER_PX = 60_000.0, 5.5
FOCAL_PX, MIDDLE_PX = DISTANCE_UM / UM_PER_PX, 511.5
BOX_UM = (5000, 1000, 1000)
# All parts of the solid are nearer to the axis than this, um. Rays are sampled within it, in steps of STEP_UM.
REACH_UM, STEP_UM = 400.0, 2.0
WINDOW_U, WINDOW_V = (130, 894), (420, 604)
ROLLED_DEG = 2.0
RAGGED_IOU = 0.945
# Correlation length of the rough edge, px.
RAGGED_SIGMA_PX = 2.0
SEED = 12345


def table(*points):
    """A smooth profile along x, with one value per um from -2500 on."""
    x, y = np.array(points, float).T
    window = np.hanning(61)
    values = np.pad(np.interp(np.arange(-2500.0, 2501.0), x, y), 30, mode="edge")
    return np.convolve(values, window / window.sum(), mode="valid")


# Rows: half width (z) and half height (y) of the body, y and z of its centre, reach of the fin up and down from it.
PROFILES = np.array([
    table((-1901, 0), (-1900, 60), (-1800, 170), (-1600, 260), (-1400, 265), (-1200, 215), (-900, 190), (-400, 150), (200, 105), (1000, 70), (1700, 35), (1860, 18), (1861, 0)),
    table((-1901, 0), (-1900, 60), (-1800, 160), (-1600, 230), (-1400, 250), (-1200, 215), (-900, 190), (-400, 165), (200, 130), (1000, 85), (1700, 40), (1860, 18), (1861, 0)),
    table((-1900, -20), (-1400, 0), (-600, 40), (400, 30), (1900, 0)),
    25 * np.sin((np.arange(-2500.0, 2501.0) + 1900) / 3800 * 2 * np.pi),
    table((-301, 0), (-300, 5), (300, 150), (900, 190), (1500, 200), (1800, 170), (1900, 40), (1901, 0)),
    table((-101, 0), (-100, 5), (400, 140), (900, 190), (1500, 210), (1800, 170), (1900, 40), (1901, 0)),
])


@numba.njit(cache=True, inline="always")
def ellipsoid(x, y, z, a, b, c):
    return (x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 <= 1.0


@numba.njit(cache=True, inline="always")
def inside(x, y, z, profiles):
    i = int(x + 2500.5)
    if i < 0 or i > 5000:
        return False
    wide, high, up, down = profiles[0, i], profiles[1, i], profiles[4, i], profiles[5, i]
    dy, dz = y - profiles[2, i], z - profiles[3, i]
    body = wide > 1.0 and high > 1.0 and (dy / high) ** 2 + (dz / wide) ** 2 <= 1.0
    fin = abs(dz) <= 14.0 and -down <= dy <= up and up + down > 4.0
    yolk = ellipsoid(x + 950, y + 165, z, 430.0, 200.0, 205.0)
    eyes = ellipsoid(x + 1640, y - 40, abs(z) - 190, 125.0, 125.0, 125.0)
    return body or fin or yolk or eyes


@numba.njit(parallel=True, cache=True)
def thickness_um(rotation, profiles, first_hit):
    """The length of each pixel's ray inside the solid. With `first_hit` only whether the ray hits it, which is faster."""
    image = np.zeros((SIDE_PX, SIDE_PX), np.float32)
    for v in numba.prange(WINDOW_V[0], WINDOW_V[1]):
        for u in range(WINDOW_U[0], WINDOW_U[1]):
            dx, dy = (u - MIDDLE_PX) / FOCAL_PX, (v - MIDDLE_PX) / FOCAL_PX
            hits, depth = 0, -REACH_UM
            while depth < REACH_UM:
                xc, yc = dx * (DISTANCE_UM + depth), dy * (DISTANCE_UM + depth)
                x = rotation[0, 0] * xc + rotation[1, 0] * yc + rotation[2, 0] * depth
                y = rotation[0, 1] * xc + rotation[1, 1] * yc + rotation[2, 1] * depth
                z = rotation[0, 2] * xc + rotation[1, 2] * yc + rotation[2, 2] * depth
                if inside(x, y, z, profiles):
                    hits += 1
                    if first_hit:
                        break
                depth += STEP_UM
            image[v, u] = hits * STEP_UM
    return image


def rotation(omega, gamma):
    (c, s), (cg, sg) = (np.cos(omega), np.sin(omega)), (np.cos(gamma), np.sin(gamma))
    return np.array([[cg, -sg, 0], [sg, cg, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def ragged(mask, noise, amplitude_px):
    """The mask with its edge displaced by smooth noise."""
    distance_px = ndimage.distance_transform_edt(mask) - ndimage.distance_transform_edt(~mask)
    return distance_px + amplitude_px * noise > 0


def edge_noise(rng):
    noise = ndimage.gaussian_filter(rng.standard_normal((SIDE_PX, SIDE_PX)), RAGGED_SIGMA_PX)
    return noise / noise.std()


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def amplitude_px(masks, noises):
    """Bisection: the amplitude that gives the wanted mean IoU over some views."""
    low, high = 0.0, 20.0
    for _ in range(12):
        middle = (low + high) / 2
        reached = np.mean([iou(m, ragged(m, n, middle)) for m, n in zip(masks, noises)])
        low, high = (middle, high) if reached > RAGGED_IOU else (low, middle)
    return low


def colour_frame(thick_um, rng):
    v, u = np.mgrid[0:SIDE_PX, 0:SIDE_PX]
    light = 205 - 35 * (((u - 512) / 512) ** 2 + ((v - 512) / 512) ** 2) / 2
    walls = sum(np.exp(-(((v - middle) / 5) ** 2)) for middle in (448, 576))
    seen = np.exp(-thick_um[..., None] / [900.0, 650.0, 500.0])
    return (light - 70 * walls)[..., None] * seen + rng.normal(0, 3, (SIDE_PX, SIDE_PX, 3))


def save(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8)).save(path)


def write_variant(folder, masks, gamma):
    k = np.array([[FOCAL_PX, 0, MIDDLE_PX], [0, FOCAL_PX, MIDDLE_PX], [0, 0, 1]])
    views = []
    for i, mask in enumerate(masks):
        omega = 2 * np.pi * i / VIEWS
        r, t = rotation(omega, gamma), [0, 0, DISTANCE_UM]
        name = f"sil/{i:03d}.png"
        save(folder / name, 255 * mask)
        views.append({"i": i, "omega": omega, "P": (k @ np.c_[r, t]).tolist(), "R": r.tolist(), "t": t, "file": name})
    told = {"n": VIEWS, "width": SIDE_PX, "height": SIDE_PX, "um_per_px": UM_PER_PX, "D_um": DISTANCE_UM, "K": k.tolist(), "box_um": BOX_UM, "views": views}
    (folder / "views.json").write_text(json.dumps(told))


def main(folder):
    rng = np.random.default_rng(SEED)
    turns = 2 * np.pi * np.arange(VIEWS) / VIEWS
    gamma = np.deg2rad(ROLLED_DEG)
    clean = [thickness_um(rotation(w, 0), PROFILES, True) > 0 for w in turns]
    write_variant(folder / "clean", clean, 0)
    write_variant(folder / "rolled", [thickness_um(rotation(w, gamma), PROFILES, True) > 0 for w in turns], gamma)
    noises = [edge_noise(rng) for _ in clean]
    by = amplitude_px(clean[::7], noises[::7])
    rough = [ragged(m, n, by) for m, n in zip(clean, noises)]
    write_variant(folder / "ragged", rough, 0)
    for i in range(0, VIEWS, 12):
        save(folder / f"rgb/{i:03d}.png", colour_frame(thickness_um(rotation(turns[i], 0), PROFILES, False), rng))
    mean_iou = np.mean([iou(a, b) for a, b in zip(clean, rough)])
    print(f"{folder}: {VIEWS} views, {clean[0].sum()} px in the first; ragged edges moved by {by:.2f} px rms, IoU {mean_iou:.4f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
