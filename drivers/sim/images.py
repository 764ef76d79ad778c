"""The images of the simulated camera: the rough interface, its micro-contacts, uneven light and the
noise of an 8-bit sensor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
from scipy.special import ndtr

from analysis.arrays import F32, F64, I16, U8, Array
from analysis.kernels import compiled
from drivers.errors import DeviceFault
from drivers.sim import speckle, warp
from drivers.sim.scenario import Scenario
from drivers.sim.truth import TrueState

LIGHT = 0.12
"""The light, which is fixed in the lab, varies by this fraction of its mean over the image."""
_NORMALS = 1 << 21
DUST_RADIUS_PX, DUST_BLUR_PX = (1.5, 15.0), (0.8, 3.0)
DUST_DEPTH = 0.05, 0.5
# of the strip of marks on the lens: wave numbers (1/px), their number, and share of the light
MARK_WAVES, WAVES, MARK_CONTRAST = 0.5, 200, 0.3
FACE_CONTRAST = 0.5  # of a contact of smooth faces, share of the light
BRIGHT = 5  # one mark in so many


class Renderer:
    """Images of the interface for given states of the world; the same seed, frame number and state
    give the same bits.

    The exact renderer moves, deforms and integrates every blob over the pixels, without
    interpolation. The fast one resamples one image of the free block; the micro-contacts, the light
    and the noise are the same in both. In boxes of 20 px they differ by less than 0.0001 px rms
    (`python -m benchmarks render`). Making a renderer compiles its kernels and draws what all
    images share. Two threads must not share a renderer.

    Parameters
    ----------
    scenario : Scenario
        Uses the camera's shape and pixel, and the seed, noise and renderer of the simulation.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._sim, self._pixel_m = scenario.sim, scenario.camera.pixel
        self._shape = shape = scenario.camera.shape
        self._is_exact = scenario.sim.renderer == "exact"
        self._grains, self._background = speckle.speckle(shape, self._sim.seed)
        self._spots = speckle.micro_contacts(shape, self._sim.seed)
        self._light_x, self._light_y = _light(shape)
        self._normals = _normals(self._sim.seed)
        unequal = np.random.default_rng([self._sim.seed, 105]).standard_normal(shape, np.float32)
        self._gain = 1 + np.float32(self._sim.unequal_pixels) * unequal
        self._gain *= dust(shape, self._sim.dust, self._sim.seed)
        self._readout_samples = scenario.readout_samples
        self._lens_px = scenario.contact_centre_px
        self._usual_s = type(scenario.camera)().exposure
        self.adjust(scenario.camera.exposure, scenario.camera.gain)
        self._scene: Array = np.empty(shape, np.float32)
        self._drawn: tuple[warp.BlockMotion, bool] | None = None  # what the scene shows
        self._expose(self._draw(warp.AT_REST, self._is_exact), 0)

    def image(self, state: TrueState, frame_index: int, *later: TrueState) -> U8:
        """Image `frame_index` of the interface in `state`, 8-bit grey levels, shape (rows,
        columns); the caller owns it.

        With a rolling shutter that is the state at the first row, and `later` are those up to the
        last row (`drivers.sim.row_times`). A row between two of them is mixed from both.
        """
        scene = self._rolled((state, *later)) if later else self._scene_of(state)
        return self._expose(scene, frame_index)

    def _scene_of(self, state: TrueState) -> Array:
        scene = self._draw(self._motion(state), self._is_exact)
        if self._sim.lens_marks:
            scene = scene.copy()
            scene[: self._sim.lens_marks] = self._marks(state)
        return scene

    def _rolled(self, states: Sequence[TrueState]) -> Array:
        """The scene whose rows show the block at times of their own."""
        rows = np.linspace(0.0, self._readout_samples, self._shape[0])
        if self._sim.readout < 0:
            rows = rows[::-1]
        times = np.subtract([state.sample for state in states], states[0].sample)
        shares = [np.interp(rows, times, one) for one in np.eye(len(states))]
        scene = np.zeros(self._shape)
        for state, share in zip(states, shares, strict=True):
            scene += share[:, None] * self._scene_of(state)
        return scene.astype(self._scene.dtype)

    def adjust(self, exposure_s: float, gain_db: float) -> None:
        """Take images of so much light from now on; that of the exposure by default is 1."""
        self._light = np.float32(exposure_s / self._usual_s * 10 ** (max(gain_db, 0.0) / 20))

    def grey(self, state: TrueState, exact: bool) -> Array:
        """Grey levels before noise and rounding, float64 if exact, else float32; shape (rows,
        columns).
        """
        scene = self._draw(self._motion(state), exact)
        light = self._light_y[:, None] * self._light_x + np.float32(1 - LIGHT)
        return np.asarray(scene * light * self._light)

    def _marks(self, state: TrueState) -> F32:
        """The strip of marks that moves with the lens: plane waves, exact between pixels."""
        rows, columns = min(self._sim.lens_marks, self._shape[0]), self._shape[1]
        rng = np.random.default_rng([self._sim.seed, 107])
        kx, ky = rng.normal(0, MARK_WAVES, (2, WAVES))
        x, y = (
            (to / self._pixel_m - at)
            for to, at in zip(state.lens_centre_m, self._lens_px, strict=True)
        )
        along = np.exp(1j * np.multiply.outer(np.arange(columns) - x, kx))
        down = np.exp(1j * (np.multiply.outer(np.arange(rows) - y, ky) + rng.uniform(0, 7, WAVES)))
        waves = (down @ along.T).real * math.sqrt(2 / WAVES)
        return np.asarray(self._background * (1 + MARK_CONTRAST * waves), np.float32)

    def _motion(self, state: TrueState) -> warp.BlockMotion:
        move = warp.motion(
            state, self._pixel_m, self._shape, speckle.HALO_PX, distortion=self._sim.distortion
        )
        if move.largest_elastic > speckle.HALO_PX / 2:
            raise DeviceFault(
                "simulated camera: an elastic displacement of"
                f" {move.largest_elastic:.0f} px cannot be drawn, {speckle.HALO_PX // 2} px is the"
                " limit; use larger pixels"
            )
        return move

    def _draw(self, move: warp.BlockMotion, exact: bool) -> Array:
        """The block under even light, drawn anew only if it has moved; the next call may reuse the
        array.
        """
        shape = self._shape
        if self._sim.pressure == "jkr":
            return self._smooth(move)
        if self._drawn and self._drawn[1] == exact and self._drawn[0].equals(move):
            return self._scene
        self._drawn = None
        if exact:
            scene: Array = np.full(shape, self._background)
            base = warp.as_if_rigid(
                self._grains.x, self._grains.y, move, speckle.period(shape), speckle.HALO_PX
            )
            _add(scene, self._grains.peak, warp.place(base, self._grains.sigma, move), move)
        else:
            scene = self._scene if self._scene.dtype == np.float32 else np.empty(shape, np.float32)
            warp.warp(self._coefficients, move, scene)
        self._add_micro_contacts(scene, move)
        self._scene, self._drawn = scene, (move, exact)
        return scene

    @cached_property
    def _coefficients(self) -> I16:
        return _coefficients(self._shape, self._sim.seed)

    def _smooth(self, move: warp.BlockMotion) -> F32:
        """Smooth faces: an even disc where they touch, whose edge is a pixel wide."""
        rows, columns = np.indices(self._shape, dtype=float)
        x, y = move.lens.ideal(columns, rows)
        inside = move.radius + 0.5 - np.hypot(x - move.centre[0], y - move.centre[1])
        touches = np.clip(inside, 0.0, 1.0) if move.radius else np.zeros(self._shape)
        return np.asarray(speckle.SPECKLE_MEAN * (1 + FACE_CONTRAST * touches), np.float32)

    def _add_micro_contacts(self, scene: Array, move: warp.BlockMotion) -> None:
        spots = self._spots.blobs
        base = warp.as_if_rigid(
            spots.x, spots.y, move, speckle.period(self._shape), speckle.HALO_PX
        )
        near = np.hypot(base[0], base[1]) < move.radius + move.largest_elastic
        places = warp.place(base[:, near], spots.sigma[near], move)
        distance, threshold = np.hypot(places[0], places[1]), self._spots.threshold[near]
        if move.lit is None:
            lit = speckle.brightness(distance, move.radius, threshold)
        else:
            share = np.interp(distance * move.per_px, np.arange(len(move.lit)), move.lit)
            lit = speckle.rough_brightness(share, threshold)
        _add(scene, spots.peak[near] * lit, places, move)

    def _expose(self, scene: Array, frame_index: int) -> U8:
        sim, (rows, columns) = self._sim, self._shape
        starts = np.random.default_rng([sim.seed, 104, frame_index]).integers(
            0, _NORMALS - columns, rows
        )
        shot = 255.0 / sim.full_well if sim.full_well > 0 else 0.0
        out = np.empty(self._shape, np.uint8)
        if sim.unequal_pixels or sim.dust or self._light != 1:
            scene = (scene * (self._gain * self._light)).astype(scene.dtype)
        _sensor(
            scene,
            self._light_x,
            self._light_y,
            self._normals,
            starts,
            np.float32(sim.read_noise**2),
            np.float32(shot),
            out,
        )
        return out


