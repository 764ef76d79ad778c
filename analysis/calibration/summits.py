"""Summits of a rough face, from the spectrum of its heights, and how they carry a sphere.

References
----------
Nayak 1971 (moments of an isotropic Gaussian surface); McCool 1986, Wear 107, 37 (density, curvature
and heights of the summits); Greenwood, Tripp 1967.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.calibration.roughness import Roughness
from analysis.mechanics.greenwood_tripp import RoughContact, rough_contact

LEAST_BANDWIDTH = 1.5  # of any isotropic surface


@dataclass(frozen=True, slots=True)
class Summits:
    """The summits of a map; SI units.

    Attributes
    ----------
    density : float
        Summits per area, 1/m^2.
    radius : float
        Of the sphere that is as curved as their mean, metres.
    h : float
        Standard deviation of their heights, metres: less than that of all heights.
    bandwidth : float
        Nayak's m0 m4/m2^2: 1.5 for waves of one length, above where there are many.
    """

    density: float
    radius: float
    h: float
    bandwidth: float

    def mu(self, R: float) -> float:
        """Greenwood and Tripp's parameter under a sphere of radius R (m): see `greenwood_tripp`."""
        return 8 / 3 * self.density * self.h * math.sqrt(2 * R * self.radius)

    def contact(self, P: float, E: float, nu: float, R: float) -> RoughContact:
        """Contact of the sphere R (m) under P (N) with a block of modulus E (Pa) that has these
        summits, their heights Gaussian.

        Raises
        ------
        ValueError
            As `rough_contact`.
        """
        return rough_contact(P, E, nu, R, self.h, self.mu(R))


def summits(found: Roughness) -> Summits:
    """The summits of a map, from the moments of its spectrum.

    Notes
    -----
    The curvature grows with the shortest waves that count: `Roughness.shortest` is part of the
    result. Moments of a profile of an isotropic surface: m0 = h^2, m2 half of the mean square
    slope, m4 three eighths of the mean square of the Laplacian.

    Examples
    --------
    >>> import numpy as np, analysis, analysis.calibration.summits as summits
    >>> white = np.random.default_rng(0).standard_normal((256, 256))
    >>> q2 = np.add.outer(np.fft.fftfreq(256) ** 2, np.fft.fftfreq(256) ** 2) * 4 * np.pi**2
    >>> z = np.fft.ifft2(np.fft.fft2(white) * np.exp(-8 * q2)).real
    >>> found = summits.summits(analysis.roughness(z * 1e-6, 1e-6))
    >>> 2.7 < found.bandwidth < 3.3
    True
    """
    q, power = found.wavenumber, found.spectrum
    known = (q >= 2 * np.pi / found.longest) & (q <= 2 * np.pi / found.shortest)
    q, power = q[known], power[known]
    m0, m2, m4 = (
        share * float(np.trapezoid(power * q ** (order + 1), q)) / (2 * np.pi)
        for order, share in ((0, 1.0), (2, 0.5), (4, 0.375))
    )
    # of the waves that the rings hold, as h is of all of them
    m0, m2, m4 = (found.h**2 * one / m0 for one in (m0, m2, m4))
    bandwidth = max(m0 * m4 / m2**2, LEAST_BANDWIDTH)
    return Summits(
        density=m4 / m2 / (6 * math.pi * math.sqrt(3)),
        radius=0.375 * math.sqrt(math.pi / m4),
        h=math.sqrt((1 - 0.8968 / bandwidth) * m0),
        bandwidth=bandwidth,
    )
