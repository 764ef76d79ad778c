"""What follows from the fields of a drive whose truth is known, without a picture: a tracker that
gives these fields stands in the place of the correlation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import short_run

from analysis.contact.apparent import ApparentContact
from analysis.dic.field import Field
from analysis.friction.local_law import LocalLaw
from analysis.mechanics import cattaneo_mindlin, greenwood_tripp, hertz
from analysis.undistorted import ideal_displacement
from app.evaluation import pictures_at_rest, pipeline as module
from app.evaluation.budget import Budget, Measured, budget
from app.evaluation.conclusions import conclude, onset_of, onset_on_the_way
from app.evaluation.history import DriveForces
from app.evaluation.law_fit import force_noise
from app.evaluation.loops import local_results
from app.evaluation.pipeline import Pipeline
from app.evaluation.readings import Readings, readings
from app.evaluation.setup import forces_of, hertz_radius_m, sensor_chain
from app.evaluation.slides import slide_results
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
from app.records.snapshot_numbers import all_series, ring_displacements
from app.settings.config import Config, load

P, MU, PIXEL = 0.3, 0.93, 5e-6
BEFORE = 0.04  # shear force at the reference, N
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

    remarks = ()

    def __init__(self, pipeline: Pipeline) -> None:
        self.grid, self.ux = pipeline.grid, np.zeros(pipeline.grid.shape)

    def start_from(self, ux: np.ndarray, uy: np.ndarray) -> None:
        """Nothing is searched for."""

    def close(self) -> None:
        """Nothing is held."""

    def track(self, image: object, points: object = None, most_passes: int = 0) -> Field:
        nothing, ones = np.zeros(self.grid.shape), np.ones(self.grid.shape)
        status = np.zeros(self.grid.shape, np.uint8)
        return Field.of(self.grid, (self.ux, nothing), ones, (ones, ones), status, status)


def measured(
    monkeypatch: pytest.MonkeyPatch,
    config: Config,
    Q: float,
    *fields: np.ndarray | Fields,
    has_background: bool = False,
) -> list[Snapshot]:
    """The snapshots of frames under the shear force Q with these u_x, pixels, after a reference
    under a little of it.
    """
    pipeline = Pipeline(config)
    tracker = FieldsTracker(pipeline)
    monkeypatch.setattr(module, "open_tracker", lambda *_, **__: tracker)
    image = np.zeros(config.camera.shape, np.uint8)
    if has_background:
        pipeline.step(0, 0, image, Conditions(Phase.BACKGROUND, math.nan, 0.0, 0.0, 0.0))
    pipeline.step(0, 0, image, Conditions(Phase.REFERENCE, math.nan, P, BEFORE, 0.0))
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


@pytest.mark.parametrize("off", [(0.0, 0.0), (40.0, -30.0)])
def test_the_motion_of_the_centre_is_that_of_the_middle_of_the_bowl(monkeypatch, off):
    """The disc of the micro-contacts tells the centre to some pixels. In sliding u_x is a bowl
    about the true one: its value beside it, which counted, brought t_s forward.
    """
    config = load(None, SETTINGS)
    a = hertz_radius_m(config, P)
    rows, columns = config.camera.shape
    centre = (columns - 1) / 2 + off[0], (rows - 1) / 2 + off[1]
    found = ApparentContact(centre_px=centre, centre_sd_px=(40.0, 40.0), radius_px=a / PIXEL)
    monkeypatch.setattr(pictures_at_rest, "apparent_contact", lambda *_, **__: found)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 4.0 + 9.0 * (x**2 + y**2) / (a / PIXEL) ** 2

    seen = measured(monkeypatch, config, BEFORE, field, has_background=True)[0].motion.centre_ux_m
    box = 9.0 * config.dic.averaging_box_px**2 / 6 / (a / PIXEL) ** 2  # taken off
    assert seen / PIXEL + box == pytest.approx(4.0, abs=0.02)


def test_rings_are_about_the_place_to_which_the_lens_has_moved(monkeypatch):
    """The block has slid by 30 px over a lens that has moved by 20 px: what is seen depends on the
    distance of each point of the material from where the lens is now.
    """
    config, Q, slid, lens = load(None, SETTINGS), 1.2, 30.0, 20.0
    sample = replace(config.sample, lens_compliance=lens * PIXEL / (Q - BEFORE))

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
    s, a = config.sample, hertz_radius_m(config, P)
    config = replace(config, camera=replace(config.camera, pixel=a / 120))
    pixel, about = a / 120, (MU, P, a, s.young_modulus, s.poisson)
    Q = 0.6 * MU * P
    D = float(cattaneo_mindlin.shift(Q, *about))
    lens, rng = s.lens_compliance * (Q - BEFORE), np.random.default_rng(8)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        moved = cattaneo_mindlin.displacement(x * pixel, y * pixel, Q, *about)[0]
        return np.asarray((D - moved + lens) / pixel + 0.005 * boxes(rng, x.shape))

    (shot,) = measured(monkeypatch, config, Q, field)
    assert shot.stick.full_slip_pa == pytest.approx(MU * hertz.peak_pressure(P, a), rel=0.02)
    assert shot.stick_radius[0] == pytest.approx(a * 0.4 ** (1 / 3), rel=0.02)


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


def sampled(end: float = 20.0) -> DriveForces:
    """Forces of a drive in every sample: both rise steadily until Q bends at 9 s."""
    t, rng = np.arange(round(1000 * end)) / 1000, np.random.default_rng(4)
    Q, load_n = 0.28 * np.minimum(t / 9, 1), P + 1e-3 * t
    return DriveForces(t, Q + 1e-3 * rng.normal(size=t.size), load_n)


def driven(samples: DriveForces, *, end: float = 20.0) -> list[Snapshot]:
    """Frames of that drive, with its forces at their middles."""
    t, Q, load_n = (values[125 : round(1000 * end) : 250] for values in samples)
    shots = drive(t, 4.85e-6 * np.maximum(t - 9.0, 0), 1e-8, Q)
    return [
        replace(s, conditions=replace(s.conditions, normal_force_n=one))
        for s, one in zip(shots, load_n, strict=True)
    ]


@pytest.mark.parametrize(
    "given",
    [
        {"normal": 1.1},
        {"shear": 0.9},
        {"added": (2e-3, -3e-3)},
        {"coupled": (0.02, 0.05)},
        {"later": 0.3},
        {"normal": 1.1, "shear": 0.9, "added": (2e-3, -3e-3), "coupled": (0.02, 0.05)},
    ],
)
def test_what_is_changed_in_the_frames_is_changed_in_the_samples(given):
    samples = sampled()
    changed = Measured(Config(), driven(samples), None, forces=samples).given(**given)
    assert changed.forces is not None
    for shot in changed.drive:
        now = shot.conditions
        place = int(np.argmin(np.abs(changed.forces.time_s - now.time_s)))
        seen = [float(values[place]) for values in changed.forces]
        expected = [now.time_s, now.shear_force_n, now.normal_force_n]
        assert seen == pytest.approx(expected, abs=1e-12)


def test_samples_that_are_read_late_are_those_of_an_earlier_time():
    samples, law = sampled(), LocalLaw(mu=MU, L=0.8e-6)
    late = samples._replace(time_s=samples.time_s + 0.2)  # Q still rises at 9 s
    right, wrong = (
        onset_of(Measured(Config(), driven(samples), None, forces=forces), law)
        for forces in (samples, late)
    )
    assert right.static_force - wrong.static_force == pytest.approx(0.28 / 9 * 0.2, abs=1e-3)
    # t_s lies on a sample: not even a lens that moves by nanometres may decide on which side
    stiff = load(None, ["sample.lens_compliance=0"])
    frames = driven(samples)
    right, delayed = (
        onset_of(one, law)
        for one in (
            Measured(stiff, frames, None, forces=samples),
            Measured(stiff, frames, None, forces=late).delayed(0.2),
        )
    )
    assert delayed.static_force == pytest.approx(right.static_force, abs=1e-5)


def test_frames_are_given_the_forces_and_the_lens_of_what_is_read_late():
    """The mean over the samples about each frame, at that later time."""
    samples, config = sampled(), Config()
    late = samples._replace(time_s=samples.time_s + 0.2)
    delayed = Measured(config, driven(late), None, forces=late).delayed(0.2).drive
    time, Q, load_n, lens = all_series(
        delayed, "time_s", "shear_force_n", "normal_force_n", "lens_m"
    )
    inside = (time > 1) & (time < 8.5)
    error = Q[inside] - 0.28 / 9 * time[inside]
    assert np.std(error) == pytest.approx(1e-3 / math.sqrt(20), rel=0.35)  # 1 mN in a sample
    assert abs(error.mean()) < 1e-4
    np.testing.assert_allclose(load_n[inside], P + 1e-3 * time[inside], atol=1e-6)
    assert lens[inside].mean() == pytest.approx(
        config.sample.lens_compliance * 0.28 / 9 * 0.2, rel=0.02
    )
    without = Measured(config, driven(samples), None).delayed(0.0)
    assert without.drive == driven(samples)  # nothing else is known of these forces


def test_samples_after_the_first_loading_do_not_count():
    samples, law = sampled(), LocalLaw(mu=MU, L=0.8e-6)
    frames, cut = driven(samples, end=15.0), [values[:14_875] for values in samples]
    # the last frame, at 14.875 s, is taken a little after the turn
    back = samples._replace(shear_n=np.where(samples.time_s > 14.8, -0.28, samples.shear_n))
    first, other = (
        onset_of(Measured(Config(), frames, None, forces=forces), law)
        for forces in (DriveForces(*cut), back)
    )
    assert "samples of the" in first.notes[0]
    assert first == other


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


@pytest.mark.parametrize("creep", [4e-8, -4e-8])
def test_creep_at_rest_is_that_of_the_mean_over_the_contact_in_time(creep):
    """u_x that grows with the radius and the time: its mean over a disc is two thirds of that at
    its edge, where rings count by their area.
    """
    config = load(None, SETTINGS)
    a, rate = hertz_radius_m(config, P), config.forces.sample_rate
    r = (np.arange(60) + 0.5) * a / 40
    shots = []
    for n in range(40):
        now = Conditions(Phase.REFERENCE, math.nan, P, 0.0, 0.0)
        rings = RingProfile(r, creep * 0.5 * n * r / a, np.full(60, 1e-10))
        shots.append(Snapshot(n, round(0.5 * n * rate), now, rings=rings))
    assert readings(config, shots, []).drift == pytest.approx(2 / 3 * abs(creep), rel=0.02)


def test_beyond_the_mask_a_rough_contact_has_less_than_a_hundredth_of_its_pressure():
    config = load(None, (*SETTINGS, "camera.pixel=0.5"))
    s, mask_m = config.sample, mask_radius_m(config, hertz_radius_m(config, P))
    rough = greenwood_tripp.rough_contact(P, *s.bodies, s.roughness)
    assert rough.pressure(mask_m) < 0.01 * rough.peak_pressure


def test_inputs_add_up_as_the_root_of_their_squares():
    spent = Budget(("a", "b", "c"), ("E", "L"), ((0.03, 0.5), (-0.04, 0.0), (0.0, -1.2)))
    assert spent.relative_sd("E") == pytest.approx(0.05)
    assert spent.relative_sd("L") == pytest.approx(1.3)


def test_a_zero_that_was_seen_costs_what_it_is():
    """P and Q each with a zero of which the settings know a part."""
    config = load(None, ["uncertainty.zero=3"])
    seen = Readings(zero=(4e-3, 0.0))
    world = Measured(config, drive([1.0], [0.0], 1e-8, 0.2), None, seen=seen)

    def means(now: Measured) -> dict[str, float]:
        one = now.drive[0].conditions
        return {"P": one.normal_force_n, "Q": one.shear_force_n}

    told = budget(world, means)
    rows = dict(zip(told.inputs, told.shares, strict=True))
    assert np.abs(rows["zero of P"]) == pytest.approx([5e-3 / P, 0.0])
    assert np.abs(rows["zero of Q"]) == pytest.approx([0.0, 3e-3 / 0.2])
    normal, shear = sensor_chain(config).relative_uncertainty()
    own = config.uncertainty.sensitivity
    assert rows["normal force"] == pytest.approx([math.hypot(normal, own), 0.0])
    assert rows["shear force"] == pytest.approx([0.0, math.hypot(shear, own)])


def test_another_distortion_moves_a_ring_as_the_lens_does():
    """The mean over a ring of what an ideal lens would show of a block that moves as a whole."""
    config, k, u = load(None, SETTINGS), 0.02, 4.0
    rows, columns = config.camera.shape
    r_px, theta = np.array([20.0, 150.0, 220.0]), np.linspace(0, 2 * np.pi, 64, endpoint=False)
    x = (columns - 1) / 2 + r_px[:, None] * np.cos(theta) - u / 2
    y = (rows - 1) / 2 + r_px[:, None] * np.sin(theta)
    moved = ideal_displacement(x, y, np.full(x.shape, u), np.zeros(x.shape), k, (rows, columns))
    shot = drive([1.0], [0.0], 1e-8)[0]
    rings = RingProfile(r_px * PIXEL, np.full(3, u * PIXEL), np.full(3, 1e-8))
    changed = Measured(config, [replace(shot, rings=rings)], None).given(distortion=k).drive[0]
    expected = moved[0].mean(axis=1) * PIXEL
    np.testing.assert_allclose(changed.rings.ux_m, expected, rtol=5e-4)


def test_the_work_of_a_cycle_is_the_area_of_its_whole_loop():
    there, back = np.linspace(0, 60e-6, 31), np.linspace(60e-6, 0, 31)[1:]
    travel = np.concatenate([there, back, there[1:], back, there[1:]])
    way = np.sign(np.diff(travel, prepend=-1.0))
    shots = drive(np.arange(len(travel)) * 0.1, 0 * travel, 1e-8, 0.25 * way, travel)
    works = local_results(Measured(Config(), shots, None), LocalLaw(), math.nan, math.nan)
    assert len(works["loop_work_j"]) == 2
    # the force turns between two frames, not at the end of the stroke
    assert works["loop_work_j"] == pytest.approx([2 * 0.25 * 58e-6] * 2, rel=0.02)


@pytest.mark.parametrize("way", [1, -1])
def test_a_rise_is_over_the_friction_before_the_hold(way):
    steps = '{do="background"}, {do="approach"}, {do="reference"}'
    steps += ', {do="drive", travel=50}, {do="hold", time=20}, {do="drive", travel=50}'
    config, shots = load(None, [f"run.steps=[{steps}]"]), []
    for step, began, friction in ((4, 0.0, 0.8), (6, 30.0, 0.6)):
        ratio = friction + (0.1 * np.exp(-np.arange(60) / 6) if step == 6 else np.zeros(60))
        for n, one in enumerate(ratio):
            t = 0.125 * (n + 0.5)
            travel = way * 5e-6 * (began + t)
            now = Conditions(Phase.DRIVE, began + t, P, way * one * P, travel, step, t)
            shots.append(Snapshot(len(shots), 0, now))
    now = Conditions(Phase.DRIVE, 10.1, P, way * 0.8 * P, way * 50e-6, 5, 0.1)
    held = Snapshot(999, 0, now)
    found = slide_results(Measured(config, [*shots, held], None), [], 0.0)
    assert found["slide_step"] == (4, 6)
    assert found["slide_mu_d"] == pytest.approx((0.8, 0.6), abs=1e-3)
    assert found["slide_rise"][1] == pytest.approx(found["slide_peak"][1] - 0.8)
    assert found["slide_hold_s"][1] == pytest.approx(20.0)


@pytest.mark.parametrize(("angle", "is_said"), [(math.pi, False), (math.pi / 3, True)])
def test_frames_of_the_way_back_are_no_picture_that_shakes(angle, is_said):
    shots = drive(np.arange(90.0), np.zeros(90), 1e-8)
    for n in range(0, 90, 3):
        shots[n] = replace(shots[n], motion=FrameMotion(0.0, 0.0, 1e-8, angle))
    with short_run.without_budget():
        notes = conclude(Config(), shots, None, []).summary.notes
    assert any("do without 30 of 90 frames" in note for note in notes) == is_said
    # nor are they left out in silence
    assert any("leave out 30 of 90 frames" in note for note in notes) != is_said


def test_beyond_the_rings_there_is_no_displacement():
    r = np.array([1e-4, 2e-4, 3e-4])
    rings = RingProfile(r, np.array([1e-6, 2e-6, np.nan]), np.full(3, 1e-9))
    (shot,) = drive([1.0], [0.0], 1e-8)
    found = ring_displacements(replace(shot, rings=rings), np.array([0.0, 1.5e-4, 2.5e-4, 1.0]))
    np.testing.assert_allclose(found, [1e-6, 1.5e-6, np.nan, np.nan])


def test_a_zero_is_seen_by_the_mean_of_many_frames():
    """It is less than the noise of one frame, and six times that of the mean."""
    config, rng, shots = load(None, ["uncertainty.zero=0.1"]), np.random.default_rng(7), []
    for n in range(200):
        phase = Phase.BACKGROUND if n < 100 else Phase.REFERENCE
        load_n, shear = (0.6e-3, 0.0) if n < 100 else (P, 0.0)
        noise = 1e-3 * rng.normal(size=2)
        now = Conditions(phase, math.nan, load_n + noise[0], shear + noise[1], 0.0)
        shots.append(Snapshot(n, n, now))
    found = readings(config, shots, [])
    assert found.zero[0] == pytest.approx(0.6e-3, abs=0.4e-3)
    assert found.zero[1] == 0
