"""A live run from settings: the one place where bench, analysis and session file are put
together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from analysis.options import quantity
from analysis.region import measured
from app.acquisition.connected_bench import Preview
from app.acquisition.force_reader import BenchDevices
from app.acquisition.run import Run
from app.evaluation.frame_analysis import FrameAnalysis
from app.evaluation.setup import bytes_per_s, grid_of, header_of, pattern_of
from app.session.files import RESERVE_BYTES, check_new_session
from app.session.recorder import SessionMaker, SessionRecorder, make_session
from app.session.versions import versions
from app.settings.certificates import calibration_records
from app.settings.hung_weights import hung_weights, pressed_loads
from app.settings.protocol_steps import (
    APPROACH_S,
    SLACK,
    Approach,
    Ask,
    Background,
    Hold,
    Motion,
    Zero,
    durations,
    legs,
)
from app.settings.sections import Config
from app.settings.sync_certificate import certificate_record
from app.system.disk import free_bytes, largest_file
from app.system.errors import UserError
from drivers.bench import Bench, make_bench as bench_of
from drivers.settings import CameraSettings
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sources import driver, natures_of

FREE_S = 10.0  # a simulated bench that is previewed is free so long, to be zeroed
NEVER_S = 86400.0
THINNEST = 3  # pitches of a layer whose whole field of tractions can be found


def unpressed(config: Config) -> Config:
    """The settings, but that nobody presses the contact of a simulated world: a block that hangs
    free may move, and its forces are those of the sensors.
    """
    return replace(config, sim=replace(config.sim, press_time=NEVER_S))


def scenario(config: Config) -> Scenario:
    """What the simulated world of these settings is made of; nobody presses the contact where no
    step asks for it.
    """
    steps = config.run.protocol
    pressed = _pressed(config)
    (_, load), *later = pressed or [(0.0, config.run.normal_force)]
    sim, rate = config.sim, config.forces.sample_rate
    return Scenario.of(
        sim=sim if pressed else unpressed(config).sim,
        sample=config.sample,
        forces=config.forces,
        camera=config.camera,
        normal_force=load,
        loads=tuple((round(sim.press_time * rate + after), load) for after, load in later),
        longest_hold=max((step.time for step in steps if isinstance(step, Hold)), default=0.0),
        weights=hung_weights(steps, rate, config.forces.block),
    )


def _pressed(config: Config) -> list[tuple[float, float]]:
    """See `pressed_loads`."""
    return pressed_loads(config.run.protocol, config.forces.sample_rate, config.run.settle_time)


def make_bench(config: Config, pace: float | None) -> Bench:
    """The bench that the settings name, not yet open.

    Raises
    ------
    UserError
        The settings describe a world that cannot be simulated.
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


def expected_seconds(config: Config) -> float:
    """How long a run of these settings takes on the bench, to within about ten per cent, if nobody
    is waited for.
    """
    run, seconds = config.run, 0.0
    for step, planned in zip(run.protocol, durations(run.protocol), strict=True):
        if isinstance(step, Approach):
            seconds += APPROACH_S + run.settle_time
        elif not isinstance(step, Ask):
            seconds += planned * (SLACK if isinstance(step, Motion) else 1.0)
    return seconds


def expected_bytes(config: Config) -> int:
    """Size of the session that a run of these settings writes, to within about ten per cent."""
    return int(expected_seconds(config) * bytes_per_s(config)) + RESERVE_BYTES


def previewed(config: Config) -> Config:
    """The settings whose simulated world a preview shows: its operator takes `FREE_S` before the
    contact is pressed, and the contact can be sheared both ways.
    """
    sim = config.sim
    law = "elasto-plastic" if sim.law == "cattaneo-mindlin" else sim.law
    return replace(config, sim=replace(sim, law=law, press_time=max(FREE_S, sim.press_time)))


def make_preview(
    config: Config,
    *,
    pace: float = 1.0,
    guard: Callable[[Bench, Preview], None] = lambda bench, preview: None,
) -> Preview:
    """The bench that the settings name, to be looked at without a run; nothing is opened before its
    `start`.

    Parameters
    ----------
    pace : float
        Simulated seconds per second.
    guard : callable
        Called once before the stage is moved for the first time.

    Raises
    ------
    UserError, DeviceError
        There is no such bench.
    """
    bench = make_bench(previewed(config), pace)
    preview = Preview(
        config,
        bench,
        guard=lambda: guard(bench, preview),
        can_restart=bench.world is None,
        bytes_per_s=bytes_per_s(config),
    )
    return preview


def check_room(config: Config, output: Path) -> None:
    """Refuse, before anything moves, a run for which the disk has no room, or whose session would
    be a larger file than it can hold. How small compressed images are is known only as they come:
    of them the recorder alone says when the file is too large.

    Raises
    ------
    UserError
    """
    needed, free = expected_bytes(config), free_bytes(output)
    needs = f"{output}: the run needs about {needed / 1e9:.2f} GB"
    shorten = f"shorten {'run.steps' if config.run.steps else 'run.travel'}"
    if needed > free:
        raise UserError(f"{needs}, the disk has {free / 1e9:.2f} GB free; make room or {shorten}")
    largest, limit = largest_file(output)
    if needed > largest and config.recording.compression == "none":
        raise UserError(
            f"{needs}, and {limit} takes no file above {largest / 1e9:.2f} GB; record to another"
            f" disk or {shorten}"
        )


