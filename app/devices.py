"""The bench that the settings name."""

from __future__ import annotations

from pathlib import Path

from app.errors import UserError
from app.session.recording import SessionRecording
from app.settings import Config
from drivers import bench
from drivers.sim.scenario import Scenario


def scenario(config: Config) -> Scenario:
    """What the simulated world of these settings is made of."""
    return Scenario(
        sim=config.sim,
        sample=config.sample,
        forces=config.forces,
        camera=config.camera,
        normal_force=config.run.normal_force,
    )


def make_bench(config: Config, pace: float | None) -> bench.Bench:
    """The bench that the settings name, not yet open.

    Raises
    ------
    UserError
        The settings describe a world that can not be simulated.
    """
    is_played = "replay" in config.sources
    try:
        return bench.make_bench(
            config.forces,
            config.camera,
            config.actuator,
            scenario=scenario(config),
            recording=SessionRecording(Path(config.replay.session), pace) if is_played else None,
            pace=pace,
        )
    except ValueError as error:
        raise UserError(f"[sim]: {error}") from None
