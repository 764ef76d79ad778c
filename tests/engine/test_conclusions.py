"""What follows from the fields of a drive whose truth is known, without a picture: a tracker that
gives these fields stands in the place of the correlation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.dic.field import Field
from analysis.friction.local_law import LocalLaw
from analysis.mechanics import cattaneo_mindlin, greenwood_tripp, hertz
from app.evaluation import pipeline as module
from app.evaluation.budget import Measured
from app.evaluation.conclusions import conclude, onset_of, onset_on_the_way
from app.evaluation.law_fit import force_noise
from app.evaluation.pipeline import Pipeline
from app.evaluation.readings import readings
from app.evaluation.setup import forces_of, sensor_chain
from app.evaluation.tractions import mask_radius_m
from app.records.record_types import (
    ZERO,
    Conditions,
    Event,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
)
from app.settings.config import Config, load

P, MU, PIXEL = 0.3, 0.93, 5e-6
SETTINGS = (
    "camera.width=640",
    "camera.height=480",
    "camera.pixel=5",
    "stress.method=none",
    "dic.box=20",
    "dic.step=10",
)
Fields = Callable[[np.ndarray, np.ndarray], np.ndarray]


class FieldsTracker:
    """Gives u_x of a function of the places in the picture, pixels from its middle."""

    def __init__(self, pipeline: Pipeline) -> None:
        self.grid, self.ux = pipeline.grid, np.zeros(pipeline.grid.shape)

    def start_from(self, ux: np.ndarray, uy: np.ndarray) -> None:
        """Nothing is searched for."""

    def close(self) -> None:
        """Nothing is held."""

    def track(self, image: object, points: object = None, most_passes: int = 0) -> Field:
        nothing, ones = np.zeros(self.grid.shape), np.ones(self.grid.shape)
        status = np.zeros(self.grid.shape, np.uint8)
        return Field.of((self.ux, nothing), ones, (ones, ones), status, status)


def measured(
    monkeypatch: pytest.MonkeyPatch, config: Config, Q: float, *fields: np.ndarray | Fields
) -> list[Snapshot]:
    """The snapshots of frames under the shear force Q with these u_x, pixels, after a reference
    under none.
    """
    pipeline = Pipeline(config)
    tracker = FieldsTracker(pipeline)
    monkeypatch.setattr(module, "open_tracker", lambda *_, **__: tracker)
    image = np.zeros(config.camera.shape, np.uint8)
    pipeline.step(0, 0, image, Conditions(Phase.REFERENCE, math.nan, P, 0.0, 0.0))
    x, y = np.meshgrid(pipeline.grid.x_px, pipeline.grid.y_px)
    rows, columns = config.camera.shape
    x, y, found = x - (columns - 1) / 2, y - (rows - 1) / 2, []
    for n, field in enumerate(fields, 1):
        tracker.ux = field(x, y) if callable(field) else field
        now = Conditions(Phase.DRIVE, float(n), P, Q, 0.0)
        found.append(pipeline.step(n, n, image, now))
    pipeline.close()
    return found


def boxes(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Noise of unit variance of boxes that overlap by half along both axes."""
    fine = rng.standard_normal((shape[0] + 1, shape[1] + 1))
    return np.asarray((fine[1:, 1:] + fine[:-1, 1:] + fine[1:, :-1] + fine[:-1, :-1]) / 2)


def test_the_uncertainty_of_the_centre_is_the_scatter_of_boxes_that_overlap(monkeypatch):
    config = load(None, SETTINGS)
    shape, rng = Pipeline(config).grid.shape, np.random.default_rng(4)
    assert config.dic.noise_box_px == 2 * config.dic.step
    shots = measured(monkeypatch, config, 0.1, *(0.01 * boxes(rng, shape) for _ in range(120)))
    motions = [s.motion for s in shots]
    pulls = [(one.centre_ux_m + one.lens_m) / one.centre_ux_sd_m for one in motions]
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_rings_are_about_the_place_to_which_the_lens_has_moved(monkeypatch):
    """The block has slid by 30 px over a lens that has moved by 20 px: what is seen depends on the
    distance of each point of the material from where the lens is now.
    """
    config, Q, slid, lens = load(None, SETTINGS), 1.2, 30.0, 20.0
    sample = replace(config.sample, lens_compliance=lens * PIXEL / Q)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return lens + slid + 2.0 * np.exp(-((x + slid) ** 2 + y**2) / 90.0**2)

    (shot,) = measured(monkeypatch, replace(config, sample=sample), Q, field)
    r = shot.rings.radius_m / PIXEL
    expected = slid + 2.0 * np.exp(-(r**2) / 90.0**2)
    known = np.isfinite(shot.rings.ux_m)
    assert known.sum() > 10
    np.testing.assert_allclose(shot.rings.ux_m[known] / PIXEL, expected[known], atol=0.1)
    assert shot.motion.lens_m / PIXEL == pytest.approx(lens)
    assert shot.motion.centre_ux_m / PIXEL == pytest.approx(slid + 2.0, abs=0.25)


