"""The commands of `slipscope` that work on files and on theory, without a bench: names, arguments
and help.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.settings import Correlation
from app.cli.command_options import (
    Given,
    JsonFlag,
    Overrides,
    Overwrite,
    SessionFile,
    command,
    output,
)
from app.settings.sections import InversionSettings, ModelSettings

app = typer.Typer()


@command(app)
def dic(
    reference: Annotated[
        Path,
        typer.Argument(
            metavar="REFERENCE",
            help="The image before any displacement; the first of a folder, or of a TIFF of many"
            " pages.",
        ),
    ],
    images: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="IMAGE...",
            help="Images to compare with it, in order; folders and TIFFs of many pages, too.",
            show_default=False,
        ),
    ] = None,
    *,
    fields: Annotated[Path, output("FIELDS.h5|.csv|.npz", "File for the fields.")],
    correlation: Correlation,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="IMAGE", help="Image of the same size: pixels that are not 0 may be used."
        ),
    ] = None,
    roi: Annotated[
        tuple[int, int, int, int] | None,
        typer.Option(
            metavar="LEFT TOP RIGHT BOTTOM",
            help="Region of the box centres [px]. Without it, the whole image.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Displacement fields between plain image files: grey PNG or TIFF, 8 or 16 bit, all of one
    size.

    A CSV begins with the columns frame,x_px,y_px,ux_px,uy_px,status: frame 1 is the first image
    after the reference, x_px and y_px are box centres with (0, 0) the centre of the top-left pixel,
    y points down, status says ok or why a point is lost. Ends with the points per second, the
    medians of standard uncertainty and correlation, and how many points were lost and why.

    Example: `slipscope dic rest.tif pull_*.tif -o fields.csv --box 27`
    """
    from app.cli import file_exchange as files

    return files.dic(
        reference,
        images or [],
        fields,
        correlation,
        mask=mask,
        roi=roi,
        overwrite=overwrite,
        as_json=as_json,
    )


