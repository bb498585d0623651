#!/usr/bin/env python3
"""Silhouettes of solids whose volume and area are known in closed form.

    generate.py FOLDER        writes FOLDER/SOLID/{view_NN.png, cameras.txt, camera.json, truth.json}

Only the standard library of Python is used, and no code of carved or of its emulated rig.

    solid = union of convex parts          part = convex hull of quadrics, discs and corners
      ellipsoid, disc  ──  dual quadric Q*  ──  P Q* P^T, the dual conic of its outline  ──┐
      corner           ──  P X  ────────────────────────────────────────────────────────── ┴─ convex polygon of the part
      polygons ── per 1/16 of a column the rows that any of them covers ── coverage of each pixel in 255 levels

World: um, right-handed, x along the axis of rotation, y down, z away from the camera.
Image: px, pixel centres at integers, u to the right, v down.
"""

import json
import math
import struct
import sys
import zlib
from pathlib import Path

WIDTH, HEIGHT = 512, 160
SUBCOLUMNS = 16
# A polygon inscribed in an ellipse of this many corners lacks (2/3) (pi/n)^2 = 1e-5 of its area.
CORNERS = 800
VIEWS = 24

# The camera: distance from the axis in um, px per um, principal point in px. Its optical axis meets the axis of
# rotation, which it sees in the row of the principal point, with a roll in deg: +x end down.
DISTANCE = 60_000.0
SCALE = 1 / 5.5
AXIS_ROW = 77.7
CENTRE = (255.5, AXIS_ROW)
AXIS_ROLL = 0.4
# What an instrument assumes before its calibration: no roll, and an axis that is 3 px off.
BELIEVED_OFF = 3.0


# Matrices as lists of rows