def test_the_traction_of_full_slip_is_mu_times_the_pressure_at_the_centre(monkeypatch):
    config = load(None, SETTINGS)
    s = config.sample
    a = hertz.contact_radius(P, s.young_modulus, s.poisson, s.lens_radius)
    config = replace(config, camera=replace(config.camera, pixel=a / 120))
    pixel, about = a / 120, (MU, P, a, s.young_modulus, s.poisson)
    Q = 0.6 * MU * P
    D = float(cattaneo_mindlin.shift(Q, *about))
    lens, rng = s.lens_compliance * Q, np.random.default_rng(8)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        moved = cattaneo_mindlin.displacement(x * pixel, y * pixel, Q, *about)[0]
        return np.asarray((D - moved + lens) / pixel + 0.005 * boxes(rng, x.shape))

    (shot,) = measured(monkeypatch, config, Q, field)
    assert shot.stick.full_slip_pa == pytest.approx(MU * hertz.peak_pressure(P, a), rel=0.02)
    assert shot.stick_radius == pytest.approx(a * 0.4 ** (1 / 3), rel=0.02)


def drive(time, u, sd, Q=0.28, travel=None):
    """Snapshots of frames with this u_x at the centre."""
    travel = np.arange(len(time)) * 1e-6 if travel is None else travel
    rows = zip(time, u, np.broadcast_to(Q, len(time)), travel, strict=True)
    return [
        Snapshot(n, n, Conditions(Phase.DRIVE, t, P, q, x), FrameMotion(0.0, one, sd, 0.0))
        for n, (t, one, q, x) in enumerate(rows)
    ]


def test_of_two_images_of_equal_noise_one_is_the_reference():
    """The uncertainty of t_s where the reference's noise is most of it."""
    time, ts, velocity, noise = (np.arange(160) + 0.5) / 8, 9.0, 4.85e-6, 2e-7
    rng, pulls = np.random.default_rng(5), []
    for _ in range(120):
        images = noise * (rng.normal(size=time.size) - rng.normal())
        u = velocity * np.maximum(time - ts, 0) + images
        force = 0.28 * np.minimum(time / ts, 1) + 1e-4 * rng.normal(size=time.size)
        shots = drive(time, u, math.sqrt(2) * noise, force)
        onset = onset_of(Measured(Config(), shots, None), LocalLaw(mu=MU, L=1e-9))
        pulls.append((onset.time - ts) / onset.time_sd)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_onset_on_the_way_is_in_the_time_of_the_drive_whichever_way_it_goes(way):
    time, began = (np.arange(200) + 0.5) / 8, 300.0
    u = 4.85e-6 * np.maximum(time - 9.0, 0)
    shots = drive(
        began + time, way * u + 3e-6, 1e-8, way * 0.28 * np.minimum(time / 9, 1), way * 1e-6 * time
    )
    assert onset_on_the_way(Config(), shots) == pytest.approx(began + 9.0, abs=0.02)


def test_the_calibration_of_a_ratio_is_that_of_both_forces():
    config = load(None, ["forces.stiffness_uncertainty=[8, 400]"])
    normal, shear = sensor_chain(config).relative_uncertainty()
    assert min(normal, shear) > 0.005
    assert conclude(config, [], None, []).summary.calibration_sd == pytest.approx(
        math.sqrt(normal**2 + shear**2)
    )


def test_the_noise_of_a_force_is_that_between_frames():
    noise = 3e-3 * np.random.default_rng(6).normal(size=2000)
    assert force_noise(np.linspace(0, 1, 2000) ** 2 + noise) == pytest.approx(3e-3, rel=0.1)


def test_a_zero_holds_from_where_the_sensors_were_given_it():
    config = Config()
    volts = np.tile([0.4, 0.7], (10, 1))
    before = forces_of(config, volts, [])
    found = forces_of(config, volts, [Event(6, ZERO, "", normal_v=0.4, shear_v=0.7)])
    np.testing.assert_array_equal(found[:6], before[:6])
    np.testing.assert_allclose(found[6:], 0.0, atol=1e-12)


def test_creep_at_rest_is_that_of_the_mean_over_the_contact_in_time():
    """u_x that grows with the radius and the time: its mean over a disc is two thirds of that at
    its edge, where rings count by their area.
    """
    config, creep = load(None, SETTINGS), 4e-8
    s, rate = config.sample, config.forces.sample_rate
    a = hertz.contact_radius(P, s.young_modulus, s.poisson, s.lens_radius)
    r = (np.arange(60) + 0.5) * a / 40
    shots = []
    for n in range(40):
        now = Conditions(Phase.REFERENCE, math.nan, P, 0.0, 0.0)
        rings = RingProfile(r, creep * 0.5 * n * r / a, np.full(60, 1e-10))
        shots.append(Snapshot(n, round(0.5 * n * rate), now, rings=rings))
    assert readings(config, shots, []).drift == pytest.approx(2 / 3 * creep, rel=0.02)


def test_beyond_the_mask_a_rough_contact_has_less_than_a_hundredth_of_its_pressure():
    config = load(None, (*SETTINGS, "camera.pixel=0.5"))
    s = config.sample
    material = s.young_modulus, s.poisson, s.lens_radius
    a = hertz.contact_radius(P, *material)
    rough = greenwood_tripp.rough_contact(P, *material, s.roughness)
    assert rough.pressure(mask_radius_m(config, a)) < 0.01 * rough.peak_pressure