@command(app)
def model(
    system: ModelSettings,
    shear_force: Annotated[
        float | None, typer.Option(help="Shear force Q of the profiles [N].")
    ] = None,
    share: Annotated[
        float | None, typer.Option(help="Or Q/(mu P), 0 to 1; without either, 0.6.")
    ] = None,
    curves: Annotated[
        Path | None, output("FILE.csv|.png|.pdf|.svg", "File for the curves.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """What theory says of the contact: radii, pressures, stick radius, displacement of the block;
    and the curves, as a table or a figure.

    The curves are p(r), sigma_xz(r) and u_x(r) at the shear force Q, and Q over the displacement of
    the block, with those of Cattaneo and Mindlin beside. The defaults are those of the paper, at
    0.5 N. Needs no bench.

    Example: `slipscope model --normal-force 1.4 --share 0.9 -o contact.png`
    """
    from app.cli import model as theory

    return theory.model(system, curves, shear_force, share, overwrite=overwrite, as_json=as_json)


@command(app)
def invert(
    fields: Annotated[
        Path,
        typer.Argument(
            metavar="FIELDS.h5|.csv", help="A session, a file of `slipscope dic`, or a table."
        ),
    ],
    given: Annotated[dict[str, float], Given(InversionSettings)],
    frames: Annotated[
        list[int] | None,
        typer.Option("--frame", help="Only this field; may be repeated. Without it, all."),
    ] = None,
    tractions: Annotated[Path | None, output("FILE.csv|.npz", "File for the tractions.")] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Shear tractions sigma_xz from displacement fields, by the Green's tensor of the block; the
    block's far displacement D is fitted.

    A session holds its own E, nu, R, P and pixel size, which options replace. A table has a header
    with x, y, ux and their units: x_px, y_mm, ux_um; ux_sd and frame if there are any; nan where
    nothing was measured. u_x is counted in the frame of the sphere, which stands still.

    Example: `slipscope invert fields.csv --E 3.43 --poisson 0.5 --radius 128.8 --normal-force 0.5
    --pixel 7.04 -o sigma.csv`
    """
    from app.cli import invert as inversion

    return inversion.invert(
        fields, tractions, given, frames or [], overwrite=overwrite, as_json=as_json
    )


@command(app)
def figures(
    results: Annotated[
        Path,
        typer.Argument(metavar="RESULTS.h5", help="Results that `slipscope analyze` wrote."),
    ],
    folder: Annotated[Path, output("FOLDER", "Folder for the figures, their data and the report.")],
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
            help="Only these: 2, 3, 4d, 5, 6a, 6b, 7 to 15, pressure, stiffness, law, dissipation,"
            " budget.",
        ),
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", metavar="png|pdf|svg...", help="Of each figure; else png, pdf."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """The figures of the paper from the results of several runs, with their data, every number and
    a report.

    Each figure comes with its data (.csv) beside it. summary.json holds every number with its
    uncertainties by noise and by the inputs, what each input costs, and the paper's value;
    report.html (one file, works without a network) and report.md hold the same, with the figures
    and the table that the Good Practices Guide for digital image correlation asks for. Where the
    paper shows a load that was not run, the nearest one is shown, and the caption says so. The
    same results give the same files.

    Example: `slipscope figures results.h5 -o paper --only 5 6a 15 --format svg`
    """
    from app.cli import figure_files as drawing

    return drawing.figures(
        results,
        folder,
        words or [],
        only or [],
        formats or [],
        overwrite=overwrite,
        as_json=as_json,
    )


@command(app)
def tradeoff(
    pictures: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="REFERENCE REST",
            help="Your picture, and others of the same at rest; else standard speckle.",
            show_default=False,
        ),
    ] = None,
    rest: Annotated[
        list[Path] | None,
        typer.Option(metavar="IMAGE...", help="Pictures at rest, the same as behind REFERENCE."),
    ] = None,
    methods: Annotated[
        list[str] | None,
        typer.Option("--method", metavar="shared|icgn|direct", help="Only this; may be repeated."),
    ] = None,
    boxes: Annotated[
        list[int] | None,
        typer.Option("--box", metavar="PX", help="Only this box; may be repeated."),
    ] = None,
    rate_hz: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Pictures per second to keep up with.")
    ] = 23.8,
    free: Annotated[
        float, typer.Option(metavar="SHARE", help="Of this computer, to be left free meanwhile.")
    ] = 0.5,
    period_px: Annotated[
        float | None,
        typer.Option(
            "--period",
            metavar="PX",
            help="Waves of u_x this long must be passed; else those of the standard settings.",
        ),
    ] = None,
    threads: Annotated[int, typer.Option(min=1, max=64, help="Of the correlation.")] = 2,
    full_scale: Annotated[
        int, typer.Option(min=0, max=65535, help="End of the grey scale, 4095 for 12 bit.")
    ] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer variants and smaller pictures, in a minute.")
    ] = False,
    results: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE.json",
            help="File for all figures. What an earlier, unfinished run left there is continued.",
        ),
    ] = None,
    picture: Annotated[Path | None, output("FILE.png|.pdf|.svg", "File for the picture.")] = None,
    overwrite: Overwrite = False,
) -> int:
    """Speed against accuracy on this computer, for your texture and its noise: bias, sigma, spatial
    resolution and cost of every method, box, step, interpolant and tolerance.

    The grains, the contrast and the noise of the picture are measured and speckle of the same kind
    is made of blobs, which can be moved exactly. The period is that of the wave of u_x of which
    90 % of the amplitude is measured. A star marks what no other one beats. Ends with what to use
    for --rate frames/s. Takes minutes; Ctrl-C leaves, and the same command goes on from --json.

    Example: `slipscope tradeoff rest_000.tif rest_*.tif --json trade.json -o trade.png`
    """
    from app.cli import tradeoff as trade

    return trade.tradeoff(
        pictures or [],
        rest or [],
        methods=methods or [],
        boxes=boxes or [],
        rate_hz=rate_hz,
        free=free,
        period_px=period_px,
        threads=threads,
        full_scale=full_scale,
        quick=quick,
        results=results,
        picture=picture,
        overwrite=overwrite,
    )


@command(app)
def export(
    held: Annotated[
        Path,
        typer.Argument(
            metavar="SESSION.h5|RESULTS.h5", help="A session, or what `slipscope analyze` wrote."
        ),
    ],
    destination: Annotated[Path, output("FOLDER|FILE.csv|.npz|.mat|.pvd", "Where to write it.")],
    what: Annotated[
        str,
        typer.Option(
            metavar="TABLE",
            help="What a .csv holds: fields (if not given), results, forces, rings, stress, law,"
            " pressure, summary, budget, cycles, slides, notes, profile, run, triggers, stage,"
            " events, gaps, counts or versions. Of results: summary (if not given), runs, joint,"
            " joint_notes, results, rings, stress, law, pressure, budget, cycles, slides, notes,"
            " profile, fields, noise or made_with. What a folder holds: images (if not given) or"
            " tables, which are all of these.",
            show_default=False,
        ),
    ] = "",
    frames: Annotated[
        str,
        typer.Option(
            metavar="FIRST:END:STEP",
            help="Only these triggers, END not included; or a single one.",
            show_default=False,
        ),
    ] = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Write what a session or a file of results holds as files of other programs.

    A folder gets the raw images (TIFF, lossless), metadata.csv with the fate of every frame,
    forces.csv and settings.toml, which `slipscope import` reads again. A .csv is one table, an
    observation in each row: displacement fields as `slipscope dic` writes them, u_x(r) and sigma(r)
    of each frame, p(r), the uncertainty by each input, ...; .npz and .mat hold all of them as
    arrays; .pvd is a series of displacement fields for ParaView, in m, y upwards. Columns are named
    by quantity and unit, ux_sd_um is the standard uncertainty of ux_um. Tables of results hold all
    runs, told apart by their columns run and P_N.

    Example: `slipscope export sample7.h5 -o rings.csv --what rings --frames 100:400:10`
    """
    from app.cli import file_exchange as files

    return files.export(held, destination, what, frames, overwrite=overwrite, as_json=as_json)


@command(app, "import")
def import_(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER|IMAGE...",
            help="Grey PNG or TIFF, 8 or 16 bit; a TIFF may hold many images.",
        ),
    ],
    session: Annotated[Path, output("SESSION.h5", "Session to write.")],
    forces: Annotated[
        Path | None,
        typer.Option(
            metavar="FORCES.csv",
            help="time_s or sample; P_N and Q_N, or normal_V and shear_V; stage_um; or what other"
            " programs call them.",
        ),
    ] = None,
    metadata: Annotated[
        Path | None,
        typer.Option(
            metavar="METADATA.csv",
            help="One row per frame: frame, sample or time_s, file, phase, reason.",
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            metavar="BENCH.toml", help="Sample, sensors, correlation; see `slipscope config`."
        ),
    ] = None,
    pixel_um: Annotated[
        float | None, typer.Option("--pixel", metavar="UM", help="Size of a pixel.")
    ] = None,
    frame_rate: Annotated[
        float | None,
        typer.Option("--frame-rate", metavar="HZ", min=1e-6, max=1e6, help="Images per second."),
    ] = None,
    rate_hz: Annotated[
        int | None,
        typer.Option("--rate", metavar="HZ", help="Force samples per second; else of the table."),
    ] = None,
    divisor: Annotated[int | None, typer.Option(help="Samples from one image to the next.")] = None,
    offset_s: Annotated[
        float | None,
        typer.Option(
            "--time-offset",
            metavar="SECONDS",
            help="Added to the times of the forces to have those of the images; else what the start"
            " of the motion in both says.",
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TEXT",
            help='Which column is what, by its name or number: "time_s=Zeit, P_mN=Last, Q_mN=3".',
        ),
    ] = None,
    delimiter: Annotated[
        str | None,
        typer.Option(metavar="SIGN", help="Between cells: , ; | tab space; else found."),
    ] = None,
    decimal: Annotated[
        str | None, typer.Option(metavar="SIGN", help="In numbers: . or ,; else found.")
    ] = None,
    encoding: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the tables, such as latin-1; else found.")
    ] = None,
    background: Annotated[
        int | None,
        typer.Option(metavar="FRAME", help="Image of the free block; else the last with P near 0."),
    ] = None,
    reference: Annotated[
        int | None,
        typer.Option(
            metavar="FRAME", help="Image at rest under load; else the last before the drive."
        ),
    ] = None,
    drive: Annotated[
        int | None,
        typer.Option(metavar="FRAME", help="First frame of the drive; else from where Q rises."),
    ] = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Make a session of images and forces of other benches and programs, and analyse it; `slipscope
    replay` then repeats that to the bit.

    Images are taken in the order of the numbers in their names, frame 0 first; a missing number is
    a lost frame. In a folder metadata.csv, forces.csv and settings.toml are used if they are there.
    How a table is written, which image is the background and which the reference, where the drive
    begins and whether both clocks are the same is found and told; options say otherwise. Between
    the rows of a table forces are interpolated linearly; where rows are missing there is a gap.
    What can not be found, such as the size of a pixel, is asked for at once. The exit code is 1 if
    nothing could be measured.

    Example: `slipscope import images -o other.h5 --forces load.csv --pixel 5.2 --frame-rate 10`
    """
    from app.cli import file_exchange as files
    from app.files.forms import TableForm
    from app.files.frames import Sources

    sources = Sources(
        images=images,
        metadata=metadata,
        forces=forces,
        settings=settings,
        pixel_um=pixel_um,
        rate_hz=rate_hz,
        divisor=divisor,
        frame_rate=frame_rate,
        offset_s=offset_s,
        form=TableForm.given(columns or (), delimiter, decimal, encoding),
        background=background,
        reference=reference,
        drive=drive,
        overrides=overrides or (),
    )
    return files.import_(sources, session, overwrite=overwrite, as_json=as_json)


@command(app)
def repair(
    session: SessionFile,
    repaired: Annotated[Path, output("REPAIRED.h5", "Session to write.")],
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Bring back every frame and sample of a session that was cut short, into a new file; the
    session itself is only read.

    Uses the journal (SESSION.h5.journal) that lies beside a session until it is closed in good
    order. Says what was lost.
    """
    from app.cli import file_exchange as files

    return files.repair(session, repaired, overwrite, as_json)
