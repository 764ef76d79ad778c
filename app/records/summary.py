"""What a loading experiment comes down to, number by number."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

from app.records.quantities import as_text, summary_quantities
from app.records.schema import build, column, record, uncertainty

NAN = math.nan
# lists of numbers or names that earlier sessions lack
_since_5 = partial(column, since=5, default=())
_of_slides = partial(column, shape=("slides",), since=7, default=())


@record("/entry/summary")
class Summary:
    """The results of a loading experiment; NaN where the run did not go far enough, with the
    reason in `notes`.

    ``*_sd`` is a standard uncertainty by the noise of images and forces; what the uncertainties of
    the operator's inputs add is in `budget`, and of every friction coefficient, by the stiffness of
    the cantilevers, in `calibration_sd`.
    """

    normal_force_n: float = column("normal_force", "N", "P, mean over the drive")
    apparent_radius_m: float = column(
        "apparent_radius", "m", "a (seen): radius of the contact's edge in the images"
    )
    apparent_radius_sd_m: float = uncertainty("apparent_radius")
    hertz_radius_m: float = column(
        "hertz_radius", "m", "a_H (Hertz): from P, the sphere's radius, E and nu"
    )
    onset_time_s: float = column(
        "onset_time", "s", "t_s, the onset of sliding, from the start of the drive"
    )
    onset_time_sd_s: float = uncertainty("onset_time")
    static_force_n: float = column("static_force", "N", "Q_s, the shear force at the onset")
    mu_s: float = column("mu_s", "1", "static friction coefficient Q_s/P")
    mu_s_sd: float = uncertainty("mu_s")
    mu_d: float = column("mu_d", "1", "dynamic friction coefficient, mean of Q/P after t_s")
    mu_d_range: tuple[float, float] = column(
        "mu_d_range", "1", "least and greatest Q/P during sliding"
    )
    sliding_velocity_m_s: float = column("sliding_velocity", "m/s", "velocity during sliding")
    notes: tuple[str, ...] = column(
        "notes", "", "why a quantity above is NaN", shape=("notes",), default=()
    )
    law_mu: float = column(
        "law_mu",
        "1",
        "mu of the local friction law mu p (1 - exp(-s/(mu L)))",
        since=3,
        default=NAN,
    )
    law_mu_sd: float = uncertainty("law_mu", default=NAN)
    law_length_m: float = column("law_length", "m", "L of that law", since=3, default=NAN)
    law_length_sd_m: float = uncertainty("law_length", default=NAN)
    young_modulus_pa: float = column(
        "young_modulus",
        "Pa",
        "E from the balance of the shear traction with Q",
        since=3,
        default=NAN,
    )
    young_modulus_sd_pa: float = uncertainty("young_modulus", default=NAN)
    calibration_sd: float = column(
        "calibration_uncertainty",
        "1",
        "relative uncertainty of every friction coefficient from the cantilevers",
        since=4,
        default=NAN,
    )
    static_force_sd_n: float = uncertainty("static_force", since=5, default=NAN)
    mu_d_sd: float = uncertainty("mu_d", since=5, default=NAN)
    law_chi2: float = column(
        "law_chi2",
        "1",
        "mean square deviation of traction against slip from the law, over its uncertainty",
        since=5,
        default=NAN,
    )
    pressure_radius_m: tuple[float, ...] = _since_5(
        "pressure_radius", "m", "distance from the contact's centre", shape=("rim",)
    )
    pressure_pa: tuple[float, ...] = _since_5(
        "pressure", "Pa", "measured pressure: traction of sliding over mu", shape=("rim",)
    )
    pressure_sd_pa: tuple[float, ...] = uncertainty("pressure", default=())
    interface_stiffness_pa_m: tuple[float, ...] = _since_5(
        "interface_stiffness",
        "Pa/m",
        "k(r): traction over small slip, at the radii of the pressure",
        shape=("rim",),
    )
    interface_stiffness_sd_pa_m: tuple[float, ...] = uncertainty("interface_stiffness", default=())
    precursor_slip_m: tuple[float, ...] = _since_5(
        "precursor_slip",
        "m",
        "local slip at t_s, before all slides, at the radii of the pressure",
        shape=("rim",),
    )
    loop_work_j: tuple[float, ...] = _since_5(
        "loop_work",
        "J",
        "dissipated in each cycle: area of the loop of Q over the travel",
        shape=("cycles",),
    )
    local_work_j: tuple[float, ...] = _since_5(
        "local_work",
        "J",
        "the same from the traction along the local slip, over the contact",
        shape=("cycles",),
    )
    masing: tuple[float, ...] = _since_5(
        "masing",
        "1",
        "rms distance of each leg from the first one at twice its size, over its greatest Q",
        shape=("reversals",),
    )
    budget_inputs: tuple[str, ...] = _since_5(
        "budget_inputs", "", "inputs that the operator gives", shape=("inputs",)
    )
    budget_quantities: tuple[str, ...] = _since_5(
        "budget_quantities", "", "names here or in results", shape=("quantities",)
    )
    budget: tuple[float, ...] = _since_5(
        "budget",
        "1",
        "part of each quantity's relative uncertainty that each input causes, with its sign: the"
        " quantities of the first input, then of the next",
        shape=("contributions",),
    )
    slide_step: tuple[int, ...] = _of_slides(
        "slide_step",
        "1",
        "number of each step that moves the stage one way, of a protocol of several",
    )
    slide_hold_s: tuple[float, ...] = _of_slides(
        "slide_hold", "s", "duration of the hold before it"
    )
    slide_velocity_m_s: tuple[float, ...] = _of_slides(
        "slide_velocity", "m/s", "velocity of the stage in it"
    )
    slide_peak: tuple[float, ...] = _of_slides(
        "slide_peak", "1", "greatest Q/P in it, along the motion: mu_s"
    )
    slide_peak_sd: tuple[float, ...] = uncertainty("slide_peak", default=())
    slide_mu_d: tuple[float, ...] = _of_slides(
        "slide_mu_d", "1", "Q/P in its last third; NaN where it rises or falls there"
    )
    slide_mu_d_sd: tuple[float, ...] = uncertainty("slide_mu_d", default=())
    slide_rise: tuple[float, ...] = _of_slides(
        "slide_rise", "1", "its peak above mu_d before the hold"
    )
    slide_rise_sd: tuple[float, ...] = uncertainty("slide_rise", default=())
    ageing_rate: float = column(
        "ageing_rate",
        "1",
        "beta of the rise beta ln(1 + t/t0) after a hold of duration t",
        since=7,
        default=NAN,
    )
    ageing_rate_sd: float = uncertainty("ageing_rate", default=NAN)
    ageing_time_s: float = column("ageing_time", "s", "t0 of that rise", since=7, default=NAN)
    ageing_time_sd_s: float = uncertainty("ageing_time", default=NAN)

    def __str__(self) -> str:
        return as_text("Summary, ± total uncertainty:", summary_quantities(self), self.notes)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show a notebook the same, in place of every number in full."""
        printer.text(str(self))

    def shares(self, quantity: str) -> dict[str, float]:
        """Relative uncertainty of a quantity by each input, with its sign; empty where it is not
        known.
        """
        if quantity not in self.budget_quantities:
            return {}
        column = self.budget_quantities.index(quantity)
        row = self.budget[column :: len(self.budget_quantities)]
        return dict(zip(self.budget_inputs, row, strict=True))

    def systematic(self, quantity: str) -> float:
        """Relative uncertainty of a quantity by all inputs together; NaN where it is not known."""
        shares = self.shares(quantity)
        return math.hypot(*shares.values()) if shares else NAN


UNMEASURED = replace(build(Summary, lambda column: None), mu_d_range=(NAN, NAN))
"""That of a run of which nothing was measured."""
