"""A camera that exposes row after row: what it shows of a block that moves, and the displacements
at one time that the analysis makes of it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import short_run
from whole_runs import done, recorded, replayed

from analysis.dic.rolling_shutter import RollingShutter
from app.evaluation.pipeline import Pipeline
from app.records.record_types import Conditions, Phase
from app.replay.browser import analysed_frame
from app.replay.replay import Replay
from app.session.reader import SessionReader
from app.settings import config
from app.settings.config import Config, ConfigError, settings_of
from app.study.instants import instants_of
from app.study.one import run_result
from drivers.settings import CameraSettings
from drivers.sim.images import Renderer
from drivers.sim.row_times import states_shown
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

VELOCITY = 20e-6
PERIOD, DRIVE, PIXEL, ROWS = 125, 1000, 17.6e-6, 480
DRIVEN = (8, 9, 13)
ROLLING = (
    *short_run.SMALL,
    "run.travel=40",
    "run.velocity=20",
    "sim.readout=40",
    "camera.readout=40",
    'sim.faults=["lost-trigger 20"]',
)


class Error(NamedTuple):
    """Of u_x in a frame: from the top to the bottom of the picture, and its mean; pixels."""

    shear: float
    mean: float


def errors(readout: float, corrected: float) -> dict[int, Error]:
    """Of frames of a drive seen by a camera of such a readout, corrected by another one."""
    camera = CameraSettings(width=640, height=ROWS, pixel=PIXEL)
    sim = SimSettings(press_time=0.1, force_noise=0.0, readout=readout)
    scenario = Scenario(sim=sim, camera=camera, press_samples=1)
    world = World(scenario, pace=None)
    world.start()
    world.advance(DRIVE)
    world.move(1e-3, VELOCITY)
    world.advance(1000)
    used = Config(camera=replace(camera, readout=corrected), sim=sim)
    renderer, pipeline, middle = Renderer(scenario), Pipeline(used), scenario.exposure_samples // 2
    x, y = np.meshgrid(pipeline.grid.x_px, pipeline.grid.y_px)
    phases = {0: Phase.BACKGROUND, 3: Phase.REFERENCE, 7: Phase.REFERENCE}
    found = {}
    for index in (*phases, *DRIVEN):
        begin, phase = index * PERIOD, phases.get(index, Phase.DRIVE)
        state, (first, *later) = world.state(begin), states_shown(world, begin)
        now = Conditions(phase, 1.0, state.normal_force_n, state.shear_force_n, 0.0)
        shot = pipeline.step(index, begin, renderer.image(first, index, *later), now)
        if phase is Phase.DRIVE:
            true, _ = world.truth(begin + middle).displacement_px(x, y, 3 * PERIOD + middle)
            off = shot.field.ux_px - true
            known = np.isfinite(off)
            slope, _ = np.polyfit(y[known], off[known], 1)
            found[index] = Error(float(slope) * ROWS, float(off[known].mean()))
    pipeline.close()
    return found


@pytest.fixture(scope="module")
def uncorrected() -> dict[int, Error]:
    return errors(0.03, 0.0)


def test_a_rolling_shutter_shears_the_field_of_a_drive(uncorrected: dict[int, Error]) -> None:
    for index in DRIVEN[1:]:
        assert 0.006 < uncorrected[index].shear < 0.02
        assert uncorrected[index].mean > 0.003


@pytest.mark.parametrize("readout", [0.03, -0.03])
def test_the_field_is_that_of_the_time_of_the_first_row(
    readout: float, uncorrected: dict[int, Error]
) -> None:
    found = errors(readout, readout)
    for index in DRIVEN[1:]:
        assert abs(found[index].shear) < 0.0015
        assert abs(found[index].mean) < 0.0012
    # the drive began after the frame before
    assert abs(found[DRIVEN[0]].shear) < 1.2 * uncorrected[DRIVEN[0]].shear


@pytest.mark.parametrize("exact", ["fast", "exact"])
@pytest.mark.parametrize("readout", [0.0317, -0.0317])
def test_each_row_shows_the_block_at_its_own_time(readout: float, exact: str) -> None:
    camera = CameraSettings(width=160, height=318, pixel=20e-6)  # ten rows in a sample
    sim = SimSettings(
        press_time=3600, readout=readout, renderer=exact, read_noise=0.0, full_well=0.0
    )
    scenario = Scenario(sim=sim, camera=camera, press_samples=1)
    world = World(scenario, pace=None)
    world.start()
    world.advance(20)
    world.move(1e-3, 400e-6)
    world.advance(100)
    renderer = Renderer(scenario)
    first, *later = states_shown(world, 30)
    assert (first.sample, later[-1].sample) == (35, 67)
    seen = renderer.image(first, 0, *later)
    for sample in (0, 4, 17, 31):
        row = 10 * sample if readout > 0 else 317 - 10 * sample
        at_once = renderer.image(world.state(35 + sample), 0)
        assert np.abs(seen[row].astype(int) - at_once[row]).max() <= 1
        other = renderer.image(world.state(35 + (sample + 16) % 32), 0)
        assert np.abs(seen[row].astype(int) - other[row]).max() > 8


def test_points_that_move_evenly_are_corrected_exactly() -> None:
    y = np.array([0.0, 40.0, 99.0])
    for readout in (0.05, -0.05):
        shutter = RollingShutter(y, 100, readout, (3, 2), start=2.0)

        def seen(at: float, readout: float = readout) -> np.ndarray:
            """Of points that start at 2.5 s with (3, 20) px/s."""
            late = 0.0 * y
            for _ in range(9):
                moved = 20.0 * np.maximum(at + late - 2.5, 0.0)
                late = readout * ((y + moved) / 99 - (readout < 0))
            return np.repeat(np.maximum(at + late - 2.5, 0.0)[:, None], 2, axis=1)

        noise = np.full((3, 2), 1e-7)
        at_rest = shutter.at_one_time(noise, noise, 2.0)  # the reference itself
        np.testing.assert_array_equal(at_rest, [noise, noise])
        shutter.at_one_time(3 * seen(2.6), 20 * seen(2.6), 2.6)
        some = 3 * seen(2.7)
        some[1, 0] = np.nan  # this one is interpolated over two frames next
        found, _ = shutter.at_one_time(some, 20 * seen(2.7), 2.7)
        assert np.isnan(found[1, 0])
        assert np.isfinite(found).sum() == 5
        ux, uy = shutter.at_one_time(3 * seen(2.8), 20 * seen(2.8), 2.8)
        np.testing.assert_allclose(ux, 3 * 0.3, atol=1e-12)
        np.testing.assert_allclose(uy, 20 * 0.3, atol=1e-12)


def test_a_readout_longer_than_the_period_is_refused() -> None:
    with pytest.raises(ConfigError, match="readout = -130 ms is longer than the trigger period"):
        config.load(None, ("camera.readout=-130",))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rolling") / "a.h5"
    recorded(path, *ROLLING)
    return path


@pytest.mark.slow
def test_a_replay_gives_the_same_bits_and_the_session_says_by_what_it_is_corrected(
    session: Path,
) -> None:
    with SessionReader(session) as reader:
        assert "readout = 40.0" in reader.header.config_toml
    assert replayed(session).verdict().agrees
    other = Replay(session, pace=None, overrides=("camera.readout=0",))
    done(other)
    assert not other.verdict().agrees


def test_a_frame_that_is_analysed_alone_is_corrected_alike(session: Path) -> None:
    with SessionReader(session) as reader:
        frames = reader.analysed_frames()
        number = next(f for f in frames if f * PERIOD > short_run.DRIVE + 600)
        recorded = reader.snapshot(frames.index(number)).field.ux_px
        alone = analysed_frame(reader, number).field.ux_px
    assert np.nanmean(np.abs(alone - recorded)) < 5e-4


def test_a_frame_that_is_asked_for_and_lies_before_another_one_is_corrected_once(
    session: Path,
) -> None:
    with SessionReader(session) as reader:
        used = settings_of(reader)
        frames = reader.analysed_frames()
        shots = [reader.snapshot(row) for row in range(len(frames))]
        free = [s for s in shots if s.conditions.phase is Phase.BACKGROUND][-1]
        reference = next(s for s in shots if s.conditions.phase is Phase.REFERENCE)
        first = next(i for i, s in enumerate(shots) if s.sample > short_run.DRIVE + 600)
        before = free, reference, *shots[first - 1 : first + 1]
        found = instants_of(used, reader, None, before, shots[first : first + 2], np.nan)
    pixel = used.camera.pixel
    for shot, ux in zip(shots[first:], found.ux_m, strict=False):
        expected = shot.field.ux_px - shot.motion.lens_m / pixel
        assert np.nanmean(np.abs(ux / pixel - expected)) < 5e-4


def test_the_fields_of_an_analysis_of_many_sessions_are_corrected(session: Path) -> None:
    found = run_result(session, ("recording.results=fields",), lambda _: None)
    instants, pixel = found.instants, found.pictures.pixel_m
    with SessionReader(session) as reader:
        frames = reader.analysed_frames()
        for number, ux in zip(instants.frame.tolist(), instants.ux_m, strict=True):
            shot = reader.snapshot(frames.index(number))
            expected = shot.field.ux_px - shot.motion.lens_m / pixel
            assert np.nanmean(np.abs(ux / pixel - expected)) < 5e-4