def prepare(
    config: Config, prepare_analysis: Callable[[], object], say: Callable[[str], None]
) -> None:
    """Compile what a run of these settings uses, so that nothing compiles during the run; cached
    for the next start.

    `say` is called with what is being prepared.
    """
    if driver("camera", config.camera.source).nature in ("simulated", "emulated"):
        say("compiling the simulated camera")
        _compile_camera()
    say("compiling the image correlation")  # last: it may be done by now, in another process
    prepare_analysis()
    say("opening the bench")


@cache
def _compile_camera() -> None:
    """Draw one small picture: of smooth, rigid faces, which are solved in no time."""
    from drivers.sim.images import Renderer
    from drivers.sim.world import World

    small = Scenario(
        camera=CameraSettings(width=64, height=64),
        sim=SimSettings(press_time=0.0, law="cattaneo-mindlin", pressure="hertz"),
        press_samples=1,
    )
    world = World(small, pace=None)
    world.start()
    world.advance(50)
    Renderer(small).image(world.state(40), 0)


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
    make: SessionMaker = make_session,
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
        An `app.session.recorder.SessionMaker`.

    Raises
    ------
    UserError
        The session cannot be written, or a device of that name is not known.
    """
    natures = check_run(config, output, pace, overwrite)
    bench = bench or make_bench(config, pace)
    if pipeline is None:
        from app.evaluation.compiling import compile_analysis
        from app.evaluation.pipeline import Pipeline

        pipeline = Pipeline(config, pattern_of(config))
        prepare_analysis = partial(compile_analysis, config)

    def create_sink() -> SessionRecorder:
        return SessionRecorder.create(
            output,
            header_of(
                config,
                versions() | certificate_record(config) | calibration_records(config),
                pattern=pipeline.pattern,
            ),
            overwrite=overwrite,
            make=make,
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


def _check_world(config: Config, natures: set[str]) -> None:
    """Refuse a protocol that the simulated world does not model."""
    run, sim = config.run, config.sim
    if {"simulated", "emulated"}.isdisjoint(natures):
        return
    if run.direction < 0:
        what = (
            "the first motion of run.steps"
            if run.steps
            else f"run.travel = {quantity(run, 'travel')}"
        )
        raise UserError(
            f"{what} goes against +x, which the simulated"
            " world does not model; give a travel above 0, or real devices"
        )
    if config.actuator.source != "sim":
        return
    back = next((leg for leg in legs(run.protocol, as_planned=True) if leg.end < leg.start), None)
    if back and sim.law != "elasto-plastic":
        step = run.protocol[back.number - 1]
        raise UserError(
            f"step {back.number} ({step.kind}) of the run goes back, which the simulated contact"
            f" does not know under the law '{sim.law}'; use sim.law = 'elasto-plastic'"
        )
    moves = (type(step) for step in run.protocol if isinstance(step, Approach | Motion))
    if sim.pressure == "jkr" and {Approach} < {*moves}:
        raise UserError(
            "the run moves the stage in contact, and faces that adhere (sim.pressure = 'jkr') are"
            " not driven; use 'hertz' or 'greenwood-tripp'"
        )
    if not run.steps:
        return
    loads = {step.normal_force for step in run.protocol if isinstance(step, Approach)}
    if len(loads) > 1 and len(_pressed(config)) == 1:
        raise UserError(
            f"run.steps approach {len(loads)} different loads; the simulated operator presses to"
            " several only where nothing is moved or asked; give one approach, or real sensors"
        )
    until_s = 0.0
    for number, step in enumerate(run.protocol, 1):
        if isinstance(step, Approach):
            return
        until_s += step.timeout if isinstance(step, Ask) else durations([step])[0]
        if until_s > sim.press_time and isinstance(step, Background | Zero):
            raise UserError(
                f"step {number} ({step.kind}) lasts until {until_s:g} s, and the simulated"
                f" operator presses at sim.press_time = {quantity(sim, 'press_time')}; raise it"
            )


def check_run(config: Config, output: Path, pace: float | None, overwrite: bool) -> set[str]:
    """The natures of the devices of a run that can be made, see `drivers.sources`.

    Raises
    ------
    UserError
        As `make_run`.
    """
    check_new_session(output, overwrite, has_picture=False)
    check_room(config, output)
    natures = natures_of(config.sources)
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
    grid = grid_of(config)
    if not measured(dic.polygons, grid.x_px, grid.y_px[:, None]).any():
        raise UserError(
            f"dic.region: no box of {dic.box} px has its centre in it; widen it, or leave it out"
        )
    _check_world(config, natures)
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
