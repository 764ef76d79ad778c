"""Zeros, cross-talk and drift that the settings do not know: each is in the uncertainty of what it
changes, and told where the run shows it.
"""

from __future__ import annotations

import math
import re
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from loads import WELL_SEEN
from short_run import without_budget
from whole_runs import recorded

from analysis.settings import Uncertainties
from app.evaluation.budget import Measured
from app.evaluation.conclusions import conclude
from app.evaluation.history import DriveForces
from app.evaluation.readings import _pictures_behind_forces, creep_in_sliding, readings
from app.records.record_types import (
    Conditions,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
    Traction,
)
from app.records.summary import Summary
from app.settings.config import Config

ERRORS = (
    'sim.errors=["forces.zero_normal -0.003", "forces.zero_shear 0.005",'
    ' "forces.shear_from_normal -0.02", "forces.normal_from_shear 0.02"]'
)
MU = 0.93


@cache
def concluded(*settings: str) -> Summary:
    """What a run comes down to whose settings know nothing of the world's faults."""
    with tempfile.TemporaryDirectory() as folder:
        summary = recorded(Path(folder) / "run.h5", *WELL_SEEN, *settings).summary
    assert summary is not None
    return summary


def notes_of(summary: Summary) -> str:
    return "\n".join(n for n in summary.notes if n.startswith(("forces:", "drift:")))


def size(value: float, truth: float, sd: float, share: float) -> float:
    """Of an error, in stated standard uncertainties of both kinds."""
    return abs(value - truth) / math.hypot(sd, share * value)


@pytest.mark.slow
def test_a_bench_without_faults_is_told_none() -> None:
    s = concluded()
    assert notes_of(s) == ""
    assert s.systematic("law_mu") < 0.02


@pytest.mark.slow
def test_what_the_settings_do_not_know_is_told_and_is_in_the_uncertainty() -> None:
    """Zeros, cross terms, and a camera that creeps along the drive, all at once."""
    still, s = concluded(), concluded(ERRORS, "sim.image_drift=[0.003, 0]")
    told = notes_of(s)
    for what in (
        "before contact, without a force, P reads -2.99",
        "before contact, without a force, Q reads 4.97",
        "as the contact was pressed, Q came to read -2.06",
        "as the contact was sheared, P changed by ",
        "at rest under load the contact creeps by 0.03",
    ):
        assert what in told, told
    (share,) = re.findall(r"P changed by (\S+) \+- (\S+) %", told)
    assert abs(float(share[0]) - 2.0) < 3 * float(share[1])
    assert abs(s.law_mu / MU - 1) > 0.03
    assert size(s.law_mu, MU, s.law_mu_sd, s.systematic("law_mu")) < 1.5
    assert s.systematic("law_mu") < 2 * abs(s.law_mu / MU - 1)
    assert abs(s.law_length_m / still.law_length_m - 1) > 0.05
    both = s.law_length_sd_m, s.systematic("law_length")
    assert size(s.law_length_m, still.law_length_m, *both) < 1.5, both
    assert abs(s.onset_time_s - still.onset_time_s) < 1.5 * s.systematic("onset_time") * 5.5


@pytest.mark.slow
def test_hum_that_all_frames_see_in_one_phase_changes_neither_friction_nor_modulus() -> None:
    """Three periods of 50 Hz from frame to frame; the forces of the frames are those of samples. By
    those of the exposures P was 0.109 N, and E 0.33 % too small. The law's friction is that of all
    samples, as mu_d: that of the frames is half as uncertain again.
    """
    s = concluded("sim.hum=10", "camera.divisor=60")
    assert abs(s.law_mu - MU) < 1e-3
    assert s.law_mu_sd < 1e-3
    assert s.law_mu_sd == pytest.approx(s.mu_d_sd, rel=0.2)
    assert abs(s.normal_force_n - 0.1) < 0.3e-3
    assert abs(s.young_modulus_pa / Config().sample.young_modulus - 1) < 0.002


