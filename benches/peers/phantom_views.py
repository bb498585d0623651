"""Silhouettes and matrices of a folder written by phantom.py, and the grid for carving."""

import json

import numpy as np
from PIL import Image


def load(folder, count=None):
    """The description, masks of 0 and 1 (view, row, column) and matrices. `count` selects this many views evenly."""
    told = json.loads((folder / "views.json").read_text())
    views = told["views"][:: told["n"] // (count or told["n"])]
    masks = np.stack([np.asarray(Image.open(folder / v["file"])) >= 128 for v in views]).astype(np.uint8)
    return told | {"views": views}, masks, np.array([v["P"] for v in views])


def grid(told, sd_um):
    """Voxels per axis, and the corner of the grid, which is centred on the box."""
    counts = tuple(round(edge / sd_um) for edge in told["box_um"])
    return counts, np.array([-n * sd_um / 2 for n in counts])


def budget(epsilon, views):
    """Number of views that may miss a voxel that is kept."""
    return int(np.floor(epsilon * views + 1e-9))
