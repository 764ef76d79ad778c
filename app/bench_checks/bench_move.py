"""The move of `slipscope check --move`: there and back, within the limits of a run, with the forces
watched meanwhile.
"""

from __future__ import annotations

import time
from dataclasses import replace

from analysis.options import quantity
from app.acquisition.ending import Ending
from app.acquisition.force_reader import BenchDevices, ForceReader
from app.acquisition.stage import Stage
from app.acquisition.watchdog import Watchdog
from app.evaluation.history import History
from app.experiment.decisions import Experiment, ExperimentFailed
from app.records.record_types import Phase, Record
from app.settings.sections import Config
from drivers.errors import DeviceError, OutOfLimits
from drivers.protocols import TriggerTrain


def move(config: Config, bench: BenchDevices, way_m: float) -> str:
    """Move the stage there and back, and compare the distances.

    Raises
    ------
    OutOfLimits
        The way is beyond ``limits.travel`` or the travel of the stage; nothing moved.
    DeviceError
        A force reached its limit or was not read, or the stage failed; it was stopped.
    """
    if abs(way_m) > config.limits.travel:
        raise OutOfLimits(
            f"--move: {way_m * 1e6:g} um was asked, limits.travel is"
            f" {quantity(config.limits, 'travel')}; move less, or raise that limit"
        )
    if config.actuator.source == "replay":
        raise DeviceError(
            f"{bench.actuator.name}: --move was asked, and a recorded stage goes where it was"
            " recorded; choose another actuator.source"
        )
    bench.forces.start(TriggerTrain(0, config.camera.divisor))
    try:
        start, began = bench.actuator.position_m(), time.monotonic()
        there = _go(config, bench, way_m)
        took = time.monotonic() - began
        left = _go(config, bench, start - there) - start
    finally:
        bench.forces.stop()
    return (
        f"{way_m * 1e6:g} um requested, {(there - start) * 1e6:.2f} um reached in {took:.1f} s,"
        f" {left * 1e6:+.2f} um off after the way back"
    )


class _Unrecorded:
    """Takes the place of the recorder."""

    def append(self, record: Record) -> None:
        del record


def _go(config: Config, bench: BenchDevices, way_m: float) -> float:
    """Where the stage stands after a move, whose end is waited for, as the drive of a run."""
    run = replace(config.run, travel=way_m, reversals=0, steps=())
    config = replace(config, run=run)
    stage, experiment = Stage(config, bench), Experiment(config)
    ending = Ending(stage.stop)
    watchdog = Watchdog(ending, config.limits.age, is_direct=False)
    history = History(experiment.rate, config.exposure_samples)
    force_reader = ForceReader(config, bench, stage, history, watchdog, pace=1.0)
    try:
        stage.arm()
        stage.aim()
        force_reader.take(_Unrecorded())  # of the time before
        watchdog.drives = True
        while experiment.phase is not Phase.END:
            measured = force_reader.take(_Unrecorded())
            if ending.is_called.is_set():
                raise DeviceError(f"{ending.reason}; it was stopped")
            if measured is None:
                continue
            if experiment.phase is not Phase.DRIVE:  # the forces are known before anything moves
                experiment.begin_drive(measured)
                stage.drive()
            else:
                experiment.advance(measured)
        return stage.start_m + stage.travel_m
    except ExperimentFailed as error:
        stage.stop()
        raise DeviceError(f"{error}; it was stopped") from error
    except BaseException:
        stage.stop()
        raise
    finally:
        watchdog.close()
