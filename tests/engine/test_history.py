"""A frame finds the forces of its exposure, the stage's travel and its phase, whatever else has
happened since.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from app.evaluation import history as module
from app.evaluation.frame_analysis import Analysis
from app.evaluation.history import KEPT_SECONDS, MOST_MEANS, History
from app.records.record_types import Phase, Snapshot
from app.settings.config import Config


def filled(seconds, rate=100, block=10, exposure=4):
    history = History(rate, exposure)
    history.begin(Phase.BACKGROUND, 0)
    for first in range(0, int(seconds * rate), block):
        n = np.arange(first, first + block, dtype=float)
        history.append(first, np.column_stack([n, -2 * n]), 1e-6 * (first + block), first + block)
    return history


def test_forces_are_means_over_the_exposure():
    now = filled(2).conditions(73)
    assert now.normal_force_n == 73 + 1.5
    assert now.shear_force_n == -2 * (73 + 1.5)


def test_travel_is_interpolated_to_the_middle_of_the_exposure_and_counted_from_the_first_reading():
    assert filled(2).conditions(73).travel_m == pytest.approx(1e-6 * (75 - 10), rel=1e-12)


def test_phase_and_time_count_from_the_drive():
    history = filled(3)
    history.begin(Phase.REFERENCE, 100)
    history.begin(Phase.DRIVE, 200)
    assert history.conditions(99).phase is Phase.BACKGROUND
    assert history.conditions(100).phase is Phase.REFERENCE
    assert math.isnan(history.conditions(199).time_s)
    assert history.conditions(200).time_s == pytest.approx(2 / 100)


@given(st.integers(0, 190), st.integers(0, 5))
def test_conditions_do_not_depend_on_what_came_later(sample, extra):
    early, late = filled(2), filled(2 + extra)
    assert repr(early.conditions(sample)) == repr(late.conditions(sample))


def test_a_sample_that_left_the_ring_is_an_error_not_another_number():
    with pytest.raises(RuntimeError, match="are kept"):
        filled(KEPT_SECONDS + 2).conditions(50)


def test_waiting_ends_when_the_samples_do():
    history = filled(1)
    history.finish()
    assert history.wait_for(100)
    assert not history.wait_for(101)


def test_block_means_cover_the_whole_run_in_about_n_points():
    samples, normal, shear = filled(100).block_means(50)
    assert 50 <= len(samples) <= 100
    np.testing.assert_allclose(shear, -2 * normal)
    assert samples[-1] > 9000


def test_a_long_run_takes_no_more_memory_than_a_short_one_and_says_the_same():
    long = filled(1500)
    assert len(long._means) <= MOST_MEANS < 15_000
    assert len(long._positions) <= 2 * KEPT_SECONDS * 10 + 2
    now = long.conditions(150_000 - 30)
    assert (now.normal_force_n, now.travel_m) == (
        150_000 - 30 + 1.5,
        pytest.approx(1e-6 * (150_000 - 28 - 10), rel=1e-12),
    )
    assert long.conditions(150_000 - 5990).travel_m == pytest.approx(
        1e-6 * (150_000 - 5988 - 10), rel=1e-12
    )
    samples, normal, shear = long.block_means(2000)
    assert (samples[0], len(samples)) == (5, pytest.approx(2500, abs=1500))
    assert set(np.diff(samples)) == {np.diff(samples)[0]}
    np.testing.assert_allclose(shear, -2 * normal)


def test_the_conditions_of_a_drive_the_other_way_are_those_along_it():
    history = History(1000.0, 10, -1.0)
    history.begin(Phase.DRIVE, 0)
    history.append(0, np.tile([0.5, -0.2], (100, 1)), 12.5e-3, 100)
    history.append(100, np.tile([0.5, -0.2], (100, 1)), 12.4e-3, 200)
    now = history.conditions(190)
    assert (now.normal_force_n, now.shear_force_n) == pytest.approx((0.5, 0.2))
    assert now.travel_m == pytest.approx(95e-6)


def test_the_last_seconds_are_given_in_order_and_can_be_shifted():
    history = filled(2)
    assert history.last(0.05)[:, 0].tolist() == [195, 196, 197, 198, 199]
    assert len(history.last(1e3)) == 200
    long = filled(KEPT_SECONDS + 1)
    assert len(long.last(1e3)) == KEPT_SECONDS * 100
    assert np.all(np.diff(long.last(1e3)[:, 0]) == 1)
    history.shift(np.array([-1.0, 10.0]))
    assert history.last(0.01).tolist() == [[198.0, -388.0]]


def test_who_waits_for_samples_that_do_not_come_waits_no_longer_than_asked():
    assert not filled(1).wait_for(101, 0.05)
    assert filled(1).wait_for(100, 0.05)


@pytest.mark.parametrize("told_after", [0, 1, 2])
def test_the_forces_of_a_drive_are_those_from_its_start_on_whenever_that_is_told(told_after):
    """A live run tells the start before its samples have come, a replay after its block."""
    history = History(100.0, 4, -1.0)
    history.begin(Phase.BACKGROUND, 0)
    for block, first in enumerate(range(0, 100, 10)):
        if block == 2 + told_after:
            history.begin(Phase.DRIVE, 23)
        n = np.arange(first, first + 10, dtype=float)
        history.append(first, np.column_stack([n, -2 * n]), 0.0, first + 10)
    time_s, shear, normal = history.drive_forces(91)
    np.testing.assert_array_equal(normal, np.arange(23, 91))
    np.testing.assert_array_equal(shear, 2 * normal)
    np.testing.assert_allclose(time_s, (normal - 23) / 100)
    assert [len(values) for values in history.drive_forces(20)] == [0, 0, 0]
    assert [len(values) for values in filled(1).drive_forces(50)] == [0, 0, 0]


def test_of_a_long_drive_the_beginning_is_kept(monkeypatch):
    monkeypatch.setattr(module, "MOST_DRIVEN", 503)  # within a block, whose end may differ
    history = History(100.0, 4)
    history.begin(Phase.DRIVE, 0)
    for first in range(0, 2000, 10):
        history.append(first, np.full((10, 2), float(first)), 0.0, first + 10)
    assert len(history.drive_forces(2000).time_s) == 503
    assert sum(map(len, history._driven)) == 510  # so that the memory of a run of days is bounded


class GivenForces(Exception):
    """What a summary was to be made from."""


def test_a_summary_rests_on_samples_that_a_replay_knows_too():
    """A replay reads the forces up to the last frame, a live run those that came later, too."""

    def summary(snapshots, forces):
        raise GivenForces(len(snapshots), len(forces.time_s))

    analysis = Analysis(Config(), SimpleNamespace(summary=summary))
    history, last = analysis.history, 400
    history.begin(Phase.DRIVE, 100)
    history.append(0, np.zeros((1000, 2)), 0.0, 1000)
    analysis.series.append(Snapshot(0, last, history.conditions(last)))
    with pytest.raises(GivenForces) as given_forces:
        analysis.summary()
    assert given_forces.value.args == (1, last + history.exposure_samples - 100)
