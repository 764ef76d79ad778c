"""Numbers as people read them, and the quantities that a loading experiment comes down to.

The terminal, the window and the pictures write their numbers by the rules of this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from analysis.options import UNITS
from app.summary import Summary

NOWHERE = (math.nan, math.nan)


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
        In SI units; `sd` is the standard uncertainty by noise. NaN: not measured.
    unit : str
        One of `UNITS`: the unit in which people read the quantity.
    extremes : (float, float)
        Least and greatest of the readings that `value` is the mean of, in place of `sd`.
    systematic : float
        Standard uncertainty by the operator's inputs.
    """

    name: str
    symbol: str
    value: float
    sd: float = math.nan
    unit: str = ""
    extremes: tuple[float, float] = NOWHERE
    systematic: float = math.nan

    @property
    def combined(self) -> Measurement:
        """With one uncertainty, by noise and inputs together."""
        known = [part for part in (self.sd, self.systematic) if math.isfinite(part)]
        sd = math.hypot(*known) if known else math.nan
        return replace(self, sd=sd, systematic=math.nan)

    @property
    def in_unit(self) -> tuple[float, float, float]:
        """Value and uncertainty, by noise and by the inputs, in `unit`."""
        factor = UNITS[self.unit]
        return self.value / factor, self.sd / factor, self.systematic / factor

    @property
    def rounded(self) -> tuple[str, str]:
        """Value and uncertainty, as ``("2.205", "± 0.041")``, with that by the inputs too
        ``("2.205", "± 0.041 ± 0.012")``, or ``("0.930", "0.921 to 0.938")``.

        The value has as many decimals as two significant digits of the uncertainty by noise need,
        but not more than three of that by the inputs; three significant digits where neither is
        known, and its text is empty then. Both texts are empty where nothing was measured.
        """
        factor = UNITS[self.unit]
        value, sd, by_inputs, low, high = (
            x / factor for x in (self.value, self.sd, self.systematic, *self.extremes)
        )
        if not math.isfinite(value):
            return "", ""
        if 0 < high - low < math.inf:
            decimals = decimals_for((high - low) / 2, 2)
            return f"{value:.{decimals}f}", f"{low:.{decimals}f} to {high:.{decimals}f}"
        known = [part for part in (sd, by_inputs) if 0 < part < math.inf]
        if not known:
            return f"{value:.{decimals_for(value, 3)}f}", ""
        decimals = decimals_for(max(known[0], known[-1] / 10), 2)
        return f"{value:.{decimals}f}", " ".join(f"± {part:.{decimals}f}" for part in known)

    @property
    def parts(self) -> tuple[str, str, str]:
        """Value and both uncertainties, by noise and by the inputs, as texts of equal decimals:
        ``("2.205", "0.041", "0.012")``; empty where one is not known. In place of the uncertainty
        by noise stands the range of the readings where there is one.
        """
        value, spread = self.rounded
        decimals = len(value.partition(".")[2])
        _, noise, inputs = (
            f"{x:.{decimals}f}" if value and math.isfinite(x) else "" for x in self.in_unit
        )
        return value, spread if "to" in spread else noise, inputs

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

    def by_inputs(value: float, name: str) -> float:
        return abs(value) * s.systematic(name)

    Q_sd = s.static_force_sd_n
    if not math.isfinite(Q_sd):  # of a session that has only that of mu_s
        Q_sd = s.mu_s_sd * s.normal_force_n
    a, E = s.apparent_radius_m, s.young_modulus_pa
    a_sd, E_sd, t_sd = s.apparent_radius_sd_m, s.young_modulus_sd_pa, s.onset_time_sd_s
    rows = (
        ("apparent radius", "a", a, a_sd, "mm", "apparent_radius"),
        ("Hertz contact radius", "a_H", s.hertz_radius_m, math.nan, "mm", "hertz_radius"),
        ("onset of sliding", "t_s", s.onset_time_s, t_sd, "s", "onset_time"),
        ("force at the onset", "Q_s", s.static_force_n, Q_sd, "N", "static_force"),
        ("static friction", "mu_s", s.mu_s, s.mu_s_sd, "", "mu_s"),
        ("dynamic friction", "mu_d", s.mu_d, s.mu_d_sd, "", "mu_d"),
        ("friction of the local law", "mu", s.law_mu, s.law_mu_sd, "", "law_mu"),
        ("length of the local law", "L", s.law_length_m, s.law_length_sd_m, "um", "law_length"),
        ("Young's modulus from the stress", "E", E, E_sd, "MPa", "young_modulus"),
        ("sliding velocity", "v", s.sliding_velocity_m_s, math.nan, "um/s", "sliding_velocity"),
    )
    return (
        Measurement("normal force", "P", s.normal_force_n, unit="N"),
        *(
            Measurement(
                name,
                symbol,
                value,
                sd,
                unit,
                s.mu_d_range if symbol == "mu_d" and math.isnan(sd) else NOWHERE,
                by_inputs(value, key),
            )
            for name, symbol, value, sd, unit, key in rows
        ),
    )
