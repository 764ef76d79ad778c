"""A live run from settings: the one place where engine, bench and session file are put together."""

from __future__ import annotations

import math
import platform
import shutil
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis import dic
from analysis.contact.rings import ring_means
from app.config import correlation, exposure_samples, to_toml
from app.engine.run import Run
from app.errors import UserError
from app.sections import Config
from app.session.writer import RESERVE_BYTES, SessionWriter
from drivers.bench import Bench, open_bench
from drivers.sim.world import World, WorldSettings


def versions() -> dict[str, str]:
    """What this program runs on, for the session's record."""
    packages = ("slipscope", "numpy", "scipy", "numba", "opencv-python-headless", "h5py")
    return {"python": platform.python_version(), "platform": platform.platform(), **{name: metadata.version(name) for name in packages}}


def world_settings(config: Config) -> WorldSettings:
    """The simulated world that belongs to the settings."""
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
        sensitivity_m_per_v=(forces.sensitivity_normal * 1e-6, forces.sensitivity_shear * 1e-6),
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
    )


def law_table(name: str) -> tuple[tuple[float, float], ...]:
    """Slip (m) and shear traction as a share of mu p, read from a CSV file of slip (um) and share.

    Raises
    ------
    UserError
        The file can not be read or holds something else.
    """
    if not name:
        raise UserError("sim.law_table: law = 'table' needs a file of slip (um) and share of mu p; none is named")
    try:
        rows = np.loadtxt(name, delimiter=",", comments="#", ndmin=2)
    except (OSError, ValueError) as error:
        raise UserError(
            f"sim.law_table: {name} can not be read: {error}; write two columns of numbers, slip (um) and share of mu p"
        ) from None
    if rows.shape[1] != 2:
        raise UserError(f"sim.law_table: {name} has {rows.shape[1]} columns; write two, slip (um) and share of mu p")
    return tuple((float(slip) * 1e-6, float(share)) for slip, share in rows)


def expected_bytes(config: Config) -> int:
    """Size of the session that a run of these settings writes, within some ten per cent."""
    run = config.run
    seconds = run.background_time + 2.0 + run.settle_time + run.reference_time + run.travel / run.velocity * 1.06
    frames = seconds * config.forces.sample_rate / config.camera.divisor
    points = (config.camera.width // config.dic.step) * (config.camera.height // config.dic.step)
    return (
        int(frames * (config.camera.width * config.camera.height + 21 * points) + seconds * config.forces.sample_rate * 32) + RESERVE_BYTES
    )


def check_output(config: Config, output: Path, *, overwrite: bool) -> None:
    """Refuse, before anything moves, a session that can not be written.

    Raises
    ------
    UserError
        The file exists, its folder does not, or the disk has no room for the run.
    """
    if output.exists() and not overwrite:
        raise UserError(f"{output}: a session of that name exists; choose another name or give --overwrite")
    folder = output.parent
    if not folder.is_dir():
        raise UserError(f"{output}: the folder {folder} does not exist; create it or choose another")
    needed, free = expected_bytes(config), shutil.disk_usage(folder).free
    if needed > free:
        raise UserError(
            f"{output}: the run needs about {needed / 1e9:.2f} GB, the disk has {free / 1e9:.2f} GB free; make room or shorten run.travel"
        )


def prepare(config: Config, say: Callable[[str], None]) -> None:
    """Compile what these settings compile at first use, so that nothing does so during a run; cached for the next start.

    `say` is told what is at hand.
    """
    from drivers.sim.images import Renderer

    say("compiling the image correlation")
    dic.compile_kernels(correlation(config.dic))
    ring_means(np.ones(8), np.ones(8), 1.0, theta=np.ones(8))
    say("compiling the simulated camera")
    world = World(WorldSettings(image_shape=(64, 64), press_sample=0, press_duration=1), pace=None)
    world.start()
    world.advance(50)
    Renderer(world.settings).image(world.state(40), 0)
    say("opening the bench")


def make_bench(config: Config, pace: float | None) -> Bench:
    """The bench that the settings name, not yet open.

    Raises
    ------
    UserError
        The settings describe a world that can not be.
    """
    world = world_settings(config)
    try:
        return open_bench(config.forces.source, config.camera.source, config.actuator.source, world=world, pace=pace)
    except ValueError as error:
        raise UserError(f"[sim]: {error}") from None


def make_run(config: Config, output: Path, *, pace: float | None, overwrite: bool = False, bench: Bench | None = None) -> Run:
    """A run on the bench that the settings name; nothing is opened before its `start`.

    Parameters
    ----------
    pace : float or None
        Simulated seconds per second; None: as fast as the machine. A bench with a real device runs at 1.
    bench : Bench, optional
        The bench to use, made with `make_bench` from the same settings and pace.

    Raises
    ------
    UserError
        The session can not be written, or a device of that name is not known.
    """
    check_output(config, output, overwrite=overwrite)
    bench = bench or make_bench(config, pace)
    sources = (config.forces.source, config.camera.source, config.actuator.source)
    if pace != 1.0 and any(source != "sim" for source in sources):
        raise UserError(f"--pace: a bench with a real device runs at pace 1, not {'max' if pace is None else pace}")

    def create_sink(
        shape: tuple[int, int], dtype: np.dtype[Any], grid_x_px: NDArray[np.float64], grid_y_px: NDArray[np.float64]
    ) -> SessionWriter:
        return SessionWriter.create(
            output,
            config_toml=to_toml(config),
            sample_rate_hz=float(config.forces.sample_rate),
            frame_shape=shape,
            frame_dtype=dtype,
            exposure_samples=exposure_samples(config),
            divisor=config.camera.divisor,
            first_trigger=0,
            pixel_m=config.camera.pixel * 1e-6,
            grid_x_px=grid_x_px,
            grid_y_px=grid_y_px,
            versions=versions(),
            overwrite=overwrite,
        )

    title = "simulated bench" if set(sources) == {"sim"} else " + ".join(sources)
    return Run(config, bench, create_sink, free_running=pace is None, title=title, output=output, prepare=partial(prepare, config))
