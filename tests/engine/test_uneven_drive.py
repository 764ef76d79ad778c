"""The onset of sliding of a drive that does not go at constant velocity, which no encoder shows."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from loads import WELL_SEEN
from short_run import without_budget
from whole_runs import done

from analysis.friction.uneven_drive import even_time
from app.records.summary import Summary
from app.runs import live
from app.settings import config
from benchmarks.loading_experiment import Recorded, true_values
from slipscope import Session

SPEED, SLID = 5e-6, 60e-6


def driven(folder: Path, *settings: str) -> tuple[Summary, dict[str, float]]:
    """What a run comes down to, and what is true of its world."""
    chosen, path = config.load(None, [*WELL_SEEN, *settings]), folder / "run.h5"
    bench = live.make_bench(chosen, None)
    with without_budget():
        done(live.make_run(chosen, path, pace=None, bench=bench))
    with Session(path) as session:
        assert session.summary is not None
        return session.summary, true_values(Recorded(session, bench.world))


@pytest.mark.slow
@pytest.mark.parametrize(("turn", "least"), [(50, 10.0), (120, -math.inf)])
def test_the_onset_of_a_drive_by_a_screw_with_an_error_is_that_of_the_world(
    tmp_path: Path, turn: int, least: float
) -> None:
    """0.2 um over its turn: by the time t_s was late by more than ten stated uncertainties, or
    early by three.
    """
    summary, true = driven(tmp_path, "sim.screw_error=0.2", f"sim.screw_pitch={turn}")
    error = summary.onset_time_s - true["onset_time_s"]
    assert abs(error) < 2.5 * summary.onset_time_sd_s < 0.02
    assert abs(summary.mu_s - true["mu_s"]) < 2.5 * summary.mu_s_sd
    (told,) = (note for note in summary.notes if "the drive is uneven" in note)
    by_time = float(told.split("would be ")[1].split()[0]) * 1e-3
    assert least * summary.onset_time_sd_s < by_time
    assert abs(by_time) > 3 * summary.onset_time_sd_s
    assert summary.sliding_velocity_m_s == pytest.approx(4.9e-6, rel=0.02)


def test_an_onset_is_as_uncertain_as_those_by_the_time_and_by_the_way_differ(
    tmp_path: Path,
) -> None:
    """Of a longer turn both agree within their uncertainties, and t_s by the time was early by
    four of those that it stated.
    """
    summary, true = driven(tmp_path, "sim.screw_error=0.2", "sim.screw_pitch=150")
    error = summary.onset_time_s - true["onset_time_s"]
    assert abs(error) < 2 * summary.onset_time_sd_s < 0.06
    assert summary.onset_time_sd_s > 0.01


def test_forces_that_are_read_late_make_no_drive_uneven(tmp_path: Path) -> None:
    """The cantilever is bent by what Q is now: by a low-pass of 0.2 s t_s was late by six stated
    uncertainties.
    """
    summary, true = driven(tmp_path, "sim.sensor_filter=200")
    assert "the drive is uneven" not in "".join(summary.notes)
    assert abs(summary.onset_time_s - true["onset_time_s"]) < 2.5 * summary.onset_time_sd_s < 0.02


@pytest.mark.parametrize("frames", [60, 400, 9000])
@pytest.mark.parametrize("lost", [0, 7])
def test_the_even_time_is_that_at_which_an_even_drive_would_be_there(
    frames: int, lost: int
) -> None:
    rng, t = np.random.default_rng(frames), np.linspace(0.01, SLID / SPEED, frames)
    lag = 0.4e-6 * np.sin(2 * math.pi * SPEED * t / 40e-6 + 1)
    way = SPEED * t + lag + 30e-9 * rng.normal(size=frames)
    way[rng.permutation(frames)[:lost]] = np.nan
    found = even_time(t, way)
    assert found is not None
    even, sd = found
    off = even - t - lag / SPEED
    off -= np.polyval(np.polyfit(t, off, 1), t)  # the mean velocity is that of the drive
    assert 0.2 < np.std(off) / sd < 2.0
    assert sd < 6e-3 / math.sqrt(frames / 60)
    assert np.isfinite(even).all()


def test_a_drive_that_is_even_as_far_as_it_shows_is_one() -> None:
    rng, t, uneven = np.random.default_rng(1), np.linspace(0.1, 12, 100), 0
    for _ in range(200):
        uneven += even_time(t, SPEED * t + 30e-9 * rng.normal(size=100)) is not None
    assert uneven <= 6  # 2 to 4 with the seeds 1 to 5
    assert even_time(t[:9], t[:9] ** 2) is None
    assert even_time(t, np.full(100, np.nan)) is None
    assert even_time([], []) is None


@pytest.mark.parametrize(("which", "most"), [(-1, 20), (-2, 4), (40, 4)])
def test_one_frame_out_of_line_is_no_uneven_drive(which: int, most: int) -> None:
    """A shaken picture; by Schwarz's criterion alone a polynomial bent to one at the end."""
    rng, t, uneven = np.random.default_rng(1), np.linspace(0.1, 12, 100), 0
    for off in 0.5e-6 * rng.normal(size=100):
        way = SPEED * t + 15e-9 * rng.normal(size=100)
        way[which] += off
        uneven += even_time(t, way) is not None
    assert uneven <= most  # with the seeds 1 to 5: 9 to 13, 0 to 1, 0 to 1
