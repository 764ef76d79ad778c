"""The commands of `slipscope` about many sessions: their analysis, and its figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from app.cli import completion
from app.cli.command_options import (
    Bench,
    JsonFlag,
    Overrides,
    Overwrite,
    command,
    option_of,
    output_file,
)
from app.cli.names import WIDTHS_MM

app = Typer()

Preset = Annotated[
    str,
    option_of(
        "finest|accurate|fast|session",
        meaning="Preset of the image correlation; session: the one of each session.",
    ),
]
Jobs = Annotated[
    int,
    Option(
        min=0,
        max=1024,
        help="Number of sessions at a time; 0: as many as processors and memory allow.",
    ),
]
Scheduler = Annotated[
    str,
    Option(
        "--dask",
        metavar="tcp://HOST:8786",
        help="Analyse on the workers of this Dask scheduler, which must reach the same folders.",
    ),
]
Results = Annotated[Path, output_file("RESULTS.h5", "File for the results.")]


@command(app)
def analyze(
    sessions: Annotated[
        list[Path],
        Argument(
            metavar="SESSION.h5...",
            help="Sessions written by `slipscope run`.",
            autocompletion=completion.files(".h5"),
        ),
    ],
    results: Results,
    preset: Preset = "finest",
    overrides: Annotated[
        list[str] | None,
        Option(
            "--set",
            metavar="TABLE.KEY=VALUE",
            help="Change one setting of all analyses; may be repeated.",
            autocompletion=completion.settings,
        ),
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Analyse one or hundreds of sessions in full, and compute their common results: a(P), Q_s(P),
    mu(P), E, L and the stiffness of the interface, each with its uncertainty.

    Every image is correlated again. Completed parts are kept beside the results; after an
    interruption, the same command resumes. The results do not depend on --jobs or --dask, to the
    bit. All sessions must be of one bench and one sample.

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
    results: Results,
    over: Annotated[
        list[str],
        Option(
            metavar="TABLE.KEY=V1;V2;...",
            help="Values of a setting; may be repeated.",
            autocompletion=completion.settings,
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
    """Simulate runs over a grid of settings and analyse each as `slipscope analyze` does; only the
    results are kept.

    Several --over give all combinations of their values. The runs in the results are in this order,
    and their notes name the values.

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
        Argument(
            metavar="RESULTS.h5",
            help="Results written by `slipscope analyze`.",
            autocompletion=completion.files(".h5"),
        ),
    ],
    folder: Annotated[
        Path, output_file("FOLDER", "Folder for the figures, their data and the report.")
    ],
    words: Annotated[
        list[str] | None,
        Argument(
            metavar="FIGURE|FORMAT",
            help="Further figures and formats, as for --only and --format.",
            show_default=False,
            autocompletion=completion.figures,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        Option(
            metavar="FIGURE...",
            help="Only these: 1, 2, 3, 4, 4d, 5, 6a, 6b, 7 to 15, pressure, stiffness, law,"
            " dissipation, budget.",
            autocompletion=completion.figures,
        ),
    ] = None,
    formats: Annotated[
        list[str] | None,
        option_of(
            "png|pdf|svg|eps...", "--format", meaning="Formats of each figure; default: png, pdf."
        ),
    ] = None,
    width: Annotated[
        float | None,
        Option(
            metavar="MM",
            min=WIDTHS_MM[0],
            max=WIDTHS_MM[1],
            help="Width of every figure; default: 88 (a column) for one panel, 180 (a page) for"
            " several.",
            show_default=False,
        ),
    ] = None,
    colours: Annotated[
        str,
        option_of(
            "paper|even|grey",
            meaning="Colours of the paper, even lightness for the colour-blind, or grey for"
            " printing.",
        ),
    ] = "paper",
    style: Annotated[
        str,
        Option(
            metavar="NAME|FILE.mplstyle",
            help="Style sheet of matplotlib: fonts, sizes, lines.",
            show_default=False,
        ),
    ] = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Draw the figures of the paper from the results of several runs, with their data, all numbers
    and a report.

    The data of each figure (.csv) lie beside it. summary.json contains every number with its
    uncertainties from noise and from the inputs, the contribution of each input, and the paper's
    value; report.html (one file, works without a network) and report.md contain the same, with the
    figures and the table required by the Good Practices Guide for digital image correlation.
    Figures have the width of a journal's column or page, 300 dpi and TrueType fonts. If the
    paper shows a load that was not run, the nearest one is shown, and the caption says so. The same
    results give the same files.

    Example: `slipscope figures results.h5 -o paper --only 5 6a 15 --format svg`
    """
    from app.cli.figure_files import chosen, looks, write_figures
    from app.cli.terminal import DONE, Bar, print_json, print_line
    from app.records.quantities import counted

    names, kinds = chosen(words or (), only or (), formats or ())
    look = looks(width or 0.0, colours, style)
    with Bar("drawing", quiet=as_json) as bar:
        data = write_figures(
            results, folder, names, kinds, overwrite=overwrite, show=bar.show, look=look
        )
    if as_json:
        print_json(data)
        return DONE
    drawn = 0
    for name, one in data["figures"].items():
        if "left_out" in one:
            print_line(f"left out: figure {name}, {one['left_out']}")
        drawn += "left_out" not in one
    drawn_text = counted(drawn, "figure")
    print_line(f"written: {folder}: {drawn_text}, summary.json, report.html, report.md")
    return DONE
