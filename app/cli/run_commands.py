"""The commands of `slipscope` that run experiments, show them, and replay what was recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from app.cli import completion
from app.cli.command_options import (
    Bench,
    Headless,
    JsonFlag,
    Overrides,
    Overwrite,
    Pace,
    SessionFile,
    command,
    option_of,
    output_file,
)
from app.cli.names import parse_pace
from app.system.errors import UserError

app = Typer()

NAME_OF_BENCH = "Name of the bench or of its session; needed if several are running."
BenchName = Annotated[
    str | None, Argument(metavar="[BENCH]", help=NAME_OF_BENCH, show_default=False)
]
RunningBench = Annotated[str | None, Option("--bench", help=NAME_OF_BENCH)]


@command(app)
def run(
    bench: Bench = None,
    session: Annotated[
        Path | None,
        output_file(
            "SESSION.h5", "Session to write; default: slipscope-DATE-TIME.h5 in this folder."
        ),
    ] = None,
    headless: Headless = False,
    pace: Pace = "1",
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Run one loading experiment: press the contact, take the reference, drive, report.

    Writes the session (HDF5, NeXus style) and a picture of the same name (.png): Q against the
    stage displacement, the stick radius c against Q, u_x in time, and the u_x field at six
    instants. Finally prints a, Q_s, mu_s, mu_d, t_s and the account of all frames and samples.
    Ctrl-C stops the block first, then closes the session; all measured data are kept.

    Example (N and um): `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7 --set
    run.travel=200`
    """
    from app.cli.run_and_replay import WindowStart, run_and_report
    from app.settings.config import load

    start = WindowStart(load(bench, overrides or ()), session, parse_pace(pace), overwrite)
    return run_and_report(start, headless, as_json)


