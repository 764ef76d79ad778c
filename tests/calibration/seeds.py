"""Whether a fit holds what it states: its errors, in its own standard uncertainties, over many
seeds.
"""

import numpy as np
from scipy.signal import lfilter

SEEDS = 180  # so many that chance does not move the shares by more than 4 %


def holds(pulls, most_at_one=0.76):
    """60 to 76 % within one standard uncertainty, 90 % or more within two."""
    pulls = np.abs(pulls)
    one, two = np.mean(pulls < 1), np.mean(pulls < 2)
    assert 0.60 <= one <= most_at_one, one
    assert two >= 0.90, two


def serial(rng, n, correlation):
    """Noise of unit variance whose correlation falls by a factor from one to the next."""
    white = rng.standard_normal(n + 200) * np.sqrt(1 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], white)[200:]
