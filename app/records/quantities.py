"""Numbers as people read them, and the quantities that experiments come down to.

The terminal, the window, reports and notebooks write their numbers by the rules of this module: the
digits of a value follow its total uncertainty, and a value that is not resolved is told by its
upper bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from analysis.options import UNITS
from app.records.schema import columns_of

if TYPE_CHECKING:
    from app.records.study_results import Joint
    from app.records.summary import Summary

NOWHERE = (math.nan, math.nan)
NO_LAW = "local law: traction against slip does not follow"
"""How the note begins that says that mu and L are those of a law that does not hold."""
COVERAGE = 2.0  # standard uncertainties about a value: the interval that resolves it, or does not
CENTRAL = 3  # rings whose mean is told for the centre
# name of the number in a record, what it is, its symbol, and the unit in which people read it
QuantityEntry = tuple[str, str, str, str]
OF_A_RUN: tuple[QuantityEntry, ...] = (
    ("normal_force_n", "normal force", "P", "N"),
    ("apparent_radius_m", "apparent radius", "a", "mm"),
    ("hertz_radius_m", "Hertz contact radius", "a_H", "mm"),
    ("onset_time_s", "onset of sliding", "t_s", "s"),
    ("static_force_n", "force at the onset", "Q_s", "N"),
    ("mu_s", "static friction", "mu_s", ""),
    ("mu_d", "dynamic friction", "mu_d", ""),
    ("law_mu", "friction of the local law", "mu", ""),
    ("law_length_m", "length of the local law", "L", "um"),
    ("young_modulus_pa", "Young's modulus from the stress", "E", "MPa"),
    ("sliding_velocity_m_s", "sliding velocity", "v", "um/s"),
)
OF_ALL_RUNS: tuple[QuantityEntry, ...] = (
    ("young_modulus_pa", "Young's modulus", "E", "MPa"),
    ("mu", "friction at 1 N", "mu", ""),
    ("decay", "its fall with the load, P^-n", "n", ""),
    ("length_m", "length of the local law", "L", "um"),
    ("stiffness_length_m", "L by the stiffness of all rings", "p/k", "um"),
    ("roughness_length_m", "L by the roughness", "L(h)", "um"),
)
AGEING: tuple[QuantityEntry, ...] = (
    ("ageing_rate", "rate of ageing of mu_s", "beta", ""),
    ("ageing_time_s", "time of ageing", "t_0", "s"),
)
SIGNED = ("decay", "ageing_rate")


def counted(number: int, what: str) -> str:
    """``1 run``, ``2 runs``."""
    return f"{number} {what}" + "s" * (number != 1)


def decimals_for(number: float, digits: int) -> int:
    """Decimals that show `number` with so many significant digits after it is rounded to them.

    0.0996 with two digits is 0.10, thus two decimals and not three.
    """
    exponent = int(f"{number:.{digits - 1}e}".partition("e")[2])
    return max(0, digits - 1 - exponent) if number else 0


def decimals_of(sd: float) -> int:
    """Decimals of a value and of its total uncertainty, by the rule of the Particle Data Group: two
    significant digits of an uncertainty that begins with 100 to 354, one from 355 to 949, and from
    950 on the two of the next power of ten, 1.0.
    """
    first, _, exponent = f"{sd:.2e}".partition("e")
    if float(first) >= 9.5:
        return decimals_for(10.0 ** (int(exponent) + 1), 2)
    return decimals_for(sd, 1 if float(first) >= 3.55 else 2)


def with_uncertainty(value: float, sd: float) -> tuple[str, str]:
    """A value and its uncertainty as ``("2.20", "± 0.04")``; three significant digits and no second
    text where that is not known; both texts are empty for NaN.
    """
    if not math.isfinite(value):
        return "", ""
    if not 0 < sd < math.inf:
        return f"{value:.{decimals_for(value, 3)}f}", ""
    decimals = decimals_of(sd)
    return f"{value:.{decimals}f}", f"± {sd:.{decimals}f}"


def resolved(value: float, sd: float) -> float:
    """A length that is 0 or more, NaN where value - 2 u reaches 0 (`upper_bound`)."""
    return math.nan if math.isfinite(upper_bound(value, sd)) else value


def upper_bound(value: float, sd: float, *, is_signed: bool = False) -> float:
    """What is told of a value that is not resolved: value + 2 u, with the total standard
    uncertainty u, rounded up to one digit; NaN where it is resolved.

    It is not resolved where the interval value ± 2 u, in which it lies with 95 %, reaches 0. The
    bound of a quantity of either sign is that of its magnitude.
    """
    if not (math.isfinite(value) and 0 < sd < math.inf) or abs(value) > COVERAGE * sd:
        return math.nan
    reach = (abs(value) if is_signed else max(value, 0.0)) + COVERAGE * sd
    power = 10.0 ** math.floor(math.log10(reach))
    return math.ceil(reach / power * (1 - 1e-12)) * power


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
    combined : float
        Standard uncertainty by both, where its two parts are not known apart.
    is_signed : bool
        Whether it may be below 0, as a difference or an exponent.
    doubt : str
        Why the number means little, in a few words; empty where nothing is known against it.
    key : str
        Its name in files, which says the SI unit.
    budget : mapping
        What each input costs it, relative and with its sign.
    origin : str
        What it is measured or computed from, in a few words; empty where that is not recorded.
    """

    name: str
    symbol: str
    value: float
    sd: float = math.nan
    unit: str = ""
    extremes: tuple[float, float] = NOWHERE
    systematic: float = math.nan
    combined: float = math.nan
    is_signed: bool = False
    doubt: str = ""
    key: str = ""
    budget: Mapping[str, float] = field(default_factory=dict)
    origin: str = ""

    @property
    def total(self) -> float:
        """Standard uncertainty by noise and inputs together; NaN where neither is known."""
        parts = (self.sd, self.systematic, self.combined)
        known = [part for part in parts if math.isfinite(part)]
        return math.hypot(*known) if known else math.nan

    @property
    def by_noise(self) -> Measurement:
        """With its uncertainty by noise alone."""
        return replace(self, systematic=math.nan)

    @property
    def bound_in_unit(self) -> float:
        """Upper bound, in `unit`, of a value that is not resolved (`upper_bound`), else NaN."""
        factor = UNITS[self.unit]
        return upper_bound(self.value / factor, self.total / factor, is_signed=self.is_signed)

    @property
    def bound(self) -> float:
        """The same in SI units."""
        return self.bound_in_unit * UNITS[self.unit]

    @property
    def is_resolved(self) -> bool:
        """Whether its total uncertainty leaves more than an upper bound."""
        return not math.isfinite(self.bound_in_unit)

    @property
    def in_unit(self) -> tuple[float, float, float]:
        """Value and uncertainty, by noise and by the inputs, in `unit`."""
        factor = UNITS[self.unit]
        return self.value / factor, self.sd / factor, self.systematic / factor

    @property
    def rounded(self) -> tuple[str, str]:
        """Value and total uncertainty in `unit`, as ``("2.20", "± 0.04")``, ``("0.9301", "0.921 to
        0.938")``, or ``("not resolved, below 0.2", "")``; the second text is empty where no
        uncertainty is known, both are where nothing was measured.
        """
        factor = UNITS[self.unit]
        value, low, high = (x / factor for x in (self.value, *self.extremes))
        if not math.isfinite(value):
            return "", ""
        if 0 < high - low < math.inf:
            decimals = decimals_for((high - low) / 2, 2)
            return f"{value:.{decimals}f}", f"{low:.{decimals}f} to {high:.{decimals}f}"
        if math.isfinite(bound := self.bound_in_unit):
            where = "within ±" if self.is_signed else "below"
            return f"not resolved, {where} {bound:.{decimals_for(bound, 1)}f}", ""
        return with_uncertainty(value, self.total / factor)

    @property
    def parts(self) -> tuple[str, str, str]:
        """Value, with the digits that its total uncertainty leaves, and both uncertainties, by
        noise and by the inputs, with two significant digits each: ``("2.20", "0.041", "0.0012")``;
        empty where one is not known. In place of the uncertainty by noise stands the range of the
        readings where there is one; what is not resolved has its bound alone.
        """
        value, spread = self.rounded
        if not value or not self.is_resolved:
            return value, "", ""
        noise, inputs = (
            f"{x:.{decimals_for(x, 2)}f}" if math.isfinite(x) else "" for x in self.in_unit[1:]
        )
        return value, spread if "to" in spread else noise, inputs

    def __str__(self) -> str:
        """As ``2.20 ± 0.04 mm``, ``0.930 (0.921 to 0.938)``, ``not resolved, below 0.2 um``, or
        "not measured"; then what is in doubt.
        """
        value, spread = self.rounded
        if not value:
            return "not measured"
        text = " ".join(
            filter(None, (value, f"({spread})" if "to" in spread else spread, self.unit))
        )
        return f"{text}; {self.doubt}" if self.doubt else text


