"""A simulated plate-loader: drives an instrument that waits for one, as `carved simulate --sampler loader` does."""

from .line import BadLine, Mischief
from .loader import Habits, PlateLoader, Report

__all__ = ["BadLine", "Habits", "Mischief", "PlateLoader", "Report"]
