"""The conditioner of the simulated force sensors, which reads the forces late and smoothed."""

from __future__ import annotations

import math

import numpy as np

from analysis.arrays import F64, I64

_NOISE_CHUNK = 1024  # samples


class Conditioner:
    """A pure delay, then a low-pass of first order, of both forces; before the first sample there
    were none.

    Parameters
    ----------
    delay, time_constant : float
        In samples; the delay is rounded. With both 0 the forces come as they are.
    """

    def __init__(self, delay: float, time_constant: float) -> None:
        self._late = np.zeros((round(delay), 2))
        # of the last reading, how much is left in the next one
        self._left = math.exp(-1 / time_constant) if time_constant else 0.0
        self._read = np.zeros(2)

    def read(self, forces: F64) -> F64:
        """What is read of the next samples of both forces, shape (n, 2)."""
        both = np.concatenate([self._late, forces])
        out, self._late = both[: len(forces)], both[len(forces) :]
        if self._left:
            for n in range(len(out)):  # scipy.signal takes half a second to import
                out[n] += self._left * (self._read - out[n])
                self._read = out[n]
        return out


def unit_noise(seed: int, samples: I64) -> F64:
    """White noise of unit variance, shape (n, 2), always drawn in the same chunks, so that it
    depends on the sample and not on the block.
    """
    chunks = range(samples[0] // _NOISE_CHUNK, samples[-1] // _NOISE_CHUNK + 1)
    drawn = [
        np.random.default_rng([seed, 1, chunk]).standard_normal((_NOISE_CHUNK, 2))
        for chunk in chunks
    ]
    return np.asarray(np.concatenate(drawn)[samples - chunks[0] * _NOISE_CHUNK])
