"""What runs have in common, where each input of the operator does the same to all of them."""

from __future__ import annotations

import math

import pytest

from analysis.mechanics.interface import elastic_length
from app.records.study_results import Origin
from app.records.summary import Summary
from app.settings.config import load, to_toml
from app.study.across_runs import Reduced, joint_of

NAN = math.nan


def run(load_n: float, budget: dict[str, float], *settings: str, sd: float = 0.002) -> Reduced:
    """A run whose law is that of all, each result within `sd` of itself by noise, and whose mu, L
    and E each input changes by the same share.
    """
    origin = Origin("run.h5", "", "done", "", to_toml(load(None, settings)))
    results = ("law_mu", "law_length", "young_modulus")
    summary = Summary(
        load_n, *[NAN] * 9, (NAN, NAN), NAN,
        law_mu=0.9, law_mu_sd=0.9 * sd, law_length_m=8e-7, law_length_sd_m=8e-7 * sd,
        young_modulus_pa=3.4e6, young_modulus_sd_pa=3.4e6 * sd,
        budget_inputs=tuple(budget), budget_quantities=results,
        budget=tuple(share for share in budget.values() for _ in results),
    )  # fmt: skip
    return Reduced(origin, summary)


def test_what_an_input_does_to_all_alike_stays_whatever_order_a_run_names_it_in() -> None:
    both = ({"pixel size": 0.03, "thickness": 0.001}, {"thickness": 0.001, "pixel size": 0.03})
    found = joint_of([run(0.1 * n, both[n % 2]) for n in range(1, 6)])
    assert found.young_modulus_pa == pytest.approx(3.4e6)
    assert found.young_modulus_sd_pa / 3.4e6 == pytest.approx(math.hypot(0.03, 0.001), rel=0.02)
    assert found.length_sd_m / 8e-7 == pytest.approx(math.hypot(0.03, 0.001), rel=0.02)


@pytest.mark.parametrize("nu", [0.4, 0.5])
def test_the_length_by_the_roughness_is_as_uncertain_as_both_its_inputs(nu: float) -> None:
    """Poisson's ratio is stepped to where a block still has one."""
    settings = (
        f"sample.poisson={nu}",
        "sample.roughness=1.2",
        "uncertainty.poisson=0.03",
        "uncertainty.roughness=2",
    )
    found = joint_of([run(0.1 * n, {}, *settings) for n in range(1, 4)])
    assert found.roughness_length_m == pytest.approx(elastic_length(1.2e-6, nu))
    change = elastic_length(1.2e-6, nu) - elastic_length(1.2e-6, nu - 0.03)
    both = math.hypot(0.02 * elastic_length(1.2e-6, nu), change)
    assert found.roughness_length_sd_m == pytest.approx(both)
    assert change > 0.02 * found.roughness_length_m


def test_no_roughness_in_the_settings_is_no_length_of_0() -> None:
    found = joint_of([run(0.1 * n, {}, "sample.roughness=0") for n in range(1, 4)])
    assert math.isnan(found.roughness_length_m)
    assert math.isnan(found.roughness_length_sd_m)
    assert any("sample.roughness is 0" in note for note in found.notes)
    assert not any("do not go together" in note for note in found.notes)