def times(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def transposed(a):
    return [list(column) for column in zip(*a)]


def about(axis, degrees):
    """The rotation by an angle about x, y or z, right-handed."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn = [[float(row == column) for column in range(3)] for row in range(3)]
    turn[i][i], turn[i][j], turn[j][i], turn[j][j] = c, -s, s, c
    return turn


def projection(degrees):
    """The 3 x 4 matrix of the fixed camera for a world that is turned about x by an angle."""
    intrinsic = [
        [SCALE * DISTANCE, 0.0, CENTRE[0]],
        [0.0, SCALE * DISTANCE, CENTRE[1]],
        [0.0, 0.0, 1.0],
    ]
    turned = times(about("z", AXIS_ROLL), about("x", degrees))
    pose = [row + [shift] for row, shift in zip(turned, (0.0, 0.0, DISTANCE))]
    return times(intrinsic, pose)


# Parts: the bodies whose convex hull they are


class Pose:
    """A rotation and a shift in um: from a solid's own frame to the world."""

    def __init__(self, rotation, shift):
        self.matrix = [row + [s] for row, s in zip(rotation, shift)] + [[0.0, 0.0, 0.0, 1.0]]

    def dual(self, semi_axes, centre):
        """The dual quadric of an ellipsoid along the solid's own axes. A semi-axis of 0 makes it a disc."""
        here = [[float(i == j) for j in range(4)] for i in range(4)]
        for i in range(3):
            here[i][3] = centre[i]
        # Planes p with p^T Q* p = 0 touch it.
        own = [[0.0] * 4 for _ in range(4)]
        for i, value in enumerate([a * a for a in semi_axes] + [-1.0]):
            own[i][i] = value
        whole = times(self.matrix, here)
        return times(times(whole, own), transposed(whole))

    def corner(self, point):
        return [row[0] for row in times(self.matrix, [[x] for x in (*point, 1.0)])]


def outline(matrix, dual):
    """Points of the ellipse that is the image of a quadric."""
    conic = times(times(matrix, dual), transposed(matrix))
    # C* ~ [[m m^T - S, m], [m^T, 1]]: centre m, and S with S = L L^T maps a circle onto the ellipse.
    w = conic[2][2]
    u, v = conic[0][2] / w, conic[1][2] / w
    a, b, d = u * u - conic[0][0] / w, u * v - conic[0][1] / w, v * v - conic[1][1] / w
    first = math.sqrt(a)
    second = b / first
    third = math.sqrt(max(d - second * second, 0.0))
    for k in range(CORNERS):
        c, s = math.cos(2 * math.pi * k / CORNERS), math.sin(2 * math.pi * k / CORNERS)
        yield (u + first * c, v + second * c + third * s)


def seen(matrix, point):
    x, y, w = (sum(m * p for m, p in zip(row, point)) for row in matrix)
    return (x / w, y / w)


def hull(points):
    """Upper and lower chain of the convex hull, both from left to right."""
    points = sorted(set(points))

    def chain(sign):
        kept = []
        for p in points:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if sign * ((bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax)) > 0:
                    break
                kept.pop()
            kept.append(p)
        return kept

    return chain(1), chain(-1)


def rows_at(chain, wanted):
    """The rows of a chain at ascending columns; None outside it."""
    found, at = [], 0
    for u in wanted:
        while at + 2 < len(chain) and chain[at + 1][0] < u:
            at += 1
        (u0, v0), (u1, v1) = chain[at], chain[at + 1]
        found.append(v0 + (v1 - v0) * (u - u0) / (u1 - u0) if u0 <= u <= u1 and u1 > u0 else None)
    return found


def silhouette(matrix, parts):
    """The coverage of each pixel, row by row, 0 to 255."""
    wanted = [(i + 0.5) / SUBCOLUMNS - 0.5 for i in range(WIDTH * SUBCOLUMNS)]
    spans = [[] for _ in wanted]
    for quadrics, corners in parts:
        points = [p for quadric in quadrics for p in outline(matrix, quadric)] + [seen(matrix, c) for c in corners]
        tops, bottoms = (rows_at(chain, wanted) for chain in hull(points))
        for at, (top, bottom) in enumerate(zip(tops, bottoms)):
            if top is not None and bottom is not None:
                spans[at].append((top, bottom))
    pixels = [[0.0] * WIDTH for _ in range(HEIGHT)]
    for at, covered in enumerate(spans):
        column, end = at // SUBCOLUMNS, -math.inf
        for top, bottom in sorted(covered):
            top, end = max(top, end), max(bottom, end)
            # Pixel v is from v - 1/2 to v + 1/2.
            for v in range(math.floor(top + 0.5), math.floor(end + 0.5) + 1):
                share = min(end, v + 0.5) - max(top, v - 0.5)
                if share > 0:
                    pixels[v][column] += share / SUBCOLUMNS
    return [bytes(min(255, int(255 * share + 0.5)) for share in row) for row in pixels]


def png(rows):
    """8 bit grey. Each line is stored as the difference from the line above."""
    above, lines = bytes(WIDTH), b""
    for row in rows:
        lines += b"\x02" + bytes((x - y) % 256 for x, y in zip(row, above))
        above = row
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(lines, 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


# Solids: parts, and by name the [volume, area] of the solid, of its ideal hull, and of the hull of a number of views


def carlson_rg(x, y, z):
    """Carlson's R_G by his duplication theorems (Numer. Algorithms 10, 1995).

    2 R_G = z R_F - (x - z) (y - z) R_D / 3 + sqrt(x y / z)
    """

    def next_of(values):
        a, b, c = (math.sqrt(v) for v in values)
        shift = a * b + a * c + b * c
        return [(v + shift) / 4 for v in values], shift

    values, total, weight = [x, y, z], 0.0, 1.0
    for _ in range(30):
        root = math.sqrt(values[2])
        rest = values[2]
        values, shift = next_of(values)
        total += weight / (root * (rest + shift))
        weight /= 4
    mean = sum(values) / 3
    r_f, r_d = mean**-0.5, 3 * total + weight * mean**-1.5
    return (z * r_f - (x - z) * (y - z) * r_d / 3 + math.sqrt(x * y / z)) / 2


def ellipsoid():
    a, b, c = 620.0, 210.0, 150.0
    pose = Pose(times(times(about("z", 6.0), about("y", 4.0)), about("x", 25.0)), (150.0, 45.0, -30.0))
    truth = [4 / 3 * math.pi * a * b * c, 4 * math.pi * carlson_rg((a * b) ** 2, (a * c) ** 2, (b * c) ** 2)]
    return [([pose.dual((a, b, c), (0.0, 0.0, 0.0))], [])], {"solid": truth, "hull": truth}


def capsule():
    r, length = 140.0, 1300.0
    pose = Pose(times(about("z", 5.0), about("y", -3.0)), (-200.0, -40.0, 35.0))
    ends = [pose.dual((r, r, r), (x, 0.0, 0.0)) for x in (-length / 2, length / 2)]
    truth = [math.pi * r * r * length + 4 / 3 * math.pi * r**3, 2 * math.pi * r * length + 4 * math.pi * r * r]
    return [(ends, [])], {"solid": truth, "hull": truth}


def tapered():
    """A head, a body that tapers, and a tail: the convex hull of two balls of radii r > q, a length d apart."""
    r, q, d = 230.0, 40.0, 1500.0
    pose = Pose(times(about("z", -4.0), about("y", 3.0)), (-700.0, 70.0, 25.0))
    sine = (r - q) / d
    cosine2 = 1 - sine * sine
    # The cone touches the balls at x = r sine and d + q sine, where its radii are r and q times the cosine.
    height = d - (r - q) * sine
    cone = math.pi / 3 * height * cosine2 * (r * r + r * q + q * q)

    def cap(radius, depth):
        return math.pi / 3 * depth * depth * (3 * radius - depth)

    volume = cone + cap(r, r * (1 + sine)) + cap(q, q * (1 - sine))
    slant = d * math.sqrt(cosine2)
    area = math.pi * (r + q) * math.sqrt(cosine2) * slant + 2 * math.pi * (r * r * (1 + sine) + q * q * (1 - sine))
    parts = [([pose.dual((r, r, r), (0.0, 0.0, 0.0)), pose.dual((q, q, q), (d, 0.0, 0.0))], [])]
    return parts, {"solid": [volume, area], "hull": [volume, area]}


def finned():
    """A cylinder of radius r with a plate of half-width w and half-thickness t through its axis.

    Both are along the axis of rotation.
    """
    r, w, t, length = 120.0, 260.0, 8.0, 1200.0
    pose = Pose(about("x", 20.0), (-60.0, 20.0, -15.0))
    discs = [pose.dual((0.0, r, r), (x, 0.0, 0.0)) for x in (-length / 2, length / 2)]
    corners = [pose.corner((x, y, z)) for x in (-length / 2, length / 2) for y in (-w, w) for z in (-t, t)]
    # A quarter of the slice of the solid: of the disc, and of the plate beyond it.
    edge = math.sqrt(r * r - t * t)
    inside = (t * edge + r * r * math.asin(t / r)) / 2
    slice_um2 = math.pi * r * r + 4 * (w * t - inside)
    slice_um = 2 * math.pi * r - 4 * r * math.asin(t / r) + 4 * (w - edge) + 4 * t
    # Of its convex hull: triangle to the plate's end, kite to the tangent's point, sector.
    away = math.hypot(w, t)
    tangent, sector = math.sqrt(away * away - r * r), math.pi / 2 - math.atan2(t, w) - math.acos(r / away)
    hull_um2 = 4 * (w * t / 2 + tangent * r / 2 + sector * r * r / 2)
    hull_um = 4 * (t + tangent + sector * r)

    def prism(slice_um2, slice_um):
        return [slice_um2 * length, slice_um * length + 2 * slice_um2]

    def of_views(views):
        """The polygon of all tangents; for an even number opposite views have the same two."""
        step = 2 * math.pi / views
        away = [step * i - math.radians(20.0) for i in range(views)]
        reach = [max(r, w * abs(math.cos(angle)) + t * abs(math.sin(angle))) for angle in away]
        sides = [
            (reach[i - 1] + reach[(i + 1) % views] - 2 * reach[i] * math.cos(step)) / math.sin(step)
            for i in range(views)
        ]
        return prism(sum(h * side for h, side in zip(reach, sides)) / 2, sum(sides))

    truth = {"solid": prism(slice_um2, slice_um), "hull": prism(hull_um2, hull_um)}
    return [(discs, []), ([], corners)], truth | {f"hull_of_{n}": of_views(n) for n in (VIEWS // 2, VIEWS)}


def main(folder):
    angles = [360.0 * i / VIEWS for i in range(VIEWS)]
    matrices = [projection(angle) for angle in angles]
    lines = (" ".join(f"{x:.12g}" for row in matrix for x in row) for matrix in matrices)
    cameras = "".join(f"{line}\n" for line in lines)
    believed = {"f": DISTANCE, "kx": round(SCALE, 12), "ky": round(SCALE, 12), "ux": CENTRE[0]}
    believed |= {"uy": round(AXIS_ROW + BELIEVED_OFF, 6), "width": WIDTH, "height": HEIGHT}
    believed["omega"] = [round(math.radians(angle), 12) for angle in angles]
    for make in (ellipsoid, capsule, tapered, finned):
        parts, numbers = make()
        truth = {
            name: {"volume_um3": float(f"{volume:.10g}"), "area_um2": float(f"{area:.10g}")}
            for name, (volume, area) in numbers.items()
        }
        truth["axis"] = {"uy": round(AXIS_ROW, 6), "gamma": round(math.radians(AXIS_ROLL), 12)}
        target = folder / make.__name__
        target.mkdir(parents=True, exist_ok=True)
        for i, matrix in enumerate(matrices):
            (target / f"view_{i:02}.png").write_bytes(png(silhouette(matrix, parts)))
        (target / "cameras.txt").write_text(cameras)
        (target / "camera.json").write_text(json.dumps(believed) + "\n")
        (target / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
