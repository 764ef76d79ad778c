"""The commands of `slipscope` about many sessions: names, arguments and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.command_options import Bench, JsonFlag, Overrides, Overwrite, command, output

app = typer.Typer()

Preset = Annotated[
    str,
    typer.Option(
        metavar="finest|accurate|fast|session",
        help="Image correlation; session: that of the settings of each.",
    ),
]
Jobs = Annotated[
    int,
    typer.Option(
        min=0, max=1024, help="Sessions at a time; 0: as many as processors and memory allow."
    ),
]
Scheduler = Annotated[
    str,
    typer.Option(
        "--dask",
        metavar="tcp://HOST:8786",
        help="Analyse on the workers of this Dask scheduler, which see the same folders.",
    ),
]


@command(app)
def analyze(
    sessions: Annotated[
        list[Path],
        typer.Argument(metavar="SESSION.h5...", help="Sessions that `slipscope run` wrote."),
    ],
    results: Annotated[Path, output("RESULTS.h5", "File for the results.")],
    preset: Preset = "finest",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="TABLE.KEY=VALUE",
            help="Analyse all of them with another setting; may be repeated.",
        ),
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """The full analysis of one session or hundreds, and what they have in common: a(P), Q_s(P),
    mu(P), E, L, the stiffness of the interface, each with its uncertainty.

    Every image is correlated again. What is done is kept beside the results: after an interruption
    the same command goes on. The results do not depend on --jobs or --dask, to the bit. Sessions
    must be of one bench and one sample.

    Example: `slipscope analyze load-*.h5 -o results.h5`
    """
    from app.cli import analyze as study

    return study.analyze(
        sessions,
        results,
        preset=preset,
        overrides=overrides or (),
        jobs=jobs,
        scheduler=scheduler,
        overwrite=overwrite,
        as_json=as_json,
    )


@command(app)
def sweep(
    results: Annotated[Path, output("RESULTS.h5", "File for the results.")],
    over: Annotated[
        list[str],
        typer.Option(
            metavar="TABLE.KEY=V1;V2;...", help="Values that a setting takes; may be repeated."
        ),
    ],
    bench: Bench = None,
    preset: Preset = "session",
    overrides: Overrides = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Simulated runs over a grid of settings, each analysed as by `slipscope analyze`; nothing but
    the results is kept.

    With several --over every value goes with every value of the others. The runs of the results are
    in this order, and their notes say which they are.

    Example: `slipscope sweep --set sim.law=elasto-plastic --over "sim.slip_length=0.4;0.8;1.6"
    --over "run.normal_force=0.3;0.5" -o sweep.h5`
    """
    from app.cli import analyze as study

    return study.sweep(
        bench,
        over,
        results,
        preset=preset,
        overrides=overrides or (),
        jobs=jobs,
        scheduler=scheduler,
        overwrite=overwrite,
        as_json=as_json,
    )
