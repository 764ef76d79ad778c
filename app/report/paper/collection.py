"""All figures by name, in the order of the paper; each is drawn from the results alone."""

from __future__ import annotations

from collections.abc import Callable

from app.records.study_results import StudyResults
from app.report.paper import (
    bench_sketch as sketch,
    beyond,
    contact_figures as contact,
    field_figures as fields,
    force_figures as forces,
    law_figures as law,
    models,
    stress,
)
from app.report.paper.runs import experiments
from app.report.paper.style import Drawn, FigureStyle, styled
from app.report.paper.titles import TITLES

_DRAWN_BY: dict[str, Callable[..., Drawn]] = {
    "1": sketch.bench_sketch,
    "2": contact.interface_image,
    "3": contact.apparent_radii,
    "4": contact.correlation_of_a_box,
    "4d": contact.noise_over_box,
    "5": forces.shear_forces,
    "6a": fields.ux_fields,
    "6b": fields.uy_fields,
    "7": forces.ring_displacements,
    "8": forces.friction_coefficients,
    "9": stress.force_balance,
    "10": fields.stress_fields,
    "11": models.sliding_displacements,
    "12": models.loading_displacements,
    "13": stress.stress_profiles,
    "14": models.stick_radii,
    "15": law.local_law,
    "pressure": beyond.pressures,
    "stiffness": beyond.stiffnesses,
    "law": beyond.law_over_loads,
    "dissipation": beyond.dissipation,
    "budget": beyond.error_budget,
}
FIGURES = {name: (title, _DRAWN_BY[name]) for name, title in TITLES.items()}
"""Name -> title, and the function that draws it; a number is that of the paper's figure."""
_OF_ALL_RUNS = ("stiffness", "law")  # they show what the runs have in common, too


def draw(name: str, results: StudyResults, look: FigureStyle | None = None) -> Drawn:
    """The figure of that name, with a look if one is given.

    Raises
    ------
    NotDrawn
        The results do not hold what it shows.
    """
    function = FIGURES[name][1]
    with styled(look):
        runs = experiments(results)
        return function(runs, results.joint) if name in _OF_ALL_RUNS else function(runs)


def number_of(name: str) -> str:
    """The number of a figure without its letter; the name of one that has no number."""
    return name.rstrip("abcd")


def stem(name: str) -> str:
    """The name of the figure's files without their ending: ``fig06a``, ``pressure``."""
    digits = number_of(name)
    return f"fig{int(digits):02d}{name[len(digits) :]}" if digits.isdigit() else name