@command(app)
def campaign(
    file: Annotated[
        Path,
        Argument(
            metavar="CAMPAIGN.toml",
            help="File of the campaign, such as `slipscope config six-loads` prints; or six-loads.",
            autocompletion=completion.files(".toml", campaigns=True),
        ),
    ],
    folder: Annotated[
        Path | None,
        output_file(
            "FOLDER", "Folder for the sessions and the page; default: the name of the campaign."
        ),
    ] = None,
    headless: Headless = False,
    pace: Pace = "1",
    only: Annotated[
        list[str] | None,
        Option(
            metavar="RUN",
            help="Only these runs: 3, 2-4, or a name such as '*-0.5N'; may be repeated.",
        ),
    ] = None,
    retry: Annotated[
        bool, Option("--retry", help="Repeat failed runs; their earlier files are kept.")
    ] = False,
    checks_only: Annotated[
        bool, Option("--check", help="Check everything and list the runs; do none.")
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Run experiments over loads, velocities, samples and repeats, one after the other; completed
    runs are skipped.

    Everything is checked before anything moves. On a real bench, the program says before each run
    what to do, and waits for the operator. Ctrl-C stops the motion, then ends the campaign; the
    same command resumes it, also after a kill or a power cut. Nothing is replaced: earlier files of
    a repeated run go to FOLDER/kept. FOLDER/index.html shows the progress. The exit code is 1 if a
    run is not complete.

    Example: `slipscope campaign six-loads --pace max`
    """
    from app.campaigns.plan import read_campaign, select_runs
    from app.campaigns.state import alone_in, keep_copy
    from app.cli.campaign import CampaignWork
    from app.cli.run_and_replay import window_problem
    from app.cli.terminal import say

    plan, speed = read_campaign(file, folder, overrides or ()), parse_pace(pace)
    wanted = select_runs(plan, only or ())
    problem = window_problem(headless)
    with alone_in(plan.folder):
        work = CampaignWork(plan, speed, problem, as_json)
        due = work.due(wanted, retry)
        work.check(due)
        if not checks_only:
            if keep_copy(plan):
                say(
                    f"{file} has changed since {plan.folder} was begun: {work.progress().done} of"
                    " its runs are done as it says now"
                )
            if problem and not as_json:
                say(f"{problem} (going on without a window)")
                work.problem = ""
            work.draw_missing(wanted)
            work.go_through(due)
        return work.report(wanted, checks_only)


@command(app)
def attach(
    bench: BenchName = None,
    headless: Headless = False,
    as_json: JsonFlag = False,
) -> int:
    """Open a window on the current run of this computer, even if its own window is gone.

    Closing this window, or Ctrl-C, does not affect the run; the buttons of the window do.

    Example: `slipscope attach`
    """
    from app.cli.run_and_replay import print_reports, run_to_end, window_problem
    from app.processes.prepared import attached_run

    problem = window_problem(headless)
    made = attached_run(bench)
    return print_reports(run_to_end(lambda: made, problem, as_json=as_json), as_json)


@command(app)
def stop(bench: BenchName = None) -> int:
    """Stop the motion of the named run, then close its session; without a name, stop every bench of
    yours on this computer: runs, benches connected without a run, checks that move a stage.

    Example: `slipscope stop`
    """
    from app.cli.terminal import DONE, FAILED, say
    from app.processes.urgent import stop as stop_at_once

    sentences, has_failed = stop_at_once(bench)
    for sentence in sentences:
        say(sentence)
    return FAILED if has_failed else DONE


@command(app)
def answer(
    text: Annotated[str, Argument(metavar="[TEXT]", help="The recorded answer.")] = "yes",
    bench: RunningBench = None,
) -> int:
    """Answer the question of a step (`do = "ask"`) of the current run on this computer.

    Example: `slipscope answer "the block is dry"`
    """
    from app.cli.terminal import DONE, say
    from app.processes.launch import attached

    source = attached(bench, "answer")
    question = source.look().health.question
    if not question:
        raise UserError(f"answer: {source.title} asks nothing now; nothing was sent")
    source.answer(text, question)
    say(f"{question} {text}")
    return DONE


@command(app)
def pause(
    bench: RunningBench = None,
    cancel: Annotated[
        bool,
        Option("--cancel", help="Withdraw a pause that has been requested but has not begun."),
    ] = False,
) -> int:
    """Make the current run on this computer wait before its next step; `slipscope answer` continues
    it. Meanwhile the stage is at rest, and the limits stay active.

    Example: `slipscope pause`
    """
    from app.cli.terminal import DONE, say
    from app.processes.launch import attached

    source = attached(bench, "pause")
    if source.look().health.state != "running":
        raise UserError(f"pause: {source.title} is not under way; nothing was ordered")
    (source.cancel_pause if cancel else source.pause)()
    waits = "does not wait" if cancel else "waits"
    say(f"{source.title}: it {waits} before its next step{'' if cancel else ', if there is one'}")
    return DONE


@command(app)
def note(
    text: Annotated[str, Argument(help="The note, which is recorded with the time.")],
    bench: RunningBench = None,
) -> int:
    """Record a note in the session of the current run on this computer.

    Example: `slipscope note "somebody opened the door"`
    """
    from app.cli.terminal import DONE, say
    from app.processes.launch import attached

    source = attached(bench, "note")
    if source.look().health.state != "running":
        raise UserError(f"note: {source.title} is not under way; nothing was recorded")
    source.note(text)
    say(f"{source.title}: noted")
    return DONE


@command(app)
def replay(
    session: SessionFile,
    headless: Headless = False,
    pace: Annotated[
        str | None,
        option_of(
            "1|max|NUMBER",
            meaning="Seconds of the experiment per second; default: 1 in the window, otherwise"
            " max.",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        Option(
            "--set",
            metavar="TABLE.KEY=VALUE",
            help="Change one setting of the analysis; may be repeated.",
            autocompletion=completion.settings,
        ),
    ] = None,
    analysis: Annotated[
        Path | None,
        output_file("ANALYSIS.h5", "File for the new results; default: SESSION-analysis.h5."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Repeat the analysis of a recorded session and compare the results frame by frame, bit by bit;
    or analyse it with other settings.

    With --set or -o, every frame is analysed with these settings, and settings, versions, computer
    and results go to a second file beside the session, without the images. The session itself is
    only read. No device is needed, and none can be moved. A missing picture of a session or an
    analysis is drawn.

    Example: `slipscope replay sample7.h5 --set dic.box=32 --set sample.thickness=3 -o
    sample7-box32.h5`
    """
    from app.cli.run_and_replay import WindowStart, print_reports, run_to_end, window_problem
    from app.replay.reanalysis import Reanalysis
    from app.replay.replay import Replay
    from app.runs.run_source import PreparedSource
    from app.session.files import next_free

    problem = window_problem(headless)
    is_analysis = analysis is not None or bool(overrides)
    speed = parse_pace(pace or ("1" if problem is None and not is_analysis else "max"))

    def make() -> PreparedSource:
        if not is_analysis:
            return PreparedSource(Replay(session, pace=speed))
        path = analysis or next_free(session.with_stem(f"{session.stem}-analysis"))
        return PreparedSource(
            Reanalysis(session, path, pace=speed, overrides=overrides or (), overwrite=overwrite)
        )

    done = run_to_end(make, problem, as_json=as_json, window=WindowStart())
    return print_reports(done, as_json)
