"""Carving, surface, fairing and VRV: carved compared with its peers on one phantom.

    python carve.py PHANTOM_FOLDER
"""

import math
import sys
from pathlib import Path

import carvers
import report
import surfaces
from ours import Said, bench
from phantom import BOX_UM
from phantom_views import grid
from report import ms, times
from timing import in_own_process

VIEWS = 84
GOAL_S = {6.93: 0.035, 5.5: 0.055}
# Peer, its rule, and the required ratio of its time to carved's.
PEERS = [
    ("numba, all views per voxel, early exit", carvers.numba_batch, "centre, float32", 11),
    ("numba, incremental, one pass per view", carvers.numba_incremental, "centre, float32", 20),
    ("numpy tuned", carvers.numpy_tuned, "centre, float32", 60),
    ("Open3D carve_silhouette", carvers.open3d_silhouettes, "any corner", 300),
]
GOAL_UNEVEN, GOAL_SURFACE_S, GOAL_FAIRING_S, GOAL_VRV_S = 1.7, 0.030, 0.350, 0.006
SURFACE_SD = 5.5
# float32 has an error of some 1e-4 px for a centre, so a few voxels in a million fall into the next pixel.
TIES = 1e-5


def differs(name, found, rule, ties=TIES):
    """A list with one line if a carver keeps other voxels than its rule, else an empty list."""
    if found is None or abs(found - rule) <= ties * rule:
        return []
    return [f"{name} keeps {found:.0f} voxels, its rule {rule}"]


def carving(machine, folder, sd_um, said, wrong):
    own = said.get("carve", "seconds", sd=sd_um, views=VIEWS, variant="clean")
    own_count = said.get("carve", "voxels", sd=sd_um, views=VIEWS, variant="clean")
    centre = in_own_process(carvers.centre_count, folder / "clean", sd_um, volume(folder, sd_um))
    wrong += differs(f"SD {sd_um}: carved", own_count, centre, ties=0)
    rows = [["carved", "centre, float64", ms(own), "1", machine.at_most(own, GOAL_S[sd_um], ms), told(own_count, centre)]]
    per_view = []
    for name, carver, rule, goal in PEERS:
        seconds, count, *views = in_own_process(carver, folder / "clean", sd_um)
        expected = in_own_process(carvers.corner_count, folder / "clean", sd_um) if rule == "any corner" else centre
        wrong += differs(f"SD {sd_um}: {name}", count, expected)
        rows.append([name, rule, ms(seconds), *machine.ratio(seconds, own, goal), told(count, expected)])
        per_view = views or per_view
        print(rows[-1], flush=True)
    own_view = [ms(said.get("view", key, sd=sd_um, views=VIEWS, variant="clean")) for key in ("median", "worst")]
    views = [["carved", *own_view], ["numba, incremental", *map(ms, per_view)]]
    megabytes = said.get("memory", "megabytes", sd=sd_um, views=VIEWS, variant="clean")
    return [
        f"### {VIEWS} views at SD {sd_um} um",
        "",
        *report.table(["carver", "rule", "median", "times carved", "goal", "voxels (difference from the rule)"], rows),
        *report.table(["one view", "median", "worst"], views),
        *([] if megabytes is None else [f"carved's hull and views need {megabytes:.1f} MB. One byte per voxel, as in numpy and numba, is {dense_mb(sd_um):.0f} MB.", ""]),
    ]


def dense_mb(sd_um):
    counts, _ = grid({"box_um": BOX_UM}, sd_um)
    return math.prod(counts) / 1e6


def volume(folder, sd_um):
    return folder / f"hull_{sd_um}.npy"


def told(count, rule):
    return "not measured" if count is None else f"{count:.0f} ({count - rule:+.0f})"


def uneven(machine, folder, said, wrong):
    rows = []
    for sd_um in GOAL_S:
        clean = said.get("carve", "seconds", sd=sd_um, views=VIEWS, variant="clean")
        for variant in ("rolled", "ragged"):
            own = said.get("carve", "seconds", sd=sd_um, views=VIEWS, variant=variant)
            count = said.get("carve", "voxels", sd=sd_um, views=VIEWS, variant=variant)
            rule = in_own_process(carvers.centre_count, folder / variant, sd_um)
            wrong += differs(f"SD {sd_um}, {variant}: carved", count, rule, ties=0)
            slower = None if None in (own, clean) else own / clean
            batch, _ = in_own_process(carvers.numba_batch, folder / variant, sd_um)
            found = "not measured" if slower is None else f"{slower:.2f}"
            rows.append([variant, f"{sd_um}", ms(own), found, machine.at_most(slower, GOAL_UNEVEN, str), told(count, rule), ms(batch), times(batch, own)])
            print(rows[-1], flush=True)
    return [
        "### A rolled axis and rough edges",
        "",
        "`rolled`: the same solid with its axis rolled by 2 deg in the picture. `ragged`: the clean silhouettes with a rough edge",
        f"(IoU about 0.945). {VIEWS} views.",
        "",
        *report.table(["variant", "SD, um", "carved", "times clean", "goal", "voxels (difference from the rule)", "numba early exit", "times carved"], rows),
    ]


