"""Readings, pictures and records of benches whose constants a calibration does not know, each bench
drawn from a seed: what the tests spoil, and what `python -m benchmarks calibrations` judges.

A bench is a function of a seed that measures, and returns by name what was found (a number or
many), its standard uncertainty and the truth; a distortion in pixels at the corners.
`hidden_samples` has more of them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy
from blobs import Speckle
from scipy.special import erf

from analysis.calibration.cross_talk import calibrate_loads, common_share, pressed_share
from analysis.calibration.photon_transfer import NoiseLevels, noise_levels, photon_transfer
from analysis.calibration.pixel_map import map_of_flat, map_of_motion
from analysis.calibration.scale import scale_of_travels
from analysis.calibration.sensor_response import sensor_response
from analysis.calibration.targets import scale_of_checkerboard, scale_of_lines
from app.calibrations.weights import ForceCalibration, WeightOptions
from app.runs.live import scenario
from app.settings.config import load
from app.settings.hung_weights import asked_weight
from drivers.sim.images import dust
from drivers.sim.optics import Lens
from drivers.sim.world import World

Found = dict[str, tuple[float, float, float]]  # what was found, its standard uncertainty, the truth
M_PER_PX = 7.11e-6


def serial(rng, n, correlation):
    """Noise of unit variance whose correlation falls by a factor from one to the next."""
    white = rng.standard_normal(n + 200) * np.sqrt(1 - correlation**2)
    return scipy.signal.lfilter([1.0], [1.0, -correlation], white)[200:]


def overlapping(rng, shape):
    """Noise of unit variance of boxes that overlap by half along both axes."""
    fine = rng.standard_normal((shape[0] + 1, shape[1] + 1))
    return (fine[1:, 1:] + fine[:-1, 1:] + fine[1:, :-1] + fine[:-1, :-1]) / 2


# ------------------------------------------------------------------ forces

LEVELS = np.array([0, 0.25, 0.5, 0.75, 1.0])
UP_AND_DOWN = np.concatenate([LEVELS, LEVELS[-2::-1]])
THREE_TIMES = np.concatenate([UP_AND_DOWN, UP_AND_DOWN[1:], UP_AND_DOWN[1:]])
EVERY_S = 10.0
RATE = 1000.0
SMALL = ("camera.width=64", "camera.height=64", "dic.box=20")
SMOOTH = ("sim.law=cattaneo-mindlin", "sim.pressure=hertz")  # made in no time
THRICE = WeightOptions(normal="0.3 0.6 1", shear="0.3 0.6 1", cycles=3, hold=0.5)


def readings(rng, x, slope, *, noise=3e-4, walk=0.0, drift=0.0, bend=0.0, rubbing=0.0):
    """Volts of a sensor: a line through 0.12 V, and what a real one has beside it; bend and rubbing
    are shares of the whole span, half way.
    """
    n, span = len(x), slope * np.ptp(x)
    u = (x - x.min()) / np.ptp(x)
    way = np.sign(np.diff(x, prepend=x[0]))
    return (
        0.12 + slope * x + span * 4 * u * (1 - u) * (bend - way * rubbing)
        + drift * np.linspace(0, 1, n) + walk * np.cumsum(rng.standard_normal(n))
        + noise * rng.standard_normal(n)
    )  # fmt: skip


def stiffness(seed):
    """Weights of one set, 0.1 % uncertain, on each axis, and displacements by a screw, 0.1 %
    uncertain.
    """
    n, rng = len(THREE_TIMES), np.random.default_rng(seed)
    load, axis = np.tile(THREE_TIMES, 2), np.repeat([0, 1], n)
    stiff = np.array([689, 9579]) * rng.uniform(0.9, 1.1, 2)
    sensitivity = np.array([3e-4, 2.2e-5]) * rng.uniform(0.9, 1.1, 2)
    coupling = np.eye(2)
    coupling[[0, 1], [1, 0]] = rng.uniform(-0.02, 0.02, 2)
    true_load = load * (1 + 1e-3 * rng.standard_normal())
    forces = np.column_stack([true_load * (axis == 0), true_load * (axis == 1)])
    volts = forces @ coupling.T / (stiff * sensitivity) + [0.1, -0.3]
    volts += 3e-4 * rng.standard_normal(volts.shape)
    found = calibrate_loads(load, axis, volts, EVERY_S * np.arange(2 * n), load_sd=1e-3)
    values = {
        name: (found.coupling[i, 1 - i], found.coupling_sd[i, 1 - i], coupling[i, 1 - i])
        for i, name in enumerate(("cross-talk Q in P", "cross-talk P in Q"))
    }
    for i, name in enumerate(("stiffness k_N", "stiffness k_T")):
        x = THREE_TIMES / stiff[i]
        true_x = x * (1 + 1e-3 * rng.standard_normal())
        moved = sensor_response(x, readings(rng, true_x, 1 / sensitivity[i]))
        k = found.newtons_per_volt[i] * moved.slope
        relative = math.hypot(
            found.newtons_per_volt_sd[i] / found.newtons_per_volt[i], moved.relative_sd, 1e-3
        )
        values[name] = k, relative * k, stiff[i]
    return values


def hung(seed):
    """Weights on the simulated bench, with drift and cross-talk, whose sensors are others than its
    settings say.
    """
    rng = np.random.default_rng(seed)
    factors, added = rng.uniform(0.9, 1.1, 4), rng.uniform(-0.02, 0.02, 2)
    names = [f"{of}_{on}" for of in ("stiffness", "sensitivity") for on in ("normal", "shear")]
    errors = [f'"forces.{name} {f}"' for name, f in zip(names, factors, strict=True)]
    cross = zip(("normal_from_shear", "shear_from_normal"), added, strict=True)
    errors += [f'"forces.{name} {a}"' for name, a in cross]
    settings = [f"sim.errors=[{', '.join(errors)}]", f"sim.seed={seed}", "sim.zero_drift=2"]
    settings += ["forces.sample_rate=200", "forces.block=10", "camera.divisor=25"]
    (config,) = ForceCalibration().plan(load(None, [*SMALL, *settings, *SMOOTH]), THRICE)
    one = scenario(config)
    world = World(one, pace=None)
    world.start()
    rows, order_of = [], [asked_weight(step) for step in config.run.steps[::2]]
    for axis, newtons in order_of:
        world.advance(420)  # asked and hung in 2 s, and a fifth of the hold
        rows.append((newtons, ("normal", "shear").index(axis), *world.advance(80).volts.mean(0)))
    load_n, axis, normal, shear = np.transpose(rows)
    found = calibrate_loads(load_n, axis.astype(int), np.column_stack([normal, shear]))
    f = one.forces
    values = {
        f"N/V of {name}": (per_volt, sd, true)
        for name, per_volt, sd, true in zip(
            ("P", "Q"), found.newtons_per_volt, found.newtons_per_volt_sd,
            np.multiply(f.stiffness, f.sensitivity), strict=True,
        )
    }  # fmt: skip
    for i, name in enumerate(("cross-talk Q in P", "cross-talk P in Q")):
        talk, sd = found.coupling[i, 1 - i], found.coupling_sd[i, 1 - i]
        values[f"{name}, simulated bench"] = talk, sd, f.coupling[i][1 - i]
    return values


def pressing(rng, share, *, load=0.5, noise=1e-3, shear=lambda P: 0 * P, rise_s=1.0):
    """Free for a second, pressed within `rise_s`, steady for a second."""
    t = np.arange(round((2 + rise_s) * RATE)) / RATE
    x = np.clip((t - 1) / rise_s, 0, 1)
    P = load * x * x * (3 - 2 * x)
    forces = np.column_stack([P, share * P + shear(P) - 0.004])
    return forces + noise * rng.standard_normal(forces.shape)


def pressed(seed):
    """The share of P in Q from three pressings, and from the first of them alone."""
    rng = np.random.default_rng(seed)
    share = rng.uniform(-0.02, 0.02)
    found = [pressed_share(pressing(rng, share, load=P), RATE) for P in (0.2, 0.5, 1.0)]
    return {
        "cross-talk by pressings": (*common_share(found), share),
        "cross-talk by one pressing": (found[0].value, found[0].sd, share),
    }


# ------------------------------------------------------------------ scale

SHAPE, ANGLE, K = (480, 640), math.radians(3.2), -0.008
X, Y = np.meshgrid(np.arange(20.0, 600, 25), np.arange(20.0, 460, 25))
DRIFT_PX_PER_S, PLAY, ENCODER_M = 0.002, 2.5e-6, 35e-9
STOPS = np.arange(0.0, 661e-6, 60e-6)
TARGET_ANGLE = math.radians(4.3)
FINER = (np.arange(4) - 1.5) / 4


def fields(rng, shift, noise=0.01, wander=0.004, k=K):
    """What the correlation finds of a block that was shifted, (n,) complex px: boxes share the
    noise of the first picture, the stage wanders by nanometres, and the way is off across itself.
    """
    shift = np.asarray(shift, complex)
    furthest = shift[np.argmax(np.abs(shift))]
    shift = shift * (1 + 8e-4j * rng.standard_normal() / np.abs(furthest))
    lens, first = Lens.of(k, SHAPE), [overlapping(rng, X.shape) for _ in range(2)]
    ideal, found = lens.ideal(X, Y), []
    for one in shift:
        way = complex(one) + wander * complex(*rng.standard_normal(2))
        to = lens.seen(ideal[0] + way.real, ideal[1] + way.imag)
        now = [(overlapping(rng, X.shape) - was) * noise / math.sqrt(2) for was in first]
        found.append([to[0] - X + now[0], to[1] - Y + now[1]])
    return np.moveaxis(np.array(found), 1, 0)


def moved(travel, time=None, drift=0j, play=0.0):
    """Displacements, px, of a block behind a stage with play."""
    at, actual = travel[0] - play / 2, []
    for one in travel:
        at = min(max(at, one - play / 2), one + play / 2)
        actual.append(at)
    shift = np.array(actual) / M_PER_PX * np.exp(1j * ANGLE)
    if time is not None:
        shift = shift + drift * time
    return shift - shift[0]


def scale_by_travel(seed, world="there and back"):
    """A stage that goes in steps, there and back, on a bench that warms up, or without pauses."""
    rng = np.random.default_rng([20, seed])
    travel = np.concatenate([STOPS, STOPS[::-1]]) if world == "there and back" else STOPS
    if world == "no pauses":
        travel = np.linspace(0, 660e-6, 14)
    time, drift = np.arange(len(travel)) * 1.0, complex(*rng.normal(0, DRIFT_PX_PER_S, 2))
    if world == "warming":
        travel, time = np.repeat(STOPS, 2), np.arange(2 * len(STOPS)) * 1.0
        drift = 0.05 - 0.01j
    # an encoder rounds what it reads, alike where the stage rests or comes back to
    place, again = np.unique(travel, return_inverse=True)
    is_at = (place + ENCODER_M * rng.uniform(-0.5, 0.5, place.shape))[again]
    u = fields(rng, moved(is_at, time, drift, play=PLAY))
    known = {"drift_sd": DRIFT_PX_PER_S * M_PER_PX, "step_m": ENCODER_M}
    found = scale_of_travels(travel, X, Y, *u, SHAPE, time_s=time, **known)
    assert (world == "there and back") == math.isfinite(found.backlash_m)
    corner = math.hypot(*SHAPE) / 2
    values = {
        "scale by travel": (found.m_per_px, found.m_per_px_sd, M_PER_PX),
        "angle of the travel": (found.angle, found.angle_sd, ANGLE),
        "distortion by travel": (corner * found.k, corner * found.k_sd, corner * K),
    }
    if world == "there and back":
        values["backlash in pictures"] = found.backlash_m, found.backlash_sd, PLAY
    if world in {"there and back", "warming"}:
        values["drift of the picture"] = found.drift_px_per_s[0], found.drift_sd, drift.real
    return values


def pictured(scene, shape, k):
    """Grey levels of a scene, a function of the ideal place, through a lens, averaged over the
    pixels.
    """
    lens, (y, x) = Lens.of(k, shape), np.mgrid[: shape[0], : shape[1]].astype(float)
    return np.mean([scene(*lens.ideal(x + dx, y + dy)) for dx in FINER for dy in FINER], axis=0)


def board(shape, k=0.0, square=30.0, corners=(11, 8), origin=(55.3, 30.7), stretched=1.0):
    def scene(x, y):
        at = ((x - origin[0]) + 1j * (y - origin[1])) * np.exp(-1j * TARGET_ANGLE) / square
        sides, inside = 1.0, 1.0
        for along, n in ((at.real, corners[0]), (at.imag / stretched, corners[1])):
            line = np.clip(np.rint(along), 0, n - 1)
            sides = sides * (1 - 2 * (line % 2)) * erf((along - line) * square)
            inside = inside * (1 + erf((np.abs(along - (n - 1) / 2) - (n + 1) / 2) * -square)) / 2
        return 200 - 160 * (0.5 - 0.5 * sides) * inside

    return pictured(scene, shape, k)


def lines(shape, k=0.0, pitch=11.3, wide=3.0, angle=TARGET_ANGLE):
    def scene(x, y):
        at = (x * math.cos(angle) + y * math.sin(angle)) / pitch + 0.3
        off = (at - np.rint(at)) * pitch
        return 200 - 70 * (erf(off + wide / 2) - erf(off - wide / 2))

    return pictured(scene, shape, k)


def seen(grey, noise=0.0, seed=0, top=255, kind=np.uint8):
    noisy = grey * (top / 255) + noise * np.random.default_rng(seed).normal(size=grey.shape)
    return np.clip(np.rint(noisy), 0, top).astype(kind)


def _of_target(name, found, k, shape):
    corner = math.hypot(*shape) / 2
    return {
        f"scale by {name}": (found.m_per_px, found.m_per_px_sd, M_PER_PX),
        f"angle of {name}": (found.angle, found.angle_sd, TARGET_ANGLE),
        f"distortion by {name}": (corner * found.k, corner * found.k_sd, corner * k),
    }


_board, _lines = lru_cache(maxsize=2)(board), lru_cache(maxsize=2)(lines)


def scale_by_lines(seed, shape=(220, 300), noise=8.0):
    """A graticule; small and noisy."""
    picture = seen(_lines(shape, 0.01), noise, seed)
    return _of_target("lines", scale_of_lines(picture, 11.3 * M_PER_PX, 7e-6), 0.01, shape)


def scale_by_board(
    seed, shape=(140, 180), corners=(7, 5), square=20.0, noise=3.0, origin=(28, 30.3)
):
    """A checkerboard, small and noisy; ten of them lie in one place."""
    ten = seed // 10 * 10
    k = ten / 3000 % 0.02 - 0.01
    clean = _board(shape, k, square, corners, (origin[0] + ten / 11 % 5, origin[1]))
    found = scale_of_checkerboard(seen(clean, noise, seed), corners, square * M_PER_PX)
    return _of_target("board", found, k, shape)


# ------------------------------------------------------------------ camera

PATTERN_SHAPE = 160, 280
WAYS = np.cumsum(np.random.default_rng(1).uniform(0.4, 1.0, 60))
MIDDLE = np.s_[10:-10, 40:-40]
SCENE = Speckle((160, 200), seed=2).grey(contrast=0.18, level=0.02)  # of the brightest level
SCENE /= SCENE.max()
LIGHTS = 0.05, 0.12, 0.25, 0.45, 0.7, 0.95


def camera(unequal, marks=0, seed=5):
    gain = 1 + unequal * np.random.default_rng(seed).standard_normal(PATTERN_SHAPE)
    return gain * dust(PATTERN_SHAPE, marks, 1)


def taken(grey, seed, dark=0.0):
    """An 8-bit picture with read noise and shot noise of 20000 electrons at full scale."""
    noise = np.random.default_rng(seed).normal(size=grey.shape)
    return np.clip(np.rint(dark + grey + noise * np.sqrt(1 + grey * 255 / 20000)), 0, 255).astype(
        np.uint8
    )


def pictures_of_motion(gain, ways=WAYS, dark=0.0, light=1.0, sideways=0.03, first=0):
    block, y, x = Speckle(PATTERN_SHAPE, seed=3), *np.mgrid[: PATTERN_SHAPE[0], : PATTERN_SHAPE[1]]
    light = light * (1 + 0.1 * np.cos((x - 130) / 160) * np.cos((y - 120) / 150))
    return [
        taken(block.grey(w, sideways * w, contrast=25, level=60) * gain * light, first + n, dark)
        for n, w in enumerate(ways)
    ]


def off_px(found, gain, level, where=MIDDLE):
    """What is wrong with a map, rms in grey levels of a picture of that level, without marks."""
    off = (found.gain / gain)[where]
    off = (off / np.median(off) - 1)[~found.is_bad[where]]
    return level * float(off.std())


def _of_map(name, found, gain, where, level):
    """A hundred pixels, in grey levels."""
    share = (found.gain / gain)[where]
    share = level * (share / np.median(share))[~found.is_bad[where]]
    return {name: (share[:: len(share) // 100], level * found.sd, level)}


def pattern_of_flat(seed):
    """The map that 60 pictures of an even face give."""
    gain = camera(0.02, seed=[5, seed])
    pictures = [taken(120 * gain, 1000 * seed + n, 8.0) for n in range(60)]
    found = map_of_flat(pictures, np.full(PATTERN_SHAPE, 8.0), top=255)
    return _of_map("pattern by a flat field", found, gain, np.s_[:, :], 100)


def pattern_of_motion(seed):
    """The map that a block gives, which is moved."""
    gain = camera(0.01, seed=[6, 1 + seed])  # [6, 0] draws what 6, the noise of a picture, does
    ways = np.stack([WAYS, 0.03 * WAYS], axis=1)
    found = map_of_motion(pictures_of_motion(gain, first=1000 * seed), ways)
    return _of_map("pattern by motion", found, gain, MIDDLE, 97)


class Sensor:
    """A camera: electrons by chance, read noise, black level, rounding and the end of the scale."""

    def __init__(self, seed, gain=0.0127, read=1.2, dark=8.0, top=255):
        self.rng, self.gain, self.read, self.dark, self.top = (
            np.random.default_rng(seed),
            gain,
            read,
            dark,
            top,
        )

    def picture(self, light, scene=SCENE):
        electrons = self.rng.poisson(scene * light * (self.top - self.dark) / self.gain)
        grey = self.dark + self.gain * electrons + self.read * self.rng.normal(size=scene.shape)
        return np.clip(np.rint(grey), 0, self.top).astype(np.uint16)


def transferred(sensor, lights=LIGHTS, scene=SCENE, change=lambda image, n: image):
    pairs = [[change(sensor.picture(light, scene), n) for n in (0, 1)] for light in lights]
    found = [noise_levels(*pair, top=sensor.top) for pair in pairs]
    bins = (
        np.concatenate([getattr(one, v) for one in found]) for v in ("level", "variance", "count")
    )
    return photon_transfer(
        NoiseLevels(*bins),
        sensor.top,
        dark=sensor.dark,
        mean_level=[np.mean(pair) for pair in pairs],
        exposure_s=np.array(lights) * 0.01,
    )


def photons(seed):
    """Pairs of pictures of a scene at four exposures."""
    hidden = np.random.default_rng([7, seed])
    sensor = Sensor(seed, hidden.uniform(0.008, 0.05), hidden.uniform(0.8, 2.5), 9.0)
    found = transferred(sensor, (0.1, 0.25, 0.5, 0.9))
    assert found.nonlinearity < 0.01
    full = (sensor.top - sensor.dark) / sensor.gain
    return {
        "gain of the camera": (found.gain, found.gain_sd, sensor.gain),
        "read noise": (found.read_noise, found.read_noise_sd, sensor.read),
        "full well": (found.full_well, found.full_well_sd, full),
    }
