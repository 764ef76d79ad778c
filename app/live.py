"""A live run from settings: the one place where engine, bench and session file are put together."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import quantity
from app.certificate import known
from app.engine.analyst import FrameAnalysis
from app.engine.intake import BenchDevices
from app.engine.run import Run
from app.engine.setup import header_of
from app.errors import UserError
from app.session.files import RESERVE_BYTES, check_new_session
from app.session.recorder import SessionRecorder, make_session
from app.session.versions import versions
from app.settings import Config
from drivers.bench import Bench
from drivers.bench import make_bench as bench_of
from drivers.settings import CameraSettings
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sources import DRIVERS, driver

if TYPE_CHECKING:
    from app.session.receipt import Receipt

THINNEST = 3  # pitches of a layer whose whole field of tractions can be found


def scenario(config: Config) -> Scenario:
    """What the simulated world of these settings is made of."""
    return Scenario.of(
        sim=config.sim,
        sample=config.sample,
        forces=config.forces,
        camera=config.camera,
        normal_force=config.run.normal_force,
    )


def make_bench(config: Config, pace: float | None) -> Bench:
    """The bench that the settings name, not yet open.

    Raises
    ------
    UserError
        The settings describe a world that can not be simulated.
    """
    recording = None
    if "replay" in config.sources:
        from app.session.recording import SessionRecording  # with HDF5

        recording = SessionRecording(Path(config.replay.session), pace)
    try:
        return bench_of(
            config.forces,
            config.camera,
            config.actuator,
            scenario=scenario(config),
            recording=recording,
            pace=pace,
        )
    except ValueError as error:
        raise UserError(f"[sim]: {error}") from None


def expected_bytes(config: Config) -> int:
    """Size of the session that a run of these settings writes, to within about ten per cent."""
    run, camera = config.run, config.camera
    waiting = run.background_time + 2.0 + run.settle_time + run.reference_time
    seconds = waiting + abs(run.travel) / run.velocity * 1.06
    points = (camera.width // config.dic.step) * (camera.height // config.dic.step)
    frame = camera.width * camera.height * camera.dtype.itemsize + 21 * points
    rate = config.frame_rate_hz * frame + config.forces.sample_rate * (
        32 + 8 * len(config.forces.auxiliary)
    )
    return int(seconds * rate) + RESERVE_BYTES


def check_room(config: Config, output: Path) -> None:
    """Refuse, before anything moves, a run for which the disk has no room.

    Raises
    ------
    UserError
    """
    needed, free = expected_bytes(config), shutil.disk_usage(output.parent).free
    if needed > free:
        raise UserError(
            f"{output}: the run needs about {needed / 1e9:.2f} GB, the disk has {free / 1e9:.2f} GB"
            " free; make room or shorten run.travel"
        )


def prepare(
    config: Config, prepare_analysis: Callable[[], object], say: Callable[[str], None]
) -> None:
    """Compile what a run of these settings uses, so that nothing compiles during the run; cached
    for the next start.

    `say` is called with what is being prepared.
    """
    if driver("camera", config.camera.source).nature in ("simulated", "emulated"):
        from drivers.sim.images import Renderer
        from drivers.sim.world import World

        say("compiling the simulated camera")
        small = Scenario(
            camera=CameraSettings(width=64, height=64),
            sim=SimSettings(press_time=0.0),
            press_samples=1,
        )
        world = World(small, pace=None)
        world.start()
        world.advance(50)
        Renderer(small).image(world.state(40), 0)
    say("compiling the image correlation")  # last: it may be done by now, in another process
    prepare_analysis()
    say("opening the bench")


def make_run(
    config: Config,
    output: Path,
    *,
    pace: float | None,
    overwrite: bool = False,
    bench: Bench | None = None,
    wrap: Callable[[BenchDevices], BenchDevices] | None = None,
    pipeline: FrameAnalysis | None = None,
    prepare_analysis: Callable[[], object] | None = None,
    make: Callable[[Path], tuple[Path, Receipt]] = make_session,
) -> Run:
    """A run on the bench that the settings name; nothing is opened before its `start`.

    Parameters
    ----------
    pace : float or None
        Simulated seconds per second; None: as fast as possible. A bench with a real device runs at
        1.
    bench : Bench, optional
        The bench to use, made with `make_bench` from the same settings and pace.
    wrap : callable, optional
        Makes of the bench the one that the run opens and closes.
    pipeline : FrameAnalysis, optional
        What analyses the frames, and `prepare_analysis` makes it ready; else a pipeline in this
        process.
    make : callable
        Makes the session of what was recorded: `app.session.recorder.SessionRecorder`.

    Raises
    ------
    UserError
        The session can not be written, or a device of that name is not known.
    """
    natures = check_run(config, output, pace, overwrite)
    bench = bench or make_bench(config, pace)
    if pipeline is None:
        from app.engine.compiling import compile_analysis
        from app.engine.pipeline import Pipeline

        pipeline, prepare_analysis = Pipeline(config), partial(compile_analysis, config)

    def create_sink() -> SessionRecorder:
        return SessionRecorder.create(
            output, header_of(config, versions() | known(config)), overwrite=overwrite, make=make
        )

    return Run(
        config,
        wrap(bench) if wrap else bench,
        create_sink,
        pipeline,
        pace=pace,
        title="simulated bench" if natures == {"simulated"} else " + ".join(config.sources),
        output=output,
        prepare=partial(prepare, config, prepare_analysis or (lambda: None)),
    )


def check_run(config: Config, output: Path, pace: float | None, overwrite: bool) -> set[str]:
    """The natures of the devices (`drivers.bench.NEEDS`) of a run that can be made.

    Raises
    ------
    UserError
        As `make_run`.
    """
    check_new_session(output, overwrite, has_picture=False)
    check_room(config, output)
    kinds = zip(DRIVERS, config.sources, strict=True)
    natures = {driver(kind, source).nature for kind, source in kinds}
    forces, sample, dic = config.forces, config.sample, config.dic
    if forces.block >= config.limits.age * forces.sample_rate * (pace or 1.0):
        raise UserError(
            f"forces.block = {forces.block} samples last longer than limits.age ="
            f" {quantity(config.limits, 'age')}; read fewer at a time"
        )
    pitch = dic.step * config.camera.pixel
    thinnest = pitch * (THINNEST if config.stress.field else 1)
    if config.stress.method != "none" and 0 < sample.thickness < thinnest:
        raise UserError(
            f"sample.thickness = {quantity(sample, 'thickness')} is too thin for a shear traction"
            f" on points that are {pitch * 1e6:g} um apart; use {thinnest * 1e3:g} mm or more, 0"
            " for a half-space, or stress.method = 'none'"
        )
    if config.run.travel < 0 and not {"simulated", "emulated"}.isdisjoint(natures):
        raise UserError(
            f"run.travel = {quantity(config.run, 'travel')} goes against +x, which the simulated"
            " world does not model; give a travel above 0, or real devices"
        )
    if pace != 1.0 and "real" in natures:
        raise UserError(
            "--pace: a bench with a real device runs at pace 1, not"
            f" {'max' if pace is None else pace}"
        )
    if pace is None and "emulated" in natures:
        raise UserError(
            "--pace: only simulated and recorded devices wait for the program, as pace max needs;"
            " give a number"
        )
    return natures
