"""Functions on plain arrays, without any file: the package `analysis`, and parts of it."""

import analysis
from analysis import dic, invert, mechanics as theory

__all__ = ["analysis", "dic", "invert", "theory"]
