"""Trackers that start from rest, and the part of a field that has no edge."""

import numpy as np

from analysis.dic import Correlation, open_tracker


def tracker_at_rest(reference, usable=None, roi=None, **options):
    """A tracker of one thread that takes the next image for one of no displacement."""
    tracker = open_tracker(
        Correlation(**{"threads": 1, **options}), reference, usable=usable, roi=roi
    )
    tracker.start_from(*np.zeros((2, *tracker.grid.shape)))
    return tracker


def inner(field, margin=3):
    """Away from the edges, where boxes leave the image or are read beyond it."""
    return field[..., margin:-margin, margin:-margin]
