"""Opens the exported models of a specimen with pynrrd, SimpleITK and trimesh, and compares them with its numbers.

    read_models.py FOLDER RECORDING

FOLDER is A02 (a ball) or B03 (a larva) with measurement.json, mesh.ply, model.glb, model.nrrd, model.stl, texture.glb and m.glb, mm.glb, um.glb.
"""

import json
import sys
from pathlib import Path

import nrrd
import numpy as np
import SimpleITK as sitk
import trimesh
from PIL import Image

folder = Path(sys.argv[1])
measured = json.loads((folder / "measurement.json").read_text())
numbers = measured["measurement"]
voxel_um = numbers["voxel_size_um"]


def near(what, found, expected, tolerance):
    off = np.max(np.abs(np.asarray(found, float) - np.asarray(expected, float)))
    assert off <= tolerance, f"{what}: {found} is {off} off {expected}, more than {tolerance}"


data, header = nrrd.read(str(folder / "model.nrrd"))
assert set(np.unique(data)) == {0, 1} and int(data.sum()) == numbers["voxels"], data.sum()
near("pynrrd, voxel in mm", header["space directions"], np.eye(3) * voxel_um / 1000, 1e-12)
assert header["estimator"] == "voxel", header
assert header["space units"] == ["mm"] * 3 and header["space"] == "3D-right-handed" and header["mode"] == "imported", header
volume_um3 = data.sum() * abs(np.linalg.det(header["space directions"])) * 1e9
near("pynrrd, volume", volume_um3, numbers["estimators"]["voxel"]["volume_um3"], 1e-9 * volume_um3)
# A ball's voxels and its surface have one centre. The tail of a larva is thinner than a voxel: its voxels miss some of it.
near_um = voxel_um * (0.5 if folder.name == "A02" else 1.5)
middle = np.argwhere(data).mean(axis=0)
place_um = 1000 * (header["space origin"] + middle @ header["space directions"])
near("pynrrd, centre", place_um, numbers["centroid_um"], near_um)
image = sitk.ReadImage(str(folder / "model.nrrd"))
near("SimpleITK, spacing", image.GetSpacing(), [voxel_um / 1000] * 3, 1e-12)
place_um = 1000 * np.array(image.TransformContinuousIndexToPhysicalPoint([float(x) for x in middle]))
near("SimpleITK, centre", place_um, numbers["centroid_um"], near_um)
assert int(sitk.GetArrayViewFromImage(image).sum()) == numbers["voxels"]
near("the border is dead", [data[0].sum(), data[-1].sum(), data[:, 0].sum(), data[:, -1].sum(), data[..., 0].sum(), data[..., -1].sum()], 0, 0)

# Positions are f32, 6e-8 of the largest coordinate: 1e-4 um at 2 mm, and 1e-6 of a volume.
ply = trimesh.load(folder / "mesh.ply")
near("PLY, volume", ply.volume, numbers["field_volume_um3"], 1e-5 * ply.volume)
stl = trimesh.load(folder / "model.stl")
assert stl.is_watertight and stl.is_winding_consistent and len(stl.faces) == len(ply.faces), (stl, ply)
near("STL in mm, volume", stl.volume * 1e9, numbers["field_volume_um3"], 1e-5 * ply.volume)
near("STL in mm, place", stl.bounds * 1000, ply.bounds, 1e-3)
header = (folder / "model.stl").read_bytes()[:80].decode()
assert header.startswith("carved unit mm imported estimator field"), header
for unit, um in {"m": 1e6, "mm": 1e3, "um": 1.0}.items():
    scene = trimesh.load(folder / f"{unit}.glb")
    glb = scene.to_mesh()
    near(f"GLB in {unit}, volume", glb.volume * um**3, numbers["field_volume_um3"], 1e-5 * ply.volume)
    # Half a turn about x: y up, z to the viewer.
    turned = np.sort(ply.bounds * [1, -1, -1], axis=0)
    near(f"GLB in {unit}, place", glb.bounds * um, turned, 1e-3)
    raw = (folder / f"{unit}.glb").read_bytes()
    document = json.loads(raw[20 : 20 + int.from_bytes(raw[12:16], "little")])
    extras = document["asset"]["extras"]
    assert (extras["unit"], extras["mode"]) == (unit, "imported"), extras
    # The default of the format is metal, which is black without surroundings.
    material = document["materials"][document["meshes"][0]["primitives"][0]["material"]]["pbrMetallicRoughness"]
    assert material["metallicFactor"] == 0 and 0.5 < material["roughnessFactor"] <= 1, material

