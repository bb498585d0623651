"""From frames to profiles: carved compared with OpenCV's mean shift and scikit-image's level set.

    python segmentation.py PHANTOM_FOLDER WORK_FOLDER
"""

import re
import sys
from pathlib import Path

import cv2
import numpy as np
from skimage.segmentation import morphological_chan_vese

import report
from ours import bench
from timing import in_own_process, median_s

# Chan-Vese takes seconds per picture, so every sixth of the 72 frames is used, which covers all difficulties.
EVERY = 6
CROP_ROWS = 144
GOAL_WHOLE, GOAL_CROP = 50, 8


def mean_shift(picture):
    return cv2.pyrMeanShiftFiltering(picture, 12, 20, maxLevel=1)


def chan_vese(picture):
    grey = picture.astype(np.float32).mean(axis=-1) / 255
    height, width = grey.shape
    start = np.zeros(grey.shape, np.int8)
    start[height // 2 - 42 : height // 2 + 43, width // 8 : -width // 8] = 1
    return morphological_chan_vese(grey, 60, init_level_set=start, smoothing=2)


METHODS = {"OpenCV pyrMeanShiftFiltering 12, 20, level 1": mean_shift, "scikit-image morphological_chan_vese, 60 steps": chan_vese}


def pictures(files, rows):
    whole = [cv2.imread(str(f)) for f in files]
    if rows is None:
        return whole
    return [np.ascontiguousarray(p[(p.shape[0] - rows) // 2 :][:rows]) for p in whole]


def peer_s(name, files, rows):
    """The median over the pictures, after one that is not counted."""
    read = pictures(files, rows)
    METHODS[name](read[0])
    return float(np.median([median_s(lambda p=p: METHODS[name](p), 1, warm=False)[0] for p in read]))


def own_s(*arguments):
    """The median of the segmentation, and the line about frames per second."""
    said = bench("sustained", *arguments)
    print(said, flush=True)
    p50, p95 = re.search(r"segment +p50 +([\d.]+) ms +p95 +([\d.]+) ms", said).groups()
    rate = re.search(r"(\d+ threads): ([\d.]+) frames/s", said)
    return float(p50) / 1e3, f"{float(p50):.1f} ms (95 %: {float(p95):.1f} ms), {rate[2]} frames/s of {rate[1]}"


def rows_of(machine, files, whole_s, crop_s):
    rows, sums = [], {"whole": 0.0, "crop": 0.0}
    for name in METHODS:
        for kind, keep in (("whole", None), ("crop", CROP_ROWS)):
            seconds = in_own_process(peer_s, name, files, keep)
            sums[kind] += seconds
            rows.append([name, kind, report.ms(seconds), report.times(seconds, whole_s), ""])
            print(rows[-1], flush=True)
    for kind, goal in (("whole", GOAL_WHOLE), ("crop", GOAL_CROP)):
        rows.append(["**both, one after the other**", kind, report.ms(sums[kind]), *machine.ratio(sums[kind], whole_s, goal)])
    if crop_s is not None:
        rows.append(["both, beside carved on the same crop", "crop", report.ms(sums["crop"]), report.times(sums["crop"], crop_s), ""])
    return rows


def main(phantom, work):
    machine = report.Machine()
    bench("sustained", "--write", work)
    rig = sorted(work.glob("*.png"))[::EVERY]
    larva = sorted((phantom / "rgb").glob("*.png"))
    rig_s, rig_line = own_s()
    larva_s, larva_line = own_s("--read", phantom / "rgb")
    crop_s, crop_line = own_s("--read", phantom / "rgb", "--rows", CROP_ROWS)
    head = ["peer", "picture", "median", "times carved on the whole frame", "goal"]
    report.write(machine.page(), "segmentation", [
        "## Segmentation",
        "",
        *machine.lines(["opencv-python-headless", "scikit-image", "numpy"]),
        "",
        "carved's hybrid method finds walls, background, profile, sub-pixel edge and the kind of specimen, in one thread. The",
        "peers give only a filtered picture and a coarse mask, with as many threads as they use. Whole frames have 1024 x 1024",
        f"px. The crop is the {CROP_ROWS} rows of the bore, which somebody would have to find first. Without the walls carved cannot work",
        "on a crop, so the times for crops are compared with carved on the whole frame.",
        "",
        f"Frames of the emulated rig. carved, all 72 frames of the set: {rig_line}. Peers: every {EVERY}th frame.",
        "",
        *report.table(head, rows_of(machine, rig, rig_s, None)),
        f"{len(larva)} frames of the phantom that is also used to time carving, with even light and plain walls. carved: {larva_line}.",
        f"On the crop, which contains the walls here: {crop_line}.",
        "",
        *report.table(head, rows_of(machine, larva, larva_s, crop_s)),
    ])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