def measured_text(value: float, sd: float) -> str:
    """A reading as ``1.853 ± 0.024``, of whatever size, or "not measured" where it is NaN."""
    return " ".join(with_uncertainty(value, sd)).strip() or "not measured"


def doubts(notes: Iterable[str]) -> list[str]:
    """Those notes of a summary that put its numbers in doubt: a law that does not hold."""
    return [note for note in notes if note.startswith(NO_LAW)]


def _read(held: Any, listed: Iterable[QuantityEntry]) -> Iterator[Measurement]:
    """Quantities of a record with their uncertainties."""
    columns = columns_of(type(held))
    attributes = {c.name: c.attribute for c in columns}
    by_attribute = {c.attribute: c for c in columns}
    for key, what, symbol, unit in listed:
        name, value = by_attribute[key].name, getattr(held, key)
        sd = getattr(held, attributes.get(f"{name}_errors", ""), math.nan)
        budget = held.shares(name) if hasattr(held, "shares") else {}
        yield Measurement(
            what,
            symbol,
            value,
            sd,
            unit,
            systematic=abs(value) * math.hypot(*budget.values()) if budget else math.nan,
            is_signed=key in SIGNED,
            key=key,
            budget=budget,
            origin=by_attribute[key].meaning,
        )


def summary_quantities(summary: Summary) -> tuple[Measurement, ...]:
    """What the experiment comes down to, in the units of the paper."""
    found = {one.key: one for one in _read(summary, OF_A_RUN)}
    Q, mu_d = found["static_force_n"], found["mu_d"]
    if math.isnan(Q.sd):  # of a session that has only that of mu_s
        found[Q.key] = replace(Q, sd=summary.mu_s_sd * summary.normal_force_n)
    if math.isnan(mu_d.sd):
        found[mu_d.key] = replace(mu_d, extremes=summary.mu_d_range)
    if doubts(summary.notes):
        for key in ("law_mu", "law_length_m"):
            found[key] = replace(found[key], doubt="the law does not hold")
    return tuple(found.values())


