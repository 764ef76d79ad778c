"""The move of `slipscope check --move`: the drive of a run, there and back, unrecorded."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from functools import partial

from analysis.options import quantity
from app.acquisition.control_loop import ControlLoop
from app.acquisition.force_reader import BenchDevices
from app.acquisition.watchdog import START_S
from app.evaluation.history import History
from app.experiment.decisions import ExperimentFailed
from app.records.record_types import Phase
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
    there_and_back = replace(config.run.as_planned, travel=way_m, reversals=1, steps=())
    config = replace(config, run=there_and_back)
    history = History(config.forces.sample_rate, config.exposure_samples)
    loop = ControlLoop(config, bench, history, pace=1.0)
    board, ask = bench.forces, loop.watchdog.ask
    ask(board.name, partial(board.start, TriggerTrain(0, config.camera.divisor)), START_S)
    try:
        there, took = _drive(loop)
    finally:
        if board.name not in loop.watchdog.given_up:
            ask(board.name, board.stop)
        loop.watchdog.close()
    return (
        f"{way_m * 1e6:g} um requested, {there * 1e6:.2f} um reached in {took:.1f} s,"
        f" {loop.stage.travel_m * 1e6:+.2f} um off after the way back"
    )


def _drive(loop: ControlLoop) -> tuple[float, float]:
    """How far the stage came before it turned, and how long that took."""
    experiment, stage, there, began, took = loop.experiment, loop.stage, 0.0, 0.0, 0.0
    try:
        stage.is_connected = True
        loop.watchdog.ask(stage.name, stage.arm)
        loop.reader.take()  # of the time before
        loop.watchdog.drives = True
        while experiment.phase is not Phase.END:
            measured = loop.reader.take()
            if loop.ending.is_called.is_set():
                raise DeviceError(loop.ending.reason)
            if measured is None:
                loop.reader.check_gaps()
                continue
            leg = experiment.leg
            if experiment.phase is Phase.DRIVE:
                experiment.advance(measured)
            else:  # the forces are known before anything moves
                experiment.begin_drive(measured)
                began = time.monotonic()
            if experiment.leg != leg:
                there, took = measured.travel_m, time.monotonic() - began
            loop.carry_out(measured.end_sample)
    except BaseException as error:
        with suppress(Exception):  # what became of it is told
            stage.stop()
        stage.confirm_stop()
        if isinstance(error, ExperimentFailed | DeviceError) and stage.may_move:
            raise DeviceError(f"{error}; {stage.answer_to_stop('').sentence}") from error
        raise
    return there, took
