"""What the paper states: numbers beside which those of an analysis are set, and the loads that its
figures show.

References
----------
Prevost et al. 2013.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LIGHTEST = 0.1  # N, Fig. 2
FIELDS_AT = 0.5  # Figs 6, 7 and 10
BALANCES_AT = (0.5, 0.7)  # Fig. 9
MODELS_AT = 0.3  # Fig. 12
STRESSES_AT = (0.2, 0.7)  # Figs 13 and 14
LAW_AT = 0.7  # Fig. 15
BOX_PX, SIGMA_PX = 20, 0.033
MU, MU_SD = 0.93, 0.08
LENGTH, LENGTH_SD, BUREAU_LENGTH = 0.80e-6, 0.23e-6, 0.89e-6
TYPICAL_PRESSURE, TYPICAL_STIFFNESS = 25e3, 30e9  # Pa, Pa/m


@dataclass(frozen=True, slots=True)
class Published:
    """A number of the paper, SI units: the value, its uncertainty, where it stands, and the load to
    which it belongs (N; NaN: all).
    """

    value: float
    sd: float
    where: str
    load: float = math.nan


PUBLISHED = {
    "young_modulus_pa": Published(3.43e6, 0.05e6, "JKR test, section 2.2"),
    "law_mu": Published(MU, MU_SD, "local law, section 5"),
    "law_length_m": Published(LENGTH, LENGTH_SD, "local law, section 5"),
    "bureau_length_m": Published(BUREAU_LENGTH, math.nan, "Bureau's model, section 5"),
    "stiffness_at_25_kpa_pa_m": Published(TYPICAL_STIFFNESS, math.nan, "section 5, about"),
    "hertz_radius_m": Published(1.857e-3, math.nan, "caption of Fig. 12", 0.3),
    "apparent_radius_m": Published(217 * 7.04e-6, math.nan, "217 px, section 2.3.2", 0.1),
    "sliding_velocity_m_s": Published(4.81e-6, math.nan, "caption of Fig. 7", 0.5),
    "sqrt_rh_m": Published(280e-6, math.nan, "section 2.3.1, about"),
    "noise_px": Published(SIGMA_PX, math.nan, "box of 20 px, section 2.3.2"),
    "stiffness_shear_n_m": Published(9579.0, 25.0, "K_T, Fig. 1"),
    "stiffness_normal_n_m": Published(689.0, 5.0, "k_N, Fig. 1"),
    "lens_compliance_m_n": Published(0.68e-6, math.nan, "section 3"),
    "lens_radius_m": Published(128.8e-3, math.nan, "R, section 2.1"),
    "roughness_m": Published(0.595e-6, 0.013e-6, "h, section 2.2"),
    "poisson": Published(0.5, math.nan, "section 2.2, close to"),
    "pixel_m": Published(7.04e-6, math.nan, "section 2.3.1, about"),
    "frame_rate_hz": Published(8.0, math.nan, "section 2.3.2; 4 at the highest load"),
    "box_px": Published(20.0, math.nan, "section 2.3.2"),
    "step_px": Published(10.0, math.nan, "section 2.3.2"),
    "velocity_m_s": Published(5e-6, math.nan, "section 3"),
}
"""By the name in `summary.json`."""