ONE_WAY = ("run.velocity=30", "camera.divisor=42", "camera.max_rate=24", "run.travel=60")
FAST = (
    *ONE_WAY,
    *("camera.width=480", "camera.height=360", "camera.pixel=16"),
    'run.steps=[{do="background"}, {do="approach"}, {do="reference"}, {do="drive", travel=60},'
    ' {do="reverse"}]',
)
LOADED = (*ONE_WAY, "run.travel=120", "run.normal_force=0.3", "sim.force_noise=0.1")
LATE = ("sim.sensor_delay=45", "sim.sensor_filter=45")


@pytest.mark.slow
def test_sensors_that_read_late_are_told_and_in_the_uncertainty() -> None:
    at_once, late = concluded(*FAST), concluded(*FAST, *LATE)
    assert "after the shear" not in notes_of(at_once)
    found = re.search(
        r"Q is read ([0-9.]+) \+- ([0-9.]+) ms after .* --set forces.delay=([0-9.]+)",
        notes_of(late),
    )
    assert found is not None
    delay_ms, sd_ms, asked_ms = map(float, found.groups())
    assert abs(delay_ms - 90) < 3 * sd_ms < 50
    assert abs(asked_ms - delay_ms) < 1
    was, is_late = at_once.young_modulus_pa, late.young_modulus_pa
    share = late.shares("young_modulus")["delay of the forces"]
    assert is_late > 1.01 * was
    assert 0.5 * (is_late / was - 1) < abs(share) < 2 * (is_late / was - 1)
    assert "delay of the forces" not in at_once.budget_inputs


@pytest.mark.slow
def test_a_delay_of_the_settings_is_taken_off() -> None:
    at_once = concluded(*FAST)
    with without_budget():
        right = concluded(*FAST, *LATE, "forces.delay=90")
    assert "after the shear" not in notes_of(right)
    late = concluded(*FAST, *LATE)
    for name in ("young_modulus_pa", "static_force_n"):
        was, off, now = (getattr(s, name) for s in (at_once, late, right))
        assert abs(now - was) < 0.35 * abs(off - was)
    assert abs(right.onset_time_s - at_once.onset_time_s) < 2 * at_once.onset_time_sd_s


@pytest.mark.long
def test_the_length_of_the_law_follows_from_the_lens_at_the_time_of_the_picture() -> None:
    was, off, now = (
        concluded(*LOADED, *more).law_length_m for more in ((), LATE, (*LATE, "forces.delay=90"))
    )
    assert off > 1.01 * was
    assert abs(now - was) < 0.35 * abs(off - was)


def sheared(
    delay: float, lens: float, creep: float = 0.0, load: float = 0.0, slip: float = 0.0
) -> list[Snapshot]:
    """A drive forth and back at 25 um/s whose forces are read late, and whose tractions are off by
    a share (N/m) of the block's displacement, with noise. A block that creeps shows that much more
    traction in the end, and a load that relaxes falls by so many newtons. A traction whose shape is
    wrong shows a share more while the contact slips in part.
    """
    rng, frames = np.random.default_rng(3), []

    def at(time: float) -> tuple[float, float]:
        # a block that is held back by a contact that yields by tanh
        D = 25e-6 * (min(max(time, 0.0), 4.0) - min(max(time - 4.0, 0.0), 4.0))
        back = 0.9 * math.tanh((100e-6 - D) / 30e-6) if time > 4.0 else 0.0
        return D, 0.45 * (math.tanh(min(25e-6 * max(time, 0.0), 100e-6) / 15e-6) - back)

    for frame, time in enumerate(np.arange(0.05, 8.0, 0.05).tolist()):
        (D, Q), (_, read) = at(time), at(time - delay)
        P = 0.5 + rng.normal(0, 3e-4) - load * (1 - math.exp(-time / 3.0))
        now = Conditions(Phase.DRIVE, time, P, 1.03 * read + rng.normal(0, 3e-4), D)
        shown = 1 + creep * (1 - math.exp(-time / 2.0)) + slip * math.exp(-D / 15e-6)
        seen = Q * shown + lens * D + rng.normal(0, 3e-4)
        frames.append(
            Snapshot(frame, 50 * frame, now, traction=Traction(1e-3, 1e-5, D, 1e-9, seen, 3e-4))
        )
    return frames


