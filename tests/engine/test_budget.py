"""The budget of a result tells what a world does to it whose constants are not those of the
settings.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from app.config import Config
from app.engine.conclusions import conclude
from app.engine.setup import grid_of
from app.records import ContactResult
from app.report.summary import budget_data, budget_rows, summary_rows
from app.summary import Summary
from benchmarks.coverage import Drawn, World

QUANTITIES = {
    "onset_time": "onset_time_s",
    "mu_d": "mu_d",
    "law_mu": "law_mu",
    "law_length": "law_length_m",
    "young_modulus": "young_modulus_pa",
}


@cache
def concluded(**errors: float) -> Summary:
    """What settings say that know nothing of the errors."""
    config, rng = Config(), np.random.default_rng(1)
    world = World(config, 0.3, True, Drawn(**errors))
    grid = grid_of(config)
    centre = float(grid.x_px.mean()) - 3.3, float(grid.y_px.mean()) + 2.1
    nothing = np.empty(0)
    contact = ContactResult(centre, math.nan, math.nan, (0.0, 0.0), nothing, nothing)
    return conclude(config, world.snapshots(rng, 5e-9), contact, []).summary


@pytest.mark.parametrize(
    ("name", "of_world", "size"),
    [
        ("pixel size", "pixel", 0.005),
        ("lens compliance", "lens_compliance", 0.1),
        ("shear force", "shear", 0.004),
        ("normal force", "normal", 0.0078),
        ("lens radius", "lens_radius", 0.005),
    ],
)
def test_the_share_of_an_input_is_what_the_world_does(
    name: str, of_world: str, size: float
) -> None:
    """The world's constant is higher than that of the settings by one standard uncertainty: every
    result is off by its share, the other way.
    """
    right, wrong = concluded(), concluded(**{of_world: 1 + size})
    truths = {"onset_time": 1.0, "law_mu": 1.0}
    for quantity, attribute in QUANTITIES.items():
        told = right.shares(quantity)[name]
        # E is measured, and is the same in both; t_s, and L where the pressure is another, are not
        off = getattr(wrong, attribute) / getattr(right, attribute) - 1
        if of_world in ("normal", "lens_radius") and quantity in ("onset_time", *truths):
            continue
        if of_world == "shear" and quantity == "onset_time":
            continue
        assert -told == pytest.approx(off, abs=0.15 * abs(told) + 1.5e-3), quantity


def test_a_lens_holder_that_is_not_known_costs_the_length_most() -> None:
    shares = concluded().shares("law_length")
    assert max(shares, key=lambda one: abs(shares[one])) == "lens compliance"
    assert shares["lens compliance"] < 0  # a softer holder: less slip


def test_the_budget_of_a_run_without_sliding_is_empty() -> None:
    config = Config()
    s = conclude(config, [], None, []).summary
    assert s.budget == s.budget_inputs == s.budget_quantities == ()
    assert math.isnan(s.systematic("law_mu"))
    assert budget_rows(s) == []


def test_both_parts_of_an_uncertainty_are_told() -> None:
    s = concluded()
    rows = {row.label: row.value for row in summary_rows(s)}
    assert rows["Young's modulus from the stress"].count("±") == 2
    (first, *_) = budget_rows(s)
    assert first.label == "what the inputs cost"
    assert any("pixel size -" in row.value for row in budget_rows(s) if row.symbol == "u(E)")


def test_machines_read_the_budget_by_name() -> None:
    s = concluded()
    data = budget_data(s)
    assert data["budget"]["young_modulus"]["pixel size"] == s.shares("young_modulus")["pixel size"]
    assert data["uncertainty_by_inputs"]["young_modulus"] == s.systematic("young_modulus")
    assert 0.005 < data["uncertainty_by_inputs"]["young_modulus"] < 0.02
