"""What the settings make of a run before anything is measured: the calibration of the sensors, the
grid of boxes, and the header of the session. Light to import.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.arrays import F64
from analysis.calibration.forces import SensorChain
from analysis.grid import Grid
from analysis.mechanics import hertz
from analysis.options import as_written
from analysis.undistorted import ideal_places
from app.records.analog_channels import Channels
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import ZERO, Conditions, Event, Header
from app.settings.certificates import certificates_of, data_in
from app.settings.config import to_toml
from app.settings.sections import Config
from app.system.errors import ConfigError, UserError

if TYPE_CHECKING:
    from analysis.dic.rolling_shutter import RollingShutter

PATTERN = "pattern"  # the calibration that says what pixels add
Picture = NDArray[np.generic]


# share of the cantilever's bending, and way (m), by which the block must be behind for certain
BENT, BEHIND_M = 0.1, 1e-6


def is_behind(config: Config, now: Conditions, start: Conditions) -> bool:
    """Whether stage and cantilever say that the block is behind the place from which it started,
    against the first motion of the drive.
    """
    bent = (now.shear_force_n - start.shear_force_n) / config.forces.stiffness_shear
    way = now.travel_m - start.travel_m
    return max(way, way - bent) < -BEHIND_M - BENT * abs(bent)


def sensor_chain(config: Config) -> SensorChain:
    """Volts to newtons with the constants of the settings."""
    f = config.forces
    return SensorChain(
        sensitivity_m_per_v=f.sensitivity,
        stiffness_n_per_m=f.stiffness,
        zero_v=f.zero,
        coupling=f.coupling,
        stiffness_std_n_per_m=f.stiffness_uncertainty,
    )


def forces_of(config: Config, volts: F64, events: Iterable[Event]) -> F64:
    """Forces (n, 2) of all readings of a recording from its first sample on, with the zeros that
    its sensors were given on the way.

    Raises
    ------
    UserError
        An event says something else than two voltages.
    """
    chain = sensor_chain(config)
    forces = chain.forces(volts)
    for event in events:
        if event.kind == ZERO:
            forces[event.sample :] = zeroed(chain, event).forces(volts[event.sample :])
    return forces


def bytes_per_s(config: Config) -> float:
    """What a second of a run of these settings takes on the disk."""
    camera = config.camera
    points = (camera.width // config.dic.step) * (camera.height // config.dic.step)
    frame = camera.width * camera.height * camera.dtype.itemsize + 21 * points
    samples = config.forces.sample_rate * (32 + 8 * len(config.forces.auxiliary))
    return config.frame_rate_hz * frame + samples


def zeroed(chain: SensorChain, event: Event) -> SensorChain:
    """The chain with the zeros of an event of the kind `ZERO`; UserError if that has none."""
    zero_v = (event.normal_v, event.shear_v)
    if not all(map(math.isfinite, zero_v)):
        raise UserError(
            f"event at sample {event.sample}: two readings without a force are needed, found"
            f" '{event.text[:80]}'; somebody changed the session, use a copy of it if there is one"
        )
    return replace(chain, zero_v=zero_v)


def hertz_radius_m(config: Config, normal_force_n: float) -> float:
    """Hertz contact radius of the settings' sample at a normal force, NaN for none."""
    if not normal_force_n > 0:
        return math.nan
    return hertz.contact_radius(normal_force_n, *config.sample.bodies)


def grid_of(config: Config) -> Grid:
    """The boxes in which the displacement is measured."""
    return Grid.cover(config.camera.shape, config.dic.box, config.dic.step)


def places_m(config: Config, x_px: ArrayLike, y_px: ArrayLike) -> tuple[F64, F64]:
    """Where places of the picture are on the interface, metres, the lens's distortion undone."""
    camera = config.camera
    x, y = ideal_places(x_px, y_px, camera.distortion, camera.shape)
    return x * camera.pixel, y * camera.pixel


def pattern_of(config: Config) -> PixelPattern | None:
    """What the certificate of a calibration `pattern` says of each pixel; None where there is none.

    Raises
    ------
    ConfigError
        There are two, one cannot be read, or it is of pictures of another size.
    """
    named = [path for path, one in certificates_of(config).items() if one.what == PATTERN]
    if not named:
        return None
    if len(named) > 1:
        raise ConfigError(
            f"calibration.certificates: {named[0]} and {named[1]} both say what the pixels of the"
            " camera add to a picture; keep the newer one"
        )
    data = data_in(named[0])
    try:
        gain, dark = (np.asarray(data[name], np.float32) for name in ("gain", "dark"))
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{named[0]}: it holds no map of the pixels: {error}") from None
    if not (gain.shape == dark.shape == config.camera.shape):
        rows, columns = config.camera.shape
        raise ConfigError(
            f"{named[0]}: its map is of pictures of {' x '.join(map(str, gain.shape[::-1]))} px and"
            f" the camera takes {columns} x {rows} px; repeat `slipscope calibrate {PATTERN}`"
        )
    shows = (gain > 0) & np.isfinite(gain) & np.isfinite(dark)
    if not shows.any():
        raise ConfigError(f"{named[0]}: by its map no pixel shows anything; calibrate again")
    return PixelPattern(np.where(shows, gain, np.float32(np.nan)), np.where(shows, dark, 0))


def pixel_correction(pattern: PixelPattern | None) -> Callable[[Picture], Picture]:
    """What flat-fields a picture, by the map of its pixels; see `PixelMap.corrected`."""
    if pattern is None:
        return lambda image: image
    from analysis.calibration.pixel_map import PixelMap

    return PixelMap(pattern.dark, pattern.gain, np.isnan(pattern.gain)).corrected


def shutter_from(config: Config, grid: Grid, sample: int) -> RollingShutter | None:
    """What brings the rows of the images after a reference at that sample to one time; None where
    the camera exposes them at one.
    """
    camera, start = config.camera, sample / config.forces.sample_rate
    if not camera.readout:
        return None
    from analysis.dic.rolling_shutter import RollingShutter

    return RollingShutter(grid.y_px, camera.height, camera.readout, grid.shape, start=start)


def full_slip_stress(config: Config, amplitude: float) -> float:
    """Traction mu p0 at the centre of a contact that slides as a whole, pascals, of a
    `StickFit.amplitude`.
    """
    E, nu = config.sample.young_modulus, config.sample.poisson
    return amplitude * math.pi * E / ((1 + nu) * (1 - nu / 2))


def header_of(
    config: Config,
    versions: dict[str, str],
    first_trigger: int = 0,
    pattern: PixelPattern | None = None,
) -> Header:
    """What a session of these settings begins with."""
    grid = grid_of(config)
    return Header(
        frame_shape=config.camera.shape,
        frame_dtype="uint8" if config.camera.dtype == np.uint8 else "uint16",
        versions=versions,
        config_toml=to_toml(config),
        sample_rate_hz=float(config.forces.sample_rate),
        first_trigger=first_trigger,
        divisor=config.camera.divisor,
        exposure_samples=config.exposure_samples,
        pixel_m=config.camera.pixel,
        grid_x_px=grid.x_px,
        grid_y_px=grid.y_px,
        **as_written(config.about),
        compression="gzip" if config.recording.compression == "gzip" else "none",
        auxiliary=Channels(
            tuple(channel.name for channel in config.forces.auxiliary_channels),
            tuple(channel.unit for channel in config.forces.auxiliary_channels),
        )
        if config.forces.auxiliary
        else None,
        pattern=pattern,
    )
