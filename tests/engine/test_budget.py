"""The budget of a result tells what a world does to it whose constants are not those of the
settings.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from analysis.friction.local_law import LocalLaw
from analysis.inversion import axisymmetric
from analysis.mechanics import greenwood_tripp
from app.evaluation import conclusions, law_fit
from app.evaluation.budget import Budget, Measured, budget
from app.evaluation.conclusions import conclude, results_of
from app.evaluation.readings import Readings
from app.evaluation.setup import grid_of, hertz_radius_m
from app.records.record_types import Conditions, ContactResult, Phase, Snapshot
from app.records.summary import Summary
from app.report.summary_rows import budget_data, budget_rows, summary_rows
from app.settings.config import Config
from benchmarks import coverage
from benchmarks.coverage import Drawn, World

QUANTITIES = {
    "onset_time": "onset_time_s",
    "mu_d": "mu_d",
    "law_mu": "law_mu",
    "law_length": "law_length_m",
    "young_modulus": "young_modulus_pa",
}


def world_of(known: Sequence[str], **errors: float) -> tuple[Config, list[Snapshot], ContactResult]:
    """Settings with the uncertainties that are named (none: all), and a drive with those errors."""
    config, rng = Config(), np.random.default_rng(1)
    if known:
        none = {name: 0.0 for name in asdict(config.uncertainty) if name not in known}
        config = replace(config, uncertainty=replace(config.uncertainty, **none))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "RATE", 2.0)
        world = World(config, 0.3, True, Drawn(**errors))
    grid = grid_of(config)
    centre = float(grid.x_px.mean()) - 3.3, float(grid.y_px.mean()) + 2.1
    nothing = np.empty(0)
    contact = ContactResult(centre, math.nan, math.nan, (0.0, 0.0), nothing, nothing)
    return config, world.snapshots(rng, 5e-9), contact


@cache
def concluded(*known: str, **errors: float) -> Summary:
    """What settings say that know nothing of the errors; its budget only where there are none, of
    the inputs that are named, or of all.
    """
    with pytest.MonkeyPatch.context() as patch:
        if errors:
            patch.setattr(conclusions, "_spent", lambda *_: Budget())
        return conclude(*world_of(known, **errors), []).summary


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "of_world", "size"),
    [
        ("zero of P", "normal_zero", 1e-3),
        ("zero of Q", "shear_zero", 1e-3),
        ("Q in P", "shear_in_normal", 0.003),
        ("P in Q", "normal_in_shear", 0.003),
        ("drift", "drift", 0.0005e-6),
    ],
)
def test_the_share_of_what_is_read_too_much_is_what_the_world_does(
    name: str, of_world: str, size: float
) -> None:
    right, wrong = concluded(), concluded(**{of_world: size})
    for quantity in ("law_mu", "law_length", "young_modulus", "mu_d"):
        told = right.shares(quantity)[name]
        off = getattr(wrong, QUANTITIES[quantity]) / getattr(right, QUANTITIES[quantity]) - 1
        assert -told == pytest.approx(off, abs=0.15 * abs(told) + 4e-4), quantity
    changed = "law_length" if name == "drift" else "law_mu"
    assert abs(right.shares(changed)[name]) > 0.002


def test_a_zero_that_drifts_is_in_the_uncertainty_of_modulus_and_friction() -> None:
    """By 20 mN in a minute E and mu were off by 2 %, and only other inputs were in the budget."""
    config, frames, contact = world_of(["shear"])

    def drifted(s: Snapshot) -> Snapshot:
        now = s.conditions
        return replace(
            s, conditions=replace(now, shear_force_n=now.shear_force_n + 0.02 / 60 * now.time_s)
        )

    s = conclude(config, [drifted(s) for s in frames], contact, []).summary
    for value, true, sd, name in (
        (s.young_modulus_pa, config.sample.young_modulus, s.young_modulus_sd_pa, "young_modulus"),
        (s.law_mu, coverage.MU, s.law_mu_sd, "law_mu"),
    ):
        known = {k: v for k, v in s.shares(name).items() if k != "drift of Q"}
        assert abs(value / true - 1) > 0.015
        assert math.hypot(*known.values()) < 0.01
        assert abs(value - true) < 1.5 * math.hypot(sd, value * s.systematic(name))
        assert abs(s.shares(name)["drift of Q"]) < 1.5 * abs(value / true - 1)


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


def test_an_uncertainty_and_what_it_comes_of_are_told() -> None:
    s = concluded()
    rows = {row.label: row.value for row in summary_rows(s)}
    assert rows["Young's modulus from the stress"].count("±") == 1
    (first, *_) = budget_rows(s)
    assert first.label == "what the inputs cost"
    assert any("pixel size -" in row.value for row in budget_rows(s) if row.symbol == "u(E)")


def test_machines_read_the_budget_by_name() -> None:
    s = concluded()
    data = budget_data(s)
    assert data["budget"]["young_modulus"]["pixel size"] == s.shares("young_modulus")["pixel size"]
    assert data["uncertainty_by_inputs"]["young_modulus"] == s.systematic("young_modulus")
    assert 0.005 < data["uncertainty_by_inputs"]["young_modulus"] < 0.02


def test_a_drive_that_began_at_an_uncertain_time_costs_the_onset_as_much() -> None:
    config, drive = Config(), [shot(t) for t in (1.0, 2.0)]
    known = replace(config.uncertainty, start=0.01)
    measured = Measured(replace(config, uncertainty=known), drive, None)
    found = budget(measured, lambda now: {"onset_time": now.drive[1].conditions.time_s})
    place = found.inputs.index("start of the drive")
    assert found.shares[place][0] == pytest.approx(-0.005)  # 10 ms of 2 s
    assert "start of the drive" not in budget(replace(measured, config=config), simple).inputs


def shot(time_s: float) -> Snapshot:
    return Snapshot(0, 0, Conditions(Phase.DRIVE, time_s, 0.5, 0.1, 1e-6))


def measured_at() -> Measured:
    config = Config()
    sample = replace(config.sample, lens_compliance=1e-6, poisson=0.45)
    return Measured(replace(config, sample=sample), [], None)


def simple(measured: Measured) -> dict[str, float]:
    """A result that goes as compliance squared, and one as one over R."""
    sample = measured.config.sample
    return {
        "law_length": (sample.lens_compliance / 1e-6) ** 2,
        "hertz_radius": 1 / sample.lens_radius,
        "nothing": math.nan,
    }


def test_what_a_run_shows_of_one_sensor_costs_that_sensor() -> None:
    """Of a frame 10 s after the start, with 0.5 N and 0.1 N."""
    measured = measured_at()
    none = replace(measured.config.uncertainty, **dict.fromkeys(asdict(Config().uncertainty), 0.0))
    seen = Readings(zero=(1e-3, 2e-3), coupling=(3e-3, 4e-3), zero_drift=(5e-4, 6e-4))
    measured = replace(
        measured,
        config=replace(measured.config, uncertainty=none),
        drive=[shot(10.0)],
        seen=seen,
    )

    def read(now: Measured) -> dict[str, float]:
        (frame,) = now.drive
        return {"P": frame.conditions.normal_force_n, "Q": frame.conditions.shear_force_n}

    found = budget(measured, read)
    for name, of_p, of_q in (
        ("zero of P", 1e-3, 0.0),
        ("zero of Q", 0.0, 2e-3),
        ("drift of P", 5e-3, 0.0),
        ("drift of Q", 0.0, 6e-3),
        ("Q in P", 0.3e-3, 0.0),
        ("P in Q", 0.0, 2e-3),
    ):
        shares = found.shares[found.inputs.index(name)]
        assert shares == pytest.approx((-of_p / 0.5, -of_q / 0.1)), name


def test_a_result_that_a_step_takes_away_is_told_by_one_the_other_way() -> None:
    measured = measured_at()
    whole = budget(measured, simple)
    assert set(whole.results) == {"law_length", "hertz_radius"}
    for edge, most in ((1.05, 0.1), (0.97, 0.2)):  # a step of 10 % up, or down, leaves no result

        def at_an_edge(now: Measured, edge: float = edge) -> dict[str, float]:
            found, share = simple(now), now.config.sample.lens_compliance / 1e-6
            if (share > edge) if edge > 1 else (share != 1 and not share > 1.07):
                found["law_length"] = math.nan
            return found

        found = budget(measured, at_an_edge)
        assert found.inputs == whole.inputs
        assert found.results == whole.results
        assert found.notes == ()
        place = found.inputs.index("lens compliance"), found.results.index("law_length")
        right = whole.shares[place[0]][place[1]]
        assert found.shares[place[0]][place[1]] == pytest.approx(right, rel=most)


def test_a_result_that_grows_to_both_sides_of_an_input_has_no_slope() -> None:
    def bent(now: Measured) -> dict[str, float]:
        off = now.config.sample.lens_compliance / 1e-6 - 1
        return simple(now) | {"law_length": 1 + 0.02 * off + abs(off)}

    found = budget(measured_at(), bent)
    place = found.inputs.index("lens compliance"), found.results.index("law_length")
    assert found.shares[place[0]][place[1]] == pytest.approx(0.002, rel=1e-6)  # 10 % of 0.02


@pytest.mark.parametrize("how", ["nan", "raises"])
def test_a_result_that_an_input_takes_away_is_named(how: str) -> None:
    def without(now: Measured) -> dict[str, float]:
        found = simple(now)
        if now.config.sample.lens_compliance != 1e-6:
            if how == "raises":
                raise ValueError("no law")
            found["law_length"] = math.nan
        return found

    found = budget(measured_at(), without)
    assert ("hertz_radius" in found.results) == (how == "nan")
    assert "law_length" not in found.results
    (note,) = found.notes
    assert "uncertainty by inputs of law length" in note
    assert note.endswith("with another lens compliance")


@pytest.mark.slow
def test_what_has_no_budget_is_among_the_notes_of_the_results(monkeypatch) -> None:
    results_of = conclusions.results_of

    def without(measured: Measured, *most: int | None) -> dict[str, float]:
        found = results_of(measured, *most)
        if measured.config.sample.lens_radius != Config().sample.lens_radius:
            found["law_length"] = math.nan
        return found

    monkeypatch.setattr(conclusions, "results_of", without)
    s = concluded.__wrapped__("lens_radius")
    assert "law_length" not in s.budget_quantities
    assert "young_modulus" in s.budget_quantities
    assert any("uncertainty by inputs of law length is not known" in note for note in s.notes)


@pytest.mark.slow
def test_a_law_that_few_frames_do_not_tell_is_told_by_all(monkeypatch) -> None:
    """The budget takes some frames; where these have no law and all have one, it takes all."""
    whole = concluded("lens_compliance")
    monkeypatch.setattr(conclusions, "BUDGET_FRAMES", 3)
    s = concluded.__wrapped__("lens_compliance")
    assert s.law_length_m == whole.law_length_m
    assert s.budget_quantities == whole.budget_quantities
    assert s.systematic("law_length") == pytest.approx(whole.systematic("law_length"), rel=0.3)


def test_what_does_not_depend_on_an_input_is_prepared_once(monkeypatch) -> None:
    """A drift changes neither the rings' places nor their noise: for it no inversion is set up, and
    for no frame weights are computed again but where another ring stands out.
    """
    calls: Counter[str] = Counter()

    def count(module: Any, name: str) -> None:
        real = getattr(module, name)

        def counted(*given: Any) -> Any:
            calls[name] += 1
            return real(*given)

        monkeypatch.setattr(module, name, counted)

    count(axisymmetric, "Smoothing")
    count(law_fit, "radial_inversion")
    count(greenwood_tripp, "rough_contact")
    monkeypatch.setattr(conclusions, "BUDGET_FRAMES", 24)
    found = []
    for known in (("lens_compliance",), ("lens_compliance", "drift")):
        config, snapshots, contact = world_of(known)
        drive = [s for s in snapshots if s.conditions.phase is Phase.DRIVE]
        force = np.mean([s.conditions.normal_force_n for s in drive])
        hertz_m = hertz_radius_m(config, float(force))
        law_fit._inversion.cache_clear()
        calls.clear()
        measured = Measured(config, drive, contact)
        spent = conclusions._spent(measured, LocalLaw(), hertz_m)
        found.append((spent.inputs, calls.pop("Smoothing"), dict(calls)))
    (few, weights, once), (more, again, twice) = found
    assert set(more) - set(few) == {"drift"}
    assert again - weights < 5  # two sides of 24 frames
    assert twice == once
    assert list(once) == ["radial_inversion"]
    # to the bit as if each input had prepared all for itself
    alone = budget(measured, lambda now: results_of(now, conclusions.BUDGET_FRAMES))
    np.testing.assert_equal(spent._asdict(), alone._asdict())
