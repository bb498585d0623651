"""Opens a plate as one OME-TIFF with tifffile and ome-types, and compares it with the recordings of its run.

    read_plate_tiff.py RUN PLAIN NASTY TEXT

PLAIN has outlines and labels. In NASTY all texts of the run are those of the file TEXT.
"""

import hashlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import ome_types
import tifffile

run, plain, nasty, text = map(Path, sys.argv[1:])
# Controls, and what XML does not have, are spaces.
raw = text.read_bytes().decode()
expected = "".join(" " if ord(c) < 32 or 127 <= ord(c) < 160 or c in "\ufffe\uffff" else c for c in raw)


def hashed(pixels):
    return hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()


def check(file, kinds, facts_expected):
    with tifffile.TiffFile(file) as tiff:
        ome = ome_types.from_xml(tiff.ome_metadata, validate=True)
        stacks = [series.asarray() for series in tiff.series]
        assert tiff.pages[0].description.isascii()
    assert len(ome.images) == len(stacks) == 2 * len(kinds), (len(ome.images), len(stacks))
    (plate,) = ome.plates
    assert (plate.name, plate.rows, plate.columns) == ("P-017", 8, 12), (plate.rows, plate.columns)
    assert [(well.row, well.column) for well in plate.wells] == [(0, 1), (1, 2)]
    samples = [sample for well in plate.wells for sample in well.well_samples]
    assert [sample.index for sample in samples] == list(range(len(stacks)))
    angles = {a.id: a for a in ome.structured_annotations.double_annotations}
    maps = {m.id: {pair.k: pair.value for pair in m.value.ms} for m in ome.structured_annotations.map_annotations}
    by_id = {image.id: (image, pixels) for image, pixels in zip(ome.images, stacks, strict=True)}
    for well, folder in zip(plate.wells, ("A02", "B03"), strict=True):
        ledger = sorted(json.loads((run / folder / "recording.json").read_text())["ledger"], key=lambda e: e["view"])
        ledger = [entry for entry in ledger if not entry["closure"]]
        assert len(well.well_samples) == len(kinds)
        for kind, sample in zip(kinds, well.well_samples, strict=True):
            image, pixels = by_id[sample.image_ref.id]
            assert image.name == f"P-017 {folder} {kind}", image.name[-40:]
            assert image.pixels.channels[0].name == kind
            assert len(pixels) == len(ledger) == image.pixels.size_t
            if kind == "bright field":
                assert [hashed(view) for view in pixels] == [entry["sha256"] for entry in ledger], folder
            for plane, entry in zip(image.pixels.planes, ledger, strict=True):
                angle = angles[plane.annotation_refs[0].id]
                assert math.isclose(angle.value, math.degrees(entry["omega"]), abs_tol=1e-9), (folder, entry["view"])
            facts = maps[image.annotation_refs[0].id]
            assert facts["well"] == folder and facts_expected.items() <= facts.items(), folder
    return ome


ome = check(plain, ["bright field", "profile"], {"mode": "imported"})
views = ome.images[0].pixels.size_t
assert len(ome.rois) == 2 * views and len({roi.id for roi in ome.rois}) == 2 * views
assert [ref.id for image in ome.images for ref in image.roi_refs] == [roi.id for roi in ome.rois]
assert all(image.acquisition_date is not None for image in ome.images)

# A time that is none is left out.
of_map = dict.fromkeys(["compound", "strain", "treatment", expected], expected)
ome = check(nasty, ["bright field"], of_map)
assert all(image.acquisition_date is None for image in ome.images)
print("read")
