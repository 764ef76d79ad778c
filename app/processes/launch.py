"""Where a run goes: into processes of its own, or into this one; and the way to one that is under
way.
"""

from __future__ import annotations

from pathlib import Path

from app.engine.run import Run
from app.errors import UserError
from app.processes.calls import Gone
from app.processes.client import LaunchedRun, RemoteRun
from app.processes.folder import running
from app.settings import Config


def launched_or_made(
    config: Config, output: Path, pace: float | None, overwrite: bool
) -> LaunchedRun | Run:
    """A run, not yet started: on a bench of its own, or in this process if it goes as fast as
    possible (`pace` None), where nothing has to be isolated.

    Raises
    ------
    UserError, DeviceError
        The run can not be made.
    """
    if pace is None:
        from app.live import make_run

        return make_run(config, output, pace=None, overwrite=overwrite)
    return LaunchedRun(config, output, pace=pace, overwrite=overwrite)


def attached(name: str | None) -> RemoteRun:
    """The run that is under way on this computer.

    Parameters
    ----------
    name : str or None
        Of the bench or of its session, whole or in part; None where only one runs.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    benches = running()
    if not benches:
        raise UserError("attach: no bench of yours runs on this computer; slipscope run starts one")
    wanted = [b for b in benches if not name or name == b.name or name in b.session]
    if len(wanted) != 1:
        which = f"{name} is the name of" if name else "there are"
        names = ", ".join(f"{b.name} ({b.title}, {Path(b.session).name})" for b in benches)
        raise UserError(f"attach: {which} {len(wanted)} running benches; name one of: {names}")
    try:
        return RemoteRun(wanted[0])
    except Gone as error:
        raise UserError(f"attach: the bench {wanted[0].name} has just ended ({error})") from error
