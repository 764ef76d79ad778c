"""The command `slipscope`: names, arguments and help of the commands, those of files and theory in
`app.cli.file_commands`, of many sessions in `app.cli.study_commands`. What a command does is in the
other modules of `app.cli`.

Nothing heavy is imported here, so that `slipscope --help` answers at once.
"""

from __future__ import annotations

import os
from typing import Annotated

import typer
from typer import Option, Typer

from app.cli import (
    command_options,
    device_commands,
    file_commands,
    inspect,
    invert,
    model,
    run_commands,
    study_commands,
    tradeoff,
)
from app.cli.command_options import plain_errors
from app.cli.streams import steady_streams
from app.cli.target import same_everywhere
from app.system import algebra_threads, logs

EPILOG = """
Examples:

- `slipscope run` - a simulated loading experiment at P = 0.5 N
- `slipscope config > bench.toml` - every setting, with its meaning, unit and limits
- `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7` - your own bench, 0.7 N
- `slipscope replay sample7.h5` - the same analysis again, from the file

`slipscope doctor` names the folder of the manual; Help > Manual shows it in the window.

Exit codes: 0 done; 1 a device or the run failed, or Ctrl-C; 2 an argument, file or setting cannot
be used.
"""

app = Typer(
    name="slipscope",
    cls=command_options.Program,
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
        Option(
            "--version", callback=_show_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
    debug: Annotated[bool, Option("--debug", help="Show the traceback of an error.")] = False,
    reproducible: Annotated[
        bool,
        Option(
            "--reproducible",
            help="Use only the instructions of x86-64-v3, so that other processors with these"
            " instructions give the same bits.",
        ),
    ] = False,
    verbose: Annotated[
        bool, Option("--verbose", help="Show the log on standard error while a command runs.")
    ] = False,
) -> None:
    """Measure the friction between a rough rubber block and a glass sphere: forces, images,
    displacement fields, stick radius, live.

    Without a command, the window opens on the default (simulated) bench.
    """
    del version
    command_options.is_debugging = debug
    if verbose:
        logs.to_terminal()
    if reproducible:
        with plain_errors():
            same_everywhere()
    if context.invoked_subcommand is None:
        with plain_errors():
            from app.cli.run_and_replay import WindowStart, run_and_report

            raise typer.Exit(run_and_report(WindowStart(), headless=False, autostart=False))


for family in (
    run_commands, inspect, device_commands, file_commands, study_commands, model, invert, tradeoff,
):  # fmt: skip
    app.add_typer(family.app)
app.add_typer(
    Typer(cls=command_options.Calibrations, no_args_is_help=True),
    name="calibrate",
    help="Calibrate a bench or its sample: a guided run, or existing files, give a certificate"
    " with values, uncertainties, data and a picture. Settings name it in"
    " `calibration.certificates`.",
)


def main() -> None:
    """Read the command line, do it, and end the program with its exit code."""
    os.environ.setdefault(algebra_threads.VARIABLE, "1")
    with steady_streams():
        logs.tell_warnings(lambda sentence: typer.echo(f"slipscope: {sentence}", err=True))
        app(prog_name="slipscope")
