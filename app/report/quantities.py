"""Numbers as people read them, and the quantities that a loading experiment comes down to.

The terminal, the window and the pictures write their numbers by the rules of this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.options import UNITS
from app.summary import Summary


def decimals_for(number: float, digits: int) -> int:
    """Decimals that show `number` with so many significant digits after it is rounded to them.

    0.0996 with two digits is 0.10, thus two decimals and not three.
    """
    exponent = int(f"{number:.{digits - 1}e}".partition("e")[2])
    return max(0, digits - 1 - exponent) if number else 0


@dataclass(frozen=True, slots=True)
class Measurement:
    """A quantity with its uncertainty.

    Attributes
    ----------
    name, symbol : str
        What it is, and how the paper writes it, ``"Q_s"``.
    value, sd : float
        In SI units; `sd` is the standard uncertainty. NaN: not measured.
    unit : str
        One of `UNITS`: the unit in which people read the quantity.
    extremes : (float, float)
        Least and greatest of the readings that `value` is the mean of, in place of `sd`.
    """

    name: str
    symbol: str
    value: float
    sd: float = math.nan
    unit: str = ""
    extremes: tuple[float, float] = (math.nan, math.nan)

    @property
    def rounded(self) -> tuple[str, str]:
        """Value and uncertainty, as ``("2.205", "± 0.041")`` or ``("0.930", "0.921 to 0.938")``.

        The value has as many decimals as two significant digits of the uncertainty need, or three
        significant digits where the uncertainty is unknown and its text empty. Both texts are empty
        where nothing was measured.
        """
        factor = UNITS[self.unit]
        value, sd, low, high = (x / factor for x in (self.value, self.sd, *self.extremes))
        if not math.isfinite(value):
            return "", ""
        if 0 < high - low < math.inf:
            decimals = decimals_for((high - low) / 2, 2)
            return f"{value:.{decimals}f}", f"{low:.{decimals}f} to {high:.{decimals}f}"
        if 0 < sd < math.inf:
            decimals = decimals_for(sd, 2)
            return f"{value:.{decimals}f}", f"± {sd:.{decimals}f}"
        return f"{value:.{decimals_for(value, 3)}f}", ""

    def __str__(self) -> str:
        """As ``2.205 ± 0.041 mm`` or ``0.930 (0.921 to 0.938)``, or "not measured"."""
        value, spread = self.rounded
        if not value:
            return "not measured"
        return " ".join(
            filter(None, (value, f"({spread})" if "to" in spread else spread, self.unit))
        )


def measured_text(value: float, sd: float) -> str:
    """`value` as ``1.853 ± 0.024``, or "not measured" where it is NaN."""
    return str(Measurement("", "", value, sd))


def summary_quantities(summary: Summary) -> tuple[Measurement, ...]:
    """What the experiment comes down to, in the units of the paper."""
    s = summary
    return (
        Measurement("normal force", "P", s.normal_force_n, unit="N"),
        Measurement("apparent radius", "a", s.apparent_radius_m, s.apparent_radius_sd_m, "mm"),
        Measurement("Hertz contact radius", "a_H", s.hertz_radius_m, unit="mm"),
        Measurement("onset of sliding", "t_s", s.onset_time_s, s.onset_time_sd_s, "s"),
        Measurement(
            "force at the onset", "Q_s", s.static_force_n, s.mu_s_sd * s.normal_force_n, "N"
        ),
        Measurement("static friction", "mu_s", s.mu_s, s.mu_s_sd),
        Measurement("dynamic friction", "mu_d", s.mu_d, extremes=s.mu_d_range),
        Measurement("friction of the local law", "mu", s.law_mu, s.law_mu_sd),
        Measurement("length of the local law", "L", s.law_length_m, s.law_length_sd_m, "um"),
        Measurement(
            "Young's modulus from the stress", "E", s.young_modulus_pa, s.young_modulus_sd_pa, "MPa"
        ),
        Measurement("sliding velocity", "v", s.sliding_velocity_m_s, unit="um/s"),
    )
