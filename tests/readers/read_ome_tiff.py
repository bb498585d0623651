"""Opens the views of a specimen with tifffile and ome-types, and compares them with its recording.

    read_ome_tiff.py RECORDING FILE
"""

import hashlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import ome_types
import tifffile

folder, file = Path(sys.argv[1]), Path(sys.argv[2])
recording = json.loads((folder / "recording.json").read_text())
ledger = sorted((e for e in recording["ledger"] if not e["closure"]), key=lambda e: e["view"])
camera = recording["rig"]["camera"]
colour = recording["rig"]["pixel_format"] != "Mono8"


def hashed(pixels):
    return hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()


with tifffile.TiffFile(file) as tiff:
    assert tiff.is_ome and len(tiff.series) == 1, tiff.series
    series = tiff.series[0]
    assert series.axes == ("TYXS" if colour else "TYX"), series.axes
    pixels = series.asarray()
    xml = tiff.ome_metadata
assert pixels.shape[:3] == (len(ledger), camera["height"], camera["width"]), pixels.shape
# Lossless: the hashes of the raw pixels are in the ledger.
assert [hashed(view) for view in pixels] == [entry["sha256"] for entry in ledger]

ome = ome_types.from_xml(xml, validate=True)
(image,) = ome.images
found = image.pixels
assert (found.size_t, found.size_c, found.size_z) == (len(ledger), 3 if colour else 1, 1)
assert (found.physical_size_x, found.physical_size_x_unit.value) == (1 / camera["kx"], "µm"), found.physical_size_x
assert (found.physical_size_y, found.physical_size_y_unit.value) == (1 / camera["ky"], "µm"), found.physical_size_y
(channel,) = found.channels
assert (channel.name, channel.samples_per_pixel) == ("bright field", 3 if colour else 1), channel
angles = {a.id: a for a in ome.structured_annotations.double_annotations}
assert len(found.planes) == len(ledger)
for plane, entry in zip(found.planes, ledger, strict=True):
    (annotation,) = (angles[ref.id] for ref in plane.annotation_refs)
    assert math.isclose(annotation.value, math.degrees(entry["omega"]), abs_tol=1e-9), (annotation, entry["omega"])
    assert (annotation.namespace, annotation.description) == ("carved/omega_deg", f"view {entry['view']}"), annotation
(plate,) = ome.plates
(well,) = plate.wells
name = recording["specimen"]["well"]
assert (plate.name, plate.rows, plate.columns) == (recording["run"], 8, 12), plate
assert (well.row, well.column) == (ord(name[0]) - ord("A"), int(name[1:]) - 1), well
assert well.well_samples[0].image_ref.id == image.id
facts = {m.k: m.value for m in ome.structured_annotations.map_annotations[0].value.ms}
assert facts["mode"] == "imported" and facts["well"] == name, facts
# All that the plate map says, with the lab's own column.
said = {key: str(value) for key, value in recording["specimen"].items() if key != "well"}
said |= {"Clutch": 'c "7"'} if name == "B03" else {}
assert said.items() <= facts.items() and (name != "B03" or said["control"] == "negative"), (said, facts)
print("read")
