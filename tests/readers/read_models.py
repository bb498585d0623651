"""Opens the exported models of a specimen with pynrrd, SimpleITK and trimesh, and compares them with its numbers.

    read_models.py FOLDER      A02 (a ball) or B03 (a larva) with measurement.json, mesh.ply, model.nrrd, model.stl and m.glb, mm.glb, um.glb
"""

import json
import sys
from pathlib import Path

import nrrd
import numpy as np
import SimpleITK as sitk
import trimesh

folder = Path(sys.argv[1])
numbers = json.loads((folder / "measurement.json").read_text())["measurement"]
voxel_um = numbers["voxel_size_um"]


def near(what, found, expected, tolerance):
    off = np.max(np.abs(np.asarray(found, float) - np.asarray(expected, float)))
    assert off <= tolerance, f"{what}: {found} is {off} off {expected}, more than {tolerance}"


data, header = nrrd.read(str(folder / "model.nrrd"))
assert set(np.unique(data)) == {0, 1} and int(data.sum()) == numbers["voxels"], data.sum()
near("pynrrd, voxel in mm", header["space directions"], np.eye(3) * voxel_um / 1000, 1e-12)
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
assert header.startswith("carved unit mm imported"), header
for unit, um in {"m": 1e6, "mm": 1e3, "um": 1.0}.items():
    scene = trimesh.load(folder / f"{unit}.glb")
    glb = scene.to_mesh()
    near(f"GLB in {unit}, volume", glb.volume * um**3, numbers["field_volume_um3"], 1e-5 * ply.volume)
    # Half a turn about x: y up, z to the viewer.
    turned = np.sort(ply.bounds * [1, -1, -1], axis=0)
    near(f"GLB in {unit}, place", glb.bounds * um, turned, 1e-3)
    raw = (folder / f"{unit}.glb").read_bytes()
    extras = json.loads(raw[20 : 20 + int.from_bytes(raw[12:16], "little")])["asset"]["extras"]
    assert (extras["unit"], extras["mode"]) == (unit, "imported"), extras
print("read")