@lru_cache(maxsize=1)
def _normals(seed: int) -> F32:
    """The noise of a seed, in rows that begin anywhere; read-only."""
    made = np.random.default_rng([seed, 103]).standard_normal(_NORMALS, dtype=np.float32)
    made.setflags(write=False)
    return made


@lru_cache(maxsize=1)  # 45 MB at 2448 x 2048
def _coefficients(shape: tuple[int, int], seed: int) -> I16:
    """The free block, as the fast renderers of one seed and shape resample it; read-only."""
    grains, background = speckle.speckle(shape, seed)
    coefficients = speckle.spline_coefficients(grains, shape)
    coefficients += np.float32(background)
    return warp.table(coefficients)


def _add(
    scene: Array,
    peak: F64,
    places: F64,
    move: warp.BlockMotion,
) -> None:
    blobs = places.copy()
    blobs[0] += move.centre[0]
    blobs[1] += move.centre[1]
    if move.lens.k:
        blobs = move.lens.seen_blobs(blobs)
    speckle.add_blobs(scene, *blobs, peak)


def _light(shape: tuple[int, int]) -> tuple[F32, F32]:
    """Factors of the uneven light along x and y; the light is their product plus 1 - LIGHT, as of a
    lamp slightly off the axis.
    """
    x, y = (np.linspace(-0.5, 0.5, n) for n in (shape[1], shape[0]))
    across = np.cos(0.8 * math.pi * (x - 0.1))
    down = np.cos(0.8 * math.pi * (y + 0.12))
    return (2 * LIGHT * across).astype(np.float32), down.astype(np.float32)