def one_way(delay: float = 0.0, lens: float = 0.0, **more: float) -> list[Snapshot]:
    """The first half of that drive."""
    return [s for s in sheared(delay, lens, **more) if s.conditions.time_s < 4.0]


def test_a_drive_one_way_tells_no_delay() -> None:
    """A traction that is wrong while the contact slips looks like one."""
    for delay, slip in ((0.0, 0.05), (0.04, 0.0)):
        half = one_way(delay, slip=slip)
        seen = readings(Config(), half, half, half)
        assert seen.delay == 0.0
        assert not any("Q is read" in note for note in seen.notes)
    assert _pictures_behind_forces(half)[0][0] == pytest.approx(0.04, abs=0.01)


@pytest.mark.parametrize("lens", [0.0, 100.0])
@pytest.mark.parametrize("delay", [0.0, 0.04])
def test_a_delay_is_told_from_a_lens_that_distorts(delay: float, lens: float) -> None:
    frames = sheared(delay, lens)
    seen = readings(Config(), frames, frames, frames)
    assert seen.delay == pytest.approx(delay, abs=3e-3)
    assert any("Q is read" in note for note in seen.notes) == (delay > 0)
    known = Config(uncertainty=Uncertainties(delay=0.06))
    assert readings(known, frames, frames, frames).delay == 0.0


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_a_delay_does_not_depend_on_the_modulus_of_the_settings(factor: float) -> None:
    frames = []
    for s in sheared(0.04, 0.0):
        assert s.traction is not None
        seen = replace(s.traction, stress_force_n=factor * s.traction.stress_force_n)
        frames.append(replace(s, traction=seen))
    delay, sd = _pictures_behind_forces(frames)[0]
    assert delay == pytest.approx(0.04, abs=3e-3)
    assert sd == pytest.approx(_pictures_behind_forces(sheared(0.04, 0.0))[0][1], rel=0.01)
    against = [
        replace(s, conditions=replace(s.conditions, shear_force_n=-s.conditions.shear_force_n))
        for s in frames
    ]
    assert math.isnan(_pictures_behind_forces(against)[0][0])  # the traction does not follow Q


@pytest.mark.parametrize("turns_back", [False, True])
def test_a_modulus_that_depends_on_time_is_told(turns_back: bool) -> None:
    frames, half = sheared(0.0, 0.0, creep=0.06), one_way(creep=0.06)
    (told,) = readings(Config(), half, half, frames if turns_back else half).notes
    found = re.search(
        r"pictures show changed by (-[0-9.]+) \+- ([0-9.]+) %: the lens .* the modulus", told
    )
    assert found is not None
    change, sd = map(float, found.groups())
    assert -6 < change < -2
    assert sd < 0.5
    still = sheared(0.0, 0.0)
    assert readings(Config(), still, still, still).notes == ()


def test_a_load_that_relaxes_is_told() -> None:
    half = one_way(load=0.01)
    (told,) = (n for n in readings(Config(), half, half, half).notes if "loading P" in n)
    found = re.search(r"loading P changed by (-[0-9.]+) \+- ([0-9.]+) mN", told)
    assert found is not None
    change, sd = map(float, found.groups())
    assert abs(change + 7) < 1.5
    assert sd < 0.5
    known = Config(uncertainty=Uncertainties(zero=0.02))
    assert "loading P" not in str(readings(known, half, half, half).notes)


def at_both_ends(P: float, Q: float) -> list[Snapshot]:
    """Frames before contact, under load, also while the run ends, and 90 s after the first of them,
    apart again, where the sensors read so many newtons more.
    """
    rng, frames = np.random.default_rng(4), []
    for first, phase, force in (
        (0, Phase.BACKGROUND, (0.0, 0.0)),
        (30, Phase.REFERENCE, (0.5, 0.0)),
        (60, Phase.END, (0.5, 0.0)),
        (90, Phase.END, (P, Q)),
    ):
        for i in range(10):
            read = np.array(force) + rng.normal(0, 3e-4, 2)
            now = Conditions(phase, math.nan, *read.tolist(), 0.0)
            frames.append(Snapshot(first + i, 1000 * first + 100 * i, now))
    return frames


