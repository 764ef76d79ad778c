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

FIGURES: dict[str, tuple[str, Callable[..., Drawn]]] = {
    "1": ("Sketch of the bench", sketch.bench_sketch),
    "2": ("Images of the interface", contact.interface_image),
    "3": ("Intensity profiles and apparent contact radius", contact.apparent_radii),
    "4": ("Principle of the image correlation", contact.correlation_of_a_box),
    "4d": ("Noise of the displacements against the box", contact.noise_over_box),
    "5": ("Shear force against displacement", forces.shear_forces),
    "6a": ("Displacement fields u_x", fields.ux_fields),
    "6b": ("Displacement fields u_y", fields.uy_fields),
    "7": ("Displacement in time and onset of sliding", forces.ring_displacements),
    "8": ("Friction coefficients", forces.friction_coefficients),
    "9": ("Force balance and Young's modulus", stress.force_balance),
    "10": ("Stress fields", fields.stress_fields),
    "11": ("Displacement in steady sliding", models.sliding_displacements),
    "12": ("Displacement during loading", models.loading_displacements),
    "13": ("Stress profiles", stress.stress_profiles),
    "14": ("Stick radius", models.stick_radii),
    "15": ("Local friction law", law.local_law),
    "pressure": ("Measured pressure", beyond.pressures),
    "stiffness": ("Stiffness of the interface", beyond.stiffnesses),
    "law": ("Local law over the loads", beyond.law_over_loads),
    "dissipation": ("Work of friction", beyond.dissipation),
    "budget": ("Error budget", beyond.error_budget),
}
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
