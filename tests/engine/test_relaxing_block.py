"""A run whose block relaxes: forces and slip are those of an elastic block once the settings
know it, and a run that does not know it says so.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from analysis.mechanics.relaxation import Relaxation
from analysis.settings import Sample
from app.evaluation.budget import Measured, _changes
from app.evaluation.conclusions import conclude
from app.evaluation.readings import Relaxes, readings, relaxation_of
from app.records.record_types import Conditions, FrameMotion, Phase, Snapshot, Traction
from app.records.snapshot_numbers import all_series, series_of
from app.settings.config import Config

SAMPLE = Sample(relaxation=0.1, relaxation_time=3.0)
KNOWN, BLIND = Config(sample=SAMPLE), Config()
P, PERIOD, SPEED = 0.1, 0.125, 5e-6


@cache
def drive() -> tuple[list[Snapshot], np.ndarray]:
    """Frames of a drive that ends in sliding, as an analysis takes them that thinks the block
    elastic; and u_x at the centre of an elastic block of the same traction.
    """
    faces = SAMPLE.young_modulus, SAMPLE.poisson, SAMPLE.lens_radius
    contact = SphereContact(P, *faces, mu=0.93, L=0.8e-6, relaxation=Relaxation(0.1, 3.0))
    loading = AxisymmetricLoading(contact, 24)
    state, frames, centre = loading.rest, [], []
    rng = np.random.default_rng(4)
    for frame in range(80):
        time = PERIOD * (frame + 1)
        for part in np.linspace(0, PERIOD, 6)[1:]:
            D = SPEED * (time - PERIOD + part)
            state = loading.advance(state, D, duration=PERIOD / 5)
        g = SAMPLE.relaxation
        surface = (1 - g) * state.sigma + g * state.lagged
        seen = float(loading._weight @ surface)
        now = Conditions(Phase.DRIVE, time, P, state.Q + rng.normal(0, 1e-5), state.D)
        motion = FrameMotion(0.0, state.D - float(state.displacement(0.0)[0]), 1e-9, 0.0)
        traction = Traction(1e-3, 1e-5, state.D, 1e-9, seen, 1e-5)
        frames.append(Snapshot(frame, round(1000 * time), now, motion=motion, traction=traction))
        elastic = replace(state, lagged=state.sigma)
        centre.append(state.D - float(elastic.displacement(0.0)[0]))
    return frames, np.array(centre)


def test_what_an_elastic_block_would_show_is_that_of_the_forces() -> None:
    frames, unmoved = drive()
    found = Measured(KNOWN, frames, None).without_relaxation().drive
    Q, was = all_series(frames, "shear_force_n", "stress_force_n")
    now, centre = all_series(found, "stress_force_n", "centre_ux_m")
    assert np.abs(was - Q).max() > 2e-3
    assert np.abs(now - Q).max() < 1e-4
    assert np.abs(centre - unmoved).max() < 2e-9
    assert Measured(BLIND, frames, None).without_relaxation().drive is frames


def test_a_frame_without_a_traction_does_not_tell_where_the_centre_would_be() -> None:
    frames, centre = drive()
    gap = [replace(s, traction=None) if s.frame == 30 else s for s in frames]
    found = Measured(KNOWN, gap, None).without_relaxation().drive
    assert math.isnan(found[30].motion.centre_ux_m)
    np.testing.assert_allclose(series_of(found[31:], "centre_ux_m"), centre[31:], atol=2e-9)


def test_what_an_input_does_to_the_picture_it_does_to_the_block_far_away_too() -> None:
    frames, centre = drive()
    for changed, expected in (
        ({"length": 1.01}, 1.01 * centre),
        ({"creep": 1e-8}, centre - 1e-8 * series_of(frames, "time_s")),
    ):
        found = Measured(KNOWN, frames, None).given(**changed).without_relaxation().drive
        np.testing.assert_allclose(series_of(found, "centre_ux_m"), expected, atol=2e-9)


def told_of(config: Config, frames: list[Snapshot]) -> list[str]:
    """What is said of Q over the shear that the pictures show."""
    notes = readings(config, frames, frames, frames).notes
    return [note for note in notes if "pictures show" in note]


def test_a_block_that_relaxes_is_told_unless_it_is_known() -> None:
    frames, _ = drive()
    (told,) = told_of(BLIND, frames)
    assert "changed by -" in told
    found = re.search(r"--set sample.relaxation=(\S+) --set sample.relaxation_time=(\S+), ", told)
    assert found is not None
    assert float(found[1]) == pytest.approx(SAMPLE.relaxation, rel=0.05)
    assert float(found[2]) == pytest.approx(SAMPLE.relaxation_time, rel=0.1)
    elastic = Measured(KNOWN, frames, None).without_relaxation().drive
    assert not told_of(KNOWN, elastic)


@pytest.mark.parametrize(("share", "time"), [(0.05, 3.0), (0.15, 3.0), (0.1, 0.5), (0.1, 20.0)])
def test_a_wrong_relaxation_is_told(share: float, time: float) -> None:
    frames, _ = drive()
    config = Config(sample=Sample(relaxation=share, relaxation_time=time))
    (told,) = told_of(config, Measured(config, frames, None).without_relaxation().drive)
    assert "replay with other values of sample.relaxation" in told


@pytest.mark.parametrize("found", [Relaxes(0.6, 0.01, 3.0, 1.0), Relaxes(0.2, 0.01, 2e4, 1.0)])
def test_no_block_that_cannot_be_is_proposed(
    found: Relaxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, _ = drive()
    monkeypatch.setattr("app.evaluation.readings.relaxation_of", lambda _: found)
    (told,) = told_of(BLIND, frames)
    assert "sample.relaxation=" not in told


@pytest.mark.parametrize("share", [0.1, 0.02, 0.0])
def test_a_share_is_found_where_there_is_one(share: float) -> None:
    """Of the same run, less of what its block has not yielded to, with noise of its tractions."""
    rng = np.random.default_rng(5)
    frames = []
    for s in drive()[0]:
        Q = s.conditions.shear_force_n
        seen = Q + share / SAMPLE.relaxation * (s.traction.stress_force_n - Q)
        noisy = replace(s.traction, stress_force_n=0.97 * seen + rng.normal(1e-4, 5e-5))
        frames.append(replace(s, traction=noisy))
    found = relaxation_of(frames)
    assert found.is_seen == (share > 0)
    if share:
        assert abs(found.share - share) < 4 * found.share_sd < 0.4 * share
    kept = [replace(s, traction=None) for s in frames[:60]] + frames[60:]
    assert not relaxation_of(kept).is_seen  # 20 frames of sliding


def test_what_lags_by_less_than_frames_tell_is_no_relaxation() -> None:
    frames, _ = drive()
    times, Q = all_series(frames, "time_s", "shear_force_n")
    seen = np.interp(times - 0.06, times, Q)
    late = [
        replace(s, traction=replace(s.traction, stress_force_n=float(one)))
        for s, one in zip(frames, seen, strict=True)
    ]
    assert np.abs(seen - Q).max() > 0.005 * Q.max()
    assert not relaxation_of(late).is_seen


def test_the_onset_is_that_of_the_relaxed_block_and_is_said_to_be() -> None:
    frames, centre = drive()
    known, blind = (conclude(config, frames, None, []) for config in (KNOWN, BLIND))
    line = np.polyfit(series_of(frames[-20:], "time_s"), centre[-20:], 1)
    assert known.summary.onset_time_s == pytest.approx(-line[1] / line[0], abs=0.02)
    assert abs(blind.summary.onset_time_s - known.summary.onset_time_s) > 0.05
    (told,) = (n for n in known.summary.notes if n.startswith("block:"))
    assert "10 % of its modulus at once is taken to relax with 3 s" in told
    assert not any(n.startswith("block:") for n in blind.summary.notes)
    for one, is_told in ((known, False), (blind, True)):
        assert any("pictures show" in n for n in one.summary.notes) == is_told
    bare = [replace(s, traction=None) for s in frames]
    (told,) = (n for n in conclude(KNOWN, bare, None, []).summary.notes if n.startswith("block:"))
    assert "t_s and mu_s are not corrected" in told


def test_share_and_time_are_inputs_of_the_budget() -> None:
    frames, _ = drive()
    names = [name for name, *_ in _changes(Measured(KNOWN, frames, None))]
    assert {"relaxation", "relaxation time"} <= set(names)
    assert "relaxation" not in [name for name, *_ in _changes(Measured(BLIND, frames, None))]
    changed = {
        name: make().config.sample for name, _, make in _changes(Measured(KNOWN, frames, None))
    }
    assert changed["relaxation"].relaxation == pytest.approx(0.11)
    assert changed["relaxation time"].relaxation_time == pytest.approx(3.3)