# The model of the recording: metres with y up, in the scene. It has fewer triangles, which are at most 1 um off (root mean square).
stored = trimesh.load(folder / "model.glb").to_mesh()
near("model.glb, place in m", stored.bounds, np.sort(ply.bounds * [1, -1, -1], axis=0) / 1e6, 6e-6)
near("model.glb, volume in m^3", stored.volume * 1e18, ply.volume, 0.01 * ply.volume)
assert measured["shape"]["estimator"] == "field", measured["shape"]["estimator"]
assert b"\ncomment estimator field\n" in (folder / "mesh.ply").read_bytes()[:400]
for name in ("model.glb", "m.glb", "texture.glb"):
    raw = (folder / name).read_bytes()
    document = json.loads(raw[20 : 20 + int.from_bytes(raw[12:16], "little")])
    assert (document["asset"]["extras"]["unit"], document["asset"]["extras"]["estimator"]) == ("m", "field"), document["asset"]

# The colours: the frames at the places of the vertices, blended by the fourth power of the cosine between normal and view.
recording = json.loads((Path(sys.argv[2]) / "recording.json").read_text())
calibration = measured.get("calibration") or {"psi": recording["rig"]["camera"], "rho": 1.0}
psi = calibration["psi"]
coloured = trimesh.load(folder / "texture.glb", process=False, skip_materials=True).to_mesh()
vertices = coloured.vertices * [1e6, -1e6, -1e6]
corners = vertices[coloured.faces]
of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
normals = np.zeros_like(vertices)
for corner in coloured.faces.T:
    np.add.at(normals, corner, of_faces)
normals /= np.linalg.norm(normals, axis=1, keepdims=True)
near("textured GLB, place", [vertices.min(axis=0), vertices.max(axis=0)], ply.bounds, 1e-3)
linear = coloured.visual.vertex_colors[:, :3] / 255


def turned(points, omega):
    """R_Y(alpha) R_Z(gamma) R_X(omega) of points."""
    a, g = psi["alpha"], psi["gamma"]
    y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    z = np.array([[np.cos(g), -np.sin(g), 0], [np.sin(g), np.cos(g), 0], [0, 0, 1]])
    x = np.array([[1, 0, 0], [0, np.cos(omega), -np.sin(omega)], [0, np.sin(omega), np.cos(omega)]])
    return points @ (y @ z @ x).T


def eps(b):
    """Angle by which the glass turns a ray that passes the axis at the distance b, rad."""
    tube = psi["glass"]
    r, outer = tube["bore_radius_um"], tube["outer_radius_um"]
    b = np.clip(b, -0.998 * r, 0.998 * r)
    snell = tube["inside"] / tube["glass"]
    outside = tube["inside"] / tube["outside"]
    return np.arcsin(b / r) - np.arcsin(snell * b / r) + np.arcsin(snell * b / outer) - np.arcsin(outside * b / outer)


def through(points, omega):
    """Where the points would lie if they were seen there without glass."""
    if psi.get("glass") is None:
        return points
    x, y, z = points.T
    across, depth = y * np.cos(omega) - z * np.sin(omega), y * np.sin(omega) + z * np.cos(omega)
    # In the glass there is nothing to be seen: points there are turned as those at the bore.
    within = np.minimum(0.998 * psi["glass"]["bore_radius_um"] / np.hypot(across, depth), 1)
    b = within * across
    for _ in range(50):
        e = eps(b)
        b = within * (across * np.cos(e) - depth * np.sin(e))
    e = eps(b)
    return np.stack([x, y * np.cos(e) - z * np.sin(e), y * np.sin(e) + z * np.cos(e)], axis=1)


k = np.array([[psi["f"] * psi["kx"], psi.get("s", 0), psi["ux"]], [0, psi["f"] * psi["ky"], psi["uy"]], [0, 0, 1]])
sums, weights = np.zeros_like(vertices), np.zeros((len(vertices), 1))
for entry in recording["ledger"]:
    if entry["closure"]:
        continue
    omega = calibration["rho"] * entry["omega"]
    eye = psi["f"] * np.array([0, np.cos(psi["phi"]), np.sin(psi["phi"])])
    u, v, w = k @ (turned(through(vertices, omega), omega) + eye).T
    frame = np.asarray(Image.open(Path(sys.argv[2]) / f"frames/view_{entry['view']:03}.png"), float)
    u, v = u / w, v / w
    x, y = u.astype(int), v.astype(int)
    du, dv = (u - x)[:, None], (v - y)[:, None]
    above = (1 - du) * frame[y, x] + du * frame[y, x + 1]
    below = (1 - du) * frame[y + 1, x] + du * frame[y + 1, x + 1]
    # The glass turns a normal too: as the point 1 um outside is seen.
    seen = turned(through(vertices + normals, omega) - through(vertices, omega), omega)
    weight = np.clip(-seen[:, 2:], 0.1, 1) ** 4
    sums += weight * ((1 - dv) * above + dv * below)
    weights += weight
# The reader rounds intensities to 8 bits.
expected = sums / weights / 255
expected = np.where(expected <= 0.04045, expected / 12.92, ((expected + 0.055) / 1.055) ** 2.4)
near("colours", linear, expected, 2.5 / 255)
assert np.ptp(linear) > 0.3, "the frames have contrast"
print("read")
