"""The commands of the same names, as functions that give objects and files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from app.files.exporting import export
from app.system.algebra_threads import one_algebra_thread
from app.system.errors import UserError
from slipscope.notebook import Session
from slipscope.results_notebook import Results

__all__ = ["UserError", "analyze", "export", "figures", "run"]


@one_algebra_thread()
def run(
    output: str | os.PathLike[str],
    bench: str | os.PathLike[str] | None = None,
    settings: Sequence[str] = (),
    *,
    faults: Sequence[str] = (),
    pace: float | None = None,
    timeout_s: float | None = None,
    overwrite: bool = False,
) -> Session:
    """Run the protocol of a bench to its end; the session that it wrote, also of a run that failed:
    see its `state` and `reason`.

    ``slipscope stop``, a window's STOP and ``slipscope attach`` reach it as a run of the command
    ``slipscope run``. No supervisor process stands by: for a stage that can do harm use that one.

    Parameters
    ----------
    output : str or Path
        Session to write, with the ending .h5.
    bench : str or Path, optional
        Settings file, or a bench that comes with the program: ``"hil-emulated"``,
        ``"slide-hold-slide"``, ``"cyclic-shear"``; default: the simulated bench.
    settings : sequence of str
        ``"run.travel=30"``, as for ``--set``; units as ``slipscope config`` shows them.
    faults : sequence of str
        What goes wrong, in the time of the bench: ``"lost-trigger 4.2s 3"``, seconds from the
        first sample, or ``"lost-trigger 40 3"``, a number; ``"stall 12"``, um of travel.
        docs/bench.md lists them.
    pace : float, optional
        Seconds of the bench per second; default: as fast as its devices allow, which is 1 with any
        real or emulated one.
    timeout_s : float, optional
        Seconds after which the run is stopped; default: no limit.

    Raises
    ------
    UserError
        The settings cannot be used, or the session cannot be written.
    RuntimeError
        The run did not begin; the message is its reason.
    TimeoutError
        The time was over; the run was stopped properly, and its session is there.

    Examples
    --------
    >>> import slipscope, tempfile, pathlib
    >>> small = ["camera.width=320", "camera.height=240", "run.travel=4", "stress.method=none"]
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "sample7.h5"
    >>> with slipscope.run(path, settings=small, faults=["lost-trigger 0.7s"]) as s:
    ...     print(s.state, s.reason, [number for number, *_ in s.lost_frames])
    done the drive of 4 um is complete [6]
    """
    from app.processes.bench import known
    from app.runs import live
    from app.settings import config
    from drivers.sim.faults import timed
    from drivers.sources import natures_of

    path, source = Path(output), None if bench is None else Path(bench)
    held = config.load(source, settings)
    if faults:
        rate_hz, divisor = held.forces.sample_rate, held.camera.divisor
        try:
            scripted = [timed(fault, rate_hz, divisor) for fault in faults]
        except ValueError as error:
            raise UserError(f"faults: {error}") from None
        held = config.load(source, [*settings, f"sim.faults={scripted}"])
    if pace is None and not natures_of(held.sources).isdisjoint(("real", "emulated")):
        pace = 1.0
    under_way = live.make_run(held, path, pace=pace, overwrite=overwrite)
    with known(under_way):
        try:
            under_way.start()
            outcome = under_way.wait(timeout_s)
        except BaseException:
            under_way.request_stop("the program that runs it was interrupted")
            under_way.wait()
            raise
        if outcome is None:
            under_way.request_stop(f"it was not over after {timeout_s:g} s")
            under_way.wait()
            raise TimeoutError(
                f"{path}: the run was not over after {timeout_s:g} s and was stopped"
            )
    if not path.exists():
        raise RuntimeError(f"{path}: the run did not begin: {outcome.reason}")
    return Session(path)


@one_algebra_thread()
def analyze(
    sessions: Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    settings: Sequence[str] = (),
    *,
    preset: str = "finest",
    jobs: int = 0,
    overwrite: bool = False,
) -> Results:
    """Analyse sessions of one bench and one sample, and what they have in common.

    Finished parts are kept beside the results: after an interruption the same call continues. The
    results do not depend on `jobs`, to the bit.

    Parameters
    ----------
    sessions : iterable of str or Path
        Files that `run` or ``slipscope run`` wrote.
    output : str or Path
        File of results to write, with the ending .h5.
    settings : sequence of str
        ``"dic.box=32"``: other settings for the analysis, as for ``--set``.
    preset : str
        Of the image correlation: ``"finest"``, ``"accurate"``, ``"fast"``, or ``"session"``, that
        of the settings of each.
    jobs : int
        Sessions at a time, each in a process of its own; 0: as many as processors and memory allow.

    Raises
    ------
    UserError
        A session cannot be analysed, two do not go together, or the results cannot be written.
    RuntimeError
        Some sessions could not be analysed; the message says which and why.

    Examples
    --------
    >>> results = slipscope.analyze(Path("six").glob("*.h5"), "results.h5")  # doctest: +SKIP
    >>> results.joint.young_modulus_pa  # doctest: +SKIP
    3400000.0
    """
    from app.cli.analyze import check_preset, most_jobs
    from app.study.analysis_plan import plan_analysis
    from app.study.analyzing import analyze as analyze_plan

    check_preset(preset)
    paths = [Path(session) for session in sessions]
    plan = plan_analysis(
        paths, Path(output), preset=preset, overrides=settings, overwrite=overwrite
    )
    analyze_plan(plan, jobs=jobs or most_jobs(len(plan.tasks)), overwrite=overwrite)
    return Results(plan.output)


@one_algebra_thread()
def figures(
    results: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    only: Iterable[str | int] = (),
    *,
    formats: Sequence[str] = ("png", "pdf"),
    width: float = 0.0,
    colours: str = "paper",
    style: str | os.PathLike[str] = "",
    overwrite: bool = False,
) -> dict[str, list[Path]]:
    """Draw the figures of the paper from a file of results, with their data, summary.json and a
    report.

    Parameters
    ----------
    results : str or Path
        What `analyze` wrote.
    folder : str or Path
        Where the files go.
    only : iterable of str or int
        Numbers or names of figures, such as ``[5, "6a", "law"]``; none: all.
    formats : sequence of str
        png, pdf, svg, ... of each figure.
    width : float
        Of every figure, 60 to 400 mm; 0: 88 (a column) for one panel, 180 (a page) for several.
    colours : str
        ``"paper"``, ``"even"`` (also for the colour-blind) or ``"grey"``.
    style : str or Path
        A style sheet of matplotlib beside ours: its name or its file.

    Returns
    -------
    dict
        Name of each figure that was drawn -> its files, the tables (.csv) last.

    Raises
    ------
    UserError
        There is no such figure, format or look, nothing can be drawn, or the folder exists.

    Examples
    --------
    >>> drawn = slipscope.figures("results.h5", "paper", [5, "6a"])  # doctest: +SKIP
    >>> [path.name for path in drawn["5"]]  # doctest: +SKIP
    ['fig05.png', 'fig05.pdf', 'fig05.csv']
    """
    from app.cli.figure_files import chosen, looks, write_figures

    names, kinds = chosen((), [str(one) for one in only], formats)
    look, folder = looks(width, colours, os.fspath(style)), Path(folder)
    data = write_figures(Path(results), folder, names, kinds, overwrite=overwrite, look=look)
    drawn = data["figures"].items()
    return {name: [folder / file for file in one.get("files", ())] for name, one in drawn}
