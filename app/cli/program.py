"""The command `slipscope`: names, arguments and help of the commands, those of files and theory in
`app.cli.file_commands`, of many sessions in `app.cli.study_commands`. What a command does is in the
other modules of `app.cli`.

Nothing heavy is imported here, so that `slipscope --help` answers at once.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from app.cli import command_options as options
from app.cli import file_commands as files
from app.cli import study_commands as studies
from app.cli.command_options import (
    Bench,
    Headless,
    JsonFlag,
    Overrides,
    Overwrite,
    Pace,
    SessionFile,
    command,
    output,
    plain_errors,
)
from app.cli.streams import steady_streams
from app.cli.target import same_everywhere
from app.system import logs

EPILOG = """
Examples:

- `slipscope run` - a simulated loading experiment at P = 0.5 N
- `slipscope config > bench.toml` - every setting, with its meaning, unit and limits
- `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7` - your own bench, 0.7 N
- `slipscope replay sample7.h5` - the same analysis again, from the file

Exit codes: 0 done; 1 a device or the run failed; 2 an argument, file or setting can not be used.
"""

app = typer.Typer(
    name="slipscope",
    cls=options.Program,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=EPILOG,
)


def _show_version(is_wanted: bool) -> None:
    if is_wanted:
        from importlib import metadata

        try:
            typer.echo(f"slipscope {metadata.version('slipscope')}")
        except metadata.PackageNotFoundError:
            typer.echo("slipscope, not installed (running from its folder)")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def slipscope(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="The version, then exit."
        ),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    reproducible: Annotated[
        bool,
        typer.Option(
            "--reproducible",
            help="Compute with the instructions of x86-64-v3 only, so that other processors that"
            " have them give the same bits.",
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Show the log on standard error while a command runs.")
    ] = False,
) -> None:
    """Friction between a rough rubber block and a glass sphere, live: forces, images, displacement
    fields, stick radius.

    Without a command the window opens on the default (simulated) bench.
    """
    del version
    options.is_debugging = debug
    if verbose:
        logs.to_terminal()
    if reproducible:
        with plain_errors():
            same_everywhere()
    if context.invoked_subcommand is None:
        with plain_errors():
            from app.cli import run_and_replay as experiment

            raise typer.Exit(
                experiment.run(
                    None, None, False, "1", (), overwrite=False, as_json=False, autostart=False
                )
            )


@command(app)
def run(
    bench: Bench = None,
    session: Annotated[
        Path | None,
        output("SESSION.h5", "Session to write; else slipscope-DATE-TIME.h5 in this folder."),
    ] = None,
    headless: Headless = False,
    pace: Pace = "1",
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Run one loading experiment: press, take the reference, drive, report.

    Writes the session (HDF5, NeXus style) and beside it a picture of the same name (.png): Q
    against the stage displacement, the stick radius c against Q, u_x in time, and the u_x field at
    six instants. Ends with a, Q_s, mu_s, mu_d, t_s and the account of every frame and sample.
    Ctrl-C stops the block first, then closes the session in good order; what was measured is kept.

    Example (N and um): `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7 --set
    run.travel=200`
    """
    from app.cli import run_and_replay as experiment

    return experiment.run(
        bench, session, headless, pace, overrides or (), overwrite, as_json, autostart=True
    )


BENCH_NAME = typer.Argument(
    metavar="[BENCH]",
    help="Name of the bench, or its session; needed where more than one runs.",
    show_default=False,
)


