"""carved measures zebrafish larvae in 3D from the views of one turn.

`segment` finds the outline in a picture. `measure` gives volume, area and shape with their standard deviations. `carve` gives the
hull of silhouettes of any cameras. `calibrate` finds the axis of a turn. `read` opens a recording of an instrument. `plot_views`,
`plot_model` and `plot_plate` draw figures with matplotlib. `build` names the sources of this module.

Lengths are in um, angles in rad, positions in pictures in px. docs/python.md has examples.
"""

from ._build import Build, build
from ._calibrate import Calibration, calibrate
from ._camera import Camera
from ._errors import CarvedError, InputError, MeasureError, RecordingError, SegmentError
from ._measure import Hull, Measurement, Model, Volume, carve, measure
from ._plot import plot_model, plot_plate, plot_views
from ._recording import Frames, Recording, read
from ._segment import Profile, segment

__version__ = build.version

__all__ = [
    "Build",
    "Calibration",
    "Camera",
    "CarvedError",
    "Frames",
    "Hull",
    "InputError",
    "MeasureError",
    "Measurement",
    "Model",
    "Profile",
    "Recording",
    "RecordingError",
    "SegmentError",
    "Volume",
    "__version__",
    "build",
    "calibrate",
    "carve",
    "measure",
    "plot_model",
    "plot_plate",
    "plot_views",
    "read",
    "segment",
]
