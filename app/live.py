"""A live run from settings: the one place where engine, bench and session file are put together."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from analysis import dic
from analysis.contact.rings import ring_means
from app.config import pixel_type, tracking
from app.devices import is_unreal, make_bench, sources_of
from app.engine.pipeline import header_of
from app.engine.run import Run
from app.errors import UserError
from app.sections import Config
from app.session.files import RESERVE_BYTES
from app.session.versions import versions
from app.session.writer import SessionWriter
from drivers.bench import Bench


def expected_bytes(config: Config) -> int:
    """Size of the session that a run of these settings writes, within some ten per cent."""
    run = config.run
    seconds = (
        run.background_time
        + 2.0
        + run.settle_time
        + run.reference_time
        + run.travel / run.velocity * 1.06
    )
    frames = seconds * config.forces.sample_rate / config.camera.divisor
    points = (config.camera.width // config.dic.step) * (config.camera.height // config.dic.step)
    return (
        int(
            frames
            * (
                config.camera.width * config.camera.height * pixel_type(config).itemsize
                + 21 * points
            )
            + seconds * config.forces.sample_rate * 32
        )
        + RESERVE_BYTES
    )


def check_output(config: Config, output: Path, *, overwrite: bool) -> None:
    """Refuse, before anything moves, a session that can not be written.

    Raises
    ------
    UserError
        The file exists, its folder does not, or the disk has no room for the run.
    """
    if output.exists() and not overwrite:
        raise UserError(
            f"{output}: a session of that name exists; choose another name or give --overwrite"
        )
    folder = output.parent
    if not folder.is_dir():
        raise UserError(
            f"{output}: the folder {folder} does not exist; create it or choose another"
        )
    needed, free = expected_bytes(config), shutil.disk_usage(folder).free
    if needed > free:
        raise UserError(
            f"{output}: the run needs about {needed / 1e9:.2f} GB, the disk has {free / 1e9:.2f} GB"
            " free; make room or shorten run.travel"
        )


def prepare(config: Config, say: Callable[[str], None]) -> None:
    """Compile what these settings compile at first use, so that nothing does so during a run;
    cached for the next start.

    `say` is told what is at hand.
    """
    say("compiling the image correlation")
    dic.compile_kernels(tracking(config))
    ring_means(np.ones(8), np.ones(8), 1.0, theta=np.ones(8))
    if is_unreal(config.camera.source):
        from drivers.sim.images import Renderer
        from drivers.sim.world import World, WorldSettings

        say("compiling the simulated camera")
        world = World(
            WorldSettings(image_shape=(64, 64), press_sample=0, press_duration=1), pace=None
        )
        world.start()
        world.advance(50)
        Renderer(world.settings).image(world.state(40), 0)
    say("opening the bench")


def make_run(
    config: Config,
    output: Path,
    *,
    pace: float | None,
    overwrite: bool = False,
    bench: Bench | None = None,
) -> Run:
    """A run on the bench that the settings name; nothing is opened before its `start`.

    Parameters
    ----------
    pace : float or None
        Simulated seconds per second; None: as fast as the machine. A bench with a real device runs
        at 1.
    bench : Bench, optional
        The bench to use, made with `make_bench` from the same settings and pace.

    Raises
    ------
    UserError
        The session can not be written, or a device of that name is not known.
    """
    check_output(config, output, overwrite=overwrite)
    bench = bench or make_bench(config, pace)
    sources = sources_of(config)
    if pace != 1.0 and not all(is_unreal(source) or source == "replay" for source in sources):
        raise UserError(
            "--pace: a bench with a real device runs at pace 1, not"
            f" {'max' if pace is None else pace}"
        )
    if pace is None and not set(sources) <= {"sim", "replay"}:
        raise UserError(
            "--pace: only simulated and recorded devices wait for the program, as pace max needs;"
            " give a number"
        )

    def create_sink() -> SessionWriter:
        return SessionWriter.create(output, header_of(config, versions()), overwrite=overwrite)

    title = "simulated bench" if set(sources) == {"sim"} else " + ".join(sources)
    return Run(
        config,
        bench,
        create_sink,
        free_running=pace is None,
        title=title,
        output=output,
        prepare=partial(prepare, config),
    )