def test_zeros_that_drift_are_told_by_what_is_read_apart_at_both_ends() -> None:
    seen = readings(Config(), at_both_ends(0.0, -0.03), [])
    assert seen.zero_drift == (0.0, pytest.approx(0.03 / 90, rel=0.02))
    assert any("90 s, the zero of Q drifted by -3" in note for note in seen.notes)
    assert readings(Config(), at_both_ends(0.03, 0.0), []).zero_drift[0] > 3e-4
    for known in (Config(uncertainty=Uncertainties(zero=0.05)), Config()):
        more = 0.03 if known.uncertainty.zero > 0.03 else 0.0
        still = readings(known, at_both_ends(more, more), [])
        assert (still.zero_drift, still.notes) == ((0.0, 0.0), ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_zeros_and_cross_terms_are_as_large_whatever_their_sign(sign: float) -> None:
    """And a block that adheres as it is taken off is not apart."""
    rng, frames, zero, cross = np.random.default_rng(6), [], 5e-3 * sign, 0.02 * sign
    for first, phase, P, Q, count in (
        (0, Phase.BACKGROUND, 0.0, 0.0, 20),
        (20, Phase.REFERENCE, 0.5, 0.0, 20),
        (40, Phase.DRIVE, 0.5, 0.4, 40),
        (80, Phase.END, 0.5, 0.4, 10),
        (90, Phase.END, -0.3, 0.0, 10),
        (100, Phase.END, 0.0, 0.0, 20),
    ):
        for i in range(count):
            sheared = Q * (1 - math.exp(-4 * (i + 1) / count))
            read = zero + np.array([P + cross * sheared, sheared + cross * P])
            read += rng.normal(0, 3e-4, 2)
            time = 0.1 * (i + 1) if phase is Phase.DRIVE else math.nan
            now = Conditions(phase, time, *read.tolist(), 0.0)
            frames.append(Snapshot(first + i, 100 * (first + i), now))
    drive = [s for s in frames if s.conditions.phase is Phase.DRIVE]
    seen = readings(Config(), frames, drive)
    assert seen.zero == pytest.approx((5e-3, 5e-3), rel=0.1)
    assert seen.coupling == pytest.approx((0.02, 0.02), rel=0.1)
    assert seen.zero_drift == (0.0, 0.0)


def test_a_zero_of_the_shear_force_that_drifts_is_told_by_the_loading() -> None:
    """As fast as it drifts: beside that the sensor reads 3 % too much."""
    half = one_way()
    assert readings(Config(), half, half, half).zero_drift == (0.0, 0.0)
    now = [replace(s.conditions, shear_force_n=s.conditions.shear_force_n + 3e-3 *
                   s.conditions.time_s) for s in half]  # fmt: skip
    half = [replace(s, conditions=one) for s, one in zip(half, now, strict=True)]
    seen = readings(Config(), half, half, half)
    assert seen.zero_drift == (0.0, pytest.approx(3e-3, rel=0.05))


def slid(further: float, *, rate: float = 8.0) -> list[Snapshot]:
    """A drive at 4.85 um/s that slides from 10 s on, in a picture that creeps by so many m/s."""
    rng, frames = np.random.default_rng(1), []
    for frame, t in enumerate(((np.arange(20 * rate) + 0.5) / rate).tolist()):
        Q = 0.4 * min(t / 10, 1) + 3e-4 * rng.normal()
        moved = 4.85e-6 * max(t - 10, 0) - (Q - 0.4 * min(t / 10, 1)) / 9579 + further * t
        now = Conditions(Phase.DRIVE, t, 0.5 + 3e-4 * rng.normal(), Q, 4.85e-6 * t)
        motion = FrameMotion(0.0, moved + 2e-8 * rng.normal(), 2e-8, 0.0)
        frames.append(Snapshot(frame, frame, now, motion))
    return frames


@pytest.mark.parametrize("creep_um_s", [0.2, -0.2, 0.0, 0.02])
def test_a_picture_that_creeps_during_the_drive_is_told(creep_um_s: float) -> None:
    frames = slid(1e-6 * creep_um_s)
    told = creep_in_sliding(Config(), frames, 11.0)
    if abs(creep_um_s) < 0.1:  # the size of a pixel is not known better
        assert told == ()
        return
    found = re.search(r"by the stage: camera or lens creep by (-?[0-9.]+) um/s", told[0])
    assert found is not None
    assert re.search(r"the block moves 4\.[0-9] \+- ", told[0])
    assert float(found[1]) == pytest.approx(creep_um_s, rel=0.1)
    assert ("further" in told[0]) == (creep_um_s > 0)
    known = Config(uncertainty=Uncertainties(pixel=0.05))
    assert creep_in_sliding(known, frames, 11.0) == ()
    short = [s for s in frames if s.conditions.time_s < 11]
    assert creep_in_sliding(Config(), short, 10.0) == ()


@pytest.mark.parametrize("slips", [2.0, 5.0, 40.0])
def test_a_contact_that_does_not_slide_steadily_is_no_picture_that_creeps(slips: float) -> None:
    """Its traction grows by the exponential law until it has slipped by so many mu L."""
    rng, scale, frames = np.random.default_rng(3), 0.75e-6, []
    for n, s in enumerate((scale * np.linspace(0.0, slips, 60 * int(slips))).tolist()):
        Q = 0.45 * -math.expm1(-s / scale)
        way = s + Q * (1 / Config().forces.stiffness_shear + 1.2e-4)
        now = Conditions(Phase.DRIVE, way / 4.85e-6, 0.5, Q + 3e-4 * rng.normal(), way)
        frames.append(Snapshot(n, n, now, FrameMotion(0.0, s + 1e-9 * rng.normal(), 1e-9, 0.0)))
    with without_budget():
        summary = conclude(Config(), frames, None, []).summary
    assert math.isfinite(summary.onset_time_s) == (slips > 8)
    assert "by the stage" not in str(summary.notes)


def sampled(seed: int = 0) -> DriveForces:
    """Forces of a drive in every sample: Q rises to 0.46 N in 20 s, noise of 1 mN."""
    t, rng = np.arange(30_000) / 1000, np.random.default_rng(seed)
    P, Q = 1e-3 * rng.normal(size=(2, t.size))
    return DriveForces(t, 0.46 * np.minimum(t / 20, 1) + Q, 0.5 + P)


def ends(forces: DriveForces, *free: Snapshot) -> list[str]:
    """What is said of sensors at the end of their range."""
    notes = readings(Config(), [*free], [], [], forces).notes
    return [note for note in notes if "end of its range" in note]


@pytest.mark.parametrize("coupled", [0.0, 0.02])
@pytest.mark.parametrize("least", [0.1, 0.45, 0.46])
def test_a_sensor_that_is_at_the_end_of_its_range_is_told(least: float, coupled: float) -> None:
    whole = sampled()
    clipped = np.minimum(whole.shear_n, least) + coupled * (whole.normal_n - 0.5)
    (told,) = ends(whole._replace(shear_n=clipped))
    count = int(told.split()[1])
    assert count == pytest.approx(np.sum(whole.shear_n > least), rel=0.2)
    assert f"greatest reading of Q, {least:.2g}" in told
    (told,) = ends(whole._replace(shear_n=-clipped))
    assert "least reading of Q, -0." in told


def test_a_load_that_is_beyond_the_sensor_from_the_start_is_told() -> None:
    rng, free = np.random.default_rng(2), []
    for frame in range(8):
        now = Conditions(Phase.BACKGROUND, math.nan, 1e-4 * rng.normal(), 0.0, 0.0)
        free.append(Snapshot(frame, 50 * frame, now))
    held = sampled()._replace(normal_n=np.full(30_000, 0.5))
    (told,) = ends(held, *free)
    assert "30000 of 30000 samples of the drive are the greatest reading of P" in told
    assert ends(held) == []  # a load that was given and not measured


def test_steps_of_a_converter_hum_and_rows_of_a_table_are_no_end_of_a_range() -> None:
    for seed in range(120):
        rng = np.random.default_rng(seed)
        n = int(10 ** rng.uniform(2, 4.7))
        t = np.arange(n) / n
        y = rng.random() * np.minimum(t / rng.uniform(0.1, 1), 1)
        y += 10 ** rng.uniform(-5, -2) * rng.normal(size=n)
        if seed % 3 == 0:
            y += 10 ** rng.uniform(-4, -2) * np.sin(9420 * t + 1)
        if seed % 2:
            step = 10 ** rng.uniform(-5, -2)
            y = np.round(y / step) * step
        if seed % 5 == 0:
            y = np.interp(t, t[::7], y[::7])
        if seed % 7 == 0:
            y += 0.01 * np.sign(np.sin(40 * t))
        assert ends(DriveForces(t, y, y + 1)) == [], seed
    nothing = np.full(1000, np.nan)
    assert ends(DriveForces(np.arange(1000.0), nothing, nothing)) == []


def test_forces_of_another_time_lie_between_those_of_the_frames() -> None:
    frames = sheared(0.0, 0.0)
    frames[7] = replace(frames[7], conditions=replace(frames[7].conditions, shear_force_n=math.nan))
    found = Measured(Config(), frames, None).delayed(0.02).drive
    Q = [s.conditions.shear_force_n for s in frames]
    now = [s.conditions.shear_force_n for s in found]
    assert now[3] == pytest.approx(0.6 * Q[3] + 0.4 * Q[4])
    assert math.isnan(now[7])
    assert now[6] == pytest.approx(0.8 * Q[6] + 0.2 * Q[8])
    assert now[-1] == Q[-1]
    assert [s.conditions.travel_m for s in found] == [s.conditions.travel_m for s in frames]
    assert Measured(Config(), [], None).delayed(0.02).drive == []


def test_the_lens_is_where_forces_of_another_time_have_moved_it() -> None:
    compliance, radius = 2e-5, np.array([1e-5, 2e-5])
    used = Config(sample=replace(Config().sample, lens_compliance=compliance))
    block = 5e-6
    frames = [
        replace(
            s,
            motion=FrameMotion(
                lens := compliance * s.conditions.shear_force_n, block - lens, 1e-9, 0
            ),
            rings=RingProfile(radius, np.full(2, block - lens), np.full(2, 1e-9)),
        )
        for s in sheared(0.0, 0.0)
    ]
    for s in Measured(used, frames, None).delayed(0.02).drive:
        lens = compliance * s.conditions.shear_force_n
        assert s.motion.lens_m == pytest.approx(lens, abs=1e-15)
        assert s.motion.centre_ux_m == pytest.approx(block - lens, abs=1e-15)
        np.testing.assert_allclose(s.rings.ux_m, block - lens, atol=1e-15)
        assert (s.motion.centre_ux_sd_m, s.rings.radius_m[0]) == (1e-9, 1e-5)


@pytest.mark.parametrize("jump", [0.0, 1.0])
def test_jumps_of_the_picture_are_told_before_the_contact_slides(jump: float) -> None:
    """By 0.14 px each way; not the way of a centre that yields steadily, nor lost frames."""
    rng, frames, sd = np.random.default_rng(5), [], 10e-9
    for n in range(120):
        if n % 7 == 3:
            continue
        t = 0.1 * n
        u = 2e-6 * t + rng.normal(0, sd / math.sqrt(2)) + jump * 1e-6 * rng.choice([-1, 1])
        now = Conditions(Phase.DRIVE, t, 0.5, 0.45 * math.tanh(t / 6), 5e-6 * t)
        frames.append(Snapshot(n, 100 * n, now, motion=FrameMotion(0.0, u, sd)))
    notes = " ".join(readings(Config(), frames, frames, frames).notes)
    found = re.search(r"picture: .* frame to frame by ([\d.]+) px", notes)
    assert bool(found) == (jump > 0)
    if found:
        assert float(found[1]) == pytest.approx(1e-6 / Config().camera.pixel, rel=0.4)