def dust(shape: tuple[int, int], marks: int, seed: int) -> F32:
    """Share of the light that passes marks on the glass or the camera's window, shape (rows,
    columns): round grains and drops out of focus, of which one in `BRIGHT` scatters light in.
    """
    rng = np.random.default_rng([seed, 106])
    passed, sides = np.ones(shape, np.float32), np.array(shape)
    for number in range(marks):
        radius, blur = (math.exp(rng.uniform(*np.log(a))) for a in (DUST_RADIUS_PX, DUST_BLUR_PX))
        middle, depth = rng.uniform(0, sides), rng.uniform(*DUST_DEPTH)
        reach = radius + 3 * blur
        first = np.clip(np.floor(middle - reach), 0, sides).astype(int)
        last = np.clip(np.ceil(middle + reach) + 1, 0, sides).astype(int)
        covering = tuple(map(slice, first, last))
        y, x = np.ogrid[covering]
        covered = ndtr((radius - np.hypot(y - middle[0], x - middle[1])) / blur)
        sign = 1 if number % BRIGHT == BRIGHT - 1 else -1
        passed[covering] *= 1 + sign * depth * covered
    return passed


@compiled(fastmath=True)
def _sensor(scene, light_x, light_y, normals, starts, read, shot, out):  # type: ignore[no-untyped-def]
    """The sensor: light, shot and read noise, rounding and clipping to 8 bits.

    N electrons fluctuate by sqrt(N); with `full_well` electrons at 255 grey levels a grey level I
    has the variance I * 255 / full_well. The noise of a row starts anywhere in a table of normal
    numbers.
    """
    rows, columns = scene.shape
    one = np.float32(1 - LIGHT)
    for j in range(rows):
        y = light_y[j]
        row, line, noise = scene[j], out[j], normals[starts[j] : starts[j] + columns]
        for i in range(columns):
            grey = row[i] * (light_x[i] * y + one)
            value = grey + noise[i] * np.sqrt(read + shot * grey) + np.float32(0.5)
            line[i] = np.uint8(min(max(value, np.float32(0)), np.float32(255)))
