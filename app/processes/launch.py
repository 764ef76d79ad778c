"""Where a run goes: into processes of its own, or into this one; and the way to one that is under
way.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path

from app.acquisition.run import Run
from app.processes.calls import Gone, Silent
from app.processes.client import LaunchedRun, RemoteRun
from app.processes.folder import RunningBench, reachable, running, running_as
from app.processes.urgent import stopped
from app.settings.sections import Config
from app.system.errors import UserError
from app.system.stopping import StopAnswer

LOG = logging.getLogger(__name__)


def launched_or_made(
    config: Config, output: Path, pace: float | None, overwrite: bool
) -> LaunchedRun | Run:
    """A run, not yet started: on a bench of its own, or in this process if it goes as fast as
    possible (`pace` None), where nothing has to be isolated.

    Raises
    ------
    UserError, DeviceError
        The run cannot be made.
    """
    if pace is None:
        from app.runs.live import make_run

        return make_run(config, output, pace=None, overwrite=overwrite)
    return LaunchedRun(config, output, pace=pace, overwrite=overwrite)


def under_way() -> list[RunningBench]:
    """The benches of this user whose stage may move, the oldest first; those that do not answer are
    among them.
    """

    def may_move(bench: RunningBench) -> bool:
        try:
            return RemoteRun(bench).look().health.state in ("armed", "running", "stopping")
        except Gone:
            return False
        except Silent:
            return True

    return [bench for bench in running() if may_move(bench)]


def stopped_but(names: Collection[str]) -> list[StopAnswer]:
    """Stop the motion of all benches of this user, with a run or without one, but those of these
    names; see `stopped`.
    """
    return stopped([bench for bench in reachable() if bench.name not in names])


def attached(name: str | None, who: str = "attach") -> RemoteRun:
    """The run that is under way on this computer.

    Parameters
    ----------
    name : str or None
        Of the bench or of its session, whole or in part; None where only one runs.
    who : str
        What asks, for error sentences.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    wanted = running_as(name, who)
    try:
        return RemoteRun(wanted)
    except Gone as error:
        raise UserError(f"{who}: the bench {wanted.name} has just ended ({error})") from error