def afterwards(machine, folder, said, wrong):
    own_surface, own_count = (said.get("surface", key, sd=SURFACE_SD) for key in ("seconds", "triangles"))
    own_fairing = said.get("fairing", "seconds")
    own_vrv = said.get("vrv", "seconds", views=21, sd=10)
    hull = volume(folder, SURFACE_SD)
    surface, triangles = in_own_process(surfaces.flying_edges, hull, SURFACE_SD)
    fairing, faired = in_own_process(surfaces.implicit_fairing, hull, SURFACE_SD)
    strict, _ = in_own_process(carvers.numba_batch, folder / "clean", 10.0, 21, 0.0)
    rule = in_own_process(carvers.centre_count, folder / "clean", 10.0, None, 21, 0.0)
    wrong += differs("VRV: carved", said.get("vrv", "voxels", views=21, sd=10), rule, ties=0)
    tolerant, _ = in_own_process(carvers.numba_batch, folder / "clean", 10.0, 21, carvers.EPSILON)
    own_triangles = "" if own_count is None else f", {own_count:.0f} triangles"

    rows = [
        ["iso-surface at SD 5.5", ms(own_surface) + own_triangles, f"VTK flying edges, {triangles} triangles", ms(surface), times(surface, own_surface), machine.at_most(own_surface, GOAL_SURFACE_S, ms)],
        ["fairing of it, 10 iterations", ms(own_fairing), f"libigl and scipy, {faired} triangles", ms(fairing), times(fairing, own_fairing), machine.at_most(own_fairing, GOAL_FAIRING_S, ms)],
        ["VRV, 21 views, SD 10", ms(own_vrv), "numba, early exit, no miss allowed", ms(strict), times(strict, own_vrv), machine.at_most(own_vrv, GOAL_VRV_S, ms)],
        ["", "", "numba, early exit, one miss allowed", ms(tolerant), times(tolerant, own_vrv), ""],
    ]
    return [
        "### Surface, fairing, VRV",
        "",
        "libigl fairs with the cotangent operator and lambda = SD^2 / 2, carved with the umbrella operator and lambda = 0.8. The",
        "number of implicit steps is the same, the resulting surface is not. VRV is one evaluation of the calibration's",
        "objective, the number of voxels that 21 views leave.",
        "",
        *report.table(["step", "carved", "peer", "peer's median", "times carved", "goal"], rows),
    ]


def scaling(said):
    """The time of a view from 1e6 voxels to 1e9, and its growth compared with that of the surface."""
    found = [values for kind, values in said.lines if kind == "scale"]
    if not found:
        return []
    n0, t0 = float(found[0]["voxels"]), float(found[0]["median"])
    rows = []
    for values in found:
        n, median = float(values["voxels"]), float(values["median"])
        rows.append([f"{n / 1e6:.0f}", ms(median), f"{median / t0:.1f}", f"{(n / n0) ** (2 / 3):.1f}", f"{n / n0:.0f}", ms(float(values["total"])), f"{float(values['megabytes']):.0f}"])
    head = ["10^6 voxels", "one view, median", "grows by", "the surface by", "the volume by", f"{VIEWS} views", "MB, views and buffers included"]
    return ["### From a million voxels to a thousand million", "", "The same views and box with ever smaller voxels. One run each, which includes its first requests of memory.", "", *report.table(head, rows)]


def main(folder):
    machine = report.Machine()
    said = Said(bench("carve_peers", folder.resolve()))
    wrong = []
    lines = [line for sd_um in GOAL_S for line in carving(machine, folder, sd_um, said, wrong)]
    lines += uneven(machine, folder, said, wrong) + scaling(said) + afterwards(machine, folder, said, wrong)
    report.write(machine.page(), "carve", [
        "## Carving",
        "",
        *machine.lines(["numpy", "numba", "open3d", "vtk", "libigl", "scipy"]),
        "",
        "A larva phantom seen by 84 views in a box of 5 x 1 x 1 mm. A voxel is kept if at most 4 of the 84 views miss it. There",
        "are two rules for a miss. *Centre*: the centre of the voxel samples the nearest pixel of the mask. Outside the image is",
        "a miss. In float32 single voxels at the surface fall into the next pixel. *Any corner* (Open3D): no view may miss, but",
        "one of the eight corners of a voxel inside the mask (sampled bilinearly) is enough. This keeps one more layer. Each",
        "count is checked against a simple implementation of its rule in float64. The difference is given beside the count.",
        "",
        *lines,
        *(["**Not what the rules say:** " + "; ".join(wrong) + "."] if wrong else []),
    ])
    if wrong:
        sys.exit("counts differ from their rules: " + "; ".join(wrong))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