def ageing_quantities(summary: Summary) -> list[Measurement]:
    """How the contact ages while it is held."""
    return list(_read(summary, AGEING))


def further_quantities(summary: Summary) -> list[Measurement]:
    """What is told beside them: the range of Q/P, how well the law holds, how the contact ages."""
    low, high = summary.mu_d_range
    return [
        Measurement("least Q/P while it slides", "", low, key="mu_d_least"),
        Measurement("greatest Q/P while it slides", "", high, key="mu_d_greatest"),
        Measurement("reduced chi2 of the local law", "", summary.law_chi2, key="law_chi2"),
        Measurement("calibration, relative, of every mu", "u(mu)", summary.calibration_sd,
                    key="calibration_sd"),
        *ageing_quantities(summary),
    ]  # fmt: skip


def local_quantities(summary: Summary) -> list[Measurement]:
    """Pressure, stiffness and slip at the centre of the contact, and what cycles dissipate."""
    s, budget = summary, summary.shares("pressure")
    pressure = _centre(s.pressure_pa)
    found = [
        Measurement("pressure at the centre", "p(0)", pressure, _centre(s.pressure_sd_pa), "kPa",
                    systematic=abs(pressure) * s.systematic("pressure"), key="pressure_pa",
                    budget=budget),
        Measurement("stiffness of the interface, centre", "k(0)",
                    _centre(s.interface_stiffness_pa_m), _centre(s.interface_stiffness_sd_pa_m),
                    "kPa/um", key="interface_stiffness_pa_m"),
        Measurement("slip at the centre at t_s", "s_0", _centre(s.precursor_slip_m), unit="um",
                    key="precursor_slip_m"),
    ]  # fmt: skip
    local = s.local_work_j or [math.nan] * len(s.loop_work_j)
    for n, (loop, slip) in enumerate(zip(s.loop_work_j, local, strict=False), 1):
        name = f"work of cycle {n}"
        found += [
            Measurement(name, "W", loop, unit="uJ", key=f"loop_work_{n}_j"),
            Measurement(
                f"{name}, by the local slip", "W", slip, unit="uJ", key=f"local_work_{n}_j"
            ),
        ]
    if s.masing:
        name = "distance from Masing's rule, at most"
        found.append(Measurement(name, "", max(s.masing), key="masing"))
    return found


def _centre(values: Sequence[float]) -> float:
    known = [v for v in values[:CENTRAL] if math.isfinite(v)]
    return math.fsum(known) / len(known) if known else math.nan


def joint_quantities(joint: Joint) -> tuple[Measurement, ...]:
    """What the runs have in common, in the units of the paper; uncertainties of all kinds."""
    found = _read(joint, OF_ALL_RUNS)
    return tuple(replace(one, sd=math.nan, combined=one.sd) for one in found)


def side_by_side(
    lists: Iterable[Iterable[Measurement]],
) -> Iterator[tuple[Measurement, list[Measurement | None]]]:
    """Each quantity that is in some lists, as the first of them has it, and that of every list."""
    by_key = [{one.key: one for one in quantities} for quantities in lists]
    for key in dict.fromkeys(key for held in by_key for key in held):
        found = [held.get(key) for held in by_key]
        yield next(filter(None, found)), found


def upper_bounds(quantities: Iterable[Measurement]) -> dict[str, float]:
    """Upper bounds, SI, of those quantities that are not resolved, by their names in files."""
    return {one.key: one.bound for one in quantities if not one.is_resolved}


def as_text(title: str, quantities: Iterable[Measurement], notes: Iterable[str]) -> str:
    """Some quantities for a person at a prompt, those that were measured, a line for each."""
    rows = [(one.name, one.symbol, str(one)) for one in quantities if math.isfinite(one.value)]
    wide = [max(map(len, column), default=0) for column in zip(*rows, strict=True)] or [0, 0]
    lines = [f"  {name:{wide[0]}}  {symbol:{wide[1]}}  {text}" for name, symbol, text in rows]
    return "\n".join([title, *lines, *(f"  note: {note}" for note in notes)])
