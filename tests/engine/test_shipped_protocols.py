"""The protocols that come with the program, against the truth of the simulated world, whose
constants are not those of the settings' defaults.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from whole_runs import ended

from app.records.summary import Summary
from app.report.summary_rows import slide_rows, summary_rows
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from drivers.sim.world import World

TINY = (
    "recording.results=forces",
    "camera.width=96",
    "camera.height=96",
    "dic.box=20",
    "limits.age=10",
)


def ran(path: Path, bench: str, *overrides: str) -> tuple[Summary, World]:
    settings = config.load(Path(bench), [*TINY, *overrides])
    run = live.make_run(settings, path, pace=None)
    world: World = run._bench.actuator._world  # type: ignore[attr-defined]
    outcome = ended(run)
    assert outcome.is_complete, outcome.reason
    assert outcome.summary is not None
    return outcome.summary, world


def test_slide_hold_slide_gives_the_ageing_of_the_world(tmp_path: Path) -> None:
    beta, t0, mu = 0.016, 0.4, 0.81
    summary, world = ran(
        tmp_path / "a.h5",
        "slide-hold-slide",
        f"sim.friction={mu}",
        f"sim.ageing={beta}",
        f"sim.ageing_time={t0}",
        "sim.ageing_slip=11",
        "camera.divisor=500",
    )
    truth = world.peaks()
    assert [round(hold) for hold, _ in truth] == [1, 3, 10, 30]
    assert summary.slide_step == (4, 6, 8, 10, 12)
    np.testing.assert_allclose(summary.slide_hold_s[1:], [hold for hold, _ in truth], atol=0.06)
    for (_, peak), found, sd in zip(
        truth, summary.slide_peak[1:], summary.slide_peak_sd[1:], strict=True
    ):
        assert 2e-4 < sd < 3e-3
        assert abs(found - peak) < 3.5 * sd
    np.testing.assert_allclose(summary.slide_mu_d, mu, rtol=4e-3)
    # the law's own words, not the fit's: mu beta per e-fold
    assert abs(summary.ageing_rate - mu * beta) < 3 * summary.ageing_rate_sd
    assert summary.ageing_rate_sd < 0.15 * mu * beta
    assert abs(summary.ageing_time_s - t0) < 3 * summary.ageing_time_sd_s
    rows = summary_rows(summary)
    assert any(row.symbol == "beta" for row in rows)
    assert len(slide_rows(summary)) == 7


@pytest.mark.slow
def test_cyclic_shear_gives_the_hysteresis_of_the_world(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    summary, world = ran(
        path, "cyclic-shear", "sim.friction=0.7", "sim.slip_length=1.4", "run.normal_force=0.2"
    )
    with SessionReader(path) as reader:
        turns = [e.sample for e in reader.events() if e.kind == "reversal"]
    assert len(turns) == 6
    assert len(summary.loop_work_j) == 3
    for number, work in enumerate(summary.loop_work_j):
        first, last = turns[2 * number], (*turns, world.now - 1)[2 * number + 2]
        samples = np.linspace(first, last - 1, 400, dtype=int).tolist()
        states: list[Any] = [world.state(sample) for sample in samples]
        x = np.array([state.stage_m for state in states])
        Q = np.array([state.shear_force_n for state in states])
        assert work == pytest.approx(np.sum((Q[1:] + Q[:-1]) / 2 * np.diff(x)), rel=0.02)
    assert max(summary.masing) < 0.01
    assert summary.slide_step == ()
    assert math.isnan(summary.ageing_rate)
