"""The commands of `slipscope` about many sessions: their analysis, and its figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.command_options import Bench, JsonFlag, Overrides, Overwrite, command, output_file

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
    results: Annotated[Path, output_file("RESULTS.h5", "File for the results.")],
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
    from app.cli.analyze import check_preset, done
    from app.study.analysis_plan import plan_analysis

    check_preset(preset)
    plan = plan_analysis(
        sessions, results, preset=preset, overrides=overrides or (), overwrite=overwrite
    )
    return done(plan, jobs, scheduler, overwrite=overwrite, as_json=as_json)


@command(app)
def sweep(
    results: Annotated[Path, output_file("RESULTS.h5", "File for the results.")],
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
    from app.cli.analyze import check_preset, done
    from app.study.sweep import swept

    check_preset(preset)
    plan = swept(
        bench, over, results, preset=preset, overrides=overrides or (), overwrite=overwrite
    )
    return done(plan, jobs, scheduler, overwrite=overwrite, as_json=as_json)


@command(app)
def figures(
    results: Annotated[
        Path,
        typer.Argument(metavar="RESULTS.h5", help="Results that `slipscope analyze` wrote."),
    ],
    folder: Annotated[
        Path, output_file("FOLDER", "Folder for the figures, their data and the report.")
    ],
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FIGURE|FORMAT",
            help="Further figures and formats, the same as behind --only and --format.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FIGURE...",
            help="Only these: 1, 2, 3, 4d, 5, 6a, 6b, 7 to 15, pressure, stiffness, law,"
            " dissipation, budget.",
        ),
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format", metavar="png|pdf|svg|eps...", help="Of each figure; else png, pdf."
        ),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            min=60,
            max=400,
            help="Of every figure; else 88 (a column) for one panel, 180 (a page) for several.",
            show_default=False,
        ),
    ] = None,
    colours: Annotated[
        str,
        typer.Option(
            metavar="paper|even|grey",
            help="Those of the paper; alike in lightness for the colour-blind; or grey to print.",
        ),
    ] = "paper",
    style: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE.mplstyle",
            help="A style sheet of matplotlib: fonts, sizes, lines.",
            show_default=False,
        ),
    ] = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """The figures of the paper from the results of several runs, with their data, every number and
    a report.

    Each figure comes with its data (.csv) beside it. summary.json holds every number with its
    uncertainties by noise and by the inputs, what each input costs, and the paper's value;
    report.html (one file, works without a network) and report.md hold the same, with the figures
    and the table that the Good Practices Guide for digital image correlation asks for. Figures
    have the width of a journal's column or page, 300 dpi and TrueType fonts. Where the
    paper shows a load that was not run, the nearest one is shown, and the caption says so. The
    same results give the same files.

    Example: `slipscope figures results.h5 -o paper --only 5 6a 15 --format svg`
    """
    from app.cli.figure_files import check, chosen, looks, write, written
    from app.cli.terminal import DONE, Bar, output, print_json
    from app.session.results import read_results
    from app.system.outputs import check_output_folder, new_folder

    names, kinds = chosen(words or (), only or (), formats or ())
    look = looks(width or 0.0, colours, style)
    check_output_folder(folder, overwrite)
    held = read_results(results)
    check(held, results)
    with (
        new_folder(folder, overwrite, written(names)) as unfinished,
        Bar("drawing", quiet=as_json) as bar,
    ):
        data = write(held, unfinished, names, kinds, bar.show, look)
    if as_json:
        print_json(data)
        return DONE
    drawn = 0
    for name, one in data["figures"].items():
        if "left_out" in one:
            output().print(f"left out: figure {name}, {one['left_out']}")
        drawn += "left_out" not in one
    output().print(f"written: {folder}: {drawn} figures, summary.json, report.html, report.md")
    return DONE
