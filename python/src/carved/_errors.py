"""Errors of carved. The message of each is that of the typed error of the Rust code."""


class CarvedError(Exception):
    """Base of all errors of this package."""


class InputError(CarvedError, ValueError):
    """An argument has a value that cannot be used. The message says what was found and what is expected."""


class SegmentError(CarvedError):
    """A picture gives no profile, for example because no capillary is in view."""


class MeasureError(CarvedError):
    """The views give no numbers, for example because too few show a specimen."""


class RecordingError(CarvedError):
    """A recording cannot be read, was altered, or is not finished."""