@command(app)
def campaign(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="CAMPAIGN.toml", help="The runs, see docs/campaigns.md; or six-loads."
        ),
    ],
    folder: Annotated[
        Path | None,
        output("FOLDER", "Where the sessions and the page go; else a folder of its name."),
    ] = None,
    headless: Headless = False,
    pace: Pace = "1",
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN",
            help="Only these runs: 3, 2-4, or a name such as '*-0.5N'; may be repeated.",
        ),
    ] = None,
    retry: Annotated[
        bool, typer.Option("--retry", help="Do failed runs again; what there is of them is kept.")
    ] = False,
    checks_only: Annotated[
        bool, typer.Option("--check", help="Check everything and show the runs; do none.")
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Run experiments over loads, velocities, samples and repeats, one after the other; those that
    are done already are not done again.

    Everything is checked before anything moves. On a real bench the operator is told what to do
    before each run, and waited for. Ctrl-C stops the motion, then ends the campaign; the same
    command goes on, after a kill or a power cut as well. Nothing is replaced: what a repeated run
    has left goes to FOLDER/kept. FOLDER/index.html shows how far it is. The exit code is 1 if a run
    is not done.

    Example: `slipscope campaign six-loads --pace max`
    """
    from app.cli import campaign as campaigns

    return campaigns.campaign(
        file,
        folder,
        headless,
        pace,
        overrides or (),
        only or (),
        retry=retry,
        checks_only=checks_only,
        as_json=as_json,
    )


@command(app)
def attach(
    bench: Annotated[str | None, BENCH_NAME] = None,
    headless: Headless = False,
    as_json: JsonFlag = False,
) -> int:
    """Open a window on the run that is under way on this computer, whatever became of its own.

    Closing this window, or Ctrl-C, leaves the run as it is; its buttons act on it.

    Example: `slipscope attach`
    """
    from app.cli import run_and_replay as experiment

    return experiment.attach(bench, headless, as_json)


@command(app)
def stop(bench: Annotated[str | None, BENCH_NAME] = None) -> int:
    """Stop the motion of the run that is under way on this computer, then end it in good order;
    without a name, of every run of yours.

    Example: `slipscope stop`
    """
    from app.cli import run_and_replay as experiment

    return experiment.stop(bench)


@command(app)
def answer(
    text: Annotated[str, typer.Argument(metavar="[TEXT]", help="What is recorded.")] = "yes",
    bench: Annotated[
        str | None,
        typer.Option(help="Name of the bench, or its session; needed where more than one runs."),
    ] = None,
) -> int:
    """Answer the question of a step (`do = "ask"`) of the run that is under way on this computer.

    Example: `slipscope answer "the block is dry"`
    """
    from app.cli import run_and_replay as experiment

    return experiment.answer(text, bench)


@command(app)
def replay(
    session: SessionFile,
    headless: Headless = False,
    pace: Annotated[
        str | None,
        typer.Option(
            metavar="1|max|NUMBER",
            help="Seconds of the experiment per second; 1 in the window, else max.",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="TABLE.KEY=VALUE",
            help="Analyse with another setting; may be repeated.",
        ),
    ] = None,
    analysis: Annotated[
        Path | None, output("ANALYSIS.h5", "The new results; else SESSION-analysis.h5.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Send a saved session through the same analysis again and compare, frame by frame and bit by
    bit; or analyse it with other settings.

    With --set or -o every frame is analysed with these settings into a second file beside the
    session: settings, versions, computer, results; its images stay where they are. The session
    itself is only read, and no device is needed, nor can one be moved. A picture is drawn beside
    each if there is none.

    Example: `slipscope replay sample7.h5 --set dic.box=32 --set sample.thickness=3 -o
    sample7-box32.h5`
    """
    from app.cli import run_and_replay as experiment

    return experiment.replay(session, headless, pace, analysis, overrides or (), overwrite, as_json)


@command(app)
def info(
    session: SessionFile,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Read everything back and compare it with its checksums."),
    ] = False,
    as_json: JsonFlag = False,
) -> int:
    """Print what a session holds: how it ended, frames and samples, phases, results, changed
    settings, further analyses.

    With --verify the exit code is 1 if the session is not as it was recorded.
    """
    from app.cli import inspect

    return inspect.info(session, as_json, verify)


