"""Opens an OME-Zarr plate with zarr, ngio and ome-zarr-py, validates it with ome-zarr-models, and compares it with its run.

    read_plate.py RUN PLATE VIEWS
"""

import json
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import zarr
from ngio import open_ome_zarr_plate
from ome_zarr.io import parse_url
from ome_zarr.reader import Reader
from ome_zarr_models.v05.hcs import HCS
from ome_zarr_models.v05.image import Image
from ome_zarr_models.v05.image_label import ImageLabel
from PIL import Image as Picture

run, path, planned = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
root = zarr.open_group(path, mode="r")
hcs = HCS.from_zarr(root)
plate = hcs.ome_attributes.plate
assert (len(plate.rows), len(plate.columns), plate.name) == (8, 12, json.loads((run / "run.json").read_text())["id"])
listed = [well.path for well in plate.wells]
with_views = []
for recording in sorted(run.glob("*/recording.json")):
    ledger = [e for e in json.loads(recording.read_text())["ledger"] if not e["closure"]]
    if ledger and "attempt" not in recording.parent.name:
        with_views.append(recording.parent)
assert listed == [f"{well.name[0]}/{int(well.name[1:])}" for well in with_views], (listed, with_views)

opened = open_ome_zarr_plate(path, mode="r")
# The table of the run, as a table of ngio.
assert opened.list_tables() == ["specimens"], opened.list_tables()
table = opened.get_table("specimens").dataframe
record = json.loads((run / "run.json").read_text())
assert list(table["well"]) == [w["well"] for w in record["plan"]["plate_map"]], list(table["well"])
volumes = {w["well"]: w["volume_um3"] for w in record["wells"] if w["volume_um3"]}
assert len(volumes) == 2 and {w: v for w, v in zip(table["well"], table["volume_um3"]) if v == v} == volumes, volumes
assert opened.wells_paths() == listed, opened.wells_paths()
# One picture of all wells, each at its place of the plate.
(whole,) = (node for node in Reader(parse_url(path))() if node.data)
mosaic = whole.data[0]

shapes = set()
for well, place in zip(with_views, listed, strict=True):
    recording = json.loads((well / "recording.json").read_text())
    camera = recording["rig"]["camera"]
    group = root[place]["0"]
    (scales,) = Image.from_zarr(group).ome_attributes.multiscales
    assert [axis.name for axis in scales.axes] == ["t", "c", "y", "x"]
    scale = scales.datasets[0].coordinateTransformations[0].scale
    assert scale == [1, 1, 1 / camera["ky"], 1 / camera["kx"]], scale
    pixels = group["0"][:]
    shapes.add(pixels.shape)
    assert pixels.shape == (planned, 3, camera["height"], camera["width"]), pixels.shape
    taken = {e["view"]: e for e in recording["ledger"] if not e["closure"]}
    for view in range(planned):
        if view in taken:
            interleaved = np.ascontiguousarray(pixels[view].transpose(1, 2, 0))
            assert sha256(interleaved.tobytes()).hexdigest() == taken[view]["sha256"], f"{place}, view {view}"
        else:
            assert not pixels[view].any(), f"{place}: view {view} was not taken"
    said = {key: str(value) for key, value in recording["specimen"].items() if key != "well"}
    said |= {"Clutch": 'c "7"'} if well.name == "B03" else {}
    facts = group.attrs["carved"]["facts"]
    assert said.items() <= facts.items() and (well.name != "B03" or said["control"] == "negative"), (said, facts)
    angles = {v["view"]: v["omega_deg"] for v in group.attrs["carved"]["views"]}
    assert angles.keys() == taken.keys()
    half = group["1"][:]
    h, w = (n // 2 for n in pixels.shape[2:])
    blocks = pixels[..., : 2 * h, : 2 * w].reshape(planned, 3, h, 2, w, 2).mean(axis=(3, 5))
    assert np.abs(half[..., :h, :w] - blocks).max() <= 0.5, "half the size is the mean of 2 x 2"
    labels = ImageLabel.from_zarr(group["labels"]["profile"])
    assert group["labels"].attrs["ome"]["labels"] == ["profile"] and labels.ome_attributes.multiscales
    mask = group["labels"]["profile"]["0"][:]
    assert mask.shape == (planned, 1, *pixels.shape[2:]) and set(np.unique(mask)) == {0, 1}
    for view in range(planned):
        file = well / f"profiles/view_{view:03}.png"
        stored = np.asarray(Picture.open(file)) >= 128 if file.exists() else np.zeros(mask.shape[2:], bool)
        assert (mask[view, 0] == stored).all(), f"{place}, profile {view}"
    row, column = place.split("/")
    container = opened.get_image(row, column, "0")
    image = container.get_image()
    assert np.array_equal(image.get_as_numpy(), pixels), f"{place}, ngio"
    assert [image.pixel_size.y, image.pixel_size.x] == scale[2:] and container.list_labels() == ["profile"], place
    assert np.array_equal(container.get_label("profile").get_as_numpy(), mask), f"{place}, ngio, profile"
    top, left = "ABCDEFGH".index(row) * camera["height"], (int(column) - 1) * camera["width"]
    tile = mosaic[..., top : top + camera["height"], left : left + camera["width"]].compute()
    assert np.array_equal(tile, pixels), f"{place}, ome-zarr-py"
    # A size is one shard and its metadata.
    assert len([f for f in (path / place).rglob("*") if f.is_file()]) == 16
assert len(shapes) <= 1, shapes
print("read")
