"""Spectra of a record from segments of it, each without its straight line, under Hann's window.

References
----------
Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70.
"""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64, Array


def segment_spectra(y: F64, length: int, step: int) -> Array:
    """Fourier transforms of the segments of a record, shape (segments, length // 2 + 1); of white
    noise of unit variance, the mean square of each is 1.
    """
    pieces = np.lib.stride_tricks.sliding_window_view(y, length)[::step]
    turn = np.arange(length) / length
    window = 0.5 - 0.5 * np.cos(2 * np.pi * turn)
    line = turn - turn.mean()
    slopes = pieces @ line / (line @ line)
    left = pieces - pieces.mean(axis=1, keepdims=True) - slopes[:, None] * line
    return np.fft.rfft(left * (window / np.sqrt(window @ window)))