@command(app)
def config(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="A bench that comes with the program: hil-emulated, pci-6251, slide-hold-slide,"
            " cyclic-shear; or six-loads.",
        ),
    ] = None,
    overrides: Overrides = None,
) -> int:
    """Print the default settings, each with its meaning, unit and limits: `slipscope config >
    bench.toml`.

    With a name, the few settings of a bench, or the campaign, that comes with the program. With
    --set, all settings, among them those of a driver that is named by --set
    actuator.source=package.module:Class.
    """
    from app.campaigns.plan import campaign_names, campaign_text
    from app.settings.config import bench_text, load, to_toml

    if name in campaign_names() and not overrides:
        text = campaign_text(name)
    elif name is not None and not overrides:
        text = bench_text(name, campaign_names())
    else:
        text = to_toml(load(None if name is None else Path(name), overrides or ()))
    typer.echo(text, nl=False)
    return 0


@command(app)
def check(
    bench: Bench = None,
    home: Annotated[
        bool, typer.Option("--home", help="Let the stage look for its origin. It moves.")
    ] = False,
    move_um: Annotated[
        float,
        typer.Option(
            "--move",
            metavar="UM",
            help="Let the stage move by this distance in um at run.velocity, and back.",
            show_default=False,
        ),
    ] = 0.0,
    sync: Annotated[
        bool,
        typer.Option(
            "--sync",
            help="Measure when the exposure of a trigger is counted, and certify it for the"
            " sessions that follow.",
        ),
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Go through a bench and say what works: devices, samples, triggers, frames, sensors, picture.
    Nothing moves unless an option allows it.

    Takes two seconds of data and records nothing. The exit code is 1 if something does not work.

    Example: `slipscope check bench.toml --move 10`
    """
    from app.cli import device_commands as benches

    return benches.check(
        bench, overrides or (), home=home, move_um=move_um, sync=sync, as_json=as_json
    )


@command(app, "check-driver")
def check_driver(
    source: Annotated[
        str,
        typer.Argument(
            metavar="PACKAGE.MODULE:CLASS", help="The class of the driver, which can be imported."
        ),
    ],
    move: Annotated[
        bool,
        typer.Option("--move", help="Let the stage of an actuator move, by up to 1 mm both ways."),
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Try a driver of your own, with its device connected, against everything that a driver of its
    kind must do: one line for each contract.

    A camera is tried on the clock of the forces of the settings, the simulated ones if not set. The
    exit code is 1 if a contract is broken, 2 if there is no such driver.

    Example: `slipscope check-driver my_lab.stage:Stage --move --set actuator.port=COM3`
    """
    from app.cli import check_driver as driver_checks

    return driver_checks.check_driver(source, overrides or (), move=move, as_json=as_json)


@command(app)
def trust(
    code: Annotated[
        Path,
        typer.Argument(
            metavar="FILE|FOLDER", help="A GenTL producer, a module, or the folder of a package."
        ),
    ],
    as_json: JsonFlag = False,
) -> int:
    """Allow settings to run code that came with them: a GenTL producer, or a driver that lies
    beside them or in the current folder.

    It is known by its SHA-256: after any change it must be confirmed again. What it loads itself is
    trusted with it.

    Example: `slipscope trust my_stage.py`
    """
    from app.cli import device_commands as bench

    return bench.trust(code, as_json)


@command(app)
def cameras(
    producer: Annotated[
        str,
        typer.Option(
            metavar="FILE.cti",
            help="GenTL producer of a camera's vendor, whose cameras are listed as well.",
            show_default=False,
        ),
    ] = "",
    as_json: JsonFlag = False,
) -> int:
    """List the cameras on this computer, with what to write in the settings as camera.device."""
    from app.cli import device_commands as bench

    return bench.cameras(producer, as_json)


@command(app)
def doctor(as_json: JsonFlag = False) -> int:
    """Check this computer: versions, devices, display, disk, cores; what is missing and how to get
    it.

    The exit code is 1 if something that every run needs is missing.
    """
    from app.cli import device_commands as bench

    return bench.doctor(as_json)


app.add_typer(files.app)
app.add_typer(studies.app)


def main() -> None:
    """Read the command line, do it, and end the program with its exit code."""
    # the arrays here are small: threads of the linear algebra library would only take the cores
    # from the correlation
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with steady_streams():
        logs.tell_warnings(lambda sentence: typer.echo(f"slipscope: {sentence}", err=True))
        app(prog_name="slipscope")
