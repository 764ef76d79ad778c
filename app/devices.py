"""The bench that the settings describe: what each driver is told, and the simulated world behind
those that are not real.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from app.config import exposure_samples, sensitivities
from app.errors import UserError
from app.sections import Config
from app.session.recording import SessionRecording
from drivers.bench import Bench, open_bench
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sim.faults import Fault, parse
from drivers.sim.settings import WorldSettings


def sources_of(config: Config) -> tuple[str, str, str]:
    """Names of the drivers of forces, camera and actuator."""
    return config.forces.source, config.camera.source, config.actuator.source


def is_unreal(source: str) -> bool:
    """Whether a driver of that name looks at the simulated world."""
    return source == "sim" or source.endswith("-emulated")


def force_settings(config: Config) -> ForceSettings:
    """What the driver of the DAQ board is told."""
    f = config.forces
    return ForceSettings(
        sample_rate_hz=float(f.sample_rate),
        block_samples=f.block,
        device=f.device,
        channels=f.channels,
        wiring=f.wiring,
        range_v=f.range,
        buffer_s=f.buffer,
        server=f.server,
        certificate=f.certificate,
        trigger=f.trigger,
        trigger_counter=f.trigger_counter,
        trigger_terminal=f.trigger_terminal,
        trigger_line=f.trigger_line,
        exposure_counter=f.exposure_counter,
        exposure_terminal=f.exposure_terminal,
    )


def camera_settings(config: Config) -> CameraSettings:
    """What the driver of the camera is told."""
    c = config.camera
    return CameraSettings(
        shape=(c.height, c.width),
        exposure_s=c.exposure * 1e-3,
        sample_rate_hz=float(config.forces.sample_rate),
        device=c.device,
        pixel_format=c.pixel_format,
        offset_px=c.offset,
        gain_db=None if c.gain < 0 else c.gain,
        trigger_line=c.trigger_line,
        exposure_line=c.exposure_line,
        producer=c.producer,
        folder=c.folder,
    )


def actuator_settings(config: Config) -> ActuatorSettings:
    """What the driver of the actuator is told."""
    a = config.actuator
    low, high = a.travel
    return ActuatorSettings(
        port=a.port,
        address=a.address,
        baud=a.baud,
        travel_limits_m=(low * 1e-3, high * 1e-3),
        velocity_limit_m_s=a.max_velocity * 1e-6,
    )


def world_settings(config: Config) -> WorldSettings:
    """The simulated world that belongs to the settings.

    Raises
    ------
    UserError
        It names a fault that there is not, or a table that can not be read.
    """
    sim, sample, forces, camera = config.sim, config.sample, config.forces, config.camera
    return WorldSettings(
        seed=sim.seed,
        normal_force_n=config.run.normal_force,
        law=sim.law,
        friction=sim.friction,
        friction_decay=sim.friction_decay,
        slip_length_m=sim.slip_length * 1e-6,
        table=law_table(sim.law_table) if sim.law == "table" else (),
        thickness_m=sim.thickness * 1e-3 or math.inf,
        young_modulus_pa=sample.young_modulus * 1e6,
        poisson=sample.poisson,
        lens_radius_m=sample.lens_radius * 1e-3,
        roughness_m=sample.roughness * 1e-6,
        lens_compliance_m_per_n=sample.lens_compliance * 1e-6,
        stiffness_n_per_m=(forces.stiffness_normal, forces.stiffness_shear),
        sensitivity_m_per_v=sensitivities(config),
        adc_range_v=max(forces.range),
        zero_v=forces.zero,
        coupling=forces.coupling,
        force_noise_n=sim.force_noise * 1e-3,
        sample_rate_hz=float(forces.sample_rate),
        block_samples=forces.block,
        exposure_samples=exposure_samples(config),
        pixel_m=camera.pixel * 1e-6,
        image_shape=(camera.height, camera.width),
        press_sample=round(sim.press_time * forces.sample_rate),
        slow_actuator=sim.slow_actuator,
        drive_angle=math.radians(sim.drive_angle),
        stage_drift_m_s=sim.stage_drift * 1e-6,
        image_drift_px_s=sim.image_drift,
        read_noise=sim.read_noise,
        full_well=sim.full_well,
        renderer=sim.renderer,
        count_exposures=bool(forces.exposure_counter),
        faults=faults(sim.faults),
    )


def law_table(name: str) -> tuple[tuple[float, float], ...]:
    """Slip (m) and shear traction as a share of mu p, read from a CSV file of slip (um) and share.

    Raises
    ------
    UserError
        The file can not be read or holds something else.
    """
    if not name:
        raise UserError(
            "sim.law_table: law = 'table' needs a file of slip (um) and share of mu p; none is"
            " named"
        )
    try:
        rows = np.loadtxt(name, delimiter=",", comments="#", ndmin=2)
    except (OSError, ValueError) as error:
        raise UserError(
            f"sim.law_table: {name} can not be read: {error}; write two columns of numbers, slip"
            " (um) and share of mu p"
        ) from None
    if rows.shape[1] != 2:
        raise UserError(
            f"sim.law_table: {name} has {rows.shape[1]} columns; write two, slip (um) and share of"
            " mu p"
        )
    return tuple((float(slip) * 1e-6, float(share)) for slip, share in rows)


def faults(texts: tuple[str, ...]) -> tuple[Fault, ...]:
    """The faults that the settings ask for.

    Raises
    ------
    UserError
        One of them is none.
    """
    try:
        return tuple(parse(text) for text in texts)
    except ValueError as error:
        raise UserError(f"sim.faults: {error}") from None


def make_bench(config: Config, pace: float | None) -> Bench:
    """The bench that the settings name, not yet open.

    Raises
    ------
    UserError
        The settings describe a world that can not be.
    """
    sources = sources_of(config)
    world = world_settings(config) if any(map(is_unreal, sources)) else None
    recording = SessionRecording(Path(config.replay.session)) if "replay" in sources else None
    told = {
        "force_settings": force_settings(config),
        "camera_settings": camera_settings(config),
        "actuator_settings": actuator_settings(config),
    }
    try:
        return open_bench(*sources, **told, world=world, recording=recording, pace=pace)  # type: ignore[arg-type]
    except ValueError as error:
        raise UserError(f"[sim]: {error}") from None
